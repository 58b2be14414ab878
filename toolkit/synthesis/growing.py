"""Multiresolution pixel synthesis in R^n (Wei & Levoy 2000; Dong, section 5.3.1), also inside a mask."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_arguments, checked_mask, checked_size
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.launch import single_threaded_blas
from intaglio.kernels.windows import Level, WindowSearch, neighborhoods
from intaglio.photometric import Relightable
from intaglio.randomness import Stream, checked_seed, uniform
from intaglio.synthesis.options import GrowOptions
from intaglio.synthesis.pyramid import halve_planes, level_shape
from intaglio.synthesis.result import Synthesis, copy_sample, pixel_positions
from intaglio.synthesis.sample import (
    Match,
    SampleMaps,
    as_match,
    prepare_sample,
    stack_maps,
    window_starts,
)

# The most values in all neighbourhoods together; in larger samples, evenly spread neighbourhoods are compared.
_MOST_VALUES = 300_000_000

# Principal components by which similar neighbourhoods are grouped.
_COMPONENTS = 12


@checked_arguments
def grow(
    maps: Any,
    size: int | tuple[int, int] | None = None,
    *,
    missing: Array | None = None,
    window: int = 2,
    levels: int | None = None,
    exhaustive: float = 1.0,
    tileable: bool = False,
    mask: Array | None = None,
    match: Any = None,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> Synthesis:
    """Synthesise a texture pixel by pixel, from coarse to fine, or fill the missing part of one.

    Each pixel copies the pixel of the sample whose neighbourhood is most similar to what is already there: a window on its
    own level, and 3 x 3 pixels on the coarser one. The search gives exactly the result of a comparison with all
    neighbourhoods.

    Parameters
    ----------
    maps : (H, W) or (H, W, n) array, Relightable, Material, or sequence of arrays of one size
        The sample, of any type of real numbers; with ``missing``, the texture to fill, whose other pixels are the sample.
    size : int or (int, int), optional
        Rows and columns of the result in pixels, 1 to 65536; one number makes a square. Not with ``missing``, where the
        result has the size of the maps.
    missing : (H, W) bool array, optional
        Pixels to fill, from the known ones inwards; all others keep their bits. Default None: a new texture of ``size``.
    window : int, optional
        Radius of the neighbourhood on the pixel's own level, in pixels, 1 to 7: its side is 2 ``window`` + 1.
    levels : int, optional
        Levels of the pyramid, 1 to 12. Default None: as many as leave the coarsest sample at least four windows on a side
        and one window of usable pixels, at most 4.
    exhaustive : float, optional
        Share of the pixels that are searched for in any case, 0 to 1; for the others the pixel next to the source of their
        left neighbour is taken if the sample has one (section 5.3.1: 0.4 to 0.7 is good enough). Not with ``missing``. Default 1:
        all are searched for, for the best result.
    tileable : bool, optional
        Neighbourhoods wrap around, so that the result matches across its border within the reach of a window; `quilt`
        closes it better. Default False, since most results are not repeated.
    mask : (H, W) bool array, optional
        Pixels of the sample that may be used. Default None: all.
    match : array like ``maps``, or Match, optional
        What is compared in place of ``maps``, such as the gamma-encoded values of a photograph, or how: see `Match`.
        Default None: ``maps`` themselves, by absolute differences.
    seed : int, optional
        The same seed gives the same bits.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the pixels done and all pixels, over all levels.

    Returns
    -------
    Synthesis
        ``.maps`` (H, W, n), ``.source`` (H, W, 2): row and column in the sample; ``.texture`` if the sample was relightable.

    Raises
    ------
    InputError
        For a sample without a whole window, values that are not finite, and other arguments out of range.

    See Also
    --------
    intaglio.quilt : Synthesis by blocks.
    intaglio.synthesize : Both methods, also for photographs under known lights.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 5.3.1, table 5.3.1.
    Wei & Levoy, "Fast Texture Synthesis using Tree-structured Vector Quantization", SIGGRAPH 2000. Yamauchi et al.,
    "Textures Revisited", The Visual Computer 21, 2005, section 5: the order in which holes shrink.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> stripes = np.tile([0.0, 0.0, 1.0, 1.0], (24, 6))
    >>> hole = np.zeros(stripes.shape, bool)
    >>> hole[10:14, 10:14] = True
    >>> made = intaglio.grow(np.where(hole, np.nan, stripes), missing=hole, levels=1, device="cpu")
    >>> bool((made.maps[:, :, 0] == stripes).all())
    True
    """
    options = GrowOptions(window, levels, exhaustive)
    side = 2 * options.window + 1
    if missing is not None and options.exhaustive != 1:
        raise InputError("exhaustive is for new textures; leave it out with missing")
    compared = as_match(match)
    seed = checked_seed(seed)
    chosen = device_or_error(device)
    if (size is None) == (missing is None):
        raise InputError("give either size, to synthesise a new texture, or missing, to fill this one")
    hole = None
    if missing is not None:
        hole = checked_mask("missing", missing, stack_maps(maps).shape[:2])
        if tileable:
            raise InputError("tileable is for new textures; leave it out with missing")
    sample = _prepare_known(maps, hole, mask, compared)
    shape = sample.usable.shape if size is None else checked_size("size", size)
    if hole is not None and not hole.any():
        kept = maps.mask if isinstance(maps, Relightable) else None
        return copy_sample(maps, sample.maps, pixel_positions(shape), tileable=False, notes=("nothing is missing",), mask=kept)

    pyramid = _build_pyramid(sample, hole, shape, side, options.levels)
    wanted = [hole if hole is not None and n == 0 else level.canvas < 0 for n, (level, _) in enumerate(pyramid)]
    total = sum(int(w.sum()) for w in wanted)
    done = 0
    coarse: Level | None = None
    notes = [f"{len(pyramid)} levels, window {side} x {side}"]
    for number in range(len(pyramid) - 1, -1, -1):
        level, usable = pyramid[number]
        candidates = _candidates(usable, None if coarse is None else pyramid[number + 1][1], side)
        if len(candidates) == 0:
            raise InputError(
                f"the sample has no {side} x {side} window of usable pixels on level {number}; "
                "give a smaller window, fewer levels or a larger sample"
            )
        candidates, rows = _group_similar(level, coarse, candidates, side, notes)
        search = WindowSearch(
            level,
            coarse,
            candidates,
            rows,
            usable,
            window=side,
            squared=compared.metric == "squared",
            wrap=tileable,
            device=chosen,
        )
        targets, waves = _raster_waves(level.canvas.shape, side) if hole is None else _shrinking_waves(wanted[number], side)
        keys = (number, targets[:, 0], targets[:, 1])
        searched = uniform(seed, Stream.GROW_EXHAUSTIVE, *keys) < options.exhaustive
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
        # Known pixels that the mask excludes from the sample still keep their values.
        source[~hole] = pixel_positions(shape)[~hole]
    if (source < 0).any():
        raise AssertionError("a pixel was not synthesised")
    kept = maps.mask | hole if hole is not None and isinstance(maps, Relightable) and maps.mask is not None else None
    return copy_sample(maps, sample.maps, source, tileable=tileable, notes=tuple(notes), mask=kept)


def _prepare_known(maps: Any, hole: Array | None, mask: Array | None, match: Match) -> SampleMaps:
    """Return the sample without its missing pixels, whose values may be anything."""
    if hole is None:
        return prepare_sample(maps, mask=mask, match=match)
    known = ~hole
    if mask is not None:
        known &= checked_mask("mask", mask, hole.shape)
    if not known.any():
        raise InputError("missing covers everything; there is no sample left to fill it from")
    return prepare_sample(maps, mask=known, match=match)


def _build_pyramid(
    sample: SampleMaps, hole: Array | None, shape: tuple[int, int], side: int, levels: int | None
) -> list[tuple[Level, Array]]:
    """Return the levels, finest first, with empty canvases; around a hole, known pixels copy themselves."""
    planes, usable = sample.features, sample.usable
    found = []
    deepest = 4 if levels is None else levels
    for number in range(deepest):
        if hole is None:
            canvas = np.full(level_shape(shape, number), -1, np.int32)
        else:
            canvas = np.where(usable, np.arange(usable.size).reshape(usable.shape), -1).astype(np.int32)
        found.append((Level(planes, canvas), usable))
        if levels is None and min(-(-n // 2) for n in usable.shape) < 4 * side:
            break
        if number + 1 < deepest:
            planes, coarse = halve_planes(planes, usable)
            if levels is None and not (window_starts(coarse, side).any() and len(_candidates(usable, coarse, side))):
                break
            usable = coarse
    return found


def _candidates(usable: Array, coarse_usable: Array | None, side: int) -> Array:
    """Return the pixels (M, 2) whose window, and the 3 x 3 pixels about their parent, are inside the sample and usable."""
    whole = ndimage.minimum_filter(usable, side, mode="constant", cval=0)
    if coarse_usable is not None:
        above = ndimage.minimum_filter(coarse_usable, 3, mode="constant", cval=0)
        whole = whole & np.repeat(np.repeat(above, 2, axis=0), 2, axis=1)[: usable.shape[0], : usable.shape[1]]
    return np.argwhere(whole)


def _group_similar(level: Level, coarse: Level | None, candidates: Array, side: int, notes: list[str]) -> tuple[Array, Array]:
    """Return the candidates, ordered so that similar ones are together and thinned if too many, and their neighbourhoods."""
    elements = len(level.planes) * (side * side + (0 if coarse is None else 9))
    most = _MOST_VALUES // elements
    if len(candidates) > most:
        notes.append(f"{most} of {len(candidates)} neighbourhoods of the sample compared, evenly spread")
        candidates = candidates[np.linspace(0, len(candidates) - 1, most).astype(int)]
    with single_threaded_blas():
        rows = neighborhoods(level, coarse, candidates, side)
        part = rows[np.linspace(0, len(rows) - 1, min(len(rows), 2000)).astype(int)].astype(np.float64)
        part -= part.mean(axis=0)
        axes = np.linalg.eigh(part.T @ part)[1][:, -_COMPONENTS:]
        order = cKDTree(rows @ axes.astype(np.float32), leafsize=16).indices
    return candidates[order], rows[order]


def _raster_waves(shape: tuple[int, int], side: int) -> tuple[Array, Array]:
    """Return pixels (T, 2) in waves, and where each wave begins.

    A pixel comes in a later wave than the row above it as far to the right as its window reaches, so that it sees the same
    neighbours as in raster order. On a torus, it also sees the left end of lower rows near the right end of its own.
    """
    pixels = pixel_positions(shape).reshape(-1, 2)
    return _sort_into_waves(pixels, pixels[:, 1] + (side // 2 + 1) * pixels[:, 0])


def _shrinking_waves(hole: Array, side: int) -> tuple[Array, Array]:
    """Return missing pixels from the known ones inwards, ring by ring; no pixel of a wave lies in the window of another."""
    if hole.all():
        return _raster_waves(hole.shape, side)
    ring = np.ceil(ndimage.distance_transform_edt(hole)).astype(int)
    pixels = np.argwhere(hole)
    apart = side // 2 + 1
    color = (pixels[:, 0] % apart) * apart + pixels[:, 1] % apart
    return _sort_into_waves(pixels, ring[hole] * apart * apart + color)


def _sort_into_waves(pixels: Array, wave: Array) -> tuple[Array, Array]:
    """Return pixels sorted by wave, and where each wave begins."""
    if len(pixels) == 0:
        return pixels, np.zeros(1, int)
    order = np.argsort(wave, kind="stable")
    starts = np.flatnonzero(np.diff(wave[order], prepend=wave[order[0]] - 1))
    return pixels[order], np.append(starts, len(order))
