"""Filling a hole from its like elsewhere on the scan: the pose that fits best, its relief, joined to the rim."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.mesh import SmoothBase, Surface, tangents
from intaglio.relief.coherent import Wishes, edges_from, join
from intaglio.relief.ground import Ground, ThinPlate, relaid, smooth_over_surface
from intaglio.relief.symmetry.copies import Copy, lay_copy, trimmed_mean, unlikeness
from intaglio.relief.symmetry.poses import Pose
from intaglio.relief.symmetry.registration import REACH, Register

# Holes of fewer targets are filled as well by pieces.
_LEAST = 100
# Poses that are looked at, and how unlike a place may be that is taken: its relief then correlates by over 0.6 with that around
# the hole. Below _CERTAIN no other is tried.
_POSES, _UNLIKE, _CERTAIN = 6, 0.9, 0.3
# Share of the hole, and of its surroundings, that a copy must reach.
_COVERED, _SURROUNDED = 0.85, 0.4
# The place is looked for among so many vertices of the scan, those nearest to the hole.
_MOST = 300_000
# The base goes through hole and surroundings at so many radii: what is smaller is compared and copied as relief.
_SCALE = 2.0


@dataclass(frozen=True)
class LikeFilling:
    """A hole filled from its like.

    Attributes
    ----------
    ground : Ground
        The hole's, over a smooth base with a new one.
    height : (N,) array
        In the input's unit.
    source : (N,) int array
        Numbers of the scan's vertices; -1 where measured.
    rotation : (N,) array
        Against the ground's frames at sources that it holds, else against `tangents` of the scan's normal.
    error, confidence : (N,) arrays
    pose : Pose
    unlikeness : float
        See `unlikeness`.
    """

    ground: Ground
    height: Array
    source: Array
    rotation: Array
    error: Array
    confidence: Array
    pose: Pose
    unlikeness: float


@dataclass(frozen=True)
class _Near:
    """A part of the scan, as registration sees it and as a mesh; ``number`` are the scan's numbers of its vertices, sorted."""

    number: Array
    points: Array
    faces: Array
    register: Register

    @classmethod
    def of(cls, scan: Surface, number: Array, faces: Array) -> _Near:
        """Take the vertices ``number``, and those of the ``faces`` that they hold."""
        local = np.full(len(scan.vertices), -1, np.int32)
        local[number] = np.arange(len(number))
        mapped = local[faces]
        points = scan.vertices[number]
        return cls(number, points, mapped[(mapped >= 0).all(axis=1)], Register(points, scan.normal[number]))

    def local(self, numbers: Array) -> Array:
        """Return the numbers here of those of the scan's vertices that are here."""
        at = np.minimum(np.searchsorted(self.number, numbers), len(self.number) - 1)
        return at[self.number[at] == numbers]


