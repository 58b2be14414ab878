"""Points in text: tables of numbers (.xyz, .txt, .csv, .asc), .pts with counts, .ptx with scan poses, and .obj without faces."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError
from intaglio.files import check_memory
from intaglio.mesh.point_cloud import PointFile, colors_from, is_number, named, odd_line, quoted

# Lines before the first row of numbers that may say something else, and the share of later ones.
_MOST_HEADING, _FEW_BAD = 50, 0.05
# Lines that are read at once where some of a table's can't be.
_BLOCK = 5000
# Memory that a byte of text takes while it is read.
_PER_BYTE = 8
_COMMENT = ("#", "//", "%", '"#', "!")
# What columns are called in the headings of tables, in lower case without signs and brackets.
_NAMES = {
    "x": 0, "y": 1, "z": 2, "east": 0, "easting": 0, "north": 1, "northing": 1, "elevation": 2, "height": 2,
    "xcoord": 0, "ycoord": 1, "zcoord": 2, "xcoordinate": 0, "ycoordinate": 1, "zcoordinate": 2, "pointx": 0, "pointy": 1,
    "pointz": 2, "nx": 3, "ny": 4, "nz": 5, "normalx": 3, "normaly": 4, "normalz": 5, "xnormal": 3, "ynormal": 4, "znormal": 5,
    "r": 6, "g": 7, "b": 8, "red": 6, "green": 7, "blue": 8, "i": 9, "intensity": 9, "intensities": 9, "reflectance": 9,
    "scalarintensity": 9,
}  # fmt: skip
# What columns may mean, by their number: x, n, c and i stand for position, normal, colour (three columns each) and intensity.
_LAYOUTS = {
    3: ("x",),
    4: ("xi",),
    6: ("xc", "xn"),
    7: ("xic", "xci", "xin", "xni"),
    9: ("xcn", "xnc"),
    10: ("xicn", "xcin", "xcni", "xnci", "xinc", "xnic"),
}
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?|[+-]?\d+")


@dataclass
class _Table:
    """Rows of numbers of a text file, with its heading, the number of rows it promises, and what was passed over."""

    rows: Array
    heading: list[str]
    count: int | None
    left_out: int
    notes: list[str]


def text_of(path: Path) -> str:
    """Return a file's text: UTF-8 or UTF-16 by its mark, else Latin-1, in which all bytes are something.

    Raises
    ------
    FileError
        If it holds bytes that no text holds.
    """
    check_memory(path, _PER_BYTE * path.stat().st_size, "its text")
    data = path.read_bytes()
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", "replace")
    if b"\0" in data[:65536]:
        raise FileError(f"{path}: is named {path.suffix}, but holds binary data, not text")
    return data.removeprefix(b"\xef\xbb\xbf").decode("latin-1")


def read_table(path: Path) -> PointFile:
    """Read a table of points; a heading names its columns, else their number and values tell what they hold."""
    table = _table(text_of(path), path)
    notes = table.notes
    rows = table.rows
    if table.count is not None and not len(rows) <= table.count <= len(rows) + table.left_out:
        said = "the file may be cut off" if table.count > len(rows) else "all were read"
        notes.append(f"it promises {table.count:.15g} points, but holds {len(rows)}: {said}")
    columns = _columns(table.heading, rows.shape[1])
    if columns is None:
        columns, note = _guessed_columns(rows, path)
        notes += note
    taken = {name: rows[:, place] for name, place in columns.items()}
    color = None
    if "c" in taken:
        color, note = _colors(taken["c"])
        notes += note
    return PointFile(
        points=np.ascontiguousarray(taken["x"]),
        normals=np.ascontiguousarray(taken["n"]) if "n" in taken else None,
        color=color,
        intensity=taken["i"][:, 0].astype(np.float32) if "i" in taken else None,
        notes=tuple(notes),
    )


def _table(text: str, path: Path) -> _Table:
    """Split a table into its heading, the number of points that may stand first, and rows of numbers."""
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    heading: list[str] = []
    notes: list[str] = []
    count = None
    place, number = 0, 0
    first = ""
    while place < len(text):
        end = text.find("\n", place)
        end = len(text) if end < 0 else end
        line = text[place:end].strip()
        number += 1
        words = line.replace(",", " ").replace(";", " ").split()
        if words and not line.startswith(_COMMENT) and all(map(is_number, words)):
            if len(words) > 2:
                first = line
                break
            if len(words) == 1 and count is None:
                count = _promised(words[0], number, notes)
                place = end + 1
                continue
        if words:
            heading.append(line)
        if len(heading) > _MOST_HEADING:
            break
        place = end + 1
    if not first:
        if not heading:
            raise InputError("holds no points")
        wrong = next((line for line in heading if not line.startswith(_COMMENT)), heading[0])
        at = text[: text.find(wrong)].count("\n") + 1
        raise FileError(f"{path}: line {at} holds {quoted(wrong)}; lines of at least 3 numbers (x y z) are needed")
    body, comma = _separated(text[place:] if place else text, first)
    words = [w for line in heading for w in [line.strip("".join(_COMMENT)).strip()] if w]
    if len(words) == 1 and not heading[0].startswith(_COMMENT) and _columns(words, 99) is None:
        notes.append(f"line {number - 1} holds {quoted(words[0])}, not the names of columns; it was passed over")
    rows, left_out, further = _rows(body, "," if comma else None, number, path, notes)
    return _Table(rows, words, None if count is None else count + further, left_out, notes)


def _promised(word: str, number: int, notes: list[str]) -> int | None:
    """Return the number of points that a line of one number promises."""
    value = float(word)
    if 0 <= value < 1e18 and value == np.floor(value):
        return int(value)
    notes.append(f"line {number}, {quoted(word)}, is no number of points; it was passed over")
    return None


def _separated(text: str, line: str) -> tuple[str, bool]:
    """Return text whose columns are separated by commas (True) or spaces (False), and numbers have points."""
    parts = re.split(r"[;\s]+", line.strip("; \t"))
    if "." not in line and "," in line and len(parts) >= 3 and all(map(_DECIMAL_COMMA.fullmatch, parts)):
        return text.replace(",", ".").replace(";", " "), False
    if "," not in line and ";" not in line:
        return text, False
    fields = line.replace(";", ",").rstrip(", ").split(",")
    # Between commas an empty field keeps its place; where spaces separate too, they all are the same.
    if all(len(field.split()) == 1 for field in fields) and len(fields) >= 3:
        text = text.replace(";", ",")
        return (re.sub(r",[ \t]*(?=\n|$)", "", text) if line.rstrip()[-1] in ",;" else text), True
    return text.replace(",", " ").replace(";", " "), False


def _rows(text: str, delimiter: str | None, number: int, path: Path, notes: list[str]) -> tuple[Array, int, int]:
    """Return rows of numbers (N, K), how many lines hold none and were left out, and the points promised by counts between."""
    try:
        return np.loadtxt(io.StringIO(text), delimiter=delimiter, comments=None, ndmin=2), 0, 0
    except ValueError:
        pass
    lines = text.split("\n")
    usual = _usual_width(lines, delimiter)
    good: list[Array] = []
    bad: list[int] = []
    promised = 0
    for begin in range(0, len(lines), _BLOCK):
        block = lines[begin : begin + _BLOCK]
        try:
            full = any(map(str.strip, block))
            rows = np.loadtxt(block, delimiter=delimiter, comments=None, ndmin=2) if full else np.zeros((0, usual))
        except ValueError:
            rows = np.zeros((0, 0))
        if rows.shape[1] == usual:
            good.append(rows)
            continue
        single: list[list[float]] = []
        for at, line in enumerate(block, begin):
            words = line.split(delimiter)
            if not line.strip() or line.lstrip().startswith(_COMMENT):
                continue
            if len(words) == usual and all(map(is_number, words)):
                single.append(list(map(float, words)))
            elif len(words) == 1 and words[0].isdecimal() and len(words[0]) < 16:
                # Where .pts files hold several scans, each has its count.
                promised += int(words[0])
            else:
                bad.append(at)
        good.append(np.array(single).reshape(-1, usual))
    table = np.concatenate(good)
    if bad:
        where = f"line {bad[0] + number}: {quoted(lines[bad[0]])}"
        if len(bad) > _FEW_BAD * len(table):
            split = [lines[k].split(delimiter) for k in bad]
            found = sorted({usual, *map(len, split)})
            if len(found) > 1 and all(all(map(is_number, words)) for words in split):
                raise FileError(f"{path}: lines must hold as many numbers, all alike; found {found[:6]} of them, as in {where}")
            raise FileError(f"{path}: {where}; {usual} numbers are needed there and in {named(len(bad) - 1, 'further line')}")
        notes.append(f"{named(len(bad), 'line')} without {usual} numbers left out, the first is {where}")
    return table, len(bad), promised


def _usual_width(lines: list[str], delimiter: str | None) -> int:
    """Return how many columns most lines have, of an even choice of them."""
    full = [k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith(_COMMENT)]
    chosen = full[:: max(1, len(full) // _BLOCK)]
    return int(np.bincount([len(lines[k].split(delimiter)) for k in chosen]).argmax())


def _columns(heading: list[str], width: int) -> dict[str, Array] | None:
    """Return the places of what a heading's last line of names lists, or None if there is no such line."""
    for line in reversed(heading):
        # Names are parted as the columns are; units in brackets, signs and digits don't count.
        parts = re.split(r"[,;\t]" if re.search(r"[,;\t]", line) else r"\s+", re.sub(r"\([^()]*\)|\[[^][]*\]", "", line).strip())
        words = [re.sub(r"[^a-z]", "", part.lower()) for part in parts]
        found = {_NAMES[word]: place for place, word in reversed(list(enumerate(words))) if word in _NAMES and place < width}
        if {0, 1, 2} <= set(found):
            groups = {"x": (0, 1, 2), "n": (3, 4, 5), "c": (6, 7, 8), "i": (9,)}
            return {name: np.array([found[k] for k in ks]) for name, ks in groups.items() if set(ks) <= set(found)}
    return None


