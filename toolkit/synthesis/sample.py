"""Samples: maps of one size, the pixels that may be used, and the values that are compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_choice, checked_mask, checked_numeric, real_array
from intaglio.errors import InputError
from intaglio.photometric import Relightable, surface_maps
from intaglio.synthesis.material import Material

METRICS = ("absolute", "squared")

# Slopes are compared as far as so many times the range of all but the last two thousandths lies beyond it.
_FAR = 1.0


@dataclass(frozen=True)
class Match:
    """What synthesis compares, and how.

    Parameters
    ----------
    maps : (H, W) or (H, W, n) array, Relightable, or sequence of arrays of one size, optional
        Compared in place of the sample's own maps, such as the gamma-encoded values of a photograph. Default None: the
        sample's maps are compared.
    weights : (n,) array, optional
        Weight of each compared map, at least 0 and not all 0; only their ratios count. All maps are first brought to equal
        range (Dong, section 6.2.3). Default None: all weigh the same.
    metric : {"absolute", "squared"}, optional
        Sum of absolute differences (Dong, eq. 6.2.1) or of squared ones. Default "absolute", as published.

    Raises
    ------
    InputError
        If the metric is unknown.

    See Also
    --------
    intaglio.weave, intaglio.quilt, intaglio.grow, intaglio.synthesize : Take it as ``match``.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, sections 6.2.1 and 6.2.3.

    Examples
    --------
    Colours are copied, but only their sum is compared:

    >>> import numpy as np
    >>> import intaglio
    >>> sample = np.stack([np.eye(24), 1 - np.eye(24)], axis=2)
    >>> match = intaglio.Match(maps=sample.sum(axis=2), metric="squared")
    >>> intaglio.quilt(sample, 30, block=8, match=match, device="cpu").maps.shape
    (30, 30, 2)
    """

    maps: Any = None
    weights: Sequence[float] | Array | None = None
    metric: str = "absolute"

    def __post_init__(self) -> None:
        # Pixels that are masked out may be NaN.
        check_fields(self, nan=True)
        checked_choice("metric", self.metric, METRICS)
        if self.maps is not None:
            object.__setattr__(self, "maps", self.maps if isinstance(self.maps, Relightable) else stack_maps(self.maps))


def as_match(match: Any) -> Match:
    """Return what ``match`` stands for: a `Match` as it is, and maps, or None, as one that compares them."""
    return match if isinstance(match, Match) else Match(None if match is None else stack_maps(match, "match"))


@dataclass(frozen=True)
class SampleMaps:
    """A sample split into what is copied and what is compared.

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
    """Return what is compared of a relightable texture, (H, W, n); heights and confidence follow from it.

    Of kind ``"gradient"`` slopes and albedo (the thesis, section 6.2.2 and table 6.2.1), of others their maps; and chromaticity.
    """
    if texture.kind != "gradient":
        return texture_planes(replace(texture, height=None, confidence=None))
    maps = surface_maps(texture)
    usable = np.ones(maps.valid.shape, bool) if texture.mask is None else texture.mask
    slopes = [_without_outliers(plane, usable) for plane in (maps.p, maps.q)]
    planes = [*slopes, maps.albedo, *([] if texture.chroma is None else [texture.chroma])]
    return np.concatenate([p.reshape(*maps.valid.shape, -1).astype(np.float32) for p in planes], axis=2)


def _without_outliers(slope: Array, usable: Array) -> Array:
    """Return slopes without the few that lie so far out that the range of all others would shrink to nothing."""
    low, high = np.percentile(slope[usable], [0.1, 99.9]) if usable.any() else (0.0, 0.0)
    reach = _FAR * (high - low)
    return np.clip(slope, low - reach, high + reach) if reach > 0 else slope


def stack_maps(maps: Any, name: str = "maps") -> Array:
    """Return ``maps`` as (H, W, n): an array (H, W) or (H, W, n), a `Relightable`, a `Material`, or several arrays of one size.

    Raises
    ------
    InputError
        If it is none of these, is empty, or its parts differ in size.
    """
    if isinstance(maps, Relightable):
        return texture_planes(maps)
    if isinstance(maps, Material):
        return maps.values
    if isinstance(maps, list | tuple):
        parts = [stack_maps(m, f"{name}[{i}]") for i, m in enumerate(maps)]
        if not parts:
            raise InputError(f"{name} is empty; give at least one map")
        sizes = {p.shape[:2] for p in parts}
        if len(sizes) > 1:
            listed = ", ".join(f"{h} x {w}" for h, w in (p.shape[:2] for p in parts))
            raise InputError(f"{name} differ in size: {listed} (rows x columns); give maps of one size")
        return np.concatenate(parts, axis=2)
    if isinstance(maps, np.ma.MaskedArray) and np.ma.is_masked(maps):
        raise InputError(f"{name} is a masked array; give its values, and the pixels that may be used as mask=~{name}.mask")
    array = real_array(name, maps)
    if array.ndim == 2:
        array = array[:, :, None]
    if array.ndim != 3:
        raise InputError(f"{name} must be (H, W) or (H, W, n), not {array.shape}")
    if array.size == 0:
        raise InputError(f"{name} is empty: {array.shape}")
    return array


def prepare_sample(maps: Any, *, mask: Array | None = None, match: Match | None = None) -> SampleMaps:
    """Check a sample and bring the values that are compared to equal range.

    Parameters
    ----------
    maps : (H, W) or (H, W, n) array, Relightable, Material, or sequence of arrays
    mask : (H, W) bool array, optional
        Pixels that may be used. The mask of a `Relightable`, or opaque pixels of a `Material`, are intersected with it.
    match : Match, optional
        What is compared, and its weights.

    Raises
    ------
    InputError
        For shapes that don't agree, values that are not finite, a mask that leaves nothing, or unusable weights.
    """
    match = Match() if match is None else match
    values = stack_maps(maps)
    usable = np.ones(values.shape[:2], bool)
    if isinstance(maps, Relightable) and maps.mask is not None:
        usable &= maps.mask
    if isinstance(maps, Material) and maps.opaque is not None:
        usable &= maps.opaque
    if mask is not None:
        usable &= checked_mask("mask", mask, usable.shape)
    if not usable.any():
        raise InputError("mask leaves no pixel of the sample; True marks pixels that may be used")
    if match.maps is not None:
        compared = stack_maps(match.maps, "match")
    else:
        compared = compared_planes(maps) if isinstance(maps, Relightable) else values
        compared = maps.compared if isinstance(maps, Material) else compared
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
    return SampleMaps(values, _equal_range(compared, usable, match.weights), usable)


def _equal_range(compared: Array, usable: Array, weights: Sequence[float] | Array | None) -> Array:
    """Return maps as (n, H, W) float32 planes from 0 to their weight, the largest being 1; 0 where not usable."""
    count = compared.shape[2]
    factor = np.ones(count) if weights is None else checked_numeric("weights", weights, np.float64)
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
