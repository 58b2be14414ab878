"""The search for a correspondence field: PatchMatch over the targets of a surface, pieces, and what becomes of small ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array
from intaglio.kernels.correspondence import Field, Patches, Reach, Terms, empty_field, patch_grid, sweep_kernel
from intaglio.kernels.launch import launch, upload
from intaglio.randomness import Stream, uniform
from intaglio.relief.coherent.joining import Wishes
from intaglio.relief.coherent.tables import SurfaceTables

# Random places tried around the best so far in a sweep, each half as far as the one before.
_HALVINGS = 4
# Sweeps that let pieces grow over what small ones held, after all of it is taken again.
_SETTLING = 6


@dataclass(frozen=True)
class Weights:
    """How much each term of a match's cost counts, where the difference of unlike patches is about 1.

    Attributes
    ----------
    missing, coherence, locality, likeness, direction, use : float
        See `intaglio.kernels.correspondence.Terms`.
    line : float
        What a source costs that lies on a line where the target doesn't, or the other way round.
    upright : float
        See there; for bases on which all frames lie one way.
    decay : float
        What a target counts in a patch, for every edge that it is away from the rim.
    smallest : int
        Pieces of fewer targets are given up, or of less than an eighth of all.
    afloat, pull : float
        1 and 0 where heights count against each other only, as over a base that is made up; 0 and more where they count as such.
    """

    missing: float = 2.0
    coherence: float = 1.0
    locality: float = 0.1
    likeness: float = 0.2
    direction: float = 0.1
    use: float = 0.3
    line: float = 1.0
    upright: float = 0.0
    afloat: float = 1.0
    pull: float = 0.0
    decay: float = 0.9
    smallest: int = 60


class FieldSearch:
    """A correspondence field and the sweeps that better it.

    Parameters
    ----------
    allowed : (N,) bool array
        The vertices that may be sources.
    targets : (T,) int array
    turning, mirrored : bool
        Whether sources may be turned, and mirrored.
    weights : Weights
    seed : int
    device : str
    """

    def __init__(
        self, allowed: Array, targets: Array, *, turning: bool, mirrored: bool, weights: Weights, seed: int, device: str
    ) -> None:
        self.targets, self.sources = targets, np.flatnonzero(allowed)
        self.field: Field = empty_field(len(allowed), device)
        self._count, self._device, self._seed = len(allowed), device, seed
        self._start, self._sweeps = 0, 0
        self._weights, self._turning, self._mirrored = weights, turning, mirrored
        self._grid_weight, turns = patch_grid()
        self._compared = Patches()
        self._compared.turns = upload(turns, wp.int32, device)
        self._compared.weight = upload(self._grid_weight, wp.float32, device)
        self._wp_sources = upload(self.sources, wp.int32, device)
        self._allowed = upload(allowed, wp.uint8, device)
        self._terms = Terms()
        self._level_tables: SurfaceTables | None = None

    @property
    def place(self) -> Array:
        """The source's vertex (N,) of every vertex; -1 for none."""
        return np.asarray(self.field.place.numpy())

    def start_over(self, start: int) -> None:
        """Forget the field, and draw other random numbers for every ``start``."""
        self.field = empty_field(self._count, self._device)
        self._start, self._sweeps = start, 0

    def take_level(
        self, tables: SurfaceTables, sources: Array, stands: Array, turn: Array, surroundings: tuple[Array, Array], reach: float
    ) -> None:
        """Compare by the sources' patches of a level from now on.

        Parameters
        ----------
        tables : SurfaceTables
        sources : (K, G, 4) array
            Patches of the sources, or of some that stand for all.
        stands, turn : (S,) arrays
            See `SurfaceTables.thinned`.
        surroundings : (N, 4), (N, 2) arrays
            Likeness, lines among it, and direction; see `Surroundings` and `Guidance`.
        reach : float
            Distance in spacings beyond which a source is far.
        """
        self._level_tables = tables
        self._patches = np.concatenate([sources, np.zeros((len(self.targets), *sources.shape[1:]), np.float32)])
        row, row_turn = np.zeros(self._count, np.int32), np.zeros(self._count, np.float32)
        row[self.sources], row[self.targets] = stands, len(sources) + np.arange(len(self.targets))
        row_turn[self.sources] = turn
        compared = self._compared
        compared.row, compared.row_turn = upload(row, wp.int32, self._device), upload(row_turn, wp.float32, self._device)
        compared.likeness = upload(surroundings[0], wp.vec4, self._device)
        compared.direction = upload(surroundings[1], wp.vec2, self._device)
        known = self._grid_weight * (sources[..., 3] > 0)
        total = np.maximum(known.sum(axis=1), 1e-9)
        mean = (known * sources[..., 0]).sum(axis=1) / total
        variance = (known * (sources[..., 0] - mean[:, None]) ** 2).sum(axis=1) / total
        steepness = (known * (sources[..., 1] ** 2 + sources[..., 2] ** 2)).sum(axis=1) / total
        terms, weights = self._terms, self._weights
        terms.w_height = 0.5 / (float(variance.mean()) + 1e-8)
        terms.w_slope = 0.5 / (float(steepness.mean()) + 1e-8)
        for name in ("missing", "coherence", "locality", "likeness", "direction", "use", "upright", "afloat"):
            setattr(terms, name, getattr(weights, name))
        terms.reach = reach

    def take_targets(self, patches: Array, active: Array, use: Array) -> None:
        """Take the targets' patches (T, G, 4), which of all vertices (N,) are to be matched, and the sources' use (N,)."""
        self._patches[len(self._patches) - len(self.targets) :] = patches
        self._active_vertices = np.flatnonzero(active)
        self._compared.values = upload(self._patches, wp.vec4, self._device, copy=False)
        self._active = upload(active, wp.uint8, self._device)
        self._wp_active_vertices = upload(self._active_vertices, wp.int32, self._device)
        self._compared.used = upload(use, wp.float32, self._device)

    def sweep(self, span: float, stride: float, *, explore: bool = True) -> None:
        """Let some of the active targets look for better sources, at random no further than ``span`` spacings from their own."""
        assert self._level_tables is not None
        fresh = empty_field(self._count, self._device)
        seed = int(2**31 * uniform(self._seed, Stream.RELIEF_SWEEP, self._start, self._sweeps))
        reach = Reach()
        reach.turning, reach.mirrored = float(self._turning), int(self._mirrored)
        reach.span, reach.stride, reach.halvings, reach.explore = float(span), float(stride), _HALVINGS, int(explore)
        launch(
            sweep_kernel,
            len(self._active_vertices),
            inputs=[
                self._wp_active_vertices,
                self._active,
                self._allowed,
                self._wp_sources,
                self._level_tables.steps,
                self._compared,
                self._terms,
                reach,
                seed,
                self.field,
            ],
            outputs=[fresh],
            device=self._device,
            grain=16,
        )
        self._sweeps += 1
        self.field = fresh

    def pieces(self, wishes: Wishes) -> tuple[Array, Array]:
        """Return the number (N,) of the piece that every vertex is in, where sources agree along edges, and the pieces' sizes."""
        joined = wishes.first[wishes.agrees], wishes.other[wishes.agrees]
        graph = coo_array((np.ones(len(joined[0]), bool), joined), shape=(self._count, self._count))
        label = connected_components(graph, directed=False)[1]
        return label, np.bincount(label)

    def give_up_small_pieces(self, wishes: Wishes, rounds: int) -> None:
        """Let the neighbours of small pieces grow over them.

        Parameters
        ----------
        wishes : Wishes
            Which sources agree, at present.
        rounds : int
            Most sweeps until all targets have a source again.
        """
        label, sizes = self.pieces(wishes)
        size = sizes[label]
        small = np.zeros(self._count, bool)
        small[self._active_vertices] = size[self._active_vertices] < min(self._weights.smallest, len(self.targets) // 8)
        if not small.any() or small[self._active_vertices].all():
            return
        self.field.place = upload(np.where(small, -1, self.place), wp.int32, self._device)
        for _ in range(rounds):
            self.sweep(1.0, 1.0, explore=False)
            if (self.place[self._active_vertices] >= 0).all():
                break
        for _ in range(_SETTLING):
            self.sweep(1.0, 1.0, explore=False)
