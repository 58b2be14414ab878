"""Projected Newton minimisation of a map's distortion, by steps that never flip a triangle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from intaglio.arrays import Array, Progress
from intaglio.kernels.distortion import Distortion
from intaglio.parameterization.border import barrier, close_pairs, crosses_itself
from intaglio.parameterization.charts import Chart, doubled_texture_areas

# A step goes at most this share of the way to where the first triangle would be flat.
_SHORT_OF_FLAT = 0.9

# Sufficient decrease of a line search (Armijo).
_DECREASE = 1e-4

# Distance below which parts of a free border repel each other, in mean border edges.
_REACH = 0.1


@dataclass(frozen=True)
class _Pattern:
    """Where the 36 entries of every triangle go in the sparse matrix of the unknowns."""

    unknown: Array
    count: int
    entry: Array
    indices: Array
    indptr: Array
    order: Array


def minimize_distortion(
    chart: Chart,
    distortion: Distortion,
    uv: Array,
    *,
    free: bool,
    iterations: int,
    tolerance: float,
    progress: Progress | None = None,
) -> tuple[Array, int]:
    """Return positions (N, 2) of lower distortion than ``uv``, which must have no flips, and the Newton steps taken.

    Parameters
    ----------
    chart : Chart
    distortion : Distortion
    uv : (N, 2) array
    free : bool
        Whether the border moves. It never crosses itself, so that no two triangles overlap.
    iterations : int
        Most steps.
    tolerance : float
        Stop when the energy falls by less than this share.
    progress : callable, optional
        Called with steps done and the most steps.
    """
    pattern = _pattern(chart, uv, free)
    if pattern.count == 0:
        return uv, 0
    loop = chart.loop
    reach = _REACH * float(np.linalg.norm(uv[loop] - uv[np.roll(loop, -1)], axis=1).mean()) if free else 0.0
    energy = _energy(distortion, uv, loop, reach)
    step = 0
    for step in range(1, iterations + 1):
        gradient, hessian = distortion.derivatives(uv)
        direction, slope = _newton_direction(pattern, chart, gradient, hessian, uv, reach)
        if not slope < 0:
            break
        length = min(1.0, _SHORT_OF_FLAT * _until_flat(uv, direction, chart.faces))
        improved = None
        while length > 1e-12:
            trial = uv + length * direction
            value = _energy(distortion, trial, loop, reach)
            if value <= energy + _DECREASE * length * slope and not (free and crosses_itself(trial[loop])):
                improved = trial
                break
            length *= 0.5
        if improved is None:
            break
        uv = improved
        fall, energy = energy - value, value
        if progress is not None:
            progress(step, iterations)
        if fall < tolerance * abs(energy):
            break
    return uv, step


def _energy(distortion: Distortion, uv: Array, loop: Array, reach: float) -> float:
    """Return the whole energy, infinite where a triangle is flipped."""
    total = float(distortion.energies(uv).sum())
    if reach > 0 and np.isfinite(total):
        total += barrier(uv[loop], *close_pairs(uv[loop], reach), reach)[0] * _strength(loop)
    return total


def _strength(loop: Array) -> float:
    """Return the weight of the border's barrier: small, since it matters only where the border nearly touches itself."""
    return 1e-3 / len(loop)


def _until_flat(uv: Array, direction: Array, faces: Array) -> float:
    """Return the shortest step at which a triangle has no area (Smith & Schaefer 2015, section 3.3); infinite if none."""
    a, b, c = (uv[faces[:, k]] for k in range(3))
    d, e, f = (direction[faces[:, k]] for k in range(3))

    def cross(p: Array, q: Array) -> Array:
        value: Array = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
        return value

    constant = doubled_texture_areas(uv, faces)
    linear = cross(b - a, f - d) + cross(e - d, c - a)
    square = cross(e - d, f - d)
    # The first positive root of constant + linear x + square x^2, where constant > 0, in the form that does not cancel.
    root = np.sqrt(np.maximum(linear**2 - 4 * square * constant, 0))
    real = linear**2 - 4 * square * constant >= 0
    with np.errstate(divide="ignore", invalid="ignore"):
        first = 2 * constant / (-linear + root)
        second = 2 * constant / (-linear - root)
    roots = np.stack([first, second])
    roots = roots[:, real]
    roots = roots[np.isfinite(roots) & (roots > 0)]
    return float(roots.min()) if len(roots) else np.inf


