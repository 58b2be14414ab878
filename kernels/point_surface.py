"""Surfaces of points with normals, held in a hashed grid: what the kernels of `points` are asked through."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload
from intaglio.kernels.points import PointGrid, nearest_kernel, project_kernel, variation_kernel


@dataclass(frozen=True)
class Feet:
    """Projections on a surface.

    Attributes
    ----------
    points, normals : (K, 3) float32 arrays
    found : (K,) bool array
        False: no surface within reach; position and normal are then those given.
    """

    points: np.ndarray
    normals: np.ndarray
    found: np.ndarray


class PointSurface:
    """The surface of points with normals, in a hashed grid; separate sets are groups that don't see each other.

    Its ``point_grid`` is what kernels take.

    Parameters
    ----------
    points, normals : (N, 3) arrays
        Used as float32: subtract far origins first. Unit normals.
    support : float
        Radius R of the weights; two to four times the distance of samples.
    group : (N,) int array, optional
        The set of each point; default: one set, 0.
    hermite : bool
        Correct averages for the surface's bending by the neighbours' tangent planes (see `local_plane`); False: Adamson &
        Alexa's surface as it is, which shrinks wires thinner than the support.
    device : str
        From `choose_device`.
    """

    def __init__(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        support: float,
        *,
        group: np.ndarray | None = None,
        hermite: bool = True,
        device: str = "cpu",
    ) -> None:
        self.device, self.support, self.hermite = device, float(support), float(hermite)
        count = len(points)
        group = np.zeros(count, np.int32) if group is None else np.ascontiguousarray(group, np.int32)
        points = np.ascontiguousarray(points, np.float32)
        # Neighbours in space become neighbours in memory, which halves the time of every query.
        key, spans = group.astype(np.int64), []
        for axis in range(3):
            cell = np.floor(points[:, axis] / np.float32(support)).astype(np.int64)
            cell -= cell.min() if count else 0
            spans.append(int(cell.max(initial=0)) + 1)
            key = key * spans[axis] + cell
        self.order = np.argsort(key, kind="stable")
        self.points = upload(points[self.order], wp.vec3, device)
        self.normals = upload(np.asarray(normals)[self.order], wp.vec3, device)
        self.group = upload(group[self.order], wp.int32, device)
        side = [int(np.clip(span + 2, 4, 1024)) for span in spans]
        while np.prod(side, dtype=wp.float32) > 1 << 22:
            side[int(np.argmax(side))] //= 2
        self._grid = wp.HashGrid(*side, device=device)
        if count:
            self._grid.reserve(count, with_groups=True)
            self._grid.build(self.points, radius=self.support, groups=self.group)
        self.point_grid = PointGrid()
        self.point_grid.grid = self._grid.id
        self.point_grid.points, self.point_grid.normals, self.point_grid.group = self.points, self.normals, self.group
        self.point_grid.support, self.point_grid.hermite = self.support, self.hermite

    def __len__(self) -> int:
        return len(self.order)

    def project(
        self,
        at: np.ndarray,
        *,
        facing: np.ndarray | None = None,
        group: np.ndarray | None = None,
        reach: float,
        along: bool = False,
    ) -> Feet:
        """Project positions quasi-orthogonally on the surface.

        Parameters
        ----------
        at : (K, 3) array
        facing : (K, 3) array, optional
            Only points whose normals have a positive product with this take part; default: the side of the nearest point.
        group : (K,) int array, optional
            The set that each position is projected on.
        reach : float
            How far to look for a surface.
        along : bool
            First look where the line along ±``facing`` meets the surface.
        """
        at = np.ascontiguousarray(at, np.float32)
        count = len(at)
        sides = np.zeros((count, 3), np.float32) if facing is None else np.ascontiguousarray(facing, np.float32)
        if not len(self) or not count:
            return Feet(at, sides, np.zeros(count, bool))
        foot = wp.empty(count, dtype=wp.vec3, device=self.device)
        normal = wp.empty(count, dtype=wp.vec3, device=self.device)
        found = wp.empty(count, dtype=wp.int32, device=self.device)
        launch(
            project_kernel,
            count,
            inputs=[self.point_grid, *self._queries(at, sides, group), float(reach), int(along)],
            outputs=[foot, normal, found],
            device=self.device,
            work=3000,
        )
        return Feet(foot.numpy().copy(), normal.numpy().copy(), found.numpy() == 1)

    def nearest(
        self, at: np.ndarray, *, facing: np.ndarray | None = None, group: np.ndarray | None = None, reach: float
    ) -> np.ndarray:
        """Return the index of the nearest point (as given, not as sorted), -1 where there is none within ``reach``."""
        at = np.ascontiguousarray(at, np.float32)
        sides = np.zeros((len(at), 3), np.float32) if facing is None else np.ascontiguousarray(facing, np.float32)
        if not len(self) or not len(at):
            return np.full(len(at), -1)
        index = wp.empty(len(at), dtype=wp.int32, device=self.device)
        launch(
            nearest_kernel,
            len(at),
            inputs=[self.point_grid, *self._queries(at, sides, group), float(reach)],
            outputs=[index],
            device=self.device,
            work=500,
        )
        found = index.numpy()
        return np.where(found >= 0, self.order[np.maximum(found, 0)], -1)

    def variation(self, radius: float) -> np.ndarray:
        """Return the surface variation (N,) float32 in [0, 1/3] of each point's neighbours within ``radius``."""
        value = wp.empty(len(self), dtype=wp.float32, device=self.device)
        launch(
            variation_kernel,
            len(self),
            inputs=[self.point_grid, float(radius)],
            outputs=[value],
            device=self.device,
            work=1000,
        )
        out = np.empty(len(self), np.float32)
        out[self.order] = value.numpy()
        return out

    def _queries(self, at: np.ndarray, sides: np.ndarray, group: np.ndarray | None) -> list[wp.array]:
        groups = np.zeros(len(at), np.int32) if group is None else group
        return [upload(at, wp.vec3, self.device), upload(sides, wp.vec3, self.device), upload(groups, wp.int32, self.device)]
