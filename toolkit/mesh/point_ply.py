"""Points of PLY files without faces: the vertices, with normals, colours and intensities."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError
from intaglio.mesh.ply_file import Lists, read_ply
from intaglio.mesh.point_cloud import PointFile, colors_from, colors_of_words

_HEADER = 1 << 20
_COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_INTENSITIES = ("intensity", "scalar_intensity", "reflectance", "scalar_reflectance")


def read_ply_points(path: Path) -> PointFile:
    """Read the vertices of a PLY file.

    Raises
    ------
    FileError
        If the file is damaged or cut off, or its vertices have no positions.
    InputError
        If it holds no vertices.
    """
    ply = read_ply(path)
    if not ply.rows.get("vertex"):
        raise InputError("holds no points")
    columns = {name.lower(): value for name, value in ply.elements["vertex"].items() if not isinstance(value, Lists)}
    return _points(columns, path)


def ply_holds_points(path: Path) -> bool:
    """Return whether a PLY file has neither faces nor a range grid."""
    with open(path, "rb") as file:
        header = file.read(_HEADER).split(b"end_header")[0].splitlines()
    other = (b"element face", b"element range_grid", b"element tristrips")
    elements = [line.split() for line in header if line.startswith(other)]
    return all(len(words) == 3 and words[2] == b"0" for words in elements)


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