def _guessed_columns(rows: Array, path: Path) -> tuple[dict[str, Array], list[str]]:
    """Return the places of what columns without names hold, told by their number and values."""
    width = rows.shape[1]
    if width < 3:
        raise FileError(f"{path}: lines hold {width} numbers; at least 3 numbers (x y z) are needed")
    layouts = _LAYOUTS.get(width, ())
    for layout in layouts:
        places = _places(layout)
        if all(_fits(name, rows[:, place]) for name, place in places.items()):
            return places, []
    if width == 6:
        return _places("xn"), ["columns 4 to 6 were taken for normals, though they are not of length 1"]
    return {"x": np.arange(3)}, [
        f"columns 4 to {width} have no names and none of the usual meanings: they were left out; name them in a first line, "
        "as x y z nx ny nz r g b intensity"
    ]


def _places(layout: str) -> dict[str, Array]:
    places, at = {}, 0
    for name in layout:
        size = 1 if name == "i" else 3
        places[name] = np.arange(at, at + size)
        at += size
    return places


def _fits(name: str, values: Array) -> bool:
    """Tell whether values may be colours, of 8 bits or from 0 to 1, or unit normals."""
    values = values[np.isfinite(values).all(axis=1)]
    if name == "n":
        length = np.linalg.norm(values, axis=1)
        return bool(len(values)) and bool((np.abs(length - 1) < 0.05).mean() > 0.9)
    if name != "c" or not len(values):
        return True
    if values.min() < 0 or values.max() > 255:
        return False
    if (values == np.floor(values)).all():
        return bool(values.max() > 1)
    return bool(values.max() <= 1) and not _fits("n", values)


