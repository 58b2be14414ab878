"""One level of synthesis by coherent pieces: patches over borders are matched and vote, and pixels are copied anew."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.kernels.patch_field import PatchField, patch_grid
from intaglio.kernels.patch_match import SIDE, STRIDE
from intaglio.randomness import Stream, uniform
from intaglio.synthesis.result import pixel_positions
from intaglio.synthesis.sample import window_starts

# Sweeps of a pass: how far off the neighbours are that a patch asks, in patches.
_JUMPS = (4, 2, 1)

# Places that a patch tries by chance in a sweep.
_CHANCES = 6

# A patch votes with exp(-cost / 2 s^2), s^2 this percentile of all costs.
_PERCENTILE = 75.0

# How much a match's cost grows with each time that its pixels are used more than evenly, and the most that counts.
_EVENNESS, _MOST_EXCESS = 0.25, 4.0

# Rounds in which borders move, a pixel's faith in the vote against seams, and the price of a border in units of the sample's own
# mean squared step.
_ROUNDS, _FAITH, _PRICE = 4, 0.5, 0.05


def improve_level(
    planes: Array, usable: Array, source: Array, *, passes: int, wrap: bool, seed: int, number: int, device: str
) -> Array:
    """Return the provenance (H, W, 2) with the borders between pieces improved.

    Parameters
    ----------
    planes : (n, h, w) float32 array
        The sample on this level, as it is compared.
    usable : (h, w) bool array
    source : (H, W, 2) int array
    passes : int
        How often patches are matched and vote.
    wrap : bool
    seed, number : int
        The level's number keys its random places.
    device : str
    """
    starts = window_starts(usable, SIDE) if min(usable.shape) >= SIDE else np.zeros((0, 0), bool)
    shape = source.shape[:2]
    if passes == 0 or not starts.any() or min(shape) < SIDE + (STRIDE if wrap else 0):
        return source
    active = broken_patches(source, wrap)
    if not active.any():
        return source
    covered = covered_pixels(active, shape, wrap)
    field = PatchField(
        planes,
        usable,
        starts,
        planes[:, source[..., 0], source[..., 1]],
        source,
        covered,
        np.flatnonzero(active),
        wrap,
        device,
        len(planes),
    )
    step = mean_step(planes, usable)
    for turn in range(passes):
        field.set_excess(_excess(field.source, usable, starts))
        for jump in _JUMPS if turn == 0 else _JUMPS[1:]:
            key = int(uniform(seed, Stream.SYNTHESIS_SWEEP, number, turn, jump) * 2**31)
            field.sweep(jump=jump, chances=_CHANCES, radius=max(starts.shape) // 2, evenness=_EVENNESS, seed=key)
        field.vote(vote_weights(field.cost, active))
    field.copy(_ROUNDS, _FAITH, _PRICE * step)
    return field.source


def refine_source(source: Array, shape: tuple[int, int], usable: Array) -> Array:
    """Return the provenance (H, W, 2) on the next finer level, of rows and columns ``shape``, of usable pixels alone."""
    fine = np.repeat(np.repeat(2 * source, 2, axis=0), 2, axis=1)[: shape[0], : shape[1]]
    fine += pixel_positions(shape) % 2
    fine = np.minimum(fine, np.array(usable.shape, np.int32) - 1)
    if not usable.all():
        nearest = ndimage.distance_transform_edt(~usable, return_distances=False, return_indices=True)
        fine = np.moveaxis(nearest[:, fine[..., 0], fine[..., 1]], 0, 2).astype(np.int32)
    return np.ascontiguousarray(fine)


def broken_patches(source: Array, wrap: bool) -> Array:
    """Return (rows, columns) bool: the patches that are no copy of one piece of the sample."""
    grid = patch_grid((source.shape[0], source.shape[1]), wrap)
    pad = SIDE if wrap else 0
    offset = source - pixel_positions(source.shape)
    if wrap:
        height, width = source.shape[:2]
        offset = np.pad(offset, ((0, pad), (0, pad), (0, 0)), mode="wrap")
        offset[height:, :, 0] -= height
        offset[:, width:, 1] -= width
    across = (np.diff(offset, axis=1) != 0).any(axis=2)
    down = (np.diff(offset, axis=0) != 0).any(axis=2)

    broken = sum_in_patches(across, grid, SIDE, SIDE - 1) + sum_in_patches(down, grid, SIDE - 1, SIDE)
    return np.asarray(broken > 0)


def sum_in_patches(mask: Array, grid: tuple[int, int], tall: int, wide: int) -> Array:
    """Return (rows, columns) int: how many of a mask's pixels lie in the first rows and columns of each patch of a canvas."""
    summed = np.pad(np.cumsum(np.cumsum(mask, axis=0, dtype=np.int64), axis=1), ((1, 0), (1, 0)))
    a, c = STRIDE * np.arange(grid[0]), STRIDE * np.arange(grid[1])
    b, d = a + tall, c + wide
    return np.asarray(summed[np.ix_(b, d)] - summed[np.ix_(a, d)] - summed[np.ix_(b, c)] + summed[np.ix_(a, c)])


