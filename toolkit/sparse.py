"""Solving sparse, symmetric, diagonally dominant systems: diffusion, seam correction and levelling."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import reverse_cuthill_mckee
from scipy.sparse.linalg import LinearOperator, SuperLU, cg, splu

from intaglio.arrays import Array

# Up to so many unknowns are solved directly; more by conjugate gradients from a start that is close.
DIRECT = 40_000

_RESIDUAL, _ITERATIONS = 1e-5, 1000


class SymmetricFactors:
    """The factors of a symmetric system, which solve for right sides (M,) or (M, C)."""

    def __init__(self, factors: SuperLU, order: Array) -> None:
        self._factors, self._order = factors, order

    def solve(self, right: Array) -> Array:
        """Return the solution for the right sides."""
        out = np.empty_like(right, np.float64)
        out[self._order] = self._factors.solve(np.ascontiguousarray(right[self._order], np.float64))
        return out


def factor_symmetric(system: csr_array) -> SymmetricFactors:
    """Return the factors of a symmetric system whose diagonal needs no pivoting.

    Reverse Cuthill-McKee ordering comes first: where neighbours have far numbers, as after subdivision, minimum degree alone
    breaks ties so badly that it takes many times as long.
    """
    rows = csr_array(system)
    order = reverse_cuthill_mckee(rows, symmetric_mode=True) if rows.shape[0] else np.zeros(0, np.int32)
    ordered = rows[order][:, order].tocsc()
    factors = splu(ordered, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return SymmetricFactors(factors, order)


def solve_symmetric(system: csr_array, right: Array, start: Array) -> Array:
    """Return the solution (M, C) of a symmetric, diagonally dominant system for right sides (M, C)."""
    if system.shape[0] <= DIRECT:
        return np.asarray(factor_symmetric(system).solve(right))
    diagonal = system.diagonal()
    scale = LinearOperator(system.shape, lambda v: v / diagonal)
    columns = [
        cg(system, right[:, k], x0=start[:, k], rtol=_RESIDUAL, maxiter=_ITERATIONS, M=scale)[0] for k in range(right.shape[1])
    ]
    return np.stack(columns, axis=1)
