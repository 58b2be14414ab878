"""What the scenes of textures from photographs share: photographing a textured mesh, and simpler textures to compare with."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intaglio.kernels.texels import rasterize
from intaglio.mesh import Surface
from intaglio.parameterization import Parameterization
from intaglio.photographs import Binding, Camera, Photograph, mean_vertex_colors, spread_colors
from intaglio.render import through_camera

Array = np.ndarray


def camera_towards(target: Array, direction: Array, up: Array, distance: float, *, focal: float, size: tuple[int, int]) -> Camera:
    """Return a camera at ``distance`` from ``target`` in ``direction``, that looks at it; ``focal`` in pixels."""
    back = np.asarray(direction, float) / np.linalg.norm(direction)
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    turn = np.stack([right, -np.cross(back, right), -back])
    place = target + distance * back
    height, width = size
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    return Camera(K=matrix, R=turn, t=-turn @ place, size=size)


def photographed(
    vertices: Array,
    faces: Array,
    uv: Array,
    image: Array,
    camera: Camera,
    name: str,
    *,
    lights: Sequence[tuple[Array, float]],
    ambient: float,
    exposure: Array,
    samples: int,
    seed: int,
) -> Photograph:
    """Photograph a textured mesh: matte, under distant lights and a sky, with an exposure per channel; alpha shows the object."""
    assert camera.size is not None
    picture, alpha = through_camera(
        vertices,
        faces,
        uv,
        image,
        matrix=camera.K,
        turn=camera.R,
        shift=camera.t,
        size=camera.size,
        lights=lights,
        ambient=ambient,
        samples=samples,
        seed=seed,
    )
    exposed = np.clip(picture * exposure, 0, 1)
    return Photograph(camera=camera, picture=np.dstack([exposed, alpha]).astype(np.float32), name=name)


def vertex_color_texture(surface: Surface, uv: Parameterization, binding: Binding, gains: Array, size: int) -> Array:
    """Return the texture (size, size, 3) that colours at the vertices alone would give."""
    face, weight = rasterize(uv.uv, uv.faces, size, size, "cpu")
    colors = spread_colors(*mean_vertex_colors(binding, gains), surface.faces)
    corner = surface.faces[face]
    third = 1 - weight.sum(axis=2)
    image = (
        weight[:, :, :1] * colors[corner[:, :, 0]]
        + weight[:, :, 1:] * colors[corner[:, :, 1]]
        + third[:, :, None] * colors[corner[:, :, 2]]
    )
    return np.where((face >= 0)[:, :, None], image, colors.mean(axis=0)).astype(np.float32)