class Likes:
    """The scan as a source of likes for its holes.

    Parameters
    ----------
    scan : Surface
    taken : (V,) bool array
        Its vertices that may serve.
    poses : list of Pose, optional
        The poses to try; default all that registration finds.
    rank : int
        Which of the places that are alike is taken: 0 the best.
    device : str
    """

    def __init__(self, scan: Surface, taken: Array, poses: list[Pose] | None, rank: int, device: str) -> None:
        self._scan, self._poses, self._rank, self._device = scan, poses, rank, device
        self._faces = scan.faces if taken.all() else scan.faces[taken[scan.faces].all(axis=1)]
        self._used = np.zeros(len(scan.vertices), bool)
        self._used[self._faces] = True
        self._register: _Near | None = None

    def fill(self, ground: Ground, kept: Array) -> LikeFilling | None:
        """Return a hole filled from its like; None where nothing on the scan is like it.

        Parameters
        ----------
        ground : Ground
            Around the hole alone.
        kept : (M,) int array
            The scan's numbers of the ground's M measured vertices.
        """
        targets = np.flatnonzero(~ground.measured)
        if len(targets) < _LEAST and self._poses is None:
            return None
        missing = ground.vertices[targets]
        center = missing.mean(axis=0)
        # Of a hole of a few targets the rim is what has a size.
        radius = max(float(np.linalg.norm(missing - center, axis=1).max()), 2 * ground.spacing)
        away = cKDTree(missing).query(ground.vertices, distance_upper_bound=REACH * radius)[0]
        around = ground.measured & (away < REACH * radius)
        if isinstance(ground.base, SmoothBase):
            scale = _SCALE * radius
            ground = relaid(ground, ground.vertices, ThinPlate(ground.foot, ground.faces, scale), scale)
        best = self._best(ground, kept, around, missing, radius)
        return None if best is None else self._joined(ground, kept, around, radius, *best)

    def _best(self, ground: Ground, kept: Array, around: Array, missing: Array, radius: float) -> tuple[Copy, float] | None:
        near = self._near(missing)
        own = near.local(kept[np.flatnonzero(around[ground.measured])])
        if len(own) == 0:
            return None
        if self._poses is None:
            matches = near.register.find(own, missing, radius, most=_POSES)
        else:
            matches = near.register.settle(self._poses, own, missing, radius, certain=True)
        given = self._poses is not None
        found: list[tuple[Copy, float]] = []
        for match in matches:
            copy = lay_copy(ground, match.pose, around | ~ground.measured, near.points, near.faces, self._device)
            copy = replace(copy, source=near.number[copy.source])
            if copy.reached[~ground.measured].mean() < _COVERED or copy.reached[around].mean() < _SURROUNDED:
                continue
            value = unlikeness(ground, copy, around, radius)
            if given or value < _UNLIKE:
                found.append((copy, value))
            if value < _CERTAIN and self._rank == 0:
                break
        found.sort(key=lambda pair: pair[1])
        return found[self._rank] if self._rank < len(found) else None

    def _near(self, missing: Array) -> _Near:
        """Return the part of the scan in which places are looked for."""
        number = np.flatnonzero(self._used)
        if len(number) <= _MOST:
            if self._register is None:
                self._register = _Near.of(self._scan, number, self._faces)
            return self._register
        away = ((self._scan.vertices[number] - missing.mean(axis=0)) ** 2).sum(axis=1)
        number = np.sort(number[np.argpartition(away, _MOST)[:_MOST]])
        return _Near.of(self._scan, number, self._faces)

    def _joined(self, ground: Ground, kept: Array, around: Array, radius: float, copy: Copy, value: float) -> LikeFilling:
        """Return the hole filled with a copy: moved smoothly to where its surroundings lie, then joined to the rim."""
        known = around & copy.reached
        off = np.where(known, ground.height - copy.height, 0.0)
        weight = np.where(known, 1.0, 1e-6)
        moved = smooth_over_surface(off[:, None], ground.foot, ground.faces, radius, weight=weight)[:, 0]
        laid = copy.height + moved
        topology, target = ground.topology, ~ground.measured
        first = np.repeat(np.arange(len(laid)), np.diff(topology.offsets))
        own = target[first]
        first, other = first[own], topology.neighbors[own]
        told = copy.reached[first] & copy.reached[other]
        wishes = Wishes(first, other, laid[other] - laid[first], told, laid[first], target[other])
        height = join(wishes, np.where(ground.measured, ground.height, laid), target)
        misfit = float(trimmed_mean((off - moved)[known] ** 2))
        ground, height = self._settled(ground, height, radius)
        hops = edges_from(topology.graph, ground.measured)
        sure = np.exp(-(value**2)) * (1.0 - 0.5 * hops / max(int(hops[target].max()), 1))
        source = np.where(target, copy.source, -1)
        return LikeFilling(
            ground,
            height,
            source,
            np.where(target, self._rotation(ground, kept, copy), 0.0).astype(np.float32),
            np.where(target, misfit, 0.0).astype(np.float32),
            np.where(target, np.where(copy.reached, sure, 0.1 * sure), 1.0).astype(np.float32),
            copy.pose,
            value,
        )

    def _settled(self, ground: Ground, height: Array, radius: float) -> tuple[Ground, Array]:
        """Return the ground with a smooth base through scan and filling, and the heights over it."""
        if not isinstance(ground.base, SmoothBase):
            return ground, height
        vertices = np.where(ground.measured[:, None], ground.vertices, ground.foot + height[:, None] * ground.normal)
        scale = min(2 * radius, 12 * ground.spacing)
        ground = relaid(ground, vertices, ThinPlate(ground.foot, ground.faces, scale), scale)
        return ground, ground.height

    def _rotation(self, ground: Ground, kept: Array, copy: Copy) -> Array:
        """Return the angles by which tangent vectors, mirrored first if the pose mirrors, are turned into the sources' frames."""
        u, v = frames_of_scan(self._scan, ground, kept, copy.source)
        ahead = ground.u @ copy.pose.turn.T
        return np.arctan2(np.einsum("ij,ij->i", ahead, v), np.einsum("ij,ij->i", ahead, u))


def frames_of_scan(scan: Surface, ground: Ground, kept: Array, vertices: Array) -> tuple[Array, Array]:
    """Return the frames u, v (K, 3) of vertices of the scan: the ground's where it holds them, else by their normals."""
    u, v = tangents(scan.normal[vertices])
    local = np.full(len(scan.vertices), -1)
    local[kept] = np.arange(len(kept))
    held = local[vertices] >= 0
    u[held], v[held] = ground.u[local[vertices[held]]], ground.v[local[vertices[held]]]
    return u, v


def given_poses(symmetry: Array) -> list[Pose]:
    """Return the poses of a mirror plane (4,) or of an axis and how often its turn makes a circle (7,).

    Parameters
    ----------
    symmetry : (4,) or (7,) array
        (nx, ny, nz, d): the plane n . x = d. (px, py, pz, dx, dy, dz, count): through p along d.
    """
    if len(symmetry) == 4:
        length = float(np.linalg.norm(symmetry[:3]))
        normal, distance = symmetry[:3] / length, symmetry[3] / length
        return [Pose(np.eye(3) - 2 * np.outer(normal, normal), 2 * distance * normal)]
    point, way, count = symmetry[:3], symmetry[3:6] / np.linalg.norm(symmetry[3:6]), int(symmetry[6])
    across = np.array([[0, -way[2], way[1]], [way[2], 0, -way[0]], [-way[1], way[0], 0]])
    poses = []
    for k in range(1, count):
        angle = 2 * np.pi * k / count
        turn = np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across
        poses.append(Pose(turn, point - turn @ point))
    return poses