def _pattern(chart: Chart, uv: Array, free: bool) -> _Pattern:
    """Lay out the sparse matrix: u and v of each moving vertex side by side."""
    vertices = len(uv)
    moving = np.ones(vertices, bool)
    if not free:
        moving[chart.loop] = False
    order = np.flatnonzero(moving)
    place = np.full(vertices, -1)
    place[order] = np.arange(len(order))
    corner = place[chart.faces]
    unknown = np.stack([2 * corner, 2 * corner + 1], axis=2)
    unknown[corner < 0] = -1
    unknown = unknown.reshape(-1, 6)
    rows, columns = np.repeat(unknown, 6, axis=1).reshape(-1), np.tile(unknown, (1, 6)).reshape(-1)
    used = (rows >= 0) & (columns >= 0)
    count = 2 * len(order)
    keys, entry = np.unique(columns[used].astype(np.int64) * count + rows[used], return_inverse=True)
    target = np.full(len(rows), -1)
    target[used] = entry.reshape(-1)
    indptr = np.searchsorted(keys, np.arange(count + 1) * np.int64(count))
    return _Pattern(unknown, count, target, (keys % count).astype(np.int32), indptr.astype(np.int32), order)


def _newton_direction(
    pattern: _Pattern, chart: Chart, gradient: Array, hessian: Array, uv: Array, reach: float
) -> tuple[Array, float]:
    """Return the Newton direction (N, 2) and the energy's slope along it."""
    moving = pattern.unknown >= 0
    total = np.bincount(pattern.unknown[moving], gradient[moving], pattern.count)
    used = pattern.entry >= 0
    data = np.bincount(pattern.entry[used], hessian.reshape(-1)[used], len(pattern.indices))
    matrix = csc_array((data, pattern.indices, pattern.indptr), shape=(pattern.count,) * 2)
    diagonal = matrix.diagonal()
    if reach > 0:
        vertex, edge = close_pairs(uv[chart.loop], reach)
        if len(vertex):
            added, more = _barrier_terms(pattern, chart.loop, uv, vertex, edge, reach)
            total += added
            matrix = matrix + more
    # The energy of a free chart does not change as it moves or turns as a whole; a small multiple of the diagonal makes the
    # matrix definite.
    tiny = 1e-9 * float(diagonal.mean())
    matrix = matrix + csc_array((np.full(pattern.count, tiny), np.arange(pattern.count), np.arange(pattern.count + 1)))
    factors = splu(matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    solved = factors.solve(-total)
    direction = np.zeros_like(uv)
    direction[pattern.order] = solved.reshape(-1, 2)
    return direction, float(total @ solved)


def _barrier_terms(
    pattern: _Pattern, loop: Array, uv: Array, vertex: Array, edge: Array, reach: float
) -> tuple[Array, csc_array]:
    """Return the barrier's gradient and Hessian over the unknowns."""
    _, gradient, hessian = barrier(uv[loop], vertex, edge, reach)
    strength = _strength(loop)
    place = np.full(len(uv), -1)
    place[pattern.order] = np.arange(len(pattern.order))
    corner = place[loop[np.stack([vertex, edge, (edge + 1) % len(loop)], axis=1)]]
    unknown = np.stack([2 * corner, 2 * corner + 1], axis=2).reshape(-1, 6)
    total = np.bincount(unknown.reshape(-1), strength * gradient.reshape(-1), pattern.count)
    rows, columns = np.repeat(unknown, 6, axis=1).reshape(-1), np.tile(unknown, (1, 6)).reshape(-1)
    return total, csc_array((strength * hessian.reshape(-1), (rows, columns)), shape=(pattern.count,) * 2)
