"""Measures of a synthesised texture: how similar it is to its sample, its seams, and repetition."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import fft, ndimage

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments
from intaglio.errors import InputError
from intaglio.photometric import Relightable
from intaglio.randomness import Stream, uniform
from intaglio.statistics import earth_movers_distance
from intaglio.synthesis.nearest import NearestWindows, rms_difference
from intaglio.synthesis.result import Synthesis, pixel_positions
from intaglio.synthesis.sample import SampleMaps, compared_planes, prepare_sample, stack_maps, window_starts

# The most windows whose nearest ones are searched for, and the most values of those they are searched among.
_QUERIES = 2000
_AMONG = 50_000_000
_WINDOW = 8

# The most pixels whose values are compared, evenly spread.
_VALUES = 100_000

# Directions along which joint distributions are compared.
_DIRECTIONS = 64


@dataclass(frozen=True)
class Likeness:
    """A result against its sample.

    Attributes
    ----------
    histogram : (n,) array
        Earth mover's distance of each map's values, in standard deviations of the sample; 0 for equal histograms.
    joint : float
        The same of all maps together: mean over directions through their space, each scaled to unit deviation.
    correlation : float
        Largest difference between the correlations of two maps; NaN if a map of the result lost all variation.
    spectrum : float
        Root mean square difference of the power spectra in decibels, over bands of an octave.
    coherence : float
        How far windows of the result are from the nearest of the sample, in units of the distance of any two of the sample's
        windows; 0: all are copies.
    completeness : float
        How far windows of the sample are from the nearest of the result, likewise; 0: nothing was left out.
    """

    histogram: Array
    joint: float
    correlation: float
    spectrum: float
    coherence: float
    completeness: float


@dataclass(frozen=True)
class SynthesisReport:
    """Measures of a synthesised texture, compared with its sample.

    Attributes
    ----------
    likeness : Likeness
        Similarity of the result to the sample, of the maps scaled to equal range: ``histogram`` (n,), ``joint``,
        ``correlation``, ``spectrum``, ``coherence`` and ``completeness``; 0 for equal ones.
    seam : float
        Mean step between neighbouring pixels from different places of the sample, over the mean step between others, of the
        maps scaled to equal range. 1: seams are like the texture itself. NaN if there is no seam.
    wrap : float
        Mean step between neighbours over the edge, over that of all neighbours inside, if the result is tileable; else NaN.
    seam_share : float
        Share of neighbouring pixels that come from different places, from 0 to 1.
    copy_side : float
        Side in pixels of a square as large as the mean piece that a pixel lies in, where a piece is copied as a whole.
    largest_copy : float
        Share of the result that the largest piece takes.
    used : float
        Share of the sample that appears in the result.
    repetition : float
        How often the most repeated tenth of the sample appears, over how often it would if all appeared equally often.
    relit : dict of str to Likeness
        For each light, similarity of the relit result to the relit sample.

    See Also
    --------
    intaglio.assess_synthesis : Computes it.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> sample = np.random.default_rng(0).random((24, 24)).round(3)
    >>> result = intaglio.quilt(sample, 32, block=8, seed=1, device="cpu")
    >>> report = intaglio.assess_synthesis(sample, result)
    >>> 0 < report.used <= 1, report.relit
    (True, {})
    """

    likeness: Likeness
    seam: float
    wrap: float
    seam_share: float
    copy_side: float
    largest_copy: float
    used: float
    repetition: float
    relit: dict[str, Likeness]

    def __post_init__(self) -> None:
        check_fields(self, nan=True)

    def lines(self) -> list[str]:
        """Return the figures as lines of text.

        Returns
        -------
        list of str
            Sentences for the user, one line each.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> sample = np.random.default_rng(0).random((24, 24)).round(3)
        >>> result = intaglio.quilt(sample, 32, block=8, seed=1, device="cpu")
        >>> lines = intaglio.assess_synthesis(sample, result).lines()
        >>> lines[1].startswith("copied pieces")
        True
        """
        seam = "no seam" if np.isnan(self.seam) else f"seam {self.seam:.2f} (1: none to be seen)"
        lines = [
            f"{seam}, {100 * self.seam_share:.1f} % of neighbours come from different places",
            *([] if np.isnan(self.wrap) else [f"over the wrap {self.wrap:.2f} times the jumps inside"]),
            f"copied pieces: {self.copy_side:.0f} pixels a side, the largest {100 * self.largest_copy:.1f} % of the result",
            f"{100 * self.used:.0f} % of the sample used; its most repeated tenth {self.repetition:.1f} times as often as evenly",
            _likeness_line("sample against result", self.likeness),
        ]
        return lines + [_likeness_line(name, likeness) for name, likeness in self.relit.items()]


def _likeness_line(name: str, found: Likeness) -> str:
    return (
        f"{name}: histograms {found.histogram.max():.3f}, joint {found.joint:.3f}, correlation {found.correlation:.3f}, "
        f"spectrum {found.spectrum:.1f} dB, coherence {found.coherence:.3f}, completeness {found.completeness:.3f}"
    )


@checked_arguments
def assess_synthesis(
    sample: Any, result: Synthesis, *, mask: Array | None = None, lights: dict[str, Array] | None = None
) -> SynthesisReport:
    """Measure a synthesised texture against its sample.

    Parameters
    ----------
    sample : (H, W) array, (H, W, n) array or Relightable
        The maps that were synthesised, or what was compared in their place, such as a photograph's gamma-encoded values; of
        these, copies are measured, not what joining pieces moved.
    result : Synthesis
        From `weave`, `quilt`, `grow` or `synthesize`.
    mask : (H, W) bool array, optional
        Pixels of the sample that could be used. Default None: all.
    lights : dict of str to (3,) array, optional
        Vectors towards lights, by name, under which sample and result are relit and compared; both must be relightable.
        Default None: none.

    Returns
    -------
    SynthesisReport
        Similarity to the sample, seams, copies and repetition.

    Raises
    ------
    InputError
        If the result was not made from such a sample, or lights are given and it can't be relit.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> sample = np.random.default_rng(0).random((24, 24)).round(3)
    >>> result = intaglio.quilt(sample, 32, block=8, seed=1, device="cpu")
    >>> report = intaglio.assess_synthesis(sample, result)
    >>> report.likeness.joint < 1, report.copy_side > 1
    (True, True)
    """
    if not isinstance(sample, Relightable):
        sample = stack_maps(sample, "sample")
    prepared = prepare_sample(sample, mask=mask)
    source = result.source
    if source.min() < 0 or (source.reshape(-1, 2).max(axis=0) >= prepared.usable.shape).any():
        raise InputError(f"the result copies pixels that a sample of {prepared.usable.shape} does not have")
    if not prepared.usable[source[..., 0], source[..., 1]].all():
        raise InputError("the result copies pixels that the mask leaves out; give the mask it was made with")
    features = np.moveaxis(prepared.features, 0, 2)
    laid = features[source[..., 0], source[..., 1]] + _moved_features(sample, prepared, result)
    seam, wrap, share = _measure_seams(laid, source, result.tileable)
    label = _label_pieces(source)
    size = np.bincount(label.ravel())
    times = np.bincount(
        source[..., 0].ravel() * prepared.usable.shape[1] + source[..., 1].ravel(), minlength=prepared.usable.size
    )
    usable_times = np.sort(times[prepared.usable.ravel()])[::-1]
    tenth = max(1, len(usable_times) // 10)
    relit = {}
    if lights:
        if result.texture is None or not isinstance(sample, Relightable):
            raise InputError("lights: sample and result must be relightable textures")
        for name, light in lights.items():
            images = [t.relight(light) for t in (sample, result.texture)]
            relit[f"under {name}"] = _measure_likeness(images[0], prepared.usable, images[1], source)
    return SynthesisReport(
        likeness=_measure_likeness(features, prepared.usable, laid, source),
        seam=seam,
        wrap=wrap,
        seam_share=share,
        copy_side=float(np.sqrt(np.mean(size[label]))),
        largest_copy=float(size.max() / source[..., 0].size),
        used=float((usable_times > 0).mean()),
        repetition=float(usable_times[:tenth].mean() / usable_times.mean()),
        relit=relit,
    )


def _moved_features(given: Any, sample: SampleMaps, result: Synthesis) -> Array:
    """Return (H, W, n) or 0: by how much joining pieces moved the sample's features; 0 where other maps than these were moved."""
    still = np.zeros(1, np.float32)
    if result.moved is None:
        return still
    if isinstance(given, Relightable):
        if result.texture is None or result.texture.kind != given.kind or given.kind == "height":
            return still
        before, now = compared_planes(given), compared_planes(result.texture)
    else:
        before, now = sample.maps, result.maps
        if now.shape[2] != before.shape[2]:
            return still
        copied = before[result.source[..., 0], result.source[..., 1]].astype(np.float64)
        if not np.allclose(now, copied + result.moved, rtol=1e-4, atol=1e-4 * float(np.abs(copied).max() or 1)):
            return still
    usable = before[sample.usable].astype(np.float64)
    spans = np.ptp(usable, axis=0)
    scales = np.ptp(sample.features[:, sample.usable], axis=1) / np.where(spans > 0, spans, 1)
    copied = before[result.source[..., 0], result.source[..., 1]].astype(np.float64)
    return np.asarray((now - copied) * scales, np.float32)