def _colors(values: Array) -> tuple[Array | None, list[str]]:
    """Return linear colours of a table's columns, from 0 to 1, to 255 or to 65535."""
    if not np.isfinite(values).all():
        return values.astype(np.float32), []
    most = float(values.max(initial=0))
    if most > 65535 or values.min(initial=0) < 0:
        return None, [f"its colours reach from {values.min():g} to {most:g}, not from 0 to 255: they were left out"]
    white = 255 if most > 1 else 1
    return colors_from(values, 65535 if most > 255 else white), []


def table_holds_points(path: Path) -> bool:
    """Return whether a text file begins, but for a heading, with lines of at least three numbers."""
    with open(path, "rb") as file:
        lines = file.read(65536).decode("latin-1").splitlines()
    for line in lines[:_MOST_HEADING]:
        words = re.split(r"[\s,;]+", line.strip())
        if len(words) >= 3 and all(map(is_number, words)):
            return True
    return False


def read_ptx(path: Path) -> PointFile:
    """Read a .ptx file: scans on grids, each with its pose; cells that hold 0 0 0 saw nothing."""
    lines = text_of(path).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    parts: list[Array] = []
    stood: list[Array] = []
    scan: list[int] = []
    empty, at = 0, 0
    while at < len(lines):
        cells, matrix = _ptx_head(lines, at, path)
        body = lines[at + 10 : at + 10 + cells]
        if len(body) < cells:
            raise FileError(f"{path}: line {at + 1} promises {cells} points, but {len(body)} follow: the file is cut off")
        try:
            rows = np.loadtxt(io.StringIO("\n".join(body)), comments=None, ndmin=2)
        except ValueError as problem:
            odd = odd_line(body, len(body[0].split()), at + 11)
            raise FileError(f"{path}: {odd}; 4 numbers (x y z intensity) or 7 (and r g b) are needed") from problem
        if rows.shape[1] not in (4, 7) or len(rows) != cells:
            raise FileError(
                f"{path}: its points hold {rows.shape[1]} numbers each; 4 (x y z intensity) or 7 (and r g b) are needed"
            )
        seen = rows[:, :3].any(axis=1)
        empty += int((~seen).sum())
        rows = rows[seen]
        with np.errstate(invalid="ignore", over="ignore"):
            rows[:, :3] = rows[:, :3] @ matrix[:3, :3] + matrix[3, :3]
        parts.append(rows)
        scan += [len(stood)] * len(rows)
        stood.append(matrix[3, :3])
        at += 10 + cells
    if not parts:
        raise InputError("holds no points")
    width = min(rows.shape[1] for rows in parts)
    table = np.concatenate([rows[:, :width] for rows in parts])
    notes = [f"{named(empty, 'cell')} of its grids without a point"] if empty else []
    color, more = _colors(table[:, 4:]) if width == 7 and len(table) else (None, [])
    return PointFile(
        points=np.ascontiguousarray(table[:, :3]),
        color=color,
        intensity=table[:, 3].astype(np.float32),
        viewpoints=np.array(stood),
        scan=np.array(scan, np.int32),
        notes=(*notes, *more),
    )


