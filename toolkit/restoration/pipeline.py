"""Filling what is missing of an image: by coherent pieces, or as Yamauchi et al. (2005, section 5) do, by two bands."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array, Progress
from intaglio.checks import (
    check_fields,
    checked_arguments,
    checked_choice,
    checked_count,
    checked_mask,
    checked_number,
    checked_shape,
)
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.patch_match import SIDE
from intaglio.kernels.pull_push import continue_image
from intaglio.randomness import checked_seed
from intaglio.restoration.coherent import fill_by_pieces, whole_patches
from intaglio.restoration.fill import find_whole_neighborhoods, synthesize_hole
from intaglio.restoration.frequency import MOST_SUBBANDS, choose_kappa, low_band
from intaglio.restoration.inpaint import inpaint
from intaglio.restoration.plate import fill_with_plate, thin_part
from intaglio.restoration.poisson import fit_to_surroundings
from intaglio.restoration.trial import Filler, first_is_better
from intaglio.synthesis import SIDES, SampleMaps, optimize_texture

# The most windows of the known part that the filled part is matched with.
_MOST_WINDOWS = 8_000

# Fine contrast is what a Gaussian of _FINE pixels removes; the contrast of the surroundings is weighted by a Gaussian of
# _SURROUNDINGS pixels; the contrast changes by a factor of at most _MOST_CONTRAST.
_FINE, _SURROUNDINGS, _MOST_CONTRAST = 2.0, 24.0, 1.25

# How far what differs at a hole's rim is carried into its copies, in pixels.
_REACH = 30.0

METHODS = ("auto", "weave", "split", "inpaint", "synthesize")


@dataclass(frozen=True)
class Restoration:
    """A restored image, with its provenance.

    Attributes
    ----------
    image : (H, W) or (H, W, C) array
        The restored image, of the given image's type; known pixels have the given bits.
    missing : (H, W) bool array
        The pixels that were filled.
    source : (H, W, 2) int32 array
        Row and column of the pixel that each pixel copies, or whose detail it carries; known pixels carry their own, and so do
        those of thin damage, and with inpainting alone all.
    low : (H, W) or (H, W, C) float64 array
        The low band, with its missing part inpainted; zero where there is none.
    kappa : int
        Number of subbands in the low band.
    notes : tuple of str
        What was chosen, in words.

    Raises
    ------
    InputError
        If an array is of another type or shape.

    See Also
    --------
    intaglio.restore : Makes one.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> ramp = np.tile(np.linspace(0, 1, 24), (24, 1))
    >>> hole = np.zeros(ramp.shape, bool)
    >>> hole[8:14, 9:15] = True
    >>> restored = intaglio.restore(ramp, hole, "inpaint", device="cpu")
    >>> bool(np.allclose(restored.image, ramp, atol=1e-5))
    True
    """

    image: Array
    missing: Array
    source: Array
    low: Array
    kappa: int
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self)
        if self.image.ndim not in (2, 3):
            raise InputError(f"image must be (H, W) or (H, W, C), not {self.image.shape}")
        shape = self.image.shape[:2]
        for name, value in (
            ("missing", checked_mask("missing", self.missing, shape)),
            ("source", checked_shape("source", self.source, np.int32, (*shape, 2))),
        ):
            object.__setattr__(self, name, value)


@checked_arguments
def restore(
    image: Array,
    missing: Array,
    method: str = "auto",
    *,
    kappa: int | None = None,
    levels: int = 3,
    coherence: float = 10.0,
    orientations: int = 1,
    refine: int = 1,
    seams: bool | None = None,
    barriers: Array | None = None,
    inside: Array | None = None,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> Restoration:
    """Fill the missing pixels of an image.

    By default thin damage is bridged by a thin plate, and holes are filled by coherent pieces of the known part: from coarse
    to fine, patches over a hole are matched to it and vote, pixels are copied from where they point, and pieces are fitted to
    each other and to the rim by their differences.

    With "split", as published, the image is split into two bands by a cosine transform. The missing part of the low band, its
    large structures and gradients, is inpainted by diffusion; that of the high band, its detail, is synthesised from the known
    part, neighbourhood by neighbourhood, on a Gaussian pyramid. The sum is the result.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Floats or integers, at most 16 channels; display values rather than linear ones, so that equal differences are equally
        visible. Missing pixels may hold anything.
    missing : (H, W) bool array
        The pixels to fill.
    method : {"auto", "weave", "split", "inpaint", "synthesize"}, optional
        "weave": coherent pieces; "split": both bands, each by the method that suits it, as published; "inpaint" and
        "synthesize": one of the latter's methods for the whole image. "auto", the default: damage under 11 pixels wide by a
        thin plate through its two sides, the rest by "weave"; where copies are clearly nearer to what is known, on damage of
        the same shape laid beside it, all by "weave". Where one of the next five options is given, "split" takes its place.
    kappa : int, optional
        Number of subbands in the low band, 0 to 512; a subband is half a cycle over the longer side. Only for "auto" and "split".
        Default None: the smallest number that leaves the high band homogeneous.
    levels : int, optional
        Levels of the pyramid of "split" and "synthesize", 1 to 6; n + 1 in section 5.4.
    coherence : float, optional
        Preference for continuing what neighbours copy over the nearest neighbourhood, 0 to 100; kappa in Hertzmann et al.
    orientations : {1, 8}, optional
        1 compares with neighbourhoods as they are, 8 also with those turned by quarters and mirrored. Default 1, since most
        textures have an up and a down.
    refine : int, optional
        Passes of texture optimisation over the filled region, with windows of 8 pixels, 0 to 10. 0 is the synthesis as
        published.
    seams : bool, optional
        Fit the filled pixels to the known ones around them by the differences of their sources (Poisson). Default None: not
        for "synthesize", which neither diffuses nor moves what it copies.
    barriers : (H, W) bool array, optional
        Pixels across which nothing diffuses, so that an edge stays an edge; a slanted line must be two pixels wide. Default
        None: there are none.
    inside : (H, W) bool or int array, optional
        Pixels that belong to the image, or the number of the chart to which each belongs, 0 for none. Pixels outside are
        neither used nor changed, and neighbourhoods don't leave their chart. Default None: the whole image is one chart.
    seed : int, optional
        Of "weave": the same seed gives the same bits.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the amount done and the total.

    Returns
    -------
    Restoration
        ``.image`` has the shape and type of the given image, and the bits of its known pixels.

    Raises
    ------
    InputError
        For shapes that don't agree, known values that are not finite, a mask that covers everything, and options out of
        range.

    See Also
    --------
    intaglio.restore_texture : The same for the texture of a surface.
    intaglio.assess_restoration : How well the result fits its surroundings.

    References
    ----------
    Wexler, Shechtman & Irani, "Space-Time Completion of Video", PAMI 29, 2007: the vote. Barnes et al., "PatchMatch",
    SIGGRAPH 2009. Newson et al., "Video Inpainting of Complex Scenes", SIAM J. Imaging Sci. 7, 2014: texture features. Criminisi
    et al., "Region Filling and Object Removal", IEEE TIP 13, 2004: the second start.
    Yamauchi et al., "Textures Revisited", The Visual Computer 21, 2005, section 5. Oliveira et al., "Fast Digital Image
    Inpainting", VIIP 2001, section 3. Hertzmann et al., "Image Analogies", SIGGRAPH 2001, section 3. Pérez et al.,
    "Poisson Image Editing", SIGGRAPH 2003.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> image = np.full((32, 32), 0.5, np.float32)
    >>> hole = np.zeros((32, 32), bool)
    >>> hole[10:20, 12:18] = True
    >>> restored = intaglio.restore(np.where(hole, 0, image), hole, device="cpu")
    >>> bool(np.allclose(restored.image, 0.5))
    True
    """
    checked_choice("method", method, METHODS)
    levels = checked_count("levels", levels, 1, 6)
    refine = checked_count("refine", refine, 0, 10)
    coherence = checked_number("coherence", coherence, 0, 100)
    if checked_count("orientations", orientations, 1, 8) not in (1, 8):
        raise InputError(f"orientations must be 1 (as they are) or 8 (turned and mirrored, too), not {orientations!r}")
    if kappa is not None:
        kappa = checked_count("kappa", kappa, 0, 512)
    seed = checked_seed(seed)
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
    notes: list[str] = []
    bridged = method == "auto"
    if bridged:
        method = "weave" if kappa is None and (levels, coherence, orientations, refine) == (3, 10.0, 1, 1) else "split"
    thin = thin_part(hole) if bridged else np.zeros_like(hole)
    # What is filled by pieces needs nothing smooth, and gives nothing to thin damage.
    first, within = (thin, np.where(hole & ~thin, 0, chart)) if method == "weave" else (hole, chart)
    smooth = inpaint(scaled, first, chart=within, barriers=stops) if first.any() else scaled
    if thin.any():

        def copied(part: Array, gone: Array, charts: Array) -> Array:
            return restore(
                part,
                gone,
                method,
                kappa=kappa,
                levels=levels,
                coherence=coherence,
                orientations=orientations,
                refine=refine,
                seams=seams,
                inside=charts,
                seed=seed,
                device=chosen,
            ).image

        smooth, thin = _fill_thin(smooth, hole, thin, within, stops, copied, notes)
        method = "inpaint" if (thin == hole).all() else method
    if method != "inpaint":
        side, starts = (SIDE, whole_patches(known, chart)) if method == "weave" else (5, find_whole_neighborhoods(known, chart))
        if not starts.any():
            notes.append(f"no {side} x {side} neighbourhood is known, so there is nothing to synthesise from: inpainted instead")
            method = "inpaint"
            smooth = inpaint(smooth, hole & ~thin, chart=chart, barriers=stops)
    result, low, source, bands = smooth, smooth, here, MOST_SUBBANDS
    if method == "weave":
        open_ = hole & ~thin
        source, how = fill_by_pieces(smooth, open_, known, chart, barriers=stops, seed=seed, device=chosen, progress=progress)
        notes.append(how)
        result, low, bands = smooth[source[:, :, 0], source[:, :, 1]], np.zeros_like(smooth), 0
        if seams is not False:
            straight = np.zeros(hole.shape, np.int64)
            result = fit_to_surroundings(result, smooth, source, straight, open_, chart, reach=_REACH)
    elif method != "inpaint":
        # The transform needs the whole rectangle: outside, the nearest colours continue.
        whole = continue_image(smooth, usable, chosen)
        bands = 0
        if method == "split":
            bands = choose_kappa(whole) if kappa is None else kappa
            notes.append(f"low band: {bands} subbands" + (", chosen by the high band's autocorrelation" if kappa is None else ""))
        low = low_band(whole, bands)
        high = whole - low
        if bands:
            low = inpaint(low, hole, chart=chart, barriers=stops)
        source, turn = synthesize_hole(
            np.where(hole[:, :, None], 0 if bands else high, high),
            hole,
            chart,
            levels=levels,
            coherence=coherence,
            orientations=orientations,
            progress=progress,
        )
        grown = np.where(source < 0, here, source)
        source = _optimize_hole(high, known, grown, hole, refine, notes)
        # Texture optimisation compares and copies windows unturned.
        turn = np.where((source == grown).all(axis=2), turn, 0)
        detail = high[source[:, :, 0], source[:, :, 1]]
        if seams or (seams is None and method == "split"):
            detail = fit_to_surroundings(detail, high, source, turn, hole, chart)
        result = low + match_contrast(detail, hole, known)
    # Detail is copied from what is known alone: thin damage is no sample, and takes none.
    result = np.where(thin[:, :, None], smooth, result)
    source = np.where(thin[:, :, None], here, source)
    filled = _restore_type(result.astype(np.float64) * span + low_end, given, low_end, high_end)
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


def _fill_thin(
    smooth: Array, hole: Array, thin: Array, chart: Array, stops: Array | None, copied: Filler, notes: list[str]
) -> tuple[Array, Array]:
    """Return the image with its thin damage filled, and which pixels that are: none where copies are nearer, by trial."""

    def plated(part: Array, gone: Array, charts: Array) -> Array:
        return fill_with_plate(inpaint(part, gone, chart=charts), gone, chart=charts)

    if not first_is_better(smooth, hole, thin, chart, plated, copied):
        notes.append("thin damage is copied as the rest is: that was nearer to what is known, by trial")
        return smooth, np.zeros_like(thin)
    notes.append(f"{int(thin.sum())} of {int(hole.sum())} missing pixels are thin damage, filled by a plate through its sides")
    return fill_with_plate(smooth, thin, chart=chart, barriers=stops), thin


def _optimize_hole(high: Array, known: Array, source: Array, hole: Array, passes: int, notes: list[str]) -> Array:
    """Return the provenance after texture optimisation over the hole."""
    if passes == 0:
        return source
    rows, columns = np.nonzero(hole)
    # Optimisation is local: a frame about the hole that holds the largest window is enough.
    top, bottom = max(rows.min() - SIDES[0], 0), min(rows.max() + SIDES[0] + 1, hole.shape[0])
    left, right = max(columns.min() - SIDES[0], 0), min(columns.max() + SIDES[0] + 1, hole.shape[1])
    frame = (slice(top, bottom), slice(left, right))
    sample = SampleMaps(high, np.ascontiguousarray(np.moveaxis(high, 2, 0)), known)
    better, sides = optimize_texture(
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


def match_contrast(detail: Array, hole: Array, known: Array) -> Array:
    """Return the band with the fine contrast of its filled part scaled to that of the known part around it.

    Matching prefers what fits best, and that often has a little less contrast than its surroundings.
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
        # Deep inside a hole no known pixel has any weight: the nearest mean counts.
        rows, columns = ndimage.distance_transform_edt(~near, return_distances=False, return_indices=True)
        return np.asarray(mean[rows, columns])

    # Next to the border, the fine contrast contains differences across it.
    outer = known & ~ndimage.binary_dilation(hole, iterations=2)
    factor = np.sqrt(around(outer) / np.maximum(around(hole), 1e-12))
    factor = np.clip(factor, 1 / _MOST_CONTRAST, _MOST_CONTRAST)
    return np.where(hole[:, :, None], smooth + factor[:, :, None] * fine, detail).astype(np.float32)


def _checked_image(image: Array) -> Array:
    try:
        array = np.asarray(image)
    except (TypeError, ValueError) as problem:
        raise InputError(f"image is not an array of numbers ({problem})") from problem
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
        raise InputError(f"inside is not an array ({problem})") from problem
    if array.shape != tuple(shape) or array.dtype.kind not in "bui":
        raise InputError(f"inside must be bool or integers of shape {tuple(shape)}, not {array.dtype} {array.shape}")
    if array.dtype.kind == "i" and array.size and array.min() < 0:
        raise InputError("inside must hold chart numbers from 1 and 0 outside, but it has negative ones")
    labels, number = np.unique(array, return_inverse=True)
    # Numbered anew: labels may be of any size.
    return number.reshape(array.shape).astype(np.int32) + (0 if labels[0] == 0 else 1)


def _restore_type(values: Array, given: Array, low: float, high: float) -> Array:
    """Return values in the type of the given image, clipped to the known range; integers are rounded."""
    if given.dtype.kind in "iu":
        return np.clip(np.rint(values), low, high).astype(given.dtype)
    # The sum of two bands can leave the known range a little, even below zero, which is no colour.
    return np.clip(values, low, high).astype(given.dtype)