def _breaks(source: Array, axis: int) -> Array:
    """Return whether a pixel and the next along ``axis``, the last one's being the first, are neighbours in the sample."""
    step = np.roll(source, -1, axis) - source
    straight = np.array([1, 0]) if axis == 0 else np.array([0, 1])
    found: Array = (step != straight).any(axis=2)
    return found


def _measure_seams(values: Array, source: Array, tileable: bool) -> tuple[float, float, float]:
    """Return jumps across seams over jumps inside, the same for the wrap, and the share of seams."""
    seam, inside, wrap = [], [], []
    for axis in (0, 1):
        jump = np.abs(np.roll(values, -1, axis) - values).sum(axis=2)
        broken = _breaks(source, axis)
        last = np.zeros(broken.shape, bool)
        last[(slice(-1, None), slice(None)) if axis == 0 else (slice(None), slice(-1, None))] = True
        seam.append(jump[broken & ~last])
        inside.append(jump[~broken & ~last])
        wrap.append(jump[last])
    across, within, over = (np.concatenate(part) for part in (seam, inside, wrap))
    typical = float(within.mean()) if len(within) else float("nan")
    everywhere = float(np.concatenate([across, within]).mean()) if len(across) + len(within) else float("nan")

    def ratio(part: Array, base: float) -> float:
        if len(part) == 0 or np.isnan(base):
            return float("nan")
        mean = float(part.mean())
        return mean / base if base > 0 else (1.0 if mean == 0 else float("inf"))

    share = len(across) / max(1, len(across) + len(within))
    return ratio(across, typical), ratio(over, everywhere) if tileable else float("nan"), share


