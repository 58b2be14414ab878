"""Normals of points: estimated from neighbours and turned to one side."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from intaglio.errors import InputError

Array = np.ndarray

# Neighbours a plane is fitted to, and those along which sides are handed on.
_PLANE, _GRAPH = 12, 8
# Share of points with another layer below or above from which a swatch is no height field.
_LAYERED = 0.05
# Share of normals that point down from which it is none.
_DOWN = 0.01
_AT_ONCE = 50_000


def estimate_normals(points: Array, axis: int, spacing: float) -> tuple[Array, str]:
    """Return unit normals (N, 3) of points without, turned consistently, and a note on how.

    Planes are fitted to the twelve nearest neighbours. On a height field all normals are turned up along ``axis``.
    Elsewhere sides are handed on from neighbour to neighbour along a minimum spanning tree of the angles between their
    planes (Hoppe et al. 1992, by SciPy's sparse graph routines); of a connected piece the outside is where its volume is
    positive, or up where it is an open sheet.

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
    neighbours = np.empty((len(points), _GRAPH), np.int64)
    for begin in range(0, len(points), _AT_ONCE):
        part = slice(begin, begin + _AT_ONCE)
        _, index = tree.query(points[part], _PLANE + 1)
        around = points[index]
        around = around - around.mean(axis=1, keepdims=True)
        normals[part] = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))[1][:, :, 0]
        neighbours[part] = index[:, 1 : _GRAPH + 1]
    if is_height_field(points, axis, spacing):
        normals[normals[:, axis] < 0] *= -1
        return normals, "normals were estimated and turned up along the height axis: the swatch is a height field"
    _hand_on_sides(points, normals, neighbours, axis)
    return normals, "normals were estimated and turned from neighbour to neighbour; check that none point inwards"


def is_height_field(points: Array, axis: int, spacing: float, normals: Array | None = None) -> bool:
    """Return whether (nearly) no vertical line meets two layers of points, and no normals point down where there are any."""
    if normals is not None and (normals[:, axis] < -0.1).mean() > _DOWN:
        return False
    plane = [(axis + 1) % 3, (axis + 2) % 3]
    columns = np.floor(points[:, plane] / (0.7 * spacing)).astype(np.int64)
    _, column = np.unique(columns, axis=0, return_inverse=True)
    column = column.reshape(-1)
    order = np.lexsort((points[:, axis], column))
    step = np.diff(points[order, axis])
    same = np.diff(column[order]) == 0
    # On one surface the heights of a column follow one another by about the distance of samples, also where it is steep.
    layered = np.zeros(column.max() + 1, bool)
    layered[column[order][1:][same & (step > 3 * spacing)]] = True
    return bool(layered.mean() < _LAYERED)


def _hand_on_sides(points: Array, normals: Array, neighbours: Array, axis: int) -> None:
    """Turn ``normals`` so that neighbours agree, in place."""
    count = len(points)
    rows = np.repeat(np.arange(count), _GRAPH)
    columns = neighbours.ravel()
    # A weight of 0 would be no edge.
    weight = 1.0001 - np.abs((normals[rows] * normals[columns]).sum(axis=1))
    graph = coo_array((weight, (rows, columns)), shape=(count, count)).tocsr()
    tree = minimum_spanning_tree(graph)
    pieces, label = connected_components(tree, directed=False)
    for piece in range(pieces):
        members = np.flatnonzero(label == piece)
        order, before = breadth_first_order(tree, members[0], directed=False)
        agree = np.ones(count, bool)
        agree[order[1:]] = (normals[order[1:]] * normals[before[order[1:]]]).sum(axis=1) >= 0
        turned = np.zeros(count, bool)
        for node in order[1:]:
            turned[node] = turned[before[node]] != (not agree[node])
        normals[turned] *= -1
        up = normals[members, axis].mean()
        volume = ((points[members] - points[members].mean(axis=0)) * normals[members]).sum(axis=1).mean()
        if (up if abs(up) > 0.3 else volume) < 0:
            normals[members] *= -1
