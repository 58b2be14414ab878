"""Reading surfaces: PLY, OBJ, STL, OFF, glTF through trimesh; range grids, point clouds, and provenance from PLY."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.errors import FileError, InputError
from intaglio.files import check_readable
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh.base import Base, Cylinder, Plane, Sphere
from intaglio.mesh.points import surface_from_points, surface_from_range_image
from intaglio.mesh.repair import repair_surface
from intaglio.mesh.smooth_base import SmoothBase
from intaglio.mesh.surface import Surface

_HEAD = re.compile(rb"^ply\s")


def read_surface(path: PathLike, *, view: Sequence[float] | None = None, repair: bool = False) -> Surface:
    r"""Read a surface from a file.

    A PLY written by Intaglio comes back the same: vertices bit for bit, with base, provenance and model. A PLY with a
    ``range_grid`` is triangulated in its own grid. A point cloud (no faces) needs ``view``.

    Parameters
    ----------
    path : path
        The file: .ply, .obj, .stl, .off, .gltf or .glb. Several meshes in one file are joined.
    view : (3,) sequence, optional
        For a point cloud: the direction of sight, from the scanner to the object. For a range grid: where the scanner
        stood. Default for a range grid: the origin if it is at least twice the points' extent away from them, as in most
        scans, else a place far along +z.
    repair : bool, optional
        Merge vertices that lie exactly on one another, drop faces that are degenerate or repeated or share an edge with
        two others already, and turn faces so that neighbours agree. What was done is added to the ``notes``; coordinates
        are not changed. Default False: the file is taken as it is.

    Returns
    -------
    Surface
        Vertices as float64 in the file's own unit. Vertex colours, or a texture's colours at the vertices, are decoded to
        linear values.

    Raises
    ------
    FileError
        If the file is missing, empty, damaged, or its suffix is unknown.
    InputError
        If its content is not a surface: no vertices, NaN, faces out of range, points without ``view``.

    See Also
    --------
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
    reader = _readers.get(path.suffix.lower())
    if reader is None:
        raise FileError(f"{path}: unknown mesh type {path.suffix!r}; known: {', '.join(sorted(_readers))}")
    try:
        surface = reader(path, view)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return repair_surface(surface) if repair else surface


def _read_with_trimesh(path: Path, view: Sequence[float] | None) -> Surface:
    return _from_trimesh(load_mesh(path), path, view)


def load_mesh(path: Path) -> Any:
    """Return a file's mesh as trimesh reads it, the parts of a scene joined; `FileError` if it can't be read."""
    import trimesh

    try:
        loaded = trimesh.load(path, process=False, maintain_order=True)
        if isinstance(loaded, trimesh.Scene):
            parts = [g for g in loaded.dump() if isinstance(g, trimesh.Trimesh)]
            if not parts:
                raise InputError("holds no mesh")
            loaded = parts[0] if len(parts) == 1 else trimesh.util.concatenate(parts)
    except InputError:
        raise
    except Exception as error:
        kind = path.suffix[1:].upper()
        raise FileError(f"{path}: can't be read as {kind} ({type(error).__name__}: {error})") from error
    return loaded


def _from_trimesh(mesh: Any, path: Path, view: Sequence[float] | None) -> Surface:
    vertices = getattr(mesh, "vertices", None)
    if vertices is None or len(vertices) == 0:
        raise InputError("holds no vertices")
    vertices = np.array(vertices, np.float64)
    faces = np.array(getattr(mesh, "faces", np.zeros((0, 3))), np.int64)
    color = vertex_colors(mesh, len(vertices))
    if len(faces) == 0:
        if view is None:
            raise InputError(
                "holds points but no faces; give the direction of sight (view=(x, y, z), --view x,y,z) to triangulate them"
            )
        return surface_from_points(vertices, np.asarray(view, np.float64), color=color)
    return Surface(vertices=vertices, faces=faces, color=color, notes=_missing_texture(mesh, path))


def picture_of(visual: Any) -> Any:
    """Return the picture of a textured mesh's material, or None."""
    material = getattr(visual, "material", None)
    return getattr(material, "image", None) or getattr(material, "baseColorTexture", None)


def _missing_texture(mesh: Any, path: Path) -> tuple[str, ...]:
    """Return a note about a textured mesh whose picture was not found, with the name of the missing file if it is known."""
    visual = getattr(mesh, "visual", None)
    if getattr(visual, "kind", None) != "texture" or getattr(visual, "uv", None) is None or picture_of(visual) is not None:
        return ()
    missing = []
    if path.suffix.lower() == ".obj":
        named = _named_files(path, "mtllib")
        missing = [n for n in named if not (path.parent / n).exists()]
        for library in named:
            if library not in missing:
                pictures = _named_files(path.parent / library, "map_Kd")
                missing += [n for n in pictures if not (path.parent / library).parent.joinpath(n).exists()]
    what = f": {', '.join(missing)} not found" if missing else ""
    return (f"the mesh has texture coordinates but no picture{what}; it is read without colours",)


