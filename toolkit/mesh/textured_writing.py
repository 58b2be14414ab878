"""Texture coordinates and their picture in PLY, OBJ and glTF: the picture's file stays as it is, bit for bit."""

from __future__ import annotations

import base64
import io
import json
import re
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from intaglio.arrays import Array
from intaglio.kernels.transfer import encode_srgb
from intaglio.mesh.raw_mesh import RawMesh

if TYPE_CHECKING:
    from intaglio.mesh.surface import Surface

# By what they begin with.
_KINDS = ((b"\x89PNG", ".png", "image/png"), (b"\xff\xd8", ".jpg", "image/jpeg"), (b"RIFF", ".webp", "image/webp"))


def picture_file(path: Path, picture: bytes) -> Path:
    """Return where the picture of a mesh file lies: beside it, without white space, which materials can't name."""
    suffix = next((suffix for begin, suffix, _ in _KINDS if picture.startswith(begin)), ".tif")
    return path.with_name(re.sub(r"\s+", "_", path.stem) + suffix)


def material_file(path: Path) -> Path:
    """Return where the materials of an OBJ file lie."""
    return path.with_name(re.sub(r"\s+", "_", path.stem) + ".mtl")


def material_text(picture: str) -> str:
    """Return a material that shows a picture as it is."""
    return f"newmtl textured\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {picture}\n"


def _has_place(surface: Surface) -> Array:
    """Return which faces (F,) have texture coordinates."""
    if surface.uv is None:
        return np.zeros(len(surface.faces), bool)
    return np.asarray(np.isfinite(surface.uv).all(axis=(1, 2)))


def ply_faces(surface: Surface) -> bytes:
    """Return the binary face element of a PLY: vertices, and texture coordinates if the surface has some; empty where none."""
    if surface.uv is None:
        faces = np.empty(len(surface.faces), [("count", "u1"), ("index", "<i4", (3,))])
        faces["count"], faces["index"] = 3, surface.faces
        return faces.tobytes()
    kinds = [("count", "u1"), ("index", "<i4", (3,)), ("uvs", "u1")]
    bare, full = np.dtype(kinds), np.dtype([*kinds, ("uv", "<f4", (6,))])
    textured = _has_place(surface)
    start = np.cumsum(np.where(textured, full.itemsize, bare.itemsize))
    out = np.zeros(int(start[-1]) if len(start) else 0, np.uint8)
    start -= np.where(textured, full.itemsize, bare.itemsize)
    for kind, which in ((bare, ~textured), (full, textured)):
        rows = np.zeros(int(which.sum()), kind)
        rows["count"], rows["index"] = 3, surface.faces[which]
        if kind is full:
            rows["uvs"], rows["uv"] = 6, surface.uv[which].reshape(-1, 6)
        out[start[which, None] + np.arange(kind.itemsize)] = rows.view(np.uint8).reshape(len(rows), kind.itemsize)
    return out.tobytes()


def textured_obj(surface: Surface, material: str | None) -> str:
    """Return an OBJ file with texture coordinates, and colours at the vertices if the surface has some."""
    textured = _has_place(surface)
    assert surface.uv is not None
    places, number = np.unique(surface.uv[textured].reshape(-1, 2), axis=0, return_inverse=True)
    number = number.reshape(-1, 3) + 1
    buffer = io.StringIO()
    if material is not None:
        buffer.write(f"mtllib {material}\n")
    rows = surface.vertices
    if surface.color is not None:
        rows = np.concatenate([rows, encode_srgb(surface.color).astype(np.float64)], axis=1)
    np.savetxt(buffer, rows, fmt="v" + " %.17g" * 3 + " %.6g" * (rows.shape[1] - 3))
    np.savetxt(buffer, places, fmt="vt %.17g %.17g")
    # Faces keep their order: a material begins where they get texture coordinates, and ends where they have none.
    rows = np.flatnonzero(np.diff(textured.astype(int), prepend=-1))
    at = np.cumsum(textured) - 1
    for first, last in zip(rows, np.append(rows[1:], len(textured)), strict=True):
        if textured[first]:
            buffer.write("usemtl textured\n" if material is not None else "")
            both = np.stack([surface.faces[first:last] + 1, number[at[first] : at[first] + last - first]], axis=2)
            np.savetxt(buffer, both.reshape(-1, 6), fmt="f %d/%d %d/%d %d/%d")
        else:
            buffer.write("usemtl plain\n" if material is not None else "")
            np.savetxt(buffer, surface.faces[first:last] + 1, fmt="f %d %d %d")
    return buffer.getvalue()


def textured_gltf(surface: Surface, kind: str) -> bytes:
    """Return a .glb or .gltf file: the faces with texture coordinates with their picture, the others with vertex colours."""
    textured = _has_place(surface)
    vertex, faces, uv = RawMesh(vertices=surface.vertices, faces=surface.faces, uv=surface.uv).split_at_seams()
    chunks: list[bytes] = []
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "Intaglio"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
        "accessors": [],
        "bufferViews": [],
    }

    def view(data: bytes) -> int:
        document["bufferViews"].append({"buffer": 0, "byteOffset": sum(map(len, chunks)), "byteLength": len(data)})
        chunks.append(data + bytes(-len(data) % 4))
        return len(document["bufferViews"]) - 1

    def accessor(values: Array, component: int, shape: str, **more: Any) -> int:
        entry = {"bufferView": view(values.tobytes()), "componentType": component, "count": len(values), "type": shape, **more}
        document["accessors"].append(entry)
        return len(document["accessors"]) - 1

    def positions(points: Array) -> int:
        single = points.astype("<f4")
        return accessor(single, 5126, "VEC3", min=single.min(axis=0).tolist(), max=single.max(axis=0).tolist())

    flipped = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1).astype("<f4")
    attributes = {"POSITION": positions(surface.vertices[vertex]), "TEXCOORD_0": accessor(flipped, 5126, "VEC2")}
    indices = accessor(faces.reshape(-1).astype("<u4"), 5125, "SCALAR")
    primitives = [{"attributes": attributes, "indices": indices, "material": 0}]
    if not textured.all():
        used, number = np.unique(surface.faces[~textured], return_inverse=True)
        attributes = {"POSITION": positions(surface.vertices[used])}
        if surface.color is not None:
            levels = np.full((len(used), 4), 255, np.uint8)
            levels[:, :3] = np.round(encode_srgb(surface.color[used]) * 255)
            attributes["COLOR_0"] = accessor(levels, 5121, "VEC4", normalized=True)
        primitives.append({"attributes": attributes, "indices": accessor(number.reshape(-1).astype("<u4"), 5125, "SCALAR")})
    if surface.picture is not None:
        mime = next((mime for begin, _, mime in _KINDS if surface.picture.startswith(begin)), "image/tiff")
        document["images"] = [{"bufferView": view(surface.picture), "mimeType": mime}]
        document["textures"] = [{"source": 0}]
        document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    document["meshes"] = [{"primitives": primitives}]
    data = b"".join(chunks)
    document["buffers"] = [{"byteLength": len(data)}]
    if kind == ".gltf":
        document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        return json.dumps(document).encode()
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + len(data)
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, length),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", len(data), b"BIN\0"),
            data,
        ]
    )
