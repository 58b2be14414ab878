"""Fitting the smooth base, stage one of Breckon & Fisher: plane, circular cylinder or sphere by orthogonal distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from intaglio.arrays import Array
from intaglio.checks import checked_arguments, checked_numeric, shown
from intaglio.errors import FitError, InputError
from intaglio.mesh import Base, BaseFit, Cylinder, Plane, Sphere, Surface, perpendicular, unit

KINDS = ("plane", "cylinder", "sphere")

# Relief is correlated over its features, so N vertices are far fewer independent observations; the information criterion
# counts at most this many. With all of them, any base would be "significantly" better than any other.
_INDEPENDENT_SAMPLES = 200
# If the scores of two kinds differ by less than this, the data does not decide between them (a difference of 10 is
# usually taken for strong evidence).
_AMBIGUITY = 10.0
# A residual above this share of the scan's diagonal is shape, not relief.
_POOR = 0.04
# So many points are fitted, and the residuals of so many are looked at.
_FIT_POINTS, JUDGED = 6_000, 1_000_000
# So many are gone through at once.
_AT_ONCE = 1 << 16


@checked_arguments
def fit_base(points: Array | Surface, kinds: Sequence[str] = KINDS) -> Base:
    """Fit the base shape that explains points best.

    Every kind is fitted by least squares of the orthogonal (geometric) distances under a robust loss (Cauchy, scaled by
    the median absolute deviation), so that relief on one side of the base, such as dimples or bumps, pulls it little. The
    kind with the least ``n log(s^2) + k log(n)`` is chosen, where s is the mean absolute residual, k the number of
    parameters, and n the number of points, but at most 200, since neighbouring points are not independent. Of more than
    6,000 points, 6,000 evenly spaced in index are fitted; the residuals are those of all, or of a million evenly spaced.

    Parameters
    ----------
    points : (N, 3) array or Surface
        At least 6 points in any unit of length, which the result keeps.
    kinds : sequence of str or str, optional
        The kinds to try, among "plane", "cylinder" and "sphere". Default all three.

    Returns
    -------
    Base
        A `Plane`, `Cylinder` or `Sphere`. Its ``fit`` holds the residuals of every kind; ``fit.ambiguous`` is True if another
        kind fits about as well, as for a nearly flat piece of a large sphere.

    Raises
    ------
    InputError
        If points are not (N, 3) finite numbers, their extent is out of range, or a kind is unknown.
    FitError
        If there are fewer than 6 points, all lie on a line or in one place, or no kind can be fitted.

    References
    ----------
    Breckon & Fisher, "Three-Dimensional Surface Relief Completion via Nonparametric Techniques", IEEE TPAMI 30(12), 2008,
    section 2.1.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> rng = np.random.default_rng(0)
    >>> directions = rng.standard_normal((300, 3))
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> points = (10 + 0.05 * rng.standard_normal((300, 1))) * directions + [1, 2, 3]
    >>> base = intaglio.fit_base(points)
    >>> base.kind, round(base.radius, 1), base.center.round(1)
    ('sphere', 10.0, array([1., 2., 3.]))
    >>> base.fit.ambiguous
    False
    """
    points = _checked(points.vertices if isinstance(points, Surface) else points)
    kinds = (kinds,) if isinstance(kinds, str) else tuple(kinds)
    unknown = [k for k in kinds if k not in KINDS]
    if unknown or not kinds:
        what = f"name an unknown base, {shown(unknown[0])}" if unknown else "name no base"
        raise InputError(f"kinds {what}; known: {', '.join(KINDS)}")
    center = points.mean(axis=0)
    square = np.empty(len(points))
    for at in range(0, len(points), _AT_ONCE):
        square[at : at + _AT_ONCE] = ((points[at : at + _AT_ONCE] - center) ** 2).sum(axis=1)
    size = float(np.sqrt(square.mean()))
    # The fits run on coordinates of unit size at the origin, since large survey coordinates would cost precision.
    sample = (evenly(points, _FIT_POINTS) - center) / size
    fitters = {"plane": _fit_plane, "cylinder": _fit_cylinder, "sphere": _fit_sphere}
    fits = {kind: _restore(fitters[kind](sample), center, size) for kind in kinds}
    extent = float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))
    return _choose(fits, evenly(points, JUDGED), size, extent)


def evenly(points: Array, most: int) -> Array:
    """Return at most so many of points (N, 3), evenly spaced in index."""
    return points if len(points) <= most else points[np.linspace(0, len(points) - 1, most).astype(int)]


def _choose(fits: dict[str, Base | None], points: Array, size: float, extent: float) -> Base:
    n = min(len(points), _INDEPENDENT_SAMPLES)
    floor = 1e-9 * size
    table: dict[str, tuple[float, float]] = {}
    bases: dict[str, Base] = {}
    for kind, base in fits.items():
        if base is None:
            continue
        distance = base.distance(points)
        rms = float(np.sqrt((distance**2).mean()))
        spread = max(float(np.abs(distance - np.median(distance)).mean()), floor)
        table[kind] = (rms, n * np.log(spread**2 / size**2) + base.parameter_count * np.log(n))
        middle = np.median(distance)
        scale = 1.4826 * float(np.median(np.abs(distance - middle)))
        bases[kind] = replace(base, fit=BaseFit(rms=rms, robust_scale=scale))
    if not table:
        raise FitError("no base could be fitted: the points give no plane, cylinder or sphere of finite size")
    ranked = sorted(table, key=lambda k: table[k][1])
    best = bases[ranked[0]]
    assert best.fit is not None
    ambiguous, note = False, f"{best.kind} chosen, rms residual {best.fit.rms:.6g}"
    if len(ranked) > 1:
        rival = ranked[1]
        margin = table[rival][1] - table[ranked[0]][1]
        ambiguous = bool(margin < _AMBIGUITY)
        verdict = "the data does not decide between them" if ambiguous else "clear"
        note += f"; next {rival} with {table[rival][0]:.6g} ({verdict}, score margin {margin:.1f})"
    poor = best.fit.rms > _POOR * extent
    if poor:
        note += f"; poor fit, the residual is {best.fit.rms / extent:.0%} of the scan's diagonal"
    return replace(best, fit=replace(best.fit, candidates=table, ambiguous=ambiguous, poor=poor, note=note))


def _checked(points: Array) -> Array:
    points = checked_numeric("points", points, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points must have shape (N, 3), not {points.shape}")
    if not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise InputError(f"points are not finite: point {bad} is {points[bad]}")
    if len(points) < 6:
        raise FitError(f"{len(points)} points are too few to fit a base; at least 6 are needed")
    extent = float((points.max(axis=0) - points.min(axis=0)).max())
    if not 1e-100 < extent < 1e100 and extent > 0:
        raise InputError(f"points extend over {extent:.3g} units: choose a unit closer to the size of the object")
    some = evenly(points, JUDGED)
    spread = np.linalg.svd(some - some.mean(axis=0), compute_uv=False)
    if spread[0] == 0:
        raise FitError("all points are in one place; no base can be fitted")
    if spread[1] < 1e-6 * spread[0]:
        raise FitError("all points lie on a line; no base can be fitted")
    return points


def _robust(residual: object, start: Array) -> Array | None:
    """Refine ``start`` by robust least squares; the loss is scaled by the residuals' own median deviation."""
    first = least_squares(residual, start, method="lm", max_nfev=400) if callable(residual) else None
    if first is None or not np.isfinite(first.x).all():
        return None
    x = first.x
    for _ in range(2):
        r = residual(x)  # type: ignore[operator]
        scale = max(1.4826 * float(np.median(np.abs(r - np.median(r)))), 1e-9)
        x = least_squares(residual, x, loss="cauchy", f_scale=0.5 * scale, max_nfev=200).x
    return x if np.isfinite(x).all() else None


