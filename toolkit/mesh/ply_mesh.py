"""What a PLY holds as a mesh: polygons, triangle strips, colours, texture coordinates and the pictures they refer to."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.files import note_input
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh.obj_file import find_beside
from intaglio.mesh.ply_file import Lists, Ply, read_ply
from intaglio.mesh.polygons import polygon_triangles, strip_triangles
from intaglio.mesh.raw_mesh import RawMesh

# PLY's names for the vertices of faces, for texture coordinates at their corners, and for such at vertices.
_INDEX_NAMES = ("vertex_indices", "vertex_index")
_UV_NAMES = ("texcoord", "texcoords")
_VERTEX_UV_NAMES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
_COLOR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))


def read_raw_ply(path: Path) -> RawMesh:
    """Return a PLY file's mesh."""
    return raw_from_ply(read_ply(path), path)


def raw_from_ply(ply: Ply, path: Path) -> RawMesh:
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
        numbers = vertex_numbers(polygons.values, len(vertices), "face", least=0)
        # Where all are triangles, their corners are those of the file as they are.
        corners = None if (polygons.counts == 3).all() else polygon_triangles(polygons.counts, numbers, vertices)
        faces = _at_corners(numbers, corners)
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
        numbers = vertex_numbers(np.insert(strips.values.astype(np.int64), at, -1), len(vertices), "strip", least=-1)
        more = strip_triangles(numbers)
        uv = None if uv is None else np.concatenate([uv, np.full((len(more), 3, 2), np.nan)])
        faces = np.concatenate([faces, more])
    color = ply_colors(ply)
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
                f"the mesh has texture coordinates but no picture{f': {missing} not found' if missing else ''}"
                + ("; it is read without its colours" if color is None else "")
            )
    shown = None
    if len(named) > 1 and pictures:
        number = ply.columns("face", "texnumber")
        if number is not None and polygons is not None:
            shown = np.full(len(faces), -1)
            kept = _at_corners(np.repeat(np.arange(len(polygons.counts)), polygons.counts), corners)[:, 0]
            # Pictures that are missing have no number here.
            here = np.array([-1 if at is None else sum(p is not None for p in found[:k]) for k, at in enumerate(found)])
            own = number[kept, 0]
            known = (own >= 0) & (own < len(here))
            shown[: len(kept)] = np.where(known, here[np.where(known, own, 0).astype(int)], -1)
    return RawMesh(
        vertices=vertices,
        faces=faces,
        normals=None if normals is None else np.ascontiguousarray(normals, np.float64),
        color=color,
        uv=uv,
        pictures=tuple(pictures),
        picture=shown,
        notes=tuple(notes),
    )


def vertex_numbers(values: Array, count: int, what: str, least: int) -> Array:
    """Return vertex numbers as signed integers of at least 32 bits, or raise `InputError` for those that don't exist."""
    if values.dtype.kind == "f":
        raise InputError(f"its {what}s name vertices by fractional numbers")
    numbers = values if values.dtype == np.int32 else values.astype(np.int64)
    if numbers.size and (numbers.min() < least or numbers.max() >= count):
        bad = int(numbers[(numbers < least) | (numbers >= count)][0])
        raise InputError(f"a {what} names vertex {bad}, but there are only {count} (0 to {count - 1})")
    return numbers


def _at_corners(values: Array, corners: Array | None) -> Array:
    """Return what triangles (F, 3) have at their corners, from the corners of polygons (K, ...); None: these are the same."""
    return values.reshape(-1, 3, *values.shape[1:]) if corners is None else np.asarray(values[corners])


def _ply_coordinates(ply: Ply, polygons: Lists, corners: Array | None, faces: Array) -> Array | None:
    """Return texture coordinates (F, 3, 2) of the faces' corners, from lists at the faces or numbers at the vertices."""
    lists = ply.lists("face", *_UV_NAMES)
    if lists is not None:
        whole = lists.counts == 2 * polygons.counts
        uv = np.full((len(polygons.values), 2), np.nan)
        uv[np.repeat(whole, polygons.counts)] = lists.values[np.repeat(whole, lists.counts)].reshape(-1, 2)
        return _at_corners(uv, corners)
    for names in _VERTEX_UV_NAMES:
        at_vertices = ply.columns("vertex", *names)
        if at_vertices is not None:
            return np.asarray(at_vertices[faces], np.float64)
    return None


def ply_colors(ply: Ply) -> Array | None:
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
