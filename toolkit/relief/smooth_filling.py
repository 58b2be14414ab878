"""A completion's hole as a mesh program fills it: with the smoothest surface that joins the scan, and no relief."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh import SmoothBase, Surface, adjacency, unique_edges
from intaglio.relief.fillings import restrict
from intaglio.relief.ground import smooth_over_surface

# In units of the mean edge; the filling does not depend on it.
_LENGTH = 12.0
# Draws the filling to its base where nothing else holds it: waves of over a thousand edges.
_HELD = 1e-9
# The energy of a vertex reaches over two edges, and that of the held ones beside the filling over two more.
_EDGES = 4
_STEPS = 4


def without_relief(surface: Surface) -> Surface:
    """Return the completion with its filled part biharmonic, joining the scan with continuous tangents.

    Over a smooth base it is fair in its own geometry, else over the base.

    Parameters
    ----------
    surface : Surface
        From `complete_relief`, over a base of any kind, or read back.

    Returns
    -------
    Surface
        With the measured vertices as they are; unchanged where nothing was filled, or all lies in one point.
    """
    filled = ~surface.measured
    near = filled.copy()
    graph = adjacency(surface.faces, len(filled))
    for _ in range(_EDGES):
        near |= (graph @ near) > 0
    vertices, faces = restrict(surface.faces, near)
    free = filled[vertices]
    length = _LENGTH * _mean_edge(surface.base[vertices], faces)
    if not length > 0:
        return surface
    made = surface.base[vertices]
    # A smooth base goes along with the filling's relief, which the geometry must not know of: it is solved for, step by step.
    for _ in range(_STEPS if isinstance(surface.model, SmoothBase) else 1):
        made = smooth_over_surface(
            np.where(free[:, None], made, surface.vertices[vertices]),
            made,
            faces,
            length,
            weight=np.where(free, _HELD, 1.0),
            free=free,
        )
    moved = surface.vertices.copy()
    moved[vertices[free]] = made[free]
    return replace(surface, vertices=moved)


def _mean_edge(points: Array, faces: Array) -> float:
    edges = unique_edges(faces)
    return float(np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1).mean()) if len(edges) else 0.0
