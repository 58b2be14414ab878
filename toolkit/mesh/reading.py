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
from intaglio.files import check_readable, note_input
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh.base import Base, Cylinder, Plane, Sphere
from intaglio.mesh.gltf_file import read_gltf
from intaglio.mesh.mending import mend_faces, mend_surface
from intaglio.mesh.obj_file import find_beside, read_obj
from intaglio.mesh.off_file import read_off
from intaglio.mesh.ply_file import Lists, Ply, read_ply
from intaglio.mesh.point_cloud import PointFile
from intaglio.mesh.point_files import POINT_FILES, read_point_file
from intaglio.mesh.points import surface_from_points, surface_from_range_image
from intaglio.mesh.polygons import polygon_triangles, strip_triangles
from intaglio.mesh.raw_mesh import RawMesh
from intaglio.mesh.smooth_base import SmoothBase
from intaglio.mesh.stl_file import read_stl
from intaglio.mesh.surface import Surface

# PLY's names for the vertices of faces, for texture coordinates at their corners, and for such at vertices.
_INDEX_NAMES = ("vertex_indices", "vertex_index")
_UV_NAMES = ("texcoord", "texcoords")
_VERTEX_UV_NAMES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
_COLOR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))


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
                return _surface_of(_raw_from_ply(ply, path), view, strict)
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
    color, notes = raw.color, raw.notes
    try:
        color = raw.joined_color()
    except IntaglioError as error:
        notes += (f"{error}; the mesh is read without its colours",)
        raw = replace(raw, pictures=())
    if len(raw.faces) == 0:
        return _from_points(PointFile(raw.vertices, color=color, notes=notes), view)
    if view is not None:
        notes += ("view is for points and range grids: this is a mesh, which needs none",)
    mending = mend_faces(raw.vertices, raw.faces)
    if strict and mending.notes:
        raise InputError(
            f"its faces don't join as a surface: {'; '.join(mending.notes)}; without --strict (strict=True) it is so mended"
        )
    return Surface(
        vertices=raw.vertices[mending.vertex],
        faces=mending.faces,
        color=None if color is None else color[mending.vertex],
        uv=None if raw.uv is None else raw.uv.reshape(-1, 2)[mending.corner],
        picture=raw.kept_picture(),
        file_vertex=mending.vertex if mending.notes else None,
        notes=notes + tuple(f"mended: {note}" for note in mending.notes),
    )


def _read_raw_ply(path: Path) -> RawMesh:
    return _raw_from_ply(read_ply(path), path)


def _raw_from_ply(ply: Ply, path: Path) -> RawMesh:
    """Return the vertices, colours, polygons and strips of a PLY."""
    vertices = ply.columns("vertex", "x", "y", "z")
    if vertices is None:
        raise InputError("has no vertices with x, y and z")
    vertices = np.ascontiguousarray(vertices, np.float64)
    normals = ply.columns("vertex", "nx", "ny", "nz")
    polygons = ply.lists("face", *_INDEX_NAMES)
    notes: list[str] = []
    faces, uv = np.zeros((0, 3), np.int64), None
    if polygons is not None:
        numbers = _vertex_numbers(polygons.values, len(vertices), "face", least=0)
        corners = polygon_triangles(polygons.counts, numbers, vertices)
        faces = numbers[corners]
        uv = _ply_coordinates(ply, polygons, corners, faces)
        empty = int((polygons.counts < 3).sum())
        if empty:
            notes.append(f"{empty} faces of fewer than three corners left out")
    elif ply.rows.get("face"):
        raise InputError(f"its faces have no list named {' or '.join(_INDEX_NAMES)}")
    strips = ply.lists("tristrips", *_INDEX_NAMES)
    if strips is not None:
        # Strips end where their list does as well as at -1.
        at = np.cumsum(strips.counts)[:-1]
        numbers = _vertex_numbers(np.insert(strips.values.astype(np.int64), at, -1), len(vertices), "strip", least=-1)
        more = strip_triangles(numbers)
        uv = None if uv is None else np.concatenate([uv, np.full((len(more), 3, 2), np.nan)])
        faces = np.concatenate([faces, more])
    pictures = []
    named = [c.split(None, 1)[1] for c in ply.comments if c.lower().startswith("texturefile ")]
    found = [find_beside(path.parent, name) for name in named]
    for picture in found:
        note_input(picture)
    if uv is not None:
        pictures = [picture for picture in found if picture is not None]
        if len(pictures) < max(len(named), 1):
            missing = ", ".join(name for name, at in zip(named, found, strict=True) if at is None)
            notes.append(
                f"the mesh has texture coordinates but no picture{f': {missing} not found' if missing else ''}; it is read "
                "without its colours"
            )
    shown = None
    if len(pictures) > 1:
        number = ply.columns("face", "texnumber")
        if number is not None and polygons is not None:
            shown = np.full(len(faces), -1)
            kept = np.repeat(np.arange(len(polygons.counts)), polygons.counts)[corners[:, 0]]
            shown[: len(kept)] = number[kept, 0]
    return RawMesh(
        vertices=vertices,
        faces=faces,
        normals=None if normals is None else np.ascontiguousarray(normals, np.float64),
        color=_ply_colors(ply),
        uv=uv,
        pictures=tuple(pictures),
        picture=shown,
        notes=tuple(notes),
    )


