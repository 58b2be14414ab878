"""Comparisons of sixteen candidates at a time, one in each lane of a vector, and what their costs are bounded with."""

from __future__ import annotations

import warp as wp

LANES = 16
vec16 = wp.types.vector(length=LANES, dtype=wp.float32)

# The cost that stands for "must not be taken": it is larger than the cost of any candidate that may be.
UNUSABLE = wp.constant(1.0e30)

# Costs are summed in an order that differs from kernel to kernel, so that bounds on them are widened by what rounding may add: a
# factor for the sum, and for each of its terms a share of the sum and an amount (for terms up to 1).
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
