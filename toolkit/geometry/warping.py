"""Thin-plate warps of patches: batched solution, and the choice of pairs that can be trusted."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.kernels.launch import single_threaded_blas
from intaglio.kernels.splines import Splines

# The most entries of systems that are solved together, to bound memory.
_SYSTEM_NUMBERS = 2e7


def solve_splines(sources: list[Array], targets: list[Array], smoothing: float) -> Splines:
    """Return the thin-plate splines that take sources to targets, one for each pair of lists, in float64.

    Minimises Σ |W(s) - t|² + smoothing · bending(W) through the usual system [K + λI, P; Pᵀ, 0] with K = -|c_i - c_j|
    (conditionally positive definite, so that λ > 0 makes it regular) and P = [1, s]. Coordinates are scaled to the spread of
    the sources first, so that ``smoothing`` means the same at any size. Systems are padded to one size and solved together.

    Parameters
    ----------
    sources, targets : lists of (n_b, 3) arrays
        At least 4 pairs that don't lie in a plane; patches with fewer are moved by their mean.
    smoothing : float
        λ over the spread of the sources; 1e-6 interpolates to within rounding.

    References
    ----------
    Wahba, *Spline Models for Observational Data* (1990), section 2.4.
    """
    count = len(sources)
    sizes = np.array([len(s) for s in sources], np.int64)
    largest = int(sizes.max(initial=0)) + 4
    together = max(1, int(_SYSTEM_NUMBERS // largest**2))
    if count > together:
        parts = [
            solve_splines(sources[k : k + together], targets[k : k + together], smoothing) for k in range(0, count, together)
        ]
        first = np.concatenate([[0], np.cumsum(sizes)])
        rest = (np.concatenate([getattr(p, name) for p in parts]) for name in ("centers", "weights", "linear", "offset"))
        return Splines(first, *rest)
    first = np.concatenate([[0], np.cumsum(sizes)])
    centers = np.concatenate(sources) if first[-1] else np.zeros((0, 3))
    weights = np.zeros((first[-1], 3))
    linear, offset = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    most = int(sizes.max(initial=0))
    if most == 0:
        return Splines(first, centers, weights, linear, offset)
    system = np.zeros((count, most + 4, most + 4))
    right = np.zeros((count, most + 4, 3))
    middle, spread = np.zeros((count, 3)), np.ones(count)
    for b, (s, t) in enumerate(zip(sources, targets, strict=True)):
        n = len(s)
        system[b, np.arange(n, most), np.arange(n, most)] = 1
        if n < 4:
            system[b, np.arange(most + 4), np.arange(most + 4)] = 1
            continue
        middle[b] = s.mean(axis=0)
        spread[b] = max(float(np.sqrt(((s - middle[b]) ** 2).sum(axis=1).mean())), 1e-300)
        scaled = (s - middle[b]) / spread[b]
        between = np.sqrt(np.maximum(((scaled[:, None] - scaled[None]) ** 2).sum(axis=2), 0))
        system[b, :n, :n] = -between
        system[b, np.arange(n), np.arange(n)] += smoothing
        system[b, :n, most] = system[b, most, :n] = 1
        system[b, :n, most + 1 :] = scaled
        system[b, most + 1 :, :n] = scaled.T
        right[b, :n] = (t - s) / spread[b]
    with single_threaded_blas():
        solution = _solve_stacked(system, right)
    for b in range(count):
        n = sizes[b]
        if n >= 4 and np.isfinite(solution[b]).all():
            # In place of t - s over the spread, the spline of t itself in the patch's own coordinates.
            weights[first[b] : first[b + 1]] = -solution[b, :n]
            gradient = solution[b, most + 1 :].T
            linear[b] += gradient
            offset[b] = solution[b, most] * spread[b] - gradient @ middle[b]
        elif n:
            offset[b] = (targets[b] - sources[b]).mean(axis=0)
    return Splines(first, centers, weights, linear, offset)


def _solve_stacked(system: Array, right: Array) -> Array:
    """Solve stacked systems; a singular one gives NaN for itself alone."""
    try:
        return np.linalg.solve(system, right)
    except np.linalg.LinAlgError:
        out = np.full(right.shape, np.nan)
        for b in range(len(system)):
            try:
                out[b] = np.linalg.solve(system[b], right[b])
            except np.linalg.LinAlgError:
                continue
        return out


def mean_moves(sources: Array, targets: Array, radius: float) -> Array:
    """Return the mean (n, 3) of sources minus targets about each target, weighted by a Gaussian of width ``radius``."""
    near = np.exp(-((targets[:, None] - targets[None]) ** 2).sum(axis=2) / (2 * radius**2))
    with single_threaded_blas():
        return near @ (sources - targets) / near.sum(axis=1, keepdims=True)


def most_coherent(sources: Array, targets: Array, radius: float, share: float) -> Array:
    """Return the indices of the ``share`` of pairs that move most as their neighbours do."""
    strange = np.linalg.norm(sources - targets - mean_moves(sources, targets, radius), axis=1)
    return np.sort(np.argsort(strange, kind="stable")[: int(np.ceil(share * len(sources)))])
