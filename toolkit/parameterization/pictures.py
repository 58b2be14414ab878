"""Showing a parameterization: a checkerboard on the surface, the triangles in the texture, and figures."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from intaglio.arrays import Array
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh import Surface
from intaglio.parameterization.charts import doubled_areas, doubled_texture_areas
from intaglio.parameterization.result import Parameterization


def checkerboard(size: int = 1024, squares: int = 32) -> Array:
    """Return a checkerboard (size, size, 3), linear, whose hue runs with u and v, so that places can be told apart."""
    place = (np.arange(size) + 0.5) / size
    light = ((place[:, None] * squares).astype(int) + (place[None, :] * squares).astype(int)) % 2
    hue = np.stack(np.broadcast_arrays(place[None, :], 1 - place[:, None], np.full((1, 1), 0.5)), axis=2)
    return np.asarray(decode_srgb(np.where(light[:, :, None], 0.75 + 0.25 * hue, 0.15 + 0.4 * hue)))


def layout_picture(uv: Parameterization, size: int = 768) -> Array:
    """Return a picture of the chart or charts (size, size, 3), linear: triangles coloured by stretch, from blue, 1, to red, 2."""
    from intaglio.kernels.texels import rasterize

    face, _ = rasterize(uv.uv, uv.faces, size, size, "cpu")
    amount = np.clip(uv.face_stretch[face] - 1, 0, 1)[:, :, None]
    low, middle, high = (np.array(c) for c in ((0.25, 0.45, 0.8), (0.95, 0.9, 0.6), (0.8, 0.2, 0.15)))
    shade = np.where(amount < 0.5, low + 2 * amount * (middle - low), middle + (2 * amount - 1) * (high - middle))
    return np.asarray(decode_srgb(np.where((face >= 0)[:, :, None], shade, 1.0)))


def describe_parameterization(uv: Parameterization, surface: Surface, view: ArrayLike | None = None) -> list[str]:
    """Return what a parameterization is like, line by line: charts, flips, stretch, shape of triangles, and the notes."""
    ratio = uv.shape_ratio
    lines = [
        f"{uv.charts} chart{'s' if uv.charts > 1 else ''}, {uv.flips} flipped triangles",
        f"L2 stretch {uv.l2_stretch:.4f}, largest stretch {uv.linf_stretch:.3g} (1 is the optimum)",
        f"height over longest side of triangles: median {np.median(ratio):.3f}, least {ratio.min():.3g}",
        f"texture used: {50 * np.abs(doubled_texture_areas(uv.uv, uv.faces)).sum():.1f} %",
    ]
    if view is not None:
        for name, seen, used in area_by_view(uv, surface, view):
            lines.append(f"{name}: {100 * seen:.1f} % of the surface, {100 * used:.1f} % of the texture")
    return [*lines, *uv.notes]


def area_by_view(uv: Parameterization, surface: Surface, view: ArrayLike) -> list[tuple[str, float, float]]:
    """Return, for what faces a view, is seen from the side and faces away, the shares of the surface and of the texture."""
    towards = np.asarray(view, np.float64)
    towards = towards / np.linalg.norm(towards)
    corner = surface.vertices[surface.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    facing = (normal @ towards) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    own, texture = doubled_areas(surface.vertices, surface.faces), np.abs(doubled_texture_areas(uv.uv, uv.faces))
    parts = (("facing the view", facing > 0.5), ("seen from the side", np.abs(facing) <= 0.5), ("facing away", facing < -0.5))
    return [(name, float(own[m].sum() / own.sum()), float(texture[m].sum() / texture.sum())) for name, m in parts]
