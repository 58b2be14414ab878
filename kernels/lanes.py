"""What the searches of texture synthesis share: sixteen candidates at a time, and how they are compared."""

from __future__ import annotations

import warp as wp

LANES = 16
vec16 = wp.types.vector(length=LANES, dtype=wp.float32)

# Above any cost of a candidate that can be taken.
UNUSABLE = wp.constant(1.0e30)

# What rounding may add to a sum: a factor, the same for every term, and an amount for every term of size 1. A bound on
# costs is widened by them.
SLACK = wp.constant(1.0001)
RELATIVE = wp.constant(1.2e-7)
ABSOLUTE = wp.constant(1.0e-6)


@wp.func
def difference(a: float, b: float, squared: int):
    """Return |a - b| or its square."""
    d = a - b
    if squared == 1:
        return d * d
    return wp.abs(d)


@wp.func
def absolute_terms(a: vec16, v: float):
    """Return |a - v|, lane by lane."""
    return wp.abs(a - vec16(v))


@wp.func
def squared_terms(a: vec16, v: float):
    """Return (a - v)^2, lane by lane."""
    d = a - vec16(v)
    return wp.cw_mul(d, d)
