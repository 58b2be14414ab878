"""The displacement metric: relief compared as heights on a tangent grid around each vertex."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.errors import InputError
from intaglio.kernels.geodesics import trace
from intaglio.kernels.location import GridLocator, polar_grid
from intaglio.kernels.neighbourhoods import NeighbourhoodMatcher
from intaglio.relief.prepare import Ground
from intaglio.relief.propagate import Picks, Selection, State, choose_near_best
from intaglio.relief.smooth_base import SmoothBase
from intaglio.relief.samples import Samples, filled_sample_set

Array = np.ndarray


class DisplacementMetric:
    """Relief as a height over a grid in the tangent plane, laid on the base by its exponential map.

    The grid is located on the base's triangulation once per vertex; what is compared are heights interpolated there. A grid
    point counts as textured where all corners that carry its triangle's weight are. A candidate is viable only if it has
    every grid point that the target has (the papers' rule that every partner be textured).

    Parameters
    ----------
    ground : Ground
    samples : Samples
    window : int
        Rings w; the grid reaches ``w * spacing`` along the base.
    rotations : int
        R, at least 1.
    device : str
    engine : {"auto", "blas", "warp"}
        See `NeighbourhoodMatcher`.
    """

    def __init__(self, ground: Ground, samples: Samples, window: int, rotations: int, device: str, engine: str = "auto") -> None:
        self.samples = samples
        self.device, self.engine = device, engine
        self._ground = ground
        offsets, self._ring, self._permutation = polar_grid(max(window, 2), rotations)
        # Kernels work in units of the spacing near the origin: single precision is enough there, whatever the survey's
        # coordinates and unit.
        self._offsets = offsets
        self._ring_weight = gaussian_weights(self._ring, max(window, 2))
        self._rotations = rotations
        self._center = ground.foot.mean(axis=0)
        kind, origin, axis, radius = ground.base.kernel_parameters
        self._locator = GridLocator(
            (ground.foot - self._center) / ground.spacing,
            ground.faces,
            ground.topology.across,
            kind,
            (origin - self._center) / ground.spacing,
            axis,
            radius / ground.spacing,
            device,
        )
        known_height = ground.height[ground.measured]
        self._level = float(known_height.mean())
        spread = float(known_height.std())
        self._scale = spread if spread > 1e-12 * max(ground.spacing, 1e-300) else 1.0
        self._targets = np.flatnonzero(~ground.measured)
        self._row = np.full(len(ground.measured), -1)
        self._row[self._targets] = np.arange(len(self._targets))
        first = ground.topology.incident[ground.topology.face_offsets[self._targets]]
        self._target_grid = self._locate(ground.foot[self._targets], ground.u[self._targets], ground.v[self._targets], first)
        self._take_samples(samples, self._textured(ground.measured), self._heights(ground.height))

    def pick(self, targets: Array, window: Array, state: State, selection: Selection, draw: Array) -> Picks:
        """See `Metric.pick`."""
        value, weight, supported = self.neighbourhoods(targets, window, state)
        if selection.rule == "near-best":
            matches = self._matcher.match(value, weight, selection.factor)
            chosen, cost = choose_near_best(matches.candidate, matches.cost, matches.count, selection.factor, draw)
        else:
            matches = self._matcher.ranked(value, weight, selection.eta / 100, draw)
            chosen = np.where(matches.count > 0, matches.candidate[:, 0], -1)
            cost = matches.cost[:, 0]
        chosen = np.where(supported, chosen, -1)
        count = self._matcher.samples
        return Picks(
            np.where(chosen >= 0, chosen % count, -1),
            np.where(chosen >= 0, 2 * np.pi / self._rotations * (chosen // count), 0).astype(np.float32),
            np.where(chosen >= 0, cost * self._scale**2, np.inf),
        )

    def absorb(self, state: State) -> None:
        """See `Metric.absorb`."""
        samples = filled_sample_set(self._ground, state.textured, state.height, state.source, state.rotation, state.color)
        self._take_samples(samples, self._textured(state.textured), self._heights(state.height))

    def neighbourhoods(self, targets: Array, window: Array, state: State) -> tuple[Array, Array, Array]:
        """Return heights (T, G) and weights (T, G) that sum to 1 over what is known, and (T,) whether anything is."""
        value, known = self._locator.gather(
            self._row[targets],
            self._target_grid,
            self._heights(state.height),
            self._textured(state.textured),
        )
        known_here = known.numpy() > 0
        # The ring next to a target lies in triangles that have the target itself as a corner: a window that shrinks to it
        # reaches on to the nearest ring where anything is known.
        nearest = np.where(known_here, self._ring, self._ring[-1]).min(axis=1)
        weight = known_here * self._ring_weight * (self._ring <= np.maximum(window, nearest)[:, None])
        total = weight.sum(axis=1, keepdims=True)
        return value.numpy(), weight / np.maximum(total, 1e-30), total[:, 0] > 0

    def vote(self, targets: Array, picks: Picks, rows: Array, window: int, confidence: Array) -> Array:
        """Return what the matched patches say about each target's height, (all targets,), NaN where none covers it.

        Parameters
        ----------
        targets : (T,) array
            Vertices whose matches vote.
        picks : Picks
            Matches; ``rows`` (bool) selects those of ``targets``.
        window : int
            Rings of the patches.
        confidence : (T,) array
            Weight of each patch.
        """
        ground = self._ground
        sample = picks.sample[rows]
        turn = np.round(picks.rotation[rows] * self._rotations / (2 * np.pi)).astype(int) % self._rotations
        face, weight = (a.numpy() for a in self._target_grid)
        inside = np.flatnonzero(self._ring <= window)
        total = np.zeros(len(ground.measured))
        norm = np.zeros(len(ground.measured))
        # In blocks of a bounded size; bincount adds in index order, so the sums have the same bits every time.
        for first in range(0, len(targets), 2048):
            part = slice(first, first + 2048)
            grid_row = self._row[targets[part]][:, None]
            at = self._permutation[turn[part]][:, inside]
            value = self._value[sample[part][:, None], at]
            known = self._known[sample[part][:, None], at] > 0
            f = face[grid_row, inside[None, :]]
            b = weight[grid_row, inside[None, :]]
            known &= f >= 0
            power = np.where(known, self._ring_weight[inside] * confidence[part][:, None], 0.0)
            corner_weight = np.stack([b[..., 0], b[..., 1], 1 - b[..., 0] - b[..., 1]], axis=-1) * power[..., None]
            corner = ground.faces[np.maximum(f, 0)].reshape(-1)
            total += np.bincount(corner, (corner_weight * value[..., None]).reshape(-1), len(total))
            norm += np.bincount(corner, corner_weight.reshape(-1), len(norm))
        voted = np.divide(total, norm, out=np.full(len(total), np.nan), where=norm > 0)
        return (voted * self._scale + self._level)[self._targets]

    def _take_samples(self, samples: Samples, textured: wp.array, height: wp.array) -> None:
        grid = self._locate(samples.foot, samples.u, samples.v, samples.first_face)
        value, known = self._locator.gather(np.arange(len(samples.vertex)), grid, height, textured)
        self.samples = samples
        if not known.numpy()[:, self._ring <= 1].all(axis=1).any():
            raise InputError(
                f"fewer samples than the smallest window needs: none of {len(samples.vertex)} samples has measured surface "
                f"all around it at a distance of {self._ground.spacing:.4g}; give a smaller spacing or more of the surface"
            )
        self._value, self._known = value.numpy(), known.numpy()
        self._matcher = NeighbourhoodMatcher(self._value, self._known, self._permutation, device=self.device, engine=self.engine)

    def _locate(self, foot: Array, u: Array, v: Array, first_face: Array) -> tuple[wp.array, wp.array]:
        unit_foot = (foot - self._center) / self._ground.spacing
        if isinstance(self._ground.base, SmoothBase):
            mesh = self._locator
            return trace(unit_foot, u, v, first_face, self._offsets, mesh.points, mesh.faces, mesh.across, self.device)
        return self._locator.locate(unit_foot, u, v, first_face, self._offsets, 0.05)

    def _heights(self, height: Array) -> wp.array:
        return wp.array(((height - self._level) / self._scale).astype(np.float32), dtype=float, device=self.device)

    def _textured(self, textured: Array) -> wp.array:
        return wp.array(textured.astype(np.uint8), dtype=wp.uint8, device=self.device)


def gaussian_weights(ring: Array, window: int) -> Array:
    """Weights (G,) of the grid: a Gaussian of the distance, times the area that a grid point stands for.

    The papers leave the Gaussian's width open; Efros & Leung take a window of 6.4 sigma, which is followed here.
    """
    sigma = (2 * window + 1) / 6.4
    points = np.bincount(ring, minlength=window + 1)
    area = np.where(np.arange(window + 1) == 0, np.pi / 4, 2 * np.pi * np.arange(window + 1)) / points
    return (area[ring] * np.exp(-0.5 * (ring / sigma) ** 2)).astype(np.float32)
