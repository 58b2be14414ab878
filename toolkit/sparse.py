"""Solving sparse, symmetric, diagonally dominant systems: diffusion, seam correction and levelling."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, SuperLU, cg, splu

from intaglio.arrays import Array

# Up to so many unknowns are solved directly; more by conjugate gradients from a start that is close.
DIRECT = 40_000

_RESIDUAL, _ITERATIONS = 1e-5, 1000


def factor_symmetric(system: csr_array) -> SuperLU:
    """Return the factors of a symmetric system whose diagonal needs no pivoting."""
    return splu(system.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


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
