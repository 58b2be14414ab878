"""Distances of samples: measuring them, and thinning dense samples to an even spread."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.randomness import Stream, uniform

# Poisson disks of radius r leave about one sample on an area of (1.28 r)².
RADIUS = 1 / 1.28

_FIRST, _NEIGHBOURS = 4, 12
# Random samples for each one that is kept.
_DENSE = 8
# Samples of a mesh where no spacing is given.
_USUAL = 50_000
# The most samples; more would take more than a few GiB to spread.
_MOST = 2e6
# The most samples whose spacing is measured; more would only cost time.
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
    last = min(_NEIGHBOURS, distance.shape[1])
    number = np.arange(min(_FIRST, last), last + 1)
    # A disc about a sample whose border meets its k-th neighbour holds about k + 1/2 samples; several k, as on a lattice
    # many lie equally far.
    found = distance[:, number - 1] * np.sqrt(np.pi / (number + 0.5))
    count = np.isfinite(found).sum(axis=1)
    # Too few neighbours on its side: an edge of the swatch, or a stray point.
    return np.where(count > 0, np.where(np.isfinite(found), found, 0).sum(axis=1) / np.maximum(count, 1), np.inf)


def usual_nearest(points: Array) -> float:
    """Return the median distance of nearest neighbours, of an even choice of 20,000 points if there are more."""
    chosen = np.linspace(0, len(points) - 1, min(len(points), _MEASURED)).astype(int)
    return float(np.median(cKDTree(points).query(points[chosen], 2)[0][:, 1]))


def thin_points(points: Array, normals: Array, radius: float, seed: int = 0) -> Array:
    """Return the indices of a Poisson-disk sample: no two on one side are nearer than ``radius``, and hardly any more fit.

    Points are taken in random order, all that are first among their undecided neighbours at once, which is what taking them
    one by one gives.
    """
    rank = np.argsort(np.argsort(uniform(seed, Stream.POINTS_THINNING, np.arange(len(points))), kind="stable"))
    every = _first_in_cells(points, normals, radius / 3, rank)
    points, normals, rank = points[every], normals[every], rank[every]
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
    return every[state != -1]


def _first_in_cells(points: Array, normals: Array, side: float, rank: Array) -> Array:
    """Return the index of the first by rank in each small cell and octant of the normal, to which all others are too near."""
    cell = np.floor((points - points.min(axis=0, initial=0)) / side).astype(np.int64)
    octant = (normals > 0) @ np.array([1, 2, 4])
    order = np.lexsort((rank, octant, cell[:, 2], cell[:, 1], cell[:, 0]))
    keys = np.concatenate([cell, octant[:, None]], axis=1)[order]
    first = np.concatenate([[True], (np.diff(keys, axis=0) != 0).any(axis=1)]) if len(order) else np.zeros(0, bool)
    return np.sort(order[first])


def sample_triangles(vertices: Array, faces: Array, spacing: float | None, seed: int) -> tuple[Array, Array, Array, Array]:
    """Return points (K, 3), normals (K, 3), faces (K,) and barycentric weights (K, 3) spread evenly over triangles.

    Random samples, eight for each one wanted, thinned to Poisson disks.

    Raises
    ------
    InputError
        If the triangles have no area, or ``spacing`` asks for more than two million samples.
    """
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(cross, axis=1)
    total = float(area.sum())
    if not total > 0:
        raise InputError("the mesh has no area: vertices and faces (or pixel) make no triangle that has one")
    spacing = np.sqrt(total / _USUAL) if spacing is None else spacing
    count = total / max(spacing**2, 1e-300)
    if count > _MOST:
        raise InputError(
            f"spacing {spacing:g} asks for {count:.3g} samples of the mesh, at most {_MOST / 1e6:g} million; give a larger one"
        )
    number = np.arange(max(int(_DENSE * count), 1))
    # Stratified along the running area: as even as random places can be.
    where = (number + uniform(seed, Stream.POINTS_PLACES, number, 0)) / len(number) * total
    face = np.minimum(np.searchsorted(np.cumsum(area), where), len(faces) - 1)
    u, v = uniform(seed, Stream.POINTS_PLACES, number, 1), uniform(seed, Stream.POINTS_PLACES, number, 2)
    root = np.sqrt(u)
    weights = np.stack([1 - root, root * (1 - v), root * v], axis=1)
    points = np.einsum("nk,nkc->nc", weights, vertices[faces[face]])
    normals = cross[face] / (2 * np.maximum(area[face], 1e-300))[:, None]
    chosen = thin_points(points, normals, RADIUS * spacing, seed)
    return points[chosen], normals[chosen], face[chosen], weights[chosen]
