"""glTF and GLB through trimesh, checked beforehand for what it would take without a word or without end."""

from __future__ import annotations

import base64
import io
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError
from intaglio.files import check_memory, check_readable, hushed
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh.raw_mesh import RawMesh

_COMPONENTS = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
# Types of what is read; indices have no name.
_TYPES = {"": "SCALAR", "POSITION": "VEC3", "NORMAL": "VEC3", "TEXCOORD": "VEC2"}
# Extensions without which the geometry can't be read.
_PACKED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")


def read_gltf(path: Path) -> RawMesh:
    """Read all meshes of a glTF or GLB file's scene, placed as its nodes say, as one.

    Raises
    ------
    FileError
        If it is damaged, or needs a file or an extension that is not there.
    InputError
        If it holds no mesh.
    """
    import trimesh

    document, buffers = _document(path)
    for name in _PACKED:
        if name in (document.get("extensionsRequired") or ()):
            raise FileError(f"{path}: its geometry is compressed by {name}; save it without, or as PLY")
    try:
        _check(document, buffers)
    except (KeyError, IndexError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise FileError(f"{path}: is damaged ({_said(error)})") from error
    pictures, numbers = _pictures(document, buffers, path.parent)
    try:
        source: Path | io.BytesIO = path
        if len(pictures) > 1 or any("uri" in entry for name in ("buffers", "images") for entry in document.get(name) or ()):
            # Names of files are resolved here: trimesh knows no escaped ones. Materials are told apart by names given here.
            source = io.BytesIO(_self_contained(document, buffers, path))
        with open(path, "rb") as file:
            kind = "glb" if source == path and file.read(4) == b"glTF" else "gltf"
        with hushed():
            loaded = trimesh.load(source, file_type=kind, process=False, maintain_order=True, force="scene")
            parts = [part for part in loaded.dump() if isinstance(part, trimesh.Trimesh)]
            clouds = [part for part in loaded.dump() if isinstance(part, trimesh.PointCloud)]
    except MemoryError as error:
        raise InputError("there is not enough memory to read it") from error
    except Exception as error:
        raise FileError(f"{path}: can't be read as glTF ({type(error).__name__}: {_said(error)})") from error
    if not parts and not clouds:
        raise InputError("holds no mesh")
    for part in parts:
        if len(part.faces) and not 0 <= part.faces.min() <= part.faces.max() < len(part.vertices):
            raise InputError(f"a face names vertex {part.faces.max()}, but its mesh has only {len(part.vertices)}")
    return _joined(parts or clouds, pictures, numbers)


def _self_contained(document: dict[str, Any], buffers: list[bytes], path: Path) -> bytes:
    """Return the JSON of a file with all that lies beside it, as far as it is there, inside."""

    def inside(data: bytes) -> str:
        return "data:application/octet-stream;base64," + base64.b64encode(data).decode()

    whole = dict(document)
    whole["buffers"] = [{**entry, "uri": inside(data)} for entry, data in zip(document["buffers"], buffers, strict=True)]
    images = []
    for entry in document.get("images") or ():
        try:
            images.append({**entry, "uri": inside(_at_uri(entry["uri"], path))} if "uri" in entry else entry)
        except FileError:
            images.append(entry)
    if images:
        whole["images"] = images
    if document.get("materials"):
        whole["materials"] = [{**entry, "name": str(k)} for k, entry in enumerate(document["materials"])]
    return json.dumps(whole).encode()


def _said(error: Exception) -> str:
    """Return an error's first line, shortened."""
    lines = str(error).splitlines() or [""]
    return lines[0][:120]


def _document(path: Path) -> tuple[dict[str, Any], list[bytes]]:
    """Return the JSON of a file, and its buffers."""
    content = check_readable(path).read_bytes()
    chunk = b""
    if content[:4] == b"glTF":
        if len(content) < 20:
            raise FileError(f"{path}: is cut off after {len(content)} bytes")
        (length,) = struct.unpack("<I", content[8:12])
        size, kind = struct.unpack("<I4s", content[12:20])
        if length > len(content) or size > len(content) - 20 or kind != b"JSON":
            raise FileError(f"{path}: its header declares {length} bytes, it holds {len(content)}: the file is cut off")
        text, rest = content[20 : 20 + size], content[20 + size :]
        if len(rest) >= 8:
            (wanted,) = struct.unpack("<I", rest[:4])
            if wanted > len(rest) - 8:
                raise FileError(f"{path}: its binary part declares {wanted} bytes, it holds {len(rest) - 8}: the file is cut off")
            chunk = rest[8 : 8 + wanted]
    else:
        text = content
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path}: is no glTF: its JSON can't be read ({_said(error)})") from error
    if not isinstance(document, dict) or not isinstance(document.get("asset"), dict):
        raise FileError(f"{path}: is no glTF: its JSON has no asset")
    try:
        buffers = [_buffer(entry, chunk, path) for entry in document.get("buffers") or ()]
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise FileError(f"{path}: a buffer is damaged ({_said(error)})") from error
    return document, buffers


