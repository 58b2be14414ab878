"""Reading and writing surfaces: PLY, OBJ, STL, OFF, glTF through trimesh; provenance as PLY vertex properties."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.errors import FileError, InputError
from intaglio.files import check_readable, whole_file
from intaglio.relief.base import Base, Cylinder, Plane, Sphere
from intaglio.render.compare import decode_srgb, encode_srgb
from intaglio.surface import Surface, surface_from_points, surface_from_range_image
from intaglio.topology import directed_edges, edge_keys, used_vertices

Array = np.ndarray

_HEAD = re.compile(rb"^ply\s")


def read_surface(path: str | os.PathLike[str], *, view: Sequence[float] | None = None, repair: bool = False) -> Surface:
    """Read a surface from a file.

    A PLY written by Intaglio comes back the same: vertices bit for bit, with base, provenance and model. A PLY with a
    ``range_grid`` is triangulated in its own grid. A point cloud (no faces) needs ``view``.

    Parameters
    ----------
    path : path
        .ply, .obj, .stl, .off, .gltf or .glb.
    view : (3,) sequence, optional
        For a point cloud: the direction of sight, from the scanner to the object. For a range grid: where the scanner
        stood; default the origin, where that is outside the points, else far along +z.
    repair : bool
        Merge vertices that lie exactly on one another, drop faces that are degenerate or repeated or share an edge with
        two others already, and turn faces so that neighbours agree. What was done is put into ``notes``. Coordinates
        are not changed.

    Raises
    ------
    FileError
        If the file is missing, empty, damaged, or of no known kind.
    InputError
        If its content is no surface: no vertices, NaN, faces out of range, points without ``view``.
    """
    path = check_readable(path)
    reader = _readers.get(path.suffix.lower())
    if reader is None:
        raise FileError(f"{path}: unknown mesh type {path.suffix!r}; known: {', '.join(sorted(_readers))}")
    try:
        surface = reader(path, view)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return repaired(surface) if repair else surface


def write_surface(surface: Surface, path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
    """Write a surface.

    PLY (binary, double precision) keeps everything: per vertex ``base_x`` … ``base_z``, ``nx`` … ``nz`` (the base's normal),
    ``measured``, ``source``, ``rotation``, ``error`` and ``red``, ``green``, ``blue`` (8-bit sRGB, for other programs) with
    ``linear_red`` … (float, what is read back); the model and the notes as comments. The other types keep what they have
    room for.

    Raises
    ------
    FileError
        For an unknown type, or if the file can't be written.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in _readers:
        raise FileError(f"{path}: unknown mesh type {kind!r}; known: {', '.join(sorted(_readers))}")
    if path.exists() and not overwrite:
        raise FileError(f"{path}: exists already; give another name or allow overwriting")
    with whole_file(path) as beside:
        if kind == ".ply":
            _write_ply(surface, beside)
        else:
            _write_trimesh(surface, beside, kind)


def repaired(surface: Surface) -> Surface:
    """Return ``surface`` with joined vertices, no degenerate or surplus faces, and one winding; see `read_surface`."""
    notes = []
    vertices, faces = surface.vertices, surface.faces
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    inverse = inverse.reshape(-1)
    # The first of equal vertices stays, in its place, so that indices shift no more than they must.
    keep = np.zeros(len(vertices), bool)
    keep[first] = True
    merged = int((~keep).sum())
    faces = first[inverse][faces].astype(np.int64)
    flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    faces = faces[~flat]
    _, unique = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    repeated = len(faces) - len(unique)
    faces = faces[np.sort(unique)]
    faces, surplus = _thin_edges(faces, len(vertices))
    faces, turned = _one_winding(faces, len(vertices))
    for number, text in (
        (merged, "vertices merged with an equal one"),
        (int(flat.sum()), "degenerate faces dropped"),
        (repeated, "repeated faces dropped"),
        (surplus, "faces dropped at edges of more than two faces"),
        (turned, "faces turned to their neighbours' winding"),
    ):
        if number:
            notes.append(f"repair: {number} {text}")
    renumber = (np.cumsum(keep) - 1).astype(np.int32)
    return Surface(
        vertices=vertices[keep],
        faces=renumber[faces],
        color=None if surface.color is None else surface.color[keep],
        notes=surface.notes + tuple(notes or ["repair: nothing to do"]),
    )


def _thin_edges(faces: Array, count: int) -> tuple[Array, int]:
    """Drop later faces at undirected edges that more than two share."""
    dropped = 0
    while True:
        edges = np.sort(directed_edges(faces), axis=1)
        keys = edge_keys(edges, count)
        order = np.argsort(keys, kind="stable")
        ordered = keys[order]
        rank = np.arange(len(keys)) - np.searchsorted(ordered, ordered)
        surplus = np.unique(order[rank >= 2] // 3)
        if len(surplus) == 0:
            return faces, dropped
        # One at a time per edge would be slow; the last face of each crowded edge goes, then edges are counted again.
        faces = np.delete(faces, surplus, axis=0)
        dropped += len(surplus)


def _one_winding(faces: Array, count: int) -> tuple[Array, int]:
    """Turn faces so that neighbours run through their shared edge in opposite directions; the majority stays."""
    edges = directed_edges(faces)
    keys = edge_keys(np.sort(edges, axis=1), count)
    order = np.argsort(keys, kind="stable")
    pair = np.flatnonzero(keys[order][:-1] == keys[order][1:])
    a, b = order[pair], order[pair + 1]
    agree = edges[a, 0] == edges[b, 1]
    neighbours: list[list[tuple[int, bool]]] = [[] for _ in range(len(faces))]
    for i, j, same in zip(a // 3, b // 3, agree, strict=True):
        neighbours[i].append((int(j), bool(same)))
        neighbours[j].append((int(i), bool(same)))
    flip = np.zeros(len(faces), bool)
    seen = np.zeros(len(faces), bool)
    for start in range(len(faces)):
        if seen[start]:
            continue
        seen[start] = True
        stack, piece = [start], []
        while stack:
            face = stack.pop()
            piece.append(face)
            for other, same in neighbours[face]:
                if not seen[other]:
                    seen[other] = True
                    flip[other] = flip[face] == same if not same else flip[face]
                    stack.append(other)
        if flip[piece].sum() * 2 > len(piece):
            flip[piece] = ~flip[piece]
    out = faces.copy()
    out[flip] = out[flip][:, ::-1]
    return out, int(flip.sum())


def _read_with_trimesh(path: Path, view: Sequence[float] | None) -> Surface:
    return _from_trimesh(_load(path), path, view)


def _load(path: Path) -> Any:
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
        raise FileError(f"{path}: is no readable {path.suffix[1:].upper()} file ({type(error).__name__}: {error})") from error
    return loaded


def _from_trimesh(mesh: Any, path: Path, view: Sequence[float] | None) -> Surface:
    vertices = getattr(mesh, "vertices", None)
    if vertices is None or len(vertices) == 0:
        raise InputError("holds no vertices")
    vertices = np.array(vertices, np.float64)
    faces = np.array(getattr(mesh, "faces", np.zeros((0, 3))), np.int64)
    color = _colors(mesh, len(vertices))
    if len(faces) == 0:
        if view is None:
            raise InputError(
                "holds points but no faces; give the direction of sight (view=(x, y, z), --view x,y,z) to triangulate them"
            )
        return surface_from_points(vertices, np.asarray(view, np.float64), color=color)
    return Surface(vertices=vertices, faces=faces, color=color)


def _colors(mesh: Any, count: int) -> Array | None:
    """Vertex colours as linear floats, if the file has them; a texture is sampled at the vertices."""
    visual: Any = getattr(mesh, "visual", None)
    if getattr(visual, "kind", None) == "texture" and getattr(visual, "uv", None) is not None:
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
    """STL has no shared vertices: equal ones are joined, as the format means them to be."""
    surface = _read_with_trimesh(path, view)
    vertices, first, inverse = np.unique(surface.vertices, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return Surface(vertices=vertices[order], faces=rank[inverse.reshape(-1)][surface.faces])


def _read_ply(path: Path, view: Sequence[float] | None) -> Surface:
    comments = _ply_comments(path)
    mesh = _load(path)
    raw = mesh.metadata.get("_ply_raw", {})
    vertex = raw.get("vertex", {}).get("data")
    if "range_grid" in raw:
        return _from_range_grid(mesh, raw["range_grid"], path, view)
    names = set(_field_names(vertex))
    if not {"base_x", "measured", "source"} <= names or not any("intaglio" in c for c in comments):
        return _from_trimesh(mesh, path, view)

    def columns(*fields: str) -> Array:
        return np.stack([np.asarray(vertex[f]).reshape(-1) for f in fields], axis=1)

    optional = {n: np.asarray(vertex[n]).reshape(-1) for n in ("rotation", "error") if n in names}
    has_color = "linear_red" in names
    return Surface(
        vertices=columns("x", "y", "z"),
        faces=np.asarray(mesh.faces),
        base=columns("base_x", "base_y", "base_z"),
        normal=columns("nx", "ny", "nz"),
        color=columns("linear_red", "linear_green", "linear_blue") if has_color else None,
        measured=np.asarray(vertex["measured"]).reshape(-1).astype(bool),
        source=np.asarray(vertex["source"]).reshape(-1),
        model=_model_from(comments),
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
            raise FileError(f"{path}: its content is not PLY, whatever its name says")
        for line in file:
            if line.startswith(b"end_header"):
                return comments
            if line.startswith(b"comment "):
                comments.append(line[len(b"comment ") :].decode("utf-8", "replace").strip())
    raise FileError(f"{path}: its header has no end")


def _from_range_grid(mesh: Any, grid: dict[str, Any], path: Path, view: Sequence[float] | None) -> Surface:
    """A PLY range grid: one list per cell, empty or holding the index of the vertex seen there."""
    header = _ply_header(path)
    try:
        columns, rows = int(header["num_cols"]), int(header["num_rows"])
    except (KeyError, ValueError) as error:
        raise InputError("has a range_grid but does not say num_cols and num_rows in its header") from error
    vertices = np.asarray(mesh.vertices, np.float64)
    index = _grid_indices(grid["data"], rows * columns)
    if index.max(initial=-1) >= len(vertices):
        raise InputError(f"its range_grid names vertex {index.max()}, but there are only {len(vertices)}")
    points = np.full((rows * columns, 3), np.nan)
    points[index >= 0] = vertices[index[index >= 0]]
    if view is None:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
        inside = bool(((low <= 0) & (high >= 0)).all())
        stood = middle + (0.0, 0.0, 10.0 * size) if inside or np.linalg.norm(middle) < 2 * size else np.zeros(3)
    else:
        stood = np.asarray(view, np.float64)
    return surface_from_range_image(points.reshape(rows, columns, 3), view=stood)


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
        raise InputError(f"its range_grid has {len(lists)} cells where its header promises {cells}")
    for cell, entry in enumerate(lists):
        values = np.asarray(entry).reshape(-1)
        if len(values):
            index[cell] = int(values[-1])
    return index


def _write_ply(surface: Surface, path: Path) -> None:
    names = ["x", "y", "z", "nx", "ny", "nz", "base_x", "base_y", "base_z"]
    columns = np.concatenate([surface.vertices, surface.normal, surface.base], axis=1)
    fields: list[tuple[str, str, Array]] = [(n, "double", columns[:, i]) for i, n in enumerate(names)]
    fields.append(("measured", "uchar", surface.measured.astype(np.uint8)))
    fields.append(("source", "int", surface.source))
    for name in ("rotation", "error"):
        value = getattr(surface, name)
        if value is not None:
            fields.append((name, "float", value))
    if surface.color is not None:
        shown = np.round(encode_srgb(surface.color) * 255).astype(np.uint8)
        for i, name in enumerate(("red", "green", "blue")):
            fields.append((name, "uchar", shown[:, i]))
        for i, name in enumerate(("red", "green", "blue")):
            fields.append((f"linear_{name}", "float", surface.color[:, i]))
    types = {"double": "<f8", "float": "<f4", "uchar": "u1", "int": "<i4"}
    table = np.empty(len(surface.vertices), [(n, types[t]) for n, t, _ in fields])
    for name, _, value in fields:
        table[name] = value
    faces = np.empty(len(surface.faces), [("count", "u1"), ("index", "<i4", (3,))])
    faces["count"] = 3
    faces["index"] = surface.faces
    header = ["ply", "format binary_little_endian 1.0", "comment intaglio surface"]
    if surface.model is not None:
        header.append(f"comment model {json.dumps(_model_record(surface.model))}")
    header += [f"comment note {json.dumps(note)}" for note in surface.notes]
    header.append(f"element vertex {len(table)}")
    header += [f"property {t} {n}" for n, t, _ in fields]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(header).encode("ascii"))
        file.write(table.tobytes())
        file.write(faces.tobytes())


def _model_record(model: Base) -> dict[str, object]:
    record: dict[str, object] = {"kind": model.kind, "inward": model.inward}
    for name in ("point", "normal", "direction", "axis", "center", "radius"):
        value = getattr(model, name, None)
        if value is not None:
            record[name] = value.tolist() if isinstance(value, np.ndarray) else float(value)
    return record


def _model_from(comments: list[str]) -> Base | None:
    kinds: dict[str, Callable[..., Base]] = {"plane": Plane, "cylinder": Cylinder, "sphere": Sphere}
    for comment in comments:
        if comment.startswith("model "):
            record = json.loads(comment[len("model ") :])
            return kinds[record.pop("kind")](**record)
    return None


def _write_trimesh(surface: Surface, path: Path, kind: str) -> None:
    import trimesh

    used = used_vertices(surface.faces, len(surface.vertices))
    if not used.any():
        raise InputError(f"{path}: a surface without faces can be written as .ply only")
    colors = None if surface.color is None else np.round(encode_srgb(surface.color) * 255).astype(np.uint8)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, vertex_colors=colors, process=False)
    options = {"digits": 12} if kind == ".obj" else {"digits": 12} if kind == ".off" else {}
    data = (
        mesh.export(file_type=kind[1:], **options)
        if kind != ".gltf"
        else trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh), embed_buffers=True)["model.gltf"]
    )
    path.write_bytes(data.encode() if isinstance(data, str) else data)


_readers: dict[str, Callable[[Path, Sequence[float] | None], Surface]] = {
    ".ply": _read_ply,
    ".stl": _read_stl,
    ".obj": _read_with_trimesh,
    ".off": _read_with_trimesh,
    ".gltf": _read_with_trimesh,
    ".glb": _read_with_trimesh,
}
