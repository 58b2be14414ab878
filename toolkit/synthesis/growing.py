"""Multiresolution pixel synthesis in R^n (Wei & Levoy 2000; Dong, section 5.3.1), also inside a mask."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_choice, checked_count, checked_number
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.launch import single_threaded_blas
from intaglio.kernels.windows import Level, WindowSearch, neighbourhoods
from intaglio.photometric import Relightable
from intaglio.randomness import Stream, checked_seed, uniform
from intaglio.synthesis.pyramid import halved, level_shape
from intaglio.synthesis.result import Synthesis, copied, places
from intaglio.synthesis.sample import METRICS, SampleMaps, checked_mask, checked_size, prepare, stacked, window_starts

# What random numbers are for.

# Values of all neighbourhoods together; of larger samples so many neighbourhoods are taken, evenly spread.
_MOST_VALUES = 300_000_000

# Principal components by which neighbourhoods are put next to similar ones.
_COMPONENTS = 12


def grow(
    maps: Any,
    size: int | tuple[int, int] | None = None,
    *,
    missing: Array | None = None,
    window: int = 5,
    levels: int | None = None,
    exhaustive: float = 1.0,
    metric: str = "absolute",
    tileable: bool = False,
    mask: Array | None = None,
    match: Any = None,
    weights: Sequence[float] | Array | None = None,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> Synthesis:
    """Synthesise a texture pixel by pixel, from coarse to fine, or fill the missing part of one.

    Each pixel copies the sample's pixel whose neighbourhood looks most like what is there already: a window of its own
    level, and 3 x 3 pixels of the coarser one. The search gives exactly what a comparison with all of them would.

    Parameters
    ----------
    maps : (H, W) or (H, W, n) array, Relightable, or sequence of arrays of one size
        The sample; with ``missing``, the texture to fill, whose other pixels are the sample.
    size : int or (int, int)
        Rows and columns of the result. Not with ``missing``: the result has the size of the maps then.
    missing : (H, W) bool array, optional
        Pixels to fill, from the known ones inwards; all others stay as they are, to the bit.
    window : int
        Side of the neighbourhood on the pixel's own level, odd, 3 to 15.
    levels : int, optional
        Of the pyramid, 1 to 12. Default: as many as leave the coarsest sample at least 4 windows on a side and a window of
        usable pixels, at most 4.
    exhaustive : float
        Share of pixels that are searched for in any case, 0 to 1; for the others the pixel next to their left neighbour's
        source is taken where there is one (section 5.3.1: 0.4 to 0.7 give good results). Not with ``missing``.
    metric : {"absolute", "squared"}
        Of differences.
    tileable : bool
        Neighbourhoods wrap around, so that the result does as far as they can see; `quilt` closes better.
    mask : (H, W) bool array, optional
        Pixels of the sample that may be used.
    match, weights : optional
        What to compare in place of ``maps``, and the weight of each compared map, as for `quilt`.
    seed : int
        The same seed gives the same bits.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``; default CUDA if there is one.
    progress : callable, optional
        Called with pixels done and all pixels, of all levels.

    Returns
    -------
    Synthesis
        ``.maps`` (H, W, n), ``.source`` (H, W, 2): row and column in the sample; ``.texture`` if the sample was relightable.

    Raises
    ------
    InputError
        For a sample without a whole window, values that are not finite, and other arguments out of range.

    References
    ----------
    Dong, Three-dimensional Surface Texture Synthesis (2003), section 5.3.1, table 5.3.1. Wei and Levoy, Fast texture
    synthesis using tree-structured vector quantization (2000). Yamauchi et al., Textures revisited (2005), section 5: the
    shrinking order.
    """
    checked_choice("metric", metric, METRICS)
    window = checked_count("window", window, 3, 15)
    if window % 2 == 0:
        raise InputError(f"window must be odd, not {window}")
    exhaustive = checked_number("exhaustive", exhaustive, 0, 1)
    if missing is not None and exhaustive != 1:
        raise InputError("exhaustive is for new textures; leave it out with missing")
    if levels is not None:
        levels = checked_count("levels", levels, 1, 12)
    seed = checked_seed(seed)
    chosen = device_or_error(device)
    if (size is None) == (missing is None):
        raise InputError("give either size, to synthesise a new texture, or missing, to fill this one")
    hole = None
    if missing is not None:
        hole = checked_mask("missing", missing, stacked(maps).shape[:2])
        if tileable:
            raise InputError("tileable is for new textures; leave it out with missing")
    sample = _prepared(maps, hole, mask, match, weights)
    shape = sample.usable.shape if size is None else checked_size(size)
    if hole is not None and not hole.any():
        kept = maps.mask if isinstance(maps, Relightable) else None
        return copied(maps, sample.maps, places(shape), tileable=False, notes=("nothing is missing",), mask=kept)

    pyramid = _pyramid(sample, hole, shape, window, levels)
    wanted = [hole if hole is not None and n == 0 else level.canvas < 0 for n, (level, _) in enumerate(pyramid)]
    total = sum(int(w.sum()) for w in wanted)
    done = 0
    coarse: Level | None = None
    notes = [f"{len(pyramid)} levels, window {window} x {window}"]
    for number in range(len(pyramid) - 1, -1, -1):
        level, usable = pyramid[number]
        candidates = _candidates(usable, None if coarse is None else pyramid[number + 1][1], window)
        if len(candidates) == 0:
            raise InputError(
                f"the sample has no {window} x {window} window of usable pixels on level {number}; "
                "give a smaller window, fewer levels or a larger sample"
            )
        candidates, rows = _grouped(level, coarse, candidates, window, notes)
        search = WindowSearch(
            level, coarse, candidates, rows, window=window, squared=metric == "squared", wrap=tileable, device=chosen
        )
        targets, waves = _raster_waves(level.canvas.shape, window) if hole is None else _shrinking_waves(wanted[number], window)
        keys = (number, targets[:, 0], targets[:, 1])
        searched = uniform(seed, Stream.GROW_EXHAUSTIVE, *keys) < exhaustive
        before = done
        search.synthesise(
            targets,
            waves,
            searched,
            uniform(seed, Stream.GROW_START, *keys),
            None if progress is None else lambda n, b=before: progress(b + n, total),
        )
        done += len(targets)
        coarse = Level(level.planes, search.canvas)
    assert coarse is not None
    width = sample.usable.shape[1]
    source = np.stack([coarse.canvas // width, coarse.canvas % width], axis=2).astype(np.int32)
    if hole is not None:
        # Pixels that the mask left out are no sample, but stay as they are.
        source[~hole] = places(shape)[~hole]
    if (source < 0).any():
        raise AssertionError("a pixel was not synthesised")
    kept = maps.mask | hole if hole is not None and isinstance(maps, Relightable) and maps.mask is not None else None
    return copied(maps, sample.maps, source, tileable=tileable, notes=tuple(notes), mask=kept)


def _prepared(maps: Any, hole: Array | None, mask: Array | None, match: Any, weights: Any) -> SampleMaps:
    """Return the sample; missing pixels are none of it, and their values may be anything."""
    if hole is None:
        return prepare(maps, mask=mask, match=match, weights=weights)
    known = ~hole
    if mask is not None:
        known &= checked_mask("mask", mask, hole.shape)
    if not known.any():
        raise InputError("missing covers everything; there is no sample left to fill it from")
    return prepare(maps, mask=known, match=match, weights=weights)


def _pyramid(
    sample: SampleMaps, hole: Array | None, shape: tuple[int, int], window: int, levels: int | None
) -> list[tuple[Level, Array]]:
    """Return levels, finest first, with empty canvases (in the shape of a hole: known pixels copy themselves)."""
    planes, usable = sample.features, sample.usable
    found = []
    deepest = 4 if levels is None else levels
    for number in range(deepest):
        if hole is None:
            canvas = np.full(level_shape(shape, number), -1, np.int32)
        else:
            canvas = np.where(usable, np.arange(usable.size).reshape(usable.shape), -1).astype(np.int32)
        found.append((Level(planes, canvas), usable))
        if levels is None and min(-(-n // 2) for n in usable.shape) < 4 * window:
            break
        if number + 1 < deepest:
            planes, coarse = halved(planes, usable)
            if levels is None and not (window_starts(coarse, window).any() and len(_candidates(usable, coarse, window))):
                break
            usable = coarse
    return found


def _candidates(usable: Array, coarse_usable: Array | None, window: int) -> Array:
    """Return (M, 2) pixels whose window, and whose parent's 3 x 3 surroundings, lie in the sample and are usable."""
    whole = ndimage.minimum_filter(usable, window, mode="constant", cval=0)
    if coarse_usable is not None:
        above = ndimage.minimum_filter(coarse_usable, 3, mode="constant", cval=0)
        whole = whole & np.repeat(np.repeat(above, 2, axis=0), 2, axis=1)[: usable.shape[0], : usable.shape[1]]
    return np.argwhere(whole)


