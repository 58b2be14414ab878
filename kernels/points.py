"""Surfaces defined by points with normals: nearest point, projection, intersection with a line, surface variation.

The surface is that of Adamson & Alexa (*On normals and projection operators for surfaces defined by point sets*, 2004):
with ``a(x)`` the weighted average of the points about x and ``n(x)`` that of their normals, it is where
``n(x) . (a(x) - x) = 0``. The weight is ``(1 - r² / R²)⁴`` within the support R, close to a Gaussian.

Only points whose normals face the side asked for take part, so that the two sides of a thread, or two threads that touch,
are not averaged into one. Points lie in a hashed uniform grid; many separate sets share one grid as its groups.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch

wp.set_module_options({"enable_backward": False})

# Iterations of a projection, and the movement (in supports) at which it has settled.
_STEPS = wp.constant(16)
_SETTLED = wp.constant(1.0e-3)
# A line that meets the surface flatter than this (sine) counts as passing it by.
_GRAZING = wp.constant(0.3)


@wp.func
def local_plane(
    grid: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    group: int,
    x: wp.vec3,
    facing: wp.vec3,
    support: float,
    hermite: float,
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
    inverse = 1.0 / (support * support)
    for j in wp.hash_grid_query(grid, x, support, group):
        d = points[j] - x
        w = 1.0 - wp.dot(d, d) * inverse
        if w > 0.0:
            n = normals[j]
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
    grid: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    group: int,
    x: wp.vec3,
    facing: wp.vec3,
    support: float,
    reach: float,
):
    """Return the nearest point's index, -1 if there is none within ``reach``; rings about ``x`` double in radius."""
    best = int(-1)
    radius = wp.min(support, reach)
    searching = int(1)
    while searching == 1:
        least = radius * radius
        for j in wp.hash_grid_query(grid, x, radius, group):
            d = points[j] - x
            r2 = wp.dot(d, d)
            # Of points at the same distance the first in the list counts, whatever the order of the visit.
            if r2 < least or (r2 == least and (best < 0 or j < best)):
                if wp.dot(normals[j], facing) >= 0.0:
                    least = r2
                    best = j
        if best >= 0 or radius >= reach:
            searching = 0
        radius = wp.min(2.0 * radius, reach)
    return best


@wp.func
def settle(
    grid: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    group: int,
    x: wp.vec3,
    begin: wp.vec3,
    facing: wp.vec3,
    support: float,
    hermite: float,
):
    """Return foot and normal of ``x`` on the surface, from ``begin`` near it, and whether there is one (1 or 0).

    The quasi-orthogonal projection: ``x`` itself is dropped on the plane at the last iterate, until the plane stays. Farther
    from a bent surface than its radius that swings to and fro ever wider: steps that turn back are halved.
    """
    at = begin
    normal = facing
    found = int(0)
    last = wp.vec3()
    share = float(1.0)
    for _ in range(_STEPS):
        position, n, total = local_plane(grid, points, normals, group, at, facing, support, hermite)
        if total == 0.0:
            break
        found = 1
        normal = n
        foot = x - n * wp.dot(n, x - position)
        # From far away the plane's foot may lie beyond the points it was made of.
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
    grid: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    group: int,
    x: wp.vec3,
    direction: wp.vec3,
    support: float,
    hermite: float,
    reach: float,
):
    """Return where the line through ``x`` along ±``direction`` meets the surface, its normal, and 1; or 0 if it does not.

    The limited intersection of Adamson & Alexa (2003): the line is cut with the plane at the last iterate. Iterations begin
    at ``x``, then farther and farther away on both sides, up to ``reach``; the first to settle counts, which is the nearest
    intersection but where two are about equally near.
    """
    step = 0.75 * support
    starts = int(reach / step)
    found = int(0)
    best = float(0.0)
    normal = direction
    for k in range(2 * starts + 1):
        if found == 0:
            # 0, 1, -1, 2, -2, ... steps from x.
            t = float((k + 1) / 2) * step * (1.0 - 2.0 * float((k + 1) % 2))
            settled = int(0)
            for _ in range(_STEPS):
                if settled == 0:
                    position, n, total = local_plane(grid, points, normals, group, x + t * direction, direction, support, hermite)
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
    grid: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    at: wp.array(dtype=wp.vec3),
    facing: wp.array(dtype=wp.vec3),
    group: wp.array(dtype=wp.int32),
    support: float,
    hermite: float,
    reach: float,
    along: int,
    # output
    foot: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    found: wp.array(dtype=wp.int32),
):
    """Foot and normal on the surface of each position; ``along``: first where the line along ``facing`` meets it."""
    i = start + wp.tid()
    x = at[i]
    side = facing[i]
    g = group[i]
    here = x
    n = side
    ok = int(0)
    if along == 1:
        here, n, ok = meet(grid, points, normals, g, x, side, support, hermite, reach)
    if ok == 0:
        j = nearest_point(grid, points, normals, g, x, side, support, reach)
        if j >= 0:
            begin = points[j]
            if wp.length(begin - x) < 0.5 * support:
                begin = x
            if wp.length_sq(side) == 0.0:
                side = normals[j]
            here, n, ok = settle(grid, points, normals, g, x, begin, side, support, hermite)
            if ok == 0:
                here = points[j]
                n = normals[j]
                ok = 1
    foot[i] = here
    normal[i] = n
    found[i] = ok