def _ptx_head(lines: list[str], at: int, path: Path) -> tuple[int, Array]:
    """Return the number of cells and the matrix (4, 4), for rows of coordinates, that a scan begins with."""
    try:
        columns, rows = int(lines[at]), int(lines[at + 1])
        matrix = np.array([[float(word) for word in line.split()] for line in lines[at + 6 : at + 10]])
        matrix = matrix.reshape(4, 4)
    except (ValueError, IndexError, OverflowError) as problem:
        raise FileError(
            f"{path}: line {at + 1} begins no scan: columns, rows, four lines of a pose and four of a matrix are needed"
        ) from problem
    if columns < 1 or rows < 1 or not np.isfinite(matrix).all():
        raise FileError(f"{path}: the scan at line {at + 1} has {columns} columns, {rows} rows and no finite 4 x 4 matrix")
    return columns * rows, matrix


def read_obj_points(path: Path) -> PointFile:
    """Read the points and normals of an OBJ file without faces."""
    points: list[list[float]] = []
    normals: list[list[float]] = []
    for number, line in enumerate(text_of(path).splitlines(), 1):
        words = line.split()
        if not words or words[0] not in ("v", "vn"):
            continue
        try:
            (points if words[0] == "v" else normals).append([float(word) for word in words[1:]])
        except ValueError as problem:
            raise FileError(f"{path}: line {number} holds {quoted(line)} where numbers are needed") from problem
    if any(len(row) < 3 for row in points + normals):
        raise FileError(f"{path}: has points or normals of fewer than 3 numbers")
    notes: list[str] = []
    if normals and len(normals) != len(points):
        raise InputError(f"holds {len(points)} points but {len(normals)} normals; a normal for each, or none, is needed")
    color = None
    if points and all(len(row) == 6 for row in points):
        color, notes = _colors(np.array([row[3:] for row in points]))
    return PointFile(
        points=np.array([row[:3] for row in points]).reshape(-1, 3),
        normals=np.array([row[:3] for row in normals]) if normals else None,
        color=color,
        notes=tuple(notes),
    )


def obj_has_faces(path: Path) -> bool:
    """Return whether an OBJ file has faces."""
    with open(path, "rb") as file:
        return any(line.split(maxsplit=1)[0] in (b"f", b"fo") for line in file if line.strip())
