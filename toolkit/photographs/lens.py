"""Models of lenses, in double precision: their coefficients, distortion, its inverse, and how far it can be inverted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.kernels.lenses import COEFFICIENTS, DIVISION, FIELD_OF_VIEW, FISHEYE, INVERSE, PERSPECTIVE, UNIFIED

# Larger coefficients are no calibration, and their powers would overflow.
_LARGEST = 1e9

# Where distortion is looked at for folds: distances at depth 1 (87 degrees off the axis), in steps, in directions.
_WIDEST = 20.0
_STEPS = 400
_DIRECTIONS = 32


@dataclass(frozen=True)
class _Model:
    family: int
    names: tuple[str, ...]
    # The kernels' place of each coefficient.
    places: tuple[int, ...]


def _model(family: int, names: str, places: tuple[int, ...]) -> _Model:
    return _Model(family, tuple(names.split()), places)


_MODELS = {
    "opencv": _model(PERSPECTIVE, "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4", (0, 1, 9, 10, 2, 6, 7, 8, 11, 12, 13, 14)),
    "brown": _model(PERSPECTIVE, "k1 k2 k3 k4 p1 p2", (0, 1, 2, 3, 9, 10)),
    "fisheye": _model(FISHEYE, "k1 k2 k3 k4 p1 p2", (0, 1, 2, 3, 9, 10)),
    "thin_prism_fisheye": _model(FISHEYE, "k1 k2 p1 p2 k3 k4 sx1 sy1", (0, 1, 9, 10, 2, 3, 11, 13)),
    "rad_tan_thin_prism_fisheye": _model(
        FISHEYE, "k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3", (0, 1, 2, 3, 4, 5, 10, 9, 11, 12, 13, 14)
    ),
    "fov": _model(FIELD_OF_VIEW, "omega", (0,)),
    "division": _model(DIVISION, "k", (0,)),
    "eucm": _model(UNIFIED, "alpha beta", (0, 1)),
    "inverse": _model(INVERSE, "k", (0,)),
}
MODELS = tuple(_MODELS)

# The place of the flag that says that tangential terms and thin prism apply to what the radial factor has moved.
_AFTER = COEFFICIENTS - 1


def coefficient_names(model: str) -> tuple[str, ...]:
    """Return the names of a model's coefficients, in their order."""
    return _MODELS[model].names


def checked_coefficients(model: str, values: Array) -> Array:
    """Return all coefficients of a model, those that are not given as 0.

    Raises
    ------
    InputError
        If there are more than the model has, or their values can't be those of a lens.
    """
    names = _MODELS[model].names
    if values.ndim != 1 or len(values) > len(names):
        raise InputError(
            f"distortion of the model {model!r} has up to {len(names)} coefficients, {', '.join(names)}, not shape {values.shape}"
        )
    full = np.zeros(len(names))
    full[: len(values)] = values
    if model == "eucm" and len(values) < 2:
        full[1] = 1.0
    wrong = None
    if not (np.abs(full) <= _LARGEST).all():
        wrong = f"{names[int(np.argmax(~(np.abs(full) <= _LARGEST)))]} is out of range"
    elif model == "fov" and abs(full[0]) >= np.pi:
        wrong = f"omega must be an angle below pi, not {full[0]:g}"
    elif model == "eucm" and not (0 <= full[0] <= 1 and full[1] > 0):
        wrong = f"alpha must be from 0 to 1 and beta above 0, not {full[0]:g} and {full[1]:g}"
    if wrong:
        raise InputError(f"distortion of the model {model!r}: {wrong}")
    return full


def is_straight(model: str, values: Array) -> bool:
    """Return whether a lens with these coefficients distorts nothing."""
    family = _MODELS[model].family
    return family != FISHEYE and not (values[:1] if family == UNIFIED else values).any()


def packed(model: str, values: Array) -> tuple[int, Array]:
    """Return a lens's family and its coefficients in the kernels' places."""
    found = np.zeros(COEFFICIENTS)
    found[list(_MODELS[model].places)] = values
    found[_AFTER] = model == "rad_tan_thin_prism_fisheye"
    return _MODELS[model].family, found


def distort(lens: tuple[int, Array], points: Array) -> Array:
    """Return where points (N, 2) at depth 1 appear; as `intaglio.kernels.lenses.distort`, in double precision."""
    family, c = lens
    s = np.sum(points**2, axis=1, keepdims=True)
    r = np.sqrt(s)
    if family == PERSPECTIVE:
        return _polynomial(c, points)[0]
    if family == FISHEYE:
        return _polynomial(c, points * np.divide(np.arctan(r), r, out=np.ones_like(r), where=r > 0))[0]
    return points * _radial(family, c, r)


