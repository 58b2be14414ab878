"""Polygons and triangle strips of mesh files as triangles."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array


def polygon_triangles(counts: Array, vertices: Array, points: Array) -> Array:
    """Return triangles over the corners of polygons.

    A quadrangle is cut along the diagonal that leaves both halves facing as it does, the shorter one if both do; a polygon of
    more corners from its first corner if it is convex, else by cutting off ears.

    Parameters
    ----------
    counts : (P,) int array
        How many corners every polygon has; those of fewer than three give nothing.
    vertices : (K,) int array
        The polygons' vertices one after the other, K = sum of ``counts``.
    points : (N, 3) array
        Positions of the vertices.

    Returns
    -------
    (F, 3) int64 array
        Numbers of corners, that is places in ``vertices``, polygon by polygon.
    """
    start = np.cumsum(counts) - counts
    parts, owners = [], []
    for size in np.unique(counts[counts >= 3]).tolist():
        which = np.flatnonzero(counts == size)
        corners = start[which, None] + np.arange(size)
        triangles = _cut(corners, points[vertices[corners]]) if size > 3 else corners[:, None]
        parts.append(triangles.reshape(-1, 3))
        owners.append(np.repeat(which, size - 2))
    if not parts:
        return np.zeros((0, 3), np.int64)
    order = np.argsort(np.concatenate(owners), kind="stable")
    return np.asarray(np.concatenate(parts)[order])


def strip_triangles(strip: Array) -> Array:
    """Return the triangles (F, 3) of triangle strips: vertices in a row (K,), with -1 between one strip and the next.

    The winding alternates; triangles that name a vertex twice, by which strips turn, are left out.
    """
    ends = strip < 0
    # Number of every vertex in its own strip.
    since = np.arange(len(strip)) - np.maximum.accumulate(np.where(ends, np.arange(len(strip)) + 1, 0))
    at = np.flatnonzero(~(ends[:-2] | ends[1:-1] | ends[2:])) if len(strip) > 2 else np.zeros(0, np.int64)
    odd = since[at] % 2 == 1
    faces = np.stack([strip[at + odd], strip[at + ~odd], strip[at + 2]], axis=1)
    return np.asarray(faces[~(faces == np.roll(faces, 1, axis=1)).any(axis=1)])


def _cut(corners: Array, points: Array) -> Array:
    """Return the triangles (P, size - 2, 3) of polygons of one size, from corners (P, size) and their points (P, size, 3)."""
    size = corners.shape[1]
    edges = np.roll(points, -1, axis=1) - points
    # Newell's normal, which is right for polygons that are neither flat nor convex.
    normal = np.cross(points - points[:, :1], np.roll(points, -1, axis=1) - points[:, :1]).sum(axis=1)
    turns = np.einsum("pkj,pj->pk", np.cross(np.roll(edges, 1, axis=1), edges), normal)
    with np.errstate(invalid="ignore"):
        reflex = turns < 0
    fan = np.stack([np.zeros(size - 2, int), np.arange(1, size - 1), np.arange(2, size)], axis=1)
    out = corners[:, fan]
    if size == 4:
        # A diagonal from a reflex corner is the only one inside; without one the shorter is taken.
        lengths = [np.linalg.norm(points[:, k] - points[:, k + 2], axis=1) for k in (0, 1)]
        other = (lengths[1] < lengths[0]) & ~reflex.any(axis=1) | reflex[:, 1] | reflex[:, 3]
        out[other] = corners[other][:, [[1, 2, 3], [1, 3, 0]]]
        return np.asarray(out)
    for p in np.flatnonzero(reflex.any(axis=1)).tolist():
        out[p] = corners[p][_ears(points[p], normal[p])]
    return np.asarray(out)


def _ears(points: Array, normal: Array) -> Array:
    """Return the triangles (size - 2, 3) of one polygon that is not convex."""
    drop = int(np.argmax(np.abs(normal)))
    flat = np.delete(points, drop, axis=1)
    if (normal[drop] < 0) != (drop == 1):
        flat = flat[:, ::-1]

    def area(a: int, b: int, c: int) -> float:
        u, v = flat[b] - flat[a], flat[c] - flat[a]
        return float(u[0] * v[1] - u[1] * v[0])

    left, out = list(range(len(points))), []
    while len(left) > 3:
        for i in range(len(left)):
            a, b, c = left[i - 1], left[i], left[(i + 1) % len(left)]
            if area(a, b, c) <= 0:
                continue
            others = [o for o in left if o not in (a, b, c)]
            if not any(min(area(a, b, o), area(b, c, o), area(c, a, o)) >= 0 for o in others):
                break
        else:
            # A polygon that crosses itself has no ear; any corner will do.
            a, b, c, i = left[0], left[1], left[2], 1
        out.append((a, b, c))
        del left[i]
    return np.array([*out, tuple(left)])
