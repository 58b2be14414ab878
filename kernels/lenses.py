"""What lenses do to pictures: where a point in front of the camera appears, before the camera's matrix."""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

# Families of lenses.
PERSPECTIVE = 0
FISHEYE = 1
FIELD_OF_VIEW = 2
DIVISION = 3
UNIFIED = 4
INVERSE = 5

# Coefficients, of all families. Polynomials, in the squared distance s from the axis (of a fisheye: the squared angle): six of
# the numerator of the radial factor, three of its denominator, two tangential ones p1 and p2, four of a thin prism, and 1 if the
# last six apply to what the radial factor has moved already. The other families have theirs in the first places.
COEFFICIENTS = 16
coefficients = wp.types.vector(length=COEFFICIENTS, dtype=wp.float32)

# Newton steps to the root of VisualSFM's cubic, which start close to it.
_STEPS = wp.constant(8)


@wp.func
def radial(family: int, c: coefficients, x: float, y: float) -> float:
    """Return the factor of a radial function of the families that are no polynomials: FOV, division, unified, inverse."""
    s = x * x + y * y
    r = wp.sqrt(s)
    factor = float(1.0)
    if family == 2:
        # Devernay & Faugeras 2001: atan(2 r tan(w / 2)) / (w r).
        wide = 2.0 * wp.tan(0.5 * c[0])
        if wp.abs(c[0]) > 1.0e-4:
            factor = wide / c[0]
            if r * wp.abs(wide) > 1.0e-4:
                factor = wp.atan(r * wide) / (r * c[0])
    elif family == 3:
        # Fitzgibbon 2001: r = r' / (1 + k r'^2), solved for r'.
        factor = 2.0 / (1.0 + wp.sqrt(wp.max(1.0 - 4.0 * c[0] * s, 0.0)))
    elif family == 4:
        # Khomutenko et al. 2016: 1 / (alpha sqrt(beta r^2 + 1) + 1 - alpha).
        factor = 1.0 / (c[0] * wp.sqrt(c[1] * s + 1.0) + 1.0 - c[0])
    elif family == 5:
        # VisualSFM: r = r' (1 + k r'^2), solved for r'; for k < 0 the root below the cubic's turning point.
        moved = float(r)
        if c[0] < 0.0:
            moved = wp.min(r, wp.sqrt(1.0 / (-3.0 * c[0])))
        else:
            moved = wp.min(r, wp.pow(r / wp.max(c[0], 1.0e-20), 1.0 / 3.0))
        for _ in range(_STEPS):
            slope = 1.0 + 3.0 * c[0] * moved * moved
            if wp.abs(slope) > 1.0e-6:
                moved -= (moved * (1.0 + c[0] * moved * moved) - r) / slope
        if r > 1.0e-12:
            factor = moved / r
    return factor


@wp.func
def polynomial(c: coefficients, x: float, y: float) -> wp.vec2:
    """Return where a point goes by radial factor, tangential terms and thin prism."""
    s = x * x + y * y
    over = 1.0 + s * (c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * (c[4] + s * c[5])))))
    under = 1.0 + s * (c[6] + s * (c[7] + s * c[8]))
    factor = over / under
    u = x * factor
    v = y * factor
    # Where the terms are those of the point itself, and where of what has been moved.
    a = wp.where(c[15] > 0.0, u, x)
    b = wp.where(c[15] > 0.0, v, y)
    q = a * a + b * b
    u += 2.0 * c[9] * a * b + c[10] * (q + 2.0 * a * a) + q * (c[11] + q * c[12])
    v += 2.0 * c[10] * a * b + c[9] * (q + 2.0 * b * b) + q * (c[13] + q * c[14])
    return wp.vec2(u, v)


@wp.func
def distort(family: int, c: coefficients, x: float, y: float) -> wp.vec2:
    """Return where the point (x, y, 1) of the camera's coordinates appears on the plane at depth 1."""
    result = wp.vec2(x, y)
    if family == 0:
        result = polynomial(c, x, y)
    elif family == 1:
        r = wp.sqrt(x * x + y * y)
        bent = float(1.0)
        if r > 1.0e-6:
            bent = wp.atan(r) / r
        result = polynomial(c, x * bent, y * bent)
    else:
        factor = radial(family, c, x, y)
        result = wp.vec2(x * factor, y * factor)
    return result
