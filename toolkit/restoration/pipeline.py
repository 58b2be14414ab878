"""Filling what is missing of an image: structure by diffusion, detail by synthesis (Yamauchi et al. 2005, section 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_choice, checked_count, checked_number
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.pull_push import continued
from intaglio.restoration.fill import fill, whole_neighbourhoods
from intaglio.restoration.frequency import MOST_SUBBANDS, chosen_kappa, low_band
from intaglio.restoration.inpaint import inpaint
from intaglio.restoration.poisson import corrected
from intaglio.synthesis import SIDES, SampleMaps, checked_mask, refined

# Windows of the known part that the filled one is matched with.
_MOST_WINDOWS = 8_000

# Fine contrast is what a Gaussian of so many pixels takes away; surroundings are weighed by one of so many; and it is changed by
# no more than this factor.
_FINE, _SURROUNDINGS, _MOST_CONTRAST = 2.0, 24.0, 1.25

METHODS = ("split", "inpaint", "synthesize")


@dataclass(frozen=True)
class Restoration:
    """A restored image, and how it came about.

    Attributes
    ----------
    image : (H, W) or (H, W, C) array
        Of the given image's type; known pixels have its bits.
    missing : (H, W) bool array
        What was filled.
    source : (H, W, 2) int32 array
        Row and column of the pixel whose detail each pixel carries: itself where known. All themselves for inpainting alone.
    low : (H, W) or (H, W, C) float64 array
        The low band, with its missing part inpainted; zero for synthesis alone.
    kappa : int
        Number of subbands in it.
    notes : tuple of str
    """

    image: Array
    missing: Array
    source: Array
    low: Array
    kappa: int
    notes: tuple[str, ...] = ()


def restore(image: Array, missing: Array, method: str = "split", **options: Any) -> Array:
    """Fill the missing pixels of an image; see `restore_in_detail`, which also tells how, for all options.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Values in the missing pixels may be anything.
    missing : (H, W) bool array
        True where to fill.
    method : {"split", "inpaint", "synthesize"}
        Both bands, each by the method that suits it; or one method for the whole image.

    Returns
    -------
    array
        Of the image's shape and type; known pixels unchanged to the bit.

    Examples
    --------
    >>> import numpy as np
    >>> image = np.full((32, 32), 0.5, np.float32)
    >>> hole = np.zeros((32, 32), bool)
    >>> hole[10:20, 12:18] = True
    >>> bool(np.allclose(restore(np.where(hole, 0, image), hole), 0.5))
    True
    """
    return restore_in_detail(image, missing, method, **options).image


def restore_in_detail(
    image: Array,
    missing: Array,
    method: str = "split",
    *,
    kappa: int | None = None,
    levels: int = 3,
    coherence: float = 10.0,
    rotations: bool = False,
    refine: int = 1,
    seams: bool | None = None,
    barriers: Array | None = None,
    inside: Array | None = None,
    device: str | None = None,
    progress: Progress | None = None,
) -> Restoration:
    """Fill the missing pixels of an image, and tell how.

    The image is split by a cosine transform. What is missing of the low band, its large structures and gradients, is inpainted
    by diffusion; what is missing of the high band, its detail, is synthesised from the known part, neighbourhood by
    neighbourhood, on a Gaussian pyramid. The sum is the result.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Of floats or integers, in the values that should look alike: display values rather than linear ones.
    missing : (H, W) bool array
    method : {"split", "inpaint", "synthesize"}
    kappa : int, optional
        Number of subbands of the low band, 0 to 512. Default: the lowest that leaves the high band homogeneous.
    levels : int
        Of the pyramid, 1 to 6: the paper's n + 1.
    coherence : float
        Weight of continuing what neighbours copy over taking the nearest neighbourhood, 0 to 100 (Hertzmann et al. 2001).
    rotations : bool
        Also compare with neighbourhoods turned by quarters and mirrored.
    refine : int
        Passes of texture optimisation over the filled region, with windows of 8 pixels, 0 to 10; 0: the paper's synthesis alone.
    seams : bool, optional
        Fit filled pixels to the known ones around them by their sources' differences (Poisson). Default: for the split; it
        diffuses what is known, which synthesis alone does not.
    barriers : (H, W) bool array, optional
        Pixels that give no colour when diffusing, so that an edge stays an edge (two pixels wide to hold diagonally).
    inside : (H, W) bool or int array, optional
        Pixels that belong to the image, or the number of the chart they belong to, 0 for none. What is outside neither gives
        nor takes, stays as it is, and neighbourhoods don't leave their chart.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``; default CUDA if there is one.
    progress : callable, optional
        Called with pixels done and all, of all levels of the synthesis.

    Raises
    ------
    InputError
        For shapes that don't fit, known values that are not finite, a mask that covers everything, or options out of range.

    References
    ----------
    Yamauchi et al., Textures revisited (2005), section 5. Oliveira et al., Fast digital image inpainting (2001). Hertzmann et
    al., Image analogies (2001). Pérez et al., Poisson image editing (2003).
    """
    checked_choice("method", method, METHODS)
    levels = checked_count("levels", levels, 1, 6)
    refine = checked_count("refine", refine, 0, 10)
    coherence = checked_number("coherence", coherence, 0, 100)
    if kappa is not None:
        kappa = checked_count("kappa", kappa, 0, 512)
    chosen = device_or_error(device)
    given = _checked_image(image)
    shape = given.shape[:2]
    hole = checked_mask("missing", missing, shape)
    stops = None if barriers is None else checked_mask("barriers", barriers, shape)
    chart = _checked_charts(inside, shape)
    usable = chart > 0
    hole = hole & usable
    known = usable & ~hole
    if not known.any():
        raise InputError("missing covers everything; there is nothing left to restore from")
    values = given.reshape(*shape, -1)
    bad = ~np.isfinite(values).all(axis=2) & known
    if bad.any():
        y, x = np.argwhere(bad)[0]
        raise InputError(f"{int(bad.sum())} known pixels are not finite, the first in row {y}, column {x}; mark them missing")
    here = np.moveaxis(np.indices(shape), 0, 2).astype(np.int32)
    if not hole.any():
        return Restoration(given.copy(), hole, here, np.zeros(given.shape), 0, ("nothing is missing",))

    # Brought to a range of 1, so that tolerances mean the same for all images.
    low_end, high_end = float(values[known].min()), float(values[known].max())
    if not np.isfinite(high_end - low_end):
        raise InputError(
            f"the image's values reach from {low_end:.3g} to {high_end:.3g}, too far for the computation; scale them"
        )
    span = high_end - low_end or 1.0
    exact = np.where(known[:, :, None], values, low_end).astype(np.float64)
    scaled = ((exact - low_end) / span).astype(np.float32)
    smooth = inpaint(scaled, hole, chart=chart, barriers=stops)
    notes: list[str] = []
    if method != "inpaint" and not whole_neighbourhoods(known, chart).any():
        notes.append("no 5 x 5 pixels are known together, there is nothing to synthesise from: inpainted")
        method = "inpaint"
    result, low, source, bands = smooth, smooth, here, MOST_SUBBANDS
    if method != "inpaint":
        # Transforms see the whole rectangle: outside, the nearest colours go on.
        whole = continued(smooth, usable, chosen)
        bands = 0
        if method == "split":
            bands = chosen_kappa(whole) if kappa is None else kappa
            notes.append(f"low band: {bands} subbands" + (", chosen by the high band's autocorrelation" if kappa is None else ""))
        low = low_band(whole, bands)
        high = whole - low
        if bands:
            low = inpaint(low, hole, chart=chart, barriers=stops)
        source, turn = fill(
            np.where(hole[:, :, None], 0 if bands else high, high),
            hole,
            chart,
            levels=levels,
            coherence=coherence,
            rotations=rotations,
            progress=progress,
        )
        grown = np.where(source < 0, here, source)
        source = _refined(high, known, grown, hole, refine, notes)
        # Optimisation compares and copies windows as they are.
        turn = np.where((source == grown).all(axis=2), turn, 0)
        detail = high[source[:, :, 0], source[:, :, 1]]
        if seams or (seams is None and method == "split"):
            detail = corrected(detail, high, source, turn, hole, chart)
        result = low + _contrast_of_surroundings(detail, hole, known)
    filled = _as_given(result.astype(np.float64) * span + low_end, given, low_end, high_end)
    image_out = given.copy().reshape(values.shape)
    image_out[hole] = filled[hole]
    return Restoration(
        image=image_out.reshape(given.shape),
        missing=hole,
        source=source,
        low=(low.astype(np.float64) * span + (low_end if bands else 0)).reshape(given.shape),
        kappa=bands,
        notes=tuple(notes),
    )


def _refined(high: Array, known: Array, source: Array, hole: Array, passes: int, notes: list[str]) -> Array:
    """Return the provenance after texture optimisation over the hole."""
    if passes == 0:
        return source
    rows, columns = np.nonzero(hole)
    # Optimisation is local: a frame about the hole that holds the largest window is enough.
    top, bottom = max(rows.min() - SIDES[0], 0), min(rows.max() + SIDES[0] + 1, hole.shape[0])
    left, right = max(columns.min() - SIDES[0], 0), min(columns.max() + SIDES[0] + 1, hole.shape[1])
    frame = (slice(top, bottom), slice(left, right))
    sample = SampleMaps(high, np.ascontiguousarray(np.moveaxis(high, 2, 0)), known)
    better, sides = refined(
        sample,
        source[frame],
        block=SIDES[-1],
        passes=passes,
        tileable=False,
        keep=~hole[frame],
        most=_MOST_WINDOWS,
        relative=True,
    )
    result = source.copy()
    result[frame] = np.where(hole[frame][:, :, None], better, source[frame])
    if sides:
        notes.append(f"refined by windows of {', '.join(map(str, sides))} pixels")
    return result


def _contrast_of_surroundings(detail: Array, hole: Array, known: Array) -> Array:
    """Return the band with its filled part brought to the fine contrast that the known part around it has.

    Matching prefers what fits, and what fits best has often a little less contrast than what it should fit.
    """
    smooth = np.stack([ndimage.gaussian_filter(plane, _FINE) for plane in np.moveaxis(detail, 2, 0)], axis=2)
    fine = detail - smooth
    energy = np.sum(fine**2, axis=2)

    def around(mask: Array) -> Array:
        weight = ndimage.gaussian_filter(mask.astype(np.float32), _SURROUNDINGS)
        total = ndimage.gaussian_filter(np.where(mask, energy, 0), _SURROUNDINGS)
        near = weight > 1e-3
        mean = total / np.maximum(weight, 1e-6)
        if near.all() or not near.any():
            return np.asarray(mean)
        # Deep inside a hole nothing known is near: what is nearest counts.
        rows, columns = ndimage.distance_transform_edt(~near, return_distances=False, return_indices=True)
        return np.asarray(mean[rows, columns])

    # Next to the border, differences reach across it.
    outer = known & ~ndimage.binary_dilation(hole, iterations=2)
    factor = np.sqrt(around(outer) / np.maximum(around(hole), 1e-12))
    factor = np.clip(factor, 1 / _MOST_CONTRAST, _MOST_CONTRAST)
    return np.where(hole[:, :, None], smooth + factor[:, :, None] * fine, detail).astype(np.float32)


def _checked_image(image: Array) -> Array:
    try:
        array = np.asarray(image)
    except (TypeError, ValueError) as problem:
        raise InputError(f"image is no array of numbers ({problem})") from problem
    if array.dtype.kind not in "fiu":
        raise InputError(f"image must hold real numbers, not {array.dtype}")
    if array.dtype.kind in "iu" and array.dtype.itemsize == 8 and array.size and np.abs(array.astype(np.float64)).max() > 2**53:
        raise InputError("image holds integers beyond 2^53, which can't be told apart in the computation; scale them")
    if array.ndim not in (2, 3) or array.size == 0 or (array.ndim == 3 and array.shape[2] > 16):
        raise InputError(f"image must be (H, W) or (H, W, C) with at most 16 channels, not {array.shape}")
    return array


def _checked_charts(inside: Array | None, shape: tuple[int, ...]) -> Array:
    """Return the number of each pixel's chart, (H, W) int32."""
    if inside is None:
        return np.ones(shape, np.int32)
    try:
        array = np.asarray(inside)
    except ValueError as problem:
        raise InputError(f"inside is no array ({problem})") from problem
    if array.shape != tuple(shape) or array.dtype.kind not in "bui":
        raise InputError(f"inside must be bool or integers of shape {tuple(shape)}, not {array.dtype} {array.shape}")
    if array.dtype.kind == "i" and array.size and array.min() < 0:
        raise InputError("inside must hold chart numbers from 1, and 0 outside; it has negative ones")
    labels, number = np.unique(array, return_inverse=True)
    # Numbered anew: labels may be of any size.
    return number.reshape(array.shape).astype(np.int32) + (0 if labels[0] == 0 else 1)


def _as_given(values: Array, given: Array, low: float, high: float) -> Array:
    """Return values of the given image's type; integers are rounded and held to their range."""
    if given.dtype.kind in "iu":
        return np.clip(np.rint(values), low, high).astype(given.dtype)
    # A sum of two bands can leave the known range a little; light below zero, or far above, would be no colour.
    return np.clip(values, low, high).astype(given.dtype)
