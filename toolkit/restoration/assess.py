"""How well a restored part fits: energy of its detail, its border, and what is known of the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.errors import InputError

# Detail is what a Gaussian of so many pixels takes away.
_DETAIL = 2.0

# The known part around the restored one reaches so far, in pixels; next to the border it counts to neither.
_AROUND, _BESIDE = 24, 2


@dataclass(frozen=True)
class RestorationReport:
    """Figures of a restored image.

    Attributes
    ----------
    energy : float
        Mean square of the detail in the restored part over that in the known part around it: 1 is alike.
    seam : float
        Mean step between neighbours across the border over that between known ones around: 1 is alike.
    psnr : float or None
        Of the restored part against the truth, in decibels, peak 1; where the truth is given.
    truth_energy, truth_seam : float or None
        The same figures of the truth: what a perfect restoration would have.
    """

    energy: float
    seam: float
    psnr: float | None = None
    truth_energy: float | None = None
    truth_seam: float | None = None

    def lines(self) -> list[str]:
        """Return the figures in words."""
        found = [
            f"detail energy {self.energy:.3f} of the known part's" + _of_truth(self.truth_energy),
            f"step across the border {self.seam:.3f} of the known part's" + _of_truth(self.truth_seam),
        ]
        if self.psnr is not None:
            found.append(f"PSNR of the restored part {self.psnr:.2f} dB")
        return found


def _of_truth(value: float | None) -> str:
    return "" if value is None else f" (the truth has {value:.3f})"


def assess_restoration(image: Array, missing: Array, truth: Array | None = None) -> RestorationReport:
    """Measure a restored image.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Restored, display values.
    missing : (H, W) bool array
        What was restored.
    truth : like ``image``, optional

    Raises
    ------
    InputError
        If shapes differ, or nothing is missing or known.
    """
    values = _planes(image)
    hole = np.asarray(missing)
    if hole.shape != values.shape[:2] or hole.dtype != bool:
        raise InputError(f"missing must be bool of shape {values.shape[:2]}, not {hole.dtype} {hole.shape}")
    if not hole.any() or hole.all():
        raise InputError("missing must cover part of the image, not none or all of it")
    if not np.isfinite(values).all():
        raise InputError("the image has values that are not finite")
    energy, seam = _figures(values, hole)
    if truth is None:
        return RestorationReport(energy, seam)
    wanted = _planes(truth)
    if wanted.shape != values.shape:
        raise InputError(f"truth must have the image's shape {values.shape}, not {wanted.shape}")
    error = float(np.mean((values[hole] - wanted[hole]) ** 2))
    return RestorationReport(energy, seam, float(-10 * np.log10(max(error, 1e-12))), *_figures(wanted, hole))


def _planes(image: Array) -> Array:
    """Return (H, W, C) in [0, 1] of integers, floats as they are."""
    array = np.asarray(image)
    if array.dtype.kind not in "fiu" or array.ndim not in (2, 3):
        raise InputError(f"an image is (H, W) or (H, W, C) of real numbers, not {array.dtype} {array.shape}")
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
