"""Approximate matching of neighbourhoods: proposals, then descent among the samples.

After PatchMatch (Barnes et al. 2009; 2010 with rotations) and coherent search (Ashikhmin 2001), on a surface: if a target's
neighbour was matched to a sample, the sample beside that one, on the target's side, is a likely match. Landmarks, a part of the
samples that `NeighbourhoodMatcher` compares in full, bring in what no neighbour knows. From the best few the search goes down
to neighbouring samples as long as the cost falls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch
from intaglio.kernels.neighbourhoods import MISSING, Matches

wp.set_module_options({"enable_backward": False})

LISTED = 8
vec4i = wp.types.vector(length=4, dtype=wp.int32)
_LISTED = wp.constant(LISTED)
_STEPS = wp.constant(12)
_CHANCES = wp.constant(8)
_NEVER = wp.constant(1.0e30)
# As in `intaglio.kernels.selection`: costs from here on belong to candidates that lack something.
_VIABLE = wp.constant(1.0e6)


@wp.func
def bounded_cost(
    value: wp.array2d(dtype=float),
    weight: wp.array2d(dtype=float),
    t: int,
    permutation: wp.array2d(dtype=wp.int32),
    sample: wp.array2d(dtype=float),
    s: int,
    q: int,
    bound: float,
) -> float:
    """Weighted squared difference of target ``t`` and sample ``s`` at rotation ``q``; given up once it exceeds ``bound``."""
    total = float(0.0)
    k = int(0)
    grid = value.shape[1]
    while k < grid:
        last = wp.min(k + 16, grid)
        for j in range(k, last):
            w = weight[t, j]
            if w > 0.0:
                d = value[t, j] - sample[s, permutation[q, j]]
                total += w * d * d
        k = last
        if total > bound:
            k = grid
    return total


@wp.func
def consider(
    value: wp.array2d(dtype=float),
    weight: wp.array2d(dtype=float),
    t: int,
    permutation: wp.array2d(dtype=wp.int32),
    sample: wp.array2d(dtype=float),
    s: int,
    q: int,
    factor: float,
    listed: wp.array2d(dtype=wp.int32),
    cost: wp.array2d(dtype=float),
) -> float:
    """Compare one candidate and keep it in the target's list, sorted by cost, if it is among the best; return its cost."""
    candidate = q * sample.shape[0] + s
    result = float(_NEVER)
    known = int(0)
    for i in range(_LISTED):
        if listed[t, i] == candidate:
            known = int(1)
            result = cost[t, i]
    if known == 0:
        bound = wp.min(cost[t, _LISTED - 1], factor * cost[t, 0])
        bound = wp.min(bound, _VIABLE)
        result = bounded_cost(value, weight, t, permutation, sample, s, q, bound)
        if result >= bound:
            # Given up: the sum so far is no cost.
            result = _NEVER
        else:
            at = int(_LISTED - 1)
            while at > 0 and cost[t, wp.max(at - 1, 0)] > result:
                cost[t, at] = cost[t, at - 1]
                listed[t, at] = listed[t, at - 1]
                at = at - 1
            cost[t, at] = result
            listed[t, at] = candidate
    return result


@wp.func
def descend(
    value: wp.array2d(dtype=float),
    weight: wp.array2d(dtype=float),
    t: int,
    permutation: wp.array2d(dtype=wp.int32),
    sample: wp.array2d(dtype=float),
    beside: wp.array2d(dtype=wp.int32),
    candidate: int,
    factor: float,
    listed: wp.array2d(dtype=wp.int32),
    cost: wp.array2d(dtype=float),
):
    """Go from one candidate to the best of its neighbours, beside it and turned by one step, as long as the cost falls."""
    samples = sample.shape[0]
    rotations = permutation.shape[0]
    at = int(candidate)
    least = bounded_cost(value, weight, t, permutation, sample, at % samples, at / samples, _VIABLE)
    step = int(0)
    while step < _STEPS:
        s = at % samples
        q = at / samples
        lower = int(-1)
        for j in range(beside.shape[1]):
            other = bounded_cost(value, weight, t, permutation, sample, beside[s, j], q, least)
            if other < least:
                least = other
                lower = q * samples + beside[s, j]
        if rotations > 1:
            for side in range(2):
                r = (q + 1 + side * (rotations - 2)) % rotations
                other = bounded_cost(value, weight, t, permutation, sample, s, r, least)
                if other < least:
                    least = other
                    lower = r * samples + s
        if lower < 0:
            step = _STEPS
        else:
            at = lower
        step = step + 1
    consider(value, weight, t, permutation, sample, at % samples, at / samples, factor, listed, cost)


