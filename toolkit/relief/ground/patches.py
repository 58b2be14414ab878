"""Filling a hole with triangles: a triangulation of least area over its rim, refined to the scan's density.

After P. Liepa, *Filling Holes in Meshes*, SGP 2003: triangulate the rim, refine, then make it fair
(`intaglio.relief.ground.filling`). Here only the connectivity and a first geometry come about.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.kernels.polygons import least_area_triangles
from intaglio.mesh import adjacency, border_edges, directed_edges, edge_keys, following, opposite_edges

# A longer rim is triangulated in two steps: the cost of one is its cube.
_LONGEST_RIM = 1000
# An edge is split when longer than this many spacings: halves are then no shorter than 0.7.
_SPLIT = 1.4
_MOST_ROUNDS = 60
_FLIP_SWEEPS = 12
_RELAXATIONS = 4


class RimError(Exception):
    """A rim that no triangulation closes without running through an edge twice."""


def triangulate_rim(vertices: Array, edge_table: Array, loops: list[Array], device: str) -> Array:
    """Return triangles (T, 3) over the vertices of one hole: its rim and the rims of islands in it.

    Parameters
    ----------
    vertices : (N, 3) array
        Of the scan.
    edge_table : (E,) sorted int64 array
        `edge_keys` of the scan's edges, the smaller vertex first.
    loops : list of (K,) int arrays
        Border loops as `find_holes` gives them; the first is the hole's rim, the others are islands'.

    Raises
    ------
    RimError
        Where no triangulation is possible.
    """
    polygon = loops[0][::-1]
    count = len(vertices)
    for island in loops[1:]:
        ring = island[::-1]
        distance, nearest = cKDTree(vertices[ring]).query(vertices[polygon])
        at = int(np.argmin(distance))
        j = int(nearest[at])
        if polygon[at] == ring[j]:
            polygon = np.concatenate([polygon[: at + 1], ring[j + 1 :], ring[: j + 1], polygon[at + 1 :]])
            continue
        # Joined by a bridge that is run through once each way.
        polygon = np.concatenate([polygon[: at + 1], ring[j:], ring[: j + 1], polygon[at:]])
        bridge = np.sort([polygon[at], ring[j]])
        edge_table = np.union1d(edge_table, edge_keys(bridge[None, :], count))
    if len(polygon) < 3:
        raise RimError("a rim of fewer than three edges")
    kept = _thin(polygon, vertices, edge_table, count)
    triangles = [polygon[kept[_best(polygon[kept], vertices, edge_table, count, device)]]]
    for first, last in zip(kept, np.append(kept[1:], len(polygon)), strict=True):
        if last - first > 1:
            chain = polygon[np.arange(first, last + 1) % len(polygon)]
            triangles.append(chain[_best(chain, vertices, edge_table, count, device)])
    found = np.concatenate(triangles)
    # A vertex that stands at two corners can be given one chord twice.
    _, times = np.unique(edge_keys(directed_edges(found), count), return_counts=True)
    sides = np.unique(np.sort(directed_edges(found), axis=1), axis=0, return_counts=True)[1]
    if times.max() > 1 or sides.max() > 2:
        raise RimError("its triangulation runs through an edge twice")
    return found


def _thin(polygon: Array, vertices: Array, edge_table: Array, count: int) -> Array:
    """Positions of the corners that a first triangulation of a long rim stands on."""
    size = len(polygon)
    step = -(-size // _LONGEST_RIM)
    if step == 1:
        return np.arange(size)
    repeated = np.bincount(polygon, minlength=count)[polygon] > 1
    kept = repeated.copy()
    kept[::step] = True
    while True:
        at = np.flatnonzero(kept)
        after = np.roll(at, -1)
        chord = np.sort(np.stack([polygon[at], polygon[after]], axis=1), axis=1)
        gap = (after - at) % size
        taken = (gap > 1) & _in_table(edge_keys(chord, count), edge_table)
        if not taken.any():
            return at
        for first, width in zip(at[taken], gap[taken], strict=True):
            kept[np.arange(first, first + width) % size] = True


def _best(polygon: Array, vertices: Array, edge_table: Array, count: int, device: str) -> Array:
    if len(polygon) == 3:
        return np.array([[0, 1, 2]])
    a, b = np.meshgrid(polygon, polygon, indexing="ij")
    pairs = np.stack([np.minimum(a, b), np.maximum(a, b)], axis=-1).reshape(-1, 2)
    barred = (_in_table(edge_keys(pairs, count), edge_table) | (pairs[:, 0] == pairs[:, 1])).reshape(a.shape)
    triangles = least_area_triangles(vertices[polygon], polygon, barred, device)
    if triangles is None:
        raise RimError("every triangulation of the rim runs through an edge of the scan twice")
    return triangles


def _in_table(keys: Array, table: Array) -> Array:
    if len(table) == 0:
        return np.zeros(len(keys), bool)
    return np.asarray(table[np.minimum(np.searchsorted(table, keys), len(table) - 1)] == keys)


def refine_patch(points: Array, faces: Array, spacing: float, barred: Array) -> tuple[Array, Array]:
    """Refine a patch until its inner edges are about ``spacing`` long; its rim stays as it is.

    Edges that are the longest of both their triangles are halved, then edges are flipped towards Delaunay's criterion and new
    vertices moved towards the middle of their neighbours.

    Parameters
    ----------
    points : (N, 3) array
        The rim's vertices and any inner ones.
    faces : (F, 3) int array
    spacing : float
        In the unit of ``points``.
    barred : (B,) sorted int64 array
        `edge_keys` (over N vertices) of pairs that must not be joined: edges of the scan outside the patch.

    Returns
    -------
    points, faces
        Earlier vertices first, in their order.
    """
    rim = np.unique(border_edges(faces))
    pairs = np.stack(np.divmod(barred, len(points)), axis=1)
    for _ in range(_MOST_ROUNDS):
        points, faces, split = _split(points, faces, _SPLIT * spacing)
        faces = _flip(points, faces, edge_keys(pairs, len(points)))
        if split == 0:
            break
    # Only now: vertices that moved between splits would crowd where edges are still long.
    moving = np.ones(len(points), bool)
    moving[rim] = False
    for _ in range(_RELAXATIONS):
        graph = adjacency(faces, len(points))
        degree = np.maximum(np.diff(graph.indptr), 1)[:, None]
        points = np.where(moving[:, None], 0.5 * (points + (graph @ points) / degree), points)
        faces = _flip(points, faces, edge_keys(pairs, len(points)))
    return points, faces


def _split(points: Array, faces: Array, longest: float) -> tuple[Array, Array, int]:
    """Halve every inner edge longer than ``longest`` that is the longest one of both its triangles."""
    edges = directed_edges(faces)
    opposite = opposite_edges(faces, len(points))
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    # A rim edge can't be split, and where it is the longest nothing is: beside a long one splits would never end. Among equals
    # the larger vertex numbers win, on both sides alike.
    low, high = edges.min(axis=1), edges.max(axis=1)
    order = np.lexsort([high, low, length])
    rank = np.empty(len(edges), np.int64)
    key = np.stack([length, low, high], axis=1)[order]
    rank[order] = np.cumsum(np.concatenate([[0], (np.diff(key, axis=0) != 0).any(axis=1)]))
    best = rank.reshape(-1, 3).argmax(axis=1) + 3 * np.arange(len(faces))
    chosen = np.zeros(len(edges), bool)
    chosen[best] = True
    chosen &= (length > longest) & (opposite >= 0)
    chosen &= chosen[opposite]
    first = np.flatnonzero(chosen & (np.arange(len(edges)) < opposite))
    if len(first) == 0:
        return points, faces, 0
    second = opposite[first]
    middle = len(points) + np.arange(len(first))
    added = points[edges[first]].mean(axis=1)
    parts = [np.delete(faces, np.concatenate([first, second]) // 3, axis=0)]
    for edge in (first, second):
        a, b = edges[edge].T
        apex = faces.reshape(-1)[following(following(edge))]
        parts += [np.stack([a, middle, apex], axis=1), np.stack([middle, b, apex], axis=1)]
    return np.concatenate([points, added]), np.concatenate(parts), len(first)


def _flip(points: Array, faces: Array, barred: Array) -> Array:
    """Flip inner edges whose opposite angles add to more than pi, until none is left or the sweeps are used up."""
    faces = faces.copy()
    count = len(points)
    for _ in range(_FLIP_SWEEPS):
        edges = directed_edges(faces)
        opposite = opposite_edges(faces, count)
        e = np.flatnonzero((opposite >= 0) & (np.arange(len(edges)) < opposite))
        o = opposite[e]
        a, b = edges[e].T
        corner = faces.reshape(-1)
        c, d = corner[following(following(e))], corner[following(following(o))]
        pa, pb, pc, pd = points[a], points[b], points[c], points[d]
        excess = _angle(pa - pc, pb - pc) + _angle(pa - pd, pb - pd) - np.pi
        old = np.cross(pb - pa, pc - pa) + np.cross(pa - pb, pd - pb)
        upright = (np.einsum("ij,ij->i", np.cross(pd - pc, pb - pc), old) > 0) & (
            np.einsum("ij,ij->i", np.cross(pc - pd, pa - pd), old) > 0
        )
        pair = edge_keys(np.sort(np.stack([c, d], axis=1), axis=1), count)
        present = np.sort(edge_keys(np.sort(edges, axis=1), count))
        good = (excess > 1e-6) & upright & (c != d) & ~_in_table(pair, present) & ~_in_table(pair, barred)
        e, o, a, b, c, d, excess, pair = (x[good] for x in (e, o, a, b, c, d, excess, pair))
        if len(e) == 0:
            break
        # Of a triangle's candidates the one with the largest excess; no two flips may make the same edge.
        order = np.lexsort([-e, excess])
        rank = np.empty(len(e), np.int64)
        rank[order] = np.arange(1, len(e) + 1)
        top = np.zeros(len(faces), np.int64)
        np.maximum.at(top, e // 3, rank)
        np.maximum.at(top, o // 3, rank)
        take = (top[e // 3] == rank) & (top[o // 3] == rank)
        keep = np.zeros(len(e), bool)
        keep[np.flatnonzero(take)[np.unique(pair[take], return_index=True)[1]]] = True
        e, o, a, b, c, d = (x[keep] for x in (e, o, a, b, c, d))
        faces[e // 3] = np.stack([c, d, b], axis=1)
        faces[o // 3] = np.stack([d, c, a], axis=1)
    return faces


def _angle(p: Array, q: Array) -> Array:
    """Angles (K,) between vectors (K, 3)."""
    return np.arctan2(np.linalg.norm(np.cross(p, q), axis=1), np.einsum("ij,ij->i", p, q))
