"""Measures of relief shared by the systems: distributions, spectra, seams."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import j0
from scipy.stats import wasserstein_distance

from intaglio.topology import unique_edges

Array = np.ndarray

# Pairs that are looked at in one part, at most.
_PAIRS_AT_ONCE = 20_000_000
_PAIR_POINTS = 2500
_SEAM_RINGS = 10


def mean_surface_integral(relief: Array) -> float:
    """Return the mean signed displacement, MSI = (1/n) sum D(i).n(i), in the input's unit (paper 001, eq. 3)."""
    return float(np.mean(relief)) if len(relief) else float("nan")


def earth_movers_distance(values: Array, reference: Array) -> float:
    """Return the earth mover's distance between two samples, in units of the reference's standard deviation.

    0 for equal distributions; 0.1 means that values must be moved by a tenth of the spread on average. A reference
    without spread gives 0 for equal samples and infinity otherwise.
    """
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


def seam_measure(points: Array, values: Array, faces: Array, measured: Array, normals: Array | None = None) -> float:
    """Return how much larger jumps across the seam are than jumps along the same direction inside; 1: no seam.

    Jumps are height differences over edges. Those across the seam join a measured and a filled vertex; those they are held
    against join rings 1 to 10 of measured vertices around the seam, so they run the same way, and are averaged as a
    function of edge length. On relief with a direction the measure depends on where its phase meets the seam.

    Parameters
    ----------
    points : (N, 3) array
        Base points.
    values : (N,) array
        Relief.
    faces : (F, 3) array
        Triangles.
    measured : (N,) bool array
    normals : (N, 3) array, optional
        Of the base. A jump is then how far two vertices stand apart along their mean normal, steps of the base itself counted in.

    Returns
    -------
    float
        NaN where there is no seam or no ring beside it.
    """
    edges = unique_edges(faces)
    crossing = measured[edges[:, 0]] != measured[edges[:, 1]]
    ring = _rings_from_seam(edges, crossing, measured)
    beside = np.abs(ring[edges[:, 0]] - ring[edges[:, 1]]) == 1
    beside &= (ring[edges] > 0).all(axis=1) & (ring[edges] <= _SEAM_RINGS).all(axis=1)
    if not crossing.any() or not beside.any():
        return float("nan")
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    jump = np.abs(values[edges[:, 0]] - values[edges[:, 1]])
    if normals is not None:
        surface = points + values[:, None] * normals
        along = normals[edges].sum(axis=1)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
        jump = np.abs(np.einsum("ij,ij->i", surface[edges[:, 0]] - surface[edges[:, 1]], along))
    bounds = np.unique(np.quantile(length[beside], np.linspace(0, 1, 9)))
    at = np.clip(np.searchsorted(bounds, length[beside], side="right") - 1, 0, max(len(bounds) - 2, 0))
    count = np.bincount(at)
    use = count > 0
    middle = np.bincount(at, length[beside])[use] / count[use]
    expected = np.interp(length[crossing], middle, np.bincount(at, jump[beside])[use] / count[use])
    total = float(expected.sum())
    if total > 0:
        return float(jump[crossing].sum() / total)
    return 1.0 if jump[crossing].sum() == 0 else float("inf")


def _rings_from_seam(edges: Array, crossing: Array, measured: Array) -> Array:
    """Ring number of measured vertices, 1 at the seam, up to _SEAM_RINGS; 0 elsewhere."""
    ring = np.zeros(len(measured), int)
    ring[np.unique(edges[crossing])] = 1
    ring[~measured] = 0
    inner = edges[measured[edges].all(axis=1)]
    for number in range(2, _SEAM_RINGS + 1):
        near = ring[inner] == number - 1
        reached = np.concatenate([inner[near[:, 0], 1], inner[near[:, 1], 0]])
        ring[reached[ring[reached] == 0]] = number
    return ring


def histogram_overlap(values: Array, reference: Array, bins: int = 64) -> float:
    """Return the shared area of two histograms over [0, 1], 1 for equal ones."""
    a, b = (np.histogram(np.clip(v, 0, 1), bins, (0, 1))[0] / max(len(v), 1) for v in (values, reference))
    return float(np.minimum(a, b).sum())