@wp.func
def turned(angle: float, rotations: int) -> int:
    """The rotation nearest to ``angle``."""
    step = 6.283185307179586 / float(rotations)
    q = int(wp.round(angle / step)) % rotations
    if q < 0:
        q = q + rotations
    return q


@wp.kernel
def search_kernel(
    start: int,
    value: wp.array2d(dtype=float),
    weight: wp.array2d(dtype=float),
    permutation: wp.array2d(dtype=wp.int32),
    sample: wp.array2d(dtype=float),
    beside: wp.array2d(dtype=wp.int32),
    sample_foot: wp.array(dtype=wp.vec3),
    sample_u: wp.array(dtype=wp.vec3),
    sample_v: wp.array(dtype=wp.vec3),
    targets: wp.array(dtype=wp.int32),
    foot: wp.array(dtype=wp.vec3),
    u: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    offsets: wp.array(dtype=wp.int32),
    neighbours: wp.array(dtype=wp.int32),
    matched: wp.array(dtype=wp.int32),
    rotation: wp.array(dtype=float),
    landmarks: wp.array2d(dtype=wp.int32),
    factor: float,
    seed: int,
    # output
    listed: wp.array2d(dtype=wp.int32),
    cost: wp.array2d(dtype=float),
):
    """List the best candidates that one target's search meets, best first."""
    t = start + wp.tid()
    vertex = targets[t]
    samples = sample.shape[0]
    rotations = permutation.shape[0]
    for i in range(_LISTED):
        listed[t, i] = -1
        cost[t, i] = _NEVER
    for i in range(landmarks.shape[1]):
        candidate = landmarks[t, i]
        if candidate >= 0:
            consider(
                value, weight, t, permutation, sample, candidate % samples, candidate / samples, factor, listed, cost
            )  # fmt: skip
    if matched[vertex] >= 0:
        q = turned(rotation[vertex], rotations)
        consider(value, weight, t, permutation, sample, matched[vertex], q, factor, listed, cost)
    for i in range(offsets[vertex], offsets[vertex + 1]):
        near = neighbours[i]
        s = matched[near]
        if s >= 0:
            # From the neighbour to here, as seen in the frame of the neighbour's match.
            way = foot[vertex] - foot[near]
            x = wp.dot(way, u[near])
            y = wp.dot(way, v[near])
            c = wp.cos(rotation[near])
            d = wp.sin(rotation[near])
            wanted = (c * x - d * y) * sample_u[s] + (d * x + c * y) * sample_v[s]
            best = int(s)
            nearest = float(wp.length_sq(wanted))
            for j in range(beside.shape[1]):
                gap = wp.length_sq(sample_foot[beside[s, j]] - sample_foot[s] - wanted)
                if gap < nearest:
                    nearest = gap
                    best = beside[s, j]
            # Frames differ from vertex to vertex, and so does what one rotation means.
            here = wp.atan2(wp.dot(u[near], v[vertex]), wp.dot(u[near], u[vertex]))
            there = wp.atan2(wp.dot(sample_u[s], sample_v[best]), wp.dot(sample_u[s], sample_u[best]))
            q = turned(rotation[near] - here + there, rotations)
            consider(value, weight, t, permutation, sample, best, q, factor, listed, cost)
    state = wp.rand_init(seed, vertex)
    for _ in range(_CHANCES):
        s = wp.randi(state, 0, samples)
        q = wp.randi(state, 0, rotations)
        consider(value, weight, t, permutation, sample, s, q, factor, listed, cost)
    # Down from the landmarks, each in its own basin, and from the best that has been met by now.
    for i in range(landmarks.shape[1]):
        if landmarks[t, i] >= 0:
            descend(value, weight, t, permutation, sample, beside, landmarks[t, i], factor, listed, cost)
    starts = vec4i(listed[t, 0], listed[t, 1], listed[t, 2], listed[t, 3])
    for i in range(4):
        if starts[i] >= 0:
            descend(value, weight, t, permutation, sample, beside, starts[i], factor, listed, cost)


