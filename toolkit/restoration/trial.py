"""Which of two ways fills thin damage better, by trial: on damage of the same shape laid where the image is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array

# The trial's damage is the image's own, moved so far in each of eight directions; of it a square of so many pixels a side, where
# most of it lies; with fewer pixels nothing is told.
_MOVES, _SIDE, _LEAST = (16, 27, 40), 160, 150

# The second must do so much better in squared errors: single places scatter.
_CLEARLY = 1.5

Filler = Callable[[Array, Array, Array], Array]


def first_is_better(image: Array, missing: Array, thin: Array, chart: Array, first: Filler, second: Filler) -> bool:
    """Return whether ``first`` is to fill damage: unless ``second`` fills it clearly nearer to the truth.

    Parameters
    ----------
    image : (H, W, C) array
    missing, thin : (H, W) bool arrays
        All damage, and that whose shape is tried.
    chart : (H, W) int array
    first, second : callable
        Called with image, missing and chart of a part; return the filled part.
    """
    known = (chart > 0) & ~missing
    best: tuple[int, Array] = 0, thin
    for move in _MOVES:
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1), (0, -1), (-1, 0), (-1, -1), (-1, 1)):
            moved = np.zeros_like(thin)
            rows, columns = (_overlap(move * step, size) for step, size in zip((down, right), thin.shape, strict=True))
            moved[rows[0], columns[0]] = thin[rows[1], columns[1]]
            moved &= known
            count = int(moved.sum())
            if count > best[0]:
                best = count, moved
    count, trial = best
    if count < _LEAST:
        return True
    density = ndimage.uniform_filter(trial.astype(np.float32), _SIDE, mode="constant")
    y, x = np.unravel_index(int(density.argmax()), density.shape)
    part = tuple(slice(max(0, at - _SIDE // 2), at + _SIDE // 2) for at in (int(y), int(x)))
    trial, gone = trial[part], missing[part]
    if trial.sum() < _LEAST or not (known[part] & ~trial).any():
        return True
    truth = image[part]
    off = [float(((way(truth, gone | trial, chart[part]) - truth)[trial] ** 2).mean()) for way in (first, second)]
    return off[0] <= _CLEARLY * off[1]


def _overlap(move: int, size: int) -> tuple[slice, slice]:
    """Return where moved pixels come to lie along an axis, and where they are from."""
    to = slice(max(move, 0), max(size + min(move, 0), 0))
    return to, slice(max(-move, 0), max(size - max(move, 0), 0))
