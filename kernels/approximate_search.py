"""Approximate matching of neighbourhoods: proposals, then descent among the samples.

After PatchMatch (Barnes et al. 2009; 2010 with rotations) and coherent search (Ashikhmin 2001), on a surface: if a target's
neighbour was matched to a sample, the sample beside that one, on the target's side, is a likely match. Landmarks, a part of the
samples that `NeighborhoodMatcher` compares in full, bring in what no neighbour knows. From the best few the search goes down
to neighbouring samples as long as the cost falls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload
from intaglio.kernels.meshes import Frames, upload_frames
from intaglio.kernels.neighborhoods import MISSING, Matches
from intaglio.kernels.selection import VIABLE

# Loops unrolled to more than four rounds would take the compiler several times as long, and run no faster.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

LISTED = 8
_LISTED = wp.constant(LISTED)
# Steps of a descent, and candidates tried by chance.
_STEPS = wp.constant(12)
_CHANCES = wp.constant(8)
# Stands for the cost of a candidate whose comparison was given up.
_NEVER = wp.constant(1.0e30)
_VIABLE = wp.constant(VIABLE)


@wp.struct
class TargetTable:
    """Targets' values on the grid (T, G), and their weights, 0 where a value is not known."""

    value: wp.array2d[wp.float32]
    weight: wp.array2d[wp.float32]


@wp.struct
class SampleTable:
    """Samples' values on the grid (S, G), the grid's rotations (R, G), and where the samples lie."""

    value: wp.array2d[wp.float32]
    permutation: wp.array2d[wp.int32]
    # The samples next to each one on the surface.
    beside: wp.array2d[wp.int32]
    frames: Frames


@wp.struct
class MatchedGround:
    """Vertices with their frames, who is joined to whom, and the sample and rotation (radians) that each one carries, or -1."""

    frames: Frames
    offsets: wp.array[wp.int32]
    neighbors: wp.array[wp.int32]
    matched: wp.array[wp.int32]
    rotation: wp.array[wp.float32]


@wp.func
def bounded_cost(
    targets: TargetTable,
    t: int,
    samples: SampleTable,
    s: int,
    q: int,
    bound: float,
) -> float:
    """Return Σ_k w_k (x_k - y_perm(q, k))² of target ``t`` and sample ``s`` at rotation ``q``, given up once above ``bound``."""
    total = float(0.0)
    k = int(0)
    grid = targets.value.shape[1]
    while k < grid:
        last = wp.min(k + 16, grid)
        for j in range(k, last):
            w = targets.weight[t, j]
            if w > 0.0:
                d = targets.value[t, j] - samples.value[s, samples.permutation[q, j]]
                total += w * d * d
        k = last
        if total > bound:
            k = grid
    return total


@wp.func
def consider(
    targets: TargetTable,
    t: int,
    samples: SampleTable,
    s: int,
    q: int,
    factor: float,
    listed: wp.array2d[wp.int32],
    cost: wp.array2d[wp.float32],
) -> float:
    """Compare one candidate and keep it in the target's list, sorted by cost, if it is among the best; return its cost."""
    candidate = q * samples.value.shape[0] + s
    result = float(_NEVER)
    known = int(0)
    for i in range(_LISTED):
        if listed[t, i] == candidate:
            known = int(1)
            result = cost[t, i]
    if known == 0:
        bound = wp.min(cost[t, _LISTED - 1], factor * cost[t, 0])
        bound = wp.min(bound, _VIABLE)
        result = bounded_cost(targets, t, samples, s, q, bound)
        if result >= bound:
            # The sum was given up, and is no cost.
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
    targets: TargetTable,
    t: int,
    samples: SampleTable,
    candidate: int,
    factor: float,
    listed: wp.array2d[wp.int32],
    cost: wp.array2d[wp.float32],
):
    """Go from one candidate to the best of its neighbours, beside it and turned by one step, as long as the cost falls."""
    sample_count = samples.value.shape[0]
    rotations = samples.permutation.shape[0]
    at = int(candidate)
    least = bounded_cost(targets, t, samples, at % sample_count, at / sample_count, _VIABLE)
    step = int(0)
    while step < _STEPS:
        s = at % sample_count
        q = at / sample_count
        lower = int(-1)
        for j in range(samples.beside.shape[1]):
            other = bounded_cost(targets, t, samples, samples.beside[s, j], q, least)
            if other < least:
                least = other
                lower = q * sample_count + samples.beside[s, j]
        if rotations > 1:
            for side in range(2):
                r = (q + 1 + side * (rotations - 2)) % rotations
                other = bounded_cost(targets, t, samples, s, r, least)
                if other < least:
                    least = other
                    lower = r * sample_count + s
        if lower < 0:
            step = _STEPS
        else:
            at = lower
        step = step + 1
    consider(targets, t, samples, at % sample_count, at / sample_count, factor, listed, cost)


@wp.func
def turned(angle: float, rotations: int) -> int:
    """Return the number of the rotation that is nearest to ``angle``."""
    step = 6.283185307179586 / float(rotations)
    q = int(wp.round(angle / step)) % rotations
    if q < 0:
        q = q + rotations
    return q


