"""Writing a textured mesh: glTF, or OBJ with its material."""

from __future__ import annotations

import io
import os
import re
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments
from intaglio.errors import FileError, InputError
from intaglio.files import check_writable, whole_file
from intaglio.kernels.transfer import encode_srgb
from intaglio.mesh import Surface, check_single_precision
from intaglio.parameterization import Parameterization
from intaglio.photographs.texture import Texture, checked_layout, checked_texture

TEXTURED_SUFFIXES = (".glb", ".gltf", ".obj")

# Levels of the coverage picture below the photographs' numbers.
OUTSIDE, MADE_UP = 0, 1


@checked_arguments
def write_textured(surface: Surface, uv: Parameterization, texture: Texture, path: PathLike) -> list[Path]:
    """Write a surface with its texture, and a picture that says which texels come from which photograph.

    The texture is written as 8-bit sRGB. Its alpha says what was photographed (255) and what was made up (254, which no viewer
    shows differently); the material is opaque. ``NAME.coverage.png`` beside it holds a number for each texel: 0 outside, 1
    made up, 2 and higher the photographs in their order.

    Parameters
    ----------
    surface : Surface
        The surface that was textured.
    uv : Parameterization
        From `parameterize`, of this surface.
    texture : Texture
        From `combine_photographs` or `restore_texture`.
    path : path
        ``.glb`` and ``.gltf`` are one file each; ``.obj`` has ``.mtl`` and ``.png`` beside it.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    FileError
        For another suffix, or if a file can't be written.
    InputError
        If an argument is of another type, or ``uv`` does not belong to the surface.

    See Also
    --------
    intaglio.combine_photographs, intaglio.restore_texture : Make the texture.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    >>> uv = intaglio.parameterize(square, device="cpu")
    >>> grey, inside = np.full((16, 16, 3), 0.5, np.float32), np.ones((16, 16), bool)
    >>> first, all_of_it = np.zeros((16, 16, 1), np.int16), np.ones((16, 16, 1), np.float16)
    >>> texture = intaglio.Texture(grey, inside, inside.astype(np.int32), first, all_of_it, ("front",), np.ones((1, 3)))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     written = intaglio.write_textured(square, uv, texture, f"{folder}/square.glb")
    >>> [path.name for path in written]
    ['square.glb', 'square.coverage.png']
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"path must be a path, not {type(path).__name__}")
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in TEXTURED_SUFFIXES:
        raise FileError(f"{path}: a textured mesh can be written as {', '.join(TEXTURED_SUFFIXES)}, not {kind!r}")
    checked_layout(surface, uv)
    checked_texture("texture", texture)
    if kind != ".obj":
        check_single_precision(surface, path)
    written = files_of(path)
    for file in written:
        check_writable(file)
    color = np.round(encode_srgb(texture.image) * 255).astype(np.uint8)
    known = np.where(texture.known, 255, 254).astype(np.uint8)
    vertices = surface.vertices[uv.vertex]
    if kind == ".obj":
        _write_obj(vertices, uv, np.dstack([color, known]), *written[:3])
    else:
        _write_gltf(vertices, uv, np.dstack([color, known]), path)
    _write_picture(coverage_levels(texture), written[-1])
    return written


def files_of(path: PathLike) -> list[Path]:
    """Return the files that `write_textured` writes for ``path``."""
    path = Path(path)
    stem = re.sub(r"\s+", "_", path.stem)
    beside = [path.with_name(f"{stem}.mtl"), path.with_name(f"{stem}.png")] if path.suffix.lower() == ".obj" else []
    return [path, *beside, path.with_name(f"{path.stem}.coverage.png")]


def coverage_levels(texture: Texture) -> Array:
    """Return each texel's number, (H, W) uint8: 0 outside, 1 made up, 2 + the strongest photograph's (255 for all beyond)."""
    strongest = texture.photograph[:, :, 0].astype(np.int64)
    levels = np.where(texture.known & (strongest >= 0), np.minimum(strongest + 2, 255), MADE_UP)
    return np.where(texture.inside, levels, OUTSIDE).astype(np.uint8)


def _png(pixels: Array) -> Any:
    from PIL import Image

    return Image.fromarray(pixels)


def _write_picture(pixels: Array, path: Path) -> None:
    with whole_file(path) as beside:
        _png(pixels).save(beside, "PNG")


def _write_gltf(vertices: Array, uv: Parameterization, pixels: Array, path: Path) -> None:
    import trimesh

    material = trimesh.visual.material.PBRMaterial(
        name="photographed",
        baseColorTexture=_png(pixels),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        alphaMode="OPAQUE",
        doubleSided=False,
    )
    visual = trimesh.visual.TextureVisuals(uv=uv.uv, material=material)
    textured = trimesh.Trimesh(vertices, uv.faces, visual=visual, process=False)
    if path.suffix.lower() == ".glb":
        data = textured.export(file_type="glb")
    else:
        data = trimesh.exchange.gltf.export_gltf(trimesh.Scene(textured), embed_buffers=True)["model.gltf"]
    with whole_file(path) as beside:
        beside.write_bytes(data)


def _write_obj(vertices: Array, uv: Parameterization, pixels: Array, path: Path, material: Path, picture: Path) -> None:
    """Write OBJ, MTL and PNG; MTL can't hold names with spaces."""
    _write_picture(pixels, picture)
    with whole_file(material) as beside:
        beside.write_text(f"newmtl photographed\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {picture.name}\n", "utf-8")
    buffer = io.StringIO()
    buffer.write(f"mtllib {material.name}\nusemtl photographed\n")
    np.savetxt(buffer, vertices, fmt="v %.17g %.17g %.17g")
    np.savetxt(buffer, uv.uv, fmt="vt %.9g %.9g")
    corners = np.repeat(uv.faces + 1, 2, axis=1)
    np.savetxt(buffer, corners, fmt="f %d/%d %d/%d %d/%d")
    with whole_file(path) as beside:
        beside.write_text(buffer.getvalue(), "utf-8")
