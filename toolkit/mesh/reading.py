"""Reading surfaces: PLY, OBJ, STL, OFF, glTF; range grids, point clouds, and provenance from PLY."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments, checked_flag
from intaglio.errors import FileError, InputError, IntaglioError
from intaglio.files import check_readable
from intaglio.mesh.base import Base, Cylinder, Plane, Sphere
from intaglio.mesh.gltf_file import read_gltf
from intaglio.mesh.mending import mend_faces, mend_surface
from intaglio.mesh.obj_file import read_obj
from intaglio.mesh.off_file import read_off
from intaglio.mesh.ply_file import Lists, Ply, read_ply
from intaglio.mesh.ply_mesh import ply_colors, raw_from_ply, read_raw_ply, vertex_numbers
from intaglio.mesh.point_cloud import PointFile
from intaglio.mesh.point_files import POINT_FILES, read_point_file
from intaglio.mesh.points import surface_from_points, surface_from_range_image
from intaglio.mesh.raw_mesh import RawMesh
from intaglio.mesh.smooth_base import SmoothBase
from intaglio.mesh.stl_file import read_stl
from intaglio.mesh.surface import Surface


@checked_arguments
def read_surface(path: PathLike, *, view: Sequence[float] | None = None, strict: bool = False) -> Surface:
    r"""Read a surface from a file.

    A PLY written by Intaglio comes back the same: vertices bit for bit, with base, provenance and model. A PLY with a
    ``range_grid`` is triangulated in its own grid. A point cloud (no faces) needs ``view``.

    Faces that do not join as a surface are mended, without moving a vertex: see `mend_surface`. What was done is in the
    ``notes``, and ``file_vertex`` tells which vertex of the file each one is.

    Parameters
    ----------
    path : path
        The file: .ply, .obj, .stl, .off, .gltf or .glb, or a file of points (.las, .laz, .e57, .xyz, .pts, .ptx, .pcd, .txt,
        .csv, .asc). Polygons and triangle strips are cut to triangles; several meshes in one file are joined.
    view : (3,) sequence, optional
        For a point cloud: the direction of sight, from the scanner to the object; default from the scanner's position, where the
        file has one. For a range grid: where the scanner
        stood. Default for a range grid: the origin if it is at least twice the points' extent away from them, as in most
        scans, else a place far along +z.
    strict : bool, optional
        Refuse a mesh that would have to be mended. Default False.

    Returns
    -------
    Surface
        Vertices as float64 in the file's own unit. Vertex colours, or a texture's colours at the vertices, are decoded to
        linear values. Texture coordinates and their picture are kept.

    Raises
    ------
    FileError
        If the file is missing, empty, damaged, or its suffix is unknown.
    InputError
        If its content is not a surface: no vertices, faces out of range, points without ``view``; with ``strict``, faces that
        do not join.

    See Also
    --------
    intaglio.mend_surface : The mending alone.
    intaglio.surface_from_points : Triangulate an array of points.
    intaglio.surface_from_range_image : Triangulate a range image.

    Examples
    --------
    >>> import pathlib
    >>> import tempfile
    >>> import intaglio
    >>> text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "triangle.obj")
    ...     _ = path.write_text(text)
    ...     surface = intaglio.read_surface(path)
    >>> surface.vertices
    array([[0., 0., 0.],
           [1., 0., 0.],
           [0., 1., 0.]])
    >>> surface.faces
    array([[0, 1, 2]], dtype=int32)
    """
    path = check_readable(path)
    strict = checked_flag("strict", strict)
    reader = _reader_of(path)
    try:
        # Numbers of absurd size are told by what they make, not by NumPy's warnings.
        with np.errstate(all="ignore"):
            if path.suffix.lower() == ".ply":
                ply = read_ply(path)
                if "range_grid" in ply.elements:
                    return _joined(_from_range_grid(ply, view), strict)
                if _is_own(ply):
                    return _own_surface(ply, path)
                raw = raw_from_ply(ply, path)
                # What the mesh is made of is all that is needed of the file from here on.
                del ply
                return _surface_of(raw, view, strict)
            if reader is None:
                return _joined(_from_points(read_point_file(path), view), strict)
            return _surface_of(reader(path), view, strict)
    except InputError as error:
        raise InputError(_with_name(error, path)) from error


def read_mesh_file(path: PathLike) -> RawMesh:
    """Return what a mesh file holds, not mended.

    Raises
    ------
    FileError
        If the file is missing, empty, damaged, or its suffix is unknown.
    InputError
        If it holds no mesh, or faces name vertices that don't exist.
    """
    path = check_readable(path)
    reader = _reader_of(path)
    if reader is None:
        raise FileError(f"{path}: {path.suffix} holds points, no faces; known mesh types: {', '.join(sorted(_readers))}")
    try:
        with np.errstate(all="ignore"):
            return reader(path)
    except InputError as error:
        raise InputError(_with_name(error, path)) from error


def _with_name(error: InputError, path: Path) -> str:
    """Return an error's message with the file's name before it."""
    said = str(error)
    return said if said.startswith(str(path)) else f"{path}: {said}"


def _reader_of(path: Path) -> Callable[[Path], RawMesh] | None:
    """Return what reads a mesh file of this type; None for a file of points."""
    kind = path.suffix.lower()
    if kind not in _readers and kind not in POINT_FILES:
        raise FileError(f"{path}: unknown mesh type {path.suffix!r}; known: {', '.join(sorted({*_readers, *POINT_FILES}))}")
    return _readers.get(kind)


def _joined(scan: Surface, strict: bool) -> Surface:
    """Return a triangulated scan, mended where points in a line or in one place made faces that don't join."""
    mended = mend_surface(scan, strict=strict)
    return scan if mended is scan else replace(mended, file_vertex=None)


