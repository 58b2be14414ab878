"""The filled regions of a completed surface, one for each hole, and the mesh around them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array
from intaglio.mesh import Surface, unique_edges, used_vertices


@dataclass(frozen=True)
class Filling:
    """One filled region.

    Attributes
    ----------
    vertices : (K,) int array
        Its filled vertices.
    rim : (R,) int array
        The measured vertices beside them; none where a piece was made up as a whole.
    center : (3,) array
        Mean of the filled vertices.
    radius : float
        Distance from there to the farthest vertex of filling and rim.
    spacing : float
        Mean length of the edges that end in the filling.
    """

    vertices: Array
    rim: Array
    center: Array
    radius: float
    spacing: float


def list_fillings(surface: Surface, edges: Array | None = None) -> list[Filling]:
    """Return the filled regions, those of most vertices first; ``edges`` are the surface's unique ones if they are known."""
    count = len(surface.vertices)
    edges = unique_edges(surface.faces) if edges is None else edges
    filled = used_vertices(surface.faces, count) & ~surface.measured
    if not filled.any():
        return []
    ends = filled[edges]
    number = _number_regions(edges[ends.all(axis=1)], filled)
    touching = edges[ends.any(axis=1)]
    region = number[touching].max(axis=1)
    length = np.linalg.norm(surface.vertices[touching[:, 0]] - surface.vertices[touching[:, 1]], axis=1)
    spacing = np.bincount(region, length) / np.bincount(region)
    # Region by region: the filled vertices, and with them the measured ends of edges that leave the filling.
    inside = np.flatnonzero(filled)
    inside = inside[np.argsort(number[inside], kind="stable")]
    sizes = np.bincount(number[inside])
    measured_end = touching[np.arange(len(touching)), filled[touching].argmin(axis=1)]
    crossing = ~filled[measured_end]
    pairs = np.unique(np.column_stack([region[crossing], measured_end[crossing]]), axis=0)
    rims = np.split(pairs[:, 1], np.searchsorted(pairs[:, 0], np.arange(1, len(sizes))))
    found = []
    for k, vertices in enumerate(np.split(inside, np.cumsum(sizes)[:-1])):
        points = surface.vertices[vertices]
        center = points.mean(axis=0)
        reach = np.linalg.norm(np.concatenate([points, surface.vertices[rims[k]]]) - center, axis=1).max()
        found.append(Filling(vertices, rims[k], center, float(reach), float(spacing[k])))
    return sorted(found, key=lambda filling: len(filling.vertices), reverse=True)


def _number_regions(edges: Array, filled: Array) -> Array:
    """Return the number (N,) of the region, joined by ``edges``, that every filled vertex lies in; -1 elsewhere."""
    count = len(filled)
    graph = coo_array((np.ones(len(edges), bool), (edges[:, 0], edges[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    _, region = np.unique(label[filled], return_inverse=True)
    number = np.full(count, -1)
    number[filled] = region
    return number


def restrict(faces: Array, keep: Array) -> tuple[Array, Array]:
    """Return the numbers (K,) of the kept vertices, and the faces among them in the numbering that they then have."""
    renumber = np.cumsum(keep) - 1
    return np.flatnonzero(keep), renumber[faces[keep[faces].all(axis=1)]]
