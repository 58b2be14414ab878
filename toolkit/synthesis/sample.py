"""What is synthesised from: maps of one size, which pixels may be used, and the values that are compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.photometric import Relightable

METRICS = ("absolute", "squared")


@dataclass(frozen=True)
class SampleMaps:
    """A sample taken apart.

    Attributes
    ----------
    maps : (H, W, n) array
        What is copied, of the type it came in.
    features : (n', H, W) float32 array
        What is compared: each map brought to the range [0, 1], times its weight.
    usable : (H, W) bool array
        Pixels that may be copied.
    """

    maps: Array
    features: Array
    usable: Array


def window_starts(usable: Array, side: int) -> Array:
    """Return (H - side + 1, W - side + 1) bool: where a window of ``side`` x ``side`` usable pixels begins."""
    summed = np.zeros((usable.shape[0] + 1, usable.shape[1] + 1), np.int64)
    summed[1:, 1:] = np.cumsum(np.cumsum(~usable, axis=0), axis=1)
    bad = summed[side:, side:] - summed[:-side, side:] - summed[side:, :-side] + summed[:-side, :-side]
    return np.asarray(bad == 0)


def texture_planes(texture: Relightable) -> Array:
    """Return all that a relightable texture holds for each pixel: its maps, chromaticity, height, confidence: (H, W, n)."""
    height, width = texture.maps.shape[1:3]
    planes = [np.moveaxis(texture.maps, 0, 2).reshape(height, width, -1)]
    planes += [p.reshape(height, width, -1) for p in (texture.chroma, texture.height, texture.confidence) if p is not None]
    return np.concatenate([p.astype(np.float32, copy=False) for p in planes], axis=2)


def compared_planes(texture: Relightable) -> Array:
    """Return what is compared of a relightable texture: maps and chromaticity; heights and confidence follow from these."""
    return texture_planes(replace(texture, height=None, confidence=None))


def stacked(maps: Any, name: str = "maps") -> Array:
    """Return ``maps`` as (H, W, n): an array (H, W) or (H, W, n), a `Relightable`, or a sequence of arrays of one size.

    Raises
    ------
    InputError
        If it is none of these, is empty, or its parts differ in size.
    """
    if isinstance(maps, Relightable):
        return texture_planes(maps)
    if isinstance(maps, list | tuple):
        parts = [stacked(m, f"{name}[{i}]") for i, m in enumerate(maps)]
        if not parts:
            raise InputError(f"{name} is empty; give at least one map")
        sizes = {p.shape[:2] for p in parts}
        if len(sizes) > 1:
            listed = ", ".join(f"{h} x {w}" for h, w in (p.shape[:2] for p in parts))
            raise InputError(f"{name} differ in size: {listed} (rows x columns); give maps of one size")
        return np.concatenate(parts, axis=2)
    if isinstance(maps, np.ma.MaskedArray) and np.ma.is_masked(maps):
        raise InputError(f"{name} is a masked array; give its values, and the pixels that may be used as mask=~{name}.mask")
    try:
        array = np.asarray(maps)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be arrays, or a sequence of arrays of one size ({error})") from error
    if array.dtype.kind not in "fiub":
        raise InputError(f"{name} must hold real numbers, not {array.dtype}")
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3:
        raise InputError(f"{name} must be (H, W) or (H, W, n), not {array.shape}")
    if array.size == 0:
        raise InputError(f"{name} is empty: {array.shape}")
    return array


def prepare(
    maps: Any, *, mask: Array | None = None, match: Any = None, weights: Sequence[float] | Array | None = None
) -> SampleMaps:
    """Check a sample and bring the values that are compared to equal range.

    Parameters
    ----------
    maps : (H, W) or (H, W, n) array, Relightable, or sequence of arrays
    mask : (H, W) bool array, optional
        Pixels that may be used. A `Relightable` brings its own, which is joined to it.
    match : like ``maps``, optional
        Compared in place of ``maps``.
    weights : (n,) array, optional
        Weight of each compared map.

    Raises
    ------
    InputError
        For shapes that don't fit, values that are not finite, a mask that leaves nothing, or weights that are none.
    """
    values = stacked(maps)
    usable = np.ones(values.shape[:2], bool)
    if isinstance(maps, Relightable) and maps.mask is not None:
        usable &= maps.mask
    if mask is not None:
        usable &= checked_mask("mask", mask, usable.shape)
    if not usable.any():
        raise InputError("mask leaves no pixel of the sample; True marks pixels that may be used")
    if match is not None:
        compared = stacked(match, "match")
    else:
        compared = compared_planes(maps) if isinstance(maps, Relightable) else values
    if compared.shape[:2] != usable.shape:
        raise InputError(f"match is {compared.shape[:2]}, the maps are {usable.shape}; they must have one size")
    for name, array in (("maps", values), ("match", compared)):
        bad = usable & ~np.isfinite(array).all(axis=2)
        if bad.any():
            y, x = np.argwhere(bad)[0]
            raise InputError(
                f"{name}: {bad.sum()} of {bad.size} pixels have values that are not finite, the first in row {y}, column {x}; "
                "mask them out (mask: True marks pixels that may be used)"
            )
    return SampleMaps(values, _equal_range(compared, usable, weights), usable)


def _equal_range(compared: Array, usable: Array, weights: Sequence[float] | Array | None) -> Array:
    """Return maps as (n, H, W) float32 planes from 0 to their weight, the largest being 1; 0 where not usable."""
    count = compared.shape[2]
    try:
        factor = np.ones(count) if weights is None else np.asarray(weights, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"weights must be {count} numbers ({error})") from error
    if factor.shape != (count,) or not np.isfinite(factor).all() or (factor < 0).any() or not factor.any():
        raise InputError(f"weights must be {count} finite numbers, none negative and not all 0; given: {weights!r}")
    factor = factor / factor.max()
    planes = np.zeros((count, *usable.shape), np.float32)
    for c in range(count):
        plane = compared[:, :, c].astype(np.float64)
        low, high = plane[usable].min(), plane[usable].max()
        with np.errstate(over="ignore"):
            spread = high - low
        if not np.isfinite(spread):
            raise InputError(f"maps: map {c} runs from {low:g} to {high:g}, a range that is not finite; rescale it")
        if spread > 0:
            planes[c][usable] = (plane[usable] - low) / spread * factor[c]
    return planes


def checked_mask(name: str, mask: Any, shape: tuple[int, ...]) -> Array:
    """Return ``mask`` as a bool array, or raise `InputError` if it is none of ``shape``."""
    try:
        array = np.asarray(mask)
    except ValueError as error:
        raise InputError(f"{name} must be a bool array {shape} like the maps ({error})") from error
    if array.shape != tuple(shape) or array.dtype.kind not in "bui":
        raise InputError(f"{name} must be a bool array {tuple(shape)} like the maps, not {array.dtype} {array.shape}")
    return array.astype(bool)


def checked_size(size: int | tuple[int, int]) -> tuple[int, int]:
    """Return ``size``, a number or (rows, columns), as (rows, columns).

    Raises
    ------
    InputError
        If it is no whole number from 1 to 65536, or two of them.
    """
    both = (size, size) if isinstance(size, int | np.integer) and not isinstance(size, bool) else size
    try:
        rows, columns = both  # type: ignore[misc]
    except (TypeError, ValueError) as error:
        raise InputError(f"size must be a whole number or (rows, columns), not {size!r}") from error
    for number in (rows, columns):
        if not isinstance(number, int | np.integer) or isinstance(number, bool) or not 1 <= number <= 65536:
            raise InputError(f"size must be whole numbers from 1 to 65536, (rows, columns); given: {size!r}")
    return int(rows), int(columns)
