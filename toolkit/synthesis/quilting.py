"""Image quilting in R^n (Efros & Freeman 2001; Dong, sections 5.3.2 and 6.2.1)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_choice, checked_count, checked_number
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.block_search import ROWS
from intaglio.kernels.blocks import BlockLayer, Sample
from intaglio.kernels.lanes import LANES
from intaglio.randomness import Stream, checked_seed, uniform
from intaglio.synthesis.block_size import automatic_block
from intaglio.synthesis.graph_cut import graph_cut_seams
from intaglio.synthesis.layout import plan
from intaglio.synthesis.refinement import refined
from intaglio.synthesis.result import Synthesis, copied
from intaglio.synthesis.sample import METRICS, SampleMaps, checked_size, prepare, window_starts

CUTS = ("path", "graph", "none")
CONTINUATIONS = ("shortcut", "search", "avoid")

# What random numbers are for.

# Beyond this any block will do.
_MOST_TOLERANCE = 1e6

# The kernels index a sample by 32-bit numbers.
_MOST_VALUES = 2**31 - 1


def quilt(
    maps: Any,
    size: int | tuple[int, int],
    block: int | str = "auto",
    overlap: int | None = None,
    tolerance: float = 0.1,
    *,
    metric: str = "absolute",
    cut: str = "path",
    continuation: str = "shortcut",
    tileable: bool = False,
    refine: int = 0,
    mask: Array | None = None,
    match: Any = None,
    weights: Sequence[float] | Array | None = None,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> Synthesis:
    """Synthesise a larger texture from blocks of a sample.

    Blocks are laid in raster order. Each is chosen at random among the blocks of the sample whose overlap with what is laid
    differs least, over all maps together, and is joined to it along the path of least difference. Values are copied: all
    maps of a pixel come from one place of the sample.

    Parameters
    ----------
    maps : (H, W) or (H, W, n) array, Relightable, or sequence of arrays of one size
        The sample.
    size : int or (int, int)
        Rows and columns of the result, 1 to 65536.
    block : int or "auto"
        Side of a block in pixels. "auto": larger than the texture's elements, by its autocorrelation.
    overlap : int, optional
        How far blocks overlap, in pixels, less than ``block``. Default a third of it (section 5.4.3: 1/6 to 1/3).
    tolerance : float
        A block is chosen among those whose difference is at most (1 + tolerance) times the least; 0 to 1e6.
    metric : {"absolute", "squared"}
        Of differences: SAD (eq. 6.2.1) or SSD.
    cut : {"path", "graph", "none"}
        The boundary: a path through each side's overlap by dynamic programming, a minimum cut of any shape through all of
        it (slower), or none.
    continuation : {"shortcut", "search", "avoid"}
        What to do where the sample itself goes on beside the blocks already laid. "shortcut" takes its next block unsearched
        if all neighbours agree on it (section 5.3.2); "search" compares it with all others, whose overlaps are seldom as
        good; "avoid" leaves it, and what begins within half a block of it, out (less in samples of few blocks), so that copied
        pieces are hardly larger than blocks.
    tileable : bool
        Make a result that wraps around without a seam; ``size`` must be at least ``block``.
    refine : int
        Passes per window size (32, 16 and 8 pixels, as far as ``block`` allows) of the refinement that removes visible seams by
        texture optimisation: windows are matched to the sample, pixels take their vote, and the last pass copies again. 0: none.
        It runs on the CPU.
    mask : (H, W) bool array, optional
        Pixels of the sample that may be used.
    match : like ``maps``, optional
        What to compare in place of ``maps``, such as a photograph's gamma-encoded values.
    weights : (n,) array, optional
        Weight of each compared map. Maps are brought to equal range before (section 6.2.3).
    seed : int
        The same seed gives the same bits.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``; default CUDA if there is one.
    progress : callable, optional
        Called with what is done and what there is to do.

    Returns
    -------
    Synthesis
        ``.maps`` (H, W, n), ``.source`` (H, W, 2): row and column in the sample; ``.texture`` if the sample was relightable.

    Raises
    ------
    InputError
        For a block larger than the sample, an overlap not below the block, a mask that leaves no block, values that are not
        finite, and other arguments out of range.

    References
    ----------
    Dong, Three-dimensional Surface Texture Synthesis (2003), sections 5.3.2 and 6.2.1, equation 6.2.1. Efros and Freeman,
    Image quilting (2001). Kwatra et al., Graphcut textures (2003).
    """
    shape = checked_size(size)
    tolerance = checked_number("tolerance", tolerance, 0, _MOST_TOLERANCE)
    refine = checked_count("refine", refine, 0, 100)
    checked_choice("metric", metric, METRICS)
    checked_choice("cut", cut, CUTS)
    checked_choice("continuation", continuation, CONTINUATIONS)
    seed = checked_seed(seed)
    chosen = device_or_error(device)
    sample = prepare(maps, mask=mask, match=match, weights=weights)
    side, note = checked_block(sample, block)
    lap = max(1, round(side / 3)) if overlap is None else overlap
    if not isinstance(lap, int | np.integer) or isinstance(lap, bool) or not 1 <= lap < side:
        raise InputError(f"overlap must be a whole number from 1 to {side - 1}, less than block ({side}), not {overlap!r}")
    if tileable and min(shape) < side:
        raise InputError(f"size {shape[0]} x {shape[1]} is smaller than block ({side}); a tileable result must be as large")

    usable = window_starts(sample.usable, side)
    if not usable.any():
        raise InputError(f"mask leaves no block of {side} x {side} usable pixels; give a smaller block or a larger mask")
    blocks = plan(shape, side, int(lap), tileable=tileable, continued=continuation == "avoid")
    count = len(blocks.origin)
    layer = BlockLayer(
        Sample(sample.features, usable),
        blocks,
        squared=metric == "squared",
        tolerance=tolerance,
        shortcut=continuation == "shortcut",
        radius=_barred_radius(side, int(usable.sum())) if continuation == "avoid" else -1,
        uniform=uniform(seed, Stream.QUILT_CHOICE, blocks.origin[:, 0], blocks.origin[:, 1]),
        device=chosen,
    )
    steps = count if refine == 0 else 4 * count
    layer.lay(
        seams=_SEAMS[cut],
        progress=None if progress is None else lambda done, total: progress(done, steps),
    )
    source = np.ascontiguousarray(layer.canvas[: shape[0], : shape[1]])
    notes = [note, f"{count} blocks of {side} pixels, overlapping by {int(lap)}"]
    if refine:
        source, sides = refined(
            sample,
            source,
            block=side,
            passes=refine,
            tileable=tileable,
            progress=None if progress is None else lambda done, total: progress(count + 3 * count * done // total, steps),
        )
        used = ", ".join(map(str, sides))
        notes.append(f"refined, {refine} passes with windows of {used} pixels" if sides else "too small to be refined")
    return copied(maps, sample.maps, source, tileable=tileable, notes=tuple(notes))


def checked_block(sample: SampleMaps, block: int | str) -> tuple[int, str]:
    """Return the side of a block, and how it was chosen.

    Raises
    ------
    InputError
        If it is no whole number, less than 2 or larger than the sample.
    """
    height, width = sample.usable.shape
    # As the kernels store it, with their padding.
    values = len(sample.features) * (height + ROWS) * (width + LANES)
    if values > _MOST_VALUES:
        raise InputError(f"the sample has {values} values, more than {_MOST_VALUES}; give a smaller part of it")
    if min(height, width) < 2:
        raise InputError(f"the sample is {height} x {width} pixels, too small for blocks; give at least 2 x 2")
    if isinstance(block, str) and block == "auto":
        side, found = automatic_block(sample.features, sample.usable)
        while side > 2 and not window_starts(sample.usable, side).any():
            side -= 1
        return side, f"block {side}: {found}"
    if not isinstance(block, int | np.integer) or isinstance(block, bool) or block < 2:
        raise InputError(f'block must be a whole number of at least 2, or "auto", not {block!r}')
    if block > min(height, width):
        raise InputError(f"block {block} is larger than the sample, {height} x {width}; give at most {min(height, width)}")
    return int(block), f"block {block}, as given"


def _barred_radius(block: int, candidates: int) -> int:
    """Return how near to its neighbours' continuation a block may not start: half a block, less where few would be left."""
    radius = block // 2
    while radius > 0 and 8 * (2 * radius + 1) ** 2 > candidates:
        radius -= 1
    # Four neighbours bar at most four squares.
    return radius if 4 * (2 * radius + 1) ** 2 < candidates else -1


def _uncut(error: Array, overlap: Array) -> Array:
    """Keep all of every block."""
    return np.ones(error.shape, bool)


_SEAMS: dict[str, Callable[[Array, Array], Array] | None] = {"path": None, "graph": graph_cut_seams, "none": _uncut}
