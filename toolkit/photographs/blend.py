"""Multiresolution spline over masks (Burt & Adelson 1983), layer by layer, each defined on part of the texture only."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.pyramids import add_band, collapsed, expanded, normalized, reduced, uploaded

Array = np.ndarray

# The coarsest level has no side shorter than this.
_LEAST_SIDE = 8


class SplineBlend:
    """Adds up layers: at every level of their Laplacian pyramids, weighted by the Gaussian pyramids of their masks.

    Pyramids are normalised by where a layer is defined, so that nothing beyond a layer's or a chart's border mixes in.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns.
    device : str
    """

    def __init__(self, shape: tuple[int, int], device: str) -> None:
        self._device = device
        self._shapes = [shape]
        while min(self._shapes[-1]) >= 2 * _LEAST_SIDE:
            height, width = self._shapes[-1]
            self._shapes.append(((height + 1) // 2, (width + 1) // 2))
        self._sums = [wp.zeros(s, dtype=wp.vec4, device=device) for s in self._shapes]

    def add(self, color: Array, defined: Array, mask: Array) -> None:
        """Add a layer: colour (H, W, 3), where it is ``defined`` (H, W) bool, and the weight it has there, (H, W).

        The mask should end within what is defined, so that there is colour on both sides of its border.
        """
        inside = defined.astype(np.float32)[:, :, None]
        level = uploaded(np.concatenate([color * inside, inside], axis=2), self._device)
        share = self._softened((mask * defined).astype(np.float32))
        for number, total in enumerate(self._sums):
            here = normalized(level, self._device)
            if number + 1 < len(self._sums):
                level = reduced(level, self._device)
                below = expanded(normalized(level, self._device), self._shapes[number], self._device)
                add_band(here, below, share, total, self._device)
                share = reduced(share, self._device)
            else:
                add_band(here, None, share, total, self._device)

    def _softened(self, mask: Array) -> wp.array:
        """Return a mask whose step at a border is a slope some texels long, since the finest band has a step of its own."""
        full = np.ones((*mask.shape, 4), np.float32)
        full[:, :, :3] = mask[:, :, None]
        below = normalized(reduced(uploaded(full, self._device), self._device), self._device)
        return expanded(below, self._shapes[0], self._device)

    def result(self) -> Array:
        """Return the blend, (H, W, 3); zero where no layer had any weight."""
        image = normalized(self._sums[-1], self._device)
        for number in range(len(self._sums) - 2, -1, -1):
            image = collapsed(self._sums[number], expanded(image, self._shapes[number], self._device), self._device)
        return np.maximum(image.numpy()[:, :, :3], 0)


def extended(color: Array, defined: Array, device: str) -> Array:
    """Return colour (H, W, 3) that is as it was where ``defined``, and elsewhere continues smoothly from there."""
    if defined.all() or not defined.any():
        return color
    inside = defined.astype(np.float32)[:, :, None]
    levels = [uploaded(np.concatenate([color * inside, inside], axis=2), device)]
    while min(levels[-1].shape) > 1:
        levels.append(reduced(levels[-1], device))
    image = normalized(levels[-1], device)
    for level in levels[-2::-1]:
        here = normalized(level, device).numpy()
        below = expanded(image, level.shape, device).numpy()
        image = uploaded(np.where(here[:, :, 3:] > 0, here, below), device)
    filled = image.numpy()[:, :, :3]
    return np.where(defined[:, :, None], color, filled).astype(np.float32)