def _label_pieces(source: Array) -> Array:
    """Return (H, W) int: connected pieces of the result that are copied from one piece of the sample."""
    height, width = source.shape[:2]
    down, right = ~_breaks(source, 0)[:-1], ~_breaks(source, 1)[:, :-1]
    # Pixels lie on even rows and columns of a grid, the links between them on odd ones.
    grid = np.zeros((2 * height - 1, 2 * width - 1), bool)
    grid[::2, ::2] = True
    grid[1::2, ::2] = down
    grid[::2, 1::2] = right
    label, _ = ndimage.label(grid)
    found: Array = label[::2, ::2] - 1
    return found


def _measure_likeness(sample: Array, usable: Array, result: Array, source: Array) -> Likeness:
    """Compare images (H, W, n)."""
    given = _take_evenly(sample[usable], _VALUES).astype(np.float64)
    made = _take_evenly(result.reshape(-1, result.shape[2]), _VALUES).astype(np.float64)
    spread = given.std(axis=0)
    kept = spread > 0
    histogram = np.array([earth_movers_distance(made[:, c], given[:, c]) for c in range(given.shape[1])])
    joint = correlation = 0.0
    if kept.any():
        a = (given[:, kept] - given[:, kept].mean(axis=0)) / spread[kept]
        b = (made[:, kept] - given[:, kept].mean(axis=0)) / spread[kept]
        angles = uniform(0, Stream.SYNTHESIS_DIRECTIONS, np.arange(_DIRECTIONS)[:, None], np.arange(a.shape[1])[None, :]) - 0.5
        angles /= np.linalg.norm(angles, axis=1, keepdims=True)
        joint = float(np.mean([earth_movers_distance(b @ d, a @ d) for d in angles]))
        if a.shape[1] > 1:
            varies = bool((b.std(axis=0) > 0).all())
            correlation = float(np.abs(np.corrcoef(a.T) - np.corrcoef(b.T)).max()) if varies else float("nan")
    coherence, completeness = _measure_window_distances(sample, usable, result, source)
    return Likeness(histogram, joint, correlation, _measure_spectrum_difference(sample, usable, result), coherence, completeness)


