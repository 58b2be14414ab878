"""Filling relief by coherent pieces, coarse to fine: the levels, and how base and relief settle together.

After Wexler, Shechtman & Irani 2007 and Darabi et al. 2012 (completion in images by a field of patches, joined by gradients) and
Barnes et al. 2009 (the search), carried over to surfaces as Harary, Tal & Grinspun 2014 do with context.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.errors import InputError
from intaglio.kernels.correspondence import Field
from intaglio.mesh import SmoothBase
from intaglio.relief.coherent.averages import average, averaging, edges_from
from intaglio.relief.coherent.guidance import Guidance
from intaglio.relief.coherent.joining import Anchors, Wishes, ask_sources, coherence, join
from intaglio.relief.coherent.search import FieldSearch, Weights
from intaglio.relief.coherent.surroundings import Surroundings
from intaglio.relief.coherent.tables import SurfaceTables
from intaglio.relief.ground import Ground, ThinPlate, relaid

# Rings of a patch: at level l they lie 2^l spacings apart.
_RINGS = 4
_MOST_LEVELS = 5
# Rounds of search and joining at the coarsest level and at each, and sweeps in a round.
_FIRST_ROUNDS, _ROUNDS, _SWEEPS = 6, 3, 3
# The coarsest level is begun so often; what an unfit match counts when starts are compared.
_STARTS, _DEAR = 3, 10.0
# A smooth base is relaid over the filling so often at a level; its wave length at the finest level and at the coarsest, in widths
# of the hole, and the least and most at the finest, in spacings.
_RELAYS = 4
# A larger ground keeps the base that it has: to factor its system would take longer than all else.
_MOST_RELAID = 150_000
_FINEST_SCALE, _COARSEST_SCALE = 1.0, 2.0
_LEAST_SCALE, _MOST_SCALE = 16.0, 40.0


@dataclass(frozen=True)
class CoherentFilling:
    """Relief that was filled by coherent pieces.

    Attributes
    ----------
    ground : Ground
        With the base that belongs to the heights: a smooth one was relaid.
    height : (N,) array
        Signed displacement, in the input's unit.
    source, rotation, mirrored, error, confidence : (N,) arrays
        Of targets; see `intaglio.Surface`. ``error`` is in squared input units, ``confidence`` from 0 to 1.
    coherence : float
        Share of the edges between targets whose two sources are neighbours.
    levels : int
    scale : float
        Wave length at which a smooth base was laid, in the input's unit; 0 for other bases.
    """

    ground: Ground
    height: Array
    source: Array
    rotation: Array
    mirrored: Array
    error: Array
    confidence: Array
    coherence: float
    levels: int
    scale: float


def _times(level: int) -> int:
    """Return how often heights are averaged for a level: at the finest they are compared as they are."""
    return 4**level if level else 0


def fill_coherently(
    ground: Ground,
    allowed: Array | None = None,
    *,
    turning: bool = True,
    mirrored: bool = False,
    seed: int = 0,
    device: str = "cpu",
    weights: Weights | None = None,
    guidance: Guidance | None = None,
    progress: Progress | None = None,
) -> CoherentFilling:
    """Fill the targets of a ground with coherent pieces of measured relief.

    Every target gets a measured place and an angle. At each level, from patches as wide as the hole to patches of four edges,
    search alternates with joining: heights whose differences along edges are those of the sources. A smooth base is laid anew
    over scan and filling together between the rounds, so that base and filling settle together.

    Parameters
    ----------
    ground : Ground
    allowed : (N,) bool array, optional
        The measured vertices whose relief may be taken; default all that have measured surface around them.
    turning, mirrored : bool
        Whether sources may be turned, and mirrored.
    seed : int
    device : str
    weights : Weights, optional
    guidance : Guidance, optional
        Lines that go on across the hole.
    progress : callable, optional
        Called with (rounds done, rounds to do).

    Raises
    ------
    InputError
        If no vertex may be taken.
    """
    return _Completion(ground, allowed, turning, mirrored, seed, device, weights or Weights(), guidance, progress).run()


class _Completion:
    def __init__(
        self,
        ground: Ground,
        allowed: Array | None,
        turning: bool,
        mirrored: bool,
        seed: int,
        device: str,
        weights: Weights,
        guidance: Guidance | None,
        progress: Progress | None,
    ) -> None:
        graph = ground.topology.graph
        self._ground, self._device, self._weights, self._progress = ground, device, weights, progress
        self._measured, self._guidance = ground.measured, guidance
        inner = ground.measured & ~(np.asarray(graph @ (~ground.measured).astype(np.float32)) > 0)
        if allowed is not None:
            inner &= allowed
        if not inner.any():
            raise InputError(
                "fewer samples than the smallest window needs: no vertex that may be taken has measured surface around it"
            )
        self._inner = inner
        self._targets = np.flatnonzero(~ground.measured)
        self._hops = edges_from(graph, ground.measured)
        self._depth = max(int(self._hops[self._targets].max()), 1)
        self._own, self._all = averaging(graph, ground.measured), averaging(graph, np.ones(len(inner), bool))
        self._height = np.where(ground.measured, ground.height / ground.spacing, 0.0)
        self._surroundings = Surroundings(ground, self._height)
        self._search = FieldSearch(
            inner, self._targets, turning=turning, mirrored=mirrored, weights=weights, seed=seed, device=device
        )
        self._tables = SurfaceTables(ground, device)
        self._levels = int(np.clip(np.round(np.log2(2.0 * max(self._depth, _RINGS) / _RINGS)), 0, _MOST_LEVELS))
        self._smooth = isinstance(ground.base, SmoothBase) and len(inner) <= _MOST_RELAID
        self._plates: dict[float, ThinPlate] = {}
        # Few targets spread over many sources: a source taken once is used evenly.
        self._even = max(1.0, len(self._targets) / len(self._search.sources))

    def run(self) -> CoherentFilling:
        """Work through the levels."""
        x = self._height.copy()
        filled = np.zeros(len(x), bool)
        plan = [self._levels, *range(self._levels, -1, -1)]
        self._done = 0
        self._steps = _STARTS * len(self._rounds(2.0**self._levels, True)) + _ROUNDS * (len(plan) - 1)
        for turn, level in enumerate(plan):
            if self._smooth:
                x = self._relay(x, self._scale(level), first=turn == 0)
                self._tables = SurfaceTables(self._ground, self._device)
            self._take_level(level)
            if turn == 0:
                x, filled = self._best_start(x, level)
            else:
                x, filled = self._settle(x, filled, level, self._rounds(2.0**level, False))
            if self._smooth:
                for _ in range(_RELAYS):
                    x = self._relay(x, self._scale(level))
        x = self._surroundings.raise_contrast(x)
        return self._result(x)

    def _scale(self, level: int) -> float:
        """Return the wave length of a smooth base at a level, in spacings."""
        width = 2.0 * self._depth
        finest = float(np.clip(_FINEST_SCALE * width, _LEAST_SCALE, _MOST_SCALE))
        coarsest = max(finest, _COARSEST_SCALE * width)
        return float(finest * (coarsest / finest) ** (level / max(self._levels, 1)))

    def _take_level(self, level: int) -> None:
        """Lay the patches of a level around sources and targets."""
        step, search = 2.0**level, self._search
        chosen, stands, turned = self._tables.thinned(search.sources, step)
        height = average(self._own, self._height, _times(level))
        search.take_level(
            self._tables,
            self._tables.patches(chosen, step, height, self._measured.astype(np.float64)),
            stands,
            turned,
            (self._likeness(), self._surroundings.direction_in(self._ground)),
            2.0 * self._depth,
        )
        self._located = self._tables.locate(self._targets, step)

    def _best_start(self, x: Array, level: int) -> tuple[Array, Array]:
        """Begin several times at the coarsest level, and go on from where matches cost least."""
        best: tuple[float, Array, Array, Field] | None = None
        for start in range(_STARTS):
            self._search.start_over(start)
            found, filled = self._settle(x, np.zeros(len(x), bool), level, self._rounds(2.0**level, True))
            cost = float(np.minimum(self._search.field.cost.numpy()[self._targets], _DEAR).mean())
            if best is None or cost < best[0]:
                best = cost, found, filled, self._search.field
        assert best is not None
        self._search.field = best[3]
        return best[1], best[2]

    def _settle(self, x: Array, filled: Array, level: int, rounds: list[int]) -> tuple[Array, Array]:
        """Search and join by turns at one level; return the heights and which targets have one."""
        step, search = 2.0**level, self._search
        first = not filled.any()
        span = max(8.0, self._depth) if level == self._levels else 4 * step
        use = np.zeros(len(x))
        for done, reach in enumerate(rounds):
            active = ~self._measured & (self._hops <= reach)
            known = self._measured | filled
            smoother = self._all if known.all() else averaging(self._ground.topology.graph, known)
            sure = np.where(self._measured, 1.0, np.where(filled, self._weights.decay**self._hops, 0.0))
            search.take_targets(
                self._tables.read(self._located, average(smoother, x, _times(level)), sure),
                active,
                np.maximum(use / self._even - 1.0, 0.0),
            )
            for _ in range(2 * _SWEEPS if first else _SWEEPS):
                search.sweep(span, 4 * step)
            if done == len(rounds) - 1:
                search.give_up_small_pieces(self._wishes(), 4 * self._depth)
            place = search.place[active]
            use = average(self._own, np.bincount(place[place >= 0], minlength=len(x)).astype(np.float64), 6)
            x = join(self._wishes(), x, active, self._weights.pull, self._anchors())
            filled = active
            self._done += 1
            if self._progress is not None:
                self._progress(self._done, self._steps)
        return x, filled

    def _rounds(self, step: float, first: bool) -> list[int]:
        """Return up to how many edges from the rim targets take part, for each round of a level."""
        if not first:
            return [self._depth] * _ROUNDS
        # From the rim inwards, so that every target has something known within its patch.
        width = max(2, int(3 * step))
        return [*range(width, self._depth, width), *[self._depth] * _FIRST_ROUNDS]

    def _likeness(self) -> Array:
        """Return the surroundings' likeness (N, 4), with nearness to lines as its last."""
        near = np.zeros(len(self._inner))
        if self._guidance is not None:
            near = self._guidance.nearness * np.sqrt(self._weights.line / self._weights.likeness)
        return np.concatenate([self._surroundings.likeness, near[:, None]], axis=1)

    def _anchors(self) -> Anchors | None:
        """Return the heights, over the base as it is now, of targets that lie on lines."""
        guidance, ground = self._guidance, self._ground
        if guidance is None:
            return None
        at = guidance.vertices
        away = np.einsum("ij,ij->i", guidance.points - ground.foot[at], ground.normal[at])
        return Anchors(at, away / ground.spacing, guidance.weight)

    def _wishes(self) -> Wishes:
        return ask_sources(self._tables, self._search.field, self._height, self._measured)

    def _relay(self, x: Array, scale: float, first: bool = False) -> Array:
        """Lay the smooth base anew through scan and filling, and return the heights over it."""
        ground = self._ground
        if scale not in self._plates:
            self._plates[scale] = ThinPlate(ground.foot, ground.faces, scale * ground.spacing)
        vertices = np.where(self._measured[:, None], ground.vertices, ground.foot + (x * ground.spacing)[:, None] * ground.normal)
        self._ground = relaid(ground, vertices, self._plates[scale], scale * ground.spacing)
        height = self._ground.height / ground.spacing
        self._height = np.where(self._measured, height, 0.0)
        return height if first else join(self._wishes(), height, ~self._measured, 0.0, self._anchors())

    def _result(self, x: Array) -> CoherentFilling:
        ground, field, count = self._ground, self._search.field, len(x)
        wishes = self._wishes()
        target = ~self._measured
        place = np.where(target, self._search.place, np.arange(count))
        lost = target & (place < 0)
        place = np.where(lost, self._search.sources[0], place)
        cost = np.where(target, np.maximum(field.cost.numpy(), 0.0), 0.0)
        variance = float((self._height[self._measured] * ground.spacing).var())
        # How far the neighbours' sources are from saying the same, against the roughness there is.
        off = np.abs(x[wishes.other] - x[wishes.first] - wishes.difference) * wishes.known
        edges = np.maximum(np.bincount(wishes.first, minlength=count), 1)
        rough = float(np.abs(np.diff(x[np.stack([self._tables.first, self._tables.other], axis=1)], axis=1)).mean()) + 1e-9
        strain = np.bincount(wishes.first, off, count) / edges / rough
        inner = target[wishes.other]
        agrees = np.bincount(wishes.first[inner], wishes.agrees[inner], count) / np.maximum(
            np.bincount(wishes.first[inner], minlength=count), 1
        )
        sure = np.exp(-cost) * (0.5 + 0.5 * agrees) / (1.0 + strain**2) * (1.0 - 0.5 * self._hops / self._depth)
        angle = np.mod(field.angle.numpy(), 2 * np.pi)
        return CoherentFilling(
            ground,
            x * ground.spacing,
            place.astype(np.int32),
            np.where(target, angle, 0.0).astype(np.float32),
            target & (field.mirror.numpy() > 0),
            np.where(lost, np.inf, cost * variance).astype(np.float32),
            np.where(target, np.clip(sure, 0.0, 1.0), 1.0).astype(np.float32),
            coherence(wishes, self._measured),
            self._levels + 1,
            self._scale(0) * ground.spacing if self._smooth else 0.0,
        )
