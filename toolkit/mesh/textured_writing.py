"""Texture coordinates and their picture in PLY, OBJ and glTF: the picture's file stays as it is, bit for bit."""

from __future__ import annotations

import base64
import io
import json
import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from intaglio.arrays import Array
from intaglio.kernels.transfer import encode_srgb
from intaglio.mesh.raw_mesh import RawMesh, samples_of

if TYPE_CHECKING:
    from intaglio.mesh.surface import Surface

# By what they begin with.
_KINDS = ((b"\x89PNG", ".png", "image/png"), (b"\xff\xd8", ".jpg", "image/jpeg"), (b"RIFF", ".webp", "image/webp"))


@dataclass(frozen=True)
class PictureFile:
    """A picture beside a mesh file.

    Attributes
    ----------
    path : Path
        Where it lies.
    content : bytes
        The image file.
    material : str
        What its material is called.
    mask : Path or None
        Where the mask of what was measured lies; None if nothing was filled.
    """

    path: Path
    content: bytes
    material: str
    mask: Path | None


def picture_files(path: Path, surface: Surface) -> list[PictureFile]:
    """Return the pictures of a surface as they lie beside a mesh file: without white space, which materials can't name.

    The first is called as the mesh, further ones have a number, and one that only filled faces refer to is the filling's.
    """
    plain = _plain_stem(path)
    partly = surface.measured_face is not None and not surface.measured_face.all()
    files = []
    for number, content in enumerate(surface.pictures):
        own = pictured(surface) == number
        name, material = plain, "textured"
        if number and surface.measured_face is not None and own.any() and not surface.measured_face[own].any():
            name, material = f"{plain}_filling", "filling"
        elif number:
            name, material = f"{plain}_{number + 1}", f"textured_{number + 1}"
        suffix = next((suffix for begin, suffix, _ in _KINDS if content.startswith(begin)), ".tif")
        mask = path.with_name(f"{name}_measured.png") if partly else None
        files.append(PictureFile(path.with_name(name + suffix), content, material, mask))
    return files


def files_of_filling(path: Path, pictures: list[PictureFile]) -> list[Path]:
    """Return what the filling of a surface with these pictures adds beside a mesh file: its own picture, then masks of all."""
    own = path.with_name(f"{_plain_stem(path)}_filling.png")
    return [own, *(p.path.with_name(f"{p.path.stem}_measured.png") for p in pictures), own.with_name(f"{own.stem}_measured.png")]


def _plain_stem(path: Path) -> str:
    return re.sub(r"\s+", "_", path.stem)


def material_file(path: Path) -> Path:
    """Return where the materials of an OBJ file lie."""
    return path.with_name(_plain_stem(path) + ".mtl")


def material_text(files: list[PictureFile]) -> str:
    """Return materials that show pictures as they are."""
    return "\n".join(f"newmtl {f.material}\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {f.path.name}\n" for f in files)


def pictured(surface: Surface) -> Array:
    """Return the number of the picture that each face (F,) shows; -1 for a face without a place in one."""
    numbers = np.zeros(len(surface.faces), np.int32) if surface.face_picture is None else surface.face_picture
    return np.where(_has_place(surface), numbers, -1)


def measured_mask(surface: Surface, number: int) -> Array:
    """Return which texels (H, W) of a picture lie in measured faces.

    Raises
    ------
    IntaglioError
        If the picture can't be read.
    """
    # Most surfaces are written without the kernels, which take a while to load.
    from intaglio.kernels.texels import rasterize

    height, width = samples_of(surface.pictures[number]).shape[:2]
    own = pictured(surface) == number
    if surface.measured_face is not None:
        own &= surface.measured_face
    if surface.uv is None or not own.any():
        return np.zeros((height, width), bool)
    uv = surface.uv[own]
    # Pictures repeat: a face lies where its middle does.
    uv = uv - np.floor(uv.mean(axis=1, keepdims=True))
    face, _ = rasterize(uv.reshape(-1, 2), np.arange(3 * len(uv)).reshape(-1, 3), height, width, "cpu")
    return np.asarray(face >= 0)


def _has_place(surface: Surface) -> Array:
    """Return which faces (F,) have texture coordinates."""
    if surface.uv is None:
        return np.zeros(len(surface.faces), bool)
    return np.asarray(np.isfinite(surface.uv).all(axis=(1, 2)))


