"""One triangulation of scan and completion: the missing part of the base filled with target points and triangles.

The base is mapped to a plane by a conformal map (plane: its chart; cylinder: an annulus, radius exp(height / radius);
sphere: stereographic, from a pole inside the scan). Circles stay circles to first order, so a Delaunay triangulation there
is one on the base. The scan's border edges are constraints; the scan's own triangles are kept, not remade.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.mesh import Base, Cylinder, Sphere, adjacency, border_edges, edge_keys, unit
from intaglio.relief.ground.layout import ConformalMap, constrained_delaunay, turn, untangle

# A target keeps this distance (in spacings) from the scan's border and from other targets.
_CLEARANCE = 0.7
_RELAXATIONS = 6


@dataclass(frozen=True)
class Filling:
    """The completed part of the base.

    Attributes
    ----------
    points : (T, 3) float64 array
        Target points on the base.
    faces : (F, 3) int32 array
        Triangles of the completed part; an index below the number of scan vertices is one of those, the others follow.
    holes : int
        How many separate regions were filled.
    """

    points: Array
    faces: Array
    holes: int


def fill_base(
    base: Base,
    vertices: Array,
    faces: Array,
    candidates: Array,
    spacing: float,
    *,
    inside: Callable[[Array], Array] | None = None,
    only_holes: bool = False,
    regular: bool = False,
) -> Filling:
    """Triangulate what the scan leaves open of the base.

    Parameters
    ----------
    base : Base
        The base.
    vertices, faces : (N, 3), (F, 3) arrays
        The scan and its triangles.
    candidates : (M, 3) array
        Possible target points, spread over all of the base that may be filled at the wanted density. Those that fall
        on the scan are dropped; gaps are closed with more.
    spacing : float
        Wanted distance between targets, in the input's unit.
    inside : callable, optional
        ``inside(points (K, 3)) -> (K,) bool``, the region to fill, for a base that has an outer border.
    only_holes : bool
        Fill only regions enclosed by the scan.
    regular : bool
        The candidates continue the scan's own lattice: leave them where they are.

    Raises
    ------
    InputError
        If there is nothing to fill, or the scan covers the base twice at its border.
    """
    border = border_edges(faces)
    if len(border) == 0:
        raise InputError("the surface has no border and no holes: nothing is missing, nothing to complete")
    rim = np.unique(border)
    feet = base.foot(vertices)[0]
    chart_of = _chart(base, feet, faces, rim)
    rim_xy = chart_of(feet[rim])
    local = np.full(len(vertices), -1)
    local[rim] = np.arange(len(rim))
    edges = local[border]
    clockwise = _is_clockwise(chart_of, feet, faces)
    if clockwise:
        edges = edges[:, ::-1]
    untangle(rim_xy, edges)
    fixed = _on_edges(feet[rim], edges, 0.5 * spacing)
    fixed_tree = cKDTree(fixed)

    # What lies close to a scanned point lies on the scan or too near its border: dropped before it costs anything.
    candidates = candidates[_clear(cKDTree(feet), candidates, _CLEARANCE * spacing)]
    targets = candidates[_clear(fixed_tree, candidates, _CLEARANCE * spacing)]
    region = _Region(base, chart_of, feet[rim], rim_xy, edges, spacing, inside, only_holes)
    for sweep in range(_RELAXATIONS):
        triangles, used = region.triangulate(targets)
        targets, triangles = _keep_used(targets, triangles, used, len(rim))
        if regular or sweep == _RELAXATIONS - 1:
            break
        targets = _relax(base, feet[rim], targets, triangles, spacing)
        targets = _mend_density(base, feet[rim], targets, triangles, spacing, fixed_tree)
    if len(triangles) == 0:
        raise InputError(
            "nothing to complete: the scan has no hole of the base inside its border"
            if only_holes
            else "nothing to complete: the scan covers the whole extent of its base"
        )
    index = np.concatenate([rim, len(vertices) + np.arange(len(targets))])
    out = index[triangles].astype(np.int32)
    return Filling(targets, out[:, ::-1].copy() if clockwise else out, region.count)


def _clear(tree: cKDTree, points: Array, distance: float) -> Array:
    """Which of ``points`` have nothing of ``tree`` within ``distance``: bounded, since most lie far from a border."""
    return np.asarray(np.isinf(tree.query(points, distance_upper_bound=distance, workers=-1)[0]))


class _Region:
    """The open region in the conformal chart, bounded by the scan's border."""

    def __init__(
        self,
        base: Base,
        chart_of: ConformalMap,
        rim: Array,
        rim_xy: Array,
        edges: Array,
        spacing: float,
        inside: Callable[[Array], Array] | None,
        only_holes: bool,
    ) -> None:
        self.base, self.chart_of, self.rim, self.rim_xy, self.edges = base, chart_of, rim, rim_xy, edges
        self.spacing, self.inside, self.only_holes = spacing, inside, only_holes
        self.count = 0

    def triangulate(self, targets: Array) -> tuple[Array, Array]:
        """Return the open region's triangles over rim and targets, and which targets they use."""
        xy = np.concatenate([self.rim_xy, self.chart_of(targets)]) if len(targets) else self.rim_xy
        triangles, across = constrained_delaunay(xy, self.edges)
        count = len(xy)
        directed = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=-1).reshape(-1, 2)
        keys = edge_keys(directed, count)
        scan_side = np.isin(keys, edge_keys(self.edges, count)).reshape(-1, 3)
        open_side = np.isin(keys, edge_keys(self.edges[:, ::-1], count)).reshape(-1, 3)
        passable = (across >= 0) & ~scan_side & ~open_side
        source, corner = np.nonzero(passable)
        graph = coo_array((np.ones(len(source), bool), (source, across[source, corner])), shape=(len(triangles), len(triangles)))
        number, label = connected_components(graph, directed=False)
        votes_scan = np.bincount(label, scan_side.sum(axis=1), number)
        votes_open = np.bincount(label, open_side.sum(axis=1), number)
        if ((votes_scan > 0) & (votes_open > 0)).any():
            bad = int(np.flatnonzero((votes_scan > 0) & (votes_open > 0))[0])
            where = self.rim[np.unique(triangles[(label == bad) & open_side.any(axis=1)])[0] % len(self.rim)]
            raise InputError(
                f"the scan covers its {self.base.kind} more than once at its border near {np.round(where, 4)}: "
                "cut away the part that does not lie on the base, or choose another base"
            )
        is_open = (votes_open > 0)[label]
        points = np.concatenate([self.rim, targets])
        if self.only_holes:
            is_open &= ~self._outer(label, number, across, open_side, xy, triangles)[label]
        elif self.inside is not None:
            is_open &= ~self._outside(is_open, triangles, across, xy, points, passable)
        self.count = len(np.unique(label[is_open]))
        chosen = triangles[is_open]
        used = np.zeros(count, bool)
        used[chosen] = True
        return chosen, used[len(self.rim) :]

    def _outside(self, is_open: Array, triangles: Array, across: Array, xy: Array, points: Array, passable: Array) -> Array:
        """Open triangles beyond the extent, and slivers reachable from there: carved away from the outside in."""
        corners = points[triangles]
        beyond = np.zeros(len(triangles), bool)
        if self.inside is not None:
            # Seen in the chart: the disk inside a cylinder's annulus is beyond its end, though level with it in space.
            beyond = ~np.asarray(self.inside(self.chart_of.inverse(xy[triangles].mean(axis=1))), bool)
        thin = _circumradius(corners) > 1.5 * self.spacing
        outside = is_open & beyond
        # The region beyond the hull counts as outside; -1 in `across` reaches it.
        hull = (across < 0).any(axis=1)
        outside |= is_open & hull & thin
        while True:
            touches = ((across >= 0) & passable & outside[np.maximum(across, 0)]).any(axis=1)
            new = is_open & thin & touches & ~outside
            if not new.any():
                return outside
            outside |= new

    def _outer(self, label: Array, number: int, across: Array, open_side: Array, xy: Array, triangles: Array) -> Array:
        """Which components are the world outside the scan rather than holes in it: on a sphere, those larger than half of it."""
        outer = np.zeros(number, bool)
        if isinstance(self.base, Sphere):
            # The area from the border alone (signed solid angles of edges seen from the pole, modulo the whole sphere): the
            # outside need not be sampled for it. Counter-clockwise in the chart is clockwise on the sphere.
            row, corner = np.nonzero(open_side)
            direction = unit(self.rim - self.base.center)
            a, b = direction[triangles[row, corner]], direction[triangles[row, (corner + 1) % 3]]
            pole = self.chart_of.pole
            angle = 2 * np.arctan2(np.cross(a, b) @ pole, 1 + a @ pole + b @ pole + np.einsum("ij,ij->i", a, b))
            return np.mod(-np.bincount(label[row], angle, number), 4 * np.pi) > 2 * np.pi
        outer[np.unique(label[(across < 0).any(axis=1)])] = True
        if isinstance(self.base, Cylinder):
            # The annulus' inner disk is the world beyond the cylinder's lower end.
            a, b, c = (xy[triangles[:, i]] for i in range(3))
            holds = (turn(a, b) >= 0) & (turn(b, c) >= 0) & (turn(c, a) >= 0)
            outer[np.unique(label[holds])] = True
        return outer


