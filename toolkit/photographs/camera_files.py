"""Reading calibrated photographs: JSON, COLMAP's text model, Bundler, VisualSFM and Middlebury."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.errors import FileError, InputError
from intaglio.files import READABLE_SUFFIXES, check_readable, read_samples
from intaglio.photographs.camera import Camera, Photograph


def read_photographs(path: PathLike, *, images: PathLike | None = None) -> list[Photograph]:
    """Read cameras and find their photographs; the pictures themselves are read when they are needed.

    Parameters
    ----------
    path : path
        One of these:

        * ``.json``: a list of views, or an object of views by name. A view has ``K`` and ``R`` (3 x 3), ``t`` (R X + t) or
          ``C`` (the camera's position), and may have ``image`` (file name; default the view's name), ``width`` and
          ``height``, ``distortion`` (k1, k2), and ``present``: false to be left out;
        * a folder with COLMAP's ``cameras.txt`` and ``images.txt``, or one of these files;
        * ``.out``: Bundler, with ``list.txt`` beside it;
        * ``.nvm``: VisualSFM;
        * ``.txt``: Middlebury's ``_par.txt`` (name, K, R, t on a line).
    images : path, optional
        Folder of the photographs. Default None: where the cameras are, or a folder ``images`` there or beside it.

    Returns
    -------
    list of Photograph
        One per view, each with its own name.

    Raises
    ------
    FileError
        If a file is missing, or can't be read as cameras.
    InputError
        If a calibration is not usable, there is no view, or two have one name; the message names the view.

    Examples
    --------
    >>> import json
    >>> import pathlib
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> view = {"K": [[4, 0, 3.5], [0, 4, 3.5], [0, 0, 1]], "R": np.eye(3).tolist(), "t": [0, 0, 2]}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     intaglio.write_image(np.full((8, 8, 3), 0.5), f"{folder}/front.png")
    ...     _ = pathlib.Path(folder, "cameras.json").write_text(json.dumps({"front.png": view}))
    ...     photographs = intaglio.read_photographs(f"{folder}/cameras.json")
    ...     shape = photographs[0].image.shape
    >>> photographs[0].name, shape
    ('front.png', (8, 8, 3))
    """
    path = Path(path)
    if path.is_dir():
        if not (path / "cameras.txt").exists():
            raise FileError(f"{path}: the folder has no cameras.txt; COLMAP writes one with model_converter --output_type TXT")
        path = path / "cameras.txt"
    check_readable(path)
    reader = _reader(path)
    folders = [Path(images)] if images is not None else [path.parent, path.parent / "images", path.parent.parent / "images"]
    if images is not None and not Path(images).is_dir():
        raise FileError(f"{images}: is not a folder")
    found: list[Photograph] = []
    try:
        for name, camera in reader(path):
            found.append(Photograph(camera=camera(folders), picture=_picture(name, folders, path), name=name))
    except (FileError, InputError):
        raise
    except (
        KeyError,
        ValueError,
        TypeError,
        IndexError,
        AttributeError,
        UnicodeDecodeError,
        RecursionError,
        OverflowError,
        OSError,
    ) as problem:
        raise FileError(f"{path}: is not a readable camera file ({type(problem).__name__}: {problem})") from problem
    if not found:
        raise InputError(f"{path}: holds no view")
    names = [p.name for p in found]
    if len(set(names)) < len(names):
        raise InputError(f"{path}: names a view twice: {next(n for n in names if names.count(n) > 1)}")
    return found


# A view's name, and what makes its camera once the folders of pictures are known: some formats put the principal point in the
# middle of the picture.
_View = tuple[str, Callable[[list[Path]], Camera]]


def _reader(path: Path) -> Callable[[Path], Iterator[_View]]:
    suffix = path.suffix.lower()
    if suffix == ".txt" and path.name.lower() in ("cameras.txt", "images.txt"):
        return _colmap_views
    readers = {".json": _json_views, ".out": _bundler_views, ".nvm": _nvm_views, ".txt": _middlebury_views}
    if suffix not in readers:
        raise FileError(f"{path}: unknown camera file {path.suffix!r}; known: {', '.join(sorted(readers))}, or COLMAP's folder")
    return readers[suffix]


def _picture(name: str, folders: list[Path], asked_by: Path) -> Path:
    """Return the file of a view: its name as it is, or with an image's suffix."""
    for folder in folders:
        for candidate in (folder / name, *(folder / f"{name}{suffix}" for suffix in READABLE_SUFFIXES)):
            if candidate.is_file():
                return candidate
    # Exported calibrations may hold paths of another machine.
    base = name.replace("\\", "/").rsplit("/", 1)[-1]
    if base != name:
        return _picture(base, folders, asked_by)
    raise FileError(
        f"{asked_by}: the photograph {name!r} is in none of {', '.join(str(f) for f in folders)}; say where (images=, --images)"
    )


