"""Reading AliceVision's scenes (Meshroom's .sfm, and JSON), of all versions; numbers are written as text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from intaglio.errors import InputError
from intaglio.photographs.camera_parts import View, Views, intrinsic, number, numbers, pixels, pose, read_json, short

# Lenses by their names: the model here and the places of the coefficients in it. fisheye1 is the field-of-view model.
_LENSES: dict[str, tuple[str, tuple[int, ...]]] = {
    "none": ("brown", ()),
    "pinhole": ("brown", ()),
    "radial1": ("brown", (0,)),
    "radialk1": ("brown", (0,)),
    "radial3": ("brown", (0, 1, 2)),
    "radialk3": ("brown", (0, 1, 2)),
    "brown": ("brown", (0, 1, 2, 4, 5)),
    "fisheye": ("fisheye", (0, 1, 2, 3)),
    "fisheye4": ("fisheye", (0, 1, 2, 3)),
    "fisheye1": ("fov", (0,)),
}


def meshroom_views(path: Path, data: Any = None) -> Views:
    """Read the views that have a pose and an intrinsic."""
    data = read_json(path) if data is None else data
    if not isinstance(data, dict):
        raise InputError(f"{path}: is no scene of AliceVision")
    version = tuple(int(number(v, f"{path}: version")) for v in numbers(data.get("version", [1, 0, 0]), None, f"{path}: version"))
    cameras: dict[str, dict[str, Any]] = {}
    poses: dict[str, dict[str, Any]] = {}
    for entry in _entries(path, data, "intrinsics"):
        key = str(entry.get("intrinsicId"))
        try:
            cameras[key] = _camera(entry, version)
        except InputError as problem:
            raise InputError(f"{path}: intrinsic {short(key)}: {problem}") from problem
    for entry in _entries(path, data, "poses"):
        key = str(entry.get("poseId"))
        inner = entry.get("pose")
        inner = inner.get("transform") if isinstance(inner, dict) else None
        if not isinstance(inner, dict):
            raise InputError(f"{path}: pose {short(key)} has no transform")
        # The matrix is written column by column.
        turn = numbers(inner.get("rotation"), 9, f"{path}: rotation of pose {short(key)}").reshape(3, 3).T
        poses[key] = pose(numbers(inner.get("center"), 3, f"{path}: center of pose {short(key)}"), turn)
    found, without = Views(), 0
    for entry in _entries(path, data, "views"):
        picture = entry.get("path")
        if not isinstance(picture, str) or not picture:
            raise InputError(f"{path}: view {short(entry.get('viewId'))} has no path")
        camera, place = str(entry.get("intrinsicId")), str(entry.get("poseId", entry.get("viewId")))
        if camera not in cameras or place not in poses:
            without += 1
            continue
        if "rigId" in entry and str(entry.get("isPoseIndependant", "1")).lower() in ("0", "false"):
            raise InputError(
                f"{path}: {short(picture)} is part of a rig, which is not read; export the cameras with their own poses"
            )
        found.views.append(View(picture.replace("\\", "/").rsplit("/", 1)[-1], {**cameras[camera], **poses[place]}, picture))
    if without and not found.views:
        raise InputError(f"{path}: none of its {without} views has a pose; give the scene after StructureFromMotion")
    return found


def _entries(path: Path, data: dict[str, Any], key: str) -> list[dict[str, Any]]:
    """Return one of the scene's lists; an empty one is written as an empty text."""
    entries = data.get(key) or []
    if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise InputError(f"{path}: {key} is no list of objects")
    return entries


def _camera(entry: dict[str, Any], version: tuple[int, ...]) -> dict[str, Any]:
    """Return the arguments of a Camera; what changed from version to version is in AliceVision's sfmDataIO/jsonIO.cpp."""
    width, height = pixels(entry.get("width"), "width"), pixels(entry.get("height"), "height")
    kind, lens = str(entry.get("type", "pinhole")).lower(), entry.get("distortionType")
    # Newer versions tell the projection and the lens apart.
    name = kind if lens is None or kind != "pinhole" else str(lens).lower()
    if name not in _LENSES:
        raise InputError(f"is of the type {short(name)}; known: {', '.join(_LENSES)}. Export undistorted images")
    model, places = _LENSES[name]
    given = numbers(entry.get("distortionParams") or [], None, "distortionParams")
    if len(given) not in (0, len(places)):
        raise InputError(f"has {len(given)} distortionParams; {name} has {len(places)}")
    terms = [0.0] * (max(places, default=-1) + 1)
    for place, value in zip(places, given, strict=False):
        terms[place] = float(value)
    center = numbers(entry.get("principalPoint"), 2, "principalPoint")
    if version >= (1, 2, 1):
        center = center + (width / 2, height / 2)
    if "pxFocalLength" in entry:
        focal = numbers(
            entry["pxFocalLength"] if isinstance(entry["pxFocalLength"], list) else [entry["pxFocalLength"]], None, "f"
        )
        fx, fy = float(focal[0]) if len(focal) else 0.0, float(focal[-1]) if len(focal) else 0.0
    else:
        sensor = number(entry.get("sensorWidth", 36.0), "sensorWidth")
        ratio = number(entry.get("pixelRatio", 1.0), "pixelRatio")
        if sensor <= 0 or ratio <= 0:
            raise InputError(f"sensorWidth and pixelRatio must be above 0, not {sensor:g} and {ratio:g}")
        focal_length = number(entry.get("focalLength"), "focalLength") / sensor * width
        if version >= (1, 2, 11):
            fx, fy = focal_length / ratio, focal_length
        else:
            fx, fy = focal_length, focal_length * ratio if version >= (1, 2, 5) else focal_length / ratio
    return {"K": intrinsic(fx, fy, *center), "size": (height, width), "distortion": terms, "model": model}
