"""Joining a smooth base to the rim: the base that was made up is moved so that the relief on it meets the scan.

A smoothed scan leaves some shape in the relief where it is creased, often just where a hole begins. Relief copied beside such a
rim then stands too high or too low. How much is known: the copied vertex's own neighbour, at the source, says by how much the
relief should change from it to the scan's vertex next to it.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from intaglio.arrays import Array
from intaglio.mesh import unique_edges
from intaglio.relief.ground import Ground
from intaglio.relief.growth.propagation import State
from intaglio.relief.growth.samples import Samples
from intaglio.sparse import solve_symmetric

# How stiff the shift is against single misfits, and over how many edges it dies away from the rim.
_STIFFNESS, _REACH = 0.5, 10.0


def shift_to_rim(ground: Ground, state: State, samples: Samples) -> Array:
    """Return by how much (N,) the base of filled vertices is to move along its normal; 0 at measured ones.

    The shift minimises squared misfits across the rim, differences between neighbours and, weakly, its own size, so that it
    dies away over some ten edges.

    Parameters
    ----------
    ground : Ground
    state : State
        Fully grown.
    samples : Samples
        Those that it was grown from.
    """
    count = len(ground.measured)
    filled = state.textured & ~ground.measured
    shift = np.zeros(count)
    edges = unique_edges(ground.faces)
    ends = filled[edges]
    crossing = edges[ends[:, 0] != ends[:, 1]]
    inner = crossing[filled[crossing]]
    outer = crossing[~filled[crossing]]
    known = (state.sample[inner] >= 0) & ground.measured[outer]
    inner, outer = inner[known], outer[known]
    if len(inner) == 0:
        return shift
    misfit = state.height[outer] - state.height[inner] - _expected_change(ground, state, samples, inner, outer)
    place = np.full(count, -1)
    vertices = np.flatnonzero(filled)
    place[vertices] = np.arange(len(vertices))
    own = place[edges[ends.all(axis=1)]]
    ones = np.full(len(own), _STIFFNESS)
    graph = coo_array((ones, (own[:, 0], own[:, 1])), shape=(len(vertices), len(vertices)))
    graph = csr_array(graph + graph.T)
    at = place[inner]
    # On a triangular lattice the graph's Laplacian is 3/2 of the continuous one.
    weak = 1.5 * _STIFFNESS / _REACH**2
    diagonal = np.asarray(graph.sum(axis=1)).reshape(-1) + np.bincount(at, minlength=len(vertices)) + weak
    right = np.bincount(at, misfit, len(vertices))
    shift[vertices] = solve_symmetric(csr_array(diags_array(diagonal) - graph), right[:, None], np.zeros((len(vertices), 1)))[
        :, 0
    ]
    return shift


def _expected_change(ground: Ground, state: State, samples: Samples, inner: Array, outer: Array) -> Array:
    """Change of height from ``inner`` to ``outer`` as at the source of ``inner``: to its neighbour in that direction."""
    offset = ground.foot[outer] - ground.foot[inner]
    x = np.einsum("ij,ij->i", offset, ground.u[inner])
    y = np.einsum("ij,ij->i", offset, ground.v[inner])
    turn = state.rotation[inner].astype(np.float64)
    x, y = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    source = state.source[inner]
    topology = ground.topology
    first, last = topology.offsets[source], topology.offsets[source + 1]
    degree = last - first
    row = np.repeat(np.arange(len(source)), degree)
    neighbor = topology.neighbors[
        np.arange(degree.sum()) - np.repeat(np.cumsum(degree) - degree, degree) + np.repeat(first, degree)
    ]
    sample = state.sample[inner]
    step = ground.foot[neighbor] - samples.foot[sample[row]]
    away = (np.einsum("ij,ij->i", step, samples.u[sample[row]]) - x[row]) ** 2
    away += (np.einsum("ij,ij->i", step, samples.v[sample[row]]) - y[row]) ** 2
    away[~ground.measured[neighbor]] = np.inf
    order = np.lexsort([away, row])
    best = order[np.cumsum(degree) - degree]
    change = state.height[neighbor[best]] - samples.height[sample]
    # A neighbour further off than the offset changes by as much more.
    reach = np.linalg.norm(step[best], axis=1)
    change *= np.minimum(1.0, np.hypot(x, y) / np.maximum(reach, 1e-300))
    # Heights of measured vertices are the scan's own; a source without measured neighbours says nothing.
    return np.where(np.isfinite(away[best]), change, 0.0)