def _make_photograph(name: str, path: Path, values: dict[str, Any], _: list[Path]) -> Camera:
    try:
        return Camera(**values)
    except InputError as problem:
        raise InputError(f"{path}: view {name}: {problem}") from problem


def _json_views(path: Path) -> Iterator[_View]:
    try:
        data = json.loads(path.read_text("utf-8-sig"), object_pairs_hook=_without_repeats)
    except json.JSONDecodeError as problem:
        raise FileError(f"{path}: is not JSON ({problem})") from problem
    if isinstance(data, dict) and isinstance(data.get("views"), list | dict):
        data = data["views"]
    if isinstance(data, list):
        views = [(str(view["image"]), view) for view in data]
    elif isinstance(data, dict):
        views = [(str(view.get("image", name)), view) for name, view in data.items()]
    else:
        raise FileError(f"{path}: holds neither a list nor an object of views")
    for name, view in views:
        present = view.get("present", True)
        if not isinstance(present, bool):
            raise InputError(f"{path}: view {name}: present must be true or false, not {present!r}")
        if not present:
            continue
        if ("width" in view) != ("height" in view):
            raise InputError(f"{path}: view {name} has only one of width and height")
        missing = [key for key in ("K", "R") if key not in view]
        if missing or not ({"t", "C"} & view.keys()):
            raise InputError(f"{path}: view {name} lacks {', '.join(missing) or 't (or C)'}")
        turn = np.asarray(view["R"], np.float64)
        if turn.shape != (3, 3):
            raise InputError(f"{path}: view {name}: R must be 3 x 3, not of shape {turn.shape}")
        shift = np.asarray(view["t"], np.float64) if "t" in view else -turn @ np.asarray(view["C"], np.float64).reshape(3)
        size = (int(view["height"]), int(view["width"])) if {"width", "height"} <= view.keys() else None
        values = {"K": view["K"], "R": turn, "t": shift, "size": size, "distortion": view.get("distortion", (0.0, 0.0))}
        yield name, partial(_make_photograph, name, path, values)


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise InputError(f"a name is given twice: {next(n for n in names if names.count(n) > 1)!r}")
    return found