@wp.kernel
def search_kernel(
    start: int,
    vertices: wp.array[wp.int32],
    targets: TargetTable,
    samples: SampleTable,
    ground: MatchedGround,
    landmarks: wp.array2d[wp.int32],
    factor: float,
    seed: int,
    # output
    listed: wp.array2d[wp.int32],
    cost: wp.array2d[wp.float32],
):
    """List the candidates of least cost Σ_k w_k (x_k - y_perm(q, k))² that one target's search meets, best first."""
    t = start + wp.tid()
    vertex = vertices[t]
    sample_count = samples.value.shape[0]
    rotations = samples.permutation.shape[0]
    for i in range(_LISTED):
        listed[t, i] = -1
        cost[t, i] = _NEVER
    for i in range(landmarks.shape[1]):
        candidate = landmarks[t, i]
        if candidate >= 0:
            consider(
                targets, t, samples, candidate % sample_count, candidate / sample_count, factor, listed, cost
            )  # fmt: skip
    if ground.matched[vertex] >= 0:
        q = turned(ground.rotation[vertex], rotations)
        consider(targets, t, samples, ground.matched[vertex], q, factor, listed, cost)
    for i in range(ground.offsets[vertex], ground.offsets[vertex + 1]):
        near = ground.neighbors[i]
        s = ground.matched[near]
        if s >= 0:
            # The step from the neighbour to this vertex, turned into the frame of the neighbour's match.
            way = ground.frames.foot[vertex] - ground.frames.foot[near]
            x = wp.dot(way, ground.frames.u[near])
            y = wp.dot(way, ground.frames.v[near])
            c = wp.cos(ground.rotation[near])
            d = wp.sin(ground.rotation[near])
            wanted = (c * x - d * y) * samples.frames.u[s] + (d * x + c * y) * samples.frames.v[s]
            best = int(s)
            nearest = float(wp.length_sq(wanted))
            for j in range(samples.beside.shape[1]):
                gap = wp.length_sq(samples.frames.foot[samples.beside[s, j]] - samples.frames.foot[s] - wanted)
                if gap < nearest:
                    nearest = gap
                    best = samples.beside[s, j]
            # Frames differ from vertex to vertex, so the rotation is corrected by how frames turn from here to there.
            here = wp.atan2(
                wp.dot(ground.frames.u[near], ground.frames.v[vertex]), wp.dot(ground.frames.u[near], ground.frames.u[vertex])
            )
            there = wp.atan2(
                wp.dot(samples.frames.u[s], samples.frames.v[best]), wp.dot(samples.frames.u[s], samples.frames.u[best])
            )
            q = turned(ground.rotation[near] - here + there, rotations)
            consider(targets, t, samples, best, q, factor, listed, cost)
    state = wp.rand_init(seed, vertex)
    for _ in range(_CHANCES):
        s = wp.randi(state, 0, sample_count)
        q = wp.randi(state, 0, rotations)
        consider(targets, t, samples, s, q, factor, listed, cost)
    # Descend from the landmarks, each of which may lie in another basin, and from the best candidates met so far.
    for i in range(landmarks.shape[1]):
        if landmarks[t, i] >= 0:
            descend(targets, t, samples, landmarks[t, i], factor, listed, cost)
    starts = wp.vec4i(listed[t, 0], listed[t, 1], listed[t, 2], listed[t, 3])
    for i in range(4):
        if starts[i] >= 0:
            descend(targets, t, samples, starts[i], factor, listed, cost)


@dataclass(frozen=True)
class Patchwork:
    """Where targets lie, and what their neighbours were matched to.

    Attributes
    ----------
    foot, u, v : (N, 3) arrays
        Vertices' base points and frames, near the origin.
    offsets, neighbors : (N + 1,), (E,) int32 arrays
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
    neighbors: np.ndarray
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
        self._table = SampleTable()
        self._table.value = upload(np.where(known > 0, value, np.float32(MISSING)), wp.float32, device)
        self._table.permutation = upload(permutation, wp.int32, device)
        self._table.beside = upload(beside, wp.int32, device)
        self._table.frames = upload_frames(foot, u, v, device)
        self._ground = MatchedGround()
        self._ground_of: Patchwork | None = None

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
            As `NeighborhoodMatcher.match` takes them.
        patchwork : Patchwork
        landmarks : (T, L) int32 array
            Candidates to begin with, ``rotation * S + sample``, -1 for none.
        factor : float
            At least 1.
        seed : int
            Seeds the choice of the few candidates that are tried by chance.
        """
        count = len(targets)
        table = TargetTable()
        table.value, table.weight = upload(value, wp.float32, self.device), upload(weight, wp.float32, self.device)
        listed = wp.empty((count, LISTED), dtype=wp.int32, device=self.device)
        cost = wp.empty((count, LISTED), dtype=wp.float32, device=self.device)
        launch(
            search_kernel,
            count,
            inputs=[
                upload(targets, wp.int32, self.device),
                table,
                self._table,
                self._upload_ground(patchwork),
                upload(landmarks, wp.int32, self.device),
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

    def _upload_ground(self, patchwork: Patchwork) -> MatchedGround:
        """Return ``patchwork`` on the device; what does not change from call to call is uploaded once."""
        ground = self._ground
        if self._ground_of is None or self._ground_of.foot is not patchwork.foot:
            ground.frames = upload_frames(patchwork.foot, patchwork.u, patchwork.v, self.device)
            ground.offsets = upload(patchwork.offsets, wp.int32, self.device)
            ground.neighbors = upload(patchwork.neighbors, wp.int32, self.device)
            self._ground_of = patchwork
        ground.matched = upload(patchwork.matched, wp.int32, self.device)
        ground.rotation = upload(patchwork.rotation, wp.float32, self.device)
        return ground
