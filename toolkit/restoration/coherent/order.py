"""Filling the coarsest level patch by patch, the most certain and the most structured first (Criminisi et al. 2004)."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.kernels.patch_match import SIDE


class Windows:
    """Patches of a sample, for exhaustive search."""

    def __init__(self, planes: Array, starts: Array) -> None:
        """Take the patches of planes (n, h, w) that begin at ``starts`` (N, 2)."""
        self.starts = starts
        found = sliding_window_view(planes, (SIDE, SIDE), axis=(1, 2))[:, starts[:, 0], starts[:, 1]]
        self._squares = np.ascontiguousarray((found**2).sum(axis=0).reshape(len(starts), -1))
        self._values = np.ascontiguousarray(np.moveaxis(found, 0, 1).reshape(len(starts), -1))

    def nearest(self, patch: Array, known: Array) -> Array:
        """Return the start of the patch nearest to (n, 8, 8) where it is known, (8, 8)."""
        weight = known.reshape(-1).astype(np.float32)
        wanted = (patch * known).reshape(-1)
        distance = self._squares @ weight - 2 * (self._values @ wanted)
        return np.asarray(self.starts[int(distance.argmin())])


def fill_in_order(planes: Array, known: Array, hole: Array, windows: Windows, sample: Array) -> tuple[Array, Array]:
    """Return planes (n, H, W) with the hole filled, and the sample's pixels that it was filled with, (H, W, 2), -1 elsewhere.

    Parameters
    ----------
    planes : (n, H, W) float32 array
    known : (H, W) bool array
        Pixels that are compared.
    hole : (H, W) bool array
        Pixels that are filled.
    windows : Windows
        Patches of ``sample``.
    sample : (n, h, w) float32 array

    References
    ----------
    Criminisi, Pérez & Toyama, "Region Filling and Object Removal by Exemplar-Based Image Inpainting", IEEE TIP 13, 2004: here
    the strongest gradient near a pixel of the front stands for the isophote that meets it.
    """
    values, known, left = planes.copy(), known.copy(), hole.copy()
    certain = known.astype(np.float64)
    source = np.full((*hole.shape, 2), -1, np.int32)
    half = SIDE // 2
    while left.any():
        front = np.argwhere(left & ndimage.binary_dilation(known, np.ones((3, 3))))
        if not len(front):
            break
        confidence = ndimage.uniform_filter(np.where(known, certain, 0.0), SIDE + 1, mode="constant")
        structure = ndimage.maximum_filter(_gradient(values, known), SIDE - 1)
        at = tuple(front.T)
        # Where nothing has structure, the most certain is next.
        y, x = front[int((confidence[at] * (structure[at] + 1e-3)).argmax())]
        top, side = (int(np.clip(c - half, 0, size - SIDE)) for c, size in zip((y, x), hole.shape, strict=True))
        box = (slice(top, top + SIDE), slice(side, side + SIDE))
        row, column = windows.nearest(values[:, box[0], box[1]], known[box])
        filled = left[box]
        there = sample[:, row : row + SIDE, column : column + SIDE]
        values[:, box[0], box[1]] = np.where(filled, there, values[:, box[0], box[1]])
        source[box][filled] = (np.moveaxis(np.indices((SIDE, SIDE)), 0, 2) + (row, column))[filled]
        certain[box] = np.where(filled, confidence[y, x], certain[box])
        known[box] |= filled
        left[box] = False
    return values, source


def _gradient(values: Array, known: Array) -> Array:
    """Return the length of the gradient of the planes' mean, 0 where its neighbours are not known."""
    weight = ndimage.gaussian_filter(known.astype(np.float64), 1.0)
    smooth = ndimage.gaussian_filter(np.where(known, values.mean(axis=0), 0).astype(np.float64), 1.0)
    down, right = np.gradient(smooth / np.maximum(weight, 1e-6))
    return np.asarray(np.where(ndimage.binary_erosion(known), np.hypot(down, right), 0))
