"""Texture optimisation: windows are matched to the sample, pixels take the vote of the windows over them, and again.

Windows go from large to small; large ones are compared at lower resolution. The last pass of each size copies: every pixel
takes the value of one place of the sample, so that provenance holds and nothing is blurred.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array, Progress
from intaglio.kernels.blocks import box_sums
from intaglio.synthesis.nearest import NearestWindows, rms_difference
from intaglio.synthesis.result import pixel_positions
from intaglio.synthesis.sample import SampleMaps, window_starts

# Sides of windows in pixels.
SIDES = (32, 16, 8)

# Values of a window's side that are compared: larger windows at lower resolution.
_SIDE = 8

# Windows are this share of their side apart, so that 16 cover every pixel.
_PER_SIDE = 4

# The most windows of the sample that are compared with, by default.
_MOST_WINDOWS = 40_000

# Windows of the canvas matched at a time, to bound memory.
_AT_ONCE = 16_384

# Least distance in the weight of a window's vote, 1 / distance^1.2 (Kwatra et al. 2005, r = 0.8), in units of the range.
_LEAST = 0.005


@dataclass(frozen=True)
class _Windows:
    """Windows of one size.

    Attributes
    ----------
    side : int
        In pixels, a multiple of `_SIDE`.
    whole : (H, W) bool array
        Where a window may begin in the sample.
    means : (n, H, W) array
        The sample's means over the boxes that are compared.
    corner : (M, 2) array
        First pixels of the windows that are searched.
    nearest : NearestWindows
    """

    side: int
    whole: Array
    means: Array
    corner: Array
    nearest: NearestWindows


def optimize_texture(
    sample: SampleMaps,
    source: Array,
    *,
    block: int,
    passes: int,
    tileable: bool,
    keep: Array | None = None,
    most: int = _MOST_WINDOWS,
    relative: bool = False,
    progress: Progress | None = None,
) -> tuple[Array, list[int]]:
    """Return provenance (H, W, 2) in which visible seams of ``source`` are gone, and the sides of the windows used.

    Parameters
    ----------
    sample : SampleMaps
    source : (H, W, 2) int array
        Row and column in the sample of each pixel.
    block : int
        Size of the texture's elements in pixels: much larger windows find nothing like them, and blur.
    passes : int
        Per size of window.
    tileable : bool
        Windows wrap around.
    keep : (H, W) bool array, optional
        Pixels that stay what they are; windows over them are matched like all others.
    most : int
        Windows of the sample compared with; of more so many, evenly spread.
    relative : bool
        Compare relative to the windows' contrast, for maps of mean zero; see `NearestWindows`.
    progress : callable, optional
        Called with passes done and all passes.

    References
    ----------
    Kwatra et al., Texture optimization for example-based synthesis (2005); Han et al., Fast example-based surface texture
    synthesis via discrete optimization (2006).
    """
    largest = min(max(SIDES[-1], 1.25 * block), *source.shape[:2], *sample.usable.shape)
    sizes = [_sample_windows(sample, side, most, relative) for side in SIDES if side <= largest]
    found = [windows for windows in sizes if windows is not None]
    source = source.astype(np.int64)
    for place, windows in enumerate(found):
        values = _read(sample.features, source)
        for number in range(passes):
            before = source
            source, values = _pass(sample.features, windows, source, values, tileable, copy=number == passes - 1)
            if keep is not None:
                source = np.where(keep[:, :, None], before, source)
                values = np.where(keep, _read(sample.features, source), values)
            if progress is not None:
                progress(place * passes + number + 1, passes * len(found))
    if progress is not None and not found:
        progress(1, 1)
    return source.astype(np.int32), [windows.side for windows in found]


def _read(features: Array, source: Array) -> Array:
    """Return the compared values (n, H, W) at ``source``."""
    return features[:, source[..., 0], source[..., 1]]


def _sample_windows(sample: SampleMaps, side: int, most: int, relative: bool) -> _Windows | None:
    """Return the sample's windows of ``side`` pixels; None if it has none."""
    whole = window_starts(sample.usable, side)
    corner = np.argwhere(whole)
    if len(corner) == 0:
        return None
    if len(corner) > most:
        corner = corner[np.linspace(0, len(corner) - 1, most).astype(int)]
    means = _box_means(sample.features, side)
    return _Windows(side, whole, means, corner, NearestWindows(_descriptors(means, corner, side), relative=relative))


def _box_means(planes: Array, side: int) -> Array:
    """Return means over the boxes in which windows of ``side`` pixels are compared, from each pixel on."""
    box = side // _SIDE
    return box_sums(planes, box) / np.float32(box * box) if box > 1 else planes


