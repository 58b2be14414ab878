"""Writing surfaces: PLY with provenance, and the formats that trimesh writes."""

from __future__ import annotations

import io
import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments
from intaglio.errors import FileError, InputError, IntaglioError, IntaglioWarning
from intaglio.files import check_writable, whole_file, write_samples
from intaglio.kernels.transfer import encode_srgb
from intaglio.mesh.textured_writing import (
    files_of_filling,
    material_file,
    material_text,
    measured_mask,
    picture_files,
    ply_faces,
    textured_gltf,
    textured_obj,
)
from intaglio.mesh.topology import unique_edges, used_vertices

if TYPE_CHECKING:
    from intaglio.mesh.base import Base
    from intaglio.mesh.surface import Surface

WRITABLE = (".ply", ".obj", ".stl", ".off", ".gltf", ".glb")
# These hold texture coordinates and pictures.
_TEXTURED = (".ply", ".obj", ".gltf", ".glb")
# These hold 32-bit floats: a unit in the last place may not exceed this share of the typical edge.
_SINGLE = (".stl", ".gltf", ".glb")
_COARSE = 1e-3
# So many rows of a table are written at once.
_AT_ONCE = 1 << 16
_NO_FACES = "a surface without faces can be written as .ply only"


@checked_arguments
def write_surface(surface: Surface, path: PathLike, *, overwrite: bool = True) -> None:
    """Write a surface to a file.

    PLY (binary, double precision) keeps everything: per vertex ``base_x`` … ``base_z``, ``nx`` … ``nz`` (the base's normal),
    ``measured``, ``source``, ``rotation``, ``error``, ``confidence``, ``mirrored`` and ``red``, ``green``, ``blue`` (8-bit sRGB,
    for other programs) with ``linear_red`` … (float, what is read back); per face ``measured``; the model and the notes as
    comments. The other types keep positions, faces and, except STL, colours: OBJ and OFF with all digits, STL and glTF in single
    precision.
    Texture coordinates and their pictures are kept by PLY and OBJ, with the pictures beside the file, and by glTF inside it.

    If some of a textured surface's faces were filled, a mask of each picture lies beside OBJ and glTF, ``*_measured.png``: white
    where measured faces lie.

    Parameters
    ----------
    surface : Surface
        What to write.
    path : path
        The file; its suffix decides the type: .ply, .obj, .stl, .off, .gltf, .glb. It appears whole, or stays as it was.
    overwrite : bool, optional
        Replace a file of that name. Default True.

    Raises
    ------
    FileError
        If the suffix is unknown, the file exists and may not be replaced, or can't be written.
    InputError
        If coordinates are too large for the type's single precision, or the type needs faces and there are none.

    Warns
    -----
    IntaglioWarning
        If the single precision of STL or glTF would round coordinates visibly: to steps of more than a thousandth of the
        median edge; if STL or OFF drop texture coordinates.

    Examples
    --------
    A PLY comes back bit for bit, with its base:

    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> surface = intaglio.Surface(vertices=corners + [0, 0, 0.1], faces=np.array([[0, 1, 2]]), base=corners)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     intaglio.write_surface(surface, f"{folder}/relief.ply")
    ...     back = intaglio.read_surface(f"{folder}/relief.ply")
    >>> back.relief
    array([0.1, 0.1, 0.1])
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in WRITABLE:
        raise FileError(f"{path}: unknown mesh type {kind!r}; known: {', '.join(sorted(WRITABLE))}")
    if path.exists() and not overwrite:
        raise FileError(f"{path}: exists already; give another name or allow overwriting")
    if kind in _SINGLE:
        check_single_precision(surface, path)
    textured = surface.uv is not None and bool(np.isfinite(surface.uv).all(axis=(1, 2)).any())
    pictures = picture_files(path, surface) if textured and kind in _TEXTURED else []
    masked = kind != ".ply"
    if textured and kind in (".stl", ".off"):
        warnings.warn(f"{path}: {kind} holds no texture coordinates and no picture; write .ply, .obj or .glb", IntaglioWarning, 2)
    for file in files_beside(surface, path):
        check_writable(file)
    for number, picture in enumerate(pictures):
        if kind in (".ply", ".obj"):
            with whole_file(picture.path) as beside:
                beside.write_bytes(picture.content)
        if masked and picture.mask is not None:
            _write_mask(surface, number, picture.mask)
    if kind == ".obj" and pictures:
        with whole_file(material_file(path)) as beside:
            beside.write_text(material_text(pictures), "utf-8")
    with whole_file(path) as beside:
        if kind == ".ply":
            _write_ply(surface, beside, [picture.path.name for picture in pictures])
        elif textured and kind == ".obj":
            beside.write_text(textured_obj(surface, [p.material for p in pictures], material_file(path).name), "utf-8")
        elif textured and kind in (".glb", ".gltf"):
            beside.write_bytes(textured_gltf(surface, kind))
        elif kind == ".off" and surface.color is not None:
            beside.write_text(_colored_off(surface, path), "utf-8")
        else:
            _write_trimesh(surface, beside, kind)


def files_beside(surface: Surface, path: Path, *, to_be_filled: bool = False) -> list[Path]:
    """Return the files that `write_surface` writes beside ``path``: pictures, an OBJ's materials, and masks.

    ``to_be_filled`` adds those that the filling of a textured scan will bring.
    """
    kind = path.suffix.lower()
    if not surface.pictures or surface.uv is None or kind not in _TEXTURED:
        return []
    pictures = picture_files(path, surface)
    files = [picture.path for picture in pictures] if kind in (".ply", ".obj") else []
    files += [material_file(path)] if kind == ".obj" else []
    files += [picture.mask for picture in pictures if picture.mask is not None and kind != ".ply"]
    if to_be_filled:
        added = files_of_filling(path, pictures)
        wanted = {".ply": added[:1], ".obj": added}.get(kind, added[1:])
        files += [file for file in wanted if file not in files]
    return files


def _write_mask(surface: Surface, number: int, path: Path) -> None:
    """Write the mask of what was measured of a picture; warn if the picture can't be read."""
    try:
        mask = measured_mask(surface, number)
    except IntaglioError as error:
        warnings.warn(f"{path}: not written, since {error}", IntaglioWarning, 3)
        return
    write_samples(np.where(mask, 255, 0).astype(np.uint8), path)