def _from_points(found: PointFile, view: Sequence[float] | None) -> Surface:
    """Return the points of a file as a surface, triangulated as their scanner saw them."""
    direction = found.sight() if view is None else np.asarray(view, np.float64)
    if direction is None:
        where = "several scan positions" if found.viewpoints is not None else "no scan position"
        raise InputError(
            f"holds points, no faces, and {where}; give the direction of sight (view=(x, y, z), --view x,y,z) to triangulate them"
        )
    surface = surface_from_points(found.points, direction, color=found.color)
    return replace(surface, notes=found.notes + surface.notes)


def _surface_of(raw: RawMesh, view: Sequence[float] | None, strict: bool) -> Surface:
    """Return a file's mesh as a surface, mended; or its points triangulated as seen along ``view``."""
    if len(raw.vertices) == 0:
        raise InputError("holds no vertices")
    notes = raw.notes
    try:
        color = raw.joined_color()
    except IntaglioError as error:
        notes += (f"{error}; the mesh is read without its colours",)
        raw = replace(raw, pictures=(), picture=None)
        color = raw.joined_color()
    if len(raw.faces) == 0:
        return _from_points(PointFile(raw.vertices, color=color, notes=notes), view)
    if view is not None:
        notes += ("view is for points and range grids: this is a mesh, which needs none",)
    mending = mend_faces(raw.vertices, raw.faces)
    if strict and mending.notes:
        raise InputError(
            f"its faces don't join as a surface: {'; '.join(mending.notes)}; without --strict (strict=True) it is so mended"
        )
    pictures, shown = raw.kept_pictures(), raw.kept_numbers()
    if not mending.notes:
        # Nothing had to be mended: vertices and corners are the file's, in its order.
        return Surface(
            vertices=raw.vertices,
            faces=mending.faces,
            color=color,
            uv=raw.uv,
            picture=pictures[0] if pictures else None,
            more_pictures=pictures[1:],
            face_picture=shown,
            notes=notes,
        )
    return Surface(
        vertices=raw.vertices[mending.vertex],
        faces=mending.faces,
        color=None if color is None else color[mending.vertex],
        uv=None if raw.uv is None else raw.uv.reshape(-1, 2)[mending.corner],
        picture=pictures[0] if pictures else None,
        more_pictures=pictures[1:],
        face_picture=None if shown is None else shown[mending.corner[:, 0] // 3],
        file_vertex=mending.vertex,
        notes=notes + tuple(f"mended: {note}" for note in mending.notes),
    )


def _is_own(ply: Ply) -> bool:
    """Tell whether a PLY was written by `write_surface`."""
    return {"base_x", "measured", "source"} <= set(ply.elements.get("vertex", {})) and any("intaglio" in c for c in ply.comments)


def _own_surface(ply: Ply, path: Path) -> Surface:
    """Return the surface of a PLY that Intaglio wrote, with its base and provenance."""

    def columns(*fields: str) -> Array:
        found = ply.columns("vertex", *fields)
        if found is None:
            raise InputError(f"Intaglio's own properties in it are damaged: {', '.join(fields)} are not all there")
        return found

    raw = raw_from_ply(ply, path)
    if len(raw.vertices) == 0:
        raise InputError("holds no vertices")
    names = ply.elements["vertex"]
    known = ("rotation", "error", "confidence", "file_vertex", "exemplar", "exemplar_source")
    optional = {name: columns(name)[:, 0] for name in known if name in names}
    if "mirrored" in names:
        optional["mirrored"] = columns("mirrored")[:, 0].astype(bool)
    own_faces = ply.columns("face", "measured")
    pictures, shown = raw.kept_pictures(), raw.kept_numbers()
    foot, normals = columns("base_x", "base_y", "base_z"), columns("nx", "ny", "nz")
    try:
        model = _model_from(list(ply.comments), foot, normals, raw.faces)
        notes = tuple(str(json.loads(c[len("note ") :])) for c in ply.comments if c.startswith("note "))
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError, RecursionError) as error:
        raise InputError(f"Intaglio's own comments in it are damaged ({type(error).__name__}: {error})") from error
    return Surface(
        vertices=raw.vertices,
        faces=raw.faces,
        base=foot,
        normal=normals,
        color=columns("linear_red", "linear_green", "linear_blue") if "linear_red" in names else None,
        measured=columns("measured")[:, 0].astype(bool),
        source=columns("source")[:, 0],
        model=model,
        measured_face=None if own_faces is None else own_faces[:, 0].astype(bool),
        uv=raw.uv,
        picture=pictures[0] if pictures else None,
        more_pictures=pictures[1:],
        face_picture=shown,
        notes=notes + raw.notes,
        **optional,
    )


