"""OFF files: vertices with or without normals, colours and texture coordinates, and polygons."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError
from intaglio.files import check_memory, check_readable
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh.polygons import polygon_triangles
from intaglio.mesh.raw_mesh import RawMesh

_HEADER = re.compile(rb"(ST)?(C)?(N)?(4)?(n)?OFF(\s+BINARY)?\s*$")


def read_off(path: Path) -> RawMesh:
    """Read an OFF, COFF, NOFF or STOFF file in text.

    Raises
    ------
    FileError
        If it is binary or no OFF file, shorter than its header says, or a line can't be understood.
    InputError
        If a face names a vertex that does not exist.
    """
    check_memory(path, 8 * check_readable(path).stat().st_size, "its content")
    rows = [line.split(b"#", 1)[0].split() for line in path.read_bytes().splitlines()]
    rows = [row for row in rows if row]
    if not rows:
        raise FileError(f"{path}: holds no lines")
    first = rows[0][0]
    kind = _HEADER.fullmatch(first)
    if kind is None:
        raise FileError(f"{path}: is named .off, but does not begin with OFF")
    if rows[0][1:2] == [b"BINARY"] or kind[4] or kind[5]:
        raise FileError(f"{path}: is a binary or higher-dimensional OFF file; save it as plain OFF, or as PLY")
    rows = ([rows[0][1:]] if len(rows[0]) > 1 else []) + rows[1:]
    count, polygons = _counts(path, rows[0] if rows else [])
    if len(rows) - 1 < count + polygons:
        raise FileError(
            f"{path}: its header declares {count} vertices and {polygons} faces, but only {len(rows) - 1} lines follow: "
            "the file is cut off"
        )
    table = _vertex_table(path, rows[1 : 1 + count])
    vertices = np.ascontiguousarray(table[:, :3])
    at = 3 + (3 if kind[3] else 0)
    color = _colors(table[:, at:]) if kind[2] and table.shape[1] >= at + 3 else None
    counts, numbers = _polygons(path, rows[1 + count : 1 + count + polygons], count)
    triangles = polygon_triangles(counts, numbers, vertices)
    return RawMesh(vertices=vertices, faces=numbers[triangles], color=color)


def _counts(path: Path, row: list[bytes]) -> tuple[int, int]:
    """Return the numbers of vertices and faces."""
    if not 2 <= len(row) <= 3 or not all(w.isdigit() and len(w) < 16 for w in row):
        raise FileError(f"{path}: its second line must hold the numbers of vertices, faces and edges")
    return int(row[0]), int(row[1])


def _vertex_table(path: Path, rows: list[list[bytes]]) -> Array:
    """Return the vertices' lines as an array."""
    widths = {len(row) for row in rows}
    if len(widths) > 1 or (widths and min(widths) < 3):
        raise FileError(f"{path}: its vertices have from {min(widths)} to {max(widths)} numbers; all need the same, at least 3")
    try:
        return np.array(rows, np.float64).reshape(len(rows), -1) if rows else np.zeros((0, 3))
    except ValueError:
        for k, row in enumerate(rows):
            for word in row:
                try:
                    float(word)
                except ValueError:
                    shown = word[:40].decode("utf-8", "replace")
                    raise FileError(f"{path}: vertex {k} has {shown!r} where a number is needed") from None
        raise


def _colors(values: Array) -> Array | None:
    """Return linear colours of values from 0 to 1 or 0 to 255."""
    shown = values[:, :3]
    if not np.isfinite(shown).all():
        return None
    # Opaqueness tells the scale even where all is dark.
    scale = 255.0 if values[:, :4].max(initial=0) > 1 else 1.0
    return decode_srgb(np.clip(shown / scale, 0, 1).astype(np.float32))


def _polygons(path: Path, rows: list[list[bytes]], known: int) -> tuple[Array, Array]:
    """Return how many corners every face has, and all corners' vertices; what follows the corners is its colour."""
    try:
        counts = np.array([int(row[0]) for row in rows], np.int64)
        flat = [word for row, n in zip(rows, counts.tolist(), strict=True) for word in row[1 : n + 1]]
        numbers = np.array(flat, np.int64) if flat else np.zeros(0, np.int64)
    except (ValueError, OverflowError):
        raise FileError(f"{path}: a face has something else than whole numbers") from None
    short = [k for k, (row, n) in enumerate(zip(rows, counts.tolist(), strict=True)) if n < 0 or len(row) < n + 1]
    if short:
        raise FileError(f"{path}: face {short[0]} declares {counts[short[0]]} corners, its line holds {len(rows[short[0]]) - 1}")
    if numbers.size and (numbers.min() < 0 or numbers.max() >= known):
        bad = int(np.flatnonzero((numbers < 0) | (numbers >= known))[0])
        raise InputError(f"{path}: a face names vertex {numbers[bad]}; there are {known}, counted from 0")
    return counts, numbers
