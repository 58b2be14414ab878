"""How well a completion continues the measured relief: the papers' MSI, and what it does not see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
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
    """The completion against the known surface.

    Attributes
    ----------
    difference : (N,) float64 array
        Relief minus true relief over the same base point, in the input's unit; NaN where the truth has none there.
    rms : float
        Over filled vertices, in the input's unit.
    measured_rms : float
        The same over measured vertices: the scan's own noise.
    msi : float
        The truth's mean surface integral at the filled vertices.
    msi_percent : float
        The filled part's MSI against that, in percent.
    displacement_emd : float
        Earth mover's distance between filled and true displacement, in standard deviations of the true one.
    coverage : float
        Share of filled vertices over which the truth has a surface.
    """

    difference: Array
    rms: float
    measured_rms: float
    msi: float
    msi_percent: float
    displacement_emd: float
    coverage: float


@dataclass(frozen=True)
class ReliefReport:
    """Measures of a completed surface. Lengths are in the input's unit.

    Attributes
    ----------
    measured_count, filled_count : int
        Vertices.
    msi_measured, msi_filled : float
        Mean surface integral (paper 001, eq. 3).
    msi_percent : float
        The papers' "% difference", 100 (filled - measured) / |measured|. Where the measured MSI is small against the
        relief's spread (a base through the middle of the relief) this quotient says little: see ``msi_deviations``.
    msi_deviations : float
        (filled - measured) in units of the measured relief's standard deviation.
    std_measured, std_filled : float
        Standard deviation of the displacement.
    displacement_emd : float
        Earth mover's distance of the displacements, in measured standard deviations.
    normal_emd : float
        The same of the angle between surface normal and base normal.
    seam : float
        Jumps across measured/filled edges against jumps inside the measured part over the same distances; 1: no seam.
    wavelength, spectrum_measured, spectrum_filled : (K,) arrays
        Roughness spectra.
    color_overlap : (3,) array or None
        Shared area of the measured and filled colour histograms per channel (display values), 1 for equal ones.
    color_emd : (3,) array or None
        Earth mover's distance of the same, in measured standard deviations.
    displacement, filled : (N,) arrays
        Signed displacement of every vertex, and whether it was filled.
    normal_deviation : (N,) array
        Degrees.
    truth : TruthComparison or None
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

    def lines(self) -> list[str]:
        """Return the figures as lines of text."""
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


def assess_relief(surface: Surface, truth: Surface | None = None, *, device: str | None = None) -> ReliefReport:
    """Measure how the filled part continues the measured one, and, given it, how both compare with the truth.

    Parameters
    ----------
    surface : Surface
        From `complete_relief`, or read back from its PLY.
    truth : Surface, optional
        The known surface, in the same coordinates.
    device : str, optional
        "cpu", "cuda:0"; default CUDA if there is one.

    Raises
    ------
    InputError
        If nothing was filled or nothing measured.

    References
    ----------
    Breckon & Fisher, TPAMI 2008, section 3, eq. 3 and table 1.
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
            # The base of a filling was made up: a step in it is a seam as well.
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
    """A measure of filled against measured display values, for each of the three channels."""
    if surface.color is None:
        return None
    from intaglio.kernels.transfer import encode_srgb

    shown = encode_srgb(surface.color)
    return np.array([measure(shown[filled, c], shown[measured, c]) for c in range(3)])


def _percent(value: float, reference: float) -> float:
    return 100 * (value - reference) / abs(reference) if reference != 0 else float("nan")
