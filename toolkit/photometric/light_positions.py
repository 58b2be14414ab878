"""Light positions of image stacks: .lp files, lights.csv, and plain tables of directions or intensities."""

from __future__ import annotations

import csv
import io
import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments, checked_number, checked_numeric
from intaglio.errors import InputError
from intaglio.files import check_readable

_COMMENTS = ("#", "//", "%")
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
# A name, which may hold blanks, and three numbers.
_ENTRY = re.compile(rf"(?:(.*?)[\s,;]+)?({_NUMBER})[\s,;]+({_NUMBER})[\s,;]+({_NUMBER})[\s,;]*")
_LONGEST_LINE = 4096
# Degrees of more turns than this are no angle that anybody meant.
_LARGEST_ANGLE = 3600.0
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")


@checked_arguments
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
    t = np.radians(checked_number("tilt", tilt, -np.inf))
    s = np.radians(checked_number("slant", slant, -np.inf))
    return np.array([np.cos(t) * np.sin(s), np.sin(t) * np.sin(s), np.cos(s)])


def unit_directions(vectors: Array) -> Array:
    """Return ``vectors`` (..., 3), finite and not zero, scaled to unit length without overflow or underflow."""
    scaled = vectors / np.abs(vectors).max(axis=-1, keepdims=True)
    return np.asarray(scaled / np.linalg.norm(scaled, axis=-1, keepdims=True))


@checked_arguments
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

    Raises
    ------
    InputError
        If the lights are not finite vectors (..., 3).

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
    lights = checked_numeric("lights", lights, np.float64)
    if lights.ndim == 0 or lights.shape[-1] != 3 or not np.isfinite(lights).all():
        raise InputError(f"lights must be finite vectors (..., 3), not {lights.shape}")
    tilt = np.degrees(np.arctan2(lights[..., 1], lights[..., 0])) % 360
    return tilt, np.degrees(np.arccos(np.clip(lights[..., 2], -1, 1)))


def spread_lights(count: int, lowest: float) -> Array:
    """Return ``count`` unit vectors spread evenly from straight above down to a slant of ``lowest`` degrees (a spiral)."""
    z = 1 - (np.arange(count) + 0.5) / count * (1 - np.cos(np.radians(lowest)))
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


@dataclass(frozen=True)
class LightList:
    """What a list of lights says, line by line.

    Attributes
    ----------
    names : list of str
        Image files with forward slashes; empty if no line names one.
    lights : (K, 3) float64 array
        Unit vectors towards the lights; x right, y up, z to the camera. NaN where a line gives no direction.
    notes : list of str
        What was mended, and what was left out.
    """

    names: list[str]
    lights: Array
    notes: list[str]


def read_light_positions(path: PathLike) -> tuple[list[str], Array]:
    """Read an .lp file: a line with the number of images, which may be missing, then ``name x y z`` a line.

    Separators may be blanks, tabs, commas or semicolons, decimals may have a comma, and lines that begin with ``#`` or ``//``
    are comments.

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
    found = list_light_positions(path, strict=True)
    return found.names, found.lights


def list_light_positions(path: PathLike, *, strict: bool = False) -> LightList:
    """Read an .lp file as `read_light_positions`; unless ``strict``, a wrong count and lines without a direction are noted.

    Raises
    ------
    InputError
        If it holds no lights, half of its lines or more give none, or only some lines name an image; with ``strict`` also if a
        line gives none or the count is wrong.
    """
    path = check_readable(path)
    lines = [line.strip() for line in _text_of(path).splitlines()]
    lines = [line for line in lines if line and not line.startswith(_COMMENTS)]
    promised = int(lines[0]) if lines and re.fullmatch("[0-9]{1,9}", lines[0]) else None
    lines = lines[promised is not None :]
    entries = [_entry_of(line) for line in lines]
    wrong = [number for number, (_, vector) in enumerate(entries, start=1) if not np.isfinite(vector).all()]
    if wrong and (strict or 2 * len(wrong) >= len(entries)):
        raise InputError(
            f"{path}: entry {wrong[0]} is not 'name x y z' with a direction: {_shortened(lines[wrong[0] - 1])!r}"
            + (f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else "")
        )
    if not entries:
        raise InputError(f"{path}: holds no lights")
    notes = []
    if promised is not None and promised != len(entries):
        if strict:
            raise InputError(f"{path}: its first line declares {promised} images, but {len(entries)} follow")
        notes.append(f"{path.name}: its first line declares {promised} images, {len(entries)} follow and were taken")
    named = [bool(name) for name, _ in entries]
    if any(named) and not all(named):
        raise InputError(f"{path}: some entries name an image and some don't; name all or none")
    if not any(named) and wrong:
        # Without names, lights and images go by their order: a light that is missing would shift all that follow.
        raise InputError(f"{path}: entry {wrong[0]} is not 'x y z' with a direction: {_shortened(lines[wrong[0] - 1])!r}")
    return LightList([name for name, _ in entries if name], np.array([vector for _, vector in entries]), notes)


def _entry_of(line: str) -> tuple[str, Array]:
    """Return the image's name, which may be empty, and the unit vector of a line of an .lp file; NaN if it holds none."""
    words = line.split()
    if len(words) >= 3 and all(_DECIMAL_COMMA.fullmatch(word) for word in words[-3:]):
        name, numbers = " ".join(words[:-3]), [word.replace(",", ".") for word in words[-3:]]
    else:
        found = _ENTRY.fullmatch(line) if len(line) <= _LONGEST_LINE else None
        if found is None:
            # The name, so far as it can be told, says which image is left without a light.
            name = re.split("[\t,;]", line, maxsplit=1)[0] if re.search("[\t,;]", line) else line.rsplit(maxsplit=3)[0]
            return _name_of(_shortened(name)), np.full(3, np.nan)
        name, numbers = found[1] or "", list(found.groups()[1:])
    vector = np.array([float(number) for number in numbers])
    usable = np.isfinite(vector).all() and vector.any()
    return _name_of(name), unit_directions(vector) if usable else np.full(3, np.nan)