def _fit_plane(p: Array) -> Plane | None:
    center = p.mean(axis=0)
    normal = np.linalg.svd(p - center, full_matrices=False)[2][2]
    u = perpendicular(normal)
    v = np.cross(normal, u)

    def plane(x: Array) -> tuple[Array, float]:
        return unit(normal + x[0] * u + x[1] * v), float(x[2])

    def residual(x: Array) -> Array:
        n, offset = plane(x)
        return (p - center) @ n - offset

    x = _robust(residual, np.zeros(3))
    if x is None:
        return None
    n, offset = plane(x)
    # The chart's first axis follows the longer side of the piece.
    long_side = np.linalg.svd(p - center, full_matrices=False)[2][0]
    return Plane(point=center + offset * n, normal=n, direction=long_side)


def _fit_sphere(p: Array) -> Sphere | None:
    # The algebraic start solves |p|^2 = 2 c.p + (r^2 - |c|^2), which is linear in c and the bracket.
    a = np.column_stack([2 * p, np.ones(len(p))])
    solution, _, rank, _ = np.linalg.lstsq(a, (p**2).sum(axis=1), rcond=1e-12)
    if rank < 4:
        return None
    center = solution[:3]
    square = solution[3] + center @ center
    if square <= 0:
        return None

    def residual(x: Array) -> Array:
        return np.linalg.norm(p - x[:3], axis=1) - x[3]

    x = _robust(residual, np.array([*center, np.sqrt(square)]))
    # A sphere with a radius of a thousand extents is practically a plane, and its centre is noise.
    return Sphere(center=x[:3], radius=x[3]) if x is not None and 0 < x[3] < 1e3 else None


