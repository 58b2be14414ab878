"""Averages along the edges of a mesh: how heights are smoothed for a level, and how far a vertex is from the rim."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from intaglio.arrays import Array

# One average spreads a value over about half an edge: 4^k of them damp waves shorter than some 3 * 2^k edges.
BANDS = (4, 16, 64)


def averaging(graph: csr_array, use: Array) -> csr_array:
    """Return the matrix (N, N) that moves every value half way to the mean of its neighbours in ``use``; rows sum to 1.

    Parameters
    ----------
    graph : (N, N) sparse array
        Ones where an edge joins two vertices.
    use : (N,) bool array
        The vertices that take part; the others keep their values.
    """
    mask = diags_array(use.astype(np.float32))
    own = csr_array(mask @ graph @ mask)
    degree = np.asarray(own.sum(axis=1)).reshape(-1)
    return csr_array(diags_array(np.where(degree > 0, 0.5, 1.0)) + diags_array(0.5 / np.maximum(degree, 1)) @ own)


def average(matrix: csr_array, values: Array, times: int) -> Array:
    """Return ``values`` averaged ``times`` times."""
    for _ in range(times):
        values = matrix @ values
    return values


def bands(matrix: csr_array, height: Array) -> list[Array]:
    """Return the relief (N,) in three bands, fine to coarse: waves of up to some 6, 12 and 24 edges."""
    out, before, done = [], height, 0
    for times in BANDS:
        smoother = average(matrix, before, times - done)
        out.append(before - smoother)
        before, done = smoother, times
    return out


def edges_from(graph: csr_array, start: Array) -> Array:
    """Return the number of edges (N,) from the nearest vertex of ``start`` (bool); the vertices' count where none leads there."""
    count = len(start)
    hops = np.full(count, count)
    front = start
    steps = 0
    while front.any():
        hops[front] = steps
        steps += 1
        front = (np.asarray(graph @ front.astype(np.float32)) > 0) & (hops > steps)
    return hops
