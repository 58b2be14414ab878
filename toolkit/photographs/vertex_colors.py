"""Colours of vertices: the photographs' weighted mean, and interpolation where no photograph reaches."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh import adjacency
from intaglio.photographs.binding import Binding

# Shares of coloured neighbours that the passes of section 4.1 require; the last accepts any.
_PASSES = (0.8, 0.6, 0.4, 0.2, 0.0)


def mean_vertex_colors(binding: Binding, gains: Array) -> tuple[Array, Array]:
    """Return each vertex's mean colour, weighted by <N, V>, (N, 3), and which vertices have one, (N,) bool (section 4.1)."""
    weight = np.where(binding.valid, binding.cosine, 0)
    total = weight.sum(axis=0)
    color = np.einsum("pn,pnc,pc->nc", weight, binding.color, gains) / np.maximum(total, 1e-12)[:, None]
    return color, total > 0


def spread_colors(color: Array, has: Array, faces: Array) -> Array:
    """Return colours for all vertices (N, 3): one without takes its neighbours' mean once 80 % of them have one.

    When no vertex is left for which that holds, 60, 40 and 20 % do, then any. Vertices that no coloured one can be reached
    from take the mean of all.

    References
    ----------
    Yamauchi et al., Textures revisited (2005), section 4.1: the passes over unbound vertices.
    """
    graph = adjacency(faces, len(color)).astype(np.float64)
    degree = np.asarray(graph.sum(axis=1)).reshape(-1)
    color, has = np.where(has[:, None], color, 0).astype(np.float64), has.copy()
    start = color[has].mean(axis=0) if has.any() else np.full(3, 0.5)
    for share in _PASSES:
        while True:
            number = graph @ has.astype(np.float64)
            ready = ~has & (number > 0) & (number >= share * degree - 1e-9)
            if not ready.any():
                break
            color[ready] = (graph[ready] @ color) / number[ready, None]
            has |= ready
    color[~has] = start
    return color
