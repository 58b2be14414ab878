"""Joining pieces by their differences: a screened Poisson equation over the steps between neighbouring pixels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from intaglio.arrays import Array


@dataclass(frozen=True)
class _Borders:
    """Steps along one axis that cross a border between pieces.

    Attributes
    ----------
    crossed : (H, W) bool array
        Whether the step from a pixel to the next crosses one.
    places : four (M, 2) int arrays
        In the sample, of each: the pixel, what follows it there; the next one, what precedes it there.
    known : two (M,) bool arrays
        Whether the sample has what follows, and what precedes.
    """

    crossed: Array
    places: tuple[Array, Array, Array, Array]
    known: tuple[Array, Array]


def join_pieces(
    planes: Iterable[Array], usable: Array, source: Array, *, reach: float, smooth: float, wrap: bool
) -> Iterator[Array]:
    """Yield, map by map, what to add to copies so that over borders between pieces no step remains but the sample's own.

    With u the copies and what is added, it minimises sum (u_q - u_p - g_pq)^2 + sum (u - copied)^2 / reach^2 over all neighbours
    p, q. g is the copied step inside a piece; across a border it is the mean of the steps that both places have in the sample.

    Parameters
    ----------
    planes : iterable of (h, w) float arrays
        The sample's maps.
    usable : (h, w) bool array
    source : (H, W, 2) int array
    reach : float
        How far from a border values are moved, in pixels: a step decays as exp(-distance / reach).
    smooth : float
        Standard deviation in pixels of the Gaussian over which steps along borders are averaged before they are taken out, so
        that single pixels of a noisy texture keep theirs. 0: every pixel's step is taken out.
    wrap : bool
        The result is a torus.
    """
    shape = (source.shape[0], source.shape[1])
    mode = "wrap" if wrap else "constant"
    borders = [_find_borders(usable, source, axis, wrap) for axis in (0, 1)]
    # The share of a Gaussian's weight that lies on borders.
    near = [
        ndimage.gaussian_filter(b.crossed.astype(np.float32), smooth, mode=mode)[b.crossed] if smooth > 0 else None
        for b in borders
    ]
    waves = [2 - 2 * np.cos(np.arange(n) * (2 * np.pi if wrap else np.pi) / n) for n in shape]
    divisor = (waves[0][:, None] + (waves[1][: shape[1] // 2 + 1] if wrap else waves[1])[None, :] + 1 / reach**2).astype(
        np.float32
    )
    forward, back = _transforms(shape, wrap)
    for plane in planes:
        # What is moved is small beside the values: single precision does.
        right = np.zeros(shape, np.float32)
        for axis, (border, weight) in enumerate(zip(borders, near, strict=True)):
            missing = np.zeros(shape, np.float32)
            missing[border.crossed] = _missing_steps(plane, border)
            if weight is not None:
                mean = ndimage.gaussian_filter(missing, smooth, mode=mode)
                missing[border.crossed] = mean[border.crossed] / weight
            right -= missing
            right += np.roll(missing, 1, axis)
        yield back(forward(right) / divisor)


def _transforms(shape: tuple[int, int], wrap: bool) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    if wrap:
        return (lambda a: fft.rfft2(a, workers=-1)), (lambda a: fft.irfft2(a, s=shape, workers=-1))
    return (lambda a: fft.dctn(a, norm="ortho", workers=-1)), (lambda a: fft.idctn(a, norm="ortho", workers=-1))


def _find_borders(usable: Array, source: Array, axis: int, wrap: bool) -> _Borders:
    """Return the borders that steps along an axis cross; beyond the edge there are none."""
    step = np.array([1, 0], source.dtype) if axis == 0 else np.array([0, 1], source.dtype)
    following = np.roll(source, -1, axis)
    crossed: Array = np.any(following - source != step, axis=2)
    if not wrap:
        crossed[(slice(-1, None), slice(None)) if axis == 0 else (slice(None), slice(-1, None))] = False
    here, there = source[crossed], following[crossed]
    after, first = _inside(usable, here + step)
    before, second = _inside(usable, there - step)
    return _Borders(crossed, (here, after, there, before), (first, second))


def _missing_steps(plane: Array, border: _Borders) -> Array:
    """Return (M,): what each step over a border lacks to be the sample's."""
    p, one, q, other = (plane[place[:, 0], place[:, 1]] for place in border.places)
    first, second = border.known
    # A place at the sample's edge has no step of its own; where neither has, none is the likeliest.
    total = np.where(first, one - p, 0) + np.where(second, q - other, 0)
    return np.asarray(total / np.maximum(first.astype(int) + second, 1) - (q - p))


def _inside(usable: Array, place: Array) -> tuple[Array, Array]:
    """Return places (M, 2), those that the sample hasn't moved to its first pixel, and whether it has them."""
    inside: Array = np.all((place >= 0) & (place < np.array(usable.shape)), axis=1)
    safe = np.where(inside[:, None], place, 0)
    return safe, inside & usable[safe[:, 0], safe[:, 1]]
