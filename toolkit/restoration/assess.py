"""How well a restored part fits the known one: energy of its detail, its border, and the difference from the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments, refuse_huge
from intaglio.errors import InputError

# Detail is what a Gaussian of this standard deviation, in pixels, removes.
_DETAIL = 2.0

# Width in pixels of the known part with which the restored one is compared, and of the strip between them that counts to
# neither.
_AROUND, _BESIDE = 24, 2


@dataclass(frozen=True)
class RestorationReport:
    """Measures of a restored image.

    Attributes
    ----------
    energy : float
        Mean square of the detail in the restored part over that in the known part around it: 1 is alike.
    seam : float
        Mean step between neighbouring pixels across the border over that between known ones around it: 1 is alike.
    psnr : float or None
        Peak signal-to-noise ratio of the restored part against the truth in decibels, with peak 1; None without the truth.
    truth_energy, truth_seam : float or None
        The same measures of the truth, which a perfect restoration would have; None without the truth.

    See Also
    --------
    intaglio.assess_restoration : Computes it.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> image = np.tile([0.2, 0.4, 0.6, 0.4], (64, 16))
    >>> missing = np.zeros((64, 64), bool)
    >>> missing[24:40, 24:40] = True
    >>> report = intaglio.assess_restoration(image, missing)
    >>> 0.9 < report.energy < 1.1, report.psnr is None
    (True, True)
    """

    energy: float
    seam: float
    psnr: float | None = None
    truth_energy: float | None = None
    truth_seam: float | None = None

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
        >>> image = np.tile([0.2, 0.4, 0.6, 0.4], (64, 16))
        >>> missing = np.zeros((64, 64), bool)
        >>> missing[24:40, 24:40] = True
        >>> len(intaglio.assess_restoration(image, missing).lines())
        2
        """
        found = [
            f"detail energy {self.energy:.3f} of the known part's" + _of_truth(self.truth_energy),
            f"step across the border {self.seam:.3f} of the known part's" + _of_truth(self.truth_seam),
        ]
        if self.psnr is not None:
            found.append(f"PSNR of the restored part {self.psnr:.2f} dB")
        return found


def _of_truth(value: float | None) -> str:
    return "" if value is None else f" (the truth has {value:.3f})"


@checked_arguments
def assess_restoration(image: Array, missing: Array, truth: Array | None = None) -> RestorationReport:
    """Measure how well the restored part of an image fits its known part, and how near it is to the truth.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        The restored image: display values, as floats in [0, 1] or as integers up to the maximum of their type.
    missing : (H, W) bool array
        The pixels that were restored.
    truth : (H, W) or (H, W, C) array, optional
        The true image, likewise. Default None: not known.

    Returns
    -------
    RestorationReport
        Energy of detail and steps across the border, relative to the known part; with the truth, the difference from it.

    Raises
    ------
    InputError
        If shapes differ, values are not finite, or no pixel or every pixel is missing.

    Examples
    --------
    An image is restored without error:

    >>> import numpy as np
    >>> import intaglio
    >>> image = np.tile([0.2, 0.4, 0.6, 0.4], (64, 16))
    >>> missing = np.zeros((64, 64), bool)
    >>> missing[24:40, 24:40] = True
    >>> report = intaglio.assess_restoration(image, missing, truth=image)
    >>> report.psnr, report.energy == report.truth_energy
    (120.0, True)
    """
    values = _planes("image", image)
    hole = missing
    if hole.shape != values.shape[:2] or hole.dtype != bool:
        raise InputError(f"missing must be bool of shape {values.shape[:2]}, not {hole.dtype} {hole.shape}")
    if not hole.any() or hole.all():
        raise InputError("missing must cover part of the image, not none or all of it")
    energy, seam = _figures(values, hole)
    if truth is None:
        return RestorationReport(energy, seam)
    wanted = _planes("truth", truth)
    if wanted.shape != values.shape:
        raise InputError(f"truth must have the image's shape {values.shape}, not {wanted.shape}")
    error = float(np.mean((values[hole] - wanted[hole]) ** 2))
    return RestorationReport(energy, seam, float(-10 * np.log10(max(error, 1e-12))), *_figures(wanted, hole))


def _planes(name: str, array: Array) -> Array:
    """Return (H, W, C) in [0, 1] of integers, floats as they are."""
    if array.dtype.kind not in "fiu" or array.ndim not in (2, 3) or array.size == 0:
        raise InputError(f"{name} must be (H, W) or (H, W, C) of real numbers, not {array.dtype} {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} has values that are not finite")
    refuse_huge(name, array)
    scale = np.iinfo(array.dtype).max if array.dtype.kind in "iu" else 1
    values = array.astype(np.float64) / scale
    return values[:, :, None] if values.ndim == 2 else values


def _figures(values: Array, hole: Array) -> tuple[float, float]:
    luminance = values.mean(axis=2)
    detail = luminance - ndimage.gaussian_filter(luminance, _DETAIL)
    distance = ndimage.distance_transform_edt(~hole)
    around = (distance > _BESIDE) & (distance <= _AROUND)
    if not around.any():
        around = ~hole
    inner = ndimage.binary_erosion(hole)
    inner = inner if inner.any() else hole
    energy = float(np.mean(detail[inner] ** 2) / max(float(np.mean(detail[around] ** 2)), 1e-30))
    across, along = [], []
    for axis in (0, 1):
        step = np.abs(np.diff(values, axis=axis)).mean(axis=2)
        first, second = (np.take(hole, range(k, hole.shape[axis] - 1 + k), axis) for k in (0, 1))
        near = np.take(around, range(around.shape[axis] - 1), axis) & np.take(around, range(1, around.shape[axis]), axis)
        across.append(step[first != second])
        along.append(step[near])
    seam = float(np.concatenate(across).mean() / max(float(np.concatenate(along).mean()), 1e-30))
    return energy, seam
