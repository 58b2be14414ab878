"""Points in the Point Cloud Library's files (.pcd): text, binary, and binary compressed by LZF."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError
from intaglio.files import check_memory
from intaglio.mesh.point_cloud import PointFile, colors_from, named, odd_line, plain, quoted

# A header is shorter than this; a field has fewer values, and a row fewer bytes.
_HEADER, _MOST_VALUES, _MOST_BYTES = 65536, 4096, 1 << 20
_KINDS = {"F": "f", "I": "i", "U": "u"}


def read_pcd(path: Path) -> PointFile:
    """Read a .pcd file; its viewpoint is kept where it says anything.

    Raises
    ------
    FileError
        If the header lacks something or does not agree with the file's size.
    """
    check_memory(path, 4 * path.stat().st_size, "its points")
    data = path.read_bytes()
    header, start = _header(data[:_HEADER], path)
    fields, count, organized, kind = _layout(header, path)
    if kind == "ascii":
        columns = _from_text(data[start:], data[:start].count(b"\n"), fields, count, path)
    elif kind == "binary":
        columns = _from_rows(data, start, fields, count, path)
    elif kind == "binary_compressed":
        columns = _from_columns(data[start:], fields, count, path)
    else:
        raise FileError(f"{path}: its data are {quoted(kind)}; known are ascii, binary and binary_compressed")
    return _points(columns, _viewpoint(header, organized, path), organized, path)


def _header(data: bytes, path: Path) -> tuple[dict[str, list[str]], int]:
    """Return the words of a header's lines by their first, and where the data begin."""
    header: dict[str, list[str]] = {}
    place = 0
    while place < len(data):
        end = data.find(b"\n", place)
        if end < 0:
            break
        words = data[place:end].decode("latin-1").split()
        place = end + 1
        if not words or words[0].startswith("#"):
            continue
        header[words[0].upper()] = words[1:]
        if words[0].upper() == "DATA":
            return header, place
    raise FileError(f"{path}: is named .pcd, but has no header that ends with a DATA line")


def _layout(header: dict[str, list[str]], path: Path) -> tuple[list[tuple[str, str, int]], int, bool, str]:
    """Return the fields (name, type, number of values), the number of points, whether they lie on a grid, and the data's kind."""
    try:
        names = header.get("FIELDS", header.get("COLUMNS", []))
        sizes, kinds = [int(w) for w in header["SIZE"]], header["TYPE"]
        counts = [int(w) for w in header.get("COUNT", ["1"] * len(names))]
        width, height = int(header["WIDTH"][0]), int(header["HEIGHT"][0])
        points = int(header["POINTS"][0]) if header.get("POINTS") else width * height
        kind = header["DATA"][0].lower()
    except (KeyError, IndexError, ValueError) as problem:
        raise FileError(f"{path}: its header is incomplete or holds no whole numbers ({plain(problem)})") from problem
    if not names or not len(names) == len(sizes) == len(kinds) == len(counts):
        raise FileError(
            f"{path}: its header names {len(names)} fields, but {len(sizes)} sizes, {len(kinds)} types, {len(counts)} counts"
        )
    if min(width, height, points) < 0 or points != width * height:
        raise FileError(f"{path}: its header promises {points} points in {width} columns and {height} rows")
    fields = []
    for name, size, letter, values in zip(names, sizes, kinds, counts, strict=True):
        known = (2, 4, 8) if letter == "F" else (1, 2, 4, 8)
        if letter not in _KINDS or size not in known or not 0 < values <= _MOST_VALUES:
            raise FileError(f"{path}: its field {quoted(name)} has type {quoted(letter)}, size {size}, count {values}")
        fields.append((name.lower(), f"<{_KINDS[letter]}{size}", values))
    return fields, points, height > 1, kind


def _row_bytes(fields: list[tuple[str, str, int]]) -> int:
    return sum(np.dtype(kind).itemsize * values for _, kind, values in fields)


def _cut_off(path: Path, count: int, needed: int, found: int) -> FileError:
    return FileError(f"{path}: its header promises {count} points, {needed} bytes, but {found} follow: the file is cut off")


def _from_text(data: bytes, before: int, fields: list[tuple[str, str, int]], count: int, path: Path) -> dict[str, Array]:
    width = sum(values for _, _, values in fields)
    try:
        rows = np.loadtxt(io.StringIO(data.decode("latin-1")), comments="#", ndmin=2) if data.strip() else np.zeros((0, width))
    except ValueError as problem:
        # The header's lines are counted too.
        lines = data.decode("latin-1").splitlines()
        odd = odd_line(lines, width, before + 1)
        raise FileError(f"{path}: {odd}; {width} numbers are needed: the file is cut off or damaged") from problem
    if rows.shape != (count, width) and rows.size:
        raise FileError(
            f"{path}: its header promises {count} rows of {width} numbers, but there are {len(rows)} of {rows.shape[1]}"
        )
    if len(rows) != count:
        raise FileError(f"{path}: its header promises {named(count, 'point')}, but none follow: the file is cut off")
    columns: dict[str, Array] = {}
    at = 0
    for name, kind, values in fields:
        column = rows[:, at]
        whole = kind[1] != "f" and bool(np.isfinite(column).all()) and bool((np.abs(column) < 2**53).all())
        columns.setdefault(name, column.astype(np.int64) if whole else column)
        at += values
    return columns


