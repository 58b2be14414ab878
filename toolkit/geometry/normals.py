"""Normals of points: estimated from neighbours and turned to one side."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.geometry.point_set import plane_axes

# Neighbours a plane is fitted to, and those along which sides are propagated.
_PLANE, _GRAPH, _AROUND = 12, 8, 24
# Share of points with another layer below or above from which a swatch is not a height field.
_LAYERED = 0.05
# Share of downward normals from which a swatch is not a height field.
_DOWN = 0.01
# Least likeness of neighbours along which sides are propagated.
_UNLIKE = 0.25
# Neighbours that lie so much along a normal (cosine) are of another surface.
_ACROSS = 0.55
# A piece that bends away from its neighbours by this many distances of samples, on average, is a thread.
_THIN = 0.1
# Pieces of fewer points take their side from those around them, in at most so many rounds.
_FEWEST, _ROUNDS = 12, 50
_AT_ONCE = 50_000


def estimate_normals(points: Array, axis: int, spacing: float) -> tuple[Array, str]:
    """Return unit normals (N, 3) of points without, turned consistently, and a note on how.

    Planes are fitted to the twelve nearest neighbours. On a height field all normals are turned up along ``axis``.
    Elsewhere sides are handed on from neighbour to neighbour along a minimum spanning tree of the angles between their
    planes (Hoppe et al. 1992, by SciPy's sparse graph routines), leaving out at first where another surface is near. The
    outside of a piece is the convex side of a thread, else where it faces up, else where its volume is positive. Where
    threads touch, some of the normals remain wrong (about one in twenty points of a tight weave).

    Parameters
    ----------
    points : (N, 3) array
        At least thirteen.
    axis : int
        The height axis.
    spacing : float
        Distance of samples.

    Raises
    ------
    InputError
        If there are too few points.
    """
    if len(points) <= _PLANE:
        raise InputError(f"{len(points)} points without normals are too few to estimate them: at least {_PLANE + 1} are needed")
    tree = cKDTree(points)
    normals = np.empty_like(points)
    around_count = min(_AROUND, len(points) - 1)
    neighbors = np.empty((len(points), around_count), np.int64)
    for begin in range(0, len(points), _AT_ONCE):
        part = slice(begin, begin + _AT_ONCE)
        _, index = tree.query(points[part], around_count + 1)
        around = points[index[:, : _PLANE + 1]]
        around = around - around.mean(axis=1, keepdims=True)
        normals[part] = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))[1][:, :, 0]
        neighbors[part] = index[:, 1:]
    if is_height_field(points, axis, spacing):
        normals[normals[:, axis] < 0] *= -1
        return normals, "normals were estimated and turned up along the height axis: the swatch is a height field"
    _propagate_sides(points, normals, neighbors, axis, spacing)
    return normals, "normals were estimated and turned from neighbour to neighbour; check that none point inwards"


def is_height_field(points: Array, axis: int, spacing: float, normals: Array | None = None) -> bool:
    """Return whether (nearly) no vertical line meets two layers of points, and no normals point down where there are any."""
    if normals is not None and (normals[:, axis] < -0.1).mean() > _DOWN:
        return False
    plane = list(plane_axes(axis))
    columns = np.floor(points[:, plane] / (0.7 * spacing)).astype(np.int64)
    _, column = np.unique(columns, axis=0, return_inverse=True)
    column = column.reshape(-1)
    order = np.lexsort((points[:, axis], column))
    step = np.diff(points[order, axis])
    same = np.diff(column[order]) == 0
    # On one surface the heights of a column follow one another by about the distance of samples, also where it is steep.
    layered = np.zeros(column.max() + 1, bool)
    layered[column[order][1:][same & (step > 1.5 * spacing)]] = True
    return bool(layered.mean() < _LAYERED)


def _propagate_sides(points: Array, normals: Array, neighbors: Array, axis: int, spacing: float) -> None:
    """Turn ``normals`` so that neighbours agree, in place.

    Points near another surface are left out at first: sides would be handed on from one thread to the next there.
    """
    count = len(points)
    rows = np.repeat(np.arange(count), _GRAPH)
    columns = neighbors[:, :_GRAPH].ravel()
    along = points[columns] - points[rows]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    # Neighbours across a gap lie along each other's normals; on one surface they lie beside each other.
    across = np.maximum(np.abs((along * normals[rows]).sum(axis=1)), np.abs((along * normals[columns]).sum(axis=1)))
    likeness = np.abs((normals[rows] * normals[columns]).sum(axis=1)) * (1 - across)
    crowded = np.zeros(count, bool)
    crowded[rows[across > _ACROSS]] = True
    crowded[columns[across > _ACROSS]] = True
    clear = (likeness > _UNLIKE) & ~crowded[rows] & ~crowded[columns]
    # Weights are above 0, which would mean no edge.
    weights = (1.0001 - likeness[clear], (rows[clear], columns[clear]))
    tree = minimum_spanning_tree(coo_array(weights, shape=(count, count)).tocsr())
    _, label = connected_components(tree, directed=False)
    _turn_along(tree, label, normals)
    pieces = label.max() + 1
    size = np.bincount(label, minlength=pieces)

    def mean(value: Array) -> Array:
        return np.bincount(label, value, pieces) / size

    bend = (points - points[neighbors].mean(axis=1)) / spacing
    middle = np.stack([mean(points[:, k]) for k in range(3)], axis=1)
    outwards, up = mean((bend * normals).sum(axis=1)), mean(normals[:, axis])
    volume = mean(((points - middle[label]) * normals).sum(axis=1))
    # The convex side of a thread is outside; of a sheet, the side that faces up.
    side = np.where(np.abs(outwards) > _THIN, outwards, np.where(np.abs(up) > 0.3, up, volume))
    normals[side[label] < 0] *= -1
    _adopt_sides(normals, neighbors, points, (size >= _FEWEST)[label])


def _turn_along(tree: csr_array, label: Array, normals: Array) -> None:
    """Turn normals so that they agree along the edges of a forest, piece by piece, in place."""
    count = len(normals)
    first = np.unique(label, return_index=True)[1]
    # One more node, joined to every piece, makes it a tree that one search goes through.
    edges = coo_array(tree)
    rows = np.concatenate([edges.coords[0], np.full(len(first), count)])
    columns = np.concatenate([edges.coords[1], first])
    whole = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count + 1, count + 1)).tocsr()
    reached, before = breadth_first_order(whole, count, directed=False)
    reached = reached[1:]
    parents = before[reached]
    below_root = parents == count
    parents = np.where(below_root, reached, parents)
    agree = (below_root | ((normals[reached] * normals[parents]).sum(axis=1) >= 0)).tolist()
    turned = [False] * count
    for node, parent, same in zip(reached.tolist(), parents.tolist(), agree, strict=True):
        turned[node] = turned[parent] != (not same)
    normals[turned] *= -1


def _adopt_sides(normals: Array, neighbors: Array, points: Array, settled: Array) -> None:
    """Turn the remaining normals like those of settled neighbours on the same surface, outwards from these, in place."""
    for _ in range(_ROUNDS):
        left = np.flatnonzero(~settled)
        near = neighbors[left]
        along = points[near] - points[left, None]
        along /= np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-300)
        product = (normals[near] * normals[left, None]).sum(axis=2)
        beside = 1 - np.abs((along * normals[left, None]).sum(axis=2))
        vote = (product * beside**2 * settled[near]).sum(axis=1)
        reached = vote != 0
        if not reached.any():
            return
        normals[left[reached & (vote < 0)]] *= -1
        settled[left[reached]] = True
