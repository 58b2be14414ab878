"""Reading transforms.json, as nerfstudio and instant-ngp write it: OpenGL's axes, pixels counted from the first one's corner."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.photographs.camera_parts import OPENGL, View, Views, intrinsic, matrix, number, pixels, pose, short

# The coefficients of a polynomial lens and of a fisheye, and other keys that would be coefficients.
_BROWN = ("k1", "k2", "k3", "k4", "p1", "p2")
_FISHEYE = ("k1", "k2", "k3", "k4")
_COEFFICIENT = re.compile(r"^([kpsb]_?\d+|ftheta_.*|lens|latlong|equirect.*)$")

_MODELS = {
    "SIMPLE_PINHOLE": (),
    "PINHOLE": (),
    "SIMPLE_RADIAL": _BROWN,
    "RADIAL": _BROWN,
    "OPENCV": _BROWN,
    "PERSPECTIVE": _BROWN,
    "OPENCV_FISHEYE": _FISHEYE,
    "FISHEYE": _FISHEYE,
}


def nerf_views(path: Path, data: dict[str, Any]) -> Views:
    """Read the frames; what they don't say themselves is said for all of them."""
    found = Views()
    try:
        undo = _undo(data)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from problem
    if undo is not None:
        found.notes.append(
            "the transform that was applied to its poses (applied_transform, applied_scale) is undone; take it out of the file "
            "if the mesh has been transformed as well"
        )
    for place, frame in enumerate(data["frames"], 1):
        name = frame.get("file_path") if isinstance(frame, dict) else None
        if not isinstance(name, str) or not name:
            raise InputError(f"{path}: frame {place} has no file_path")
        name = name.removeprefix("./")
        try:
            found.views.append(View(name, _camera({**data, **frame}, undo)))
        except InputError as problem:
            raise InputError(f"{path}: frame {short(name)}: {problem}") from problem
    return found


def _undo(data: dict[str, Any]) -> tuple[Array, Array, float] | None:
    """Return rotation, translation and scale of the transform from the original coordinates to the file's; None for none."""
    applied, scale = data.get("applied_transform"), number(data.get("applied_scale", 1.0), "applied_scale")
    if scale <= 0:
        raise InputError(f"applied_scale must be above 0, not {scale:g}")
    whole = np.eye(4)[:3]
    if applied is not None:
        rows = applied[:3] if isinstance(applied, list) else applied
        whole = matrix(rows, (3, 4), "applied_transform")
    turn = whole[:, :3]
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-3 or np.linalg.det(turn) < 0:
        raise InputError("applied_transform is no rotation and translation")
    return None if scale == 1 and (whole == np.eye(4)[:3]).all() else (turn, whole[:, 3], scale)


def _camera(frame: dict[str, Any], undo: tuple[Array, Array, float] | None) -> Any:
    name = frame.get("camera_model", "OPENCV_FISHEYE" if frame.get("is_fisheye") else "OPENCV")
    if not isinstance(name, str) or name.upper() not in _MODELS:
        raise InputError(f"camera_model {short(name)} is not known; known: {', '.join(_MODELS)}")
    known = _MODELS[name.upper()]
    for key, value in frame.items():
        if _COEFFICIENT.match(key) and key not in known and value not in (0, 0.0, False, None):
            raise InputError(f"{short(key)} is no coefficient of {name.upper()}, which has {', '.join(known) or 'none'}")
    rows = frame.get("transform_matrix")
    whole = matrix(rows[:3] if isinstance(rows, list) else rows, (3, 4), "transform_matrix")
    turn, center = whole[:, :3], whole[:, 3]
    if undo is not None:
        applied, shift, scale = undo
        turn, center = applied.T @ turn, applied.T @ (center / scale - shift)
    values = {
        **pose(center, OPENGL @ turn.T),
        "distortion": [number(frame.get(key, 0.0), key) for key in known],
        "model": "fisheye" if known is _FISHEYE else "brown",
    }
    size = None
    if "w" in frame and "h" in frame:
        size = (pixels(frame["h"], "h"), pixels(frame["w"], "w"))

    def with_size(height: int, width: int) -> dict[str, Any]:
        fx, fy = _focal(frame, height, width)
        cx, cy = number(frame.get("cx", width / 2), "cx"), number(frame.get("cy", height / 2), "cy")
        return {**values, "K": intrinsic(fx, fy, cx - 0.5, cy - 0.5), "size": (height, width)}

    return with_size if size is None else with_size(*size)


def _focal(frame: dict[str, Any], height: int, width: int) -> tuple[float, float]:
    """Return the focal lengths in pixels, from themselves or from the angles of view."""
    found: list[float | None] = []
    for key, angle, side in (("fl_x", "camera_angle_x", width), ("fl_y", "camera_angle_y", height)):
        if frame.get(key) is not None:
            found.append(number(frame[key], key))
        elif frame.get(angle) is not None:
            wide = number(frame[angle], angle)
            if not 0 < wide < np.pi:
                raise InputError(f"{angle} must be an angle in radians below pi, not {wide:g}")
            found.append(side / 2 / float(np.tan(wide / 2)))
        else:
            found.append(None)
    fx, fy = found
    if fx is None and fy is None:
        raise InputError("has no focal length (fl_x, or camera_angle_x)")
    return (fx or fy or 0.0), (fy or fx or 0.0)
