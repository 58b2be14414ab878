"""Reading OpenMVG's sfm_data.json, whose pixels have whole numbers at their centres."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from intaglio.errors import InputError
from intaglio.photographs.camera_parts import View, Views, intrinsic, matrix, number, numbers, pixels, pose, short

# The key of the lens's coefficients by the name of the camera's type, and the model here. The tangential terms t1 and t2 of
# pinhole_brown_t2 are OpenCV's p1 and p2.
_TYPES: dict[str, tuple[str | None, int, str]] = {
    "pinhole": (None, 0, "brown"),
    "pinhole_radial_k1": ("disto_k1", 1, "brown"),
    "pinhole_radial_k3": ("disto_k3", 3, "brown"),
    "pinhole_brown_t2": ("disto_t2", 5, "brown"),
    "fisheye": ("fisheye", 4, "fisheye"),
}

# cereal marks what it tells for the first time by the highest bit.
_FIRST = 1 << 31


def openmvg_views(path: Path, data: dict[str, Any]) -> Views:
    """Read the views that have a pose and intrinsics."""
    found = Views()
    root = data.get("root_path")
    if isinstance(root, str) and root:
        found.folders.append(path.parent / root.replace("\\", "/"))
    try:
        cameras, poses = _intrinsics(_items(data, "intrinsics")), {}
        for key, value in _items(data, "extrinsics"):
            turn = matrix(value.get("rotation"), (3, 3), f"rotation of pose {short(key)}")
            poses[str(key)] = pose(numbers(value.get("center"), 3, f"center of pose {short(key)}"), turn)
        views = _items(data, "views")
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from problem
    missing = 0
    for key, value in views:
        view = _data(value)
        name = view.get("filename")
        if not isinstance(name, str) or not name:
            raise InputError(f"{path}: view {short(key)} has no filename")
        place, camera = str(view.get("id_pose")), str(view.get("id_intrinsic"))
        if place not in poses or camera not in cameras:
            missing += 1
            continue
        # Not every version names the folder below the root.
        below = view.get("local_path")
        picture = f"{below}/{name}" if isinstance(below, str) and below.strip("/\\") else name
        found.views.append(View(name, {**cameras[camera], **poses[place]}, picture))
    if missing and not found.views:
        raise InputError(f"{path}: none of its {missing} views has a pose; it is from before the reconstruction")
    return found


def _items(data: dict[str, Any], key: str) -> list[tuple[Any, dict[str, Any]]]:
    """Return keys and values of one of cereal's maps."""
    entries = data.get(key)
    if not isinstance(entries, list):
        raise InputError(f"has no list of {key}, as OpenMVG's sfm_data has")
    for entry in entries:
        if not isinstance(entry, dict) or not isinstance(entry.get("value"), dict) or isinstance(entry.get("key"), list | dict):
            raise InputError(f"an entry of {key} has no key and value")
    return [(entry.get("key"), entry["value"]) for entry in entries]


def _data(value: dict[str, Any]) -> dict[str, Any]:
    """Return what a pointer of cereal's points to; older versions nest the base class as value0."""
    inner = value.get("ptr_wrapper", value)
    inner = inner.get("data", inner) if isinstance(inner, dict) else {}
    if not isinstance(inner, dict):
        return {}
    base = inner.get("value0")
    return {**base, **inner} if isinstance(base, dict) else inner


def _intrinsics(entries: list[tuple[Any, dict[str, Any]]]) -> dict[str, dict[str, Any]]:
    names: dict[int, str] = {}
    cameras = {}
    for key, value in entries:
        number_of_type = value.get("polymorphic_id")
        name = value.get("polymorphic_name")
        if isinstance(number_of_type, int):
            if isinstance(name, str):
                names[number_of_type & ~_FIRST] = name
            else:
                name = names.get(number_of_type & ~_FIRST)
        if not isinstance(name, str) or name not in _TYPES:
            raise InputError(f"intrinsic {short(key)} is of the type {short(name)}; known: {', '.join(_TYPES)}")
        data = _data(value)
        place, count, model = _TYPES[name]
        focal = number(data.get("focal_length"), f"focal_length of intrinsic {short(key)}")
        cx, cy = numbers(data.get("principal_point"), 2, f"principal_point of intrinsic {short(key)}")
        terms = [] if place is None else list(numbers(data.get(place), count, f"{place} of intrinsic {short(key)}"))
        if place == "disto_t2":
            terms = [*terms[:3], 0.0, *terms[3:]]
        size = tuple(pixels(data.get(k), f"{k} of intrinsic {short(key)}") for k in ("height", "width"))
        cameras[str(key)] = {"K": intrinsic(focal, focal, cx, cy), "size": size, "distortion": terms, "model": model}
    return cameras
