"""How well a completion continues the measured relief: the mean surface integral of Breckon & Fisher, and what it misses."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import checked_arguments
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.mesh import SmoothBase, Surface, unique_edges, vertex_normals
from intaglio.relief.figures import ReliefReport, describe_roughness, describe_sources
from intaglio.relief.fillings import list_fillings
from intaglio.relief.provenance import measure_provenance
from intaglio.relief.roughness import measure_roughness
from intaglio.relief.seam import seam_measure
from intaglio.relief.truth import compare_with_truth, percent
from intaglio.statistics import (
    earth_movers_distance,
    histogram_overlap,
    mean_surface_integral,
    roughness_spectrum,
)


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
        If an argument is not a surface, no vertex was filled or none measured, the base has no extent, the truth has no faces or
        does not cover the filled part, or the device does not exist.

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
    if spacing == 0:
        raise InputError("most edges of the surface's base have no length: there is nothing to measure along")
    msi_measured, msi_filled = mean_surface_integral(relief[measured]), mean_surface_integral(relief[filled])
    spread = float(relief[measured].std())
    wavelength, spectrum_measured = roughness_spectrum(surface.base[measured], relief[measured], spacing)
    _, spectrum_filled = roughness_spectrum(surface.base[filled], relief[filled], spacing)
    fillings = list_fillings(surface, edges)
    rough = measure_roughness(surface.vertices, surface.faces, surface.measured, fillings)
    sources = measure_provenance(surface, fillings, edges)
    compared = None
    if truth is not None:
        compared = compare_with_truth(surface, truth, measured, filled, fillings, device_or_error(device))
    remarks = describe_roughness(rough.whole, rough.few, None if compared is None else compared.roughness)
    remarks += describe_sources(sources.coherence, sources.largest_use)
    if rough.skipped:
        remarks.append(f"roughness was measured on the larger fillings only: {rough.skipped} were left out")
    return ReliefReport(
        measured_count=int(measured.sum()),
        filled_count=int(filled.sum()),
        msi_measured=msi_measured,
        msi_filled=msi_filled,
        msi_percent=percent(msi_filled, msi_measured),
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
        roughness=rough.whole,
        filling_roughness=rough.ratio,
        surroundings=rough.around,
        filling_count=np.array([len(filling.vertices) for filling in fillings]),
        filling_center=np.array([filling.center for filling in fillings]),
        local_share=sources.local,
        coherence=sources.coherence,
        largest_use=sources.largest_use,
        confidence=float("nan") if surface.confidence is None else float(surface.confidence[filled].mean()),
        remarks=tuple(remarks),
        displacement=relief,
        filled=filled,
        normal_deviation=tilt,
        truth=compared,
    )


def _by_channel(measure: Callable[[Array, Array], float], surface: Surface, measured: Array, filled: Array) -> Array | None:
    """Return a measure of filled against measured display values for each of the three channels, or None without colours."""
    if surface.color is None:
        return None
    from intaglio.kernels.transfer import encode_srgb

    shown = encode_srgb(surface.color)
    return np.array([measure(shown[filled, c], shown[measured, c]) for c in range(3)])