def undistort(lens: tuple[int, Array], points: Array, reach: float) -> Array:
    """Return the points (N, 2) at depth 1 that appear at ``points``; NaN where none within ``reach`` does."""
    family, c = lens
    with np.errstate(all="ignore"):
        r = np.sqrt(np.sum(points**2, axis=1, keepdims=True))
        if family in (PERSPECTIVE, FISHEYE):
            return _unwound(family, c, points, reach)
        if family == FIELD_OF_VIEW:
            far = r * abs(c[0])
            factor = np.where(far < np.pi / 2, np.tan(far) / np.where(far > 0, 2 * r * np.tan(abs(c[0]) / 2), 1), np.nan)
            factor = np.where(far > 1e-9, factor, c[0] / (2 * np.tan(c[0] / 2)) if c[0] else 1.0)
        elif family == DIVISION:
            # Beyond r' = 1 / sqrt(k), where 1 + k r'^2 is 2, points would come back to the axis.
            under = 1 + c[0] * r**2
            factor = np.where((under > 0) & (under <= 2 * (1 + 1e-12)), 1 / under, np.nan)
        elif family == UNIFIED:
            alpha, beta = c[0], c[1]
            inner = 1 - (2 * alpha - 1) * beta * r**2
            depth = (1 - alpha**2 * beta * r**2) / (alpha * np.sqrt(inner) + 1 - alpha)
            factor = np.where(depth > 0, 1 / depth, np.nan)
        else:
            factor = np.where(1 + 3 * c[0] * r**2 > 0, 1 + c[0] * r**2, np.nan)
        return np.asarray(points * factor)


def reach_of(lens: tuple[int, Array]) -> float:
    """Return the squared distance from the axis, at depth 1 and before distortion, up to which distortion can be inverted."""
    family, c = lens
    if family == DIVISION:
        return 1 / (4 * c[0]) if c[0] > 0 else np.inf
    if family == INVERSE:
        # The turning point of r (1 + k r^2), r^2 = -1 / 3k, is met at 2/3 r.
        return 4 / (-27 * c[0]) if c[0] < 0 else np.inf
    if family not in (PERSPECTIVE, FISHEYE):
        return np.inf
    limit = np.sqrt(_radial_reach(c))
    if c[9:15].any():
        limit = min(limit, _unfolded(c, limit if family == PERSPECTIVE else min(limit, np.pi / 2)))
    if family == FISHEYE:
        limit = np.tan(limit) if limit < np.pi / 2 else np.inf
    return float(limit**2)


def _radial(family: int, c: Array, r: Array) -> Array:
    """Return factors of the families that are no polynomials at distances r."""
    if family == FIELD_OF_VIEW:
        if c[0] == 0:
            return np.ones_like(r)
        wide = 2 * np.tan(c[0] / 2)
        return np.divide(np.arctan(r * wide), r * c[0], out=np.full_like(r, wide / c[0]), where=r > 1e-9)
    if family == DIVISION:
        return np.asarray(2 / (1 + np.sqrt(np.maximum(1 - 4 * c[0] * r**2, 0))))
    if family == UNIFIED:
        return np.asarray(1 / (c[0] * np.sqrt(c[1] * r**2 + 1) + 1 - c[0]))
    turn = np.sqrt(-1 / (3 * c[0])) if c[0] < 0 else np.inf
    moved = np.minimum(r, turn if c[0] <= 0 else np.cbrt(r / c[0]))
    for _ in range(60):
        slope = 1 + 3 * c[0] * moved**2
        moved = moved - np.divide(moved * (1 + c[0] * moved**2) - r, slope, out=np.zeros_like(r), where=slope > 1e-12)
    return np.divide(moved, r, out=np.ones_like(r), where=r > 0)


