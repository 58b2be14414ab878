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
    """Return the unit vector towards a light of given tilt and slant.

    It is (cos τ sin σ, sin τ sin σ, cos σ) for tilt τ and slant σ, with x to the right of the image, y up and z towards the
    camera.

    Parameters
    ----------
    tilt : float
        Angle in degrees from the x axis to the light's projection onto the image, counter-clockwise.
    slant : float
        Angle in degrees from the line of sight: 0 is straight above the sample, 90 the horizon.

    Returns
    -------
    (3,) float64 array
        Unit vector x, y, z towards the light.

    See Also
    --------
    intaglio.tilt_and_slant : The reverse.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 3.3 and figure
    3.3.1.

    Examples
    --------
    >>> import intaglio
    >>> intaglio.light_direction(tilt=90, slant=45).round(3)
    array([0.   , 0.707, 0.707])
    """
    t, s = np.radians(tilt), np.radians(slant)
    return np.array([np.cos(t) * np.sin(s), np.sin(t) * np.sin(s), np.cos(s)])


def unit_directions(vectors: Array) -> Array:
    """Return ``vectors`` (..., 3), finite and not zero, scaled to unit length without overflow or underflow."""
    scaled = vectors / np.abs(vectors).max(axis=-1, keepdims=True)
    return np.asarray(scaled / np.linalg.norm(scaled, axis=-1, keepdims=True))


def tilt_and_slant(lights: Array) -> tuple[Array, Array]:
    """Return the tilts and slants of lights.

    Parameters
    ----------
    lights : (..., 3) array
        Unit vectors towards the lights; x right, y up, z to the camera.

    Returns
    -------
    tilt : (...) float64 array
        Angles in degrees in [0, 360) from the x axis, counter-clockwise; 0 for a light straight above.
    slant : (...) float64 array
        Angles in degrees in [0, 180] from the line of sight.

    See Also
    --------
    intaglio.light_direction : The reverse.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 3.3 and figure
    3.3.1.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> tilt, slant = intaglio.tilt_and_slant(np.array([[0.0, 0.6, 0.8], [-1.0, 0.0, 0.0]]))
    >>> print(tilt.round(2), slant.round(2))
    [ 90. 180.] [36.87 90.  ]
    """
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
        Image files, relative to the .lp file, with forward slashes; empty if the lines are just ``x y z``.
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
        lights.append(unit_directions(vector))
    if not names:
        raise InputError(f"{path}: holds no lights")
    if promised is not None and promised != len(names):
        raise InputError(f"{path}: its first line declares {promised} images, but {len(names)} follow")
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
        raise InputError(f"{path}: is not a table of lights ({error})") from error
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
        lights.append(unit_directions(vector))
    if not names:
        raise InputError(f"{path}: holds no lights")
    return names, np.array(lights)


def read_table(path: PathLike, columns: tuple[int, ...], what: str) -> Array:
    """Read a plain table of numbers, a row or a column per image, as (K, columns).

    If the number of columns is an allowed one, every row is an image; else, if the number of rows is, every column is.

    Raises
    ------
    InputError
        If it is not a table of finite numbers, or of another shape.
    """
    path = check_readable(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an empty table is reported below
            table = np.loadtxt(Path(path), ndmin=2, delimiter=_delimiter(path), encoding="utf-8")
    except ValueError as error:
        raise InputError(f"{path}: is not a table of {what} ({error})") from error
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
