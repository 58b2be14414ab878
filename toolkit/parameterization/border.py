"""Free borders: whether a chart's border crosses itself, and a barrier that keeps it from doing so."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array


def crosses_itself(points: Array) -> bool:
    """Return whether the closed polygon ``points`` (B, 2) crosses or touches itself."""
    ends = np.roll(points, -1, axis=0)
    middle, half = (points + ends) / 2, np.linalg.norm(ends - points, axis=1) / 2
    count = len(points)
    # Pairs whose bounding circles may meet. Long edges would make every pair a candidate, so each searches its own radius.
    short = half <= 4 * np.median(half)
    pairs = [_near_pairs(middle, half, short)]
    for k in np.flatnonzero(~short):
        other = np.flatnonzero(np.linalg.norm(middle - middle[k], axis=1) <= half + half[k])
        pairs.append(np.stack([np.full(len(other), k), other], axis=1))
    i, j = np.concatenate(pairs).T
    apart = (i - j) % count
    keep = (apart > 1) & (apart < count - 1)
    i, j = i[keep], j[keep]

    def side(a: Array, b: Array, c: Array) -> Array:
        value: Array = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
        return value

    p, q, r, s = points[i], ends[i], points[j], ends[j]
    return bool(((side(p, q, r) * side(p, q, s) <= 0) & (side(r, s, p) * side(r, s, q) <= 0)).any())


def _near_pairs(middle: Array, half: Array, which: Array) -> Array:
    index = np.flatnonzero(which)
    found = cKDTree(middle[index]).query_pairs(2 * float(half[index].max()), output_type="ndarray")
    return index[found]


def close_pairs(points: Array, reach: float) -> tuple[Array, Array]:
    """Return border vertices and edges nearer than ``reach``, as places in ``points`` (B, 2); an edge k runs to k + 1."""
    count = len(points)
    ends = np.roll(points, -1, axis=0)
    middle, half = (points + ends) / 2, np.linalg.norm(ends - points, axis=1) / 2
    tree = cKDTree(points)
    edge = tree.query_ball_point(middle, half + reach)
    number = np.array([len(e) for e in edge])
    k = np.repeat(np.arange(count), number)
    v = np.concatenate([np.asarray(e, int) for e in edge]) if number.sum() else np.zeros(0, int)
    apart = (v - k) % count
    keep = (apart > 1) & (apart < count - 1)
    v, k = v[keep], k[keep]
    distance, _ = _distances(points, v, k)
    near = distance < reach
    return v[near], k[near]


def barrier(points: Array, vertex: Array, edge: Array, reach: float) -> tuple[float, Array, Array]:
    """Return the barrier's energy, gradient (P, 6) and Gauss-Newton Hessian (P, 6, 6) of pairs of vertex and edge.

    Energy sum max(0, reach / distance - 1)^2 (Smith & Schaefer, Bijective parameterization with free boundaries, 2015,
    section 4). Coordinates: the vertex, the edge's first and second end.
    """
    if len(vertex) == 0:
        return 0.0, np.zeros((0, 6)), np.zeros((0, 6, 6))
    distance, at = _distances(points, vertex, edge)
    first, second = points[edge], points[(edge + 1) % len(points)]
    direction = points[vertex] - (first + at[:, None] * (second - first))
    unit = direction / np.maximum(distance, 1e-300)[:, None]
    excess = np.maximum(reach / np.maximum(distance, 1e-300) - 1, 0)
    by_distance = -reach / np.maximum(distance, 1e-300) ** 2
    slope = np.concatenate([unit, -(1 - at)[:, None] * unit, -at[:, None] * unit], axis=1) * by_distance[:, None]
    gradient = 2 * excess[:, None] * slope
    hessian = 2 * (excess > 0)[:, None, None] * slope[:, :, None] * slope[:, None, :]
    return float((excess**2).sum()), gradient, hessian


def _distances(points: Array, vertex: Array, edge: Array) -> tuple[Array, Array]:
    """Return distances of vertices to edges, and where along them the nearest points are, 0 to 1."""
    first, second = points[edge], points[(edge + 1) % len(points)]
    along = second - first
    at = np.einsum("ij,ij->i", points[vertex] - first, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)
    at = np.clip(at, 0, 1)
    distance = np.linalg.norm(points[vertex] - first - at[:, None] * along, axis=1)
    return distance, at
