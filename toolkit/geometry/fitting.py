"""Patches made to fit what is there: pairing, warp and blending (Duranleau & Poulin, sections 5.2 and 5.3)."""

from __future__ import annotations

import numpy as np

from intaglio.geometry.buckets import RECORD
from intaglio.geometry.clustering import cluster
from intaglio.geometry.layout import PatchPlace
from intaglio.geometry.swatch import Swatch
from intaglio.geometry.warping import most_coherent, solve_splines
from intaglio.kernels.pairing import Targets, pair_points
from intaglio.kernels.points import PointSurface
from intaglio.kernels.splines import warp_points

Array = np.ndarray

# Surface variation up to which a cluster of targets is left whole.
_FLATNESS = 0.03
# A Jacobian's determinant below this folds the surface or is about to.
_FOLDED = 0.1


class PatchFitter:
    """Warps and blends patches."""

    def __init__(self, swatch: Swatch, settings) -> None:
        self.swatch, self.settings = swatch, settings

    def fitted(self, places: list[PatchPlace], old: list[Array], surface: PointSurface, new: list[Array]) -> list[Array]:
        settings = self.settings
        group = np.repeat(np.arange(len(places)), [len(r) for r in new])
        together = np.concatenate(new)
        copied = together["point"].copy()
        if settings.warp:
            together = self._warped(places, old, together, group)
        near = self._near_box(places, together["point"], group)
        together, group, copied = together[near], group[near], copied[near]
        keep = np.ones(len(together), bool)
        kept: list[Array] = [np.empty(0, RECORD)] * len(places)
        if settings.blend:
            keep, kept = self._blend(places, old, surface, together, group)
        together["moved"] = np.linalg.norm(together["point"] - copied, axis=1)
        return [np.concatenate([together[keep & (group == b)], kept[b]]) for b in range(len(places))]

    def _near_box(self, places: list[PatchPlace], points: Array, group: Array) -> Array:
        """Return which points lie in their patch's box, or so near that blending may bring them in."""
        low = np.array([-p.extra[:2] for p in places]) - self.swatch.spacing
        high = np.array([p.size + p.extra[2:] for p in places]) + self.swatch.spacing
        return ((points[:, :2] >= low[group]) & (points[:, :2] < high[group])).all(axis=1)

    def _warped(self, places, old, new, group):
        settings = self.settings
        unit = float(settings.patch.min())
        sources = PointSurface(new["point"], new["normal"], self.swatch.support, group=group, device=self.swatch.device)
        targets = self._targets(places, old)
        w = settings.weights
        chosen = pair_points(
            sources, new["variation"], targets,
            position=w.position, normal=w.normal, variation_weight=w.variation, length=w.length, direction=w.direction,
            most_position=w.most_distance, most_normal=(1 - np.cos(np.radians(w.most_angle))) / 2,
            most_variation=w.most_variation**2, unit=unit, radius=settings.overlap / 2, rounds=settings.rounds,
        )  # fmt: skip
        self.pairs = chosen
        paired = []
        for b, place in enumerate(places):
            part = slice(targets.first[b], targets.first[b + 1])
            found = chosen[part] >= 0
            paired.append((new["point"][chosen[part][found]], targets.points[part][found].astype(float)))
        return self._splined(places, paired, new, group)

    def _splined(self, places, paired, new, group):
        """Warp ``new`` by the splines of the pairs; where that would fold the surface, by those of fewer pairs."""
        settings = self.settings
        todo = np.arange(len(places))
        out = new.copy()
        for attempt in range(4):
            ends = [self._with_anchors(places[b], *paired[b]) for b in todo]
            splines = solve_splines([e[0] for e in ends], [e[1] for e in ends], settings.smoothing)
            of_todo = np.full(len(places), -1)
            of_todo[todo] = np.arange(len(todo))
            mine = np.flatnonzero(of_todo[group] >= 0)
            point, normal, volume = warp_points(
                new["point"][mine], new["normal"][mine], of_todo[group[mine]], first=splines.first, centers=splines.centers,
                weights=splines.weights, linear=splines.linear, offset=splines.offset, device=self.swatch.device,
            )  # fmt: skip
            out["point"][mine], out["normal"][mine] = point, normal
            sound = np.where(np.isfinite(volume), volume, -np.inf)
            edges = np.searchsorted(of_todo[group[mine]], np.arange(len(todo)))
            folded = np.minimum.reduceat(sound, edges) < _FOLDED
            if not folded.any():
                break
            todo = todo[folded]
            for b in todo:
                s, t = paired[b]
                keep = most_coherent(s, t, settings.overlap / 2, 0.5) if attempt < 2 else np.zeros(0, int)
                paired[b] = s[keep], t[keep]
        return out

    def _with_anchors(self, place, sources, targets):
        if not len(sources):
            return sources, targets
        unit = float(self.settings.patch.min())
        places = place.free_places(self.settings.extra)
        heights = [-unit / 4, self.swatch.height + unit / 4]
        anchors = np.array([[x, y, z] for x, y in places for z in heights]).reshape(-1, 3)
        shift = (targets - sources).mean(axis=0) * (1, 1, 0)
        return np.concatenate([sources, anchors]), np.concatenate([targets, anchors + shift])

    def _targets(self, places, old):
        parts, groups = [], []
        for b, (place, records) in enumerate(zip(places, old, strict=True)):
            inside = place.overlapping(records["point"][:, 0], records["point"][:, 1])
            parts.append(records[inside])
            groups.append(np.full(inside.sum(), b))
        together, group = np.concatenate(parts), np.concatenate(groups)
        counts = np.bincount(group, minlength=len(places))
        largest = np.ceil(2 * counts / self.settings.pairs)
        chosen = cluster(together["point"], group, largest=largest, smallest=np.ceil(largest / 3), flatness=_FLATNESS)
        first = np.searchsorted(group[chosen], np.arange(len(places) + 1))
        picked = together[chosen]
        return Targets(picked["point"].astype(np.float32), picked["normal"], picked["variation"], first)

    def _blend(
        self, places: list[PatchPlace], old: list[Array], surface: PointSurface, new: Array, group: Array
    ) -> tuple[Array, list[Array]]:
        """Draw ``new`` towards the surface that is there; return which points stay, and which old ones stay with them."""
        share = np.concatenate([p.share_of_old(*new["point"][group == b, :2].T) for b, p in enumerate(places)])
        touched = np.flatnonzero(share > 0)
        reach = self.swatch.support
        feet = surface.project(
            new["point"][touched], facing=new["normal"][touched], group=group[touched], reach=reach, along=True
        )
        keep = np.ones(len(new), bool)
        lost = touched[~feet.found]
        keep[lost] = share[lost] <= 0.5
        warped = PointSurface(new["point"], new["normal"], reach, group=group, device=self.swatch.device)
        kept = self._unmatched(places, old, warped, reach)
        touched, point, normal = touched[feet.found], feet.points[feet.found], feet.normals[feet.found]
        t = share[touched, None]
        new["point"][touched] += t * (point - new["point"][touched])
        mixed = new["normal"][touched] * (1 - t) + t * normal
        new["normal"][touched] = mixed / np.linalg.norm(mixed, axis=1, keepdims=True)
        return keep, kept

    def _unmatched(self, places: list[PatchPlace], old: list[Array], warped: PointSurface, reach: float) -> list[Array]:
        """Return what is there, in the half of the overlap that is nearer to it, and has no counterpart in the patch."""
        asked = []
        for place, records in zip(places, old, strict=True):
            x, y = records["point"][:, 0], records["point"][:, 1]
            low, high = -place.extra[:2], place.size + place.extra[2:]
            inside = (x >= low[0]) & (x < high[0]) & (y >= low[1]) & (y < high[1])
            part = records[inside]
            asked.append(part[place.share_of_old(x[inside], y[inside]) > 0.5])
        group = np.repeat(np.arange(len(places)), [len(a) for a in asked])
        together = np.concatenate(asked)
        found = warped.nearest(together["point"], facing=together["normal"], group=group, reach=reach) >= 0
        return [together[(group == b) & ~found] for b in range(len(places))]
