"""Choosing by trial: small results, measured against the sample by a statistic that synthesis does not optimise.

The statistic is the sliced Wasserstein distance of patches (Rabin et al. 2011) over several scales: along random directions the
sorted projections of the result's patches are compared with those of the sample's.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from intaglio.arrays import Array
from intaglio.randomness import Stream, uniform
from intaglio.synthesis.pyramid import halve_planes
from intaglio.synthesis.sample import window_starts

_PATCH, _PATCHES, _DIRECTIONS, _SCALES = 7, 6_000, 32, 4
# Blocks that are tried, in shares of the sample's shorter side, beside the one that autocorrelation suggests.
_SHARES = (0.12, 0.2, 0.28, 0.36)
# A trial's result is so many times as wide as the sample, at most _WIDEST pixels.
_WIDTH, _WIDEST = 1.5, 512
# The suggested block stays unless another is better by this.
_BETTER = 0.9


def patch_distance(result: Array, sample: Array, usable: Array, seed: int) -> float:
    """Return how far the patches of a result (n, H, W) are from those of a sample (n, h, w), in the sample's standard deviations.

    Parameters
    ----------
    result, sample : (n, H, W), (n, h, w) arrays
    usable : (h, w) bool array
        Pixels of the sample that count.
    seed : int
    """
    spread = float(sample[:, usable].std()) or 1.0
    total, scales = 0.0, 0
    everything = np.ones(result.shape[1:], bool)
    for scale in range(_SCALES):
        if min(*result.shape[1:], *sample.shape[1:]) < 2 * _PATCH:
            break
        found = [_patches(planes, known, seed, scale) for planes, known in ((result, everything), (sample, usable))]
        if any(len(patches) == 0 for patches in found):
            break
        width = found[0].shape[1]
        way = uniform(seed, Stream.SYNTHESIS_TRIAL, scale, np.arange(width * _DIRECTIONS)).reshape(width, -1) - 0.5
        way /= np.linalg.norm(way, axis=0)
        one, other = (np.sort(patches @ way, axis=0) for patches in found)
        total += float(np.abs(one - other).mean()) / spread
        scales += 1
        result, everything = halve_planes(result, everything)
        sample, usable = halve_planes(sample, usable)
    return total / max(scales, 1)


def best_block(
    suggested: int, sample: Array, usable: Array, limits: tuple[int, int], lay: Callable[[int, int], Array], seed: int
) -> tuple[int, str]:
    """Return the side of the block whose small result is nearest to the sample, and how it was found.

    Parameters
    ----------
    suggested : int
        The side that the sample's autocorrelation suggests.
    sample : (n, H, W) array
    usable : (H, W) bool array
    limits : (int, int)
        Smallest and largest side that can be used.
    lay : callable
        Called with a side and a size; returns a square result (n, size, size).
    seed : int
    """
    shorter = min(usable.shape)
    size = int(min(_WIDTH * shorter, _WIDEST))
    least, most = max(limits[0], 8), min(limits[1], size // 2)
    if most < suggested <= limits[1]:
        # A small result can't hold such blocks: nothing could be told of them.
        return suggested, ""
    sides = sorted({suggested, *(round(share * shorter) for share in _SHARES)})
    sides = [side for side in sides if least <= side <= most and window_starts(usable, side).any()]
    if not sides or sides == [suggested]:
        return suggested, ""
    off = {side: patch_distance(lay(side, size), sample, usable, seed) for side in sides}
    best = min(off, key=lambda side: off[side])
    if suggested in off and off[best] >= _BETTER * off[suggested]:
        best = suggested
    return best, "by trial of " + ", ".join(f"{side} ({value:.3f})" for side, value in off.items())


def _patches(planes: Array, usable: Array, seed: int, scale: int) -> Array:
    """Return patches (_PATCHES, n _PATCH^2) drawn from where all of them is usable; none where none is."""
    starts = window_starts(usable, _PATCH)
    place = np.flatnonzero(starts)
    if len(place) == 0:
        return np.zeros((0, 1))
    draw = uniform(seed, Stream.SYNTHESIS_TRIAL, _SCALES + scale, np.arange(_PATCHES))
    rows, columns = np.unravel_index(place[(draw * len(place)).astype(int)], starts.shape)
    windows = np.lib.stride_tricks.sliding_window_view(planes, (_PATCH, _PATCH), axis=(1, 2))
    return np.moveaxis(windows[:, rows, columns], 0, 1).reshape(_PATCHES, -1)