def _vertex_numbers(values: Array, count: int, what: str, least: int) -> Array:
    """Return vertex numbers as int64, or raise `InputError` for those that don't exist."""
    if values.dtype.kind == "f":
        raise InputError(f"its {what}s name vertices by fractional numbers")
    numbers = values.astype(np.int64)
    if numbers.size and (numbers.min() < least or numbers.max() >= count):
        bad = int(numbers[(numbers < least) | (numbers >= count)][0])
        raise InputError(f"a {what} names vertex {bad}, but there are only {count} (0 to {count - 1})")
    return numbers


def _ply_coordinates(ply: Ply, polygons: Lists, corners: Array, faces: Array) -> Array | None:
    """Return texture coordinates (F, 3, 2) of the faces' corners, from lists at the faces or numbers at the vertices."""
    lists = ply.lists("face", *_UV_NAMES)
    if lists is not None:
        whole = lists.counts == 2 * polygons.counts
        uv = np.full((len(polygons.values), 2), np.nan)
        uv[np.repeat(whole, polygons.counts)] = lists.values[np.repeat(whole, lists.counts)].reshape(-1, 2)
        return np.asarray(uv[corners])
    for names in _VERTEX_UV_NAMES:
        at_vertices = ply.columns("vertex", *names)
        if at_vertices is not None:
            return np.asarray(at_vertices[faces], np.float64)
    return None


def _ply_colors(ply: Ply) -> Array | None:
    """Return the vertices' linear colours, or those of the faces about them."""
    for element in ("vertex", "face"):
        for names in _COLOR_NAMES:
            values = ply.columns(element, *names)
            if values is not None and element == "vertex":
                return _linear(values, element)
            polygons = ply.lists("face", *_INDEX_NAMES)
            if values is not None and polygons is not None and len(values):
                at = np.repeat(np.arange(len(values)), polygons.counts)
                linear = _linear(values, element)
                count = np.bincount(polygons.values, minlength=ply.rows["vertex"])
                sums = [np.bincount(polygons.values, linear[at, c], ply.rows["vertex"]) for c in range(3)]
                return np.asarray(np.stack(sums, axis=1) / np.maximum(count, 1)[:, None], np.float32)
    return None


def _linear(values: Array, element: str) -> Array:
    """Return stored colours, encoded by sRGB in integers or from 0 to 1, as linear ones."""
    if values.dtype.kind == "f":
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise InputError(
                f"{len(bad)} {'vertices' if element == 'vertex' else 'faces'} have a colour that is not finite, the first is "
                f"{element} {bad[0]}: leave these out, or the colours"
            )
        return decode_srgb(np.clip(values / (255.0 if values.max(initial=0) > 1 else 1.0), 0, 1).astype(np.float32))
    return decode_srgb(np.clip(values, 0, None).astype(np.float32) / np.float32(np.iinfo(values.dtype).max))


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

    raw = _raw_from_ply(ply, path)
    if len(raw.vertices) == 0:
        raise InputError("holds no vertices")
    names = ply.elements["vertex"]
    optional = {n: columns(n)[:, 0] for n in ("rotation", "error", "file_vertex") if n in names}
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
        uv=raw.uv,
        picture=raw.kept_picture(),
        notes=notes,
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
    index[seen] = _vertex_numbers(lists.values, len(vertices), "range_grid", least=-1)[np.cumsum(lists.counts)[seen] - 1]
    points = np.full((rows * columns, 3), np.nan)
    points[index >= 0] = vertices[index[index >= 0]]
    if view is None:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
        inside = bool(((low <= 0) & (high >= 0)).all())
        stood = middle + (0.0, 0.0, 10.0 * size) if inside or np.linalg.norm(middle) < 2 * size else np.zeros(3)
    else:
        stood = np.asarray(view, np.float64)
    colors = _ply_colors(ply)
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
    ".ply": _read_raw_ply,
    ".stl": read_stl,
    ".obj": read_obj,
    ".off": read_off,
    ".gltf": read_gltf,
    ".glb": read_gltf,
}
