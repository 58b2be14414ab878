"""Reading what RealityCapture (RealityScan) exports: a table of internal and external parameters, or an XMP file a photograph.

Focal lengths and principal points are relative to the longer side of a photograph, which the files don't tell. The tangential
terms are named the other way round than OpenCV's, as the program's own export for OpenCV shows.
"""

from __future__ import annotations

import csv
import re
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError
from intaglio.files import READABLE_SUFFIXES, check_readable
from intaglio.photographs.camera_parts import OPENGL, View, Views, intrinsic, number, numbers, pose, read_text, short
from intaglio.photographs.metashape_cameras import xml_root

# Columns by the names they have in one version or another.
_NAMES = {"heading": "yaw", "f_35mm": "f", "px_norm": "px", "py_norm": "py", "z": "alt", "#name": "name"}
_NEEDED = ("name", "x", "y", "alt", "yaw", "pitch", "roll", "f")
_LENS = ("k1", "k2", "k3", "k4", "t1", "t2")
_COEFFICIENT = re.compile(r"^[kpst]\d+$|^skew$")

_XCR = "{http://www.capturingreality.com/ns/xcr/1.1#}"


def csv_views(path: Path) -> Views:
    """Read "Internal/External camera parameters": position, yaw, pitch, roll, focal length as for 36 mm, lens."""
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    while lines and lines[0].lower().startswith("#cameras"):
        del lines[0]
    try:
        rows = list(csv.reader(lines))
    except csv.Error as problem:
        raise FileError(f"{path}: is no table ({problem})") from problem
    header = [_NAMES.get(word, word) for word in (w.strip().lower() for w in (rows[0] if rows else []))]
    missing = [name for name in _NEEDED if name not in header]
    if missing:
        raise FileError(
            f"{path}: is no table of RealityCapture's camera parameters, it has no column {missing[0]}; "
            "export 'Internal/External camera parameters'"
        )
    found = Views()
    for row in rows[1:]:
        entry = dict(zip(header, row, strict=False))
        name = entry.get("name", "").strip()
        try:
            if not name:
                raise InputError("has no name")
            x, y, z, yaw, pitch, roll, f = (number(entry.get(key), key) for key in _NEEDED[1:])
            px, py, *lens = (number(entry.get(key) or 0.0, key) for key in ("px", "py", *_LENS))
            # Turned about z by the compass, about x by the pitch, about y by the roll, of a camera with OpenGL's axes.
            strange = [k for k in entry if _COEFFICIENT.match(k) and k not in _LENS and number(entry[k] or 0.0, k)]
            if strange:
                raise InputError(f"its lens has {strange[0]}, which is not read; known: {', '.join(_LENS)}")
            to_world = _about(2, -yaw) @ _about(0, pitch) @ _about(1, roll)
            values = pose(np.array([x, y, z]), OPENGL @ to_world.T)
            found.views.append(View(name, partial(_camera, values, (f / 36, px, py, 0.0, 1.0), lens)))
        except InputError as problem:
            raise InputError(f"{path}: view {short(name)}: {problem}") from problem
    return found


def xmp_views(folder: Path) -> Views:
    """Read the XMP files beside photographs that hold a pose: a rotation into the camera's coordinates and its position."""
    found, without = Views(), 0
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() != ".xmp" or not path.is_file():
            continue
        root = xml_root(check_readable(path))
        given = {e.tag.removeprefix(_XCR): e.text for e in root.iter() if e.tag.startswith(_XCR)}
        for element in root.iter():
            given |= {k.removeprefix(_XCR): v for k, v in element.attrib.items() if k.startswith(_XCR)}
        if "Rotation" not in given or "Position" not in given:
            without += 1
            continue
        try:
            model = str(given.get("DistortionModel", "perspective")).lower()
            lens = list(numbers(given.get("DistortionCoeficients") or "0 0 0 0 0 0", 6, "DistortionCoeficients"))
            if model == "division":
                raise InputError("its lens is RealityCapture's division model, which is not read; export it as brown3 or brown4")
            if model == "perspective":
                lens = [0.0] * 6
            elif not model.startswith("brown"):
                raise InputError(f"its lens has the model {short(model)}; known: perspective, brown3, brown4, brown3t2, brown4t2")
            f = number(given.get("FocalLength35mm"), "FocalLength35mm") / 36
            u, v, skew = (number(given.get(k) or 0.0, k) for k in ("PrincipalPointU", "PrincipalPointV", "Skew"))
            aspect = number(given.get("AspectRatio") or 1.0, "AspectRatio")
            turn = numbers(given["Rotation"], 9, "Rotation").reshape(3, 3)
            values = pose(numbers(given["Position"], 3, "Position"), turn)
        except InputError as problem:
            raise InputError(f"{path}: {problem}") from problem
        camera = partial(_camera, values, (f, u, v, skew, aspect), lens)
        found.views.append(View(path.stem, camera, _beside(path)))
    if without and not found.views:
        raise InputError(
            f"{folder}: none of its {without} XMP files holds a pose; export them with poses (draft, exact or locked)"
        )
    return found


def _beside(path: Path) -> str:
    """Return the name of the photograph that an XMP file belongs to."""
    for suffix in READABLE_SUFFIXES:
        for name in (f"{path.stem}{suffix}", f"{path.stem}{suffix.upper()}"):
            if path.with_name(name).is_file():
                return name
    return path.stem


def _about(axis: int, degrees: float) -> Array:
    """Return the rotation about one axis."""
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.eye(3)
    one, other = (axis + 1) % 3, (axis + 2) % 3
    turn[one, one], turn[one, other], turn[other, one], turn[other, other] = cosine, -sine, sine, cosine
    return turn


def _camera(
    values: dict[str, Any], relative: tuple[float, float, float, float, float], lens: list[float], height: int, width: int
) -> dict[str, Any]:
    f, px, py, skew, aspect = relative
    side = max(height, width)
    k = intrinsic(f * side, f * side * aspect, px * side + width / 2 - 0.5, py * side + height / 2 - 0.5, skew * side)
    k1, k2, k3, k4, t1, t2 = lens
    return {**values, "K": k, "size": (height, width), "distortion": [k1, k2, k3, k4, t2, t1], "model": "brown"}
