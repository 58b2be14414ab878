"""Surfaces defined by points with normals: nearest point, projection, intersection with a line, surface variation.

The surface is that of Adamson & Alexa (*On normals and projection operators for surfaces defined by point sets*, 2004):
with ``a(x)`` the weighted average of the points about x and ``n(x)`` that of their normals, it is where
``n(x) . (a(x) - x) = 0``. The weight is ``(1 - r² / R²)⁴`` within the support R, close to a Gaussian.

Only points whose normals face the side asked for take part, so that the two sides of a thread, or two threads that touch,
are not averaged into one. Points lie in a hashed uniform grid; many separate sets share one grid as its groups.
"""

from __future__ import annotations

import warp as wp

# Loops unrolled to more than four rounds would take the compiler several times as long, and run no faster.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

# A projection takes at most this many iterations, and ends where one moves the point by less than this share of the support.
_STEPS = wp.constant(16)
_SETTLED = wp.constant(1.0e-3)
# A line that meets the surface at an angle whose sine is less than this counts as passing it by.
_GRAZING = wp.constant(0.3)


@wp.struct
class PointGrid:
    """Points with normals in a hashed grid, and what a surface is made of them with."""

    grid: wp.uint64
    points: wp.array[wp.vec3]
    normals: wp.array[wp.vec3]
    group: wp.array[wp.int32]
    # Radius R of the weights.
    support: float
    # Share of the correction for bending, 0 to 1; see `local_plane`.
    hermite: float


@wp.func
def local_plane(
    surface: PointGrid,
    group: int,
    x: wp.vec3,
    facing: wp.vec3,
):
    """Return average position, average unit normal and sum of weights about ``x`` (sum 0: no points there).

    Averages lie inside of what bends: on a sphere of radius r by the mean of d² / 2r of the neighbours at distance d. The
    neighbours' own tangent planes pass as far outside. ``hermite`` 1 takes the middle of the two, which is off by the next
    order only, and weighs neighbours by how far they face the same side, which keeps threads that cross apart; 0 is the plain
    average.
    """
    position = wp.vec3()
    normal = wp.vec3()
    tangent = float(0.0)
    total = float(0.0)
    hermite = surface.hermite
    inverse = 1.0 / (surface.support * surface.support)
    for j in wp.hash_grid_query(surface.grid, x, surface.support, group):
        d = surface.points[j] - x
        w = 1.0 - wp.dot(d, d) * inverse
        if w > 0.0:
            n = surface.normals[j]
            side = wp.dot(n, facing)
            if side >= 0.0:
                w = w * w
                w = w * w
                w = w * (1.0 - hermite + hermite * side * side)
                position += w * d
                normal += w * n
                tangent += w * wp.dot(n, d)
                total += w
    length = wp.length(normal)
    if length < 1.0e-3 * total:
        total = 0.0
    if total > 0.0:
        normal = normal / length
        position = position / total
        position += normal * (0.5 * hermite * (tangent / total - wp.dot(normal, position)))
        position += x
    return position, normal, total


@wp.func
def nearest_point(
    surface: PointGrid,
    group: int,
    x: wp.vec3,
    facing: wp.vec3,
    reach: float,
):
    """Return the nearest point's index, -1 if there is none within ``reach``; rings about ``x`` double in radius."""
    best = int(-1)
    radius = wp.min(surface.support, reach)
    searching = int(1)
    while searching == 1:
        least = radius * radius
        for j in wp.hash_grid_query(surface.grid, x, radius, group):
            d = surface.points[j] - x
            r2 = wp.dot(d, d)
            # Of points at the same distance the first in the list is taken, so that the order of the visit does not matter.
            if r2 < least or (r2 == least and (best < 0 or j < best)):
                if wp.dot(surface.normals[j], facing) >= 0.0:
                    least = r2
                    best = j
        if best >= 0 or radius >= reach:
            searching = 0
        radius = wp.min(2.0 * radius, reach)
    return best


@wp.func
def settle(
    surface: PointGrid,
    group: int,
    x: wp.vec3,
    begin: wp.vec3,
    facing: wp.vec3,
):
    """Return foot and normal of ``x`` on the surface, from ``begin`` near it, and whether there is one (1 or 0).

    The quasi-orthogonal projection: ``x`` itself is dropped on the plane at the last iterate, until the plane stays. Where
    ``x`` is farther from a bent surface than the surface's radius of curvature, the iterates would swing to and fro ever
    wider, so steps that turn back are halved.
    """
    at = begin
    normal = facing
    found = int(0)
    support = surface.support
    last = wp.vec3()
    share = float(1.0)
    for _ in range(_STEPS):
        position, n, total = local_plane(surface, group, at, facing)
        if total == 0.0:
            break
        found = 1
        normal = n
        foot = x - n * wp.dot(n, x - position)
        # Seen from far away, the foot on the plane may lie beyond the points that the plane was made of.
        away = foot - position
        length = wp.length(away)
        if length > 0.5 * support:
            foot = position + away * (0.5 * support / length)
        step = foot - at
        if wp.dot(step, last) < 0.0:
            share = 0.5 * share
        at += share * step
        last = step
        if wp.length(step) < _SETTLED * support:
            break
    return at, normal, found


