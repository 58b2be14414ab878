"""How well a completion continues the measured relief: the mean surface integral of Breckon & Fisher, and what it misses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.location import height_above
from intaglio.mesh import SmoothBase, Surface, unique_edges, vertex_normals
from intaglio.relief.seam import seam_measure
from intaglio.statistics import (
    earth_movers_distance,
    histogram_overlap,
    mean_surface_integral,
    roughness_spectrum,
)


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
        Breckon & Fisher's "% difference", 100 (filled − measured) / abs(measured). If the measured integral is small against the
        spread of the relief, as for a base through its middle, this quotient says little, unlike ``msi_deviations``.
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
        out = [
            f"vertices: {self.measured_count} measured, {self.filled_count} filled",
            f"mean surface integral: measured {self.msi_measured:.6g}, filled {self.msi_filled:.6g}, difference "
            f"{self.msi_percent:+.2f} % ({self.msi_deviations:+.3f} standard deviations)",
            f"standard deviation of relief: measured {self.std_measured:.6g}, filled {self.std_filled:.6g}",
            f"earth mover's distance (in measured standard deviations): displacement {self.displacement_emd:.3f}, "
            f"normal deviation {self.normal_emd:.3f}",
            f"seam measure (1 = no seam): {self.seam:.3f}",
        ]
        if self.color_overlap is not None:
            out.append("colour histograms, shared area: " + ", ".join(f"{v:.3f}" for v in self.color_overlap))
        if self.color_emd is not None:
            out.append(
                "earth mover's distance of colours (in measured standard deviations): "
                + ", ".join(f"{v:.3f}" for v in self.color_emd)
            )
        if self.truth is not None:
            t = self.truth
            out.append(
                f"against the truth: MSI {t.msi:.6g} ({t.msi_percent:+.2f} %), displacement EMD {t.displacement_emd:.3f}, rms "
                f"difference {t.rms:.6g} where filled, {t.measured_rms:.6g} where measured; {t.coverage:.1%} covered"
            )
        return out


@checked_arguments
def assess_relief(surface: Surface, truth: Surface | None = None, *, device: str | None = None) -> ReliefReport:
    """Measure how well the filled part of a surface continues the measured one, and how both compare with the truth.

    Parameters
    ----------
    surface : Surface
        From `complete_relief`, or read back from the PLY that was written of it.
    truth : Surface, optional
        The known surface, with faces, in the same coordinates. Default None: not known.
    device : str, optional
        Where distances from the truth are computed, such as "cpu" or "cuda:0". Default None: CUDA if there is a GPU, else
        the CPU.

    Returns
    -------
    ReliefReport
        Figures of the two parts, and the displacements and angles of every vertex.

    Raises
    ------
    InputError
        If an argument is not a surface, no vertex was filled or none measured, the truth has no faces or does not cover the
        filled part, or the device does not exist.

    References
    ----------
    Breckon & Fisher, "Three-Dimensional Surface Relief Completion via Nonparametric Techniques", IEEE TPAMI 30(12), 2008,
    section 3, eq. 3 and table 1.

    Examples
    --------
    A sheet with waves whose middle was filled:

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
    >>> report.filled_count, report.displacement_emd < 0.2, report.seam < 1.5
    (36, True, True)
    """
    for name, value in (("surface", surface), ("truth", truth)):
        if not isinstance(value, Surface) and not (name == "truth" and value is None):
            raise InputError(f"{name} must be an intaglio.Surface, not {type(value).__name__}")
    used = np.zeros(len(surface.vertices), bool)
    used[surface.faces] = True
    measured, filled = used & surface.measured, used & ~surface.measured
    if not measured.any() or not filled.any():
        raise InputError(
            f"nothing to assess: {measured.sum()} measured and {filled.sum()} filled vertices; "
            "assess_relief takes the result of complete_relief"
        )
    relief = surface.relief
    normals = vertex_normals(surface.vertices, surface.faces)
    tilt = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", normals, surface.normal), -1, 1)))
    edges = unique_edges(surface.faces)
    spacing = float(np.median(np.linalg.norm(surface.base[edges[:, 0]] - surface.base[edges[:, 1]], axis=1)))
    msi_measured, msi_filled = mean_surface_integral(relief[measured]), mean_surface_integral(relief[filled])
    spread = float(relief[measured].std())
    wavelength, spectrum_measured = roughness_spectrum(surface.base[measured], relief[measured], spacing)
    _, spectrum_filled = roughness_spectrum(surface.base[filled], relief[filled], spacing)
    return ReliefReport(
        measured_count=int(measured.sum()),
        filled_count=int(filled.sum()),
        msi_measured=msi_measured,
        msi_filled=msi_filled,
        msi_percent=_percent(msi_filled, msi_measured),
        msi_deviations=(msi_filled - msi_measured) / spread if spread > 0 else float("nan"),
        std_measured=spread,
        std_filled=float(relief[filled].std()),
        displacement_emd=earth_movers_distance(relief[filled], relief[measured]),
        normal_emd=earth_movers_distance(tilt[filled], tilt[measured]),
        seam=seam_measure(
            surface.base,
            relief,
            surface.faces,
            measured,
            # The smooth base of a filling is made up too, so a step in it counts as a seam.
            surface.normal if isinstance(surface.model, SmoothBase) else None,
        ),
        wavelength=wavelength,
        spectrum_measured=spectrum_measured,
        spectrum_filled=spectrum_filled,
        color_overlap=_by_channel(histogram_overlap, surface, measured, filled),
        color_emd=_by_channel(earth_movers_distance, surface, measured, filled),
        displacement=relief,
        filled=filled,
        normal_deviation=tilt,
        truth=None if truth is None else _against_truth(surface, truth, relief, measured, filled, device),
    )


def _against_truth(
    surface: Surface, truth: Surface, relief: Array, measured: Array, filled: Array, device: str | None
) -> TruthComparison:
    if len(truth.faces) == 0:
        raise InputError("the truth has no faces: it can't be compared with")
    extent = float(np.linalg.norm(np.ptp(surface.base, axis=0)))
    reach = min(0.2 * extent, 10 * float(np.abs(relief).max()) + 1e-3 * extent)
    true_relief = height_above(surface.base, surface.normal, truth.vertices, truth.faces, reach, device_or_error(device))
    difference = relief - true_relief
    known = np.isfinite(true_relief)
    at, own = filled & known, measured & known
    if not at.any():
        raise InputError("the truth has no surface over the filled part: is it in the same coordinates and unit?")
    msi = mean_surface_integral(true_relief[at])
    return TruthComparison(
        difference=difference,
        rms=float(np.sqrt((difference[at] ** 2).mean())),
        measured_rms=float(np.sqrt((difference[own] ** 2).mean())) if own.any() else float("nan"),
        msi=msi,
        msi_percent=_percent(mean_surface_integral(relief[at]), msi),
        displacement_emd=earth_movers_distance(relief[at], true_relief[at]),
        coverage=float(at.sum() / filled.sum()),
    )


def _by_channel(measure: Callable[[Array, Array], float], surface: Surface, measured: Array, filled: Array) -> Array | None:
    """Return a measure of filled against measured display values for each of the three channels, or None without colours."""
    if surface.color is None:
        return None
    from intaglio.kernels.transfer import encode_srgb

    shown = encode_srgb(surface.color)
    return np.array([measure(shown[filled, c], shown[measured, c]) for c in range(3)])


def _percent(value: float, reference: float) -> float:
    return 100 * (value - reference) / abs(reference) if reference != 0 else float("nan")
