"""Reading Bundler's and VisualSFM's files, Middlebury's, and MVE's scenes."""

from __future__ import annotations

import configparser
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.errors import FileError, InputError
from intaglio.files import READABLE_SUFFIXES, check_readable
from intaglio.photographs.camera_parts import OPENGL, View, Views, intrinsic, number, numbers, pose, read_text, short, turn_of


def _rows(path: Path) -> list[list[str]]:
    """Return the words of each line that is not a comment."""
    return [line.split() for line in read_text(path).splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _count(word: str, path: Path) -> int:
    if not word.isdigit() or len(word) > 9:
        raise FileError(f"{path}: has no number of views where it should, but {short(word)}")
    return int(word)


def _centered(values: dict[str, Any], focal: float, height: int, width: int) -> dict[str, Any]:
    """Return the arguments of a camera whose principal point is the middle of its photograph."""
    return {**values, "K": intrinsic(focal, focal, (width - 1) / 2, (height - 1) / 2), "size": (height, width)}


def _list_for(path: Path) -> Path:
    """Return the list of photographs for Bundler's .out: list.txt beside it or above, or the only .lst of another program."""
    own = [folder / "list.txt" for folder in (path.parent, path.parent.parent)]
    others = sorted(path.parent.glob("*.lst"))
    return next((p for p in own if p.is_file()), others[0] if len(others) == 1 else own[0])


def _name(row: list[str]) -> str:
    """Return the name in a line of Bundler's list, which may have spaces, and a 0 and a focal length behind it."""
    try:
        behind = len(row) > 2 and [float(word) for word in row[-2:]]
    except ValueError:
        behind = False
    return " ".join(row[:-2] if behind else row)


def bundler_views(path: Path) -> Views:
    """Bundler looks along -z with y up: its second and third axes are turned. list.txt beside it names the photographs."""
    rows = _rows(path)
    if not rows or len(rows[0]) != 2:
        raise FileError(f"{path}: is not Bundler's .out: it does not begin with the numbers of cameras and points")
    count = _count(rows[0][0], path)
    if len(rows) < 1 + 5 * count:
        raise InputError(f"{path}: promises {count} cameras, its {len(rows)} lines can't hold them")
    beside = _list_for(path)
    names = [_name(row) for row in _rows(check_readable(beside))]
    if len(names) != count:
        raise InputError(f"{path}: has {count} cameras, but {beside} names {len(names)} photographs")
    found = Views()
    for place, name in enumerate(names):
        what = f"{path}: a value of view {short(name)}"
        block = [numbers(row, 3, what) for row in rows[1 + 5 * place : 6 + 5 * place]]
        focal, k1, k2 = block[0]
        # Photographs that could not be registered have zeros.
        if focal == 0:
            continue
        values = {"R": OPENGL @ np.array(block[1:4]), "t": OPENGL @ block[4], "distortion": [k1, k2]}
        found.views.append(View(name, partial(_centered, values, float(focal))))
    return found


def nvm_views(path: Path) -> Views:
    """A line a view: name, focal length, quaternion w x y z, centre, lens, 0."""
    rows = _rows(path)
    if not rows or not rows[0][0].startswith("NVM_V3"):
        raise FileError(f"{path}: is not an NVM_V3 file")
    # One calibration for all: fx cx fy cy, then a lens.
    fixed: dict[str, Any] | None = None
    if len(rows[0]) >= 6 and rows[0][1] == "FixedK":
        fx, cx, fy, cy = numbers(rows[0][2:6], 4, f"{path}: FixedK")
        lens = numbers(rows[0][6:7] or ["0"], 1, f"{path}: FixedK's lens")
        fixed = {"K": intrinsic(fx, fy, cx - 0.5, cy - 0.5), "distortion": lens, "model": "inverse"}
    count = _count(rows[1][0], path) if len(rows) > 1 else 0
    if len(rows) < 2 + count:
        raise InputError(f"{path}: promises {count} views, holds {len(rows) - 2}")
    found = Views()
    for row in rows[2 : 2 + count]:
        if len(row) < 11:
            raise InputError(f"{path}: a view has {len(row)} entries, not 11: {short(' '.join(row))}")
        # Names with spaces are written with quotes in their place.
        name = " ".join(row[:-10]).replace('"', " ")
        try:
            values = numbers(row[-10:], 10, "one of its values")
            camera = pose(values[5:8], turn_of(*values[1:5]))
        except InputError as problem:
            raise InputError(f"{path}: view {short(name)}: {problem}") from problem
        if fixed is not None:
            found.views.append(View(name, {**fixed, **camera}))
        else:
            own = {**camera, "distortion": values[8:9], "model": "inverse"}
            found.views.append(View(name, partial(_centered, own, float(values[0]))))
    return found


def middlebury_views(path: Path) -> Views:
    """A line a view: name, K, R and t, 21 numbers row by row; the first line counts them."""
    rows = _rows(path)
    if not rows or len(rows[0]) != 1:
        raise FileError(f"{path}: does not begin with the number of views, as Middlebury's _par.txt does")
    if len(rows) != _count(rows[0][0], path) + 1:
        raise InputError(f"{path}: promises {rows[0][0]} views, holds {len(rows) - 1}")
    found = Views()
    for row in rows[1:]:
        if len(row) != 22:
            raise InputError(f"{path}: view {short(row[0])} has {len(row) - 1} numbers, not 21")
        values = numbers(row[1:], 21, f"{path}: a value of view {short(row[0])}")
        camera = {"K": values[:9].reshape(3, 3), "R": values[9:18].reshape(3, 3), "t": values[18:]}
        found.views.append(View(row[0], camera))
    return found


def mve_views(folder: Path) -> Views:
    """A scene of MVE: folders views/NAME.mve with meta.ini; focal lengths are relative to the longer side."""
    found, without = Views(), 0
    for view in sorted((folder / "views").glob("*.mve")):
        path = view / "meta.ini"
        if not path.is_file():
            continue
        parser = configparser.ConfigParser(interpolation=None, strict=False)
        try:
            parser.read_string(read_text(check_readable(path)))
            camera = dict(parser["camera"]) if parser.has_section("camera") else {}
            name = parser.get("view", "name", fallback=view.stem)
        except configparser.Error as problem:
            raise FileError(f"{path}: is no meta.ini of MVE ({short(problem)})") from problem
        pictures = [p for p in sorted(view.iterdir()) if p.suffix.lower() in READABLE_SUFFIXES]
        picture = next((p for stem in ("undistorted", "undist-l0", "original") for p in pictures if p.stem == stem), None)
        try:
            focal = number(camera.get("focal_length") or 0.0, "focal_length")
            if focal == 0 or picture is None:
                without += 1
                continue
            if picture.stem == "original" and numbers(camera.get("radial_distortion") or "0 0", 2, "radial_distortion").any():
                raise InputError("has only its original picture, with radial_distortion; let MVE undistort it")
            ratio = number(camera.get("pixel_aspect") or 1.0, "pixel_aspect")
            middle = numbers(camera.get("principal_point") or "0.5 0.5", 2, "principal_point")
            turn = numbers(camera.get("rotation"), 9, "rotation").reshape(3, 3)
            values = {"R": turn, "t": numbers(camera.get("translation"), 3, "translation")}
        except InputError as problem:
            raise InputError(f"{path}: {problem}") from problem
        found.views.append(View(name, partial(_relative, values, focal, ratio, middle), str(picture.resolve())))
    if without and not found.views:
        raise InputError(f"{folder}: none of its {without} views has a camera and a picture")
    return found


def _relative(values: dict[str, Any], focal: float, ratio: float, middle: Any, height: int, width: int) -> dict[str, Any]:
    if not ratio > 0:
        raise InputError(f"pixel_aspect must be above 0, not {ratio:g}")
    fx = focal * height / ratio if width * ratio < height else focal * width
    return {
        **values,
        "K": intrinsic(fx, fx * ratio, width * middle[0] - 0.5, height * middle[1] - 0.5),
        "size": (height, width),
    }