def check_single_precision(surface: Surface, path: Path) -> None:
    """Raise `InputError` for coordinates too large for 32-bit floats, and warn where these would round them visibly."""
    largest = float(np.abs(surface.vertices).max(initial=0))
    if largest > float(np.finfo(np.float32).max):
        raise InputError(f"{path}: coordinates up to {largest:.3g} don't fit {path.suffix}'s single precision; write .ply")
    edges = unique_edges(surface.faces)
    if len(edges) == 0:
        return
    typical = float(np.median(np.linalg.norm(surface.vertices[edges[:, 0]] - surface.vertices[edges[:, 1]], axis=1)))
    step = float(np.spacing(np.float32(largest)))
    if step > _COARSE * typical:
        warnings.warn(
            f"{path}: {path.suffix} holds single precision, coordinates near {largest:.3g} are rounded to {step:.2g} "
            f"(typical edge {typical:.3g}); write .ply to keep them",
            IntaglioWarning,
            stacklevel=4,
        )


def _write_ply(surface: Surface, path: Path, pictures: list[str]) -> None:
    names = ["x", "y", "z", "nx", "ny", "nz", "base_x", "base_y", "base_z"]
    triples = (surface.vertices, surface.normal, surface.base)
    fields: list[tuple[str, str, Array]] = [(n, "double", triples[i // 3][:, i % 3]) for i, n in enumerate(names)]
    fields.append(("measured", "uchar", surface.measured.astype(np.uint8)))
    fields.append(("source", "int", surface.source))
    if surface.file_vertex is not None:
        fields.append(("file_vertex", "int", surface.file_vertex))
    for name in ("rotation", "error", "confidence"):
        value = getattr(surface, name)
        if value is not None:
            fields.append((name, "float", value))
    for name in ("exemplar", "exemplar_source"):
        value = getattr(surface, name)
        if value is not None:
            fields.append((name, "int", value))
    if surface.mirrored is not None:
        fields.append(("mirrored", "uchar", surface.mirrored.astype(np.uint8)))
    if surface.color is not None:
        fields += color_fields(surface.color)
    count = len(surface.vertices)
    properties = ply_table([(name, kind, value[:0]) for name, kind, value in fields], 0)[1]
    header = ["ply", "format binary_little_endian 1.0", "comment intaglio surface"]
    if surface.model is not None:
        header.append(f"comment model {json.dumps(_model_record(surface.model))}")
    header += [f"comment note {json.dumps(note)}" for note in surface.notes]
    header += [f"comment TextureFile {name}" for name in pictures]
    header.append(f"element vertex {count}")
    header += properties
    faces, declared = ply_faces(surface)
    header += [f"element face {len(surface.faces)}", *declared, "end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(header).encode("utf-8"))
        for at in range(0, count, _AT_ONCE):
            some = slice(at, min(at + _AT_ONCE, count))
            file.write(ply_table([(name, kind, value[some]) for name, kind, value in fields], some.stop - at)[0].tobytes())
        file.write(faces)


def color_fields(color: Array) -> list[tuple[str, str, Array]]:
    """Return the PLY properties of linear colours (N, 3): 8-bit sRGB for other programs, and the floats that are read back."""
    shown = np.round(encode_srgb(color) * 255).astype(np.uint8)
    names = ("red", "green", "blue")
    fields: list[tuple[str, str, Array]] = [(name, "uchar", shown[:, i]) for i, name in enumerate(names)]
    return fields + [(f"linear_{name}", "float", color[:, i]) for i, name in enumerate(names)]


def ply_table(fields: list[tuple[str, str, Array]], count: int) -> tuple[Array, list[str]]:
    """Return the binary table of a PLY element and the header's lines that declare its properties (name, type, values)."""
    types = {"double": "<f8", "float": "<f4", "uchar": "u1", "int": "<i4"}
    table = np.empty(count, [(name, types[kind]) for name, kind, _ in fields])
    for name, _, value in fields:
        table[name] = value
    return table, [f"property {kind} {name}" for name, kind, _ in fields]


def _model_record(model: Base) -> dict[str, object]:
    record: dict[str, object] = {"kind": model.kind, "inward": model.inward}
    for name in ("point", "normal", "direction", "axis", "center", "radius", "relief_scale"):
        value = getattr(model, name, None)
        if value is not None:
            record[name] = value.tolist() if isinstance(value, np.ndarray) else float(value)
    return record


def _colored_off(surface: Surface, path: Path) -> str:
    """Return an OFF file with colours, which trimesh leaves out."""
    if len(surface.faces) == 0:
        raise InputError(f"{path}: {_NO_FACES}")
    assert surface.color is not None
    levels = np.full((len(surface.vertices), 4), 255)
    levels[:, :3] = np.round(encode_srgb(surface.color) * 255)
    buffer = io.StringIO()
    buffer.write(f"COFF\n{len(surface.vertices)} {len(surface.faces)} 0\n")
    np.savetxt(buffer, np.concatenate([surface.vertices, levels], axis=1), fmt="%.17g %.17g %.17g %d %d %d %d")
    np.savetxt(buffer, surface.faces, fmt="3 %d %d %d")
    return buffer.getvalue()


def _write_trimesh(surface: Surface, path: Path, kind: str) -> None:
    import trimesh

    used = used_vertices(surface.faces, len(surface.vertices))
    if not used.any():
        raise InputError(f"{path}: {_NO_FACES}")
    colors = None if surface.color is None else np.round(encode_srgb(surface.color) * 255).astype(np.uint8)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces, vertex_colors=colors, process=False)
    options = {"digits": 17} if kind in (".obj", ".off") else {}
    data = (
        mesh.export(file_type=kind[1:], **options)
        if kind != ".gltf"
        else trimesh.exchange.gltf.export_gltf(trimesh.Scene(mesh), embed_buffers=True)["model.gltf"]
    )
    path.write_bytes(data.encode() if isinstance(data, str) else data)
