"""The size of a texture's elements, from its autocorrelation."""

from __future__ import annotations

import numpy as np
from scipy import fft, ndimage

from intaglio.arrays import Array

# A peak of the autocorrelation this high counts as a repetition of the pattern.
_PEAK = 0.25

# Pixels at a distance where it has fallen to this are nearly uncorrelated.
_FALLEN = 0.2

SMALLEST = 8


def autocorrelation(features: Array, usable: Array) -> Array:
    """Return the autocorrelation of planes (n, H, W), the mean of the maps weighted by variance: (H, W), lag 0 first.

    Lags along an axis run from 0 to half its length and, from the end back, through the negative ones. Only pairs of usable
    pixels count; lags with less than a tenth of all pairs are 0.
    """
    height, width = usable.shape
    shape = (fft.next_fast_len(2 * height, real=True), fft.next_fast_len(2 * width, real=True))

    def correlated(plane: Array) -> Array:
        found: Array = fft.irfft2(np.abs(fft.rfft2(plane, shape)) ** 2, shape)
        return found

    weight = usable.astype(np.float64)
    pairs = correlated(weight)
    total = np.zeros(shape)
    for plane in features.astype(np.float64):
        total += correlated((plane - plane[usable].mean()) * weight)
    enough = pairs > 0.1 * pairs[0, 0]
    covariance = np.divide(total, pairs, out=np.zeros(shape), where=enough)
    if covariance[0, 0] <= 0:
        return np.zeros((height, width))
    rows, columns = (np.r_[0 : n // 2 + 1, -(n - n // 2 - 1) : 0] for n in (height, width))
    return covariance[np.ix_(rows, columns)] / covariance[0, 0]


def element_size(features: Array, usable: Array) -> tuple[float, str]:
    """Return how large the texture's elements are, in pixels, and how that was found.

    The longer of the two shortest repetitions (lags of peaks that are not multiples of one another) if there is a pattern,
    else three times the distance at which the autocorrelation has fallen to a fifth.
    """
    correlation = autocorrelation(features, usable)
    height, width = correlation.shape
    if not correlation.any():
        return float(SMALLEST), "the sample is constant"
    centred = np.fft.fftshift(correlation)
    lag = np.stack(np.meshgrid(np.arange(height) - height // 2, np.arange(width) - width // 2, indexing="ij"))
    far = np.hypot(*lag)
    rounds = np.round(far).astype(int)
    mean = np.bincount(rounds.ravel(), centred.ravel()) / np.bincount(rounds.ravel())
    below = np.flatnonzero(mean < _FALLEN)
    length = float(below[0]) if len(below) else float(min(height, width) / 2)

    peak = (centred == ndimage.maximum_filter(centred, size=5)) & (centred > _PEAK) & (far > 1.5 * length)
    # Longer periods can't be distinguished from chance.
    peak &= far < min(height, width) / 3
    # A pattern falls below zero before it returns; a slow slope does not.
    if peak.any() and mean[: int(min(height, width) / 2)].min() < 0:
        first = np.argmin(np.where(peak, far, np.inf))
        along = lag.reshape(2, -1)[:, first] / far.ravel()[first]
        aside = np.abs(lag[0] * along[1] - lag[1] * along[0]) > 0.5 * far
        other = np.where(peak & aside, far, np.inf)
        period = float(min(np.min(other), 2 * far.ravel()[first]))
        period = max(period, float(far.ravel()[first]))
        return period, f"its pattern repeats every {period:.0f} pixels"
    return 3 * length, f"its autocorrelation falls to {_FALLEN:g} at {length:.0f} pixels"


def automatic_block(features: Array, usable: Array) -> tuple[int, str]:
    """Return the side of a block that holds one element of the texture and a margin, and how it was found.

    At least 8 pixels and at most a third of the sample's shorter side, so that there are blocks to choose from.
    """
    size, found = element_size(features, usable)
    largest = max(2, min(usable.shape) // 3)
    return int(np.clip(round(1.25 * size), min(SMALLEST, largest), largest)), found
