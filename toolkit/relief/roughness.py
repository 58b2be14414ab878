"""Roughness of fillings by wavelength and by distance from the rim, against what surrounds them.

A measure that no completion optimises: distributions of heights may agree to a thousandth while a filling's middle is smooth.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.mesh import unique_edges, used_vertices, vertex_normals
from intaglio.relief.fillings import Filling, restrict
from intaglio.relief.ground import smooth_over_surface

# The bands lie between surfaces smoothed over so many spacings: waves of up to 5, 5 to 10, and 10 to 20.
BANDS = (5.0, 10.0, 20.0)
RINGS = 3
# The surroundings reach this share of the filling's radius beyond its rim, and at least so many spacings.
_BESIDE, _LEAST_BESIDE = 0.5, 5.0
# The mesh that is smoothed reaches so many spacings further, where its cut edge is no longer felt.
_MARGIN = 10.0
# A ring of fewer vertices has no roughness to speak of.
_LEAST = 10
# Area of a vertex in squared spacings where triangles are equilateral.
_VERTEX_AREA = 0.87
# Below this share of the spacing nothing is rough.
_FLAT = 1e-4
# Vertices that are smoothed at once; of more, so many nearest of two places in every ring are.
_AT_ONCE, _SAMPLED = 40_000, 8000
# Vertices that are smoothed in all, apart from the largest filling's.
_IN_ALL = 200_000


@dataclass(frozen=True)
class Roughness:
    """Roughness of fillings in the order given.

    Attributes
    ----------
    ratio : (K, 3, 3) array
        Root mean square of filling k, band b, ring r, over that of the surroundings; NaN where it was not measured.
    around : (K, 3) array
        Root mean square of the surroundings' bands, in the input's unit.
    count : (K, 3) array
        Vertices in every ring.
    skipped : int
        Fillings that were not measured because larger ones took the time.
    """

    ratio: Array
    around: Array
    count: Array
    skipped: int

    @property
    def whole(self) -> Array:
        """Return the ratios (3, 3) of all fillings together: root mean squares over their vertices."""
        known = np.isfinite(self.ratio)
        weight = np.where(known, self.count[:, None, :], 0)
        square = (weight * np.where(known, self.ratio, 0) ** 2).sum(axis=0)
        total = weight.sum(axis=0)
        return np.sqrt(np.divide(square, total, out=np.full(total.shape, np.nan), where=total > 0))

    @property
    def few(self) -> Array:
        """Return for which ratios (3, 3) of all fillings together hardly one wave of the band fits into the ring."""
        known = np.isfinite(self.ratio)
        vertices = np.where(known, self.count[:, None, :], 0).sum(axis=0)
        return np.asarray(vertices < np.square(BANDS)[:, None] / _VERTEX_AREA)


def measure_roughness(points: Array, faces: Array, measured: Array, fillings: list[Filling]) -> Roughness:
    """Return how rough the fillings of a mesh of points (N, 3) and faces (F, 3) are against their surroundings.

    Bands are differences of surfaces that are smoothed more and more, along the normal. Rings are thirds of the way from the rim
    to the vertex farthest from it, over the mesh. Surroundings are measured vertices up to half a radius beyond the rim; all of
    them where half as many vertices were filled as measured, or more.
    """
    ratio = np.full((len(fillings), len(BANDS), RINGS), np.nan)
    around, count = np.full((len(fillings), len(BANDS)), np.nan), np.zeros((len(fillings), RINGS), int)
    used = used_vertices(faces, len(points))
    scanned = int((used & measured).sum())
    left, skipped = _IN_ALL, 0
    for k, filling in enumerate(fillings):
        if len(filling.vertices) < _LEAST or len(filling.rim) == 0 or filling.spacing == 0:
            continue
        if left < 0:
            skipped += 1
            continue
        reach = max(_BESIDE * filling.radius, _LEAST_BESIDE * filling.spacing)
        if 2 * len(filling.vertices) >= scanned:
            reach = np.inf
        ratio[k], around[k], count[k], smoothed = _measure_filling(points, faces, measured, filling, used, reach)
        left -= smoothed
    return Roughness(ratio, around, count, skipped)


def _measure_filling(
    points: Array, faces: Array, measured: Array, filling: Filling, used: Array, reach: float
) -> tuple[Array, Array, list[int], int]:
    """Return ratios (3, 3), surroundings (3,), vertices of the rings (3,), and the number of vertices that it took."""
    vertices, near, inside, distance = _surrounded(points, faces, filling, used, reach)
    ring = np.minimum(distance[inside] / distance[inside].max() * RINGS, RINGS - 1).astype(int)
    rings = [np.flatnonzero(inside)[ring == r] for r in range(RINGS)]
    parts = [*rings, np.flatnonzero(measured[vertices] & (distance <= reach))]
    band = _bands_at(points[vertices], near, filling.spacing, parts)
    rough = np.sqrt([_mean_square(band[part]) for part in parts])
    flat = _FLAT * filling.spacing
    # Where both are flat there is nothing to compare, and where only the surroundings are, nothing to divide by.
    ratio = np.where(np.maximum(rough[:-1], rough[-1]) > flat, rough[:-1] / np.maximum(rough[-1], flat), np.nan).T
    return ratio, rough[-1], [len(part) for part in rings], len(vertices)


def surface_bands(points: Array, faces: Array, spacing: float) -> Array:
    """Return how far points (N, 3) stand off their surface (N, 3) in waves of up to 5 spacings, 5 to 10, and 10 to 20."""
    smooth = [points] + [smooth_over_surface(points, points, faces, length * spacing) for length in BANDS]
    normal = vertex_normals(smooth[2], faces)
    return np.stack([np.einsum("ij,ij->i", a - b, normal) for a, b in pairwise(smooth)], axis=1)


def _surrounded(points: Array, faces: Array, filling: Filling, used: Array, reach: float) -> tuple[Array, Array, Array, Array]:
    """Return the mesh of a filling and what is around it.

    Returns
    -------
    vertices : (M,) int array
        Their numbers in the whole mesh, those up to ``reach`` and a margin beyond the rim.
    faces : (G, 3) array
        The triangles among them.
    inside : (M,) bool array
        Which of them the filling is.
    distance : (M,) array
        From the rim, over edges.
    """
    margin = _MARGIN * filling.spacing
    keep = used
    if np.isfinite(reach):
        # In a straight line nothing is farther than over the surface.
        keep = used & (np.linalg.norm(points - filling.center, axis=1) <= filling.radius + reach + margin)
    vertices, local = restrict(faces, keep)
    edges = unique_edges(local)
    length = np.linalg.norm(points[vertices[edges[:, 0]]] - points[vertices[edges[:, 1]]], axis=1)
    graph = csr_array((np.maximum(length, 1e-300), (edges[:, 0], edges[:, 1])), shape=(len(vertices), len(vertices)))
    distance = dijkstra(graph, directed=False, indices=np.searchsorted(vertices, filling.rim), min_only=True)
    inside = np.zeros(len(vertices), bool)
    inside[np.searchsorted(vertices, filling.vertices)] = True
    near = inside | (distance <= reach + margin) if np.isfinite(reach) else np.isfinite(distance)
    kept, local = restrict(local, near)
    return vertices[kept], local, inside[kept], distance[kept]


def _bands_at(points: Array, faces: Array, spacing: float, parts: list[Array]) -> Array:
    """Return the bands (N, 3) of a mesh; of a large one only around two places in each of the parts, and NaN elsewhere."""
    if len(points) <= _AT_ONCE:
        return surface_bands(points, faces, spacing)
    band = np.full((len(points), len(BANDS)), np.nan)
    tree = cKDTree(points)
    for part in parts:
        if len(part) == 0:
            continue
        along = part[np.argsort(points[part, np.ptp(points[part], axis=0).argmax()], kind="stable")]
        for place in along[[len(along) // 4, 3 * len(along) // 4]]:
            distance, near = tree.query(points[place], _SAMPLED)
            keep = np.zeros(len(points), bool)
            keep[near] = True
            vertices, inner = restrict(faces, keep)
            core = near[distance <= distance[-1] - _MARGIN * spacing]
            found = surface_bands(points[vertices], inner, spacing)
            band[core] = found[np.searchsorted(vertices, core)]
    return band


def _mean_square(band: Array) -> Array:
    """Return the mean squares (3,) of a ring's bands, NaN where too few vertices were looked at."""
    seen = band[np.isfinite(band).all(axis=1)]
    return (seen**2).mean(axis=0) if len(seen) >= _LEAST else np.full(len(BANDS), np.nan)
