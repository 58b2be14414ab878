"""Even spreading of points over a surface: neighbours push each other apart along it."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch
from intaglio.kernels.points import PointSurface

wp.set_module_options({"enable_backward": False})


@wp.kernel
def repel_kernel(
    start: int,
    grid: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    group: wp.array(dtype=wp.int32),
    radius: float,
    strength: float,
    # output
    moved: wp.array(dtype=wp.vec3),
):
    """Push of the neighbours within ``radius``, falling to 0 there, along the tangent plane (Turk 1992, Pauly 2002)."""
    i = start + wp.tid()
    x = points[i]
    n = normals[i]
    push = wp.vec3()
    for j in wp.hash_grid_query(grid, x, radius, group[i]):
        d = x - points[j]
        r = wp.length(d)
        if r < radius and r > 0.0:
            if wp.dot(normals[j], n) > 0.0:
                push += d * ((radius - r) / r)
    push = strength * (push - n * wp.dot(push, n))
    length = wp.length(push)
    if length > 0.25 * radius:
        push = push * (0.25 * radius / length)
    moved[i] = x + push


def repelled(surface: PointSurface, radius: float, strength: float) -> np.ndarray:
    """Return the points (N, 3) float32 of ``surface``, each pushed away by its neighbours within ``radius`` on its side.

    Parameters
    ----------
    surface : PointSurface
    radius : float
        At most the surface's support.
    strength : float
        Share of the pushes' sum that is moved.
    """
    moved = wp.empty(len(surface), dtype=wp.vec3, device=surface.device)
    launch(
        repel_kernel,
        len(surface),
        [
            surface.grid, surface.points, surface.normals, surface.group, float(radius), float(strength),
        ],
        [moved],
        device=surface.device,
        work=500,
    )  # fmt: skip
    out = np.empty((len(surface), 3), np.float32)
    out[surface.order] = moved.numpy()
    return out