def _name_of(text: str) -> str:
    """Return a file name as written in a list: without quotes, with forward slashes."""
    return text.strip().strip("\"'").strip().replace("\\", "/")


def _shortened(text: str, most: int = 80) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def _text_of(path: Path) -> str:
    """Return a text file in whatever encoding it has: UTF-16 with a byte order mark, UTF-8, or else Windows' Latin."""
    content = path.read_bytes()
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", "replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


def read_lights_csv(path: PathLike) -> tuple[list[str], Array]:
    """Read ``lights.csv``: a row per image with its name and tilt, slant (degrees) or x, y, z.

    Columns may be separated by comma, semicolon or tab. A heading row may name them (``image``, ``tilt``, ``slant`` or
    ``x``, ``y``, ``z``, in any order); without one, a name and two numbers are tilt and slant, a name and three x, y, z.

    Raises
    ------
    InputError
        If a row has other columns, or numbers that are no direction.
    """
    found = list_lights_csv(path, strict=True)
    return found.names, found.lights


def list_lights_csv(path: PathLike, *, strict: bool = False) -> LightList:
    """Read a ``lights.csv`` as `read_lights_csv`; unless ``strict``, rows without a direction have a light of NaN.

    Raises
    ------
    InputError
        If it holds no lights, or half of its rows or more give none; with ``strict`` if one doesn't.
    """
    path = check_readable(path)
    text = _text_of(path)
    separator = next((s for s in ";\t" if s in text.partition("\n")[0]), ",")
    try:
        rows = [[cell.strip() for cell in row] for row in csv.reader(text.splitlines(), delimiter=separator)]
    except csv.Error as error:
        raise InputError(f"{path}: is not a table of lights ({error})") from error
    rows = [row for row in rows if any(row) and not row[0].startswith(_COMMENTS)]
    heading = [cell.lower() for cell in rows[0]] if rows else []
    known = {"tilt", "slant", "x", "y", "z"} & set(heading)
    if known:
        rows = rows[1:]
        angles = {"tilt", "slant"} <= known
        wanted = ("tilt", "slant") if angles else ("x", "y", "z")
        if not set(wanted) <= set(heading) or "image" not in heading:
            listed = _shortened(", ".join(heading))
            raise InputError(f"{path}: the heading must name image and tilt, slant or x, y, z, not {listed}")
        order = [heading.index(w) for w in ("image", *wanted)]
        rows = [[row[i] if i < len(row) else "" for i in order] for row in rows]
    vectors = [_vector_of(row[1:], decimal_comma=separator != ",") for row in rows]
    wrong = [number for number, vector in enumerate(vectors, start=1) if not np.isfinite(vector).all()]
    if wrong and (strict or 2 * len(wrong) >= len(rows)):
        listed = _shortened(", ".join(rows[wrong[0] - 1]))
        raise InputError(f"{path}: row {wrong[0]} is not 'image, tilt, slant' or 'image, x, y, z': {listed!r}")
    if not rows:
        raise InputError(f"{path}: holds no lights")
    return LightList([_name_of(row[0]) for row in rows], np.array(vectors), [])


def _vector_of(cells: list[str], decimal_comma: bool) -> Array:
    """Return the unit vector that two angles or three coordinates mean; NaN if they mean none."""
    try:
        numbers = [float(cell.replace(",", ".") if decimal_comma else cell) for cell in cells if cell]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3) or not np.isfinite(numbers).all() or (len(numbers) == 3 and not any(numbers)):
        return np.full(3, np.nan)
    if len(numbers) == 2 and max(map(abs, numbers)) > _LARGEST_ANGLE:
        return np.full(3, np.nan)
    return unit_directions(light_direction(*numbers) if len(numbers) == 2 else np.array(numbers))


def read_table(path: PathLike, columns: tuple[int, ...], what: str) -> Array:
    """Read a plain table of numbers, a row or a column per image, as (K, columns).

    If the number of columns is an allowed one, every row is an image; else, if the number of rows is, every column is.

    Raises
    ------
    InputError
        If it is not a table of finite numbers, or of another shape.
    """
    path = check_readable(path)
    text = _text_of(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # an empty table is reported below
            table = np.loadtxt(io.StringIO(text), ndmin=2, delimiter="," if "," in text else None)
    except ValueError as error:
        raise InputError(f"{path}: is not a table of {what} ({_shortened(str(error))})") from error
    if not np.isfinite(table).all():
        raise InputError(f"{path}: holds {what} that are not finite numbers")
    if table.shape[1] in columns:
        return table
    if table.shape[0] in columns:
        return np.ascontiguousarray(table.T)
    allowed = " or ".join(str(c) for c in columns)
    raise InputError(f"{path}: {what} need {allowed} columns or rows, the table is {table.shape[0]} x {table.shape[1]}")
