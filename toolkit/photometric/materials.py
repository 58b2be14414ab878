"""What other programs take: normal map, albedo and height as images, and a glTF material on a plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.errors import FileError
from intaglio.files import check_folder, check_writable, whole_file, whole_folder, write_exr, write_image
from intaglio.kernels.transfer import encode_srgb
from intaglio.photometric.heights import height_from_gradients
from intaglio.photometric.normals import SurfaceMaps, surface_maps
from intaglio.photometric.relightable import Relightable

MAP_NAMES = ("normal.png", "albedo.png", "height.png", "maps.exr")


def height_of(texture: Relightable, maps: SurfaceMaps | None = None, *, method: str = "cosine") -> Array:
    """Return a texture's height map (H, W) in pixels: its own, for kind ``"height"``, else integrated from its normals."""
    if texture.height is not None:
        return texture.height
    maps = maps or surface_maps(texture)
    return height_from_gradients(*maps.gradients(), method=method).astype(np.float32)


def write_maps(texture: Relightable, folder: PathLike) -> list[Path]:
    """Write the maps of a matte material into ``folder``, made if it does not exist.

    ``normal.png`` (16 bits, (n + 1) / 2; x right, y up: OpenGL's convention), ``albedo.png`` (8 bits, sRGB), ``height.png`` (16
    bits, its range stretched to [0, 1]) for viewing, and ``maps.exr`` with the same as they are: channels ``normal.X``,
    ``normal.Y``, ``normal.Z``, ``albedo.R``…, ``height.Y`` in pixels and, of robust fits, ``confidence.Y``.

    Returns
    -------
    list of Path
    """
    folder = check_folder(folder)
    maps = surface_maps(texture)
    height = height_of(texture, maps).astype(np.float64)
    albedo = np.repeat(maps.albedo, 3, axis=2) if maps.albedo.shape[2] == 1 else maps.albedo
    spread = float(np.ptp(height)) or 1.0
    channels = {f"normal.{c}": maps.normal[:, :, i] for i, c in enumerate("XYZ")}
    channels |= {f"albedo.{c}": albedo[:, :, i] for i, c in enumerate("RGB")} | {"height.Y": height}
    if texture.confidence is not None:
        channels["confidence.Y"] = texture.confidence
    with whole_folder(folder) as beside:
        paths = [beside / name for name in MAP_NAMES]
        write_image(maps.normal * 0.5 + 0.5, paths[0], bits=16)
        write_image(albedo, paths[1])
        write_image((height - height.min()) / spread, paths[2], bits=16)
        write_exr(channels, paths[3])
    return [folder / name for name in MAP_NAMES]


def write_gltf(texture: Relightable, path: PathLike) -> None:
    """Write a matte glTF material, with albedo and normal map, on a plane that faces +z; one unit is the longer side (.glb)."""
    import trimesh
    from PIL import Image

    path = Path(path)
    if path.suffix.lower() != ".glb":
        raise FileError(f"{path}: glTF is written as one binary file, .glb")
    check_writable(path)
    maps = surface_maps(texture)
    height, width = maps.normal.shape[:2]
    side = np.array([width, height]) / max(width, height) / 2
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * np.append(side, 0)
    color = np.round(255 * encode_srgb(maps.albedo)).astype(np.uint8)
    color = np.repeat(color, 3, axis=2) if color.shape[2] == 1 else color
    material = trimesh.visual.material.PBRMaterial(
        name="relightable",
        baseColorTexture=Image.fromarray(color),
        normalTexture=Image.fromarray(np.round(255 * (maps.normal * 0.5 + 0.5)).astype(np.uint8)),
        metallicFactor=0.0,
        roughnessFactor=1.0,
    )
    visual = trimesh.visual.TextureVisuals(uv=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float), material=material)
    plane = trimesh.Trimesh(
        corners,
        [[0, 1, 2], [0, 2, 3]],
        vertex_normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
        visual=visual,
        process=False,
    )
    content = trimesh.Scene(plane).export(file_type="glb", include_normals=True)
    with whole_file(path) as beside:
        beside.write_bytes(content)
