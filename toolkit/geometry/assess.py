"""Measures of extended geometry textures: spread of samples, holes, normals, steps at patch borders, connected pieces."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from intaglio.geometry.point_set import PointSet

Array = np.ndarray

# Neighbours of one surface have normals this alike (cosine).
_ALIKE = 0.5
_SECTORS = 6


def nearest_distances(points: PointSet) -> Array:
    """Return the distance (N,) of every point to the nearest other."""
    distance, _ = cKDTree(points.points).query(points.points, 2)
    return distance[:, 1]


def pieces_of(points: PointSet, reach: float) -> Array:
    """Return the number of the connected piece of each point: neighbours within ``reach`` whose normals agree are joined.

    Two threads that touch face each other there, so they stay apart.
    """
    pairs = cKDTree(points.points).query_pairs(reach, output_type="ndarray")
    alike = (points.normals[pairs[:, 0]] * points.normals[pairs[:, 1]]).sum(axis=1) > _ALIKE
    pairs = pairs[alike]
    graph = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    return connected_components(graph, directed=False)[1]


def hole_widths(points: PointSet, reach: float) -> Array:
    """Return for each point (N,) how far the surface is empty in the emptiest of six sectors about it, at most ``reach``.

    Neighbours are laid in the tangent plane; what faces away is another surface. At a border the sector stays empty: the
    value is ``reach`` there.
    """
    tree = cKDTree(points.points)
    widest = np.empty(len(points))
    for begin in range(0, len(points), 20_000):
        part = slice(begin, begin + 20_000)
        here, normal = points.points[part], points.normals[part]
        distance, index = tree.query(here, 48, distance_upper_bound=reach)
        found = np.isfinite(distance)
        found[:, 0] = False
        index = np.where(found, index, 0)
        found &= (points.normals[index] * normal[:, None]).sum(axis=2) > 0
        side = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.9, [1.0, 0, 0], [0, 1.0, 0]))
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        away = points.points[index] - here[:, None]
        angle = np.arctan2((away * np.cross(normal, side)[:, None]).sum(axis=2), (away * side[:, None]).sum(axis=2))
        emptiest = np.zeros(len(here))
        # Sectors overlap by half, so that no gap hides at a sector's edge.
        for k in range(2 * _SECTORS):
            middle = np.pi * k / _SECTORS
            within = np.abs((angle - middle + np.pi) % (2 * np.pi) - np.pi) <= np.pi / _SECTORS
            emptiest = np.maximum(emptiest, np.where(found & within, distance, reach).min(axis=1))
        widest[part] = emptiest
    return widest
