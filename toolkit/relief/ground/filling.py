"""Filling the holes of a scan smoothly, and smoothing the scan: the base that relief of any shape stands on."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.kernels.geodesics import nearest_on_mesh
from intaglio.mesh import SmoothBase, Topology, adjacency, edge_keys, pieces, unique_edges, unit, vertex_normals
from intaglio.relief.ground.holes import Hole
from intaglio.relief.ground.patches import RimError, refine_patch, triangulate_rim
from intaglio.relief.ground.thin_plate import smooth_over_surface
from intaglio.sparse import solve_symmetric

# Most vertices of a hole that are solved for at once; a larger hole is solved on coarser triangles and refined afterwards.
_SOLVED_AT_ONCE = 15_000
# A filling may be so many times as large as the triangulation of least area, and so much of it may be folded, before it is
# drawn tighter; how tight, tried in turn.
_LARGEST, _FOLDED = 2.2, 0.005
# Over how many edges a shift along the base dies away from the rim.
_SLIP_REACH = 5.0
_TENSIONS = (0.0, 0.3, 1.0, 3.0)
# A piece of the scan lies in a hole if so much of its border lies over the smooth filling, no further than this share of
# the hole's size.
_ISLAND_SHARE, _ISLAND_DISTANCE = 0.9, 0.25


@dataclass(frozen=True)
class SmoothFilling:
    """A scan with its holes filled by a smooth surface.

    Attributes
    ----------
    base : SmoothBase
        Over scan and filling.
    foot, normal : (N + T, 3) float64 arrays
        Base points and normals of the scan's N vertices and of T targets after them.
    faces : (F, 3) int32 array
        Triangles of the filling alone.
    holes : int
        How many were filled.
    notes : tuple of str
    """

    base: SmoothBase
    foot: Array
    normal: Array
    faces: Array
    holes: int
    notes: tuple[str, ...]


def fill_smoothly(
    vertices: Array, faces: Array, chosen: list[Hole], every: list[Hole], spacing: float, relief_scale: float, device: str
) -> SmoothFilling:
    """Fill holes with a smooth surface and smooth the scan itself: the base that relief stands on.

    A hole is triangulated over its rim, refined to ``spacing``, and given the shape of least thin-plate energy together with the
    scan around it, smoothed at ``relief_scale``: across the rim tangents are continuous. Then scan and fillings are smoothed once
    more as one surface. The foot of a measured vertex is below it along the base's normal.

    Parameters
    ----------
    vertices, faces : (N, 3), (F, 3) arrays
        The scan.
    chosen, every : list of Hole
        The holes to fill, and all borders of the scan: pieces whose border lies in a hole are joined to its filling.
    spacing, relief_scale : float
        In the unit of ``vertices``.
    device : str

    Raises
    ------
    InputError
        Where no hole could be filled.
    """
    scan = _Scan(vertices, faces)
    notes: list[str] = []
    islands = _islands(scan, chosen, every, device)
    # A rim that lies in another hole is filled with that one.
    inner = {island.number for group in islands.values() for island in group}
    points, triangles, total = [vertices], [faces], len(vertices)
    failed = []
    count = 0
    for hole in chosen:
        if hole.number in inner:
            continue
        own = islands.get(hole.number, [])
        try:
            patch = _patch(scan, hole, own, spacing, device)
        except RimError as problem:
            failed.append(f"{hole.describe()}: {problem}")
            continue
        added, patch_faces = _fairest(scan, patch, spacing, relief_scale)
        patch_faces = np.where(patch_faces >= len(vertices), patch_faces + total - len(vertices), patch_faces)
        points.append(added)
        total += len(added)
        triangles.append(patch_faces)
        scan.add(patch_faces)
        count += 1
        if own:
            notes.append(f"{hole.describe()}: filled around {len(own)} pieces of the scan in it")
    if failed:
        notes.append(f"{len(failed)} holes were left open, their rims can't be closed; the first is {failed[0]}")
    if count == 0:
        raise InputError(f"no hole could be filled: {failed[0]}; cut the faces at its rim away")
    together = np.concatenate(triangles).astype(np.int32)
    everything = np.concatenate(points)
    surface = smooth_over_surface(everything, everything, together, relief_scale)
    normals = vertex_normals(surface, together)
    height = np.einsum("ij,ij->i", vertices - surface[: len(vertices)], normals[: len(vertices)])
    foot = surface.copy()
    foot[: len(vertices)] = vertices - height[:, None] * normals[: len(vertices)]
    foot[len(vertices) :] += _draw_along(foot[: len(vertices)] - surface[: len(vertices)], together, total)
    base = SmoothBase(vertices=foot, faces=together, normals=normals, relief_scale=relief_scale, device=device)
    return SmoothFilling(base, foot, normals, together[len(faces) :], count, tuple(notes))


def _rows(start: Array, length: Array) -> Array:
    """Positions of several runs in a table, one after the other: ``length`` from ``start`` each."""
    return np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length) + np.repeat(start, length)


class _Scan:
    """The scan as single holes look at it: what lies near a rim, and what joins it, without going through all of it."""

    def __init__(self, vertices: Array, faces: Array) -> None:
        self.vertices, self.faces = vertices, faces
        self.normals = vertex_normals(vertices, faces)
        self._topology = Topology.of(faces, len(vertices))
        self._tree = cKDTree(vertices)
        # Edges between scan vertices that fillings have made: no later one may make them again.
        self._made = np.zeros((0, 2), np.int64)

    def joined(self, rim: Array) -> Array:
        """Return the pairs (E, 2) of vertices of ``rim`` (sorted) that an edge joins already, the smaller first."""
        offsets, neighbors = self._topology.offsets, self._topology.neighbors
        degree = offsets[rim + 1] - offsets[rim]
        first = np.repeat(rim, degree)
        other = neighbors[_rows(offsets[rim], degree)]
        pairs = np.stack([first, other], axis=1)
        pairs = np.concatenate([pairs[(first < other) & np.isin(other, rim)], self._made[np.isin(self._made, rim).all(axis=1)]])
        return np.unique(pairs, axis=0)

    def add(self, faces: Array) -> None:
        """Take note of a filling's edges between vertices of the scan."""
        edges = unique_edges(faces)
        own = edges[(edges < len(self.vertices)).all(axis=1)]
        self._made = np.concatenate([self._made, own])

    def band(self, rim: Array, reach: float) -> tuple[Array, Array]:
        """Return the vertices (K,), sorted, and faces (G, 3) within ``reach`` of the rim, and joined to it there.

        The far side of a thin wall is near, but not joined.
        """
        lists = self._tree.query_ball_point(self.vertices[rim], reach)
        near = np.unique(np.concatenate([np.asarray(found, np.int64) for found in lists]))
        offsets, incident = self._topology.face_offsets, self._topology.incident
        degree = offsets[near + 1] - offsets[near]
        faces = self.faces[np.unique(incident[_rows(offsets[near], degree)])]
        place = np.searchsorted(near, faces)
        own = (near[np.minimum(place, len(near) - 1)] == faces).all(axis=1)
        faces, place = faces[own], place[own]
        _, label = pieces(place, len(near))
        reached = np.isin(label, label[np.searchsorted(near, rim)])
        return near[reached], faces[reached[place].all(axis=1)]


