"""Pairs of points of two surfaces that are to be joined: costs, coherence and the greedy choice.

Duranleau & Poulin, section 5.2. Every target lists the eight sources that cost it least, all targets at once; then the
targets of a patch choose in order, each the first of its list that is still free. This is Duranleau & Poulin's greedy
choice, since the costs of one round depend on the pairs of the round before only. A target all of whose eight sources are taken
stays without one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload
from intaglio.kernels.point_surface import PointSurface
from intaglio.kernels.points import PointGrid

wp.set_module_options({"enable_backward": False})

_LISTED = 8


@wp.struct
class PairWeights:
    """Weights and limits of equation 2 and of the coherence term; lengths are in patch sides."""

    position: float
    normal: float
    variation: float
    length: float
    direction: float
    most_position: float
    most_normal: float
    most_variation: float
    unit: float
    radius: float


@wp.kernel
def coherence_kernel(
    start: int,
    first: wp.array[wp.int32],
    group: wp.array[wp.int32],
    targets: wp.array[wp.vec3],
    sources: wp.array[wp.vec3],
    pair: wp.array[wp.int32],
    weights: PairWeights,
    # output
    length: wp.array[wp.float32],
    direction: wp.array[wp.vec3],
):
    """Write f_l and f_d: mean length and direction of the pairs near a target q, weighted by exp(-|q - t_k|² / 2 radius²)."""
    i = start + wp.tid()
    q = targets[i]
    g = group[i]
    total = float(0.0)
    mean = float(0.0)
    toward = wp.vec3()
    for k in range(first[g], first[g + 1]):
        s = pair[k]
        if s >= 0:
            d = sources[s] - targets[k]
            w = wp.exp(-wp.length_sq(q - targets[k]) / (2.0 * weights.radius * weights.radius))
            total += w
            mean += w * wp.length(d)
            toward += w * d
    if total > 0.0:
        mean = mean / total
    length[i] = mean
    direction[i] = wp.normalize(toward)


@wp.func
def precedes(cost: float, index: int, other_cost: float, other: int):
    """Return whether a source comes before another: by cost, then by index, so that the order of the visit does not matter."""
    return cost < other_cost or (cost == other_cost and index < other)


@wp.kernel
def list_sources_kernel(
    start: int,
    surface: PointGrid,
    variation: wp.array[wp.float32],
    targets: wp.array[wp.vec3],
    target_normals: wp.array[wp.vec3],
    target_variation: wp.array[wp.float32],
    weights: PairWeights,
    coherent: int,
    length: wp.array[wp.float32],
    direction: wp.array[wp.vec3],
    # output
    listed: wp.array2d[wp.int32],
    cost: wp.array2d[wp.float32],
):
    """List the eight sources that cost a target least, best first, -1 where fewer are allowed.

    c = ω_p |p - q| + ω_n (1 - n_p . n_q) / 2 + ω_v (v_p - v_q)² of equation 2, and if ``coherent``
    + ω_l ||p - q| - f_l| + ω_d (1 - cos(p - q, f_d)) / 2.
    """
    i = start + wp.tid()
    q = targets[i]
    n = target_normals[i]
    v = target_variation[i]
    for k in range(_LISTED):
        listed[i, k] = -1
        cost[i, k] = float(3.0e38)
    reach = weights.most_position * weights.unit
    for j in wp.hash_grid_query(surface.grid, q, reach, 0):
        d = (surface.points[j] - q) / weights.unit
        r = wp.length(d)
        turned = 0.5 * (1.0 - wp.dot(surface.normals[j], n))
        varied = variation[j] - v
        varied = varied * varied
        if r <= weights.most_position:
            if turned <= weights.most_normal and varied <= weights.most_variation:
                c = weights.position * r + weights.normal * turned + weights.variation * varied
                if coherent == 1:
                    c += weights.length * wp.abs(r - length[i] / weights.unit)
                    if r > 0.0:
                        c += 0.5 * weights.direction * (1.0 - wp.dot(direction[i], d) / r)
                if precedes(c, j, cost[i, _LISTED - 1], listed[i, _LISTED - 1]):
                    k = int(_LISTED - 1)
                    while k > 0 and precedes(c, j, cost[i, wp.max(k - 1, 0)], listed[i, wp.max(k - 1, 0)]):
                        cost[i, k] = cost[i, k - 1]
                        listed[i, k] = listed[i, k - 1]
                        k -= 1
                    cost[i, k] = c
                    listed[i, k] = j


@wp.kernel
def choose_pairs_kernel(
    start: int,
    first: wp.array[wp.int32],
    listed: wp.array2d[wp.int32],
    # output
    pair: wp.array[wp.int32],
):
    """Let the targets of a patch choose in order, each the first source of its list that none before it has chosen."""
    g = start + wp.tid()
    for i in range(first[g], first[g + 1]):
        chosen = int(-1)
        for k in range(_LISTED):
            s = listed[i, k]
            if chosen < 0 and s >= 0:
                free = int(1)
                for before in range(first[g], i):
                    if pair[before] == s:
                        free = 0
                if free == 1:
                    chosen = s
        pair[i] = chosen


@dataclass(frozen=True)
class PairCosts:
    """Weights and limits of pairs.

    Attributes
    ----------
    position, normal, variation, length, direction : float
        ω_p, ω_n, ω_v, ω_l, ω_d.
    most_position, most_normal, most_variation : float
        Limits: of the distance in units, of (1 - cos) / 2, of the squared difference of variation.
    unit : float
        Lengths count in this.
    radius : float
        Width of the Gaussian θ.
    """

    position: float
    normal: float
    variation: float
    length: float
    direction: float
    most_position: float
    most_normal: float
    most_variation: float
    unit: float
    radius: float

    def on_device(self) -> PairWeights:
        """Return them as kernels take them."""
        weights = PairWeights()
        for name, value in vars(self).items():
            setattr(weights, name, float(value))
        return weights


@dataclass(frozen=True)
class Targets:
    """Points of several patches, sorted by patch, each of which is to be paired with a source; in the sources' coordinates.

    Attributes
    ----------
    points, normals : (n, 3) float32 arrays
    variation : (n,) float32 array
    first : (B + 1,) int array
        Where each patch's begin.
    """

    points: np.ndarray
    normals: np.ndarray
    variation: np.ndarray
    first: np.ndarray


def pair_points(
    surface: PointSurface,
    variation: np.ndarray,
    targets: Targets,
    costs: PairCosts,
    rounds: int,
) -> np.ndarray:
    """Return for every target the index of the source it is paired with, -1 for none.

    Parameters
    ----------
    surface : PointSurface
        The sources, one group; the patches share them, a source serves one target of each. Indices returned are into the
        points as given.
    variation : (m,) array
        Surface variation of the sources.
    targets : Targets
    costs : PairCosts
    rounds : int
        Rounds with the coherence term.
    """
    device, count = surface.device, len(targets.points)
    if not count or not len(surface):
        return np.full(count, -1)
    weights = costs.on_device()
    first = upload(targets.first, wp.int32, device)
    group = upload(np.repeat(np.arange(len(targets.first) - 1), np.diff(targets.first)), wp.int32, device)
    points = upload(targets.points, wp.vec3, device)
    normals = upload(targets.normals, wp.vec3, device)
    bent = upload(targets.variation, wp.float32, device)
    sources_bent = upload(np.asarray(variation)[surface.order], wp.float32, device)
    listed = wp.empty((count, _LISTED), dtype=wp.int32, device=device)
    cost = wp.empty((count, _LISTED), dtype=wp.float32, device=device)
    pair = wp.full(count, -1, dtype=wp.int32, device=device)
    near = wp.zeros(count, dtype=wp.float32, device=device)
    toward = wp.zeros(count, dtype=wp.vec3, device=device)
    for turn in range(rounds + 1):
        if turn:
            launch(
                coherence_kernel,
                count,
                inputs=[first, group, points, surface.points, pair, weights],
                outputs=[near, toward],
                device=device,
                work=10 * count / max(len(targets.first) - 1, 1),
            )
        launch(
            list_sources_kernel,
            count,
            inputs=[surface.point_grid, sources_bent, points, normals, bent, weights, int(turn > 0), near, toward],
            outputs=[listed, cost],
            device=device,
            work=5000,
        )
        launch(choose_pairs_kernel, len(targets.first) - 1, inputs=[first, listed], outputs=[pair], device=device, work=20000)
    chosen = pair.numpy()
    return np.where(chosen >= 0, surface.order[np.maximum(chosen, 0)], -1)
