"""Synthesis by coherent pieces: blocks laid evenly on a coarse level, borders improved level by level, pieces joined."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_arguments, checked_size
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.photometric import Relightable
from intaglio.randomness import checked_seed
from intaglio.synthesis.coherent.joining import join_pieces
from intaglio.synthesis.coherent.levels import improve_level, refine_source
from intaglio.synthesis.coherent.starts import Start, begin
from intaglio.synthesis.material import Material
from intaglio.synthesis.options import WeaveOptions
from intaglio.synthesis.pyramid import halve_planes, level_shape
from intaglio.synthesis.result import Synthesis, copy_sample, texture_of_planes
from intaglio.synthesis.sample import SampleMaps, as_match, prepare_sample, window_starts

# The coarsest level's shorter side is at least this many pixels: smaller ones don't tell elements apart.
_COARSEST = 48

# Rounds of every level but the finest, which has one: in each, borders are found anew.
_ROUNDS = 2

# How far from a border values are moved, in pixels; of heights, so many blocks' sides: their pieces are offset as a whole.
_REACH, _REACH_OF_HEIGHTS = 8.0, 1.0

# Steps of values are averaged along borders over so many pixels; those of heights, which would be cliffs, are not.
_SMOOTH = 2.0

# The kernels index pictures by 32-bit numbers.
_MOST_VALUES = 2**31 - 1


@checked_arguments
def weave(
    maps: Any,
    size: int | tuple[int, int],
    block: int | str = "auto",
    *,
    passes: int = 2,
    exact: bool = False,
    tileable: bool = False,
    mask: Array | None = None,
    match: Any = None,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> Synthesis:
    """Synthesise a larger texture from coherent pieces of a sample.

    On a coarse level, blocks of the sample are laid so that they fit and the sample is evenly used; several sizes of blocks and
    weights of even use are tried, and the result whose patches are most like the sample's is kept. Then, level by level, the
    patches over the borders between pieces are matched to the sample (PatchMatch), pixels take their vote and are copied from
    where they point, and borders move to where they cost least. Last, all maps are joined over the borders by their
    differences, so that no step is left that the sample doesn't have.

    Parameters
    ----------
    maps : (H, W) or (H, W, n) array, Relightable, Material, or sequence of arrays of one size
        The sample, of any type of real numbers.
    size : int or (int, int)
        Rows and columns of the result in pixels, 1 to 65536; one number makes a square.
    block : int or "auto", optional
        Side of the first blocks in pixels, as in `WeaveOptions`.
    passes : int, optional
        How often the patches of a level are matched and vote, 0 to 100; as in `WeaveOptions`.
    exact : bool, optional
        Only copies: pieces are not joined, as in `WeaveOptions`.
    tileable : bool, optional
        Make a result that wraps around without a seam. Default False, since most results are not repeated.
    mask : (H, W) bool array, optional
        Pixels of the sample that may be used. Default None: all.
    match : array like ``maps``, or Match, optional
        What is compared in place of ``maps``, such as the gamma-encoded values of a photograph, or how: see `Match`. Its metric
        is that of the blocks; patches are compared by squared differences. Default None: ``maps`` themselves.
    seed : int, optional
        The same seed gives the same bits.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the amount done and the total.

    Returns
    -------
    Synthesis
        ``.maps`` (H, W, n), ``.source`` (H, W, 2): row and column in the sample; ``.moved`` (H, W, n): by how much values were
        moved to join pieces; ``.texture`` if the sample was relightable.

    Raises
    ------
    InputError
        For a block larger than the sample, a mask that leaves no block, values that are not finite, and other arguments out of
        range.

    See Also
    --------
    intaglio.quilt : Synthesis by blocks alone, as published.
    intaglio.grow : Synthesis pixel by pixel.
    intaglio.synthesize : All methods, also for photographs under known lights.

    References
    ----------
    Barnes et al., "PatchMatch", SIGGRAPH 2009. Wexler, Shechtman & Irani, "Space-Time Completion of Video", PAMI 29, 2007:
    the vote. Kwatra et al., "Graphcut Textures", SIGGRAPH 2003, equation 1: the cost of borders. Kaspar et al., "Self Tuning
    Texture Optimization", Eurographics 2015: even use. Pérez et al., "Poisson Image Editing", SIGGRAPH 2003.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> sample = np.tile(np.eye(8), (8, 8))
    >>> made = intaglio.weave(sample, (80, 96), seed=1, device="cpu")
    >>> bool(np.allclose(made.maps, made.copy_of(sample)[:, :, None] + made.moved, atol=1e-6))
    True
    """
    shape = checked_size("size", size)
    options = WeaveOptions(block, passes, exact)
    compared = as_match(match)
    seed = checked_seed(seed)
    chosen = device_or_error(device)
    sample = prepare_sample(maps, mask=mask, match=compared)
    _check_sizes(sample, shape, options, tileable)
    levels = [(sample.features, sample.usable)]
    while _has_coarser(levels[-1], shape, len(levels)):
        levels.append(halve_planes(*levels[-1]))
    if not levels[-1][1].any() or not window_starts(levels[-1][1], 2).any():
        levels = levels[:1]

    start = None
    while start is None:
        deepest = len(levels) - 1
        planes, usable = levels[-1]
        start = begin(
            planes,
            usable,
            level_shape(shape, deepest),
            block=None if isinstance(block, str) else max(2, round(int(block) / 2**deepest)),
            wrap=tileable,
            squared=compared.metric == "squared",
            seed=seed,
            device=chosen,
        )
        if start is None and deepest == 0:
            raise InputError(
                f"mask leaves no block of {block if isinstance(block, int) else 2} usable pixels a side; "
                "give a smaller block or a larger mask"
            )
        if start is None:
            levels.pop()

    work = [4.0**-n * (1 if n == 0 else _ROUNDS) for n in range(len(levels))]
    total = sum(work) + 1
    if progress is not None:
        progress(1000, int(1000 * total))
    source = start.source
    for number in range(len(levels) - 1, -1, -1):
        planes, usable = levels[number]
        for turn in range(1 if number == 0 else _ROUNDS):
            source = improve_level(
                planes,
                usable,
                source,
                passes=options.passes,
                wrap=tileable,
                seed=seed,
                number=16 * number + turn,
                device=chosen,
            )
        if number:
            source = refine_source(source, level_shape(shape, number - 1), levels[number - 1][1])
        if progress is not None:
            progress(int(1000 * (1 + sum(work[number:]))), int(1000 * total))
    found = copy_sample(maps, sample.maps, source, tileable=tileable, notes=_describe(start, len(levels) - 1, sample))
    return found if options.exact else _join(found, maps, sample, start.side * 2.0 ** (len(levels) - 1))


def _check_sizes(sample: SampleMaps, shape: tuple[int, int], options: WeaveOptions, tileable: bool) -> None:
    """Raise `InputError` for a sample or a result that is too small or too large."""
    height, width = sample.usable.shape
    if min(height, width) < 2:
        raise InputError(f"the sample is {height} x {width} pixels, too small for blocks; give at least 2 x 2")
    if not isinstance(options.block, str) and options.block > min(height, width):
        raise InputError(
            f"block {options.block} is larger than the sample, {height} x {width}; give at most {min(height, width)}"
        )
    if tileable and not isinstance(options.block, str) and min(shape) < options.block:
        raise InputError(
            f"size {shape[0]} x {shape[1]} is smaller than block ({options.block}); a tileable result must be as large"
        )
    if tileable and min(shape) < 2:
        raise InputError(f"size {shape[0]} x {shape[1]} is too small to be tileable; give at least 2 x 2")
    for what, pixels in (("the sample", height * width), ("the result", shape[0] * shape[1])):
        # A canvas that wraps around is a patch larger.
        values = len(sample.features) * (pixels + 16 * (shape[0] + shape[1] + height + width))
        if values > _MOST_VALUES:
            raise InputError(f"{what} has {values} values that are compared, more than {_MOST_VALUES}; make it smaller")


def _has_coarser(level: tuple[Array, Array], shape: tuple[int, int], number: int) -> bool:
    """Return whether a level ``number`` is large enough, of the sample and of the result."""
    half = min(-(-n // 2) for n in level[1].shape)
    return half >= _COARSEST and min(level_shape(shape, number)) >= _COARSEST // 3


def _describe(start: Start, deepest: int, sample: SampleMaps) -> tuple[str, ...]:
    scale = "" if deepest == 0 else f" at 1/{2**deepest} of the size"
    chosen = f", the most alike of {start.tried} arrangements" if start.tried > 1 else ""
    return (f"begun with blocks of {start.side * 2**deepest} pixels{scale}{chosen}",)


def _join(found: Synthesis, maps: Any, sample: SampleMaps, side: float) -> Synthesis:
    """Return the result with all its maps joined over the borders between pieces."""
    kinds = _kinds(maps, sample.maps.shape[2])
    copies = found.maps
    made = copies.copy()
    ends = [(low, high) for low, high in zip(*(f(sample.maps[sample.usable], axis=0) for f in (np.min, np.max)), strict=True)]
    for group, reach, smooth in (
        (("height",), max(_REACH, _REACH_OF_HEIGHTS * side), 0.0),
        (("value", "normal"), _REACH, _SMOOTH),
    ):
        which = [c for c, kind in enumerate(kinds) if kind in group]
        planes = (sample.maps[:, :, c].astype(np.float64) for c in which)
        added = join_pieces(planes, sample.usable, found.source, reach=reach, smooth=smooth, wrap=found.tileable)
        for c, more in zip(which, added, strict=False):
            made[:, :, c] = _as_type(np.clip(copies[:, :, c] + more.astype(np.float64), *ends[c]), made.dtype)
    normals = [c for c, kind in enumerate(kinds) if kind == "normal"]
    if normals:
        normal = 2 * made[:, :, normals].astype(np.float64) - 1
        made[:, :, normals] = (normal / np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12) + 1) / 2
    moved = np.empty(made.shape, np.float32)
    for c in range(made.shape[2]):
        moved[:, :, c] = made[:, :, c].astype(np.float64) - copies[:, :, c]
    texture = None if found.texture is None else texture_of_planes(found.texture, made)
    spans = [float(high) - float(low) or 1.0 for low, high in ends]
    share = max((float(np.abs(moved[:, :, c]).mean()) / span for c, span in enumerate(spans)), default=0.0)
    notes = (
        *found.notes,
        f"pieces joined by their differences, which moved values by {100 * share:.2g} % of their range on average",
    )
    return replace(found, maps=made, texture=texture, moved=moved, notes=notes)


def _as_type(values: Array, dtype: np.dtype[Any]) -> Array:
    """Return values in a type; integers are rounded."""
    return (np.rint(values) if dtype.kind in "iu" else values).astype(dtype)


def _kinds(maps: Any, count: int) -> list[str]:
    """Return what each map is: "height", "normal" for those of a `Material`, "given" for what stays as copied, else "value"."""
    kinds: list[str] = []
    if isinstance(maps, Material):
        for kind, plane in maps.maps.items():
            name = "height" if kind in ("displacement", "bump") else "normal" if kind == "normal" else "value"
            kinds += [name] * (1 if plane.ndim == 2 else plane.shape[2])
        return kinds
    if isinstance(maps, Relightable):
        kinds = ["value"] * int(np.prod(maps.maps.shape) // np.prod(maps.maps.shape[1:3]))
        kinds += ["value"] * (0 if maps.chroma is None else int(np.prod(maps.chroma.shape[2:])))
        kinds += [] if maps.height is None else ["height"]
        # What the fit was worth is no quantity that runs on from pixel to pixel.
        return kinds + ["given"] * (count - len(kinds))
    return ["value"] * count
