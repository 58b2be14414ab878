"""How well a representation reconstructs the photographs it was fitted to, and predicts others (Dong, section 4.5.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import check_fields, checked_arguments
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.lighting import weighted_sums
from intaglio.photometric.linear_fits import LINEAR_KINDS, Settings, prediction, reconstruction
from intaglio.photometric.relightable import KINDS
from intaglio.photometric.representation import linear_fit, represent, stack_moments
from intaglio.photometric.stack import PhotometricStack


@dataclass(frozen=True)
class RepresentationReport:
    """Errors of relit images against the photographs.

    Attributes
    ----------
    kind : str
        The kind that was fitted; see `represent`.
    leave_one_out : bool
        Whether every image was relit from a fit to the others (ability of prediction) rather than to all (ability of
        reconstruction).
    normalized_rms : float
        η = mean over images of rms(relit − original) / std(original); NaN if no image has any contrast.
    relative : float
        ‖relit − original‖ / ‖original‖ over all images together. Images of grazing lights, which vary little, count little.
    per_image : (K,) float64 array
        Values rms(relit − original) / std(original); NaN for an image without any contrast, which η leaves out.
    notes : tuple of str
        What was chosen in fitting, as sentences for the user.

    See Also
    --------
    intaglio.assess_representation : Computes it.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 4.5.1, eq. 4.5.1.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> tilts, slants = (0, 0, 90, 180, 270), (0, 45, 45, 45, 45)
    >>> lights = np.array([intaglio.light_direction(*angles) for angles in zip(tilts, slants)])
    >>> albedo = np.linspace(0.2, 0.8, 4).reshape(2, 2, 1)
    >>> stack = intaglio.PhotometricStack(lights[:, 2, None, None, None] * albedo, lights)
    >>> report = intaglio.assess_representation(stack, "gradient", device="cpu")
    >>> report.kind, report.per_image.shape, round(report.normalized_rms, 3)
    ('gradient', (5,), 0.0)
    """

    kind: str
    leave_one_out: bool
    normalized_rms: float
    relative: float
    per_image: Array
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self, nan=True)


@checked_arguments
def assess_representation(
    stack: PhotometricStack,
    kind: str,
    leave_one_out: bool = False,
    *,
    robust: bool = False,
    order: int = 3,
    interpolation: str = "auto",
    components: int | None = None,
    smoothing: float | None = None,
    integration: str = "fourier",
    differentiation: str = "fourier",
    device: str | None = None,
    progress: Progress | None = None,
) -> RepresentationReport:
    """Measure how well a kind represents a stack: relight it by the lights of the photographs and compare.

    Parameters
    ----------
    stack : PhotometricStack
        Photographs and their lights; linear values.
    kind : str
        The kind to fit; see `represent`, of which the other options are as well.
    leave_one_out : bool, optional
        Relight every image from a fit to all others, which measures prediction; default False, which measures
        reconstruction. For least-squares kinds the relit images follow from the hat matrix, for "3i" and principal images
        from the products of the images, without a fit to any pixel; for "height" and robust fits every fit is made. "rbf"
        chooses its interpolation and smoothing again without the image, but its number of maps only once. Eigen kinds on a
        grid of lights are interpolated over triangles, since without one light the grid is not full.
    robust : bool, optional
        For "gradient" and "height": a fit that leaves out shadows and highlights. Default False.
    order : {2, 3}, optional
        For "hsh": 4 or 9 harmonics. Default 3.
    interpolation : {"auto", "grid", "triangles"}, optional
        For the eigen kinds. Default "auto": the grid if the lights form one.
    components : int, optional
        For "rbf": number of maps. Default None: by cross-validation.
    smoothing : float, optional
        For "rbf": at least 0. Default None: by cross-validation.
    integration : {"fourier", "cosine"}, optional
        For "height". Default "fourier", as in the thesis.
    differentiation : {"fourier", "central", "forward"}, optional
        For "height". Default "fourier", as in the thesis.
    device : str, optional
        Where fits run, such as "cpu" or "cuda:0". Default None: CUDA if there is a GPU, else the CPU.
    progress : callable, optional
        Called as ``progress(done, total)`` while work goes on. Default None.

    Returns
    -------
    RepresentationReport
        The errors, of all images together and of each.

    Raises
    ------
    InputError
        As `represent`; and with ``leave_one_out``, if the other images don't determine the maps.
    FileError
        If an image of a stack on disk is missing or damaged.

    Notes
    -----
    The thesis prints e_k = 1/(NM) √(Σ(r − i)²) (eq. 4.5.1); the factor belongs inside the root, else η would fall with the
    size of the image. Relit values are clipped at 0. Only pixels inside the mask count.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 4.5.1, eq. 4.5.1.

    Examples
    --------
    A level, matte sample is predicted without error by Lambert's law:

    >>> import numpy as np
    >>> import intaglio
    >>> tilts, slants = (0, 0, 90, 180, 270), (0, 45, 45, 45, 45)
    >>> lights = np.array([intaglio.light_direction(*angles) for angles in zip(tilts, slants)])
    >>> albedo = np.linspace(0.2, 0.8, 4).reshape(2, 2, 1)
    >>> stack = intaglio.PhotometricStack(lights[:, 2, None, None, None] * albedo, lights)
    >>> report = intaglio.assess_representation(stack, "gradient", leave_one_out=True, device="cpu")
    >>> round(report.normalized_rms, 3)
    0.0
    """
    if kind not in KINDS:
        raise InputError(f"kind {kind!r} is not known; known: {', '.join(KINDS)}")
    device = device_or_error(device)
    report = progress or (lambda done, total: None)
    if kind not in LINEAR_KINDS or robust:
        options = {"robust": robust, "integration": integration, "differentiation": differentiation, "device": device}
        return _assess_by_fitting(stack, kind, leave_one_out, options, report)
    settings = Settings(order, interpolation, components, smoothing).checked()
    notes: tuple[str, ...] = ()
    if leave_one_out:
        needs = kind in ("eigen3", "eigen6", "rbf")
        relit = prediction(kind, stack.lights, stack_moments(stack) if needs else None, settings)
    else:
        fit = linear_fit(kind, stack, settings, device)
        relit, notes = reconstruction(fit, stack.lights), fit.notes
    errors = _Errors(stack.shape[0])
    for rows, strip in stack.strips():
        values = strip if stack.mask is None else strip[:, stack.mask[rows]]
        planes = np.ascontiguousarray(values.reshape(len(strip), -1))
        errors.add(planes, weighted_sums(planes, relit.T, floor=0.0, double=True, device=device))
        report(rows.stop, stack.shape[1])
    return errors.report(kind, leave_one_out, notes)


def _assess_by_fitting(
    stack: PhotometricStack, kind: str, leave_one_out: bool, options: dict[str, object], report: Progress
) -> RepresentationReport:
    """Fit, or fit without each image in turn, and relight."""
    count = stack.shape[0]
    errors = _Errors(count)
    texture = None if leave_one_out else represent(stack, kind, **options)  # type: ignore[arg-type]
    for k in range(count):
        if leave_one_out:
            texture = represent(stack.subset(np.delete(np.arange(count), k)), kind, **options)  # type: ignore[arg-type]
        assert texture is not None
        original, relit = stack.image(k), texture.relight(stack.lights[k])
        if stack.mask is not None:
            original, relit = original[stack.mask], relit[stack.mask]
        errors.add(original.reshape(1, -1), relit.reshape(1, -1), slice(k, k + 1))
        report(k + 1, count)
    return errors.report(kind, leave_one_out, () if texture is None else texture.notes)


class _Errors:
    """Sums of squares over images, strip by strip."""

    def __init__(self, count: int) -> None:
        self.away, self.squares, self.sums, self.number = (np.zeros(count) for _ in range(4))

    def add(self, original: Array, relit: Array, which: slice = slice(None)) -> None:
        """Count rows of values of the images ``which``."""
        for k, (i, r) in enumerate(zip(original, relit, strict=True), start=which.start or 0):
            values = i.astype(np.float64)
            away = r - values
            self.away[k] += away @ away
            self.squares[k] += values @ values
            self.sums[k] += values.sum()
            self.number[k] += len(values)

    def report(self, kind: str, leave_one_out: bool, notes: tuple[str, ...]) -> RepresentationReport:
        """Return the report; the normalised error of an image whose values are all equal is NaN."""
        if not self.squares.any():
            raise InputError("the stack is black: no value is over 0")
        mean = self.sums / self.number
        variance = np.maximum(self.squares / self.number - mean * mean, 0)
        flat = variance <= 1e-12 * np.maximum(self.squares / self.number, 1e-30)
        with np.errstate(divide="ignore", invalid="ignore"):
            per_image = np.where(flat, np.nan, np.sqrt(self.away / self.number) / np.sqrt(variance))
        eta = float(np.mean(per_image[~flat])) if (~flat).any() else float("nan")
        relative = float(np.sqrt(self.away.sum() / self.squares.sum()))
        return RepresentationReport(kind, leave_one_out, eta, relative, per_image, notes)