@dataclass(frozen=True)
class Patchwork:
    """Where targets lie, and what their neighbours were matched to.

    Attributes
    ----------
    foot, u, v : (N, 3) arrays
        Vertices' base points and frames, near the origin.
    offsets, neighbours : (N + 1,), (E,) int32 arrays
        Which vertices are joined.
    matched : (N,) int32 array
        The sample that a vertex carries, or -1.
    rotation : (N,) float32 array
        By how much it is turned, in radians.
    """

    foot: np.ndarray
    u: np.ndarray
    v: np.ndarray
    offsets: np.ndarray
    neighbours: np.ndarray
    matched: np.ndarray
    rotation: np.ndarray


class ApproximateSearch:
    """Finds near-best samples of targets without comparing them all.

    Parameters
    ----------
    value, known : (S, G) arrays
        Samples' values on the grid, and which of them exist.
    permutation : (R, G) int32 array
    beside : (S, B) int32 array
        The samples next to each one on the surface.
    foot, u, v : (S, 3) arrays
        Samples' base points and frames, in the unit of `Patchwork`.
    device : str
        From `choose_device`.
    """

    def __init__(
        self,
        value: np.ndarray,
        known: np.ndarray,
        permutation: np.ndarray,
        beside: np.ndarray,
        foot: np.ndarray,
        u: np.ndarray,
        v: np.ndarray,
        device: str,
    ) -> None:
        self.device = device
        self.samples, self.rotations = len(value), len(permutation)
        self._permutation = self._array(permutation, wp.int32)
        self._sample = self._array(np.where(known > 0, value, np.float32(MISSING)), float)
        self._beside = self._array(beside, wp.int32)
        self._frames = [self._array(a, wp.vec3) for a in (foot, u, v)]
        self._ground: tuple[Patchwork, list[wp.array]] | None = None

    def match(
        self,
        targets: np.ndarray,
        value: np.ndarray,
        weight: np.ndarray,
        patchwork: Patchwork,
        landmarks: np.ndarray,
        factor: float,
        seed: int,
    ) -> Matches:
        """List up to 8 candidates within ``factor`` of the best that was met, best first.

        Parameters
        ----------
        targets : (T,) int32 array
            Vertices of ``patchwork``.
        value, weight : (T, G) arrays
            As `NeighbourhoodMatcher.match` takes them.
        patchwork : Patchwork
        landmarks : (T, L) int32 array
            Candidates to begin with, ``rotation * S + sample``, -1 for none.
        factor : float
            At least 1.
        seed : int
            Of the few candidates that are tried by chance.
        """
        count = len(targets)
        listed = wp.empty((count, LISTED), dtype=wp.int32, device=self.device)
        cost = wp.empty((count, LISTED), dtype=float, device=self.device)
        launch(
            search_kernel,
            count,
            inputs=[
                self._array(value, float),
                self._array(weight, float),
                self._permutation,
                self._sample,
                self._beside,
                *self._frames,
                self._array(targets, wp.int32),
                *self._put(patchwork),
                self._array(patchwork.matched, wp.int32),
                self._array(patchwork.rotation, float),
                self._array(landmarks, wp.int32),
                max(float(factor), 1.5),
                int(seed) & 0x7FFFFFFF,
            ],
            outputs=[listed, cost],
            device=self.device,
            grain=16,
        )
        candidate, found = listed.numpy().copy(), cost.numpy().astype(np.float64)
        near = (candidate >= 0) & (found <= factor * found[:, :1])
        return Matches(candidate, np.where(near, found, 1e30), near.sum(axis=1).astype(np.int32))

    def _put(self, patchwork: Patchwork) -> list[wp.array]:
        """Upload what does not change from list to list once."""
        if self._ground is None or self._ground[0].foot is not patchwork.foot:
            arrays = [self._array(a, wp.vec3) for a in (patchwork.foot, patchwork.u, patchwork.v)]
            arrays += [self._array(a, wp.int32) for a in (patchwork.offsets, patchwork.neighbours)]
            self._ground = (patchwork, arrays)
        return self._ground[1]

    def _array(self, data: np.ndarray, dtype: type) -> wp.array:
        kind = np.int32 if dtype is wp.int32 else np.float32
        return wp.array(np.ascontiguousarray(data, kind), dtype=dtype, device=self.device)