@wp.func
def meet(
    surface: PointGrid,
    group: int,
    x: wp.vec3,
    direction: wp.vec3,
    reach: float,
):
    """Return where the line through ``x`` along ±``direction`` meets the surface, its normal, and 1; or 0 if it does not.

    The limited intersection of Adamson & Alexa (2003): the line is cut with the plane at the last iterate. Iterations begin
    at ``x``, then farther and farther away on both sides, up to ``reach``; the first to settle counts, which is the nearest
    intersection, except perhaps where two are about equally near.
    """
    support = surface.support
    step = 0.75 * support
    starts = int(reach / step)
    found = int(0)
    best = float(0.0)
    normal = direction
    for k in range(2 * starts + 1):
        if found == 0:
            # Iterations begin 0, 1, -1, 2, -2, ... steps from x.
            t = float((k + 1) / 2) * step * (1.0 - 2.0 * float((k + 1) % 2))
            settled = int(0)
            for _ in range(_STEPS):
                if settled == 0:
                    position, n, total = local_plane(surface, group, x + t * direction, direction)
                    slope = wp.dot(n, direction)
                    if total == 0.0 or slope < _GRAZING:
                        settled = -1
                    else:
                        to = wp.dot(n, position - x) / slope
                        if wp.abs(to) > reach:
                            settled = -1
                        else:
                            if wp.abs(to - t) < _SETTLED * support:
                                settled = 1
                            normal = n
                            t = to
            if settled == 1:
                found = 1
                best = t
    return x + best * direction, normal, found


@wp.kernel
def project_kernel(
    start: int,
    surface: PointGrid,
    at: wp.array[wp.vec3],
    facing: wp.array[wp.vec3],
    group: wp.array[wp.int32],
    reach: float,
    along: int,
    # output
    foot: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    found: wp.array[wp.int32],
):
    """Write the foot and normal of each position on the surface n(x) . (a(x) - x) = 0.

    With ``along`` = 1 the foot is where the line along ``facing`` meets the surface, if it does.
    """
    i = start + wp.tid()
    x = at[i]
    side = facing[i]
    g = group[i]
    here = x
    n = side
    ok = int(0)
    if along == 1:
        here, n, ok = meet(surface, g, x, side, reach)
    if ok == 0:
        j = nearest_point(surface, g, x, side, reach)
        if j >= 0:
            begin = surface.points[j]
            if wp.length(begin - x) < 0.5 * surface.support:
                begin = x
            if wp.length_sq(side) == 0.0:
                side = surface.normals[j]
            here, n, ok = settle(surface, g, x, begin, side)
            if ok == 0:
                here = surface.points[j]
                n = surface.normals[j]
                ok = 1
    foot[i] = here
    normal[i] = n
    found[i] = ok


@wp.kernel
def nearest_kernel(
    start: int,
    surface: PointGrid,
    at: wp.array[wp.vec3],
    facing: wp.array[wp.vec3],
    group: wp.array[wp.int32],
    reach: float,
    # output
    index: wp.array[wp.int32],
):
    """Write the index of the nearest point on the side asked for, argmin |p_j - x| with n_j . facing >= 0; -1 beyond reach."""
    i = start + wp.tid()
    index[i] = nearest_point(surface, group[i], at[i], facing[i], reach)


@wp.kernel
def variation_kernel(
    start: int,
    surface: PointGrid,
    radius: float,
    # output
    variation: wp.array[wp.float32],
):
    """Write the surface variation of Pauly et al. (2002), l0 / (l0 + l1 + l2) of the neighbours' covariance, l0 the least."""
    i = start + wp.tid()
    x = surface.points[i]
    side = surface.normals[i]
    count = float(0.0)
    mean = wp.vec3()
    second = wp.mat33()
    for j in wp.hash_grid_query(surface.grid, x, radius, surface.group[i]):
        d = surface.points[j] - x
        if wp.dot(d, d) <= radius * radius:
            if wp.dot(surface.normals[j], side) >= 0.0:
                count += 1.0
                mean += d
                second += wp.outer(d, d)
    value = float(0.0)
    if count >= 3.0:
        mean = mean / count
        covariance = second / count - wp.outer(mean, mean)
        scale = wp.trace(covariance)
        if scale > 0.0:
            _, eigenvalues = wp.eig3(covariance / scale)
            value = wp.max(0.0, wp.min(eigenvalues[0], wp.min(eigenvalues[1], eigenvalues[2])))
    variation[i] = value
