"""Image quilting in R^n (Efros & Freeman 2001; Dong, sections 5.3.2 and 6.2.1)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_arguments, checked_size
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.block_search import ROWS
from intaglio.kernels.blocks import BlockLayer, Sample
from intaglio.kernels.lanes import LANES
from intaglio.randomness import Stream, checked_seed, uniform
from intaglio.synthesis.block_size import automatic_block
from intaglio.synthesis.graph_cut import graph_cut_seams
from intaglio.synthesis.layout import plan_blocks
from intaglio.synthesis.options import QuiltOptions
from intaglio.synthesis.refinement import optimize_texture
from intaglio.synthesis.result import Synthesis, copy_sample
from intaglio.synthesis.sample import SampleMaps, as_match, prepare_sample, window_starts
from intaglio.synthesis.trial import best_block

# The kernels index a sample by 32-bit numbers.
_MOST_VALUES = 2**31 - 1


@checked_arguments
def quilt(
    maps: Any,
    size: int | tuple[int, int],
    block: int | str = "auto",
    overlap: int | None = None,
    tolerance: float = 0.1,
    *,
    cut: str = "path",
    continuation: str = "shortcut",
    tileable: bool = False,
    refine: int = 2,
    mask: Array | None = None,
    match: Any = None,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> Synthesis:
    """Synthesise a larger texture from blocks of a sample.

    Blocks are laid in raster order. Each is drawn from the blocks of the sample that differ least, over all maps together,
    from what is already laid where they overlap, and is joined to it along the path of least difference. Values are copied:
    all maps of a pixel come from one place of the sample.

    Parameters
    ----------
    maps : (H, W) or (H, W, n) array, Relightable, Material, or sequence of arrays of one size
        The sample, of any type of real numbers.
    size : int or (int, int)
        Rows and columns of the result in pixels, 1 to 65536; one number makes a square.
    block : int or "auto", optional
        Side of a block in pixels, as in `QuiltOptions`.
    overlap : int, optional
        How far blocks overlap in pixels, as in `QuiltOptions`.
    tolerance : float, optional
        Relative excess over the least difference that a block may have, as in `QuiltOptions`.
    cut : {"path", "graph", "none"}, optional
        The boundary between blocks, as in `QuiltOptions`.
    continuation : {"shortcut", "search", "avoid"}, optional
        What happens if the sample itself continues the blocks already laid, as in `QuiltOptions`.
    tileable : bool, optional
        Make a result that wraps around without a seam; ``size`` must be at least ``block``. Default False, since most
        results are not repeated.
    refine : int, optional
        Passes of texture optimisation for each size of window, 0 to 100; see `QuiltOptions`. Windows are matched to the
        sample, pixels take the vote of the windows over them, and the last pass copies again. Default 2; 0 is plain quilting,
        as published.
    mask : (H, W) bool array, optional
        Pixels of the sample that may be used. Default None: all.
    match : array like ``maps``, or Match, optional
        What is compared in place of ``maps``, such as the gamma-encoded values of a photograph, or how: see `Match`.
        Default None: ``maps`` themselves, by absolute differences (eq. 6.2.1).
    seed : int, optional
        The same seed gives the same bits.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the amount done and the total.

    Returns
    -------
    Synthesis
        ``.maps`` (H, W, n), ``.source`` (H, W, 2): row and column in the sample; ``.texture`` if the sample was relightable.

    Raises
    ------
    InputError
        For a block larger than the sample, an overlap that is not smaller than the block, a mask that leaves no block,
        values that are not finite, and other arguments out of range.

    See Also
    --------
    intaglio.grow : Synthesis pixel by pixel.
    intaglio.synthesize : Both methods, also for photographs under known lights.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, sections 5.3.2, 5.4.3 and
    6.2.1, equation 6.2.1. Efros & Freeman, "Image Quilting for Texture Synthesis and Transfer", SIGGRAPH 2001. Kwatra et
    al., "Graphcut Textures", SIGGRAPH 2003, section 3.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> sample = np.tile(np.eye(8), (4, 4))
    >>> made = intaglio.quilt(sample, (40, 60), block=12, seed=1, device="cpu")
    >>> bool((made.maps == made.copy_of(sample)[:, :, None]).all())
    True
    """
    shape = checked_size("size", size)
    options = QuiltOptions(block, overlap, tolerance, cut, continuation, refine)
    compared = as_match(match)
    seed = checked_seed(seed)
    chosen = device_or_error(device)
    sample = prepare_sample(maps, mask=mask, match=compared)
    side, note = _block_side(sample, block)

    def layer_of(side: int, shape: tuple[int, int], tileable: bool) -> BlockLayer:
        """Blocks of ``side`` pixels for a result of that shape, not laid yet."""
        usable = window_starts(sample.usable, side)
        if not usable.any():
            raise InputError(f"mask leaves no block of {side} x {side} usable pixels; give a smaller block or a larger mask")
        blocks = plan_blocks(shape, side, _overlap(side, overlap), tileable=tileable, continued=continuation == "avoid")
        return BlockLayer(
            Sample(sample.features, usable),
            blocks,
            squared=compared.metric == "squared",
            tolerance=options.tolerance,
            shortcut=continuation == "shortcut",
            radius=_barred_radius(side, int(usable.sum())) if continuation == "avoid" else -1,
            uniform=uniform(seed, Stream.QUILT_CHOICE, blocks.origin[:, 0], blocks.origin[:, 1]),
            device=chosen,
        )

    if isinstance(block, str):

        def tried(side: int, size: int) -> Array:
            layer = layer_of(side, (size, size), False)
            layer.lay(seams=_SEAMS[cut], progress=None)
            place = layer.canvas[:size, :size]
            return np.asarray(sample.features[:, place[:, :, 0], place[:, :, 1]])

        # A block must be larger than the overlap, and lie in the result and in the sample.
        limits = (overlap or 0) + 1, min(*shape, *sample.usable.shape)
        side, found = best_block(side, sample.features, sample.usable, limits, tried, seed)
        note = f"block {side} {found}" if found else note
    lap = _overlap(side, overlap)
    if lap >= side:
        raise InputError(f"overlap must be a whole number from 1 to {side - 1}, less than block ({side}), not {overlap!r}")
    if tileable and min(shape) < side:
        raise InputError(f"size {shape[0]} x {shape[1]} is smaller than block ({side}); a tileable result must be as large")

    layer = layer_of(side, shape, tileable)
    count = len(layer.blocks.origin)
    steps = count if refine == 0 else 4 * count
    layer.lay(
        seams=_SEAMS[cut],
        progress=None if progress is None else lambda done, total: progress(done, steps),
    )
    source = np.ascontiguousarray(layer.canvas[: shape[0], : shape[1]])
    notes = [note, f"{count} blocks of {side} pixels, overlapping by {lap}"]
    if refine:
        source, sides = optimize_texture(
            sample,
            source,
            block=side,
            passes=refine,
            tileable=tileable,
            progress=None if progress is None else lambda done, total: progress(count + 3 * count * done // total, steps),
        )
        used = ", ".join(map(str, sides))
        notes.append(f"refined, {refine} passes with windows of {used} pixels" if sides else "too small to be refined")
    return copy_sample(maps, sample.maps, source, tileable=tileable, notes=tuple(notes))


def _block_side(sample: SampleMaps, block: int | str) -> tuple[int, str]:
    """Return the side of a block in pixels, and how it was chosen; `InputError` if the sample is too small for it."""
    height, width = sample.usable.shape
    # The number that the kernels store, padding included.
    values = len(sample.features) * (height + ROWS) * (width + LANES)
    if values > _MOST_VALUES:
        raise InputError(f"the sample has {values} values, more than {_MOST_VALUES}; give a smaller part of it")
    if min(height, width) < 2:
        raise InputError(f"the sample is {height} x {width} pixels, too small for blocks; give at least 2 x 2")
    if isinstance(block, str):
        side, found = automatic_block(sample.features, sample.usable)
        while side > 2 and not window_starts(sample.usable, side).any():
            side -= 1
        return side, f"block {side}: {found}"
    if block > min(height, width):
        raise InputError(f"block {block} is larger than the sample, {height} x {width}; give at most {min(height, width)}")
    return int(block), f"block {block}, as given"


def _overlap(side: int, overlap: int | None) -> int:
    """Return how far blocks of ``side`` pixels overlap."""
    return max(1, round(side / 3)) if overlap is None else int(overlap)


def _barred_radius(block: int, candidates: int) -> int:
    """Return the radius about the continuation of a neighbour in which no block may start, -1 for none.

    It is half a block, or less if few candidates would be left.
    """
    radius = block // 2
    while radius > 0 and 8 * (2 * radius + 1) ** 2 > candidates:
        radius -= 1
    # Four neighbours exclude at most four squares.
    return radius if 4 * (2 * radius + 1) ** 2 < candidates else -1


def _keep_all(error: Array, overlap: Array) -> Array:
    """Return a mask that keeps all pixels of every block: (K, B, B)."""
    return np.ones(error.shape, bool)


_SEAMS: dict[str, Callable[[Array, Array], Array] | None] = {"path": None, "graph": graph_cut_seams, "none": _keep_all}