def _chart(base: Base, feet: Array, faces: Array, rim: Array) -> ConformalMap:
    if isinstance(base, Sphere):
        centers = feet[faces].mean(axis=1)
        far = centers[np.argmax(cKDTree(feet[rim]).query(centers)[0])]
        return ConformalMap(base, pole=far - base.center)
    if isinstance(base, Cylinder):
        height = base.chart(feet)[:, 1]
        middle = float(height.min() + height.max()) / 2
        if np.ptp(height) > 60 * base.radius:
            raise InputError(f"the cylinder is too slender to unroll: height {np.ptp(height):.4g}, radius {base.radius:.4g}")
        return ConformalMap(base, middle=middle)
    return ConformalMap(base)


def _is_clockwise(chart_of: ConformalMap, feet: Array, faces: Array) -> bool:
    """Whether the scan's triangles run clockwise in the chart, by area; those across a pole or cut don't decide it."""
    xy = chart_of(feet)
    a, b, c = (xy[faces[:, i]] for i in range(3))
    doubled = turn(b - a, c - a)
    return bool(np.sign(doubled).sum() < 0)


def _on_edges(points: Array, edges: Array, step: float) -> Array:
    """Return points along the border edges, at most ``step`` apart, corners included."""
    a, b = points[edges[:, 0]], points[edges[:, 1]]
    parts = np.maximum(1, np.ceil(np.linalg.norm(b - a, axis=1) / step)).astype(int)
    which = np.repeat(np.arange(len(edges)), parts)
    t = (np.arange(len(which)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[which]
    return a[which] + t[:, None] * (b - a)[which]


def _keep_used(targets: Array, triangles: Array, used: Array, rim_count: int) -> tuple[Array, Array]:
    renumber = np.concatenate([np.arange(rim_count), rim_count + np.cumsum(used) - 1])
    return targets[used], renumber[triangles]


def _relax(base: Base, rim: Array, targets: Array, triangles: Array, spacing: float) -> Array:
    """Move every target half way to the centroid of its neighbours, along the base."""
    if len(targets) == 0:
        return targets
    points = np.concatenate([rim, targets])
    graph = adjacency(triangles, len(points))
    degree = np.maximum(np.diff(graph.indptr), 1)
    centroid = (graph @ points) / degree[:, None]
    step = 0.5 * (centroid[len(rim) :] - targets)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    step *= np.minimum(1.0, 0.3 * spacing / np.maximum(length, 1e-300))
    # A target on the extent's outer border would shrink inwards: it stays.
    border = np.unique(border_edges(triangles))
    free = np.ones(len(points), bool)
    free[border] = False
    return base.foot(np.where(free[len(rim) :, None], targets + step, targets))[0]


def _mend_density(base: Base, rim: Array, targets: Array, triangles: Array, spacing: float, fixed: cKDTree) -> Array:
    """Add a target where a triangle is far too large, drop one where two are far too close."""
    points = np.concatenate([rim, targets])
    corners = points[triangles]
    large = _circumradius(corners) > 0.95 * spacing
    extra = _circumcenter(corners[large])
    extra = base.foot(extra[np.isfinite(extra).all(axis=1)])[0]
    if len(extra):
        extra = extra[_clear(fixed, extra, _CLEARANCE * spacing)]
    if len(extra):
        # A circumcentre far outside its own triangle (a sliver's) is no place for a point.
        reach = cKDTree(corners[large].mean(axis=1)).query(extra)[0]
        extra = extra[reach < 2 * spacing]
    pool = np.concatenate([targets, extra])
    if len(pool) == 0:
        return pool
    pool = pool[_clear(fixed, pool, 0.9 * _CLEARANCE * spacing)]
    drop = np.zeros(len(pool), bool)
    for a, b in sorted(cKDTree(pool).query_pairs(0.9 * _CLEARANCE * spacing)):
        if not drop[a]:
            drop[b] = True
    return pool[~drop]


def _circumradius(corners: Array) -> Array:
    a = np.linalg.norm(corners[:, 1] - corners[:, 2], axis=1)
    b = np.linalg.norm(corners[:, 2] - corners[:, 0], axis=1)
    c = np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1)
    doubled = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return np.divide(a * b * c, 2 * doubled, out=np.full(len(a), np.inf), where=doubled > 1e-12 * a * b)


def _circumcenter(corners: Array) -> Array:
    a = corners[:, 0]
    ab, ac = corners[:, 1] - a, corners[:, 2] - a
    n = np.cross(ab, ac)
    square = np.einsum("ij,ij->i", n, n)[:, None]
    lab, lac = (np.einsum("ij,ij->i", v, v)[:, None] for v in (ab, ac))
    flat = square <= 1e-24 * lab * lac
    step = (lac * np.cross(n, ab) + lab * np.cross(ac, n)) / np.where(flat, 1.0, 2 * square)
    return np.where(flat, np.nan, a + step)