def _polynomial(c: Array, points: Array) -> tuple[Array, Array]:
    """Return where points (N, 2) go, and the derivatives (N, 2, 2) of that by them."""
    x, y = points[:, 0], points[:, 1]
    s = x * x + y * y
    over, under = np.polynomial.Polynomial([1, *c[:6]]), np.polynomial.Polynomial([1, *c[6:9]])
    with np.errstate(all="ignore"):
        factor = over(s) / under(s)
        slope = (over.deriv()(s) - factor * under.deriv()(s)) / under(s)
        moved = points * factor[:, None]
        change = factor[:, None, None] * np.eye(2) + 2 * slope[:, None, None] * points[:, :, None] * points[:, None, :]
        base = moved if c[_AFTER] else points
        a, b = base[:, 0], base[:, 1]
        q = a * a + b * b
        p1, p2, s1, s2, s3, s4 = c[9:15]
        extra = np.stack(
            [
                2 * p1 * a * b + p2 * (q + 2 * a * a) + q * (s1 + q * s2),
                2 * p2 * a * b + p1 * (q + 2 * b * b) + q * (s3 + q * s4),
            ],
            axis=1,
        )
        along = np.stack(
            [
                2 * p1 * b + 6 * p2 * a + 2 * a * (s1 + 2 * q * s2),
                2 * p1 * a + 2 * p2 * b + 2 * b * (s1 + 2 * q * s2),
                2 * p2 * b + 2 * p1 * a + 2 * a * (s3 + 2 * q * s4),
                2 * p2 * a + 6 * p1 * b + 2 * b * (s3 + 2 * q * s4),
            ],
            axis=1,
        ).reshape(-1, 2, 2)
        change = change + (along @ change if c[_AFTER] else along)
    return moved + extra, change


def _radial_reach(c: Array) -> float:
    """Return the smallest s at which r F(r^2) of the polynomials stops growing, or F has a pole; infinite if none."""
    over, under = np.polynomial.Polynomial([1, *c[:6]]), np.polynomial.Polynomial([1, *c[6:9]])
    s = np.polynomial.Polynomial([0, 1])
    growth = (over + 2 * s * over.deriv()) * under - 2 * s * over * under.deriv()
    found = []
    for one in (growth, under):
        # Coefficients that underflow beside the others would give infinities in the companion matrix.
        kept = np.where(np.abs(one.coef) < 1e-20, 0, one.coef)
        roots = np.roots(np.trim_zeros(kept[::-1], "f"))
        found += list(roots.real[(np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))) & (roots.real > 0)])
    return float(min(found, default=np.inf))


def _unfolded(c: Array, limit: float) -> float:
    """Return the distance up to which the polynomials turn no direction back, at most ``limit``."""
    widest = min(limit, _WIDEST)
    r = np.linspace(0, widest, _STEPS)[1:]
    angle = np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    at = r[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    change = _polynomial(c, at.reshape(-1, 2))[1]
    with np.errstate(all="ignore"):
        det = change[:, 0, 0] * change[:, 1, 1] - change[:, 0, 1] * change[:, 1, 0]
    fine = (det > 0).reshape(len(r), -1).all(axis=1)
    return limit if fine.all() else float(np.concatenate([[0.0], r])[int(np.argmin(fine))])


def _unwound(family: int, c: Array, points: Array, reach: float) -> Array:
    """Return the points at depth 1 that the polynomials bring to ``points``, by Newton's method from the radial solution."""
    far = np.sqrt(reach) if np.isfinite(reach) else np.inf
    limit = min(far, 1e4) if family == PERSPECTIVE else np.arctan(far)
    r = np.concatenate([np.linspace(0, min(limit, 4.0), 2000), np.geomspace(4.0, limit, 500) if limit > 4 else []])
    over, under = np.polynomial.Polynomial([1, *c[:6]]), np.polynomial.Polynomial([1, *c[6:9]])
    table = np.maximum.accumulate(r * over(r**2) / under(r**2))
    wanted = np.sqrt(np.sum(points**2, axis=1))
    start = np.interp(wanted, table, r)
    guess = points * np.divide(start, wanted, out=np.ones_like(wanted), where=wanted > 0)[:, None]
    for _ in range(30):
        at, change = _polynomial(c, guess)
        det = change[:, 0, 0] * change[:, 1, 1] - change[:, 0, 1] * change[:, 1, 0]
        off = at - points
        step = (
            np.stack(
                [
                    change[:, 1, 1] * off[:, 0] - change[:, 0, 1] * off[:, 1],
                    change[:, 0, 0] * off[:, 1] - change[:, 1, 0] * off[:, 0],
                ],
                axis=1,
            )
            / np.where(det == 0, np.nan, det)[:, None]
        )
        guess = guess - step
    off = np.abs(_polynomial(c, guess)[0] - points).max(axis=1)
    distance = np.sqrt(np.sum(guess**2, axis=1))
    good = (off <= 1e-9 * (1 + wanted)) & (distance <= limit * (1 + 1e-9))
    if family == FISHEYE:
        good &= distance < np.pi / 2
        guess = guess * np.divide(np.tan(distance), distance, out=np.ones_like(distance), where=distance > 0)[:, None]
    return np.where(good[:, None], guess, np.nan)
