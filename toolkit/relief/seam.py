"""How visible the seam between measured and filled relief is."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh import unique_edges

_SEAM_RINGS = 10


def seam_measure(points: Array, values: Array, faces: Array, measured: Array, normals: Array | None = None) -> float:
    """Return how much larger jumps across the seam are than jumps along the same direction inside; 1: no seam.

    Jumps are height differences over edges. Those across the seam join a measured and a filled vertex; those they are held
    against join rings 1 to 10 of measured vertices around the seam, so they run the same way, and are averaged as a
    function of edge length. On relief with a direction the measure depends on where its phase meets the seam.

    Parameters
    ----------
    points : (N, 3) array
        Base points.
    values : (N,) array
        Relief.
    faces : (F, 3) array
        Triangles.
    measured : (N,) bool array
    normals : (N, 3) array, optional
        Of the base. A jump is then how far two vertices stand apart along their mean normal, steps of the base itself counted in.

    Returns
    -------
    float
        NaN where there is no seam or no ring beside it.
    """
    edges = unique_edges(faces)
    crossing = measured[edges[:, 0]] != measured[edges[:, 1]]
    ring = _rings_from_seam(edges, crossing, measured)
    beside = np.abs(ring[edges[:, 0]] - ring[edges[:, 1]]) == 1
    beside &= (ring[edges] > 0).all(axis=1) & (ring[edges] <= _SEAM_RINGS).all(axis=1)
    if not crossing.any() or not beside.any():
        return float("nan")
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    jump = np.abs(values[edges[:, 0]] - values[edges[:, 1]])
    if normals is not None:
        surface = points + values[:, None] * normals
        along = normals[edges].sum(axis=1)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
        jump = np.abs(np.einsum("ij,ij->i", surface[edges[:, 0]] - surface[edges[:, 1]], along))
    bounds = np.unique(np.quantile(length[beside], np.linspace(0, 1, 9)))
    at = np.clip(np.searchsorted(bounds, length[beside], side="right") - 1, 0, max(len(bounds) - 2, 0))
    count = np.bincount(at)
    use = count > 0
    middle = np.bincount(at, length[beside])[use] / count[use]
    expected = np.interp(length[crossing], middle, np.bincount(at, jump[beside])[use] / count[use])
    total = float(expected.sum())
    if total > 0:
        return float(jump[crossing].sum() / total)
    return 1.0 if jump[crossing].sum() == 0 else float("inf")


def _rings_from_seam(edges: Array, crossing: Array, measured: Array) -> Array:
    """Ring number of measured vertices, 1 at the seam, up to _SEAM_RINGS; 0 elsewhere."""
    ring = np.zeros(len(measured), int)
    ring[np.unique(edges[crossing])] = 1
    ring[~measured] = 0
    inner = edges[measured[edges].all(axis=1)]
    for number in range(2, _SEAM_RINGS + 1):
        near = ring[inner] == number - 1
        reached = np.concatenate([inner[near[:, 0], 1], inner[near[:, 1], 0]])
        ring[reached[ring[reached] == 0]] = number
    return ring