def _named_files(path: Path, keyword: str) -> list[str]:
    """Return the names of files in those lines of a text file that begin with ``keyword``."""
    with open(path, encoding="utf-8", errors="replace") as file:
        lines = [line.split(maxsplit=1) for line in file if line.lower().startswith(keyword.lower())]
    return [words[1].strip().replace("\\", "/") for words in lines if len(words) == 2]


def vertex_colors(mesh: Any, count: int) -> Array | None:
    """Return the vertex colours as linear floats, if the mesh has colours; a texture is sampled at the vertices."""
    visual: Any = getattr(mesh, "visual", None)
    if getattr(visual, "kind", None) == "texture" and getattr(visual, "uv", None) is not None:
        if picture_of(visual) is None:
            return None
        visual = visual.to_color()
    colors = None
    if getattr(visual, "kind", None) == "vertex" or (visual is not None and hasattr(visual, "vertex_colors")):
        if getattr(visual, "kind", None) in ("vertex", "face", None) and getattr(visual, "defined", True):
            colors = np.asarray(visual.vertex_colors)
    elif getattr(mesh, "colors", None) is not None and len(mesh.colors) == count:
        colors = np.asarray(mesh.colors)
    if colors is None or colors.ndim != 2 or len(colors) != count:
        return None
    return decode_srgb(colors[:, :3].astype(np.float32) / 255.0)


def _read_stl(path: Path, view: Sequence[float] | None) -> Surface:
    """Read an STL file, whose triangles share no vertices: equal ones are joined, as the format intends."""
    surface = _read_with_trimesh(path, view)
    vertices, first, inverse = np.unique(surface.vertices, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return Surface(vertices=vertices[order], faces=rank[inverse.reshape(-1)][surface.faces])


def _read_ply(path: Path, view: Sequence[float] | None) -> Surface:
    comments = _ply_comments(path)
    mesh = load_mesh(path)
    raw = mesh.metadata.get("_ply_raw", {})
    vertex = raw.get("vertex", {}).get("data")
    if "range_grid" in raw:
        return _from_range_grid(mesh, raw["range_grid"], path, view)
    _check_counts(mesh, raw)
    _check_colors(vertex)
    names = set(_field_names(vertex))
    if not {"base_x", "measured", "source"} <= names or not any("intaglio" in c for c in comments):
        return _from_trimesh(mesh, path, view)
    try:
        return _own_surface(mesh, vertex, names, comments)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"Intaglio's own properties in it are damaged ({type(error).__name__}: {error})") from error


def _check_colors(vertex: Any) -> None:
    """Raise `InputError` for colours that are not finite: converted to bytes they would silently turn black."""
    for name in ("red", "green", "blue"):
        if name in _field_names(vertex):
            values = np.asarray(vertex[name]).reshape(-1)
            if values.dtype.kind == "f" and not np.isfinite(values).all():
                bad = np.flatnonzero(~np.isfinite(values))
                raise InputError(
                    f"{len(bad)} vertices have a {name} that is not finite, the first is vertex {bad[0]}: leave these vertices "
                    "out, or the colours"
                )


def _check_counts(mesh: Any, raw: dict[str, Any]) -> None:
    """Raise `InputError` if the file holds fewer elements than its header declares."""
    for name, found in (("vertex", len(getattr(mesh, "vertices", ()))), ("face", len(getattr(mesh, "faces", ())))):
        promised = raw.get(name, {}).get("length", 0)
        if found < promised:
            raise InputError(f"its header declares {promised} {name} entries, but it holds {found}: the file is cut off")


def _own_surface(mesh: Any, vertex: Any, names: set[str], comments: list[str]) -> Surface:
    """Return the surface of a PLY that Intaglio wrote, with its base and provenance."""

    def columns(*fields: str) -> Array:
        return np.stack([np.asarray(vertex[f]).reshape(-1) for f in fields], axis=1)

    optional = {n: np.asarray(vertex[n]).reshape(-1) for n in ("rotation", "error") if n in names}
    has_color = "linear_red" in names
    foot, normals = columns("base_x", "base_y", "base_z"), columns("nx", "ny", "nz")
    faces = np.asarray(getattr(mesh, "faces", np.zeros((0, 3), int)))
    return Surface(
        vertices=columns("x", "y", "z"),
        faces=faces,
        base=foot,
        normal=normals,
        color=columns("linear_red", "linear_green", "linear_blue") if has_color else None,
        measured=np.asarray(vertex["measured"]).reshape(-1).astype(bool),
        source=np.asarray(vertex["source"]).reshape(-1),
        model=_model_from(comments, foot, normals, faces),
        notes=tuple(json.loads(c[len("note ") :]) for c in comments if c.startswith("note ")),
        **optional,
    )


