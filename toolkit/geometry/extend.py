"""Larger geometry textures from a swatch, patch by patch (Duranleau & Poulin)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from intaglio.checks import checked_count, checked_number
from intaglio.devices import device_or_error
from intaglio.errors import InputError, IntaglioWarning
from intaglio.geometry.buckets import RECORD, Buckets
from intaglio.geometry.fitting import PatchFitter
from intaglio.geometry.layout import Layout, PatchPlace, lay_out
from intaglio.geometry.options import PairingWeights, checked_weights, pair
from intaglio.geometry.point_set import GeometryTexture, PointSet
from intaglio.geometry.spreading import relaxed
from intaglio.geometry.swatch import Swatch, layer_heights
from intaglio.kernels.distance_fields import Overlaps, PatchSearch, candidates, signed_distance
from intaglio.kernels.points import PointSurface
from intaglio.randomness import checked_seed, uniform

Array = np.ndarray

# Patches worked on at once; bounds memory.
_AT_ONCE = 32
_SEED_STREAM = 61


@dataclass(frozen=True)
class Settings:
    """What the patches are searched, warped and blended with; lengths in the input's unit."""

    patch: Array
    overlap: float
    extra: float
    cell: float
    tolerance: float
    pairs: int
    rounds: int
    smoothing: float
    weights: PairingWeights
    max_error: float
    warp: bool
    blend: bool


