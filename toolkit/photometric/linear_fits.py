"""Fits that are linear in the images: every map is a weighted sum of photographs, and so is every relit image.

With images as columns of I, maps are M₁ = I F, and an image relit by light l is I F c(l): F (K, n) and c come from the
lights, and for eigen images from the K x K products of the images. Errors of reconstruction and of prediction are then
quadratic forms of those products too.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.optimize import linear_sum_assignment

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.photometric.bases import (
    Basis,
    HemisphericalBasis,
    LambertBasis,
    PolynomialBasis,
    ThreeImageBasis,
    coefficients,
    need_rank,
)
from intaglio.photometric.interpolation import CHARTS, KERNELS, TRENDS, interpolate, need_spread, smooth, smooth_matrix
from intaglio.photometric.light_positions import light_direction

LEAST_SQUARES = ("gradient", "ptm", "hsh")
LINEAR_KINDS = ("3i", *LEAST_SQUARES, "eigen3", "eigen6", "rbf")

# The smoothings among which cross-validation chooses.
SMOOTHING = (0.0, 1e-4, 1e-3, 1e-2, 3e-2, 1e-1)
MOST_COMPONENTS = 18
MOST_SMOOTHING = 1e6
SCHEMES = ("auto", "grid", "triangles")

# Chart, kernel, trend and smoothing of a radial basis.
Scheme = tuple[str, str, str, float]


@dataclass(frozen=True)
class Moments:
    """Sums over all values (pixels times channels) of a stack.

    Attributes
    ----------
    products : (K, K) float64 array
        Σ i_j i_k, for images j and k.
    sums : (K,) float64 array
        Σ i_k.
    count : int
        Number of values.
    """

    products: Array
    sums: Array
    count: int

    @property
    def deviation(self) -> Array:
        """(K,) standard deviations of the images."""
        mean = self.sums / self.count
        return np.sqrt(np.maximum(np.diag(self.products) / self.count - mean * mean, 0))

    def subset(self, chosen: Array) -> Moments:
        """Return the sums of some of the images."""
        return Moments(self.products[np.ix_(chosen, chosen)], self.sums[chosen], self.count)

    def error(self, relit: Array) -> float:
        """Return η (eq. 4.5.1) of images relit as I R, without clipping at zero; ``relit`` is R (K, K)."""
        away = relit - np.eye(len(relit))
        squared = ((self.products @ away) * away).sum(axis=0)
        usable = self.deviation > 0
        if not usable.any():
            return 0.0
        return float(np.mean(np.sqrt(np.maximum(squared[usable], 0) / self.count) / self.deviation[usable]))


@dataclass(frozen=True)
class Settings:
    """Options of the kinds.

    Attributes
    ----------
    order : {2, 3}
        For ``"hsh"``.
    interpolation : {"auto", "grid", "triangles"}
        For ``"eigen3"`` and ``"eigen6"``.
    components : int, optional
        For ``"rbf"``; default: the fewest that predict within 0.5 % of the best, at most 18.
    smoothing : float, optional
        For ``"rbf"``; default by cross-validation.
    """

    order: int = 3
    interpolation: str = "auto"
    components: int | None = None
    smoothing: float | None = None

    def checked(self) -> Settings:
        """Return the settings, or raise `InputError` if one is out of range whatever the stack."""
        if self.order not in (2, 3) or not isinstance(self.order, int):
            raise InputError(f"order {self.order} of hemispherical harmonics is not known; 2 (4 maps) or 3 (9 maps)")
        if self.interpolation not in SCHEMES:
            raise InputError(f"interpolation {self.interpolation!r} is not known; known: {', '.join(SCHEMES)}")
        if self.components is not None and (not isinstance(self.components, int | np.integer) or self.components < 1):
            raise InputError(f"components must be a whole number of at least 1, not {self.components!r}")
        is_number = isinstance(self.smoothing, int | float | np.number)
        if self.smoothing is not None and not (is_number and 0 <= self.smoothing <= MOST_SMOOTHING):
            raise InputError(f"smoothing must be a number from 0 to {MOST_SMOOTHING:g}, not {self.smoothing!r}")
        return self


@dataclass(frozen=True)
class LinearFit:
    """F and c: maps are Σ_k weights[k, j] image_k.

    Attributes
    ----------
    weights : (K, n) float64 array
    basis : Basis
    notes : tuple of str
        What was chosen, as sentences for the user.
    """

    weights: Array
    basis: Basis
    notes: tuple[str, ...] = field(default=())


def fit_linear(kind: str, lights: Array, moments: Moments | None, settings: Settings) -> LinearFit:
    """Return the fit of a linear kind to a stack with ``lights``; eigen kinds and ``"rbf"`` need its ``moments``.

    Raises
    ------
    InputError
        If there are too few images, the lights don't determine the coefficients, or a setting is out of range.
    """
    if kind == "3i":
        return _three_images(lights)
    if kind in LEAST_SQUARES:
        basis, names = _least_squares_basis(kind, settings)
        matrix = coefficients(basis, lights)
        need_rank(matrix, kind, names)
        return LinearFit(np.linalg.pinv(matrix).T, basis)
    assert moments is not None
    if kind in ("eigen3", "eigen6"):
        count = int(kind[-1])
        vectors = principal(moments, count, kind)
        share = information(moments)
        alone = ", ".join(f"{one:.2%}" for one in individual_information(moments)[:count])
        held = f"{share[count - 1]:.2%} of the information (eq. 4.4.13), one by one {alone} (eq. 4.4.12)"
        note = f"{kind}: {count} base images hold {held}"
        return LinearFit(vectors, interpolate(lights, vectors, settings.interpolation), (note,))
    return _smooth_fit(lights, moments, settings)


def prediction(kind: str, lights: Array, moments: Moments | None, settings: Settings) -> Array:
    """Return R (K, K), whose column k makes image k, relit by a fit to all other images (leave one out), from these.

    For least squares it follows from the hat matrix H: (H − diag H) / (1 − diag H) by columns; otherwise every fit is made,
    from the products of the images alone. Eigen kinds on a grid of lights are interpolated over triangles, since without one
    light the grid is not full.
    """
    count = len(lights)
    settings = replace(settings, interpolation="auto")
    if kind in LEAST_SQUARES:
        fit = fit_linear(kind, lights, None, settings)
        hat = fit.weights @ coefficients(fit.basis, lights).T
        own = np.diag(hat)
        if not (own < 1 - 1e-9).all():
            k = int(np.argmax(own))
            raise InputError(f"without image {k} the lights no longer determine {kind!r}; more images are needed")
        return np.asarray((hat - np.diag(own)) / (1 - own)[None, :])
    if kind == "rbf":
        assert moments is not None
        return _smooth_left_out(lights, moments, settings)
    relit = np.zeros((count, count))
    for k in range(count):
        others = np.delete(np.arange(count), k)
        fit = fit_linear(kind, lights[others], None if moments is None else moments.subset(others), settings)
        relit[others, k] = fit.weights @ coefficients(fit.basis, lights[k : k + 1])[0]
    return relit


def reconstruction(fit: LinearFit, lights: Array) -> Array:
    """Return R (K, K): column k gives image k relit from the fit to all images."""
    return np.asarray(fit.weights @ coefficients(fit.basis, lights).T)


def principal(moments: Moments, count: int, kind: str) -> Array:
    """Return the first ``count`` right singular vectors (K, count) of the image matrix, largest first, each of positive sum.

    They are the eigenvectors of IᵀI, from which the eigen base images U W = I V of I = U W Vᵀ follow (eq. 4.4.14).
    """
    if len(moments.products) < count:
        raise InputError(f"kind {kind!r} keeps {count} base images, the stack has only {len(moments.products)} images")
    _, vectors = np.linalg.eigh(moments.products)
    vectors = vectors[:, ::-1][:, :count]
    signs = np.sign(vectors.sum(axis=0))
    return np.ascontiguousarray(vectors * np.where(signs == 0, 1, signs))


def information(moments: Moments) -> Array:
    """Return the cumulative information of the eigenvectors, √(Σ_{i≤k} w²/Σ w²) (eq. 4.4.13), (K,)."""
    return np.sqrt(np.cumsum(individual_information(moments) ** 2))


def individual_information(moments: Moments) -> Array:
    """Return the information of each eigenvector, √(w_k²/Σ w²) (eq. 4.4.12), (K,)."""
    values = np.maximum(np.linalg.eigvalsh(moments.products)[::-1], 0)
    return np.sqrt(values / max(values.sum(), 1e-300))


def _three_images(lights: Array) -> LinearFit:
    """Take the photographs whose lights are nearest to slant 45° and tilts 0°, 90° and 180°."""
    if len(lights) < 3:
        raise InputError(f"kind '3i' needs 3 images, the stack has {len(lights)}")
    wanted = np.stack([light_direction(tilt, 45.0) for tilt in (0.0, 90.0, 180.0)])
    away = np.arccos(np.clip(wanted @ lights.T, -1, 1))
    _, chosen = linear_sum_assignment(away)
    basis = ThreeImageBasis(np.ascontiguousarray(lights[chosen]))
    if np.linalg.svd(basis.lights, compute_uv=False)[-1] < 0.05:
        raise InputError("the three lights nearest to slant 45° and tilts 0°, 90°, 180° lie in one plane; use 'gradient'")
    weights = np.zeros((len(lights), 3))
    weights[chosen, np.arange(3)] = 1
    degrees = np.degrees(away[np.arange(3), chosen])
    note = f"3i uses images {', '.join(str(c) for c in chosen)}, {degrees.max():.0f} degrees at most from the thesis's lights"
    return LinearFit(weights, basis, (note,))


def _least_squares_basis(kind: str, settings: Settings) -> tuple[Basis, tuple[str, ...]]:
    if kind == "gradient":
        return LambertBasis(), ("x", "y", "z")
    if kind == "ptm":
        return PolynomialBasis(), ("x²", "y²", "xy", "x", "y", "1")
    basis = HemisphericalBasis(settings.order)
    return basis, tuple(f"h{i}" for i in range(basis.size))


def _smooth_fit(lights: Array, moments: Moments, settings: Settings) -> LinearFit:
    """Fit principal components whose coefficients are interpolated by radial functions that have least leave-one-out error."""
    inverses = _smooth_inverses(lights, settings)
    scheme, error = _best_scheme(inverses, moments)
    components = settings.components or _enough_components(_left_out(inverses[scheme]), moments)
    vectors = principal(moments, components, "rbf")
    chart, kernel, trend, smoothing = scheme
    note = (
        f"rbf: {components} components, {kernel} in {chart} coordinates with {trend} trend, smoothing {smoothing:g}, "
        f"leave-one-out error {error:.3f} before cutting components"
    )
    return LinearFit(vectors, smooth(lights, vectors, *scheme), (note,))


def _smooth_left_out(lights: Array, moments: Moments, settings: Settings) -> Array:
    """Return R (K, K) as `prediction`, where for every image that is left out the scheme is chosen again without it.

    The inverse without a light follows from that with all of them: of M⁻¹ = [[B, b], [bᵀ, β]] it is B − b bᵀ / β.
    """
    inverses = _smooth_inverses(lights, settings)
    scheme, _ = _best_scheme(inverses, moments)
    components = settings.components or _enough_components(_left_out(inverses[scheme]), moments)
    count = len(lights)
    relit = np.zeros((count, count))
    for k in range(count):
        others = np.delete(np.arange(count), k)
        inner = moments.subset(others)
        rest = {s: left for s, part in inverses.items() if (left := _without(part, k)) is not None}
        if not rest:
            raise InputError(f"without image {k} there are too few lights to interpolate between; more images are needed")
        scheme, _ = _best_scheme(rest, inner)
        vectors = principal(inner, min(components, count - 1), "rbf")
        relit[others, k] = vectors @ (vectors.T @ _left_out(inverses[scheme])[others, k])
    return relit


def _smooth_inverses(lights: Array, settings: Settings) -> dict[Scheme, Array]:
    """Return the part (K, K) over the lights of every scheme's inverted system; ill-conditioned schemes are left out."""
    count = len(lights)
    if count < 6:
        raise InputError(f"kind 'rbf' needs at least 6 images, the stack has {count}")
    if settings.components is not None and settings.components > count:
        raise InputError(f"components must be from 1 to the number of images, {count}, not {settings.components}")
    need_spread(lights)
    tried = SMOOTHING if settings.smoothing is None else (settings.smoothing,)
    inverses: dict[Scheme, Array] = {}
    for chart, kernel, trend, smoothing in product(CHARTS, KERNELS, TRENDS, tried):
        if chart == "chord" and trend == "chart":
            continue  # the coordinates of the chord are those of Lambert's law
        system, _ = smooth_matrix(lights, chart, kernel, trend, smoothing)
        try:
            inverse = np.linalg.inv(system)
        except np.linalg.LinAlgError:
            continue
        part = np.ascontiguousarray(inverse[:count, :count])
        if np.linalg.norm(system, 1) * np.linalg.norm(inverse, 1) < 1e12 and (np.abs(np.diag(part)) > 1e-12).all():
            inverses[chart, kernel, trend, smoothing] = part
    if not inverses:
        raise InputError("the lights are too close together to interpolate between them smoothly; use 'gradient' or 'ptm'")
    return inverses


