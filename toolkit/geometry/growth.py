"""The growing output: patches are searched, copied, fitted and put in place, those of a level together."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.geometry.buckets import Buckets, within
from intaglio.geometry.fitting import PatchFitter
from intaglio.geometry.layout import Layout, PatchPlace
from intaglio.geometry.options import Settings
from intaglio.geometry.swatch import Swatch, layer_heights
from intaglio.kernels.distance_fields import Overlaps, PatchSearch, candidates, signed_distance
from intaglio.kernels.point_surface import PointSurface
from intaglio.randomness import Stream, uniform

# The most patches that are processed together, to bound memory.
_AT_ONCE = 32
# The fewest nodes along a side of a patch that is divided.
_FEWEST_NODES = 6
# The most patches without a candidate whose positions the notes list.
_LISTED = 10


class Growth:
    """Grows an output from a swatch.

    Parameters
    ----------
    swatch : Swatch
    layout : Layout
    settings : Settings
    margin : float
        How far beyond a patch's box to look at what is there.
    seed : int

    Attributes
    ----------
    notes : list of str
    """

    def __init__(self, swatch: Swatch, layout: Layout, settings: Settings, margin: float, seed: int) -> None:
        self.swatch, self.layout, self.settings, self.seed = swatch, layout, settings, seed
        self.notes: list[str] = []
        self._poor = 0
        self._margin = margin
        side = float(settings.patch.min()) / 4
        self._out = Buckets(side, layout.period)
        self._sample = swatch.buckets(side)
        # Every node of a height field has surface within the height of the bounds.
        self._reach = max(swatch.height, 2 * swatch.support)
        # Distances in units of half the height are compared with unit gradients.
        self._scale = 2 / max(swatch.height, 4 * swatch.support)
        field = swatch.field(settings.cell, self._reach)
        field[..., 0] *= self._scale
        self._layers = layer_heights(swatch.height, settings.cell)
        self._search = PatchSearch(field, swatch.device)
        self._fitter = PatchFitter(swatch, settings)

    def grow(self, progress: Progress | None = None) -> None:
        """Lay all patches."""
        done, total = 0, len(self.layout.places)
        for level in self.layout.levels:
            for begin in range(0, len(level), _AT_ONCE):
                part = [self.layout.places[k] for k in level[begin : begin + _AT_ONCE]]
                for place in self._lay(part, divide=True):
                    # Smaller patches may fit where a larger one does not.
                    for quarter in place.quarters():
                        self._lay([quarter], divide=False)
                done += len(part)
                if progress is not None:
                    progress(done, total)

    def records(self) -> Array:
        """Return all records, in the frame of the swatch and of the layout's plane."""
        return self._out.everything()

    def _lay(self, places: list[PatchPlace], *, divide: bool) -> list[PatchPlace]:
        """Lay patches that don't touch; return those for which the swatch has no candidate."""
        old = [self._out.inside(p.low - self._margin, p.high + self._margin) for p in places]
        for records, place in zip(old, places, strict=True):
            records["point"][:, :2] -= place.origin
        surface = self._surface(old)
        begins, errors = self._choose(places, surface)
        poor = errors > self.settings.max_error
        if poor.any():
            smallest = min(float(p.size.min()) for p in places)
            divide = divide and smallest / 2 >= _FEWEST_NODES * self.settings.cell
            for k in np.flatnonzero(poor):
                self._note_misfit(places[k], errors[k], divide)
            if divide:
                left = [p for p, bad in zip(places, poor, strict=True) if bad]
                good = np.flatnonzero(~poor)
                places, old = [places[k] for k in good], [old[k] for k in good]
                begins = [begins[k] for k in good]
                if places:
                    self._put(places, old, self._surface(old), begins)
                return left
        self._put(places, old, surface, begins)
        return []

    def _note_misfit(self, place: PatchPlace, error: float, divided: bool) -> None:
        """Note where no candidate was found; beyond a readable number, only how often."""
        self._poor += 1
        if self._poor > _LISTED:
            rest = f"{self._poor - _LISTED} more patches found no candidate"
            self.notes[-1:] = [rest] if self._poor > _LISTED + 1 else [self.notes[-1], rest]
            return
        where = place.origin + place.size / 2
        what = "four smaller ones were put there" if divided else "the best was taken"
        self.notes.append(f"the patch at {where[0]:.6g}, {where[1]:.6g} found no candidate (error {error:.3g}); {what}")

    def _surface(self, old: list[Array]) -> PointSurface:
        together = np.concatenate(old)
        group = np.repeat(np.arange(len(old)), [len(r) for r in old])
        return PointSurface(together["point"], together["normal"], self.swatch.support, group=group, device=self.swatch.device)

    def _put(self, places: list[PatchPlace], old: list[Array], surface: PointSurface, begins: list[Array]) -> None:
        new = [self._copy(place, begin) for place, begin in zip(places, begins, strict=True)]
        for place, records in zip(places, self._fitter.fit(places, begins, old, surface, new), strict=True):
            records["point"][:, :2] += place.origin
            self._out.remove(place.low, place.high)
            self._out.add(records[within(records["point"], place.low, place.high)])

    def _choose(self, places: list[PatchPlace], surface: PointSurface) -> tuple[list[Array], Array]:
        """Return where in the swatch each patch begins, and its root mean square distance (section 5.1)."""
        cell, layers = self.settings.cell, self._layers
        nodes, first = [], [0]
        for place in places:
            counts = [int(np.floor(side / cell + 1e-9)) + 1 for side in place.size]
            i, j = np.meshgrid(np.arange(counts[0]), np.arange(counts[1]), indexing="ij")
            there = place.overlapping(i * cell, j * cell)
            flat = np.stack([i[there], j[there]], axis=1)
            level = np.tile(np.arange(len(layers)), len(flat))
            nodes.append(np.concatenate([np.repeat(flat, len(layers), axis=0), level[:, None]], axis=1))
            first.append(first[-1] + len(level))
        node = np.concatenate(nodes)
        at = np.stack([node[:, 0] * cell, node[:, 1] * cell, layers[node[:, 2]]], axis=1)
        group = np.repeat(np.arange(len(places)), np.diff(first))
        value = signed_distance(surface, at, group=group, reach=self._reach)
        value[:, 0] *= self._scale
        positions = self._positions(places[0].size)
        distance = self._search.distances(Overlaps(np.array(first), node, value), positions)
        begins, errors = [], np.zeros(len(places))
        for b, place in enumerate(places):
            allowed = candidates(distance[b], self.settings.tolerance)
            # The quarters of a patch share its number and differ in their part.
            pick = uniform(self.seed, Stream.GEOMETRY_PATCH, place.number, place.part)
            index = allowed[int(pick * len(allowed))]
            begins.append(np.array(np.unravel_index(index, positions)) * cell)
            errors[b] = np.sqrt(distance[b].min() / max(first[b + 1] - first[b], 1))
        return begins, errors

    def _positions(self, size: Array) -> tuple[int, int]:
        """Return the columns and rows of nodes at which a patch of ``size`` may begin."""
        counts = [int(np.floor((self.swatch.base[i] - size[i]) / self.settings.cell + 1e-9)) + 1 for i in range(2)]
        return max(counts[0], 1), max(counts[1], 1)

    def _copy(self, place: PatchPlace, begin: Array) -> Array:
        """Return the swatch's geometry for a patch, its extra region and what the warp may pull in, at the patch's place."""
        further = min(self.settings.extra, self.settings.weights.most_distance * float(self.settings.patch.min()))
        records = self._sample.inside(begin - place.extra[:2] - further, begin + place.size + place.extra[2:] + further)
        records["point"][:, :2] -= begin
        records["patch"] = place.number
        return records