def _field_names(data: Any) -> tuple[str, ...]:
    if data is None:
        return ()
    if isinstance(data, dict):
        return tuple(data)
    return tuple(data.dtype.names or ())


def _ply_comments(path: Path) -> list[str]:
    comments: list[str] = []
    with open(path, "rb") as file:
        if not _HEAD.match(file.read(4)):
            raise FileError(f"{path}: is named .ply, but its content is not PLY")
        for line in file:
            if line.startswith(b"end_header"):
                return comments
            if line.startswith(b"comment "):
                comments.append(line[len(b"comment ") :].decode("utf-8", "replace").strip())
    raise FileError(f"{path}: its header has no end_header line")


def _from_range_grid(mesh: Any, grid: dict[str, Any], path: Path, view: Sequence[float] | None) -> Surface:
    """Return the surface of a PLY range grid: one list per cell, empty or with the index of the vertex seen there."""
    header = _ply_header(path)
    try:
        columns, rows = int(header["num_cols"]), int(header["num_rows"])
    except (KeyError, ValueError) as error:
        raise InputError("has a range_grid but does not say num_cols and num_rows in its header") from error
    if columns < 1 or rows < 1:
        raise InputError(f"its range_grid has {columns} columns and {rows} rows; both must be positive")
    vertices = np.asarray(mesh.vertices, np.float64)
    index = _grid_indices(grid["data"], rows * columns)
    if index.max(initial=-1) >= len(vertices) or index.min(initial=-1) < -1:
        raise InputError(f"its range_grid names vertices {index.min()} to {index.max()}, but there are only {len(vertices)}")
    colors = vertex_colors(mesh, len(vertices))
    points = np.full((rows * columns, 3), np.nan)
    points[index >= 0] = vertices[index[index >= 0]]
    if view is None:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
        inside = bool(((low <= 0) & (high >= 0)).all())
        stood = middle + (0.0, 0.0, 10.0 * size) if inside or np.linalg.norm(middle) < 2 * size else np.zeros(3)
    else:
        stood = np.asarray(view, np.float64)
    color = None
    if colors is not None:
        cells = np.zeros((rows * columns, 3), np.float32)
        cells[index >= 0] = colors[index[index >= 0]]
        color = cells.reshape(rows, columns, 3)
    return surface_from_range_image(points.reshape(rows, columns, 3), view=stood, color=color)


def _ply_header(path: Path) -> dict[str, str]:
    found = {}
    with open(path, "rb") as file:
        for line in file:
            if line.startswith(b"end_header"):
                break
            words = line.decode("latin-1").split()
            if len(words) == 3 and words[0] == "obj_info":
                found[words[1]] = words[2]
    return found


def _grid_indices(data: Any, cells: int) -> Array:
    lists = next(iter(data.values())) if isinstance(data, dict) else data
    index = np.full(cells, -1, np.int64)
    if len(lists) != cells:
        raise InputError(f"its range_grid has {len(lists)} cells, but its header declares {cells}")
    for cell, entry in enumerate(lists):
        values = np.asarray(entry).reshape(-1)
        if len(values):
            index[cell] = int(values[-1])
    return index


def _model_from(comments: list[str], foot: Array, normals: Array, faces: Array) -> Base | None:
    kinds: dict[str, Callable[..., Base]] = {"plane": Plane, "cylinder": Cylinder, "sphere": Sphere}
    for comment in comments:
        if comment.startswith("model "):
            record = dict(json.loads(comment[len("model ") :]))
            if record["kind"] == "smooth":
                return SmoothBase(vertices=foot, faces=faces, normals=normals, relief_scale=float(record["relief_scale"]))
            return kinds[record.pop("kind")](**record)
    return None


_readers: dict[str, Callable[[Path, Sequence[float] | None], Surface]] = {
    ".ply": _read_ply,
    ".stl": _read_stl,
    ".obj": _read_with_trimesh,
    ".off": _read_with_trimesh,
    ".gltf": _read_with_trimesh,
    ".glb": _read_with_trimesh,
}
