"""The figures of an assessed completion, and how they are put into words."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields
from intaglio.relief.roughness import BANDS

# Roughness against the surroundings outside these bounds is said in words, and so are less coherence and more use of one place.
_LOW, _HIGH = 0.8, 1.25
_COHERENT, _EVEN = 0.85, 3.0
# Fillings that are listed one by one.
_LISTED = 8
BAND_NAMES = (f"up to {BANDS[0]:g}", *(f"{a:g} to {b:g}" for a, b in pairwise(BANDS)))
RING_NAMES = ("at the rim", "halfway to the middle", "in the middle")


@dataclass(frozen=True)
class TruthComparison:
    """Differences between a completion and the known surface.

    Attributes
    ----------
    difference : (N,) float64 array
        Relief minus true relief over the same base point, in the input's unit; NaN where the truth has no surface.
    rms : float
        Root mean square difference over the filled vertices, in the input's unit.
    measured_rms : float
        Root mean square difference over the measured vertices, which is the scan's own noise; NaN if the truth covers none.
    msi : float
        Mean surface integral of the truth at the filled vertices, in the input's unit.
    msi_percent : float
        Difference of the filled part's mean surface integral from the truth's, in percent of the truth's.
    displacement_emd : float
        Earth mover's distance between filled and true displacements, in standard deviations of the true ones.
    coverage : float
        Share of the filled vertices over which the truth has a surface, from 0 to 1.
    distance_rms : float
        Root mean square distance of the truth's vertices over the filled part from the completed surface, in the input's unit;
        NaN if it has none there.
    smooth_rms : float
        The same from the smooth filling of the same holes: biharmonic, joining the scan with continuous tangents, without relief.
        NaN likewise, and where over 60,000 vertices were filled.
    roughness : (3, 3) array
        As that of `ReliefReport`, of the truth where it lies over the fillings: what a perfect filling would have.

    See Also
    --------
    intaglio.assess_relief : Computes it, if it is given the truth.

    References
    ----------
    Breckon & Fisher, "Three-Dimensional Surface Relief Completion via Nonparametric Techniques", IEEE TPAMI 30(12), 2008,
    section 3, eq. 3 and table 1.

    Examples
    --------
    A sheet whose middle was "filled" with the truth itself:

    >>> import numpy as np
    >>> import intaglio
    >>> x, y = np.meshgrid(np.arange(16.0), np.arange(16.0))
    >>> points = np.column_stack([x.ravel(), y.ravel(), 0.2 * np.sin(x.ravel())])
    >>> sheet = intaglio.surface_from_points(points, direction=(0, 0, -1))
    >>> filled = (np.abs(sheet.vertices[:, :2] - 7.5) < 3).all(axis=1)
    >>> completed = intaglio.Surface(
    ...     vertices=sheet.vertices,
    ...     faces=sheet.faces,
    ...     base=sheet.vertices * [1, 1, 0],
    ...     normal=np.tile([0.0, 0.0, 1.0], (256, 1)),
    ...     measured=~filled,
    ... )
    >>> comparison = intaglio.assess_relief(completed, truth=sheet, device="cpu").truth
    >>> round(comparison.rms, 6), comparison.coverage
    (0.0, 1.0)
    """

    difference: Array
    rms: float
    measured_rms: float
    msi: float
    msi_percent: float
    displacement_emd: float
    coverage: float
    distance_rms: float
    smooth_rms: float
    roughness: Array

    def __post_init__(self) -> None:
        check_fields(self, nan=True)


@dataclass(frozen=True)
class ReliefReport:
    """Measures of a completed surface: how its filled part compares with its measured part.

    Attributes
    ----------
    measured_count, filled_count : int
        Number of measured and of filled vertices that some face uses.
    msi_measured, msi_filled : float
        Mean surface integrals: mean signed displacements of the two parts, in the input's unit.
    msi_percent : float
        Their difference, 100 (filled − measured) / abs(measured). Breckon & Fisher's "% difference" for a hole is that from its
        truth, ``truth.msi_percent``. If the measured integral is small against the spread of the relief, as for a base through
        its middle, this quotient says little, unlike ``msi_deviations``.
    msi_deviations : float
        Difference filled − measured of the integrals, in standard deviations of the measured relief.
    std_measured, std_filled : float
        Standard deviations of the displacements, in the input's unit.
    displacement_emd : float
        Earth mover's distance between the displacements of the two parts, in measured standard deviations.
    normal_emd : float
        Earth mover's distance between the angles from the base normal to the surface normal, likewise.
    seam : float
        Steps over edges from measured to filled vertices, relative to steps inside the measured part over edges of the same
        length; 1 means no seam, NaN that no edge crosses it.
    wavelength : (K,) array
        Wavelengths of the roughness spectra, in the input's unit.
    spectrum_measured, spectrum_filled : (K,) arrays
        Power of the roughness at these wavelengths, in the fourth power of the input's unit.
    color_overlap : (3,) array or None
        Shared area of the measured and filled colour histograms of each channel (display values); 1 for equal ones. None
        without colours.
    color_emd : (3,) array or None
        Earth mover's distance between the colours likewise, in measured standard deviations.
    roughness : (3, 3) array
        Roughness of the fillings over that of their surroundings, by band of wavelengths (up to 5 spacings, 5 to 10, 10 to 20)
        and by third of the way from the rim to the middle; 1 is right for relief that is even. A root mean square over all
        fillings. NaN where there are under ten vertices, or no relief in filling and surroundings. A spacing is a filling's
        mean edge; surroundings are measured vertices up to half a radius beyond the rim, or all of them where half as many were
        filled as measured.
    filling_roughness : (K, 3, 3) array
        The same for each filled region, those of most vertices first.
    surroundings : (K, 3) array
        Root mean square of the three bands around each, in the input's unit; NaN where it was not measured.
    filling_count : (K,) int array
        Vertices of each.
    filling_center : (K, 3) array
        Mean position of each, in the input's unit.
    local_share : float
        Share of the filled vertices whose source lies within two radii of their filling's center; NaN where no source is known.
    coherence : float
        Share of the edges between filled vertices whose two sources are neighbours, at most twice the edge's length apart; NaN
        likewise.
    largest_use : float
        Area that the most used place of the scan, a vertex and its neighbours, covers in the fillings, over its own area; where
        more was filled than measured, over what even use would make of it. NaN likewise.
    confidence : float
        Mean confidence of the filled vertices, from 0 to 1; NaN if the surface has none.
    remarks : tuple of str
        What is out of the ordinary, a sentence each: roughness outside 0.8 to 1.25, coherence under 0.85, use over 3.
    displacement : (N,) array
        Signed displacement of every vertex, in the input's unit.
    filled : (N,) bool array
        Whether the vertex was filled and some face uses it.
    normal_deviation : (N,) array
        Angle between surface normal and base normal at every vertex, in degrees.
    truth : TruthComparison or None
        Differences from the known surface, if that was given.

    See Also
    --------
    intaglio.assess_relief : Computes it.

    References
    ----------
    Breckon & Fisher, "Three-Dimensional Surface Relief Completion via Nonparametric Techniques", IEEE TPAMI 30(12), 2008,
    section 3, eq. 3 and table 1.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> x, y = np.meshgrid(np.arange(16.0), np.arange(16.0))
    >>> points = np.column_stack([x.ravel(), y.ravel(), 0.2 * np.sin(x.ravel())])
    >>> sheet = intaglio.surface_from_points(points, direction=(0, 0, -1))
    >>> filled = (np.abs(sheet.vertices[:, :2] - 7.5) < 3).all(axis=1)
    >>> completed = intaglio.Surface(
    ...     vertices=sheet.vertices,
    ...     faces=sheet.faces,
    ...     base=sheet.vertices * [1, 1, 0],
    ...     normal=np.tile([0.0, 0.0, 1.0], (256, 1)),
    ...     measured=~filled,
    ... )
    >>> report = intaglio.assess_relief(completed, device="cpu")
    >>> report.measured_count, report.filled_count
    (220, 36)
    """

    measured_count: int
    filled_count: int
    msi_measured: float
    msi_filled: float
    msi_percent: float
    msi_deviations: float
    std_measured: float
    std_filled: float
    displacement_emd: float
    normal_emd: float
    seam: float
    wavelength: Array
    spectrum_measured: Array
    spectrum_filled: Array
    color_overlap: Array | None
    color_emd: Array | None
    roughness: Array
    filling_roughness: Array
    surroundings: Array
    filling_count: Array
    filling_center: Array
    local_share: float
    coherence: float
    largest_use: float
    confidence: float
    remarks: tuple[str, ...]
    displacement: Array
    filled: Array
    normal_deviation: Array
    truth: TruthComparison | None

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
        >>> x, y = np.meshgrid(np.arange(16.0), np.arange(16.0))
        >>> points = np.column_stack([x.ravel(), y.ravel(), 0.2 * np.sin(x.ravel())])
        >>> sheet = intaglio.surface_from_points(points, direction=(0, 0, -1))
        >>> filled = (np.abs(sheet.vertices[:, :2] - 7.5) < 3).all(axis=1)
        >>> completed = intaglio.Surface(
        ...     vertices=sheet.vertices,
        ...     faces=sheet.faces,
        ...     base=sheet.vertices * [1, 1, 0],
        ...     normal=np.tile([0.0, 0.0, 1.0], (256, 1)),
        ...     measured=~filled,
        ... )
        >>> intaglio.assess_relief(completed, device="cpu").lines()[0]
        'vertices: 220 measured, 36 filled'
        """
        out = [f"vertices: {self.measured_count} measured, {self.filled_count} filled"]
        if self.truth is not None:
            out += _truth_lines(self.truth, self.msi_filled)
        out += [
            f"against the measured part: mean surface integral {self.msi_filled:.6g}, measured {self.msi_measured:.6g}, "
            f"difference {self.msi_percent:+.2f} % ({self.msi_deviations:+.3f} standard deviations)",
            f"standard deviation of relief: filled {self.std_filled:.6g}, measured {self.std_measured:.6g}",
            f"earth mover's distance from the measured part (in its standard deviations): displacement "
            f"{self.displacement_emd:.3f}, normal deviation {self.normal_emd:.3f}",
            f"seam measure (1 = no seam): {self.seam:.3f}",
            self._roughness_line(),
        ]
        if self.truth is not None and np.isfinite(self.truth.roughness).any():
            out.append("the truth's own roughness, likewise: " + _by_band(self.truth.roughness))
        if len(self.filling_count) > 1:
            out += self._filling_lines()
        if not np.isnan(self.local_share):
            out.append(
                f"sources: {self.local_share:.0%} within two radii of their filling's center; neighbours have neighbouring "
                f"sources over {self.coherence:.0%} of the filled edges; the most used place carries {self.largest_use:.2g} "
                "times even use"
            )
        if not np.isnan(self.confidence):
            out.append(f"confidence of what was filled (0 to 1): {self.confidence:.2f} in the mean")
        if self.color_overlap is not None:
            out.append("colour histograms, shared area: " + ", ".join(f"{v:.3f}" for v in self.color_overlap))
        if self.color_emd is not None:
            out.append(
                "earth mover's distance of colours (in measured standard deviations): "
                + ", ".join(f"{v:.3f}" for v in self.color_emd)
            )
        return out + [f"note: {remark}" for remark in self.remarks]

    def _roughness_line(self) -> str:
        if np.isfinite(self.roughness).any():
            return f"roughness (1 = that of the surroundings), from the rim to the middle: {_by_band(self.roughness)}"
        if np.isfinite(self.surroundings).any():
            return "roughness: none, neither filled nor around"
        return "roughness: what was filled is too small to measure, or has no rim"

    def _filling_lines(self) -> list[str]:
        """Return a line for each of the largest fillings, and one for how many there are beside them."""
        out = []
        for k in range(min(len(self.filling_count), _LISTED)):
            ratio = self.filling_roughness[k]
            said = _by_band(ratio) if np.isfinite(ratio).any() else "not measured"
            at = ", ".join(f"{v:.6g}" for v in self.filling_center[k])
            out.append(f"filling {k + 1} at ({at}), {self.filling_count[k]} vertices: roughness {said}")
        if len(self.filling_count) > _LISTED:
            out.append(f"{len(self.filling_count) - _LISTED} smaller fillings are not listed")
        return out


