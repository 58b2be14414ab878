"""Reading COLMAP's models, binary and text. COLMAP counts pixels from the corner of the first one: its centre is (0.5, 0.5)."""

from __future__ import annotations

import mmap
import struct
from pathlib import Path
from typing import Any

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError
from intaglio.files import check_readable
from intaglio.photographs.camera_parts import View, Views, intrinsic, number, numbers, pixels, read_text, short, turn_of

# COLMAP's camera models by their numbers in binary files: name, focal lengths, parameters of the lens, and its model here.
# https://colmap.github.io/cameras.html; the principal point follows the focal lengths.
_MODELS = {
    0: ("SIMPLE_PINHOLE", 1, 0, "opencv"),
    1: ("PINHOLE", 2, 0, "opencv"),
    2: ("SIMPLE_RADIAL", 1, 1, "opencv"),
    3: ("RADIAL", 1, 2, "opencv"),
    4: ("OPENCV", 2, 4, "opencv"),
    5: ("OPENCV_FISHEYE", 2, 4, "fisheye"),
    6: ("FULL_OPENCV", 2, 8, "opencv"),
    7: ("FOV", 2, 1, "fov"),
    8: ("SIMPLE_RADIAL_FISHEYE", 1, 1, "fisheye"),
    9: ("RADIAL_FISHEYE", 1, 2, "fisheye"),
    10: ("THIN_PRISM_FISHEYE", 2, 8, "thin_prism_fisheye"),
    11: ("RAD_TAN_THIN_PRISM_FISHEYE", 2, 12, "rad_tan_thin_prism_fisheye"),
    12: ("SIMPLE_DIVISION", 1, 1, "division"),
    13: ("DIVISION", 2, 1, "division"),
    14: ("SIMPLE_FISHEYE", 1, 0, "fisheye"),
    15: ("FISHEYE", 2, 0, "fisheye"),
    16: ("EUCM", 2, 2, "eucm"),
}
_NUMBERS = {name: key for key, (name, *_) in _MODELS.items()}


def colmap_camera(model: str, width: Any, height: Any, parameters: Array) -> dict[str, Any]:
    """Return the arguments of a Camera, without its pose, for one of COLMAP's models.

    Raises
    ------
    InputError
        If the model is not known, or has another number of parameters.
    """
    if model not in _NUMBERS:
        raise InputError(f"the model {short(model)} is not known; known: {', '.join(_NUMBERS)}")
    _, focals, lens, name = _MODELS[_NUMBERS[model]]
    if len(parameters) != focals + 2 + lens:
        raise InputError(f"{model} has {focals + 2 + lens} parameters, not {len(parameters)}")
    cx, cy = parameters[focals] - 0.5, parameters[focals + 1] - 0.5
    return {
        "K": intrinsic(parameters[0], parameters[focals - 1], cx, cy),
        "size": (pixels(height, "its height"), pixels(width, "its width")),
        "distortion": parameters[focals + 2 :],
        "model": name,
    }


def colmap_views(path: Path) -> Views:
    """Read cameras and images beside each other, of which ``path`` is one."""
    if path.suffix.lower() == ".bin":
        return _binary_views(path.parent)
    cameras = {}
    for row in _rows(check_readable(path.parent / "cameras.txt")):
        if len(row) < 5:
            raise InputError(f"{path}: camera {short(row[0])} has no parameters")
        try:
            cameras[row[0]] = colmap_camera(row[1], row[2], row[3], numbers(row[4:], None, "its parameters"))
        except InputError as problem:
            raise InputError(f"{path}: camera {short(row[0])}: {problem}") from problem
    found = Views()
    for row in _image_rows(path):
        try:
            place = numbers(row[1:8], 7, "its pose")
            values = {**_camera(cameras, row[8]), "R": turn_of(*place[:4]), "t": place[4:]}
        except InputError as problem:
            raise InputError(f"{path}: view {short(row[9])}: {problem}") from problem
        found.views.append(View(row[9].strip(), values))
    return found