def _draw_along(slip: Array, faces: Array, count: int) -> Array:
    """Return by how much targets (T, 3) are drawn along where the scan's feet slip (N, 3) along the base at the rim.

    A sharp rim is rounded off by smoothing: its vertices' feet stand beyond it, and so would a gap. The shift dies away over
    some edges.
    """
    scanned = len(slip)
    graph = adjacency(faces, count)[scanned:].astype(np.float64)
    degree = np.asarray(graph.sum(axis=1)).reshape(-1)
    own = csr_array(graph[:, scanned:])
    system = csr_array(diags_array(degree + 1.5 / _SLIP_REACH**2) - own)
    right = graph[:, :scanned] @ slip
    return solve_symmetric(system, right, np.zeros(right.shape))


def _patch(scan: _Scan, hole: Hole, islands: list[Hole], spacing: float, device: str) -> _Patch:
    loops = [hole.loop, *(island.loop for island in islands)]
    rim = np.unique(np.concatenate(loops))
    points = scan.vertices[rim]
    # Pairs of rim vertices that are joined already: neither a triangle nor a flip may make that edge again.
    joined = scan.joined(rim)
    try:
        triangles = triangulate_rim(scan.vertices, np.sort(edge_keys(joined, len(scan.vertices))), loops, device)
        local = np.searchsorted(rim, triangles)
    except RimError:
        # Every chord is an edge of the scan already: a few triangles about a vertex in the middle need none.
        if islands:
            raise
        ring = np.searchsorted(rim, hole.loop[::-1])
        local = np.stack([ring, np.roll(ring, -1), np.full(len(ring), len(rim))], axis=1)
        points = np.concatenate([points, points.mean(axis=0, keepdims=True)])
    patch = _Patch(rim, points, local, np.searchsorted(rim, joined))
    patch.refine(max(spacing, float(np.sqrt(2.3 * patch.area / _SOLVED_AT_ONCE))))
    return patch