def _descriptors(means: Array, corner: Array, side: int) -> Array:
    """Return what is compared of the windows at ``corner``: (M, 64 n), of `_box_means`."""
    at = np.arange(_SIDE) * (side // _SIDE)
    y = corner[:, 0, None, None] + at[None, :, None]
    x = corner[:, 1, None, None] + at[None, None, :]
    return np.ascontiguousarray(np.moveaxis(means[:, y, x], 0, 1).reshape(len(corner), len(means) * _SIDE * _SIDE))


def _pass(features: Array, windows: _Windows, source: Array, values: Array, tileable: bool, *, copy: bool) -> tuple[Array, Array]:
    """Match and vote once; return provenance, and the values (n, H, W) that the next pass matches."""
    side, step = windows.side, windows.side // _PER_SIDE
    height, width = source.shape[:2]
    corner = _find_broken_windows(source, side, step, tileable)
    if len(corner) == 0:
        return source, values
    around = np.pad(values, ((0, 0), (0, side), (0, side)), mode="wrap") if tileable else values
    match, distance = _match_windows(windows, source, corner, _box_means(around, side))
    weight = (distance + _LEAST) ** -1.2

    # Windows whose corners fall on one of 16 cells of the grid don't overlap (but for a few where a torus closes, where the
    # last one counts): a layer of proposals for the whole canvas.
    layer = (corner[:, 0] // step % _PER_SIDE) * _PER_SIDE + corner[:, 1] // step % _PER_SIDE
    falloff = np.hanning(side + 2)[1:-1]
    falloff = (falloff[:, None] * falloff[None, :]).astype(np.float32)
    strongest = float(_LEAST**-1.2)
    total = values * 0
    weights = np.zeros((height, width), np.float32)
    for number in range(_PER_SIDE**2):
        proposal, strength = _propose_copies(
            corner[layer == number], match[layer == number], weight[layer == number], source, side, falloff, strongest
        )
        total += strength * _read(features, proposal)
        weights += strength
    voted = total / weights
    if not copy:
        return source, voted
    best = np.full((height, width), np.inf, np.float32)
    chosen = source.copy()
    for number in range(_PER_SIDE**2):
        proposal, _ = _propose_copies(
            corner[layer == number], match[layer == number], weight[layer == number], source, side, falloff, strongest
        )
        away = ((_read(features, proposal) - voted) ** 2).sum(axis=0)
        # Pixels of large windows that are nearest to the vote one by one would be a mosaic without contrast.
        away = ndimage.uniform_filter(away, side // 4 + 1, mode="wrap" if tileable else "nearest")
        nearer = away < best
        best[nearer] = away[nearer]
        chosen[nearer] = proposal[nearer]
    return chosen, _read(features, chosen)


def _match_windows(windows: _Windows, source: Array, corner: Array, means: Array) -> tuple[Array, Array]:
    """Return the sample's window nearest to each of the canvas' windows at ``corner`` (M, 2), and its distance (M,).

    Besides the nearest of those that are searched, the windows that continue what was copied to the middle of a window or to
    the middles of its quarters are candidates. ``means``: the canvas', from `_box_means`.
    """
    side = windows.side
    match = np.zeros_like(corner)
    distance = np.zeros(len(corner), np.float32)
    rows, columns = source.shape[:2]
    for first in range(0, len(corner), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        query = _descriptors(means, corner[part], side)
        best = windows.corner[windows.nearest.find(query)]
        least = rms_difference(_descriptors(windows.means, best, side), query)
        for down, right in ((2, 2), (1, 1), (1, 3), (3, 1), (3, 3)):
            step = np.array([down * side // 4, right * side // 4])
            at = (corner[part] + step) % (rows, columns)
            continued = source[at[:, 0], at[:, 1]] - step
            inside = ((continued >= 0) & (continued < windows.whole.shape)).all(axis=1)
            inside[inside] = windows.whole[tuple(continued[inside].T)]
            there = np.flatnonzero(inside)
            away = rms_difference(_descriptors(windows.means, continued[there], side), query[there])
            nearer = there[away < least[there]]
            least[nearer] = away[away < least[there]]
            best[nearer] = continued[nearer]
        match[part], distance[part] = best, least
    return match, distance


def _find_broken_windows(source: Array, side: int, step: int, tileable: bool) -> Array:
    """Return first pixels (M, 2) of the grid's windows that are not copies of one piece of the sample.

    All others match themselves.
    """
    height, width = source.shape[:2]
    wide = np.pad(source, ((0, side), (0, side), (0, 0)), mode="wrap") if tileable else source
    offset = wide - pixel_positions(wide.shape)
    breaks = np.zeros(wide.shape[:2], np.int64)
    breaks[:, 1:] |= (np.diff(offset, axis=1) != 0).any(axis=2)
    below = np.zeros(wide.shape[:2], np.int64)
    below[1:] |= (np.diff(offset, axis=0) != 0).any(axis=2)
    ys, xs = (np.arange(0, n if tileable else n - side + 1, step) for n in (height, width))

    def counted(mask: Array, top: int, left: int) -> Array:
        # Breaks between pixels of a window: the first row or column of it does not count.
        summed = np.pad(np.cumsum(np.cumsum(mask, axis=0), axis=1), ((1, 0), (1, 0)))
        a, b, c, d = ys + top, ys + side, xs + left, xs + side
        return np.asarray(summed[np.ix_(b, d)] - summed[np.ix_(a, d)] - summed[np.ix_(b, c)] + summed[np.ix_(a, c)])

    broken = counted(breaks, 0, 1) + counted(below, 1, 0) > 0
    return np.stack([ys[np.nonzero(broken)[0]], xs[np.nonzero(broken)[1]]], axis=1)


def _propose_copies(
    corner: Array, match: Array, weight: Array, source: Array, side: int, falloff: Array, strongest: float
) -> tuple[Array, Array]:
    """Return one layer: where each pixel would be copied from, (H, W, 2), and the weight of that, (H, W).

    Where the layer has no broken window, pixels stay as they are, with the weight of a perfect match.
    """
    height, width = source.shape[:2]
    proposal = source.copy()
    strength = np.full((height, width), strongest * float(falloff.mean()), np.float32)
    at = np.arange(side)
    y = ((corner[:, 0, None] + at) % height)[:, :, None]
    x = ((corner[:, 1, None] + at) % width)[:, None, :]
    proposal[y, x, 0] = (match[:, 0, None] + at)[:, :, None]
    proposal[y, x, 1] = (match[:, 1, None] + at)[:, None, :]
    strength[y, x] = weight[:, None, None] * falloff
    return proposal, strength