def _camera(cameras: dict[Any, dict[str, Any]], key: Any) -> dict[str, Any]:
    if key not in cameras:
        raise InputError(f"its camera {short(key)} is not among the cameras")
    return cameras[key]


def _rows(path: Path) -> list[list[str]]:
    return [line.split() for line in read_text(path).splitlines() if line.strip() and not line.lstrip().startswith("#")]


def _image_rows(path: Path) -> list[list[str]]:
    """Return the words of the first of two lines a view; the second, with points, may be empty."""
    lines = [line for line in read_text(check_readable(path.parent / "images.txt")).splitlines() if line.lstrip()[:1] != "#"]
    while lines and not lines[0].strip():
        del lines[0]
    for line in lines[1::2]:
        words = line.split()
        if len(words) == 10 and not _is_number(words[9]):
            raise InputError(
                f"{path}: view {short(words[9])} follows a view without its line of points; COLMAP writes one, if empty"
            )
    rows = [line.split(maxsplit=9) for line in lines[::2] if line.strip()]
    for row in rows:
        if len(row) < 10:
            raise InputError(f"{path}: a view has {len(row)} entries, not 10: {short(' '.join(row))}")
    return rows


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


class _Bytes:
    """Values of a file in their order, little-endian; `FileError` where it ends too early."""

    def __init__(self, path: Path, data: Any) -> None:
        self._path, self._data, self._at = path, data, 0

    def take(self, layout: str) -> tuple[Any, ...]:
        layout = f"<{layout}"
        self.skip(struct.calcsize(layout))
        return struct.unpack_from(layout, self._data, self._at - struct.calcsize(layout))

    def skip(self, count: int) -> None:
        if count > len(self._data) - self._at:
            raise FileError(f"{self._path}: ends after {len(self._data)} bytes, in the middle of a record; it is cut short")
        self._at += count

    def word(self) -> str:
        end = self._data.find(b"\0", self._at)
        if end < 0:
            raise FileError(f"{self._path}: ends in the middle of a name; it is cut short")
        text = bytes(self._data[self._at : end]).decode("utf-8", "replace")
        self._at = end + 1
        return text

    def count(self, least: int, what: str) -> int:
        """Return a count of records of at least ``least`` bytes each, which the file must have room for."""
        (found,) = self.take("Q")
        if found * least > len(self._data) - self._at:
            raise FileError(f"{self._path}: promises {found} {what}, more than its {len(self._data)} bytes can hold")
        return int(found)


def _binary_views(folder: Path) -> Views:
    """The layout is that of COLMAP's src/colmap/scene/reconstruction_io_binary.cc."""
    path = check_readable(folder / "cameras.bin")
    source = _Bytes(path, path.read_bytes())
    cameras = {}
    for _ in range(source.count(24, "cameras")):
        key, model, width, height = source.take("IiQQ")
        if model not in _MODELS:
            raise InputError(f"{path}: camera {key} has the model {model}; known: {', '.join(_NUMBERS)}")
        name, focals, lens, _ = _MODELS[model]
        parameters = numbers(source.take(f"{focals + 2 + lens}d"), None, f"{path}: a parameter of camera {key}")
        try:
            cameras[key] = colmap_camera(name, width, height, parameters)
        except InputError as problem:
            raise InputError(f"{path}: camera {key}: {problem}") from problem
    path = check_readable(folder / "images.bin")
    found = Views()
    # The points of each view make these files large; they are stepped over.
    with open(path, "rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        source = _Bytes(path, data)
        for _ in range(source.count(73, "views")):
            _, *place, key = source.take("I7dI")
            name = source.word()
            source.skip(24 * source.count(24, "points"))
            try:
                place = [number(v, "its pose") for v in place]
                values = {**_camera(cameras, key), "R": turn_of(*place[:4]), "t": place[4:]}
            except InputError as problem:
                raise InputError(f"{path}: view {short(name)}: {problem}") from problem
            found.views.append(View(name, values))
    return found