def _grouped(level: Level, coarse: Level | None, candidates: Array, window: int, notes: list[str]) -> tuple[Array, Array]:
    """Return the candidates, similar ones together and thinned where they are too many, and their neighbourhoods."""
    elements = len(level.planes) * (window * window + (0 if coarse is None else 9))
    most = _MOST_VALUES // elements
    if len(candidates) > most:
        notes.append(f"{most} of {len(candidates)} neighbourhoods of the sample compared, evenly spread")
        candidates = candidates[np.linspace(0, len(candidates) - 1, most).astype(int)]
    with single_threaded_blas():
        rows = neighbourhoods(level, coarse, candidates, window)
        part = rows[np.linspace(0, len(rows) - 1, min(len(rows), 2000)).astype(int)].astype(np.float64)
        part -= part.mean(axis=0)
        axes = np.linalg.eigh(part.T @ part)[1][:, -_COMPONENTS:]
        order = cKDTree(rows @ axes.astype(np.float32), leafsize=16).indices
    return candidates[order], rows[order]


def _raster_waves(shape: tuple[int, int], window: int) -> tuple[Array, Array]:
    """Return pixels (T, 2) in waves, and where each wave begins.

    A pixel needs the row above it done as far to the right as its window reaches: its wave sees what raster order would show
    it. On a torus the left end of lower rows is there already when the right end of a row is reached, and is seen too.
    """
    pixels = places(shape).reshape(-1, 2)
    return _in_waves(pixels, pixels[:, 1] + (window // 2 + 1) * pixels[:, 0])


def _shrinking_waves(hole: Array, window: int) -> tuple[Array, Array]:
    """Return missing pixels from the known ones inwards, ring by ring; pixels of one wave are out of each other's window."""
    if hole.all():
        return _raster_waves(hole.shape, window)
    ring = np.ceil(ndimage.distance_transform_edt(hole)).astype(int)
    pixels = np.argwhere(hole)
    apart = window // 2 + 1
    color = (pixels[:, 0] % apart) * apart + pixels[:, 1] % apart
    return _in_waves(pixels, ring[hole] * apart * apart + color)


def _in_waves(pixels: Array, wave: Array) -> tuple[Array, Array]:
    """Return pixels sorted by wave, and where each wave begins."""
    if len(pixels) == 0:
        return pixels, np.zeros(1, int)
    order = np.argsort(wave, kind="stable")
    starts = np.flatnonzero(np.diff(wave[order], prepend=wave[order[0]] - 1))
    return pixels[order], np.append(starts, len(order))
