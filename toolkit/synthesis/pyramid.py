"""Gaussian pyramids of samples with pixels that may not be used, and the sizes of their levels."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array

# Burt & Adelson's generating kernel, a = 0.4.
_KERNEL = np.array([0.05, 0.25, 0.4, 0.25, 0.05])

# A coarse pixel counts as known if known pixels hold this share of its weight.
_SHARE = 0.5


def halve_planes(planes: Array, known: Array) -> tuple[Array, Array]:
    """Return the next coarser level: planes (n, ceil(H/2), ceil(W/2)) float32, and which of its pixels are known.

    Pixels that are not known have no weight in their neighbours' means.
    """
    weight = smooth_plane(known.astype(np.float64))
    smooth = np.stack([smooth_plane(np.where(known, p, 0).astype(np.float64)) for p in planes])
    mean = np.divide(smooth, weight, out=np.zeros_like(smooth), where=weight > 0)
    return mean[:, ::2, ::2].astype(np.float32), weight[::2, ::2] >= _SHARE


def smooth_plane(plane: Array) -> Array:
    """Return a plane convolved with the generating kernel; its border values continue beyond it."""
    rows = ndimage.correlate1d(plane, _KERNEL, axis=0, mode="nearest")
    smooth: Array = ndimage.correlate1d(rows, _KERNEL, axis=1, mode="nearest")
    return smooth


def level_shape(shape: tuple[int, int], level: int) -> tuple[int, int]:
    """Return the size of a level of a pyramid over ``shape``."""
    return -(-shape[0] // 2**level), -(-shape[1] // 2**level)
