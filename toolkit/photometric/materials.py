"""Files for other programs: normal map, albedo and height as images, and a glTF material on a plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments
from intaglio.errors import FileError
from intaglio.files import check_folder, check_writable, whole_file, whole_folder, write_exr, write_image
from intaglio.kernels.transfer import encode_srgb
from intaglio.photometric.heights import height_from_gradients
from intaglio.photometric.normals import SurfaceMaps, surface_maps
from intaglio.photometric.relightable import Relightable

MAP_NAMES = ("normal.png", "albedo.png", "height.png", "maps.exr")


@checked_arguments
def height_of(texture: Relightable, maps: SurfaceMaps | None = None, *, method: str = "cosine") -> Array:
    """Return the height map of a texture: its own for kind "height", else integrated from its normals.

    Parameters
    ----------
    texture : Relightable
        From `represent` or `read_relightable`.
    maps : SurfaceMaps, optional
        From `surface_maps`, if they are there already. Default None: computed here.
    method : {"cosine", "fourier"}, optional
        How to integrate; see `height_from_gradients`. Default "cosine", which does not assume that the texture repeats.

    Returns
    -------
    (H, W) float32 array
        Heights in pixels, towards the camera.

    Raises
    ------
    InputError
        If the method is unknown.

    See Also
    --------
    intaglio.height_from_gradients : The integration itself.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
    >>> normal = np.array([-0.6, 0.0, 0.8])  # rises by 0.75 pixels a pixel to the right
    >>> images = 0.5 * np.ones((4, 2, 3, 1)) * (lights @ normal)[:, None, None, None]
    >>> texture = intaglio.represent(intaglio.PhotometricStack(images, lights), "gradient", device="cpu")
    >>> intaglio.height_of(texture)[0].round(3)
    array([-0.75,  0.  ,  0.75], dtype=float32)
    """
    if texture.height is not None:
        return texture.height
    maps = maps or surface_maps(texture)
    return height_from_gradients(*maps.gradients(), method=method).astype(np.float32)


@checked_arguments
def write_maps(texture: Relightable, folder: PathLike) -> list[Path]:
    """Write normal map, albedo and height of a texture, the maps of a matte material.

    The files are ``normal.png`` (16 bits, (n + 1) / 2; x right, y up, as OpenGL has it), ``albedo.png`` (8 bits, sRGB),
    ``height.png`` (16 bits, its range stretched to [0, 1], for viewing), and ``maps.exr`` with the values as they are: channels
    ``normal.X``, ``normal.Y``, ``normal.Z``, ``albedo.R``, ``albedo.G``, ``albedo.B``, ``height.Y`` in pixels and, from robust
    fits, ``confidence.Y``.

    Parameters
    ----------
    texture : Relightable
        From `represent` or `read_relightable`.
    folder : path
        Where the files go; made if it does not exist. Files of these names are replaced, all or none.

    Returns
    -------
    list of Path
        The four files.

    Raises
    ------
    FileError
        If the folder is a file, can't be made or written to.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
    >>> images = 0.5 * np.ones((4, 8, 8, 1)) * lights[:, 2, None, None, None]
    >>> texture = intaglio.represent(intaglio.PhotometricStack(images, lights), "gradient", device="cpu")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     paths = intaglio.write_maps(texture, folder)
    ...     channels, _ = intaglio.read_exr(f"{folder}/maps.exr")
    >>> [path.name for path in paths]
    ['normal.png', 'albedo.png', 'height.png', 'maps.exr']
    >>> print(channels["albedo.R"][0, 0].round(3))
    0.5
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


@checked_arguments
def write_gltf(texture: Relightable, path: PathLike) -> None:
    """Write a matte glTF material, with albedo and normal map, on a plane.

    The plane faces +z, and its longer side has length 1. Viewers show the material under any light, as far as it is matte.

    Parameters
    ----------
    texture : Relightable
        From `represent` or `read_relightable`.
    path : path
        The .glb file. It appears whole, or stays as it was.

    Raises
    ------
    FileError
        If the suffix is not .glb, or the file can't be written.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
    >>> images = 0.5 * np.ones((4, 8, 8, 1)) * lights[:, 2, None, None, None]
    >>> texture = intaglio.represent(intaglio.PhotometricStack(images, lights), "gradient", device="cpu")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     intaglio.write_gltf(texture, f"{folder}/sample.glb")
    ...     plane = intaglio.read_surface(f"{folder}/sample.glb")
    >>> plane.vertices.max(axis=0)
    array([0.5, 0.5, 0. ])
    """
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
