"""Even spreading of points over a surface: neighbours push each other apart along it, and gaps between them are found."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch
from intaglio.kernels.point_surface import PointSurface
from intaglio.kernels.points import PointGrid

wp.set_module_options({"enable_backward": False})

_SECTORS = wp.constant(12)
vec12 = wp.types.vector(length=12, dtype=wp.float32)


@wp.kernel
def repel_kernel(
    start: int,
    surface: PointGrid,
    radius: float,
    strength: float,
    # output
    moved: wp.array[wp.vec3],
):
    """Write x + strength P Σ_j (radius - r_j) / r_j (x - p_j) over the neighbours with r_j = |x - p_j| < radius.

    P projects on the tangent plane of x (Turk 1992; Pauly et al. 2002). No point moves by more than a quarter of ``radius``.
    """
    i = start + wp.tid()
    x = surface.points[i]
    n = surface.normals[i]
    push = wp.vec3()
    for j in wp.hash_grid_query(surface.grid, x, radius, surface.group[i]):
        d = x - surface.points[j]
        r = wp.length(d)
        if r < radius and r > 0.0:
            if wp.dot(surface.normals[j], n) > 0.0:
                push += d * ((radius - r) / r)
    push = strength * (push - n * wp.dot(push, n))
    length = wp.length(push)
    if length > 0.25 * radius:
        push = push * (0.25 * radius / length)
    moved[i] = x + push


@wp.kernel
def gap_kernel(
    start: int,
    surface: PointGrid,
    narrow: float,
    wide: float,
    # output
    middle: wp.array[wp.vec3],
    width: wp.array[wp.float32],
):
    """Write the width and the middle of the widest gap about a point: the largest distance of a sector's nearest point.

    Twelve sectors of 60° overlap by half. A sector whose nearest point is nearer than ``narrow`` is no gap, and one that
    is empty up to ``wide`` is a border: the width is 0 where there are only such.
    """
    i = start + wp.tid()
    x = surface.points[i]
    n = surface.normals[i]
    u = wp.cross(n, wp.vec3(1.0, 0.0, 0.0))
    if wp.abs(n[0]) > 0.9:
        u = wp.cross(n, wp.vec3(0.0, 1.0, 0.0))
    u = wp.normalize(u)
    v = wp.cross(n, u)
    least = vec12(wide)
    for j in wp.hash_grid_query(surface.grid, x, wide, surface.group[i]):
        d = surface.points[j] - x
        r = wp.length(d)
        if r < wide and r > 0.0:
            if wp.dot(surface.normals[j], n) > 0.0:
                turn = wp.atan2(wp.dot(d, v), wp.dot(d, u)) / (2.0 * wp.pi) * 12.0 + 12.0
                s = int(turn) % _SECTORS
                # A sector spans two twelfths of the circle: a point lies in that which begins at its twelfth and that before.
                before = (s + _SECTORS - 1) % _SECTORS
                least[s] = wp.min(least[s], r)
                least[before] = wp.min(least[before], r)
    widest = float(0.0)
    at = int(0)
    for s in range(_SECTORS):
        if least[s] < wide and least[s] > widest:
            widest = least[s]
            at = s
    if widest < narrow:
        widest = 0.0
    angle = float(at + 1) * 2.0 * wp.pi / 12.0
    middle[i] = x + 0.5 * widest * (wp.cos(angle) * u + wp.sin(angle) * v)
    width[i] = widest


def repel_points(surface: PointSurface, radius: float, strength: float) -> np.ndarray:
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
        inputs=[surface.point_grid, float(radius), float(strength)],
        outputs=[moved],
        device=surface.device,
        work=500,
    )
    out = np.empty((len(surface), 3), np.float32)
    out[surface.order] = moved.numpy()
    return out


def gaps(surface: PointSurface, narrow: float, wide: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the middle (N, 3) and width (N,) float32 of the widest gap beside each point, width 0 where there is none.

    Parameters
    ----------
    surface : PointSurface
    narrow, wide : float
        A gap is a sector of 60° in the tangent plane whose nearest point is farther than ``narrow`` and nearer than ``wide``.
    """
    middle = wp.empty(len(surface), dtype=wp.vec3, device=surface.device)
    width = wp.empty(len(surface), dtype=wp.float32, device=surface.device)
    launch(
        gap_kernel,
        len(surface),
        inputs=[surface.point_grid, float(narrow), float(wide)],
        outputs=[middle, width],
        device=surface.device,
        work=1000,
    )
    places, widths = np.empty((len(surface), 3), np.float32), np.empty(len(surface), np.float32)
    places[surface.order], widths[surface.order] = middle.numpy(), width.numpy()
    return places, widths
