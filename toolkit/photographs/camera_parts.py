"""What the readers of camera files share: views before their photographs are known, and checked pieces of files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError

# Arguments of a Camera; or a function that gives them once the photograph's rows and columns are known, which some programs
# need for the principal point or a focal length that is relative to them.
Intrinsics = dict[str, Any] | Callable[[int, int], dict[str, Any]]

# OpenGL's camera has y up and looks along -z.
OPENGL = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class View:
    """A view as a file describes it: its name, which is also its photograph's file unless ``picture`` is, and its camera."""

    name: str
    camera: Intrinsics
    picture: str | None = None


@dataclass
class Views:
    """All views of a file, folders in which it says that photographs lie, and sentences for the user."""

    views: list[View] = field(default_factory=list)
    folders: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def short(text: object, most: int = 80) -> str:
    """Return text of a file, for a message: on one line, and not all of it if it is long."""
    line = " ".join(str(text).split())
    line = "".join(c if c.isprintable() else "?" for c in line)
    return line if len(line) <= most else f"{line[: most - 1]}…"


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8 (or, for a byte that can't be that, Latin-1)."""
    data = path.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def read_json(path: Path, pairs: Callable[[list[tuple[str, Any]]], Any] | None = None) -> Any:
    """Return the content of a JSON file, or raise `FileError`."""
    try:
        return json.loads(read_text(path), object_pairs_hook=pairs)
    except RecursionError as problem:
        raise FileError(f"{path}: is nested too deeply to be a camera file") from problem
    except json.JSONDecodeError as problem:
        raise FileError(f"{path}: is not JSON ({problem})") from problem


def number(value: Any, what: str) -> float:
    """Return a finite number, also where the file holds it as text, or raise `InputError`."""
    try:
        found = float(value) if not isinstance(value, bool) else np.nan
    except (TypeError, ValueError, OverflowError):
        found = np.nan
    if not np.isfinite(found):
        raise InputError(f"{what} is no number: {short(value)}")
    return found


def numbers(values: Any, count: int | None, what: str) -> Array:
    """Return ``count`` finite numbers (any number of them if None) of a list or of text, or raise `InputError`."""
    items = values.split() if isinstance(values, str) else values
    if not isinstance(items, Iterable) or isinstance(items, dict):
        raise InputError(f"{what} is no list of numbers: {short(values)}")
    found = np.array([number(v, what) for v in items])
    if count is not None and len(found) != count:
        raise InputError(f"{what} must be {count} numbers, not {len(found)}")
    return found


def matrix(values: Any, shape: tuple[int, int], what: str) -> Array:
    """Return a matrix of a list of rows, or raise `InputError`."""
    if not isinstance(values, list) or len(values) != shape[0]:
        raise InputError(f"{what} must be {shape[0]} x {shape[1]} numbers")
    return np.stack([numbers(row, shape[1], what) for row in values])


def pixels(value: Any, what: str) -> int:
    """Return a size in whole pixels, or raise `InputError`."""
    found = number(value, what)
    if not (1 <= found <= 1e6 and found == int(found)):
        raise InputError(f"{what} must be whole pixels from 1 to 1000000, not {short(value)}")
    return int(found)


def turn_of(w: float, x: float, y: float, z: float) -> Array:
    """Return the rotation matrix of a quaternion, or raise `InputError` if it is none."""
    q = np.array([w, x, y, z])
    with np.errstate(all="ignore"):
        length = np.linalg.norm(q)
    if not 1e-6 < length < 1e6:
        raise InputError(f"its quaternion has the length {length:.3g}; a rotation has 1")
    w, x, y, z = q / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def pose(center: Array, turn: Array) -> dict[str, Array]:
    """Return the arguments of a Camera for its position and its rotation from the world's coordinates."""
    return {"R": turn, "t": -turn @ center}


def intrinsic(fx: float, fy: float, cx: float, cy: float, skew: float = 0.0) -> list[list[float]]:
    """Return K, with the principal point counted from the centre of the first pixel."""
    return [[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
