"""Smooth surfaces over a triangle mesh: least squares with the thin-plate energy.

A surface x over a mesh is sought that minimises

    sum_i w_i A_i |x_i - p_i|^2  +  s^4 sum_j |(L x)_j|^2 / A_j,

with vertex areas A, the cotangent Laplacian L summed over inner vertices, and data weights w: 1 where a surface is to be
smoothed, 0 where it is to be made up. Waves of length l are damped by 1 / (1 + (2 pi s / l)^4). Where w is 0 the solution is
biharmonic and joins what is around it with continuous tangents.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import LinearOperator, cg

from intaglio.arrays import Array
from intaglio.mesh import border_edges
from intaglio.sparse import factor_symmetric

# Up to so many unknowns are solved directly.
DIRECT = 60_000
_RESIDUAL, _ITERATIONS = 1e-8, 500
# Cotangents are kept in this range: slivers would make the system singular in single places.
_FLATTEST, _STEEPEST = 0.02, 20.0


def laplacian(points: Array, faces: Array) -> tuple[csr_array, Array]:
    """Return the symmetric cotangent Laplacian (N, N), negative semi-definite, and the vertex areas (N,).

    Cotangents are kept between 0.02 and 20.

    Parameters
    ----------
    points, faces : (N, 3), (F, 3) arrays
    """
    count = len(points)
    corners = points[faces]
    rows, columns, weights = [], [], []
    double_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        inner = np.einsum("ij,ij->i", corners[:, a] - corners[:, k], corners[:, b] - corners[:, k])
        cotangent = np.divide(inner, double_area, out=np.full(len(faces), _STEEPEST), where=double_area > 0)
        half = 0.5 * np.clip(cotangent, _FLATTEST, _STEEPEST)
        rows += [faces[:, a], faces[:, b]]
        columns += [faces[:, b], faces[:, a]]
        weights += [half, half]
    graph = coo_array((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count)).tocsr()
    area = np.bincount(faces.reshape(-1), np.repeat(double_area / 6, 3), count)
    positive = area[area > 0]
    least = 1e-3 * float(positive.mean()) if len(positive) else 1.0
    return csr_array(graph - diags_array(np.asarray(graph.sum(axis=1)).reshape(-1))), np.maximum(area, least)


def smooth_over_surface(
    values: Array,
    points: Array,
    faces: Array,
    length: float,
    *,
    weight: Array | None = None,
    free: Array | None = None,
    film: Array | None = None,
    tension: float = 0.0,
) -> Array:
    """Return the thin-plate surface (N, C) through values over a mesh.

    Parameters
    ----------
    values : (N, C) array
        What to smooth: positions or heights.
    points, faces : (N, 3), (F, 3) arrays
        The mesh whose geometry counts.
    length : float
        Wave length that is damped to a half, in the unit of ``points``: s = length / (2 pi).
    weight : (N,) array, optional
        Data weights; default 1.
    free : (N,) bool array, optional
        Vertices that may move; the others keep their values. Default all.
    film : (K, 3) array, optional
        Triangles on which slope counts as well, ``tension`` times: it draws the surface there in between a plate and a soap
        film. In units in which the thin-plate energy has weight 1 and ``s`` is 1.
    """
    count = len(points)
    scale = length / (2 * np.pi)
    energy, area = _energy(points, faces, length)
    if film is not None and tension > 0:
        energy = csr_array(energy - tension * laplacian(points / scale, film)[0])
    mass = area if weight is None else area * weight
    system = csr_array(energy + diags_array(mass))
    offset = values.mean(axis=0)
    right = mass[:, None] * (values - offset)
    moving = np.arange(count) if free is None else np.flatnonzero(free)
    if len(moving) == 0:
        return values.copy()
    out = values - offset
    if len(moving) < count:
        held = np.setdiff1d(np.arange(count), moving)
        rows = system[moving]
        right = right[moving] - rows[:, held] @ out[held]
        system = csr_array(rows[:, moving])
    if len(moving) <= DIRECT:
        out[moving] = factor_symmetric(system).solve(right)
    else:
        operator = laplacian(points / scale, faces)[0]
        root = csr_array(csr_array(diags_array(area) - operator)[moving][:, moving])
        out[moving] = _iterate(system, right, out[moving], root, area[moving])
    return np.asarray(out + offset)


class ThinPlate:
    """The thin-plate surface through values over one mesh, factored once: `smooth_over_surface` for many sets of values.

    Parameters
    ----------
    points, faces : (N, 3), (F, 3) arrays
        The mesh whose geometry counts.
    length : float
        Wave length that is damped to a half, in the unit of ``points``.
    """

    def __init__(self, points: Array, faces: Array, length: float) -> None:
        energy, self._area = _energy(points, faces, length)
        self._factors = factor_symmetric(csr_array(energy + diags_array(self._area)))

    def smooth(self, values: Array) -> Array:
        """Return the smoothed values (N, C)."""
        offset = values.mean(axis=0)
        return np.asarray(self._factors.solve(self._area[:, None] * (values - offset))) + offset


def _energy(points: Array, faces: Array, length: float) -> tuple[csr_array, Array]:
    """Return the thin-plate energy (N, N) and the vertex areas (N,), in units of the length scale s."""
    # Entries are then of order one whatever the input's unit.
    operator, area = laplacian(points * (2 * np.pi / length), faces)
    # Border vertices' rows don't count, so that a plane has the energy zero up to its border.
    inner = np.ones(len(points))
    inner[np.unique(border_edges(faces))] = 0
    return csr_array(operator.T @ diags_array(inner / area) @ operator), area


def _iterate(system: csr_array, right: Array, start: Array, root: csr_array, area: Array) -> Array:
    """Solve by conjugate gradients, and directly where they don't converge.

    (A - L) A^-1 (A - L) is the energy's own form with all weights 1, up to a factor of 2: few steps are needed, however long the
    waves that are damped, and to factor A - L takes far less than to factor its square.
    """
    factors = factor_symmetric(root)
    guess = LinearOperator(system.shape, lambda v: factors.solve(area * factors.solve(v)))
    columns = []
    for k in range(right.shape[1]):
        column, missed = cg(system, right[:, k], x0=start[:, k], rtol=_RESIDUAL, maxiter=_ITERATIONS, M=guess)
        if missed:
            return np.asarray(factor_symmetric(system).solve(right))
        columns.append(column)
    return np.stack(columns, axis=1)
