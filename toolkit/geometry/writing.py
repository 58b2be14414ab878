"""Writing points with normals and provenance."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments
from intaglio.errors import FileError, InputError
from intaglio.files import whole_file
from intaglio.mesh import color_fields, ply_table

if TYPE_CHECKING:
    from intaglio.geometry.point_set import PointSet

POINT_SUFFIXES = (".ply", ".xyz", ".obj")


@checked_arguments
def write_points(points: PointSet, path: PathLike) -> None:
    """Write points with normals to a file.

    PLY (binary, positions in double precision) keeps everything: normals, ``source``, ``moved``, ``patch``, colours, and the
    notes as comments. XYZ (x y z nx ny nz) and OBJ (``v`` and ``vn``) keep positions and normals, with all digits.

    Parameters
    ----------
    points : PointSet
        What to write.
    path : path
        The file; its suffix decides the type: .ply, .xyz or .obj. It appears whole, or stays as it was.

    Raises
    ------
    FileError
        If the suffix is unknown, or the file can't be written.
    InputError
        If ``points`` is not a PointSet.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> points = intaglio.PointSet(points=np.eye(3), normals=np.eye(3))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     intaglio.write_points(points, f"{folder}/points.xyz")
    ...     rows = np.loadtxt(f"{folder}/points.xyz")
    >>> rows[1]
    array([0., 1., 0., 0., 1., 0.])
    """
    if not hasattr(points, "normals"):
        raise InputError(f"points must be a PointSet, not {type(points).__name__}")
    path = Path(path)
    writer = {".ply": _write_ply, ".xyz": _write_xyz, ".obj": _write_obj}.get(path.suffix.lower())
    if writer is None:
        raise FileError(f"{path}: unknown type {path.suffix!r} of points; known: {', '.join(POINT_SUFFIXES)}")
    with whole_file(path) as beside:
        writer(points, beside)


def _write_ply(points: PointSet, path: Path) -> None:
    fields: list[tuple[str, str, Array]] = [(n, "double", points.points[:, i]) for i, n in enumerate("xyz")]
    fields += [(n, "float", points.normals[:, i]) for i, n in enumerate(("nx", "ny", "nz"))]
    if points.source is not None:
        fields.append(("source", "int", points.source))
    if points.moved is not None:
        fields.append(("moved", "float", points.moved))
    if points.patch is not None:
        fields.append(("patch", "int", points.patch))
    if points.color is not None:
        fields += color_fields(points.color)
    table, properties = ply_table(fields, len(points))
    header = ["ply", "format binary_little_endian 1.0", "comment intaglio points"]
    header += [f"comment note {json.dumps(note)}" for note in points.notes]
    header += [f"element vertex {len(points)}", *properties, "end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(header).encode("ascii"))
        file.write(table.tobytes())


def _write_xyz(points: PointSet, path: Path) -> None:
    np.savetxt(path, np.concatenate([points.points, points.normals], axis=1), fmt=["%.17g"] * 3 + ["%.9g"] * 3)


def _write_obj(points: PointSet, path: Path) -> None:
    with open(path, "w", encoding="ascii") as file:
        np.savetxt(file, points.points, fmt="v %.17g %.17g %.17g")
        np.savetxt(file, points.normals, fmt="vn %.9g %.9g %.9g")