def extend_geometry(
    texture: GeometryTexture,
    size: float | tuple[float, float],
    patch: float | tuple[float, float] | None = None,
    *,
    overlap: float | None = None,
    extra: float | None = None,
    cell: float | None = None,
    tolerance: float = 0.1,
    weights: PairingWeights | str = "auto",
    pairs: int = 100,
    rounds: int = 3,
    smoothing: float = 1e-3,
    warp: bool = True,
    blend: bool = True,
    relax: int = 3,
    max_error: float | None = None,
    toroidal: bool = False,
    seed: int = 0,
    device: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> PointSet:
    """X."""
    device = device_or_error(device)
    seed = checked_seed(seed)
    wanted = pair(size, "size")
    sides = pair(patch, "patch") if patch is not None else np.full(2, texture.base.min() / 3)
    overlap = checked_number("overlap", sides.min() / 3 if overlap is None else overlap, 0)
    extra = checked_number("extra", sides.min() / 4 if extra is None else extra, 0)
    swatch = Swatch(texture, extra, device)
    cell = checked_number("cell", max(sides.min() / 16, swatch.spacing) if cell is None else cell, 0)
    chosen = checked_weights(weights) or checked_weights("weave")
    settings = Settings(
        sides, overlap, extra, cell, tolerance, pairs, rounds, smoothing, chosen,
        np.inf if max_error is None else max_error, warp, blend,
    )
    layout = lay_out(wanted, sides, overlap, extra, max(extra, 2 * swatch.support), toroidal=toroidal)
    grower = _Grower(swatch, layout, settings, seed)
    grower.grow(progress)
    records = grower.finished()
    if relax:
        records = relaxed(records, swatch, layout.period, relax)
    inside = ((records["point"][:, :2] >= layout.low) & (records["point"][:, :2] < layout.high)).all(axis=1)
    records = records[inside]
    return PointSet(
        swatch.to_world(records["point"] + (0, 0, swatch.origin[2])),
        swatch.to_world(records["normal"].astype(float)),
        source=records["source"],
        moved=records["moved"],
        notes=tuple(swatch.notes + grower.notes),
    )


class _Grower:
    """The growing output."""

    def __init__(self, swatch: Swatch, layout: Layout, settings: Settings, seed: int) -> None:
        self.swatch, self.layout, self.settings, self.seed = swatch, layout, settings, seed
        self.notes: list[str] = []
        side = float(settings.patch.min()) / 4
        period = layout.period
        self.out = Buckets(side, period)
        self.sample = swatch.buckets(side)
        self.reach = max(swatch.height, 2 * swatch.support)
        # Distances count against unit gradients in half the height of the bounds.
        self.scale = 2 / max(swatch.height, 4 * swatch.support)
        field = swatch.field(settings.cell, self.reach)
        field[..., 0] *= self.scale
        self.columns = field.shape[:2]
        self.layers = layer_heights(swatch.height, settings.cell)
        self.search = PatchSearch(field, swatch.device)
        self.fitter = PatchFitter(swatch, settings)

    def positions(self, size: Array) -> tuple[int, int]:
        """Nodes at which a patch of ``size`` may begin."""
        cell = self.settings.cell
        counts = [int(np.floor((self.swatch.base[i] - size[i]) / cell + 1e-9)) + 1 for i in range(2)]
        return counts[0], counts[1]

    def grow(self, progress: Callable[[int, int], None] | None) -> None:
        done, total = 0, len(self.layout.places)
        for level in self.layout.levels:
            for begin in range(0, len(level), _AT_ONCE):
                self._lay([self.layout.places[k] for k in level[begin : begin + _AT_ONCE]])
            done += len(level)
            if progress is not None:
                progress(done, total)

    def finished(self) -> Array:
        return self.out.everything()

    def _lay(self, places: list[PatchPlace]) -> None:
        margin = self.layout_margin
        old = [self.out.inside(p.low - margin, p.high + margin) for p in places]
        for records, place in zip(old, places, strict=True):
            records["point"][:, :2] -= place.origin
        group = np.repeat(np.arange(len(places)), [len(r) for r in old])
        together = np.concatenate(old)
        surface = PointSurface(
            together["point"], together["normal"], self.swatch.support, group=group, device=self.swatch.device
        )
        begins = self._choose(places, surface)
        new = [self._copy(place, begin) for place, begin in zip(places, begins, strict=True)]
        made = self.fitter.fitted(places, old, surface, new)
        for place, records in zip(places, made, strict=True):
            records["point"][:, :2] += place.origin
            inside = ((records["point"][:, :2] >= place.low) & (records["point"][:, :2] < place.high)).all(axis=1)
            self.out.remove(place.low, place.high)
            self.out.add(records[inside])

    @property
    def layout_margin(self) -> float:
        return max(self.settings.extra, 2 * self.swatch.support)

    def _choose(self, places: list[PatchPlace], surface: PointSurface) -> list[Array]:
        """Return where in the swatch each patch begins (section 5.1)."""
        cell = self.settings.cell
        nodes, values, first = [], [], [0]
        for place in places:
            counts = [int(np.floor(side / cell + 1e-9)) + 1 for side in place.size]
            i, j = np.meshgrid(np.arange(counts[0]), np.arange(counts[1]), indexing="ij")
            there = place.overlapping(i * cell, j * cell)
            flat = np.stack([i[there], j[there]], axis=1)
            node = np.concatenate(
                [np.repeat(flat, len(self.layers), axis=0), np.tile(np.arange(len(self.layers)), len(flat))[:, None]], axis=1
            )
            nodes.append(node)
            first.append(first[-1] + len(node))
        node = np.concatenate(nodes).reshape(-1, 3)
        at = np.stack([node[:, 0] * cell, node[:, 1] * cell, self.layers[node[:, 2]]], axis=1)
        group = np.repeat(np.arange(len(places)), np.diff(first))
        value = signed_distance(surface, at, group=group, reach=self.reach)
        value[:, 0] *= self.scale
        positions = self.positions(places[0].size)
        distance = self.search.distances(Overlaps(np.array(first), node, value), positions)
        begins = []
        for b, place in enumerate(places):
            allowed = candidates(distance[b], self.settings.tolerance)
            pick = uniform(self.seed, _SEED_STREAM, place.number, 0)
            index = allowed[int(pick * len(allowed))]
            begins.append(np.array(np.unravel_index(index, positions)) * cell)
        return begins

    def _copy(self, place: PatchPlace, begin: Array) -> Array:
        """Return the swatch's geometry for a patch, its extra region and what the warp may pull in, at the patch's place."""
        further = min(self.settings.extra, self.settings.weights.most_distance * float(self.settings.patch.min()))
        records = self.sample.inside(begin - place.extra[:2] - further, begin + place.size + place.extra[2:] + further)
        records["point"][:, :2] -= begin
        return records
