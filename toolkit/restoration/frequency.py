"""Splitting an image into a low and a high band by its cosine transform (Yamauchi et al. 2005, section 5.2)."""

from __future__ import annotations

import numpy as np
from scipy import fft

from intaglio.arrays import Array

# Threshold of the deviation of the autocorrelation, for luminances in [0, 1], and the largest number of subbands (section 5.2).
DEVIATION = 0.001
MOST_SUBBANDS = 16

# Where no band is below the threshold: the largest accepted deviation, in units of the least one.
_HARDLY_MORE = 1.1

# Images are analysed at no more than about this many pixels a side: large structures need no more.
_ANALYSED = 512

# CIE Y of linear Rec.709; the authors use Y because shadows and gradients are most prominent in it.
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def low_band(image: Array, kappa: int) -> Array:
    """Return the part of an image (H, W, C) in its first ``kappa`` subbands, float32; zero for 0.

    A subband is a frequency of half a cycle over the longer side, along rows and columns alike.
    """
    if kappa <= 0:
        return np.zeros(image.shape, np.float32)
    height, width = image.shape[:2]
    rows, columns = _kept(height, width, kappa)
    spectrum = fft.dctn(image.astype(np.float64), axes=(0, 1), norm="ortho")
    kept = np.zeros_like(spectrum)
    kept[:rows, :columns] = spectrum[:rows, :columns]
    return np.asarray(fft.idctn(kept, axes=(0, 1), norm="ortho"), np.float32)


def _kept(height: int, width: int, kappa: int) -> tuple[int, int]:
    """Return how many rows and columns of coefficients lie in the first subbands."""
    longest = max(height, width)
    return max(1, round(kappa * height / longest)), max(1, round(kappa * width / longest))


def deviations(image: Array) -> Array:
    """Return the deviation of the high band's autocorrelation for each number of subbands, 0 to `MOST_SUBBANDS`.

    The autocorrelation is DCT^-1(DCT(H)^2), here divided by the root of the number of pixels, so that it is a mean product
    and does not grow with the image; of CIE Y, with the image's range taken as [0, 1].
    """
    luminance = image[:, :, :3].astype(np.float64) @ _LUMINANCE if image.shape[2] >= 3 else image.astype(np.float64).mean(axis=2)
    span = float(np.ptp(luminance))
    if span == 0:
        return np.zeros(MOST_SUBBANDS + 1)
    down, across = (min(n, -(-max(luminance.shape) // _ANALYSED)) for n in luminance.shape)
    if max(down, across) > 1:
        height, width = luminance.shape[0] // down * down, luminance.shape[1] // across * across
        luminance = luminance[:height, :width].reshape(height // down, down, width // across, across).mean(axis=(1, 3))
    height, width = luminance.shape
    # Padded with zeros to a square, as in section 5.2, so that frequencies are the same along both sides.
    side = max(height, width)
    found = []
    for kappa in range(MOST_SUBBANDS + 1):
        high = luminance / span - low_band(luminance[:, :, None] / span, kappa)[:, :, 0]
        padded = np.zeros((side, side))
        padded[:height, :width] = high
        spectrum = fft.dctn(padded, norm="ortho")
        correlation = fft.idctn(spectrum**2, norm="ortho")[:height, :width] / side
        found.append(float(correlation.std()))
    return np.array(found)


def choose_kappa(image: Array) -> int:
    """Return the lowest number of subbands whose high band deviates by less than `DEVIATION`.

    If none does, because the texture itself is strong and regular, the lowest that deviates little more than the best.
    """
    found = deviations(image)
    return int(np.flatnonzero(found < max(DEVIATION, _HARDLY_MORE * float(found.min()) + 1e-12))[0])
