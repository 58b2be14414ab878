"""Choosing by trial: small results, measured against the sample by a statistic that synthesis does not optimise.

The statistic is the sliced Wasserstein distance of patches (Rabin et al. 2011) over several scales: along random directions the
sorted projections of the result's patches are compared with those of the sample's.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from intaglio.arrays import Array
from intaglio.randomness import Stream, uniform

_PATCH, _PATCHES, _DIRECTIONS, _SCALES = 7, 6_000, 32, 4
# Blocks that are tried, in shares of the sample's shorter side, beside the one that autocorrelation suggests.
_SHARES = (0.12, 0.2, 0.28, 0.36)
# A trial's result is so many times as wide as the sample, at most _WIDEST pixels.
_WIDTH, _WIDEST = 1.5, 384
# The suggested block stays unless another is better by this.
_BETTER = 0.9


def patch_distance(result: Array, sample: Array, usable: Array, seed: int) -> float:
    """Return how far the patches of a result (H, W, n) are from those of a sample (h, w, n), in the sample's standard deviations.

    Parameters
    ----------
    result, sample : (H, W, n), (h, w, n) arrays
    usable : (h, w) bool array
        Pixels of the sample that count.
    seed : int
    """
    spread = float(sample[usable].std()) or 1.0
    total, scales = 0.0, 0
    for scale in range(_SCALES):
        if min(*result.shape[:2], *sample.shape[:2]) < 2 * _PATCH:
            break
        found = [_patches(image, mask, seed, scale) for image, mask in ((result, None), (sample, usable))]
        if any(len(patches) == 0 for patches in found):
            break
        width = found[0].shape[1]
        way = uniform(seed, Stream.SYNTHESIS_TRIAL, scale, np.arange(width * _DIRECTIONS)).reshape(width, -1) - 0.5
        way /= np.linalg.norm(way, axis=0)
        one, other = (np.sort(patches @ way, axis=0) for patches in found)
        at = np.linspace(0, 1, min(len(one), len(other)))
        one, other = (v[np.round(at * (len(v) - 1)).astype(int)] for v in (one, other))
        total += float(np.abs(one - other).mean()) / spread
        scales += 1
        result, (sample, usable) = _half(result, np.ones(result.shape[:2], bool))[0], _half(sample, usable)
    return total / max(scales, 1)


def best_block(
    suggested: int, sample: Array, usable: Array, limits: tuple[int, int], lay: Callable[[int, int], Array], seed: int
) -> tuple[int, str]:
    """Return the side of the block whose small result is nearest to the sample, and how it was found.

    Parameters
    ----------
    suggested : int
        The side that the sample's autocorrelation suggests.
    sample : (H, W, n) array
    usable : (H, W) bool array
    limits : (int, int)
        Smallest and largest side that can be used.
    lay : callable
        Called with a side and a size; returns a square result (size, size, n).
    seed : int
    """
    shorter = min(sample.shape[:2])
    size = int(min(_WIDTH * shorter, _WIDEST))
    sides = sorted({suggested, *(round(share * shorter) for share in _SHARES)})
    least, most = max(limits[0], 8), min(limits[1], size // 2)
    sides = [side for side in sides if least <= side <= most]
    if not sides or sides == [suggested]:
        return suggested, ""
    off = {side: patch_distance(lay(side, size), sample, usable, seed) for side in sides}
    best = min(off, key=lambda side: off[side])
    if suggested in off and off[best] >= _BETTER * off[suggested]:
        best = suggested
    return best, "by trial of " + ", ".join(f"{side} ({value:.3f})" for side, value in off.items())


def _patches(image: Array, usable: Array | None, seed: int, scale: int) -> Array:
    """Return patches (K, _PATCH^2 n) drawn from where all of them is usable."""
    windows = np.lib.stride_tricks.sliding_window_view(image, (_PATCH, _PATCH), axis=(0, 1))
    starts = np.arange(windows.shape[0] * windows.shape[1])
    if usable is not None:
        whole = np.lib.stride_tricks.sliding_window_view(usable, (_PATCH, _PATCH)).all(axis=(2, 3))
        starts = np.flatnonzero(whole)
    if len(starts) == 0:
        return np.zeros((0, 1))
    draw = uniform(seed, Stream.SYNTHESIS_TRIAL, _SCALES + scale, np.arange(_PATCHES))
    chosen = starts[np.minimum((draw * len(starts)).astype(int), len(starts) - 1)]
    found = windows[np.unravel_index(chosen, windows.shape[:2])]
    return np.ascontiguousarray(found.reshape(len(found), -1), np.float32)


def _half(image: Array, usable: Array) -> tuple[Array, Array]:
    """Return an image and its mask at half the size: means of 2 x 2 pixels, usable where all four are."""
    height, width = (n // 2 * 2 for n in image.shape[:2])
    image, usable = image[:height, :width], usable[:height, :width]
    quarter = [(slice(a, None, 2), slice(b, None, 2)) for a in (0, 1) for b in (0, 1)]
    return np.mean([image[q] for q in quarter], axis=0), np.all([usable[q] for q in quarter], axis=0)