def covered_pixels(active: Array, shape: tuple[int, int], wrap: bool) -> Array:
    """Return (H, W) bool: the pixels that lie in active patches."""
    height, width = shape[0] + SIDE, shape[1] + SIDE
    spread = np.zeros((height, width), bool)
    rows, columns = np.nonzero(active)
    spread[STRIDE * rows, STRIDE * columns] = True
    reach = np.zeros_like(spread)
    for dy in range(SIDE):
        reach[dy:] |= spread[: height - dy]
    filled = np.zeros_like(reach)
    for dx in range(SIDE):
        filled[:, dx:] |= reach[:, : width - dx]
    if wrap:
        filled[:SIDE] |= filled[shape[0] :]
        filled[:, :SIDE] |= filled[:, shape[1] :]
    return filled[: shape[0], : shape[1]]


def mean_step(planes: Array, usable: Array) -> float:
    """Return the mean squared step between neighbours of a sample, over all maps together."""
    total = 0.0
    for axis in (0, 1):
        both = np.moveaxis(usable, axis, 0)
        pairs = both[1:] & both[:-1]
        steps = np.diff(np.moveaxis(planes, axis + 1, 1), axis=1)[:, pairs]
        total += float((steps.astype(np.float64) ** 2).sum(axis=0).mean()) / 2 if steps.size else 0.0
    return total


def vote_weights(cost: Array, active: Array) -> Array:
    """Return the weights (K,) with which patches vote: 1 for copies."""
    costs = cost[active.ravel()]
    spread = float(np.percentile(costs, _PERCENTILE)) if len(costs) else 0.0
    weight = np.ones(len(cost), np.float32)
    if spread > 0:
        # Patches that fit nothing still say something: where they alone cover a pixel, their mean counts.
        weight[active.ravel()] = np.maximum(np.exp(-costs / (2 * spread)), 1e-6)
    return weight


def _excess(source: Array, usable: Array, starts: Array) -> Array:
    """Return how much more than evenly a patch's pixels are used, 0 where not more, from each start on."""
    height, width = usable.shape
    use = np.bincount(source[..., 0].ravel() * width + source[..., 1].ravel(), minlength=usable.size).reshape(height, width)
    summed = np.pad(np.cumsum(np.cumsum(use, axis=0), axis=1), ((1, 0), (1, 0)))
    box = summed[SIDE:, SIDE:] - summed[:-SIDE, SIDE:] - summed[SIDE:, :-SIDE] + summed[:-SIDE, :-SIDE]
    even = source[..., 0].size / max(int(usable.sum()), 1) * SIDE * SIDE
    return np.asarray(np.clip(box[: starts.shape[0], : starts.shape[1]] / even - 1, 0, _MOST_EXCESS))