def _buffer(entry: dict[str, Any], chunk: bytes, path: Path) -> bytes:
    """Return what a buffer holds."""
    data = chunk if entry.get("uri") is None else _at_uri(entry["uri"], path)
    if len(data) < int(entry["byteLength"]):
        raise FileError(f"{path}: a buffer declares {entry['byteLength']} bytes, it holds {len(data)}: the file is cut off")
    return data


def _at_uri(uri: str, path: Path) -> bytes:
    """Return what lies in a file beside ``path`` or in the address itself."""
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.split(",", 1)[1])
        except (IndexError, ValueError) as error:
            raise FileError(f"{path}: a data address is damaged ({_said(error)})") from error
    return check_readable(path.parent / unquote(uri)).read_bytes()


def _check(document: dict[str, Any], buffers: list[bytes]) -> None:
    """Raise `IndexError` or `ValueError` for numbers that point at nothing: negative ones would be counted from the end."""

    def at(name: str, number: Any) -> Any:
        entries = document.get(name) or []
        if isinstance(number, bool) or not isinstance(number, int) or not 0 <= number < len(entries):
            raise IndexError(f"{name} has {len(entries)} entries, no number {str(number)[:20]}")
        return entries[number]

    for view in document.get("bufferViews") or ():
        at("buffers", view["buffer"])
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        if start < 0 or length < 0 or start + length > len(buffers[view["buffer"]]):
            raise ValueError("a bufferView reaches beyond its buffer")
    for accessor in document.get("accessors") or ():
        count = int(accessor["count"])
        width = _COMPONENTS[accessor["componentType"]] * _SIZES[accessor["type"]]
        if count < 0:
            raise ValueError("an accessor has a negative count")
        if accessor.get("bufferView") is None:
            check_memory("an accessor without data", count * width, "its zeros")
            continue
        view = at("bufferViews", accessor["bufferView"])
        start, stride = int(accessor.get("byteOffset", 0)), int(view.get("byteStride") or width)
        if start < 0 or stride < 0 or (count and start + (count - 1) * stride + width > view["byteLength"]):
            raise ValueError(f"an accessor's {count} entries reach beyond its bufferView")
    for mesh in document.get("meshes") or ():
        for primitive in mesh["primitives"]:
            for name, number in (
                *primitive["attributes"].items(),
                *([("", primitive["indices"])] if "indices" in primitive else []),
            ):
                kind = at("accessors", number)["type"]
                if kind != _TYPES.get(name.split("_")[0], kind):
                    raise ValueError(f"{name or 'indices'} are of type {kind}")
            if "material" in primitive:
                at("materials", primitive["material"])
    for node in document.get("nodes") or ():
        for child in node.get("children") or ():
            at("nodes", child)
        if "mesh" in node:
            at("meshes", node["mesh"])
    for scene in document.get("scenes") or ():
        for number in scene.get("nodes") or ():
            at("nodes", number)
    if "scene" in document:
        at("scenes", document["scene"])
    _check_tree(document)


