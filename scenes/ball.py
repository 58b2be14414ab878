"""The dimpled ball that the golf ball scenes scan: made here, so that its whole surface is known."""

from __future__ import annotations

import numpy as np
import trimesh

from intaglio.mesh import Surface

RADIUS = 21.35  # mm, half the least diameter that the rules of golf allow
DEPTH = 0.25  # mm


def dimple_centers(frequency: int) -> np.ndarray:
    """Return unit vectors (10 frequency^2 + 2, 3): a triangular lattice on the faces of an icosahedron."""
    solid = trimesh.creation.icosahedron()
    points = []
    for a, b, c in solid.vertices[solid.faces]:
        for i in range(frequency + 1):
            for j in range(frequency + 1 - i):
                points.append((i * a + j * b + (frequency - i - j) * c) / frequency)
    unit = np.array(points) / np.linalg.norm(points, axis=1, keepdims=True)
    return unit[np.unique(np.round(unit, 6), axis=0, return_index=True)[1]]


def ball(frequency: int = 4, subdivisions: int = 7, coverage: float = 0.86) -> Surface:
    """Return a dimpled ball, watertight, in millimetres.

    Parameters
    ----------
    frequency : int
        3, 4 and 5 give 92, 162 and 252 dimples.
    subdivisions : int
        Of the icosphere: 6 gives 40,962 vertices, 7 gives 163,842.
    coverage : float
        Dimple diameter over the distance to the nearest neighbour.
    """
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    centers = dimple_centers(frequency)
    gaps = np.sort(np.arccos(np.clip(centers @ centers.T, -1, 1)), axis=1)[:, 1]
    radius = 0.5 * coverage * gaps.min()
    chord, _ = _nearest(centers, np.asarray(sphere.vertices))
    angle = 2 * np.arcsin(np.clip(chord / 2, 0, 1))
    # A cap whose rim is a little rounded.
    depth = DEPTH * np.clip(1 - (angle / radius) ** 2, 0, 1) ** 1.2
    return Surface(vertices=sphere.vertices * (RADIUS - depth)[:, None], faces=np.asarray(sphere.faces))


def _nearest(points: np.ndarray, queries: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    from scipy.spatial import cKDTree

    return cKDTree(points).query(queries)
