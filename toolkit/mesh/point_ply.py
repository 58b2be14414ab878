"""Points of PLY files without faces: the vertices, in text or binary, with normals, colours and intensities."""

from __future__ import annotations

import io
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError
from intaglio.mesh.point_cloud import PointFile, colors_from, colors_of_words, odd_line, plain, quoted

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_HEADER = 1 << 20
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_INTENSITIES = ("intensity", "scalar_intensity", "reflectance", "scalar_reflectance")


@dataclass
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)
    lists: bool = False


def read_ply_points(path: Path) -> PointFile:
    """Read the vertices of a PLY file.

    Raises
    ------
    FileError
        If the header is damaged, or promises more than the file holds.
    """
    with open(path, "rb") as file:
        head = file.read(_HEADER)
    order, elements, start = _header(head, path)
    before: list[_Element] = []
    for element in elements:
        if element.name == "vertex":
            break
        before.append(element)
    else:
        raise InputError("holds no vertices")
    if element.lists or any(e.lists for e in before):
        raise FileError(f"{path}: its vertices come with or after lists, which points can't be read with")
    table = _text_rows(path, start, before, element) if order == "" else _binary_rows(path, start, order, before, element)
    return _points(table, path)


def ply_holds_points(path: Path) -> bool:
    """Return whether a PLY file has neither faces nor a range grid."""
    with open(path, "rb") as file:
        header = file.read(_HEADER).split(b"end_header")[0].split(b"\n")
    elements = [
        line.split() for line in header if line.startswith((b"element face", b"element range_grid", b"element tristrips"))
    ]
    return all(len(words) == 3 and words[2] == b"0" for words in elements)


def _header(data: bytes, path: Path) -> tuple[str, list[_Element], int]:
    order, elements, place = None, list[_Element](), 0
    if not data.startswith(b"ply"):
        raise FileError(f"{path}: is named .ply, but its content is not PLY")
    while (end := data.find(b"\n", place)) >= 0:
        words = data[place:end].decode("latin-1").split()
        place = end + 1
        try:
            if words[:1] == ["format"]:
                order = _ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(_Element(words[1], int(words[2])))
            elif words[:2] == ["property", "list"]:
                elements[-1].lists = True
            elif words[:1] == ["property"]:
                elements[-1].properties.append((words[2], _TYPES[words[1]]))
        except (KeyError, IndexError, ValueError) as problem:
            raise FileError(f"{path}: its header can't be understood: {quoted(' '.join(words))} ({plain(problem)})") from problem
        if words[:1] == ["end_header"]:
            if order is None or any(e.count < 0 for e in elements):
                raise FileError(f"{path}: its header has no format line, or counts below 0")
            return order, elements, place
    raise FileError(f"{path}: its header has no end_header line")


def _binary_rows(path: Path, start: int, order: str, before: list[_Element], element: _Element) -> dict[str, Array]:
    start += sum(e.count * sum(np.dtype(kind).itemsize for _, kind in e.properties) for e in before)
    kinds = [np.dtype(order + kind) for _, kind in element.properties]
    size = sum(kind.itemsize for kind in kinds)
    held = path.stat().st_size - start
    if size == 0 or element.count * size > held:
        raise FileError(
            f"{path}: its header declares {element.count} vertex entries, {element.count * size} bytes, but {max(held, 0)} "
            "follow: the file is cut off"
        )
    with open(path, "rb") as file:
        file.seek(start)
        table = np.frombuffer(file.read(element.count * size), np.uint8).reshape(element.count, size)
    columns: dict[str, Array] = {}
    at = 0
    for (name, _), kind in zip(element.properties, kinds, strict=True):
        columns.setdefault(name.lower(), np.ascontiguousarray(table[:, at : at + kind.itemsize]).view(kind).reshape(-1))
        at += kind.itemsize
    return columns


def _text_rows(path: Path, start: int, before: list[_Element], element: _Element) -> dict[str, Array]:
    skipped = sum(e.count for e in before)
    if element.count > path.stat().st_size:
        raise FileError(
            f"{path}: its header declares {element.count} vertex entries, more than the file has bytes: it is cut off"
        )
    with open(path, "rb") as file:
        head = file.read(start)
        text = file.read().decode("latin-1")
    if not element.count:
        raise InputError("holds no points")
    try:
        rows = np.loadtxt(io.StringIO(text), comments=None, ndmin=2, skiprows=skipped, max_rows=element.count)
    except ValueError as problem:
        width = len(element.properties)
        odd = odd_line(text.splitlines()[skipped:], width, head.count(b"\n") + skipped + 1)
        raise FileError(f"{path}: {odd}; {width} numbers are needed: the file is cut off or damaged") from problem
    if rows.shape != (element.count, len(element.properties)):
        raise FileError(
            f"{path}: its header declares {element.count} vertex entries of {len(element.properties)} numbers, but it holds "
            f"{len(rows)} of {rows.shape[1]}: the file is cut off"
        )
    columns: dict[str, Array] = {}
    for (name, kind), column in zip(element.properties, rows.T, strict=True):
        finite = bool(np.isfinite(column).all())
        whole = kind[0] in "iu" and finite
        if whole and (column < np.iinfo(kind).min).any() | (column > np.iinfo(kind).max).any():
            raise FileError(f"{path}: its {quoted(name)} reaches from {column.min():g} to {column.max():g}, beyond its type")
        columns.setdefault(name.lower(), column.astype(kind) if whole else column)
    return columns


def _points(columns: dict[str, Array], path: Path) -> PointFile:
    def stacked(names: tuple[str, ...], kind: type = np.float64) -> Array | None:
        return np.stack([columns[n].astype(kind) for n in names], axis=1) if set(names) <= set(columns) else None

    points = stacked(("x", "y", "z"))
    if points is None:
        raise FileError(f"{path}: its vertices have no x, y and z")
    color, notes = stacked(("linear_red", "linear_green", "linear_blue"), np.float32), list[str]()
    names = next((names for names in _COLORS if set(names) <= set(columns)), None)
    if color is None and names is not None:
        kind = np.result_type(*(columns[n].dtype for n in names))
        levels = np.stack([columns[n] for n in names], axis=1)
        if kind.kind == "f":
            color = colors_from(levels, 1) if np.isfinite(levels).all() else levels.astype(np.float32)
        elif kind.itemsize == 2:
            color, note = colors_of_words(levels)
            notes += [note] if note else []
        else:
            color = colors_from(levels, 255)
    intensity = next((columns[n] for n in _INTENSITIES if n in columns), None)
    normals = stacked(("nx", "ny", "nz"))
    return PointFile(
        points=points,
        normals=stacked(("normal_x", "normal_y", "normal_z")) if normals is None else normals,
        color=color,
        intensity=None if intensity is None else intensity.astype(np.float32),
        notes=tuple(notes),
    )