def _without(part: Array, k: int) -> Array | None:
    """Return a scheme's inverse without light k; None if the other lights, or these without another one, hardly determine it."""
    scale = np.abs(np.diag(part)).max()
    if np.abs(part[k, k]) < 1e-6 * scale:
        return None
    others = np.delete(np.arange(len(part)), k)
    rest = part[np.ix_(others, others)] - np.outer(part[others, k], part[others, k]) / part[k, k]
    return None if (np.abs(np.diag(rest)) < 1e-6 * scale).any() else np.asarray(rest)


def _left_out(part: Array) -> Array:
    """Return R (K, K), whose column k interpolates image k from the others, with all components kept.

    The error at a light that is left out is (A⁻¹y)_k / (A⁻¹)_kk, where A is the interpolation's system.
    """
    return np.asarray(np.eye(len(part)) - (part / np.diag(part)[:, None]).T)


def _best_scheme(inverses: dict[Scheme, Array], moments: Moments) -> tuple[Scheme, float]:
    """Return the scheme of least leave-one-out error, and the error."""
    errors = {scheme: moments.error(_left_out(part)) for scheme, part in inverses.items()}
    scheme = min(errors, key=lambda s: errors[s])
    return scheme, errors[scheme]


def _enough_components(left_out: Array, moments: Moments) -> int:
    """Return the fewest components that predict within 0.5 % of the best number, up to `MOST_COMPONENTS`."""
    count = len(left_out)
    tried = [n for n in (3, 4, 5, 6, 8, 10, 12, 15, MOST_COMPONENTS) if n < count - 1]
    relit = np.zeros((len(tried), count, count))
    for k in range(count):
        others = np.delete(np.arange(count), k)
        vectors = principal(moments.subset(others), tried[-1], "rbf")
        for i, n in enumerate(tried):
            relit[i, others, k] = vectors[:, :n] @ (vectors[:, :n].T @ left_out[others, k])
    errors = np.array([moments.error(r) for r in relit])
    return tried[int(np.argmax(errors <= 1.005 * errors.min()))]
