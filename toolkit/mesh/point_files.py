"""Reading points from files: LAS, LAZ, COPC, E57, tables of text, PTS, PTX, PCD, PLY and OBJ without faces."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from intaglio.arrays import PathLike
from intaglio.errors import FileError, InputError
from intaglio.files import check_readable
from intaglio.mesh.point_cloud import PointFile, tidied
from intaglio.mesh.point_pcd import read_pcd
from intaglio.mesh.point_ply import ply_holds_points, read_ply_points
from intaglio.mesh.point_scans import read_e57, read_las
from intaglio.mesh.point_text import obj_has_faces, read_obj_points, read_ptx, read_table, table_holds_points


def read_point_file(path: PathLike) -> PointFile:
    r"""Read the points of a file, with all that it holds of them.

    Points without finite coordinates and repeated ones are left out, and normals of length 0 are taken from the nearest
    points; the notes say so. Coordinates stay as they are, but for the poses that scans come with.

    Parameters
    ----------
    path : path
        The file:

        * laser scans: .las and .laz, also as COPC (laspy and lazrs are needed), .e57 (pye57); all come with ``pip install
          'intaglio[points]'``;
        * tables of numbers: .xyz, .txt, .csv, .asc and .pts, with columns parted by spaces, tabs, commas or semicolons.
          A first line may name them; else x y z, then intensity, normals and colours are told by their number and values.
          They may begin with the number of points;
        * .ptx, .pcd;
        * .ply and .obj without faces.

    Returns
    -------
    PointFile
        The points as float64 in world coordinates, and what the file holds of normals, colours (decoded to linear values),
        intensities and the scanner's positions.

    Raises
    ------
    FileError
        If the file is missing, empty, damaged, cut off, or of an unknown type, or a package is missing that reads it.
    InputError
        If it holds no points.

    Examples
    --------
    >>> import pathlib
    >>> import tempfile
    >>> from intaglio.mesh import read_point_file
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "scan.pts")
    ...     _ = path.write_text("2\n0 0 1 -900 255 0 0\n0 1 1 -850 0 0 255\n")
    ...     found = read_point_file(path)
    >>> found.color
    array([[1., 0., 0.],
           [0., 0., 1.]], dtype=float32)
    >>> found.intensity
    array([-900., -850.], dtype=float32)
    """
    path = check_readable(path)
    reader = _readers.get(path.suffix.lower())
    if reader is None:
        raise FileError(f"{path}: unknown type {path.suffix!r} of points; known: {', '.join(sorted(_readers))}")
    try:
        # Numbers of absurd size are left out with a note, without NumPy's warnings.
        with np.errstate(all="ignore"):
            return tidied(reader(path))
    except InputError as problem:
        said = str(problem)
        raise InputError(said if said.startswith(f"{path}: ") else f"{path}: {said}") from problem


def holds_points(path: PathLike) -> bool:
    """Return whether a file holds points without faces: a scan, a table of three numbers or more, a PLY or OBJ without faces.

    Parameters
    ----------
    path : path
        A file that exists.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind == ".obj":
        return not obj_has_faces(path)
    if kind == ".ply":
        return ply_holds_points(path)
    return kind in POINT_FILES and (kind not in (".txt", ".csv") or table_holds_points(path))


_readers: dict[str, Callable[[Path], PointFile]] = {
    ".las": read_las,
    ".laz": read_las,
    ".e57": read_e57,
    ".xyz": read_table,
    ".txt": read_table,
    ".csv": read_table,
    ".asc": read_table,
    ".pts": read_table,
    ".ptx": read_ptx,
    ".pcd": read_pcd,
    ".ply": read_ply_points,
    ".obj": read_obj_points,
}

# Files that hold nothing but points.
POINT_FILES = tuple(kind for kind in _readers if kind not in (".ply", ".obj"))
