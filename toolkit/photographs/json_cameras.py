"""Reading cameras from JSON: views with K and R, what Gaussian splatting writes, and other programs' by their content."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.errors import FileError, InputError
from intaglio.photographs.camera_parts import View, Views, intrinsic, matrix, number, numbers, pixels, pose, read_json, short
from intaglio.photographs.lens import MODELS, coefficient_names
from intaglio.photographs.meshroom_cameras import meshroom_views
from intaglio.photographs.nerf_cameras import nerf_views
from intaglio.photographs.openmvg_cameras import openmvg_views

# Keys that would change where a point appears, if they were understood.
_LENS = re.compile(r"(?i)^(k|p|s|b|t|tau)_?\d+$|dist|lens|skew|tangential|radial|omega|fisheye|camera_model")
_UNDERSTOOD = ("K", "R", "t", "C", "distortion", "model")


def json_views(path: Path) -> Views:
    """Read a JSON file of whatever program, told by its content."""
    try:
        data = read_json(path, _without_repeats)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from problem
    if isinstance(data, dict):
        if isinstance(data.get("frames"), list):
            return nerf_views(path, data)
        if "sfm_data_version" in data or ("extrinsics" in data and "root_path" in data):
            return openmvg_views(path, data)
        if isinstance(data.get("intrinsics"), list) or ("version" in data and isinstance(data.get("views"), list)):
            return meshroom_views(path, data)
        if isinstance(data.get("views"), list | dict):
            data = data["views"]
    if isinstance(data, list):
        if data and all(isinstance(view, dict) and {"img_name", "rotation", "position"} <= view.keys() for view in data):
            return _splat_views(path, data)
        views = [(view.get("image") if isinstance(view, dict) else None, view) for view in data]
    elif isinstance(data, dict):
        views = [(view.get("image", name) if isinstance(view, dict) else name, view) for name, view in data.items()]
    else:
        raise FileError(f"{path}: holds neither a list nor an object of views")
    found = Views()
    for place, (name, view) in enumerate(views, 1):
        if not isinstance(view, dict):
            raise InputError(f"{path}: view {place} is no object with K, R, and t or C, but {short(view)}")
        if not isinstance(name, str) or not name:
            raise InputError(f"{path}: view {place} has no file name of its photograph (image): {short(name)}")
        try:
            one = _view(name, view)
        except InputError as problem:
            raise InputError(f"{path}: view {short(name)}: {problem}") from problem
        if one is not None:
            found.views.append(one)
    return found


def _view(name: str, view: dict[str, Any]) -> View | None:
    """Return a view with K, R, and t or C; None for one that is not present."""
    present = view.get("present", True)
    if not isinstance(present, bool):
        raise InputError(f"present must be true or false, not {short(present)}")
    if not present:
        return None
    missing = [key for key in ("K", "R") if key not in view]
    if missing or not ({"t", "C"} & view.keys()):
        raise InputError(f"lacks {', '.join(missing) or 't (or C)'}")
    if ("width" in view) != ("height" in view):
        raise InputError("has only one of width and height")
    strange = [key for key, value in view.items() if key not in _UNDERSTOOD and _LENS.search(key) and _counts(value)]
    if strange:
        raise InputError(
            f"{short(strange[0])} would change the picture and is not understood; a lens is given by distortion and model"
        )
    turn = matrix(view["R"], (3, 3), "R")
    values: dict[str, Any] = {"K": matrix(view["K"], (3, 3), "K"), "R": turn}
    if "t" in view:
        values["t"] = numbers(_flat(view["t"]), 3, "t")
    else:
        values["t"] = -turn @ numbers(_flat(view["C"]), 3, "C")
    if "width" in view:
        values["size"] = (pixels(view["height"], "height"), pixels(view["width"], "width"))
    model = view.get("model", "opencv")
    if not isinstance(model, str) or model not in MODELS:
        raise InputError(f"model must be one of {', '.join(MODELS)}, not {short(model)}")
    given = view.get("distortion", [])
    if isinstance(given, dict):
        known = coefficient_names(model)
        strange = [key for key in given if key not in known]
        if strange:
            raise InputError(f"distortion has {short(strange[0])}; the model {model!r} has {', '.join(known)}")
        given = [given.get(key, 0.0) for key in known]
    return View(name, {**values, "distortion": numbers(given, None, "distortion"), "model": model})


def _flat(value: Any) -> Any:
    """Return a vector that may be written as a column."""
    if isinstance(value, list) and all(isinstance(v, list) and len(v) == 1 for v in value):
        return [v[0] for v in value]
    return value


def _counts(value: Any) -> bool:
    """Return whether a value is anything but nothing."""
    if isinstance(value, list):
        return any(_counts(v) for v in value)
    return not (value is None or value is False or (isinstance(value, int | float) and value == 0))


def _splat_views(path: Path, data: list[dict[str, Any]]) -> Views:
    """The cameras.json of Gaussian splatting: rotation from the camera to the world, position, fx, fy, width and height."""
    found = Views()
    for view in data:
        name = view["img_name"]
        if not isinstance(name, str) or not name:
            raise InputError(f"{path}: a view's img_name is no file name: {short(name)}")
        try:
            width, height = pixels(view.get("width"), "width"), pixels(view.get("height"), "height")
            fx, fy = number(view.get("fx"), "fx"), number(view.get("fy"), "fy")
            turn = matrix(view["rotation"], (3, 3), "rotation").T
            values = {"K": intrinsic(fx, fy, (width - 1) / 2, (height - 1) / 2), "size": (height, width)}
            found.views.append(View(name, {**values, **pose(np.asarray(numbers(view["position"], 3, "position")), turn)}))
        except InputError as problem:
            raise InputError(f"{path}: view {short(name)}: {problem}") from problem
    return found


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise InputError(f"a name is given twice: {short(next(n for n in names if names.count(n) > 1))}")
    return found