def _from_range_grid(ply: Ply, view: Sequence[float] | None) -> Surface:
    """Return the surface of a PLY range grid: one list per cell, empty or with the index of the vertex seen there."""
    try:
        columns, rows = int(ply.info["num_cols"]), int(ply.info["num_rows"])
    except (KeyError, ValueError) as error:
        raise InputError("has a range_grid but does not say num_cols and num_rows in its header") from error
    if columns < 1 or rows < 1:
        raise InputError(f"its range_grid has {columns} columns and {rows} rows; both must be positive")
    if rows * columns != ply.rows["range_grid"]:
        raise InputError(f"its range_grid has {ply.rows['range_grid']} cells, but its header says {columns} x {rows}")
    vertices = ply.columns("vertex", "x", "y", "z")
    lists = next((value for value in ply.elements["range_grid"].values() if isinstance(value, Lists)), None)
    if vertices is None or len(vertices) == 0 or lists is None:
        raise InputError("has a range_grid, but no vertices with x, y and z, or no lists of them in its cells")
    vertices = np.ascontiguousarray(vertices, np.float64)
    index = np.full(rows * columns, -1, np.int64)
    seen = lists.counts > 0
    index[seen] = vertex_numbers(lists.values, len(vertices), "range_grid", least=-1)[np.cumsum(lists.counts)[seen] - 1]
    points = np.full((rows * columns, 3), np.nan)
    points[index >= 0] = vertices[index[index >= 0]]
    if view is None:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
        inside = bool(((low <= 0) & (high >= 0)).all())
        stood = middle + (0.0, 0.0, 10.0 * size) if inside or np.linalg.norm(middle) < 2 * size else np.zeros(3)
    else:
        stood = np.asarray(view, np.float64)
    colors = ply_colors(ply)
    color = None
    if colors is not None:
        cells = np.zeros((rows * columns, 3), np.float32)
        cells[index >= 0] = colors[index[index >= 0]]
        color = cells.reshape(rows, columns, 3)
    return surface_from_range_image(points.reshape(rows, columns, 3), view=stood, color=color)


def _model_from(comments: list[str], foot: Array, normals: Array, faces: Array) -> Base | None:
    kinds: dict[str, Callable[..., Base]] = {"plane": Plane, "cylinder": Cylinder, "sphere": Sphere}
    for comment in comments:
        if comment.startswith("model "):
            record = dict(json.loads(comment[len("model ") :]))
            if record["kind"] == "smooth":
                return SmoothBase(vertices=foot, faces=faces, normals=normals, relief_scale=float(record["relief_scale"]))
            return kinds[record.pop("kind")](**record)
    return None


_readers: dict[str, Callable[[Path], RawMesh]] = {
    ".ply": read_raw_ply,
    ".stl": read_stl,
    ".obj": read_obj,
    ".off": read_off,
    ".gltf": read_gltf,
    ".glb": read_gltf,
}