def _from_rows(data: bytes, start: int, fields: list[tuple[str, str, int]], count: int, path: Path) -> dict[str, Array]:
    size = _row_bytes(fields)
    if count * size > len(data) - start:
        raise _cut_off(path, count, count * size, len(data) - start)
    table = np.frombuffer(data, np.uint8, count * size, start).reshape(count, size)
    columns: dict[str, Array] = {}
    at = 0
    for name, kind, values in fields:
        wide = np.dtype(kind).itemsize
        columns.setdefault(name, np.ascontiguousarray(table[:, at : at + wide]).view(kind).reshape(count))
        at += wide * values
    return columns


def _from_columns(data: bytes, fields: list[tuple[str, str, int]], count: int, path: Path) -> dict[str, Array]:
    needed = count * _row_bytes(fields)
    if len(data) < 8:
        raise _cut_off(path, count, needed, len(data))
    packed, unpacked = (int(n) for n in np.frombuffer(data, "<u4", 2))
    if unpacked != needed or packed > len(data) - 8:
        raise FileError(
            f"{path}: {needed} bytes of points are promised, {unpacked} of them packed into {packed}, but {len(data) - 8} "
            "follow: the file is cut off or damaged"
        )
    check_memory(path, 3 * needed, f"a cloud of {count} points")
    plane = _lzf_unpacked(data[8 : 8 + packed], needed, path)
    columns: dict[str, Array] = {}
    at = 0
    for name, kind, values in fields:
        size = np.dtype(kind).itemsize * values * count
        columns.setdefault(name, np.frombuffer(plane, kind, count * values, at).reshape(count, values)[:, 0])
        at += size
    return columns


def _lzf_unpacked(data: bytes, size: int, path: Path) -> bytes:
    """Return what LibLZF packed: runs of literals, and copies of what came up to 8 KiB before."""
    made = bytearray()
    at, end = 0, len(data)
    try:
        while at < end and len(made) <= size:
            control = data[at]
            at += 1
            if control < 32:
                made += data[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[at]
                at += 1
            begin = len(made) - ((control & 31) << 8) - data[at] - 1
            at += 1
            length += 2
            if begin < 0:
                break
            piece = made[begin : begin + length]
            # A copy may reach into itself: it then repeats.
            made += piece if len(piece) == length else (piece * (length // len(piece) + 1))[:length]
    except IndexError:
        pass
    if len(made) != size:
        raise FileError(f"{path}: its compressed points are damaged: {len(made)} bytes come out where {size} are promised")
    return bytes(made)


def _viewpoint(header: dict[str, list[str]], organized: bool, path: Path) -> Array | None:
    """Return where the sensor stood (3,); the header's default, the origin, says something of points on a sensor's grid only."""
    try:
        values = [float(word) for word in header.get("VIEWPOINT", [])[:3]]
    except ValueError as problem:
        raise FileError(f"{path}: its VIEWPOINT holds no numbers ({plain(problem)})") from problem
    if len(values) != 3 or not all(map(math.isfinite, values)):
        return None
    return np.array(values) if organized or any(values) else None


def _points(columns: dict[str, Array], stood: Array | None, organized: bool, path: Path) -> PointFile:
    if not {"x", "y", "z"} <= set(columns):
        raise FileError(f"{path}: its fields are {', '.join(list(columns)[:12])[:80]}; x, y and z are needed")

    def stacked(*names: str) -> Array | None:
        # Signalling NaN of damaged floats would be warned of.
        with np.errstate(invalid="ignore"):
            return np.stack([columns[n].astype(np.float64) for n in names], axis=1) if set(names) <= set(columns) else None

    points = stacked("x", "y", "z")
    assert points is not None
    notes = []
    if organized:
        seen = np.isfinite(points).all(axis=1)
        if not seen.all():
            notes.append(f"{named(int((~seen).sum()), 'cell')} of its grid without a point")
            columns = {name: column[seen] for name, column in columns.items()}
            points = points[seen]
    intensity = columns.get("intensity", columns.get("i"))
    return PointFile(
        points=points,
        normals=stacked("normal_x", "normal_y", "normal_z") if "normal_x" in columns else stacked("nx", "ny", "nz"),
        color=_colors(columns),
        intensity=None if intensity is None else intensity.astype(np.float32),
        viewpoints=None if stood is None else stood[None],
        scan=None if stood is None else np.zeros(len(points), np.int32),
        notes=tuple(notes),
    )


def _colors(columns: dict[str, Array]) -> Array | None:
    """Return linear colours of packed values 0x00RRGGBB, which may pose as floats, or of columns of their own."""
    packed = columns.get("rgb", columns.get("rgba"))
    if packed is not None:
        if packed.dtype.kind == "f":
            with np.errstate(all="ignore"):
                packed = np.ascontiguousarray(packed, np.float32).view(np.uint32)
        word = packed.astype(np.int64)
        return colors_from(np.stack([word >> 16 & 255, word >> 8 & 255, word & 255], axis=1), 255)
    if {"r", "g", "b"} <= set(columns):
        levels = np.stack([columns[n].astype(np.float64) for n in "rgb"], axis=1)
        with np.errstate(invalid="ignore"):
            white = 1.0 if columns["r"].dtype.kind == "f" and levels.max(initial=0) <= 1 else 255.0
        return colors_from(levels, white)
    return None
