"""Laying a base out in the plane: conformal maps, borders without crossings, constrained Delaunay triangulation."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.mesh import Base, Cylinder, Plane, Sphere, edge_keys, perpendicular, unit


class ConformalMap:
    """Base -> plane, angles kept. ``pole`` (a unit direction seen from the centre) is sent to infinity on a sphere."""

    def __init__(self, base: Base, pole: Array | None = None, middle: float = 0.0) -> None:
        self.base = base
        self.middle = middle
        if isinstance(base, Sphere):
            self.pole = np.array([0.0, 0.0, 1.0]) if pole is None else unit(np.asarray(pole, np.float64))
            self.e1 = perpendicular(self.pole)
            self.e2 = np.cross(self.pole, self.e1)

    def __call__(self, points: Array) -> Array:
        """Return plane coordinates (N, 2), without unit."""
        base = self.base
        if isinstance(base, Plane):
            return base.chart(points)
        if isinstance(base, Cylinder):
            arc = base.chart(points)
            angle, height = arc[:, 0] / base.radius, (arc[:, 1] - self.middle) / base.radius
            return np.exp(height)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        assert isinstance(base, Sphere)
        d = unit(np.asarray(points, np.float64) - base.center)
        w = np.maximum(1.0 - d @ self.pole, 1e-12)
        return np.stack([d @ self.e1, d @ self.e2], axis=1) / w[:, None]

    def inverse(self, xy: Array) -> Array:
        """Return the base points (N, 3) at plane coordinates (N, 2)."""
        base = self.base
        if isinstance(base, Plane):
            return base.from_chart(xy)
        if isinstance(base, Cylinder):
            radius = np.maximum(np.linalg.norm(xy, axis=1), 1e-300)
            angle = np.arctan2(xy[:, 1], xy[:, 0])
            return base.from_chart(np.stack([base.radius * angle, base.radius * np.log(radius) + self.middle], axis=1))
        assert isinstance(base, Sphere)
        square = (xy**2).sum(axis=1, keepdims=True)
        direction = (2 * (xy @ np.stack([self.e1, self.e2])) + (square - 1) * self.pole) / (square + 1)
        return base.center + base.radius * direction


def turn(a: Array, b: Array) -> Array:
    """Return twice the signed area of (origin, a, b), rows of 2-vectors."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def constrained_delaunay(xy: Array, edges: Array) -> tuple[Array, Array]:
    """Return counter-clockwise triangles (T, 3) and, per edge k -> k + 1, the triangle across it or -1."""
    import pythoncdt as cdt

    mesh = cdt.Triangulation(cdt.VertexInsertionOrder.AUTO, cdt.IntersectingConstraintEdges.NOT_ALLOWED, 0.0)
    try:
        mesh.insert_vertices(np.ascontiguousarray(xy, np.float64))
        mesh.insert_edges(np.unique(np.sort(edges, axis=1), axis=0).astype(np.uintc))
        mesh.erase_super_triangle()
    except (RuntimeError, ValueError) as error:
        raise InputError(
            "the scan's border crosses or touches itself when laid out on its base: cut away what does not lie on the base, "
            f"or choose another base ({str(error).splitlines()[0]})"
        ) from error
    triangles = np.asarray(mesh.triangles_array()["vertices"]).astype(np.int64)
    count = len(xy)
    directed = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
    keys, opposite = edge_keys(directed, count), edge_keys(directed[:, ::-1], count)
    order = np.argsort(keys)
    at = order[np.minimum(np.searchsorted(keys, opposite, sorter=order), len(keys) - 1)]
    return triangles, np.where(keys[at] == opposite, at // 3, -1).reshape(-1, 3)


def untangle(xy: Array, edges: Array) -> None:
    """Smooth the border's chart positions, in place, where noise makes it cross itself.

    Only the layout is smoothed; the surface keeps its vertices. The places are single knots of a few edges where relief or
    noise folds over the border; a border that still crosses afterwards is reported by the triangulation.
    """
    graph = coo_array((np.ones(2 * len(edges)), (edges.T.reshape(-1), edges[:, ::-1].T.reshape(-1)))).tocsr()
    degree = np.maximum(np.diff(graph.indptr), 1)
    for _ in range(100):
        knots = _crossing(xy, edges)
        if len(knots) == 0:
            return
        near = np.zeros(len(xy))
        near[np.unique(edges[knots])] = 1
        near = (near + graph @ near) > 0
        centroid = (graph @ xy) / degree[:, None]
        xy[near] += 0.5 * (centroid - xy)[near]


def _crossing(xy: Array, edges: Array) -> Array:
    """Return the border edges that cross another one (sharing a vertex is no crossing)."""
    a, b = xy[edges[:, 0]], xy[edges[:, 1]]
    low, high = np.minimum(a, b), np.maximum(a, b)
    order = np.argsort(low[:, 0])
    last = np.searchsorted(low[order, 0], high[order, 0], side="right")
    counts = np.maximum(last - np.arange(len(order)) - 1, 0)
    bad: set[int] = set()
    start = 0
    while start < len(order):
        # Pairs are taken in blocks of a bounded number, whatever the border's length.
        stop = max(start + 1, int(np.searchsorted(np.cumsum(counts[start:]), 4_000_000)) + start)
        i = np.repeat(np.arange(start, min(stop, len(order))), counts[start:stop])
        begin = np.repeat(np.cumsum(counts[start:stop]) - counts[start:stop], counts[start:stop])
        j = i + 1 + np.arange(len(i)) - begin
        p, q = order[i], order[j]
        overlap = (low[p, 1] <= high[q, 1]) & (low[q, 1] <= high[p, 1])
        p, q = p[overlap], q[overlap]
        shared = (edges[p][:, :, None] == edges[q][:, None, :]).any(axis=(1, 2))
        p, q = p[~shared], q[~shared]
        d1, d2 = _side(a[p], b[p], a[q]), _side(a[p], b[p], b[q])
        d3, d4 = _side(a[q], b[q], a[p]), _side(a[q], b[q], b[p])
        hit = (d1 * d2 <= 0) & (d3 * d4 <= 0)
        bad.update(p[hit].tolist())
        bad.update(q[hit].tolist())
        start = stop
    return np.array(sorted(bad), int)


def _side(a: Array, b: Array, c: Array) -> Array:
    return np.sign(turn(b - a, c - a))
