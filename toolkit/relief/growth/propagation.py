"""Stage two: non-parametric propagation of relief over the completed part (both papers' algorithm)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from intaglio.arrays import Array, Progress
from intaglio.randomness import Stream, uniform
from intaglio.relief.ground import Ground
from intaglio.relief.growth.interpolation import ReliefBetween
from intaglio.relief.growth.samples import Samples
from intaglio.relief.growth.settings import Selection
from intaglio.relief.growth.state import Growth, Metric, Picks, State


def grow_relief(
    ground: Ground,
    metric: Metric,
    *,
    window: int,
    error: float,
    selection: Selection,
    order: str = "wave",
    bootstrap: bool = False,
    between: ReliefBetween | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Growth:
    """Grow relief from the scan over all targets.

    The list of untextured vertices next to textured ones is shuffled, then sorted by falling number of textured
    neighbours. In "sequential" order its vertices are matched and filled one after the other, each seeing those before
    it: the papers' way. In "wave" order the whole list is matched against the surface as it was when the list was made,
    then filled at once: neighbours in one list don't see each other, a list is one search, and the result does not
    depend on the order within it. A vertex that finds no acceptable match waits and shrinks its window by one ring (down
    to 1); a list that fills nothing raises the error bound by 10 %. Where no sample can be compared at all, even at the
    smallest window, a vertex takes its textured neighbour's relief.

    Parameters
    ----------
    ground : Ground
        From `prepare_ground`.
    metric : Metric
        How neighbourhoods are compared.
    window : int
        w, the neighbourhood's radius in edges.
    error : float
        e: a match is accepted below this weighted mean squared distance, in squared input units.
    selection : Selection
        How a match is chosen.
    order : {"wave", "sequential"}
    bootstrap : bool
        Filled vertices become samples.
    between : ReliefBetween, optional
        Reads displacements between the samples' vertices.
    seed : int
    progress : callable, optional
        Called with (filled, total) after each list.

    References
    ----------
    Breckon & Fisher, TPAMI 2008, section 2.2.2; *Non-parametric 3D Surface Completion*, appendix A.
    """
    count = len(ground.measured)
    graph = ground.topology.graph
    targets = ~ground.measured & (np.diff(graph.indptr) > 0)
    state = State(
        height=ground.height,
        textured=ground.measured.copy(),
        source=np.where(ground.measured, np.arange(count), -1).astype(np.int32),
        rotation=np.zeros(count, np.float32),
        error=np.zeros(count, np.float32),
        color=None if ground.color is None else ground.color.copy(),
        sample=metric.samples.numbers(count),
    )
    windows = np.full(count, window)
    attempts = np.zeros(count, np.int64)
    threshold = error
    total, waves, orphans = int(targets.sum()), 0, 0
    if progress:
        progress(0, total)
    while True:
        support = graph @ state.textured.astype(np.float32)
        boundary = np.flatnonzero(targets & ~state.textured & (support > 0))
        if len(boundary) == 0:
            break
        shuffled = np.lexsort([uniform(seed, Stream.RELIEF_SHUFFLE, boundary, waves), -support[boundary]])
        boundary = boundary[shuffled]
        lists = [boundary] if order == "wave" else boundary[:, None]
        filled, viable = 0, False
        for part in lists:
            draw = uniform(seed, Stream.RELIEF_PICK, part, attempts[part])
            picks = metric.pick(part, windows[part], state, selection, draw)
            accepted = (picks.sample >= 0) & (picks.error < threshold)
            viable |= bool((picks.sample >= 0).any())
            _fill(state, part[accepted], metric.samples, picks, accepted, between, windows[part[accepted]])
            failed = part[~accepted]
            windows[failed] = np.maximum(windows[failed] - 1, 1)
            attempts[failed] += 1
            filled += int(accepted.sum())
            if bootstrap and accepted.any():
                metric.absorb(state)
                # The samples are numbered anew; each vertex carries the one that its source is.
                state.sample[:] = np.where(state.source >= 0, metric.samples.numbers(count)[state.source], -1)
        waves += 1
        if progress:
            progress(int((state.textured & targets).sum()), total)
        if filled == 0 and viable:
            threshold *= 1.1
        elif filled == 0 and (windows[boundary] == 1).all():
            _take_from_neighbors(state, boundary, graph)
            orphans += len(boundary)
    return Growth(state, waves, threshold, int((windows[targets] < window).sum()), orphans)


def _fill(
    state: State,
    vertices: Array,
    samples: Samples,
    picks: Picks,
    accepted: Array,
    between: ReliefBetween | None,
    windows: Array,
) -> None:
    own = Picks(picks.sample[accepted], picks.rotation[accepted], picks.error[accepted])
    carry_relief(state, vertices, samples, own, between, windows)
    turn = samples.turn[own.sample]
    state.rotation[vertices] = np.mod(own.rotation + turn, np.float32(2 * np.pi))
    state.textured[vertices] = True


def carry_relief(
    state: State, vertices: Array, samples: Samples, picks: Picks, between: ReliefBetween | None, windows: Array
) -> None:
    """Let ``vertices`` carry the relief of their matches: the samples' own, or what lies ``between`` them.

    Parameters
    ----------
    state : State
        Changed in place.
    vertices : (T,) array
    samples : Samples
        What the matches number.
    picks : Picks
        One match for each vertex, all found.
    between : ReliefBetween, optional
    windows : (T,) array
        Radius of the neighbourhoods, in edges.
    """
    chosen = picks.sample
    if between is None:
        height, source, color = samples.height[chosen], samples.vertex[chosen], None
        if samples.color is not None:
            color = samples.color[chosen]
    else:
        _, height, source, color = between.take(vertices, picks, windows, state, samples)
    state.height[vertices] = height
    state.source[vertices] = source
    state.sample[vertices] = chosen
    state.rotation[vertices] = picks.rotation
    state.error[vertices] = picks.error
    if state.color is not None and color is not None:
        state.color[vertices] = color


def _take_from_neighbors(state: State, vertices: Array, graph: csr_array) -> None:
    """Let ``vertices`` carry the relief of their first textured neighbour, marked by an infinite error."""
    for vertex in vertices:
        near = graph.indices[graph.indptr[vertex] : graph.indptr[vertex + 1]]
        giver = near[state.textured[near]][0]
        for field in (state.height, state.source, state.rotation, state.sample):
            field[vertex] = field[giver]
        if state.color is not None:
            state.color[vertex] = state.color[giver]
        state.error[vertex] = np.inf
    state.textured[vertices] = True


def choose_near_best(
    candidate: Array, cost: Array, count: Array, tolerance: float, draw: Array, spare: Array | None = None
) -> tuple[Array, Array]:
    """Choose at random among the listed candidates whose cost is at most ``1 + tolerance`` times the least.

    ``spare`` (T,) is the place in each list of an entry that says what the least is, but had no part in the drawing of the list:
    it is chosen only if nothing else can be; -1 for none.

    Returns
    -------
    chosen : (T,) array
        Candidate index, -1 where none is listed.
    cost : (T,) array
        Its cost.
    """
    if candidate.shape[1] == 0:
        return np.full(len(count), -1), np.full(len(count), np.inf)
    listed = np.arange(candidate.shape[1]) < count[:, None]
    best = np.where(listed, cost, np.inf).min(axis=1)
    eligible = listed & (cost <= (1 + tolerance) * best[:, None])
    if spare is not None:
        drawn = eligible & (np.arange(candidate.shape[1]) != spare[:, None])
        eligible = np.where(drawn.any(axis=1)[:, None], drawn, eligible)
    wanted = np.minimum((draw * eligible.sum(axis=1)).astype(int), np.maximum(eligible.sum(axis=1) - 1, 0))
    at = np.argmax(np.cumsum(eligible, axis=1) == wanted[:, None] + 1, axis=1)
    rows = np.arange(len(count))
    found = eligible.any(axis=1)
    return np.where(found, candidate[rows, at], -1), np.where(found, cost[rows, at], np.inf)
