"""Light positions of image stacks: .lp files, lights.csv, and plain tables of directions or intensities."""

from __future__ import annotations

import csv
import re
import warnings
from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.errors import InputError
from intaglio.files import check_readable


def light_direction(tilt: float, slant: float) -> Array:
    """Return the unit vector (cos τ sin σ, sin τ sin σ, cos σ) towards a light of ``tilt`` τ and ``slant`` σ, in degrees."""
    t, s = np.radians(tilt), np.radians(slant)
    return np.array([np.cos(t) * np.sin(s), np.sin(t) * np.sin(s), np.cos(s)])


def unit(vectors: Array) -> Array:
    """Return unit vectors along ``vectors`` (..., 3) that are finite and not zero, whatever their size."""
    scaled = vectors / np.abs(vectors).max(axis=-1, keepdims=True)
    return np.asarray(scaled / np.linalg.norm(scaled, axis=-1, keepdims=True))


def tilt_and_slant(lights: Array) -> tuple[Array, Array]:
    """Return tilt in [0, 360) and slant, in degrees, of unit vectors (..., 3)."""
    tilt = np.degrees(np.arctan2(lights[..., 1], lights[..., 0])) % 360
    return tilt, np.degrees(np.arccos(np.clip(lights[..., 2], -1, 1)))


def spread_lights(count: int, lowest: float) -> Array:
    """Return ``count`` unit vectors spread evenly from straight above down to a slant of ``lowest`` degrees (a spiral)."""
    z = 1 - (np.arange(count) + 0.5) / count * (1 - np.cos(np.radians(lowest)))
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


def read_light_positions(path: PathLike) -> tuple[list[str], Array]:
    """Read an .lp file: a line with the number of images, which may be missing, then ``name x y z`` a line.

    Parameters
    ----------
    path : path

    Returns
    -------
    names : list of str
        Image files, relative to the .lp file, with forward slashes; empty where the lines hold just ``x y z``.
    lights : (K, 3) float64 array
        Unit vectors towards the light; x right, y up, z to the camera.

    Raises
    ------
    FileError
        If the file is missing or empty.
    InputError
        If a line is not a name and three finite numbers, or the count is wrong.
    """
    path = check_readable(path)
    lines = [line.strip() for line in path.read_text(encoding="utf-8-sig", errors="replace").splitlines()]
    lines = [line for line in lines if line]
    promised = int(lines[0]) if lines and re.fullmatch("[0-9]{1,9}", lines[0]) else None
    names, lights = [], []
    for number, line in enumerate(lines[promised is not None :], start=1):
        words = line.rsplit(maxsplit=3)
        if len(words) == 3:
            words = ["", *words]
        try:
            vector = np.array([float(w) for w in words[1:]])
        except ValueError:
            vector = np.zeros(0)
        if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
            raise InputError(f"{path}: entry {number} is not 'name x y z' with a direction: {line!r}")
        names.append(words[0].replace("\\", "/"))
        lights.append(unit(vector))
    if not names:
        raise InputError(f"{path}: holds no lights")
    if promised is not None and promised != len(names):
        raise InputError(f"{path}: its first line promises {promised} images, but {len(names)} follow")
    if any(names) and not all(names):
        raise InputError(f"{path}: some entries name an image and some don't; name all or none")
    return [n for n in names if n], np.array(lights)


def read_lights_csv(path: PathLike) -> tuple[list[str], Array]:
    """Read ``lights.csv``: a row per image with its name and tilt, slant (degrees) or x, y, z.

    Columns may be separated by comma, semicolon or tab. A heading row may name them (``image``, ``tilt``, ``slant`` or
    ``x``, ``y``, ``z``, in any order); without one, a name and two numbers are tilt and slant, a name and three x, y, z.

    Raises
    ------
    InputError
        If a row has other columns, or numbers that are no direction.
    """
    path = check_readable(path)
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    separator = next((s for s in ";\t" if s in text.partition("\n")[0]), ",")
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines(), delimiter=separator)]
    except csv.Error as error:
        raise InputError(f"{path}: is no table of lights ({error})") from error
    rows = [row for row in rows if any(row)]
    heading = [cell.lower() for cell in rows[0]] if rows else []
    known = {"tilt", "slant", "x", "y", "z"} & set(heading)
    if known:
        rows = rows[1:]
        angles = {"tilt", "slant"} <= known
        wanted = ("tilt", "slant") if angles else ("x", "y", "z")
        if not set(wanted) <= set(heading) or "image" not in heading:
            raise InputError(f"{path}: the heading must name image and tilt, slant or x, y, z, not {', '.join(heading)}")
        order = [heading.index(w) for w in ("image", *wanted)]
        rows = [[row[i] if i < len(row) else "" for i in order] for row in rows]
    names, lights = [], []
    for number, row in enumerate(rows, start=1):
        try:
            numbers = [float(cell) for cell in row[1:]]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3) or not np.isfinite(numbers).all() or (len(numbers) == 3 and not any(numbers)):
            raise InputError(f"{path}: row {number} is not 'image, tilt, slant' or 'image, x, y, z': {', '.join(row)!r}")
        vector = light_direction(*numbers) if len(numbers) == 2 else np.array(numbers)
        names.append(row[0].replace("\\", "/"))
        lights.append(unit(vector))
    if not names:
        raise InputError(f"{path}: holds no lights")
    return names, np.array(lights)


def read_table(path: PathLike, columns: tuple[int, ...], what: str) -> Array:
    """Read a plain table of numbers, a row or a column per image, as (K, columns).

    A table of as many columns as allowed is taken by rows, one of as many rows by columns.

    Raises
    ------
    InputError
        If it is no table of finite numbers, or of another shape.
    """
    path = check_readable(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that a table is empty is told below
            table = np.loadtxt(Path(path), ndmin=2, delimiter=_delimiter(path), encoding="utf-8")
    except ValueError as error:
        raise InputError(f"{path}: is no table of {what} ({error})") from error
    if not np.isfinite(table).all():
        raise InputError(f"{path}: holds {what} that are not finite numbers")
    if table.shape[1] in columns:
        return table
    if table.shape[0] in columns:
        return np.ascontiguousarray(table.T)
    allowed = " or ".join(str(c) for c in columns)
    raise InputError(f"{path}: {what} need {allowed} columns or rows, the table is {table.shape[0]} x {table.shape[1]}")


def _delimiter(path: Path) -> str | None:
    return "," if "," in path.read_text(encoding="utf-8", errors="replace") else None
