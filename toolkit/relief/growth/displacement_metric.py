"""The displacement metric: relief compared as heights on a tangent grid around each vertex."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.kernels.approximate_search import ApproximateSearch, Patchwork
from intaglio.kernels.geodesics import trace
from intaglio.kernels.launch import threads
from intaglio.kernels.location import GridLocator, polar_grid
from intaglio.kernels.neighborhoods import Matches, NeighborhoodMatcher
from intaglio.mesh import SmoothBase, largest_faces
from intaglio.randomness import Stream, uniform
from intaglio.relief.ground import Ground
from intaglio.relief.growth.comparison import Comparison
from intaglio.relief.growth.propagation import choose_near_best
from intaglio.relief.growth.samples import Samples, with_filled
from intaglio.relief.growth.settings import Selection
from intaglio.relief.growth.state import Picks, State

# Of an approximate search: candidates that are compared in full, how many of the best of them are gone on from, and how many
# neighbours a sample has.
_LANDMARKS, _BEST_LANDMARKS, _BESIDE = 30_000, 32, 8
# Landmarks within this many times the least cost are looked at.
_LANDMARK_FACTOR = 3.0
# Vertices whose grids are located, or read, at a time.
_AT_ONCE = 32_768
# Targets whose votes are summed at a time.
_VOTES_AT_ONCE = 4096


class DisplacementMetric:
    """Relief as a height over a grid in the tangent plane, laid on the base by its exponential map.

    The grid is located on the base's triangulation once per vertex; what is compared are heights interpolated there, and with
    them colours and coarser relief. A grid point counts as textured where all corners that carry its triangle's weight are. A
    candidate is viable only if it has every grid point that the target has (the papers' rule that every partner be textured).
    Interpolated linearly, a subdivided surface is the same one: oversampling adds samples here, and nothing else.

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
        See `NeighborhoodMatcher`.
    comparison : Comparison
        What is compared beside relief.
    approximate : bool
        Search near matched neighbours and landmarks instead of comparing every sample.
    keep_grids : bool
        Hold the targets' located grids (12 bytes a point); else they are located anew whenever they are read.
    seed : int
        Of the approximate search.
    partners : {"measured", "textured"}
        What counts as known around a sample: see `ReliefSettings`.
    """

    def __init__(
        self,
        ground: Ground,
        samples: Samples,
        window: int,
        rotations: int,
        device: str,
        engine: str = "auto",
        *,
        comparison: Comparison | None = None,
        approximate: bool = False,
        keep_grids: bool = True,
        seed: int = 0,
        partners: str = "measured",
    ) -> None:
        self.samples = self._measured_samples = samples
        self._partners = partners
        self.device, self.engine = device, engine
        self._ground = ground
        self._comparison = Comparison() if comparison is None else comparison
        self._approximate, self._seed, self._calls = approximate, seed, 0
        offsets, self._ring, self._permutation = polar_grid(max(window, 2), rotations)
        self._factors = self._comparison.factors()
        points = len(self._ring)
        self._turns = np.concatenate([self._permutation + c * points for c in range(len(self._factors))], axis=1)
        # Kernels work in units of the spacing near the origin: single precision is enough there, whatever the survey's
        # coordinates and unit.
        self._offsets = offsets
        self._ring_weight = gaussian_weights(self._ring, max(window, 2))
        self._rotations = rotations
        self._center = ground.foot.mean(axis=0)
        kind, origin, axis, radius = ground.base.kernel_parameters
        self._unit_foot = (ground.foot - self._center) / ground.spacing
        self._locator = GridLocator(
            self._unit_foot,
            ground.faces,
            ground.topology.across,
            kind,
            (origin - self._center) / ground.spacing,
            axis,
            radius / ground.spacing,
            device,
        )
        known_height = ground.height[ground.measured]
        spread = float(known_height.std())
        self._scale = spread if spread > 1e-12 * max(ground.spacing, 1e-300) else 1.0
        self._levels = [float(v[ground.measured].mean()) for v in self._comparison.values(ground.height, ground.color)]
        self._face_at = largest_faces(ground.faces, ground.foot)
        self._everything = self._upload_textured(np.ones(len(ground.measured), bool))
        self._targets = np.flatnonzero(~ground.measured)
        self._row = np.full(len(ground.measured), -1)
        self._row[self._targets] = np.arange(len(self._targets))
        self._target_grid = self._locate_vertices(self._targets) if keep_grids else None
        self._take_samples(samples, ground.measured, ground.height, ground.color)

    def pick(self, targets: Array, window: Array, state: State, selection: Selection, draw: Array) -> Picks:
        """See `Metric.pick`."""
        candidate = np.full(len(targets), -1)
        cost = np.full(len(targets), np.inf)
        fields = self._fields(state.height, state.color)
        textured = self._upload_textured(state.textured)
        if self._partners == "textured":
            self._read_grown(fields, textured)
        for first in range(0, len(targets), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            value, weight, supported = self._neighborhoods(targets[part], window[part], fields, textured)
            chosen, found = self._choose(targets[part], value, weight, state, selection, draw[part])
            candidate[part] = np.where(supported, chosen, -1)
            cost[part] = found
        self._calls += 1
        count = len(self.samples.vertex)
        return Picks(
            np.where(candidate >= 0, candidate % count, -1),
            np.where(candidate >= 0, 2 * np.pi / self._rotations * (candidate // count), 0).astype(np.float32),
            np.where(candidate >= 0, cost * self._scale**2, np.inf),
        )

    def absorb(self, state: State) -> None:
        """See `Metric.absorb`."""
        samples = with_filled(
            self._measured_samples, self._ground, state.textured, state.height, state.source, state.rotation, state.color
        )
        self._take_samples(samples, state.textured, state.height, state.color)

    def neighborhoods(self, targets: Array, window: Array, state: State) -> tuple[Array, Array, Array]:
        """Return values (T, G C) and weights (T, G C) of G grid points in C channels, and (T,) whether anything is known.

        Weights of relief (and of each colour) sum to 1 over what is known.
        """
        fields = self._fields(state.height, state.color)
        return self._neighborhoods(targets, window, fields, self._upload_textured(state.textured))

    def vote(self, targets: Array, picks: Picks, rows: Array, window: int, confidence: Array) -> tuple[Array, Array | None]:
        """See `VotingMetric.vote`."""
        ground = self._ground
        sample = picks.sample[rows]
        turn = np.round(picks.rotation[rows] * self._rotations / (2 * np.pi)).astype(int) % self._rotations
        inside = np.flatnonzero(self._ring <= window)
        points = len(self._ring)
        channels = 4 if self._comparison.color_weight > 0 else 1
        total = np.zeros((channels, len(ground.measured)))
        norm = np.zeros(len(ground.measured))
        held = None if self._target_grid is None else [array.numpy() for array in self._target_grid]
        # In blocks of a bounded size; bincount adds in index order, so the sums have the same bits every time.
        for first in range(0, len(targets), _VOTES_AT_ONCE):
            part = slice(first, first + _VOTES_AT_ONCE)
            face, weight = [array.numpy() for array in self._locate_vertices(targets[part])] if held is None else held
            grid_rows = np.arange(len(targets[part])) if held is None else self._row[targets[part]]
            f, b = (array[grid_rows[:, None], inside[None, :]] for array in (face, weight))
            at = self._permutation[turn[part]][:, inside]
            own = sample[part][:, None]
            known = (self._known[own, at] > 0) & (f >= 0)
            power = np.where(known, self._ring_weight[inside] * confidence[part][:, None], 0.0)
            corner_weight = np.stack([b[..., 0], b[..., 1], 1 - b[..., 0] - b[..., 1]], axis=-1) * power[..., None]
            corner = ground.faces[np.maximum(f, 0)].reshape(-1)
            norm += np.bincount(corner, corner_weight.reshape(-1), len(norm))
            for c in range(channels):
                value = self._value[own, at + c * points]
                total[c] += np.bincount(corner, (corner_weight * value[..., None]).reshape(-1), len(norm))
        mean = np.divide(total, norm, out=np.full(total.shape, np.nan), where=norm > 0)[:, self._targets]
        said = [mean[c] * self._scale / (self._factors[c][0] or 1.0) + self._levels[c] for c in range(channels)]
        return said[0], None if channels == 1 else np.stack(said[1:], axis=1)

    def _choose(
        self, targets: Array, value: Array, weight: Array, state: State, selection: Selection, draw: Array
    ) -> tuple[Array, Array]:
        if selection.rule == "near-best":
            matches = self._matches(targets, value, weight, state, 1 + selection.tolerance, draw)
            tolerance = selection.tolerance
            return choose_near_best(matches.candidate, matches.cost, matches.count, tolerance, draw, matches.spare)
        ranked = self._matcher.pick_ranked(value, weight, selection.eta / 100, draw)
        return np.where(ranked.count > 0, ranked.candidate[:, 0], -1), ranked.cost[:, 0]

    def _matches(self, targets: Array, value: Array, weight: Array, state: State, factor: float, draw: Array) -> Matches:
        if not self._approximate:
            return self._matcher.match(value, weight, factor, draw)
        coarse = self._matcher.match(value, weight, _LANDMARK_FACTOR)
        order = np.argsort(coarse.cost, axis=1, kind="stable")[:, :_BEST_LANDMARKS]
        best = np.take_along_axis(coarse.candidate, order, axis=1)
        of_all = best // len(self._landmarks) * len(self.samples.vertex) + self._landmarks[best % len(self._landmarks)]
        listed = np.arange(order.shape[1]) < coarse.count[:, None]
        ground = self._ground
        patchwork = Patchwork(
            self._unit_foot,
            ground.u,
            ground.v,
            ground.topology.offsets,
            ground.topology.neighbors,
            state.sample,
            state.rotation,
        )
        seed = int(2**31 * uniform(self._seed, Stream.RELIEF_LANDMARKS, 1 + self._calls))
        return self._search.match(targets, value, weight, patchwork, np.where(listed, of_all, -1), factor, seed)

    def _neighborhoods(
        self, targets: Array, window: Array, fields: Sequence[wp.array], textured: wp.array
    ) -> tuple[Array, Array, Array]:
        rows, grid = self._grids(targets)
        values, weights = [], []
        for (_, everywhere), field in zip(self._factors, fields, strict=True):
            value, known = self._locator.gather(rows, grid, field, self._everything if everywhere else textured)
            known_here = known.numpy() > 0
            # The ring next to a target lies in triangles that have the target itself as a corner: a window that shrinks to it
            # reaches on to the nearest ring where anything is known.
            nearest = np.where(known_here, self._ring, self._ring[-1]).min(axis=1)
            weight = known_here * self._ring_weight * (self._ring <= np.maximum(window, nearest)[:, None])
            total = weight.sum(axis=1, keepdims=True)
            values.append(value.numpy().copy())
            weights.append(weight / np.maximum(total, 1e-30))
        supported = sum(w.sum(axis=1) for w in weights) > 0
        return np.concatenate(values, axis=1), np.concatenate(weights, axis=1), np.asarray(supported)

    def _take_samples(self, samples: Samples, textured: Array, height: Array, color: Array | None) -> None:
        fields, known_at = self._fields(height, color), self._upload_textured(textured)
        self.samples = samples
        count = len(samples.vertex)
        shape = (count, len(self._ring) * len(fields))
        self._value, self._known = np.zeros(shape, np.float32), np.zeros(shape, bool)
        self._read_samples(np.arange(count), fields, known_at)
        complete = np.asarray(self._known[:, np.flatnonzero(self._ring <= 1)].all(axis=1))
        if not complete.any():
            raise InputError(
                f"fewer samples than the smallest window needs: none of {count} samples has measured surface "
                f"all around it at a distance of {self._ground.spacing:.4g}; give a smaller spacing or more of the surface"
            )
        compared = np.arange(count)
        if self._approximate:
            compared = self._lay_landmarks(complete)
        self._matcher = self._matcher_of(compared)

    def _matcher_of(self, compared: Array) -> NeighborhoodMatcher:
        return NeighborhoodMatcher(
            self._value[compared], self._known[compared], self._turns, device=self.device, engine=self.engine
        )

    def _read_samples(self, numbers: Array, fields: Sequence[wp.array], known_at: wp.array) -> None:
        """Read the neighbourhoods of the samples with these numbers."""
        samples, points = self.samples, len(self._ring)
        for first in range(0, len(numbers), _AT_ONCE):
            part = numbers[first : first + _AT_ONCE]
            grid = self._locate(samples.foot[part], samples.u[part], samples.v[part], samples.first_face[part])
            for c, ((_, everywhere), field) in enumerate(zip(self._factors, fields, strict=True)):
                columns = slice(c * points, (c + 1) * points)
                value, known = self._locator.gather(
                    np.arange(len(part)), grid, field, self._everything if everywhere else known_at
                )
                self._value[part, columns], self._known[part, columns] = value.numpy(), known.numpy() > 0

    def _read_grown(self, fields: Sequence[wp.array], textured: wp.array) -> None:
        """Read what was filled since around samples whose surroundings are not whole."""
        partial = np.flatnonzero(~self._known.all(axis=1))
        before = int(self._known[partial].sum())
        self._read_samples(partial, fields, textured)
        if int(self._known[partial].sum()) > before:
            self._matcher = self._matcher_of(np.arange(len(self._known)))

    def _lay_landmarks(self, complete: Array) -> Array:
        """Choose the samples that are compared in full, and set up the search from them."""
        samples = self.samples
        foot = (samples.foot - self._center) / self._ground.spacing
        # Never itself; a single sample has none beside it but itself.
        beside = list(range(2, min(_BESIDE + 1, len(foot)) + 1)) or [1]
        nearest = cKDTree(foot).query(foot, k=beside, workers=threads())[1]
        self._search = ApproximateSearch(
            self._value, self._known, self._turns, nearest, foot, samples.u, samples.v, self.device
        )  # fmt: skip
        # Samples with an incomplete grid can match few targets: they are reached from their neighbours.
        whole = np.flatnonzero(self._known.all(axis=1))
        if len(whole) < 0.1 * len(foot):
            whole = np.flatnonzero(complete)
        wanted = max(500, _LANDMARKS // self._rotations)
        order = np.argsort(uniform(self._seed, Stream.RELIEF_LANDMARKS, whole, 0), kind="stable")
        self._landmarks = np.sort(whole[order[:wanted]])
        return self._landmarks

    def _grids(self, targets: Array) -> tuple[Array, tuple[wp.array, wp.array]]:
        """Located grids, and the rows of them that belong to some targets."""
        if self._target_grid is None:
            return np.arange(len(targets)), self._locate_vertices(targets)
        return self._row[targets], self._target_grid

    def _locate_vertices(self, vertices: Array) -> tuple[wp.array, wp.array]:
        ground = self._ground
        return self._locate(ground.foot[vertices], ground.u[vertices], ground.v[vertices], self._face_at[vertices])

    def _locate(self, foot: Array, u: Array, v: Array, first_face: Array) -> tuple[wp.array, wp.array]:
        unit_foot = (foot - self._center) / self._ground.spacing
        if isinstance(self._ground.base, SmoothBase):
            mesh = self._locator
            return trace(unit_foot, u, v, first_face, self._offsets, mesh.points, mesh.faces, mesh.across, self.device)
        return self._locator.locate(unit_foot, u, v, first_face, self._offsets, 0.05)

    def _fields(self, height: Array, color: Array | None) -> list[wp.array]:
        """The channels' values as they are compared: about their mean, times their factor, in units of the relief's spread."""
        return [
            wp.array(((value - level) * (factor / self._scale)).astype(np.float32), dtype=float, device=self.device)
            for value, level, (factor, _) in zip(self._comparison.values(height, color), self._levels, self._factors, strict=True)
        ]

    def _upload_textured(self, textured: Array) -> wp.array:
        return wp.array(textured.astype(np.uint8), dtype=wp.uint8, device=self.device)


def gaussian_weights(ring: Array, window: int) -> Array:
    """Weights (G,) of the grid: a Gaussian of the distance, times the area that a grid point stands for.

    The papers leave the Gaussian's width open; Efros & Leung take a window of 6.4 sigma, which is followed here.
    """
    sigma = (2 * window + 1) / 6.4
    points = np.bincount(ring, minlength=window + 1)
    area = np.where(np.arange(window + 1) == 0, np.pi / 4, 2 * np.pi * np.arange(window + 1)) / points
    return (area[ring] * np.exp(-0.5 * (ring / sigma) ** 2)).astype(np.float32)
