"""A base of any shape: the scan's own smoothed surface, carried on over its holes."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.spatial import cKDTree

from intaglio.errors import InputError
from intaglio.kernels.geodesics import nearest_on_mesh
from intaglio.kernels.launch import choose_device
from intaglio.relief.base import Base, unit
from intaglio.relief.holes import Hole
from intaglio.relief.patches import RimError, refined, triangulated_rim
from intaglio.relief.thin_plate import smoothed
from intaglio.surface import vertex_normals
from intaglio.topology import edge_keys, pieces, unique_edges

Array = np.ndarray

# Most vertices of a hole that are solved for at once; a larger hole is solved on coarser triangles and refined afterwards.
_SOLVED_AT_ONCE = 15_000
# A filling may be so many times as large as the triangulation of least area, and so much of it may be folded, before it is
# drawn tighter; how tight, tried in turn.
_LARGEST, _FOLDED = 2.2, 0.005
_TENSIONS = (0.0, 0.3, 1.0, 3.0)
# A piece of the scan lies in a hole if so much of its border lies over the smooth filling, no further than this share of
# the hole's size.
_ISLAND_SHARE, _ISLAND_DISTANCE = 0.9, 0.25


@dataclass(frozen=True, kw_only=True)
class SmoothBase(Base):
    """A smooth triangulated surface.

    Attributes
    ----------
    vertices : (N, 3) float64 array
    faces : (F, 3) int32 array
    normals : (N, 3) float64 array
        Unit vertex normals; between vertices they are interpolated.
    relief_scale : float
        Wave length that parts relief from shape, in the input's unit.
    """

    kind: ClassVar[str] = "smooth"
    vertices: Array
    faces: Array
    normals: Array
    relief_scale: float

    def foot(self, points: Array) -> tuple[Array, Array]:
        """See `Base.foot`."""
        face, weight = nearest_on_mesh(np.asarray(points, np.float64), self.vertices, self.faces, choose_device())
        corner = self.faces[face]
        foot = np.einsum("ik,ikc->ic", weight, self.vertices[corner])
        return foot, unit(np.einsum("ik,ikc->ic", weight, self.normals[corner])) * self.orientation

    @property
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """See `Base.kernel_parameters`."""
        return 3, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0

    @property
    def parameters(self) -> dict[str, object]:
        """See `Base.parameters`."""
        return {"relief scale": self.relief_scale, "vertices": str(len(self.vertices))}


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
    edges = np.sort(edge_keys(unique_edges(faces), len(vertices)))
    notes: list[str] = []
    islands = _islands(vertices, faces, chosen, every, edges, device)
    # A rim that lies in another hole is filled with that one.
    inner = {island.number for group in islands.values() for island in group}
    points, triangles = vertices, [faces]
    failed = []
    count = 0
    for hole in chosen:
        if hole.number in inner:
            continue
        own = islands.get(hole.number, [])
        try:
            patch = _patch(vertices, edges, hole, own, spacing, device)
        except RimError as problem:
            failed.append(f"{hole.describe()}: {problem}")
            continue
        added, patch_faces = _fairest(vertices, faces, patch, spacing, relief_scale)
        patch_faces = np.where(patch_faces >= len(vertices), patch_faces + len(points) - len(vertices), patch_faces)
        points = np.concatenate([points, added])
        triangles.append(patch_faces)
        # Holes may meet in vertices: no later one may make an edge that this one has made.
        own_edges = unique_edges(patch_faces)
        edges = np.union1d(edges, edge_keys(own_edges[(own_edges < len(vertices)).all(axis=1)], len(vertices)))
        count += 1
        if own:
            notes.append(f"{hole.describe()}: filled around {len(own)} pieces of the scan in it")
    if failed:
        notes.append(f"{len(failed)} holes were left open, their rims can't be closed; the first is {failed[0]}")
    if count == 0:
        raise InputError(f"no hole could be filled: {failed[0]}; cut the faces at its rim away")
    together = np.concatenate(triangles).astype(np.int32)
    surface = smoothed(points, points, together, relief_scale)
    normals = vertex_normals(surface, together)
    height = np.einsum("ij,ij->i", vertices - surface[: len(vertices)], normals[: len(vertices)])
    foot = surface.copy()
    foot[: len(vertices)] = vertices - height[:, None] * normals[: len(vertices)]
    base = SmoothBase(vertices=foot, faces=together, normals=normals, relief_scale=relief_scale)
    return SmoothFilling(base, foot, normals, together[len(faces) :], count, tuple(notes))


def _patch(vertices: Array, edges: Array, hole: Hole, islands: list[Hole], spacing: float, device: str) -> _Patch:
    rim = np.unique(np.concatenate([hole.loop, *(island.loop for island in islands)]))
    points = vertices[rim]
    try:
        triangles = triangulated_rim(vertices, edges, [hole.loop, *(island.loop for island in islands)], device)
        local = np.searchsorted(rim, triangles)
    except RimError:
        # Every chord is an edge of the scan already: a few triangles about a vertex in the middle need none.
        if islands:
            raise
        ring = np.searchsorted(rim, hole.loop[::-1])
        local = np.stack([ring, np.roll(ring, -1), np.full(len(ring), len(rim))], axis=1)
        points = np.concatenate([points, points.mean(axis=0, keepdims=True)])
    # Pairs of rim vertices that the scan joins already: no flip may make that edge again.
    a, b = np.divmod(edges, len(vertices))
    here = np.isin(a, rim) & np.isin(b, rim)
    joined = np.stack([np.searchsorted(rim, a[here]), np.searchsorted(rim, b[here])], axis=1)
    patch = _Patch(rim, points, local, joined)
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
        self.points, self.faces = refined(self.points, self.faces, spacing, table)
        self.coarse = spacing


def _fairest(vertices: Array, faces: Array, flat: _Patch, spacing: float, relief_scale: float) -> tuple[Array, Array]:
    """Return the patch's inner vertices (K, 3), fair, and its faces with numbers from the scan's count on for them.

    Over a rim whose tangents point far apart a plate bulges or folds: it is then drawn tighter, step by step, towards a soap film.
    """
    patch = flat
    for tension in _TENSIONS:
        patch = _faired(vertices, faces, flat, relief_scale, tension)
        if patch.area <= _LARGEST * flat.area and patch.folded <= _FOLDED:
            break
    rim = patch.rim
    if patch.coarse > 1.001 * spacing:
        facets = patch.coarse
        patch.refine(spacing)
        patch.points = smoothed(
            patch.points, patch.points, patch.faces, 5 * facets, free=np.arange(len(patch.points)) >= len(rim)
        )
    inner = patch.points[len(rim) :]
    number = np.concatenate([rim, len(vertices) + np.arange(len(inner))])
    return inner, number[patch.faces]


def _faired(vertices: Array, faces: Array, flat: _Patch, relief_scale: float, tension: float) -> _Patch:
    """Return the patch in the shape of least energy together with the scan around it, smoothed."""
    patch = copy(flat)
    rim = patch.rim
    near = cKDTree(vertices[rim]).query(vertices, distance_upper_bound=1.5 * relief_scale)[0] < np.inf
    near &= _reached(faces, near, rim)
    band_faces = faces[near[faces].all(axis=1)]
    band = np.union1d(np.unique(band_faces), rim)
    place = np.full(len(vertices), -1)
    place[band] = np.arange(len(band))
    data = vertices[band]
    smooth_band = data
    for step in range(3):
        inner = patch.points[len(rim) :]
        number = np.concatenate([place[rim], len(band) + np.arange(len(inner))])
        mesh = np.concatenate([place[band_faces], number[patch.faces]])
        geometry = np.concatenate([smooth_band, inner])
        weight = np.concatenate([np.ones(len(band)), np.zeros(len(inner))])
        solved = smoothed(
            np.concatenate([data, inner]), geometry, mesh, relief_scale, weight=weight, film=number[patch.faces], tension=tension
        )
        smooth_band = solved[: len(band)]
        patch.points = np.concatenate([patch.points[: len(rim)], solved[len(band) :]])
        if step == 0:
            # The surface has grown beyond the flat one that was refined.
            patch.refine(patch.coarse)
    return patch


def _reached(faces: Array, near: Array, rim: Array) -> Array:
    """Which vertices are joined to the rim through vertices that are ``near``: not the far side of a thin wall."""
    chosen = faces[near[faces].all(axis=1)]
    _, label = pieces(chosen, len(near))
    return np.isin(label, label[rim])


def _islands(
    vertices: Array, faces: Array, chosen: list[Hole], every: list[Hole], edges: Array, device: str
) -> dict[int, list[Hole]]:
    """Return, by the number of the hole, the outer borders of other pieces of the scan that lie in it."""
    _, label = pieces(faces, len(vertices))
    candidates = [border for border in every if border.outer]
    found: dict[int, list[Hole]] = {}
    taken: set[int] = set()
    if len(np.unique(label[faces[:, 0]])) < 2:
        return found
    normals = vertex_normals(vertices, faces)
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
            triangles = triangulated_rim(vertices, edges, [hole.loop], device)
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
            alike = np.einsum("ij,ij->i", normals[border.loop], facing[face]) > 0
            over = weight.max(axis=1) < 1 - 1e-6
            if (close & alike & over).mean() >= _ISLAND_SHARE:
                found.setdefault(hole.number, []).append(border)
                taken.add(border.number)
    return found
