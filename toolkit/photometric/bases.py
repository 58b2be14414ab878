"""How the coefficients of a linear combination depend on the light: i = M₁ c(l), Dong's mathematical framework (eq. 4.4.5).

A basis evaluates c(l) from the components of the light's unit vector with the functions of any array library
(`NumpyMaths` here; the renderer has its own), so that relighting and rendering run the same code.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError


class Maths(Protocol):
    """The functions of an array library that bases need."""

    sqrt: Any
    log: Any
    arctan2: Any
    where: Any
    minimum: Any
    maximum: Any


class NumpyMaths:
    """The functions of NumPy."""

    sqrt = staticmethod(np.sqrt)
    log = staticmethod(np.log)
    arctan2 = staticmethod(np.arctan2)
    where = staticmethod(np.where)
    minimum = staticmethod(np.minimum)
    maximum = staticmethod(np.maximum)


class Basis(Protocol):
    """c(l): n coefficients as functions of the light."""

    @property
    def size(self) -> int:
        """Number n of coefficients."""

    def evaluate(self, x: Any, y: Any, z: Any, maths: Any) -> list[Any]:
        """Return the n coefficients, each of the shape of x, y and z: components of unit vectors towards the light."""

    def parameters(self) -> dict[str, Any]:
        """Return the parameters from which `basis_from_parameters` makes the basis, as plain lists and numbers."""


def coefficients(basis: Basis, lights: Array) -> Array:
    """Return c(l) for unit vectors ``lights`` (L, 3) as (L, n) float64."""
    x, y, z = (np.ascontiguousarray(lights[:, i], np.float64) for i in range(3))
    columns = basis.evaluate(x, y, z, NumpyMaths)
    return np.stack([np.broadcast_to(np.asarray(c, np.float64), x.shape) for c in columns], axis=1)


@dataclass(frozen=True)
class LambertBasis:
    """c = l: the maps are scaled normals (eq. 4.4.8)."""

    size = 3

    def evaluate(self, x: Any, y: Any, z: Any, maths: Any) -> list[Any]:
        """Return l."""
        return [x, y, z]

    def parameters(self) -> dict[str, Any]:
        """Return the name alone."""
        return {"basis": "lambert"}


@dataclass(frozen=True)
class ThreeImageBasis:
    """c = L⁻¹ l for three lights (eqs. 4.4.9 and 4.4.10): the maps are three of the photographs.

    Attributes
    ----------
    lights : (3, 3) float64 array
        Unit vectors, a row each.
    """

    lights: Array
    size = 3

    def evaluate(self, x: Any, y: Any, z: Any, maths: Any) -> list[Any]:
        """Return L⁻¹ l, where L holds the lights in its columns."""
        inverse = np.linalg.inv(self.lights.T)
        return [float(r[0]) * x + float(r[1]) * y + float(r[2]) * z for r in inverse]

    def parameters(self) -> dict[str, Any]:
        """Return the three lights."""
        return {"basis": "three-images", "lights": self.lights.tolist()}


@dataclass(frozen=True)
class PolynomialBasis:
    """c = (x², y², xy, x, y, 1): polynomial texture maps (eq. 4.4.11, whose first list prints l_z l_y for l_x l_y)."""

    size = 6

    def evaluate(self, x: Any, y: Any, z: Any, maths: Any) -> list[Any]:
        """Return the six terms in the order of .ptm files."""
        return [x * x, y * y, x * y, x, y, 0 * x + 1]

    def parameters(self) -> dict[str, Any]:
        """Return the name alone."""
        return {"basis": "polynomial"}


@dataclass(frozen=True)
class HemisphericalBasis:
    """Hemispherical harmonics (Gautron et al., A Novel Hemispherical Basis, 2004) of order 2 (4 terms) or 3 (9 terms).

    Spherical harmonics in which cos θ is replaced by 2 cos θ − 1. With r = √(cos θ − cos² θ) and the direction (u, v) of the
    tilt, r cos φ = u r and so on, without trigonometry.
    """

    order: int

    @property
    def size(self) -> int:
        """order²."""
        return self.order**2

    def evaluate(self, x: Any, y: Any, z: Any, maths: Any) -> list[Any]:
        """Return the terms in the order of RTI viewers: (l, m) = (0,0), (1,1), (1,0), (1,−1), (2,2), (2,1) and so on."""
        z = maths.minimum(maths.maximum(z, 0.0), 1.0)
        across = maths.maximum(maths.sqrt(x * x + y * y), 1e-12)
        u, v = x / across, y / across
        r = maths.sqrt(maths.maximum(z - z * z, 0.0))
        pi = math.pi
        terms = [
            0 * x + 1 / math.sqrt(2 * pi),
            math.sqrt(6 / pi) * u * r,
            math.sqrt(3 / (2 * pi)) * (2 * z - 1),
            math.sqrt(6 / pi) * v * r,
        ]
        if self.order == 3:
            terms += [
                math.sqrt(30 / pi) * (u * u - v * v) * (z * z - z),
                math.sqrt(30 / pi) * u * (2 * z - 1) * r,
                math.sqrt(5 / (2 * pi)) * (1 - 6 * z + 6 * z * z),
                math.sqrt(30 / pi) * v * (2 * z - 1) * r,
                math.sqrt(30 / pi) * 2 * u * v * (z * z - z),
            ]
        return terms

    def parameters(self) -> dict[str, Any]:
        """Return the order."""
        return {"basis": "hemispherical", "order": self.order}


def need_rank(matrix: Array, kind: str, names: Sequence[str]) -> None:
    """Raise `InputError` if the lights don't determine all coefficients; ``matrix`` (K, n) has a row c(l) for each light."""
    if len(matrix) < matrix.shape[1]:
        raise InputError(f"kind {kind!r} has {matrix.shape[1]} unknowns per pixel, the stack has only {len(matrix)} images")
    values = np.linalg.svd(matrix, compute_uv=False)
    rank = int((values > 1e-3 * values[0]).sum())
    if rank < matrix.shape[1]:
        why = "they lie in one plane" if list(names) == ["x", "y", "z"] else "do they all have one slant or one tilt?"
        raise InputError(
            f"the lights determine only {rank} of the {matrix.shape[1]} coefficients of {kind!r} ({', '.join(names)}): {why}; "
            "take lights from more directions, or a kind with fewer coefficients"
        )
