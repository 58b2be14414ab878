"""Fitting patches to existing geometry: pairing, warp and blending (Duranleau & Poulin, sections 5.2 and 5.3)."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.geometry.buckets import RECORD, within
from intaglio.geometry.clustering import cluster
from intaglio.geometry.layout import PatchPlace
from intaglio.geometry.options import Settings
from intaglio.geometry.swatch import Swatch
from intaglio.geometry.warping import mean_moves, most_coherent, solve_splines
from intaglio.kernels.pairing import PairCosts, Targets, pair_points
from intaglio.kernels.point_surface import PointSurface
from intaglio.kernels.splines import warp_points

# Surface variation up to which a cluster of targets is not split.
_FLATNESS = 0.03
# Determinant of the Jacobian below which the surface counts as folded.
_FOLDED = 0.1
# The number of times that a fold halves the pairs before the patch is only shifted.
_HALVINGS = 2
# The fewest pairs that determine a spline.
_LEAST_PAIRS = 4


class PatchFitter:
    """Warps and blends patches of one output.

    Parameters
    ----------
    swatch : Swatch
    settings : Settings
    """

    def __init__(self, swatch: Swatch, settings: Settings) -> None:
        self.swatch, self.settings = swatch, settings
        self._unit = float(settings.patch.min())
        w = settings.weights
        self._costs = PairCosts(
            position=w.position,
            normal=w.normal,
            variation=w.variation,
            length=w.length,
            direction=w.direction,
            most_position=w.most_distance,
            most_normal=(1 - float(np.cos(np.radians(w.most_angle)))) / 2,
            most_variation=w.most_variation**2,
            unit=self._unit,
            radius=settings.overlap / 2,
        )

    def fit(
        self, places: list[PatchPlace], begins: list[Array], old: list[Array], surface: PointSurface, new: list[Array]
    ) -> list[Array]:
        """Return the records that replace those in the box of each patch.

        Parameters
        ----------
        places : list of PatchPlace
        begins : list of (2,) arrays
            Where in the swatch each patch begins.
        old, new : lists of arrays of RECORD
            For each patch, the records that are already there, and the copied ones, relative to its lower left corner.
        surface : PointSurface
            Of ``old``, a group for each patch.
        """
        group = np.repeat(np.arange(len(places)), [len(r) for r in new])
        together = np.concatenate(new)
        if self.settings.fit.warp:
            paired = self._pair(places, begins, old)
            # Points that no pair could move into the box need not be warped.
            farthest = [float(np.linalg.norm(t - s, axis=1).max(initial=0)) for s, t in paired]
            near = self._near_box(places, together["point"], group, np.array(farthest) + self.swatch.spacing)
            together, group = together[near], group[near]
            copied = together["point"].copy()
            together = self._warp(places, paired, together, group)
        else:
            copied = together["point"].copy()
        near = self._near_box(places, together["point"], group, np.full(len(places), self.swatch.spacing))
        together, group, copied = together[near], group[near], copied[near]
        keep = np.ones(len(together), bool)
        kept = [np.empty(0, RECORD)] * len(places)
        if self.settings.fit.blend:
            keep, kept = self._blend(places, old, surface, together, group)
        together["moved"] = np.linalg.norm(together["point"] - copied, axis=1)
        return [np.concatenate([together[keep & (group == b)], kept[b]]) for b in range(len(places))]

    def _pair(self, places: list[PatchPlace], begins: list[Array], old: list[Array]) -> list[tuple[Array, Array]]:
        """Return sources and targets of the pairs of each patch, relative to its lower left corner."""
        targets = self._targets(places, begins, old)
        records = self.swatch.records
        chosen = pair_points(self.swatch.surface, records["variation"], targets, self._costs, self.settings.fit.rounds)
        paired = np.flatnonzero(chosen >= 0)
        group = np.repeat(np.arange(len(places)), np.diff(targets.first))[paired]
        source, target = records["point"][chosen[paired]], targets.points[paired].astype(np.float64)
        # The samples of two surfaces don't coincide. So each target follows the mean move of the pairs near it rather than
        # its own, and the move ends on the surface rather than on a sample.
        begun = target.copy()
        for b in range(len(places)):
            mine = group == b
            begun[mine] += mean_moves(source[mine], target[mine], self._costs.radius)
        feet = self.swatch.surface.project(begun, facing=targets.normals[paired], reach=self.swatch.support)
        source = np.where(feet.found[:, None], feet.points, source)
        shift = np.concatenate([np.array(begins), np.zeros((len(places), 1))], axis=1)
        return [(source[group == b] - shift[b], target[group == b] - shift[b]) for b in range(len(places))]

    def _targets(self, places: list[PatchPlace], begins: list[Array], old: list[Array]) -> Targets:
        """Return points spread over each overlap, denser where the surface bends, moved over the swatch's patch."""
        parts = [r[p.overlapping(r["point"][:, 0], r["point"][:, 1])] for p, r in zip(places, old, strict=True)]
        counts = np.array([len(part) for part in parts])
        together, group = np.concatenate(parts), np.repeat(np.arange(len(places)), counts)
        largest = np.ceil(2 * counts / self.settings.fit.pairs)
        chosen = cluster(together["point"], group, largest=largest, smallest=np.ceil(largest / 3), flatness=_FLATNESS)
        first = np.searchsorted(group[chosen], np.arange(len(places) + 1))
        picked = together[chosen]
        point = picked["point"]
        point[:, :2] += np.array(begins)[group[chosen]]
        return Targets(point, picked["normal"], picked["variation"], first)

    def _warp(self, places: list[PatchPlace], paired: list[tuple[Array, Array]], new: Array, group: Array) -> Array:
        """Warp ``new`` by the splines of the pairs, or of fewer pairs where that would fold the surface."""
        todo = np.arange(len(places))
        out = new.copy()
        for attempt in range(_HALVINGS + 2):
            ends = [self._add_anchors(places[b], *paired[b]) for b in todo]
            splines = solve_splines([e[0] for e in ends], [e[1] for e in ends], self.settings.fit.smoothing)
            turn = np.full(len(places), -1)
            turn[todo] = np.arange(len(todo))
            mine = np.flatnonzero(turn[group] >= 0)
            if not len(mine):
                break
            of = turn[group[mine]]
            point, normal, volume = warp_points(new["point"][mine], new["normal"][mine], of, splines, self.swatch.device)
            out["point"][mine], out["normal"][mine] = point, normal
            lowest = np.full(len(todo), np.inf)
            np.minimum.at(lowest, of, np.where(np.isfinite(volume), volume, -np.inf))
            todo = todo[lowest < _FOLDED]
            if not len(todo) or attempt > _HALVINGS:
                break
            for b in todo:
                sources, targets = paired[b]
                # In the last attempt too few for a spline: they only shift the patch by their mean.
                share = 0.5 if attempt < _HALVINGS else (_LEAST_PAIRS - 1) / max(len(sources), _LEAST_PAIRS)
                keep = most_coherent(sources, targets, self.settings.overlap / 2, share)
                paired[b] = sources[keep], targets[keep]
        return out

    def _add_anchors(self, place: PatchPlace, sources: Array, targets: Array) -> tuple[Array, Array]:
        """Return the pairs, with additional ones by which the free corners follow the mean move of the overlap.

        In section 5.2 the corners stay in place; patches are found to the nearest node only, so that would stretch every
        patch by up to half a cell.
        """
        if len(sources) < _LEAST_PAIRS:
            return sources, targets
        free = place.free_places(self.settings.extra)
        heights = (-self._unit / 4, self.swatch.height + self._unit / 4)
        anchors = np.array([[x, y, z] for x, y in free for z in heights]).reshape(-1, 3)
        shift = (targets - sources).mean(axis=0) * (1, 1, 0)
        return np.concatenate([sources, anchors]), np.concatenate([targets, anchors + shift])

    def _near_box(self, places: list[PatchPlace], points: Array, group: Array, margin: Array) -> Array:
        """Return which points lie within ``margin`` (B,) of their patch's box."""
        low = np.array([-p.extra[:2] for p in places]) - margin[:, None]
        high = np.array([p.size + p.extra[2:] for p in places]) + margin[:, None]
        return within(points, low[group], high[group])

    def _blend(
        self, places: list[PatchPlace], old: list[Array], surface: PointSurface, new: Array, group: Array
    ) -> tuple[Array, list[Array]]:
        """Move ``new`` towards the existing surface; return which of its points stay, and the existing records that stay.

        Geometry without a counterpart is cut where both surfaces have the same weight: each stays on its own side only.
        """
        share = np.zeros(len(new))
        for b, place in enumerate(places):
            mine = group == b
            share[mine] = place.share_of_old(new["point"][mine, 0], new["point"][mine, 1])
        touched = np.flatnonzero(share > 0)
        reach = self.swatch.support
        feet = surface.project(
            new["point"][touched], facing=new["normal"][touched], group=group[touched], reach=reach, along=True
        )
        keep = np.ones(len(new), bool)
        lost = touched[~feet.found]
        keep[lost] = share[lost] <= 0.5
        kept = self._find_unmatched(places, old, new, group, reach)
        touched, point, normal = touched[feet.found], feet.points[feet.found], feet.normals[feet.found]
        t = share[touched, None]
        new["point"][touched] += t * (point - new["point"][touched])
        mixed = new["normal"][touched] * (1 - t) + t * normal
        new["normal"][touched] = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
        return keep, kept

    def _find_unmatched(self, places: list[PatchPlace], old: list[Array], new: Array, group: Array, reach: float) -> list[Array]:
        """Return the existing records, on their half of the overlap, that have no counterpart in the patch."""
        warped = PointSurface(new["point"], new["normal"], reach, group=group, device=self.swatch.device)
        asked = []
        for place, records in zip(places, old, strict=True):
            there = records[within(records["point"], -place.extra[:2], place.size + place.extra[2:])]
            asked.append(there[place.share_of_old(*there["point"][:, :2].T) > 0.5])
        owner = np.repeat(np.arange(len(places)), [len(a) for a in asked])
        together = np.concatenate(asked)
        found = warped.nearest(together["point"], facing=together["normal"], group=owner, reach=reach) >= 0
        return [together[(owner == b) & ~found] for b in range(len(places))]
