"""Distances of samples: measuring them, and thinning dense samples to an even spread."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from intaglio.randomness import uniform

Array = np.ndarray

_NEIGHBOURS = 8
_STREAM = 62
# Samples of largest density measured: more would only cost time.
_MEASURED = 20_000


def local_spacing(points: Array, normals: Array | None = None) -> Array:
    """Return the distance of samples about each point (K,): 1 over the root of their number on a unit of area.

    Parameters
    ----------
    points : (N, 3) array
        At least nine; of more than 20,000 an even choice is measured.
    normals : (N, 3) array, optional
        Neighbours that face away are left out.
    """
    tree = cKDTree(points)
    chosen = np.linspace(0, len(points) - 1, min(len(points), _MEASURED)).astype(int)
    wanted = min(_NEIGHBOURS if normals is None else 3 * _NEIGHBOURS, len(points) - 1)
    distance, index = tree.query(points[chosen], wanted + 1)
    distance, index = distance[:, 1:], index[:, 1:]
    if normals is not None:
        facing = (normals[index] * normals[chosen, None]).sum(axis=2) > 0
        distance = np.sort(np.where(facing, distance, np.inf), axis=1)
    column = min(_NEIGHBOURS, distance.shape[1]) - 1
    # A disc about a sample whose border meets its k-th neighbour holds about k + 1/2 samples.
    return distance[:, column] * np.sqrt(np.pi / (column + 1.5))


def thinned(points: Array, normals: Array, radius: float, seed: int = 0) -> Array:
    """Return the indices of a Poisson-disk choice: none nearer to another on its side than ``radius``, and no room for more.

    Points are taken in random order, all that are first among their undecided neighbours at once, which is what taking them
    one by one gives.
    """
    rank = np.argsort(np.argsort(uniform(seed, _STREAM, np.arange(len(points))), kind="stable"))
    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
    pairs = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) > 0]
    early = np.where(rank[pairs[:, 0]] < rank[pairs[:, 1]], pairs[:, 0], pairs[:, 1])
    late = pairs.sum(axis=1) - early
    state = np.zeros(len(points), np.int8)
    while len(late):
        first = np.ones(len(points), bool)
        first[late] = False
        taken = first & (state == 0)
        state[taken] = 1
        state[late[taken[early]]] = -1
        alive = (state[early] == 0) & (state[late] == 0)
        early, late = early[alive], late[alive]
    state[state == 0] = 1
    return np.flatnonzero(state == 1)
