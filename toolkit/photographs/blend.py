"""Multiresolution spline over masks (Burt & Adelson 1983), layer by layer, each defined on part of the texture only."""

from __future__ import annotations

import numpy as np
import warp as wp
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.kernels.pyramids import add_band, collapse_level, expand_level, normalize_level, reduce_level, upload_image

# The least side of the coarsest level.
_LEAST_SIDE = 8


# Level from which on a layer's broad weight counts: structures of 2^3 texels and more.
_BROAD = 3


class ChartBlend:
    """The spline for each chart by itself, since neighbours in the texture need not be neighbours on the surface.

    Many small charts are blended together, over so few levels that they hardly reach each other.

    Parameters
    ----------
    chart : (H, W) int array
        Number of the chart of each texel, from 1; 0 outside.
    device : str
    """

    def __init__(self, chart: Array, device: str) -> None:
        self._chart = chart
        frames = [(n + 1, f) for n, f in enumerate(ndimage.find_objects(chart)) if f is not None]
        small = [n for n, f in frames if max(_shape(f)) < _SMALL]
        together = np.isin(chart, small) if len(small) > _FEW else np.zeros(chart.shape, bool)
        self._parts = [
            (f, chart[f] == n, SplineBlend(_shape(f), device))
            for n, f in frames
            if len(small) <= _FEW or max(_shape(f)) >= _SMALL
        ]
        if together.any():
            everything = (slice(0, chart.shape[0]), slice(0, chart.shape[1]))
            self._parts.append((everything, together, SplineBlend(chart.shape, device, _SMALL_LEVELS)))

    def add(self, color: Array, defined: Array, mask: Array, broad: Array | None = None) -> None:
        """Add a layer to every chart on which it has any weight; see `SplineBlend.add`."""
        for frame, own, spline in self._parts:
            here = defined[frame] & own
            wide = None if broad is None else broad[frame] * own
            narrow = mask[frame] * own
            if narrow.any() or (wide is not None and wide.any()):
                spline.add(color[frame], here, narrow, wide)

    def result(self) -> Array:
        """Return the blend, (H, W, 3); zero where no layer had any weight, and outside."""
        image = np.zeros((*self._chart.shape, 3), np.float32)
        for frame, own, spline in self._parts:
            image[frame][own] = spline.result()[own]
        return image


def _shape(frame: tuple[slice, ...]) -> tuple[int, int]:
    return frame[0].stop - frame[0].start, frame[1].stop - frame[1].start


# Charts with no longer side than this, in texels, are small; more than a few of them are blended together, with so many levels.
_SMALL, _FEW, _SMALL_LEVELS = 96, 16, 3


class SplineBlend:
    """Adds up layers: at every level of their Laplacian pyramids, weighted by the Gaussian pyramids of their masks.

    Pyramids are normalised by where a layer is defined, so that what lies beyond its border does not mix in.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns.
    device : str
    most : int, optional
        Levels, at most.
    """

    def __init__(self, shape: tuple[int, int], device: str, most: int | None = None) -> None:
        self._device = device
        self._shapes = [shape]
        while min(self._shapes[-1]) >= 2 * _LEAST_SIDE and (most is None or len(self._shapes) < most):
            height, width = self._shapes[-1]
            self._shapes.append(((height + 1) // 2, (width + 1) // 2))
        self._sums = [wp.zeros(s, dtype=wp.vec4, device=device) for s in self._shapes]

    def add(self, color: Array, defined: Array, mask: Array, broad: Array | None = None) -> None:
        """Add a layer: colour (H, W, 3), where it is ``defined`` (H, W) bool, and the weight it has there, (H, W).

        The mask should end within what is defined, so that there is colour on both sides of its border. ``broad`` weighs the
        bands of structures from `_BROAD` levels on instead.
        """
        inside = defined.astype(np.float32)[:, :, None]
        level = upload_image(np.concatenate([color * inside, inside], axis=2), self._device)
        share = self._soften((mask * defined).astype(np.float32))
        wide = share if broad is None else self._soften((broad * defined).astype(np.float32))
        for number, total in enumerate(self._sums):
            here = normalize_level(level, self._device)
            if number == _BROAD:
                share = share if broad is None else wide
            if number + 1 < len(self._sums):
                level = reduce_level(level, self._device)
                below = expand_level(normalize_level(level, self._device), self._shapes[number], self._device)
                add_band(here, below, share, total, self._device)
                share = reduce_level(share, self._device)
                if broad is not None and number < _BROAD:
                    wide = reduce_level(wide, self._device)
            else:
                add_band(here, None, share, total, self._device)

    def _soften(self, mask: Array) -> wp.array:
        """Return a mask whose step at a border is a slope some texels long, since the finest band has a step of its own."""
        full = np.ones((*mask.shape, 4), np.float32)
        full[:, :, :3] = mask[:, :, None]
        below = normalize_level(reduce_level(upload_image(full, self._device), self._device), self._device)
        return expand_level(below, self._shapes[0], self._device)

    def result(self) -> Array:
        """Return the blend, (H, W, 3); zero where no layer had any weight."""
        image = normalize_level(self._sums[-1], self._device)
        for number in range(len(self._sums) - 2, -1, -1):
            image = collapse_level(self._sums[number], expand_level(image, self._shapes[number], self._device), self._device)
        return np.maximum(image.numpy()[:, :, :3], 0)
