"""Relightable textures on meshes, rendered."""

from __future__ import annotations

from typing import Any

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.errors import FileError, InputError
from intaglio.mesh import read_mesh_file
from intaglio.photometric.light_positions import unit_directions
from intaglio.photometric.relightable import Relightable
from intaglio.render import frame, relightable_bsdf, relit


def bsdf_of(
    texture: Relightable,
    *,
    repeat: tuple[float, float] = (1.0, 1.0),
    tiled: bool = True,
    smooth: bool = True,
    back: bool = False,
) -> Any:
    """Return the texture as a Mitsuba BSDF; see `intaglio.render.relightable_bsdf`."""
    return relightable_bsdf(
        texture.maps, texture.basis.evaluate, chroma=texture.chroma, repeat=repeat, tiled=tiled, smooth=smooth, back=back
    )


def read_textured_mesh(path: PathLike) -> tuple[Array, Array, Array]:
    """Read vertices (N, 3), faces (F, 3) and texture coordinates (N, 2) of a mesh file.

    Raises
    ------
    FileError
        If the file is missing, damaged, or has no texture coordinates.
    """
    raw = read_mesh_file(path)
    try:
        vertex, faces, uv = raw.split_at_seams()
    except InputError as error:
        raise FileError(f"{path}: {error}") from error
    vertices = raw.vertices[vertex]
    for what, values, most in (("vertices", vertices, 1e15), ("texture coordinates", uv, 1e6)):
        if not (np.abs(values) <= most).all():
            raise FileError(f"{path}: has {what} that are not finite, or larger than {most:g}")
    corners = vertices[faces]
    if not np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).any():
        raise FileError(f"{path}: its faces have no area")
    return vertices, faces, uv


def render_on_mesh(
    texture: Relightable,
    path: PathLike,
    *,
    light: Array,
    direction: Array,
    repeat: float = 1.0,
    size: tuple[int, int] = (800, 800),
    samples: int = 32,
    seed: int = 0,
) -> Array:
    """Render a texture on a mesh under one distant light.

    Parameters
    ----------
    texture : Relightable
        From `represent` or `read_relightable`.
    path : path
        Mesh with texture coordinates.
    light, direction : (3,) arrays
        Vectors towards the light and the eye, in the mesh's coordinates.
    repeat : float
        How often the texture is repeated over the unit square of texture coordinates.
    size : (rows, columns)
        Size of the image in pixels.
    samples : int
        Paths per pixel.
    seed : int
        Seed of the paths.

    Returns
    -------
    (H, W, 3) float32 array
        Linear values; white where nothing is seen.
    """
    vertices, faces, uv = read_textured_mesh(path)
    camera = frame(vertices, unit_directions(np.asarray(direction, np.float64)), margin=1.05)
    towards = unit_directions(np.asarray(light, np.float64))
    bsdf = bsdf_of(texture, repeat=(repeat, repeat), back=True)
    return relit(vertices, faces, uv, bsdf, camera=camera, light=towards, size=size, samples=samples, background=1.0, seed=seed)