def ply_faces(surface: Surface) -> tuple[bytes, list[str]]:
    """Return the binary face element of a PLY, and the header's lines that declare its properties.

    These are vertices and, as far as the surface has them, texture coordinates (empty where a face has none), the picture's
    number, and whether the face was measured.
    """
    lines = ["property list uchar int vertex_indices"]
    after: list[tuple[str, str]] = []
    values: dict[str, Array] = {}
    if surface.uv is not None and surface.face_picture is not None:
        after.append(("texnumber", "<i4"))
        values["texnumber"] = pictured(surface)
    if surface.measured_face is not None:
        after.append(("measured", "u1"))
        values["measured"] = surface.measured_face
    declared = [f"property {'int' if kind == '<i4' else 'uchar'} {name}" for name, kind in after]
    kinds: list[tuple[str, str] | tuple[str, str, tuple[int]]] = [("count", "u1"), ("index", "<i4", (3,))]
    if surface.uv is None:
        rows = np.zeros(len(surface.faces), [*kinds, *after])
        _put_faces(rows, surface, values, np.ones(len(rows), bool))
        return rows.tobytes(), lines + declared
    lines.append("property list uchar float texcoord")
    bare = np.dtype([*kinds, ("uvs", "u1"), *after])
    full = np.dtype([*kinds, ("uvs", "u1"), ("uv", "<f4", (6,)), *after])
    textured = _has_place(surface)
    start = np.cumsum(np.where(textured, full.itemsize, bare.itemsize))
    out = np.zeros(int(start[-1]) if len(start) else 0, np.uint8)
    start -= np.where(textured, full.itemsize, bare.itemsize)
    for kind, which in ((bare, ~textured), (full, textured)):
        rows = np.zeros(int(which.sum()), kind)
        _put_faces(rows, surface, values, which)
        if kind is full:
            rows["uvs"], rows["uv"] = 6, surface.uv[which].reshape(-1, 6)
        out[start[which, None] + np.arange(kind.itemsize)] = rows.view(np.uint8).reshape(len(rows), kind.itemsize)
    return out.tobytes(), lines + declared


def _put_faces(rows: Array, surface: Surface, values: dict[str, Array], which: Array) -> None:
    """Put corners and single values of faces into the rows of a table."""
    rows["count"], rows["index"] = 3, surface.faces[which]
    for name, value in values.items():
        rows[name] = value[which]


def textured_obj(surface: Surface, materials: list[str], library: str) -> str:
    """Return an OBJ file with texture coordinates, and colours at the vertices if the surface has some.

    Parameters
    ----------
    surface : Surface
    materials : list of str
        Those of the surface's pictures; none if it has no pictures.
    library : str
        The file in which these are.
    """
    shown = pictured(surface)
    textured = _has_place(surface)
    assert surface.uv is not None
    places, number = np.unique(surface.uv[textured].reshape(-1, 2), axis=0, return_inverse=True)
    number = number.reshape(-1, 3) + 1
    buffer = io.StringIO()
    if materials:
        buffer.write(f"mtllib {library}\n")
    rows = surface.vertices
    if surface.color is not None:
        rows = np.concatenate([rows, encode_srgb(surface.color).astype(np.float64)], axis=1)
    np.savetxt(buffer, rows, fmt="v" + " %.17g" * 3 + " %.6g" * (rows.shape[1] - 3))
    np.savetxt(buffer, places, fmt="vt %.17g %.17g")
    # Faces keep their order: a material begins where another picture does, and ends where there are no texture coordinates.
    rows = np.flatnonzero(np.diff(np.where(textured, shown, -2), prepend=-3))
    at = np.cumsum(textured) - 1
    for first, last in zip(rows, np.append(rows[1:], len(textured)), strict=True):
        if materials:
            buffer.write(f"usemtl {materials[shown[first]] if shown[first] >= 0 else 'plain'}\n")
        if textured[first]:
            both = np.stack([surface.faces[first:last] + 1, number[at[first] : at[first] + last - first]], axis=2)
            np.savetxt(buffer, both.reshape(-1, 6), fmt="f %d/%d %d/%d %d/%d")
        else:
            np.savetxt(buffer, surface.faces[first:last] + 1, fmt="f %d %d %d")
    return buffer.getvalue()


def textured_gltf(surface: Surface, kind: str) -> bytes:
    """Return a .glb or .gltf file: the faces with texture coordinates with their pictures, the others with vertex colours."""
    textured = _has_place(surface)
    assert surface.uv is not None
    shown = pictured(surface)
    chunks: list[bytes] = []
    document: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "Intaglio"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "materials": [],
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

    primitives = []
    names = [file.material for file in picture_files(Path("mesh"), surface)]
    for number in np.unique(shown[textured]).tolist():
        own = textured & (shown == number)
        vertex, faces, uv = RawMesh(vertices=surface.vertices, faces=surface.faces[own], uv=surface.uv[own]).split_at_seams()
        flipped = np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1).astype("<f4")
        attributes = {"POSITION": positions(surface.vertices[vertex]), "TEXCOORD_0": accessor(flipped, 5126, "VEC2")}
        indices = accessor(faces.reshape(-1).astype("<u4"), 5125, "SCALAR")
        primitives.append({"attributes": attributes, "indices": indices, "material": len(document["materials"])})
        look: dict[str, Any] = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
        if 0 <= number < len(names):
            look["baseColorTexture"] = {"index": number}
        name = names[number] if 0 <= number < len(names) else "plain"
        document["materials"].append({"name": name, "pbrMetallicRoughness": look})
    if not textured.all():
        used, number = np.unique(surface.faces[~textured], return_inverse=True)
        attributes = {"POSITION": positions(surface.vertices[used])}
        if surface.color is not None:
            levels = np.full((len(used), 4), 255, np.uint8)
            levels[:, :3] = np.round(encode_srgb(surface.color[used]) * 255)
            attributes["COLOR_0"] = accessor(levels, 5121, "VEC4", normalized=True)
        primitives.append({"attributes": attributes, "indices": accessor(number.reshape(-1).astype("<u4"), 5125, "SCALAR")})
    for picture in surface.pictures:
        mime = next((mime for begin, _, mime in _KINDS if picture.startswith(begin)), "image/tiff")
        document.setdefault("images", []).append({"bufferView": view(picture), "mimeType": mime})
        document.setdefault("textures", []).append({"source": len(document["images"]) - 1})
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