def describe_roughness(roughness: Array, few: Array, true: Array | None) -> list[str]:
    """Return a sentence for each ratio (3, 3) outside 0.8 to 1.25.

    ``few`` says where hardly one wave fits; the truth's ratios are told, too, where they are known.
    """
    out = []
    for b, band in enumerate(BAND_NAMES):
        for r, ring in enumerate(RING_NAMES):
            ratio = roughness[b, r]
            if np.isfinite(ratio) and not _LOW <= ratio <= _HIGH:
                known = f"; the truth has {true[b, r]:.2f}" if true is not None and np.isfinite(true[b, r]) else ""
                kind = "smoother" if ratio < 1 else "rougher"
                chance = "; hardly one such wave fits there, so this may be chance" if few[b, r] else ""
                out.append(
                    f"waves of {band} spacings {ring} of the filling have {ratio:.2f} times the roughness of the surroundings: "
                    f"{kind} than what surrounds it{known}{chance}"
                )
    return out


def describe_sources(coherence: float, largest_use: float) -> list[str]:
    """Return a sentence each for low coherence and for uneven use."""
    out = []
    if coherence < _COHERENT:
        out.append(
            f"neighbours have neighbouring sources over {coherence:.0%} of the filled edges only: the filling consists of many "
            "pieces that don't belong together"
        )
    if largest_use > _EVEN:
        out.append(
            f"one place of the scan was used {largest_use:.2g} times as often as even use would have it: look for repetitions"
        )
    return out


def _truth_lines(truth: TruthComparison, filled: float) -> list[str]:
    smooth = f", {truth.smooth_rms:.6g} from a smooth filling" if not np.isnan(truth.smooth_rms) else ""
    if truth.smooth_rms > 0:
        smooth += f" ({truth.distance_rms / truth.smooth_rms:.2f} times)"
    return [
        f"against the truth of the filled part: mean surface integral {filled:.6g}, true {truth.msi:.6g}, difference "
        f"{truth.msi_percent:+.2f} %; earth mover's distance of displacements (in true standard deviations) "
        f"{truth.displacement_emd:.3f}",
        f"rms difference of heights from the truth: {truth.rms:.6g} where filled, {truth.measured_rms:.6g} where measured; "
        f"{truth.coverage:.1%} of the filled part covered",
        f"rms distance of the truth's vertices: {truth.distance_rms:.6g} from the completion{smooth}",
    ]


def _by_band(roughness: Array) -> str:
    """Return the ratios (3, 3) as text, a dash where there is none."""
    bands = (", ".join("–" if np.isnan(v) else f"{v:.2f}" for v in row) for row in roughness)
    return "; ".join(f"waves of {name} spacings {said}" for name, said in zip(BAND_NAMES, bands, strict=True))
