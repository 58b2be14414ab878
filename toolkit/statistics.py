"""Measures of relief shared by the systems: distributions, spectra, seams."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import j0

from intaglio.arrays import Array

# Pairs that are looked at in one part, at most.
_PAIRS_AT_ONCE = 20_000_000
_PAIR_POINTS = 2500


def mean_surface_integral(relief: Array) -> float:
    """Return the mean signed displacement, MSI = (1/n) sum D(i).n(i), in the input's unit.

    Breckon & Fisher, IEEE TPAMI 30(12), 2008, equation 3.
    """
    return float(np.mean(relief)) if len(relief) else float("nan")


def earth_movers_distance(values: Array, reference: Array) -> float:
    """Return the earth mover's distance between two samples, in units of the reference's standard deviation.

    0 for equal distributions; 0.1 means that values must be moved by a tenth of the spread on average. A reference
    without spread gives 0 for equal samples and infinity otherwise.
    """
    # SciPy's statistics take long to import.
    from scipy.stats import wasserstein_distance

    if len(values) == 0 or len(reference) == 0:
        return float("nan")
    distance = float(wasserstein_distance(values, reference))
    spread = float(np.std(reference))
    if spread > 0:
        return distance / spread
    return 0.0 if distance == 0 else float("inf")


def autocovariance(points: Array, values: Array, step: float, bins: int) -> tuple[Array, Array]:
    """Return isotropic autocovariance of scattered values: distances (bins,) and covariance (bins,), NaN where no pair is.

    Parameters
    ----------
    points : (N, 3) array
    values : (N,) array
    step : float
        Width of a distance bin.
    bins : int
        Pairs closer than ``bins * step`` are used. At most 2,500 points, evenly spread in index, are paired with all.
    """
    take = np.unique(np.linspace(0, len(points) - 1, min(len(points), _PAIR_POINTS)).astype(int))
    centered = values - values.mean()
    all_points = cKDTree(points)
    total, count = np.zeros(bins), np.zeros(bins)
    # In parts, so that a scan much denser than the step needs no more memory.
    per_part = max(1, _PAIRS_AT_ONCE // len(points))
    for first in range(0, len(take), per_part):
        part = take[first : first + per_part]
        pairs = cKDTree(points[part]).sparse_distance_matrix(all_points, bins * step, output_type="coo_matrix")
        at = np.minimum((pairs.data / step).astype(int), bins - 1)
        product = centered[part][pairs.row] * centered[pairs.col]
        total += np.bincount(at, product, bins)
        count += np.bincount(at, minlength=bins)
    covariance = np.divide(total, count, out=np.full(bins, np.nan), where=count > 0)
    return (np.arange(bins) + 0.5) * step, covariance


def roughness_spectrum(points: Array, values: Array, spacing: float) -> tuple[Array, Array]:
    """Return the isotropic power spectrum of relief: wavelengths (K,) in the input's unit, and power (K,), length^4.

    The Hankel transform of the autocovariance over 24 spacings, tapered by a Hann window; it needs no chart, so it can be
    had on every base. Power that the taper leaves negative is set to zero.
    """
    bins = 48
    distance, covariance = autocovariance(points, values, 0.5 * spacing, bins)
    covariance = np.nan_to_num(covariance)
    # The lag-zero bin holds each point with itself: the variance, noise included.
    taper = 0.5 * (1 + np.cos(np.pi * distance / (bins * 0.5 * spacing)))
    wavelength = spacing * np.geomspace(2, 24, 24)
    k = 2 * np.pi / wavelength
    kernel = j0(np.outer(k, distance)) * (covariance * taper * distance)[None, :]
    return wavelength, np.maximum(2 * np.pi * kernel.sum(axis=1) * 0.5 * spacing, 0.0)


def histogram_overlap(values: Array, reference: Array, bins: int = 64) -> float:
    """Return the shared area of two histograms over [0, 1], 1 for equal ones."""
    a, b = (np.histogram(np.clip(v, 0, 1), bins, (0, 1))[0] / max(len(v), 1) for v in (values, reference))
    return float(np.minimum(a, b).sum())