def _measure_window_distances(sample: Array, usable: Array, result: Array, source: Array) -> tuple[float, float]:
    """Return mean distances of the result's windows to the nearest of the sample's, and the other way round.

    Of many windows an evenly spread part is searched; the place that a window's first pixel was copied from, or to, is always
    among them, so that what is copied is found.
    """
    side = min(_WINDOW, *usable.shape, *result.shape[:2])
    everywhere = np.ones(result.shape[:2], bool)
    own_starts, made_starts = (window_starts(mask, side) for mask in (usable, everywhere))
    if not own_starts.any():
        return float("nan"), float("nan")
    most = max(_QUERIES, _AMONG // (side * side * sample.shape[2]))
    own = _windows(sample, _take_evenly(np.argwhere(own_starts), most), side)
    made = _windows(result, _take_evenly(np.argwhere(made_starts), most), side)
    half = len(own) // 2
    typical = float(np.sqrt(np.mean((own[:half] - own[half : 2 * half]) ** 2))) if half else 0.0
    if typical == 0:
        return 0.0, 0.0
    copied_to = np.full((*usable.shape, 2), -1)
    copied_to[source[..., 0], source[..., 1]] = pixel_positions(everywhere.shape)

    def apart(image: Array, starts: Array, among: Array, other: Array, other_starts: Array, place: Array) -> float:
        corner = _take_evenly(np.argwhere(starts), _QUERIES)
        query = _windows(image, corner, side)
        distance = rms_difference(among[NearestWindows(among).find(query)], query)
        there = place[corner[:, 0], corner[:, 1]]
        inside = ((there >= 0) & (there < other_starts.shape)).all(axis=1)
        inside[inside] = other_starts[tuple(there[inside].T)]
        away = rms_difference(_windows(other, there[inside], side), query[inside])
        distance[inside] = np.minimum(distance[inside], away)
        return float(distance.mean()) / typical

    return (
        apart(result, made_starts, own, sample, own_starts, source),
        apart(sample, own_starts, made, result, made_starts, copied_to),
    )


def _take_evenly(rows: Array, most: int) -> Array:
    """Return at most so many rows, evenly spread."""
    return rows[np.linspace(0, len(rows) - 1, min(len(rows), most)).astype(int)]


def _windows(image: Array, corner: Array, side: int) -> Array:
    """Return windows (M, side² n) that begin at ``corner`` (M, 2)."""
    at = np.arange(side)
    y, x = corner[:, 0, None, None] + at[None, :, None], corner[:, 1, None, None] + at[None, None, :]
    return np.ascontiguousarray(image[y, x].reshape(len(corner), side * side * image.shape[2]), np.float32)


def _measure_spectrum_difference(sample: Array, usable: Array, result: Array) -> float:
    """Return the rms difference in decibels of power per octave, over all maps; only wavelengths that both can hold."""
    longest = min(*usable.shape, *result.shape[:2]) / 2
    bounds = 2.0 ** np.arange(1, 16)
    bounds = bounds[bounds <= max(longest, 4)]
    made = _band_power(result, np.ones(result.shape[:2], bool), bounds)
    given = _band_power(sample, usable, bounds)
    both = (made > 0) & (given > 0)
    if not both.any():
        return 0.0
    return float(np.sqrt(np.mean((10 * np.log10(made[both] / given[both])) ** 2)))


def _band_power(image: Array, usable: Array, bounds: Array) -> Array:
    """Return power per pixel (n, bands) between wavelengths ``bounds``, under a Hann window."""
    height, width = usable.shape
    window = np.hanning(height + 2)[1:-1, None] * np.hanning(width + 2)[None, 1:-1] * usable
    frequency = np.hypot(fft.fftfreq(height)[:, None], fft.rfftfreq(width)[None, :])
    frequency[0, 0] = 1e-9
    band = np.digitize(1 / frequency, bounds)
    rows = []
    for c in range(image.shape[2]):
        plane = np.where(usable, image[:, :, c], 0).astype(np.float64)
        plane = (plane - plane[usable].mean()) * window
        power = np.abs(fft.rfft2(plane)) ** 2 / (window**2).sum()
        # Mean per mode: images of different size have different numbers of modes in a band.
        sums = np.bincount(band.ravel(), power.ravel(), len(bounds) + 1)
        modes = np.maximum(np.bincount(band.ravel(), minlength=len(bounds) + 1), 1)
        rows.append((sums / modes)[1 : len(bounds)])
    return np.array(rows)
