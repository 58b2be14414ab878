"""Creases, ridges and valleys of a scan: where the surface bends most, across one direction (after Ohtake et al. 2004)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh import tangents, unit, vertex_normals
from intaglio.relief.coherent import average, averaging
from intaglio.relief.ground import Ground

# Normals are averaged so often: what bends less than some four edges wide is noise.
_AVERAGED = 3
# A line bends at least so much, in radians per spacing, and so many times as much as the surface around does in the middle.
_LEAST_BEND, _OUTSTANDING = 0.08, 2.5
# Across a line the surface bends so many times as much as along it.
_DIRECTED = 2.0


@dataclass(frozen=True)
class Features:
    """How the measured surface bends.

    Attributes
    ----------
    bend : (N,) array
        The principal curvature of larger size, in radians per spacing: positive on ridges, negative in valleys, 0 where unknown.
    along : (N, 3) array
        Unit tangents across which the surface bends least: the direction of a line.
    on_line : (N,) bool array
        Vertices on lines: they bend outstandingly, and more than what is beside them across the line.
    """

    bend: Array
    along: Array
    on_line: Array


def find_features(ground: Ground) -> Features:
    """Return how the measured part of a ground bends, and where it has lines.

    The shape operator of a vertex is fitted to the differences of averaged normals along its edges in the least squares.

    Parameters
    ----------
    ground : Ground
    """
    measured, topology = ground.measured, ground.topology
    count = len(measured)
    faces = ground.faces[measured[ground.faces].all(axis=1)]
    normal = vertex_normals(ground.vertices, faces)
    own = averaging(topology.graph, measured)
    normal = unit(average(own, normal, _AVERAGED))
    smooth = average(own, ground.vertices, 1)
    u, v = tangents(normal)
    first = np.repeat(np.arange(count), np.diff(topology.offsets))
    other = topology.neighbors
    both = measured[first] & measured[other]
    first, other = first[both], other[both]
    way = (smooth[other] - smooth[first]) / ground.spacing
    turn = normal[other] - normal[first]
    x, y = (np.einsum("ij,ij->i", way, axis[first]) for axis in (u, v))
    p, q = (np.einsum("ij,ij->i", turn, axis[first]) for axis in (u, v))

    # S = (a, b; b, c) minimises the sum of |S (x, y) - (p, q)|^2.
    def total(values: Array) -> Array:
        return np.bincount(first, values, count)

    xx, xy, yy = total(x * x), total(x * y), total(y * y)
    zero = np.zeros(count)
    system = np.stack([np.stack([xx, xy, zero], 1), np.stack([xy, xx + yy, xy], 1), np.stack([zero, xy, yy], 1)], axis=1)
    right = np.stack([total(x * p), total(x * q + y * p), total(y * q)], axis=1)
    size = np.trace(system, axis1=1, axis2=2)
    system += 1e-6 * (size + 1e-12)[:, None, None] * np.eye(3)
    a, b, c = np.linalg.solve(system, right[:, :, None])[:, :, 0].T
    values, vectors = np.linalg.eigh(np.stack([np.stack([a, b], 1), np.stack([b, c], 1)], axis=1))
    larger = np.abs(values).argmax(axis=1)
    rows = np.arange(count)
    bend, lesser = values[rows, larger], np.abs(values[rows, 1 - larger])
    flat = vectors[rows, :, 1 - larger]
    along = flat[:, :1] * u + flat[:, 1:] * v
    # At borders normals are one-sided.
    inner = measured & (np.bincount(first, minlength=count) >= 4)
    bend = np.where(inner, bend, 0.0)
    strength = np.abs(bend)
    usual = float(np.median(strength[inner])) if inner.any() else 0.0
    high = (strength > max(_LEAST_BEND, _OUTSTANDING * usual)) & (strength > _DIRECTED * lesser)
    # More than half of what lies beside it, across, bends less.
    across = np.abs(np.einsum("ij,ij->i", unit(way), along[first])) < 0.7
    beside = np.bincount(first, across, count)
    less = np.bincount(first, across & (strength[other] < strength[first]), count)
    crest = less >= np.maximum(0.7 * beside, 1)
    return Features(bend, along, high & crest)