def _check_tree(document: dict[str, Any]) -> None:
    """Raise `ValueError` if a node is its own descendant."""
    nodes = document.get("nodes") or []
    parents = [0] * len(nodes)
    for node in nodes:
        for child in node.get("children") or ():
            parents[child] += 1
    roots = [k for k, n in enumerate(parents) if n == 0]
    seen = 0
    while roots:
        seen += 1
        for child in nodes[roots.pop()].get("children") or ():
            parents[child] -= 1
            if parents[child] == 0:
                roots.append(child)
    if seen < len(nodes):
        raise ValueError("its nodes go round in circles")


def _pictures(document: dict[str, Any], buffers: list[bytes], folder: Path) -> tuple[list[bytes], dict[str, int]]:
    """Return the image files of the materials' base colours, each once, and which one the material of a number has."""
    found: list[bytes] = []
    numbers: dict[str, int] = {}
    materials = document.get("materials")
    for number, material in enumerate(materials if isinstance(materials, list) else ()):
        try:
            texture = material["pbrMetallicRoughness"]["baseColorTexture"]["index"]
            image = document["images"][document["textures"][texture]["source"]]
            if "bufferView" in image:
                view = document["bufferViews"][image["bufferView"]]
                start = int(view.get("byteOffset", 0))
                content = buffers[view["buffer"]][start : start + int(view["byteLength"])]
            else:
                content = _at_uri(image["uri"], folder / "mesh.gltf")
        except (KeyError, IndexError, TypeError, ValueError, OverflowError, OSError):
            continue
        if content not in found:
            found.append(content)
        numbers[str(number)] = found.index(content)
    return found, numbers


def _joined(parts: list[Any], pictures: list[bytes], numbers: dict[str, int]) -> RawMesh:
    """Return the parts of a scene as one mesh; with several pictures a part's is that of its material, named by a number."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [
        np.asarray(getattr(part, "faces", np.zeros((0, 3), int)), np.int64) + start
        for part, start in zip(parts, starts, strict=False)
    ]
    uv, notes = [], []
    for part, own in zip(parts, faces, strict=True):
        coordinates = getattr(part.visual, "uv", None)
        if coordinates is None or len(coordinates) != len(part.vertices):
            uv.append(np.full((len(own), 3, 2), np.nan))
        else:
            uv.append(np.asarray(coordinates, np.float64)[np.asarray(part.faces)])
    textured = any(np.isfinite(own).any() for own in uv)
    colors = [_own_color(part) for part in parts]
    color = None
    if any(own is not None for own in colors):
        color = np.concatenate(
            [
                np.full((len(part.vertices), 3), np.nan, np.float32) if own is None else own
                for part, own in zip(parts, colors, strict=True)
            ]
        )
    if textured and not pictures:
        notes.append("the mesh has texture coordinates but no picture; it is read without its colours")
    shown = None
    if textured and len(pictures) > 1:
        of_part = [numbers.get(str(getattr(getattr(part.visual, "material", None), "name", "")), -1) for part in parts]
        shown = np.repeat(of_part, [len(own) for own in faces])
    return RawMesh(
        vertices=np.concatenate([np.asarray(part.vertices, np.float64) for part in parts]),
        faces=np.concatenate(faces),
        color=color,
        uv=np.concatenate(uv) if textured else None,
        pictures=tuple(pictures),
        picture=shown,
        notes=tuple(notes),
    )


def _own_color(part: Any) -> Array | None:
    """Return the colours of a part's vertices, linear, if it has such."""
    colors = None
    if getattr(part.visual, "kind", None) in ("vertex", "face"):
        colors = np.asarray(part.visual.vertex_colors)
    elif getattr(part, "colors", None) is not None and len(part.colors) == len(part.vertices):
        colors = np.asarray(part.colors)
    if colors is None or colors.ndim != 2 or len(colors) != len(part.vertices):
        return None
    return decode_srgb(colors[:, :3].astype(np.float32) / 255.0)