def _fit_cylinder(p: Array) -> Cylinder | None:
    best: tuple[float, Array, Array] | None = None
    coarse = p if len(p) <= 600 else p[np.linspace(0, len(p) - 1, 600).astype(int)]
    starts = []
    for axis in _hemisphere(200):
        fit = _circle(coarse, axis)
        if fit is not None:
            starts.append((fit[1], axis, fit[0]))
    for _, axis, circle in sorted(starts, key=lambda s: s[0])[:3]:
        e1 = perpendicular(axis)
        e2 = np.cross(axis, e1)

        def cylinder(x: Array, axis: Array = axis, e1: Array = e1, e2: Array = e2) -> tuple[Array, Array]:
            return x[2] * e1 + x[3] * e2, unit(axis + x[0] * e1 + x[1] * e2)

        def residual(x: Array, cylinder: object = cylinder, q: Array = coarse) -> Array:
            point, a = cylinder(x)  # type: ignore[operator]
            relative = q - point
            return np.linalg.norm(relative - (relative @ a)[:, None] * a, axis=1) - x[4]

        x = _robust(residual, np.array([0.0, 0.0, *circle]))
        if x is None or not 0 < abs(x[4]) < 1e3:
            continue
        cost = float(np.abs(residual(x)).mean())
        if best is None or cost < best[0]:
            if len(p) > len(coarse):
                refined = _robust(lambda y, c=cylinder, r=residual: r(y, c, p), x)
                x = x if refined is None else refined
            point, a = cylinder(x)
            best = (cost, np.array([*point, abs(x[4])]), a)
    if best is None:
        return None
    _, circle, axis = best
    point = circle[:3] - (circle[:3] @ axis) * axis
    return Cylinder(point=point, axis=axis, radius=circle[3])


def _circle(p: Array, axis: Array) -> tuple[Array, float] | None:
    """Fit a circle to the points seen along ``axis``; return centre and radius (3,), and the mean absolute residual."""
    e1 = perpendicular(axis)
    q = p @ np.stack([e1, np.cross(axis, e1)], axis=1)
    solution, _, rank, _ = np.linalg.lstsq(np.column_stack([2 * q, np.ones(len(q))]), (q**2).sum(axis=1), rcond=1e-10)
    square = solution[2] + solution[:2] @ solution[:2]
    if rank < 3 or square <= 0:
        return None
    radius = np.sqrt(square)
    error = float(np.abs(np.linalg.norm(q - solution[:2], axis=1) - radius).mean())
    return np.array([solution[0], solution[1], radius]), error


def _hemisphere(count: int) -> Array:
    """Return ``count`` directions spread evenly over a hemisphere (Fibonacci lattice)."""
    i = np.arange(count) + 0.5
    z = 1 - i / count
    angle = np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def _restore(base: Base | None, center: Array, size: float) -> Base | None:
    """Bring a base fitted to scaled points back to the input's coordinates."""
    if isinstance(base, Plane):
        return replace(base, point=base.point * size + center)
    if isinstance(base, Cylinder):
        return replace(base, point=base.point * size + center, radius=base.radius * size)
    if isinstance(base, Sphere):
        return replace(base, center=base.center * size + center, radius=base.radius * size)
    return None
