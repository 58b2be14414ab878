"""Registration of a scan with itself: where the surroundings of a hole are found again.

Profiles of the surface around a few places beside the hole are compared with those around places all over the scan, at all
angles and mirrored; the best are refined by point-to-plane registration (Chen & Medioni 1991) of all the surroundings. After
Mitra, Guibas & Pauly 2006 (partial symmetries by matched local frames), with whole profiles in the place of curvatures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from intaglio.arrays import Array
from intaglio.mesh import tangents
from intaglio.relief.symmetry.poses import Pose

# A profile: rings and angles of mean heights around a place, as wide as the hole.
_RINGS, _ANGLES = 4, 24
# Points that stand for the surface lie so far apart, in hole radii; places that profiles are taken at, at most so many.
_GRAIN, _PLACES = 1 / 7, 4_000
# Places beside the hole whose profiles are looked for, guesses kept of each, those of all that are compared, and refined.
_SEEDS, _GUESSES, _PROMISING, _REFINED = 24, 40, 300, 40
# Surroundings that are registered: so many radii beyond the rim, at most so many points.
REACH = 0.9
_REGISTERED, _STEPS = 400, 25
# What lies further off than this share of the radius counts as if it lay there: the scan may end, or go on otherwise.
_FAR = 0.2
# Poses that move no place beside the hole by more than this share of the radius are one.
_SAME = 0.25


@dataclass(frozen=True)
class Match:
    """A pose under which the surroundings of a hole lie on the scan.

    Attributes
    ----------
    pose : Pose
        From the hole to the place that it is like.
    residual : float
        Root mean square distance of the surroundings from the scan there, in the input's unit; what is far counts as if it lay at
        a fifth of the radius.
    """

    pose: Pose
    residual: float


class Register:
    """A scan as registration sees it.

    Parameters
    ----------
    points, normals : (N, 3) arrays
        Measured vertices and their unit normals.
    """

    def __init__(self, points: Array, normals: Array) -> None:
        self._points, self._normals = points, normals
        self._tree = cKDTree(points)
        some = points[:: max(1, len(points) // 200)]
        # About the distance between points.
        self._edge = float(np.median(self._tree.query(some, k=2)[0][:, 1]))

    def find(self, around: Array, missing: Array, radius: float, *, most: int = 4) -> list[Match]:
        """Return the poses under which the surroundings of a hole fit the scan best, best first.

        Parameters
        ----------
        around : (K,) int array
            The vertices around the hole.
        missing : (T, 3) array
            Points that stand for the hole: measured surface must lie where they come to lie.
        radius : float
            Of the hole, in the input's unit.
        most : int
            Of poses.
        """
        thin = _thinned(self._points, _GRAIN * radius)
        seeds = _spread(self._points[around], _SEEDS)
        own = around[seeds]
        places = _some(thin, _PLACES)
        cloud = cKDTree(self._points[thin])
        here = self._profiles(own, thin, cloud, radius)
        there = self._profiles(places, thin, cloud, radius)
        guesses = self._guesses(own, places, here, there)
        few = _some(around, _REGISTERED // 4)
        middle = missing.mean(axis=0)
        kept = []
        for pose in guesses:
            if np.linalg.norm(pose.apply(middle[None])[0] - middle) < radius:
                continue
            kept.append((self._residual(pose, few, radius), pose))
        kept.sort(key=lambda pair: pair[0])
        distinct = _apart(kept[:_PROMISING], self._points[few], _SAME * radius)
        chosen = [pose for _, pose in distinct[:_REFINED]]
        return self.settle(chosen, around, missing, radius)[:most]

    def settle(self, poses: list[Pose], around: Array, missing: Array, radius: float, *, certain: bool = False) -> list[Match]:
        """Refine poses, and return those that differ and lead from the hole to measured surface, best first.

        Parameters
        ----------
        poses : list of Pose
        around, missing, radius
            As in `find`.
        certain : bool
            The poses are known to hold: where refinement runs away, as with few vertices around, they stay as they are.
        """
        sample = _some(around, _REGISTERED)
        found = []
        for pose in poses:
            refined = self._refined(pose, sample, radius)
            if refined is None and certain:
                refined = pose
            if refined is not None and self._leads_elsewhere(refined, sample, missing, radius):
                found.append((self._residual(refined, sample, radius), refined))
        found.sort(key=lambda pair: pair[0])
        return [Match(pose, residual) for residual, pose in _apart(found, self._points[sample], _SAME * radius)]

    def _profiles(self, vertices: Array, thin: Array, cloud: cKDTree, radius: float) -> tuple[Array, Array]:
        """Return the mean heights (V, rings, angles) around vertices, in radii, and where they are known."""
        shape = (len(vertices), _RINGS, _ANGLES)
        total, known = np.zeros(shape), np.zeros(shape)
        u, v = tangents(self._normals[vertices])
        lists = cloud.query_ball_point(self._points[vertices], radius)
        number = np.repeat(np.arange(len(vertices)), [len(found) for found in lists])
        near = thin[np.concatenate([np.asarray(found, np.int64) for found in lists])]
        way = (self._points[near] - self._points[vertices[number]]) / radius
        same = np.einsum("ij,ij->i", self._normals[near], self._normals[vertices[number]]) > -0.2
        number, way = number[same], way[same]
        x, y, z = (np.einsum("ij,ij->i", way, axis[number]) for axis in (u, v, self._normals[vertices]))
        across = np.hypot(x, y)
        ring = np.minimum((across * _RINGS).astype(int), _RINGS - 1)
        # The inner rings are too short for all angles: neighbouring bins share what falls into one.
        angle = np.mod(np.arctan2(y, x) / (2 * np.pi) * _ANGLES, _ANGLES)
        row = number * _RINGS + ring
        for spread, weight in ((-1, 0.3), (0, 1.0), (1, 0.3)):
            at = row * _ANGLES + np.mod(np.round(angle).astype(int) + spread, _ANGLES)
            total += weight * np.bincount(at, z, total.size).reshape(shape)
            known += weight * np.bincount(at, minlength=total.size).reshape(shape)
        return np.divide(total, known, out=np.zeros(shape), where=known > 0), known > 0

    def _guesses(self, own: Array, places: Array, here: tuple[Array, Array], there: tuple[Array, Array]) -> list[Pose]:
        """Return the poses under which single profiles fit best."""
        frames_here, frames_there = (np.stack([*tangents(self._normals[v]), self._normals[v]], axis=2) for v in (own, places))
        b, b_known = (values.reshape(len(places), -1) for values in there)
        b_square = b**2 * b_known
        poses = []
        for i in range(len(own)):
            turned, known = [], []
            for mirror in (False, True):
                for k in range(_ANGLES):
                    rows = [part[i] for part in here]
                    if mirror:
                        rows = [np.roll(row[:, ::-1], 1, axis=1) for row in rows]
                    rows = [np.roll(row, k, axis=1).reshape(-1) for row in rows]
                    turned.append(rows[0])
                    known.append(rows[1])
            a, a_known = np.array(turned) * np.array(known), np.array(known, float)
            both = b_known @ a_known.T
            square = b_known @ (a**2).T - 2 * (b * b_known) @ a.T + b_square @ a_known.T
            cost = np.where(both > 0.6 * a_known.sum(axis=1), square / np.maximum(both, 1), np.inf)
            # The best angle at a place, then the best places.
            best = cost.argmin(axis=1)
            value = cost[np.arange(len(places)), best]
            for place in np.argsort(value, kind="stable")[:_GUESSES]:
                if np.isfinite(value[place]):
                    flip, k = divmod(int(best[place]), _ANGLES)
                    poses.append(
                        _between(
                            frames_here[i],
                            frames_there[place],
                            2 * np.pi * k / _ANGLES,
                            bool(flip),
                            self._points[own[i]],
                            self._points[places[place]],
                        )
                    )
        return poses

    def _fit(self, pose: Pose, vertices: Array) -> tuple[Array, Array, Array]:
        """Return where vertices come to lie, their signed distances from the scan there, and its normals."""
        at = pose.apply(self._points[vertices])
        nearest = self._tree.query(at)[1]
        normal = self._normals[nearest]
        away = np.einsum("ij,ij->i", at - self._points[nearest], normal)
        far = np.linalg.norm(at - self._points[nearest], axis=1)
        turned = self._normals[vertices] @ pose.turn.T
        # What faces another way, or lies beyond the scan's border, is as far as its nearest vertex.
        off = (np.einsum("ij,ij->i", turned, normal) < 0.3) | (far > 3 * np.abs(away) + 2 * self._edge)
        return at, np.where(off, np.maximum(far, np.abs(away)), away), normal

    def _residual(self, pose: Pose, vertices: Array, radius: float) -> float:
        away = np.minimum(np.abs(self._fit(pose, vertices)[1]), _FAR * radius)
        return float(np.sqrt((away**2).mean()))

    def _refined(self, pose: Pose, vertices: Array, radius: float) -> Pose | None:
        """Return the pose after point-to-plane registration; None where it runs away."""
        start = pose
        center = self._points[vertices].mean(axis=0)
        for _ in range(_STEPS):
            at, away, normal = self._fit(pose, vertices)
            scale = max(1.5 * float(np.median(np.abs(away))), 1e-9 * radius)
            weight = 1.0 / (1.0 + (away / scale) ** 2)
            middle = pose.apply(center[None])[0]
            rows = np.concatenate([np.cross((at - middle) / radius, normal), normal], axis=1)
            system = (rows * weight[:, None]).T @ rows
            # What the surface leaves open, as sliding along an edge, stays as it is.
            system += 1e-4 * np.trace(system) * np.eye(6)
            move = np.linalg.solve(system, -(rows * weight[:, None]).T @ away)
            rotation = Rotation.from_rotvec(move[:3] / radius).as_matrix()
            pose = pose.after(rotation, middle - rotation @ middle + move[3:])
            if np.abs(move).max() < 1e-5 * radius:
                break
        moved = np.linalg.norm(pose.apply(self._points[vertices]) - start.apply(self._points[vertices]), axis=1).max()
        return pose if moved < radius else None

    def _leads_elsewhere(self, pose: Pose, vertices: Array, missing: Array, radius: float) -> bool:
        """Return whether the hole, with its surroundings, comes to lie beside itself, and on measured surface."""
        center = self._points[vertices].mean(axis=0)
        if np.linalg.norm(pose.apply(center[None])[0] - center) <= 0.9 * radius:
            return False
        away = self._tree.query(pose.apply(missing))[0]
        # The smooth filling may be off by a third of the hole; a hole there leaves its middle empty.
        return bool((away < max(0.35 * radius, 1.5 * self._edge)).mean() > 0.98)


def _thinned(points: Array, grain: float) -> Array:
    """Return one vertex of each cell."""
    cell = np.floor((points - points.min(axis=0)) / grain).astype(np.int64)
    return np.sort(np.unique(cell, axis=0, return_index=True)[1])


def _some(vertices: Array, most: int) -> Array:
    """Return at most so many of vertices (K,), evenly chosen."""
    return vertices[np.linspace(0, len(vertices) - 1, min(len(vertices), most)).astype(int)]


def _spread(points: Array, count: int) -> Array:
    """Return points that lie far apart, one after the other the farthest from those before."""
    chosen = [0]
    away = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < min(count, len(points)):
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def _between(here: Array, there: Array, angle: float, mirror: bool, start: Array, end: Array) -> Pose:
    """Return the pose that lays one frame (its axes are columns), turned and perhaps mirrored first, on another."""
    c, s = np.cos(angle), np.sin(angle)
    plane = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.diag([1.0, -1.0 if mirror else 1.0, 1.0])
    turn = there @ plane @ here.T
    return Pose(turn, end - turn @ start)


def _apart(poses: list[tuple[float, Pose]], points: Array, least: float) -> list[tuple[float, Pose]]:
    """Return the first of those poses that move all points to nearly the same places."""
    out: list[tuple[float, Pose]] = []
    some = points[:: max(1, len(points) // 20)]
    images = np.zeros((len(poses), len(some), 3))
    for residual, pose in poses:
        image = pose.apply(some)
        off = ((images[: len(out)] - image) ** 2).sum(axis=2).max(axis=1)
        if (off > least**2).all():
            images[len(out)] = image
            out.append((residual, pose))
    return out
