"""Geometry of a chart: areas, edges and stretch of its triangles, in space and in the texture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array


@dataclass(frozen=True)
class Chart:
    """A triangulated disk in space.

    Attributes
    ----------
    vertices : (N, 3) float64 array
    faces : (F, 3) int32 array
    loop : (B,) int array
        The border, in order, the surface on its left.
    """

    vertices: Array
    faces: Array
    loop: Array


def doubled_areas(vertices: Array, faces: Array) -> Array:
    """Return twice the area of each triangle in space, (F,)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area: Array = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return area


def doubled_texture_areas(uv: Array, faces: Array) -> Array:
    """Return twice the signed area of each triangle in the texture, (F,); negative where it is flipped."""
    a, b, c = (uv[faces[:, k]] for k in range(3))
    p, q = b - a, c - a
    area: Array = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    return area


def flat_edges(vertices: Array, faces: Array) -> Array:
    """Return each triangle's edges a to b and a to c, as columns, in its own plane: (F, 2, 2), the first along x."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    p, q = b - a, c - a
    along = np.linalg.norm(p, axis=1)
    safe = np.maximum(along, 1e-300)
    edges = np.zeros((len(faces), 2, 2))
    edges[:, 0, 0] = along
    edges[:, 0, 1] = np.einsum("ij,ij->i", p, q) / safe
    edges[:, 1, 1] = np.linalg.norm(np.cross(p, q), axis=1) / safe
    return edges


def invert_matrices(matrices: Array) -> Array:
    """Return the inverses of 2 x 2 matrices (F, 2, 2)."""
    a, b, c, d = (matrices[:, i, j] for i in range(2) for j in range(2))
    det = a * d - b * c
    inverse: Array = np.stack([np.stack([d, -b], -1), np.stack([-c, a], -1)], axis=1) / det[:, None, None]
    return inverse


def squared_stretches(uv: Array, faces: Array, rest: Array) -> Array:
    """Return each triangle's squared L2 stretch (F,): half the sum of 1/s1^2 and 1/s2^2 (Sander et al. 2001, section 3).

    ``rest`` holds the inverses of `flat_edges`. Mirrored triangles count as what they are unmirrored; flat ones are infinite.
    """
    a, b, c = (uv[faces[:, k]] for k in range(3))
    jacobian = np.stack([b - a, c - a], axis=2) @ rest
    det = np.abs(jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        # A triangle of which nothing is left, not even a line, is flat as well.
        squared = np.where(det > 0, np.sum(jacobian**2, axis=(1, 2)) / (2 * det**2), np.inf)
    return squared
