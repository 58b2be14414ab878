"""What the parts of growth hand to each other: the growing surface, matches, and the protocol of a metric."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from intaglio.arrays import Array
from intaglio.relief.growth.samples import Samples
from intaglio.relief.growth.settings import Selection


@dataclass(frozen=True)
class Picks:
    """One match per target.

    Attributes
    ----------
    sample : (T,) int array
        Number of the sample, -1 for none.
    rotation : (T,) float32 array
        By how much its neighbourhood was turned, in radians.
    error : (T,) array
        Weighted mean squared distance, in squared input units.
    """

    sample: Array
    rotation: Array
    error: Array


@dataclass
class State:
    """The growing surface: what each of its N vertices carries so far.

    Attributes
    ----------
    height : (N,) float64 array
        Signed displacement.
    textured : (N,) bool array
        Whether the vertex has relief: measured, or filled already.
    source, rotation, error : (N,) arrays
        As in `intaglio.Surface`.
    color : (N, 3) float32 array or None
    sample : (N,) int32 array
        Number of the sample that a vertex carries, or is itself; -1 for none.
    """

    height: Array
    textured: Array
    source: Array
    rotation: Array
    error: Array
    color: Array | None
    sample: Array


class Metric(Protocol):
    """Compares the neighbourhoods of targets with those of samples."""

    samples: Samples

    def pick(self, targets: Array, window: Array, state: State, selection: Selection, draw: Array) -> Picks:
        """Match each of ``targets`` (T,) within its window (T,) and choose one candidate by ``draw`` (T,) in [0, 1)."""
        ...

    def absorb(self, state: State) -> None:
        """Take all textured vertices as samples (bootstrapped completion)."""
        ...


@runtime_checkable
class VotingMetric(Metric, Protocol):
    """A metric whose matched patches can vote on the relief that they cover, which refinement needs."""

    def vote(self, targets: Array, picks: Picks, rows: Array, window: int, confidence: Array) -> tuple[Array, Array | None]:
        """Return what the matched patches say about each target: heights (all targets,), colours (all targets, 3) as displayed.

        NaN where no patch covers a target; no colours where they don't count.

        Parameters
        ----------
        targets : (T,) array
            Vertices whose matches vote.
        picks : Picks
            Matches; ``rows`` (bool) selects those of ``targets``.
        rows : bool array
        window : int
            Radius of the patches, in rings.
        confidence : (T,) array
            Weight of each patch.
        """
        ...


@dataclass(frozen=True)
class Growth:
    """What was propagated, and how it went.

    Attributes
    ----------
    state : State
    waves : int
        Lists worked through.
    threshold : float
        The error bound at the end, in squared input units.
    shrunk : int
        Targets whose window shrank.
    orphans : int
        Targets that no sample could be compared with; they carry a neighbour's relief.
    """

    state: State
    waves: int
    threshold: float
    shrunk: int
    orphans: int
