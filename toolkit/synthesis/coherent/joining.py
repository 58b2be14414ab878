"""Joining pieces by their differences: a screened Poisson equation over the steps between neighbouring pixels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import fft, ndimage

from intaglio.arrays import Array


def join_pieces(copied: Array, plane: Array, usable: Array, source: Array, *, reach: float, smooth: float, wrap: bool) -> Array:
    """Return a map over whose borders between pieces no step remains but the sample's own.

    Minimises sum (u_q - u_p - g_pq)^2 + sum (u - copied)^2 / reach^2 over all neighbours p, q. g is the copied step inside a
    piece; across a border it is the mean of the steps that both places have in the sample.

    Parameters
    ----------
    copied : (H, W) float array
        ``plane`` at ``source``.
    plane : (h, w) float array
        The sample's map.
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
    right = np.zeros(copied.shape)
    for axis in (0, 1):
        missing, border = _missing_steps(copied, plane, usable, source, axis, wrap)
        if smooth > 0:
            mode = "wrap" if wrap else "constant"
            near = ndimage.gaussian_filter(border.astype(np.float64), smooth, mode=mode)
            mean = ndimage.gaussian_filter(missing, smooth, mode=mode)
            missing = np.divide(mean, near, out=np.zeros_like(mean), where=border)
        right -= missing
        right += np.roll(missing, 1, axis)
    waves = [2 - 2 * np.cos(np.arange(n) * (2 * np.pi if wrap else np.pi) / n) for n in copied.shape]
    divisor = waves[0][:, None] + waves[1][None, :] + 1 / reach**2
    forward, back = _transforms(wrap)
    return copied + np.real(back(forward(right) / divisor))


def _transforms(wrap: bool) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    if wrap:
        return fft.fft2, fft.ifft2
    return (lambda a: fft.dctn(a, norm="ortho")), (lambda a: fft.idctn(a, norm="ortho"))


def _missing_steps(copied: Array, plane: Array, usable: Array, source: Array, axis: int, wrap: bool) -> tuple[Array, Array]:
    """Return (H, W): what the step from each pixel to the next along ``axis`` lacks, and which steps cross a border.

    Inside pieces and beyond the edge nothing is lacking.
    """
    step = np.array([1, 0]) if axis == 0 else np.array([0, 1])
    following = np.roll(source, -1, axis)
    border: Array = np.any(following - source != step, axis=2)
    if not wrap:
        border[(slice(-1, None), slice(None)) if axis == 0 else (slice(None), slice(-1, None))] = False
    here, there = source[border], following[border]
    one, first = _read(plane, usable, here + step)
    other, second = _read(plane, usable, there - step)
    p, q = plane[here[:, 0], here[:, 1]], plane[there[:, 0], there[:, 1]]
    # A place at the sample's edge has no step of its own; where neither has, none is the likeliest.
    total = np.where(first, one - p, 0) + np.where(second, q - other, 0)
    wanted = total / np.maximum(first.astype(int) + second, 1)
    result = np.zeros(copied.shape)
    result[border] = wanted - (q - p)
    return result, border


def _read(plane: Array, usable: Array, place: Array) -> tuple[Array, Array]:
    """Return values at places (M, 2), and whether the sample has them."""
    inside: Array = np.all((place >= 0) & (place < np.array(usable.shape)), axis=1)
    safe = np.where(inside[:, None], place, 0)
    return plane[safe[:, 0], safe[:, 1]], inside & usable[safe[:, 0], safe[:, 1]]