@wp.kernel
def nearest_kernel(
    start: int,
    grid: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    at: wp.array(dtype=wp.vec3),
    facing: wp.array(dtype=wp.vec3),
    group: wp.array(dtype=wp.int32),
    support: float,
    reach: float,
    # output
    index: wp.array(dtype=wp.int32),
):
    """Nearest point that faces the side asked for, -1 where there is none within reach."""
    i = start + wp.tid()
    index[i] = nearest_point(grid, points, normals, group[i], at[i], facing[i], support, reach)


@wp.kernel
def variation_kernel(
    start: int,
    grid: wp.uint64,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    group: wp.array(dtype=wp.int32),
    radius: float,
    # output
    variation: wp.array(dtype=float),
):
    """Surface variation of Pauly et al. (2002): least eigenvalue of the neighbours' covariance over the sum of all three."""
    i = start + wp.tid()
    x = points[i]
    side = normals[i]
    count = float(0.0)
    mean = wp.vec3()
    second = wp.mat33()
    for j in wp.hash_grid_query(grid, x, radius, group[i]):
        d = points[j] - x
        if wp.dot(d, d) <= radius * radius:
            if wp.dot(normals[j], side) >= 0.0:
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


@dataclass(frozen=True)
class Feet:
    """Projections on a surface.

    Attributes
    ----------
    points, normals : (K, 3) float32 arrays
    found : (K,) bool array
        False: no surface within reach; position and normal are then those given.
    """

    points: np.ndarray
    normals: np.ndarray
    found: np.ndarray