class _Patch:
    """The triangles of one hole; the first vertices are the rim's."""

    def __init__(self, rim: Array, points: Array, faces: Array, joined: Array) -> None:
        self.rim, self.points, self.faces, self._joined = rim, points, faces, joined
        self.coarse = 0.0

    @property
    def area(self) -> float:
        """Of its triangles."""
        return 0.5 * float(np.linalg.norm(self._crosses, axis=1).sum())

    @property
    def folded(self) -> float:
        """Share of its triangles that face away from the mean of their vertices' normals."""
        normals = vertex_normals(self.points, self.faces)[self.faces].sum(axis=1)
        return float((np.einsum("ij,ij->i", self._crosses, normals) < 0).mean())

    @property
    def _crosses(self) -> Array:
        corners = self.points[self.faces]
        return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])

    def refine(self, spacing: float) -> None:
        """Split and flip until edges are about ``spacing`` long."""
        table = np.sort(edge_keys(self._joined, len(self.points)))
        self.points, self.faces = refine_patch(self.points, self.faces, spacing, table)
        self.coarse = spacing


def _fairest(scan: _Scan, flat: _Patch, spacing: float, relief_scale: float) -> tuple[Array, Array]:
    """Return the patch's inner vertices (K, 3), fair, and its faces with numbers from the scan's count on for them.

    Over a rim whose tangents point far apart a plate bulges or folds: it is then drawn tighter, step by step, towards a soap
    film.
    """
    patch = flat
    band, faces = scan.band(flat.rim, 1.5 * relief_scale)
    local, rim = np.searchsorted(band, faces), np.searchsorted(band, flat.rim)
    for tension in _TENSIONS:
        patch = _fair(scan.vertices[band], local, rim, flat, relief_scale, tension)
        if patch.area <= _LARGEST * flat.area and patch.folded <= _FOLDED:
            break
    rim = patch.rim
    if patch.coarse > 1.001 * spacing:
        facets = patch.coarse
        patch.refine(spacing)
        patch.points = smooth_over_surface(
            patch.points, patch.points, patch.faces, 5 * facets, free=np.arange(len(patch.points)) >= len(rim)
        )
    inner = patch.points[len(rim) :]
    number = np.concatenate([rim, len(scan.vertices) + np.arange(len(inner))])
    return inner, number[patch.faces]


def _fair(band: Array, band_faces: Array, rim: Array, flat: _Patch, relief_scale: float, tension: float) -> _Patch:
    """Return the patch in the shape of least energy together with the scan around it, smoothed.

    ``band`` (K, 3) are the scan's vertices near the hole, ``rim`` says which of them are the patch's first vertices.
    """
    patch = copy(flat)
    smooth_band = band
    for step in range(3):
        inner = patch.points[len(rim) :]
        number = np.concatenate([rim, len(band) + np.arange(len(inner))])
        mesh = np.concatenate([band_faces, number[patch.faces]])
        geometry = np.concatenate([smooth_band, inner])
        weight = np.concatenate([np.ones(len(band)), np.zeros(len(inner))])
        found = smooth_over_surface(
            np.concatenate([band, inner]), geometry, mesh, relief_scale, weight=weight, film=number[patch.faces], tension=tension
        )
        smooth_band = found[: len(band)]
        patch.points = np.concatenate([patch.points[: len(rim)], found[len(band) :]])
        if step == 0:
            # The surface has grown beyond the flat one that was refined.
            patch.refine(patch.coarse)
    return patch


def _islands(scan: _Scan, chosen: list[Hole], every: list[Hole], device: str) -> dict[int, list[Hole]]:
    """Return, by the number of the hole, the outer borders of other pieces of the scan that lie in it."""
    candidates = [border for border in every if border.outer]
    found: dict[int, list[Hole]] = {}
    taken: set[int] = set()
    if len({border.piece for border in every}) < 2:
        return found
    vertices = scan.vertices
    for hole in chosen:
        size = float(np.sqrt(hole.area / np.pi))
        others = [
            border
            for border in candidates
            if border.piece != hole.piece
            and border.number not in taken
            and border.length < hole.length
            and np.linalg.norm(border.center - hole.center) < hole.length / 2
        ]
        if not others:
            continue
        try:
            table = np.sort(edge_keys(scan.joined(np.unique(hole.loop)), len(vertices)))
            triangles = triangulate_rim(vertices, table, [hole.loop], device)
        except RimError:
            continue
        # A few triangles are enough to say whether a piece lies over the hole.
        flat = vertices[triangles]
        facing = unit(np.cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]))
        for border in others:
            at = vertices[border.loop]
            face, weight = nearest_on_mesh(at, vertices, triangles.astype(np.int32), device)
            nearest = np.einsum("ik,ikc->ic", weight, flat[face])
            close = np.linalg.norm(at - nearest, axis=1) < max(_ISLAND_DISTANCE * 2 * size, 1e-12)
            alike = np.einsum("ij,ij->i", scan.normals[border.loop], facing[face]) > 0
            over = weight.max(axis=1) < 1 - 1e-6
            if (close & alike & over).mean() >= _ISLAND_SHARE:
                found.setdefault(hole.number, []).append(border)
                taken.add(border.number)
    return found
