"""Refinement after growth: the filled part matched as a whole, voted on, and copied again from the samples.

Growth sees only what lies behind its front, so its errors accumulate. Here every filled vertex's full neighbourhood is
matched; each matched patch votes for the relief of all filled vertices that it covers (texture optimisation, Kwatra et
al. 2005, over a surface). The last pass copies: every filled vertex again has one measured source.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from intaglio.arrays import Array, Progress
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh import SmoothBase, unique_edges
from intaglio.randomness import Stream, uniform
from intaglio.relief.ground import Ground
from intaglio.relief.growth.interpolation import ReliefBetween
from intaglio.relief.growth.propagation import carry_relief
from intaglio.relief.growth.settings import Selection
from intaglio.relief.growth.state import Picks, State, VotingMetric

_SMALLEST_WINDOW = 3
# How far around a hole its surroundings reach at least, in spacings.
_SURROUNDINGS = 10.0
# Kwatra et al.: votes count by distance to the power r - 2 with r = 0.8, that is squared distance to -0.6.
_ROBUST_POWER = -0.6


def refine_relief(
    ground: Ground,
    metric: VotingMetric,
    state: State,
    *,
    window: int,
    passes: int,
    seed: int,
    between: ReliefBetween | None = None,
    progress: Progress | None = None,
) -> int:
    """Refine the filled part of ``state`` in place; return the number of passes made.

    Windows go from ``window`` down to half of it. Between passes the voted relief is brought back to the distribution of
    the measured relief (averaging flattens it). The last pass copies the best match's displacement.

    Parameters
    ----------
    ground : Ground
    metric : VotingMetric
        The metric that growth used.
    state : State
        Fully grown; ``height``, ``source``, ``rotation``, ``error`` and ``color`` of filled vertices change.
    window : int
        Rings of the first pass.
    passes : int
        At least 1; the last is the copying one.
    seed : int
    between : ReliefBetween, optional
        Reads the last pass's displacements between the samples' vertices.
    progress : callable, optional
        Called with (vertices matched, vertices to match), growth counted in.
    """
    targets = np.flatnonzero(state.textured & ~ground.measured)
    if len(targets) == 0:
        return 0
    copy_best = Selection("near-best", tolerance=0.0)
    references = _references(ground, state, targets)
    spread = float(state.height[ground.measured].var()) or 1.0
    last_window = max(min(_SMALLEST_WINDOW, window), window // 2)
    for step in range(passes):
        size = round(window + (last_window - window) * step / max(passes - 1, 1))
        windows = np.full(len(targets), size)
        draw = uniform(seed, Stream.RELIEF_REFINE, targets, step)
        picks = metric.pick(targets, windows, state, copy_best, draw)
        found = picks.sample >= 0
        if step < passes - 1:
            confidence = (picks.error[found] / spread + 1e-6) ** _ROBUST_POWER
            voted, shown = metric.vote(targets[found], picks, found, size, confidence)
            hit = np.isfinite(voted)
            state.height[targets[hit]] = voted[hit]
            for own, measured in references:
                state.height[own] = _redistribute(state.height[own], measured)
            state.sample[targets[found]], state.rotation[targets[found]] = picks.sample[found], picks.rotation[found]
            if shown is not None and state.color is not None:
                state.color[targets[hit]] = decode_srgb(shown[hit])
        else:
            copied = Picks(picks.sample[found], picks.rotation[found], picks.error[found])
            carry_relief(state, targets[found], metric.samples, copied, between, windows[found])
        if progress is not None:
            progress(len(targets) * (2 + step), len(targets) * (1 + passes))
    return passes


def _references(ground: Ground, state: State, targets: Array) -> list[tuple[Array, Array]]:
    """Filled vertices, and the sorted measured heights whose distribution theirs should have.

    On a plane, cylinder or sphere the relief is taken to be one texture. Over a scan of any shape it is rough here and smooth
    there: each hole goes by what surrounds it, as far from its rim as it is large.
    """
    if not isinstance(ground.base, SmoothBase):
        return [(targets, np.sort(state.height[ground.measured]))]
    # Along edges, not faces: a slit one vertex wide is one hole as well.
    edges = unique_edges(ground.faces)
    own_edges = edges[~ground.measured[edges].any(axis=1)]
    shape = (len(ground.measured), len(ground.measured))
    label = connected_components(coo_array((np.ones(len(own_edges), bool), own_edges.T), shape=shape), directed=False)[1]
    scan = np.flatnonzero(ground.measured)
    tree = cKDTree(ground.foot[scan])
    order = targets[np.argsort(label[targets], kind="stable")]
    out = []
    for own in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        foot = ground.foot[own]
        center = foot.mean(axis=0)
        radius = float(np.linalg.norm(foot - center, axis=1).max()) + ground.spacing
        near = scan[tree.query_ball_point(center, 2 * radius + _SURROUNDINGS * ground.spacing)]
        if len(near) >= len(own):
            out.append((own, np.sort(state.height[near])))
    return out


def _redistribute(height: Array, measured_sorted: Array) -> Array:
    """Map ``height`` monotonically so that its distribution is that of the measured relief."""
    order = np.argsort(height, kind="stable")
    rank = (np.arange(len(height)) + 0.5) / len(height)
    out = np.empty_like(height)
    out[order] = np.interp(rank, (np.arange(len(measured_sorted)) + 0.5) / len(measured_sorted), measured_sorted)
    return out