class PointSurface:
    """The surface of points with normals, in a hashed grid; separate sets are groups that don't see each other.

    Parameters
    ----------
    points, normals : (N, 3) arrays
        Used as float32: subtract far origins first. Unit normals.
    support : float
        Radius R of the weights; two to four times the distance of samples.
    group : (N,) int array, optional
        The set of each point; default: one set, 0.
    hermite : bool
        Correct averages for the surface's bending by the neighbours' tangent planes (see `local_plane`); False: Adamson &
        Alexa's surface as it is, which shrinks wires thinner than the support.
    device : str
        From `choose_device`.
    """

    def __init__(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        support: float,
        *,
        group: np.ndarray | None = None,
        hermite: bool = True,
        device: str = "cpu",
    ) -> None:
        self.device, self.support, self.hermite = device, float(support), float(hermite)
        count = len(points)
        group = np.zeros(count, np.int32) if group is None else np.ascontiguousarray(group, np.int32)
        points = np.ascontiguousarray(points, np.float32)
        # Neighbours in space become neighbours in memory, which halves the time of every query.
        key, spans = group.astype(np.int64), []
        for axis in range(3):
            cell = np.floor(points[:, axis] / np.float32(support)).astype(np.int64)
            cell -= cell.min() if count else 0
            spans.append(int(cell.max(initial=0)) + 1)
            key = key * spans[axis] + cell
        self.order = np.argsort(key, kind="stable")
        self.points = wp.array(points[self.order], dtype=wp.vec3, device=device)
        self.normals = wp.array(np.ascontiguousarray(normals, np.float32)[self.order], dtype=wp.vec3, device=device)
        self.group = wp.array(group[self.order], dtype=wp.int32, device=device)
        side = [int(np.clip(span + 2, 4, 1024)) for span in spans]
        while np.prod(side, dtype=float) > 1 << 22:
            side[int(np.argmax(side))] //= 2
        self._grid = wp.HashGrid(*side, device=device)
        if count:
            self._grid.reserve(count, with_groups=True)
            self._grid.build(self.points, radius=self.support, groups=self.group)

    @property
    def grid(self) -> wp.uint64:
        """Id of the hashed grid, for kernels."""
        return self._grid.id

    def __len__(self) -> int:
        return len(self.order)

    def project(
        self,
        at: np.ndarray,
        *,
        facing: np.ndarray | None = None,
        group: np.ndarray | None = None,
        reach: float,
        along: bool = False,
    ) -> Feet:
        """Project positions quasi-orthogonally on the surface.

        Parameters
        ----------
        at : (K, 3) array
        facing : (K, 3) array, optional
            Only points whose normals have a positive product with this take part; default: the side of the nearest point.
        group : (K,) int array, optional
            The set that each position is projected on.
        reach : float
            How far to look for a surface.
        along : bool
            First look where the line along ±``facing`` meets the surface.
        """
        at = np.ascontiguousarray(at, np.float32)
        count = len(at)
        sides = np.zeros((count, 3), np.float32) if facing is None else np.ascontiguousarray(facing, np.float32)
        if not len(self) or not count:
            return Feet(at, sides, np.zeros(count, bool))
        foot = wp.empty(count, dtype=wp.vec3, device=self.device)
        normal = wp.empty(count, dtype=wp.vec3, device=self.device)
        found = wp.empty(count, dtype=wp.int32, device=self.device)
        launch(
            project_kernel,
            count,
            [
                self.grid,
                self.points,
                self.normals,
                *self._queries(at, sides, group),
                self.support,
                self.hermite,
                float(reach),
                int(along),
            ],
            [foot, normal, found],
            device=self.device,
            work=3000,
        )
        return Feet(foot.numpy().copy(), normal.numpy().copy(), found.numpy() == 1)

    def nearest(
        self, at: np.ndarray, *, facing: np.ndarray | None = None, group: np.ndarray | None = None, reach: float
    ) -> np.ndarray:
        """Return the index of the nearest point (as given, not as sorted), -1 where there is none within ``reach``."""
        at = np.ascontiguousarray(at, np.float32)
        sides = np.zeros((len(at), 3), np.float32) if facing is None else np.ascontiguousarray(facing, np.float32)
        if not len(self) or not len(at):
            return np.full(len(at), -1)
        index = wp.empty(len(at), dtype=wp.int32, device=self.device)
        launch(
            nearest_kernel,
            len(at),
            [self.grid, self.points, self.normals, *self._queries(at, sides, group), self.support, float(reach)],
            [index],
            device=self.device,
            work=500,
        )
        found = index.numpy()
        return np.where(found >= 0, self.order[np.maximum(found, 0)], -1)

    def variation(self, radius: float) -> np.ndarray:
        """Return the surface variation (N,) float32 in [0, 1/3] of each point's neighbours within ``radius``."""
        value = wp.empty(len(self), dtype=float, device=self.device)
        launch(
            variation_kernel,
            len(self),
            [self.grid, self.points, self.normals, self.group, float(radius)],
            [value],
            device=self.device,
            work=1000,
        )
        out = np.empty(len(self), np.float32)
        out[self.order] = value.numpy()
        return out

    def _queries(self, at: np.ndarray, sides: np.ndarray, group: np.ndarray | None) -> list[wp.array]:
        groups = np.zeros(len(at), np.int32) if group is None else np.ascontiguousarray(group, np.int32)
        return [
            wp.array(at, dtype=wp.vec3, device=self.device),
            wp.array(sides, dtype=wp.vec3, device=self.device),
            wp.array(groups, dtype=wp.int32, device=self.device),
        ]