def _rows(path: Path) -> list[list[str]]:
    """Return the words of each line that is not a comment."""
    lines = path.read_text("utf-8").splitlines()
    return [line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _turn(w: float, x: float, y: float, z: float) -> Array:
    """Return the rotation matrix of a quaternion."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat([x, y, z, w]).as_matrix())


# COLMAP's camera models: how many focal lengths, then the principal point, then radial terms, and how many others follow.
_COLMAP = {
    "SIMPLE_PINHOLE": (1, 0, 0),
    "PINHOLE": (2, 0, 0),
    "SIMPLE_RADIAL": (1, 1, 0),
    "RADIAL": (1, 2, 0),
    "OPENCV": (2, 2, 2),
}


def _colmap_views(path: Path) -> Iterator[_View]:
    """COLMAP counts pixels from the corner of the first one: its centre is at (0.5, 0.5)."""
    cameras = {}
    for row in _rows(check_readable(path.parent / "cameras.txt")):
        model, numbers = row[1], [float(v) for v in row[4:]]
        if model not in _COLMAP:
            raise InputError(f"{path}: camera {row[0]} is a {model}; known: {', '.join(_COLMAP)}. Undistort the images first")
        focals, radial, others = _COLMAP[model]
        if len(numbers) != focals + 2 + radial + others:
            raise InputError(
                f"{path}: camera {row[0]}: {model} has {focals + 2 + radial + others} parameters, not {len(numbers)}"
            )
        if any(numbers[focals + 2 + radial :]):
            raise InputError(f"{path}: camera {row[0]} has tangential distortion; undistort the images first")
        fx, fy = numbers[0], numbers[focals - 1]
        cx, cy = numbers[focals] - 0.5, numbers[focals + 1] - 0.5
        terms = (*numbers[focals + 2 : focals + 2 + radial], 0.0, 0.0)[:2]
        cameras[row[0]] = {
            "K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]],
            "size": (int(row[3]), int(row[2])),
            "distortion": terms,
        }
    # Two lines a view, the second, with points, possibly empty.
    text = check_readable(path.parent / "images.txt").read_text("utf-8")
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    for line in lines[1::2]:
        words = line.split()
        if len(words) == 10 and not _is_number(words[9]):
            raise InputError(f"{path}: view {words[9]} follows a view without its line of points; COLMAP writes one, if empty")
    while lines and not lines[0].strip():
        del lines[0]
    for line in lines[::2]:
        row = line.split(maxsplit=9)
        if not row:
            continue
        name, turn, shift = row[9], _turn(*map(float, row[1:5])), [float(v) for v in row[5:8]]
        values = {**cameras[row[8]], "R": turn, "t": shift}
        yield name, partial(_make_photograph, name, path, values)


def _center(name: str, path: Path, focal: float, values: dict[str, Any], folders: list[Path]) -> Camera:
    """Return a camera whose principal point is the middle of its photograph."""
    height, width = read_samples(_picture(name, folders, path)).shape[:2]
    k = [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]]
    return _make_photograph(name, path, {**values, "K": k, "size": (height, width)}, folders)


def _bundler_views(path: Path) -> Iterator[_View]:
    """Bundler looks along -z with y up: its second and third axes are turned."""
    rows = _rows(path)
    count = int(rows[0][0])
    beside = check_readable(path.parent / "list.txt")
    names = [row[0] for row in _rows(beside)]
    if len(names) != count:
        raise InputError(f"{path}: has {count} cameras, but {beside} names {len(names)} photographs")
    flip = np.diag([1.0, -1.0, -1.0])
    for number, name in enumerate(names):
        block = [[float(v) for v in row] for row in rows[1 + 5 * number : 6 + 5 * number]]
        focal, k1, k2 = block[0]
        # Photographs that could not be registered have zeros.
        if focal == 0:
            continue
        values = {"R": flip @ np.array(block[1:4]), "t": flip @ np.array(block[4]), "distortion": (k1, k2)}
        yield name, partial(_center, name, path, focal, values)


def _nvm_views(path: Path) -> Iterator[_View]:
    """A line a view: name, focal length, quaternion w x y z, centre, radial distortion, 0."""
    rows = _rows(path)
    if not rows[0][0].startswith("NVM_V3"):
        raise FileError(f"{path}: is not an NVM_V3 file")
    # One calibration for all: fx cx fy cy, then a distortion.
    fixed = None
    if len(rows[0]) >= 6 and rows[0][1] == "FixedK":
        fx, cx, fy, cy = (float(v) for v in rows[0][2:6])
        if any(float(v) for v in rows[0][6:]):
            raise InputError(f"{path}: has VisualSFM's radial distortion; export undistorted images")
        fixed = [[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]]
    count = int(rows[1][0])
    if len(rows) < 2 + count:
        raise InputError(f"{path}: promises {count} views, holds {len(rows) - 2}")
    for row in rows[2 : 2 + count]:
        name, numbers = " ".join(row[:-10]), [float(v) for v in row[-10:]]
        turn = _turn(*numbers[1:5])
        if fixed is not None:
            values = {"K": fixed, "R": turn, "t": -turn @ np.array(numbers[5:8])}
            yield name, partial(_make_photograph, name, path, values)
            continue
        if numbers[8] != 0:
            raise InputError(f"{path}: view {name} has VisualSFM's radial distortion; export undistorted images")
        values = {"R": turn, "t": -turn @ np.array(numbers[5:8])}
        yield name, partial(_center, name, path, numbers[0], values)


def _middlebury_views(path: Path) -> Iterator[_View]:
    """A line a view: name, K, R and t, 21 numbers row by row; the first line counts them."""
    rows = _rows(path)
    if len(rows[0]) != 1:
        raise FileError(f"{path}: does not begin with the number of views, as Middlebury's _par.txt does")
    if len(rows) != int(rows[0][0]) + 1:
        raise InputError(f"{path}: promises {rows[0][0]} views, holds {len(rows) - 1}")
    for row in rows[1:]:
        if len(row) != 22:
            raise InputError(f"{path}: view {row[0]} has {len(row) - 1} numbers, not 21")
        numbers = np.array([float(v) for v in row[1:]])
        values = {"K": numbers[:9].reshape(3, 3), "R": numbers[9:18].reshape(3, 3), "t": numbers[18:]}
        yield row[0], partial(_make_photograph, row[0], path, values)
