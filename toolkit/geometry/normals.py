"""Normals of points: estimated from neighbours and turned to one side."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.geometry.point_set import plane_axes
from intaglio.geometry.winding import turn_outwards

# Neighbours a plane is fitted to, and those along which sides are propagated.
_PLANE, _GRAPH, _AROUND = 12, 8, 24
# Planes that bend more than this are tried with fewer neighbours, and these kept if they bend so much less.
_BENT, _FEWER, _MUCH = 0.03, (8, 6), 0.5
# What a note adds for a cloud that is open or closed.
_CLOSED_NOTE = {False: "; check that none point inwards", True: ", out of the solid that they enclose"}
# Cosine of normal and line of sight up to which a surface was seen too slantingly to tell its side.
_GRAZING = 0.15
# Normals of neighbours are of one surface from this cosine on, and up to this one of their chord and their mean normal.
_ALIKE, _BESIDE = 0.7, 0.2
# Normals are mended if more than this share is wrong, and few of the disagreements are left. If so many were wrong, those of a
# closed cloud are turned out of it, and if nearly half were, a surface has no main side.
_FEW_WRONG, _LEFT, _MANY_WRONG, _UNDECIDED = 0.005, 0.2, 0.1, 0.4
# Points lie on opposite sides of a thin sheet if their mean offset is larger than this.
_SHEETS = 0.03
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

    Planes are fitted to the twelve nearest neighbours, or fewer where these bend. On a height field all normals are turned up
    along ``axis``. Elsewhere sides are handed on from neighbour to neighbour along a minimum spanning tree of the angles
    between their planes (Hoppe et al. 1992, by SciPy's sparse graph routines), leaving out at first where another surface is
    near. The outside of a piece is the convex side of a thread, else where it faces up, else where its volume is positive;
    where all pieces together are closed, their winding number decides (`turn_outwards`). Where threads touch, some of the
    normals remain wrong (about one in twenty points of a tight weave).

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
    normals, neighbors = _plane_normals(points)
    if is_height_field(points, axis, spacing):
        normals[normals[:, axis] < 0] *= -1
        return normals, "normals were estimated and turned up along the height axis: the swatch is a height field"
    closed = _propagate_sides(points, normals, neighbors, axis, spacing)
    return normals, "normals were estimated and turned from neighbour to neighbour" + _CLOSED_NOTE[closed]


def normals_facing(points: Array, stood: Array) -> Array:
    """Return unit normals (N, 3) of points without, turned to where the scanner stood.

    Where a surface was seen at a grazing angle, the noise of its normal decides what side it faces: such points take
    their side from their neighbours.

    Parameters
    ----------
    points : (N, 3) array
        At least thirteen.
    stood : (N, 3) array
        Where the scanner stood that saw each point.

    Raises
    ------
    InputError
        If there are too few points.
    """
    normals, neighbors = _plane_normals(points)
    sight = stood - points
    facing = (normals * sight).sum(axis=1) / np.maximum(np.linalg.norm(sight, axis=1), 1e-300)
    normals[facing < 0] *= -1
    _adopt_sides(normals, neighbors, points, np.abs(facing) > _GRAZING)
    return normals


def mend_sides(points: Array, normals: Array, axis: int, spacing: float) -> tuple[Array, str | None]:
    """Return normals that face one side of each surface, and a note where some of those given did not.

    Normals of neighbours on one surface that face opposite sides are a mistake, of a scanner's software or of scans turned
    differently; those of two sheets near each other are none. They differ in that opposite normals of a thin sheet lie on
    opposite sides, each in the direction of its own normal. Where a surface has a side that most of its normals face, the
    others are turned to it; else the side is found as for points without normals. Directions are kept.

    Parameters
    ----------
    points, normals : (N, 3) array
        Points, and unit normals.
    axis : int
        The height axis.
    spacing : float
        Distance of samples.
    """
    if len(points) <= _PLANE:
        return normals, None
    count = len(points)
    _, near = cKDTree(points).query(points, _GRAPH + 1)
    rows, columns = np.repeat(np.arange(count), _GRAPH), near[:, 1:].ravel()
    along = points[columns] - points[rows]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    product = (normals[rows] * normals[columns]).sum(axis=1)
    # The chord of two points of a smooth surface is at a right angle to their mean normal.
    offset = (along * (normals[rows] + np.sign(product)[:, None] * normals[columns])).sum(axis=1) / 2
    strong = (np.abs(product) > _ALIKE) & (np.abs(offset) < _BESIDE)
    rows, columns, product, offset = rows[strong], columns[strong], product[strong], offset[strong]
    against = product < 0
    if not against.any() or _apart(offset[against]):
        return normals, None
    weights = 1.0001 - np.abs(product) * (1 - np.abs(offset))
    tree = minimum_spanning_tree(coo_array((weights, (rows, columns)), shape=(count, count)).tocsr())
    pieces, label = connected_components(tree, directed=False)
    turned = normals.copy()
    _turn_along(tree, label, turned)
    changed = (turned * normals).sum(axis=1) < 0
    share = np.bincount(label, changed, pieces) / np.bincount(label, minlength=pieces)
    # What most normals of a piece face is its side.
    turned[(share > 0.5)[label]] *= -1
    wrong = (turned * normals).sum(axis=1) < 0
    left = ((turned[rows] * turned[columns]).sum(axis=1) < 0).sum()
    if wrong.sum() < _FEW_WRONG * count or left > _LEFT * against.sum():
        return normals, None
    if np.minimum(share, 1 - share)[label].mean() > _UNDECIDED:
        if is_height_field(points, axis, spacing):
            turned[turned[:, axis] < 0] *= -1
        else:
            _, around = cKDTree(points).query(points, min(_AROUND, count - 1) + 1)
            _propagate_sides(points, turned, around[:, 1:], axis, spacing)
    elif wrong.mean() > _MANY_WRONG:
        turn_outwards(points, turned, label, _areas(points, near[:, _GRAPH]))
    wrong = (turned * normals).sum(axis=1) < 0
    return turned, f"{int(wrong.sum())} of {count} normals that faced the other side than those around them were turned"


def _areas(points: Array, eighth: Array) -> Array:
    """Return the area that each point stands for, from its eighth nearest neighbour."""
    farthest = np.linalg.norm(points[eighth] - points, axis=1)
    return np.pi * farthest**2 / (_GRAPH + 0.5)


def _apart(offset: Array) -> bool:
    """Tell whether points with opposite normals lie on one side of each other throughout, as those of two sheets do."""
    mean = float(offset.mean())
    return abs(mean) > max(_SHEETS, 3 * float(offset.std()) / np.sqrt(len(offset)))


def _plane_normals(points: Array) -> tuple[Array, Array]:
    """Return unit normals (N, 3) of planes through each point's neighbours, of either side, and the neighbours (N, K)."""
    if len(points) <= _PLANE:
        raise InputError(f"{len(points)} points without normals are too few to estimate them: at least {_PLANE + 1} are needed")
    tree = cKDTree(points)
    normals = np.empty_like(points)
    around_count = min(_AROUND, len(points) - 1)
    neighbors = np.empty((len(points), around_count), np.int64)
    for begin in range(0, len(points), _AT_ONCE):
        part = slice(begin, begin + _AT_ONCE)
        _, index = tree.query(points[part], around_count + 1)
        normals[part], bend = _planes(points, index[:, : _PLANE + 1])
        doubtful = np.flatnonzero(bend > _BENT)
        for fewer in _FEWER:
            # Where walls are thin, the nearest neighbours alone are of one side.
            near, flat = _planes(points, index[doubtful, : fewer + 1])
            better = flat < _MUCH * bend[doubtful]
            normals[begin + doubtful[better]], bend[doubtful[better]] = near[better], flat[better]
        neighbors[part] = index[:, 1:]
    return normals, neighbors


def _planes(points: Array, index: Array) -> tuple[Array, Array]:
    """Return the normals (N, 3) of planes through points (N, K), and how much these bend: 0 in a plane, a third at most."""
    around = points[index]
    around = around - around.mean(axis=1, keepdims=True)
    spread, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    return axes[:, :, 0], spread[:, 0] / np.maximum(spread.sum(axis=1), 1e-300)


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


def _propagate_sides(points: Array, normals: Array, neighbors: Array, axis: int, spacing: float) -> bool:
    """Turn ``normals`` so that neighbours agree, in place, and those of a closed cloud outwards; return whether it is closed.

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
    # Neighbours whose sides agree by now are of one piece, whatever else is near.
    agree = (normals[rows] * normals[columns]).sum(axis=1) * (1 - across) > _UNLIKE
    joined = coo_array((np.ones(int(agree.sum())), (rows[agree], columns[agree])), shape=(count, count))
    _, label = connected_components(joined, directed=False)
    return turn_outwards(points, normals, label, _areas(points, neighbors[:, _GRAPH - 1]))


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
