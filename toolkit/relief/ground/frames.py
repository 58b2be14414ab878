"""Local orientation frames [u, v, n] on the base.

Breckon & Fisher, IEEE TPAMI 30(12), 2008, "Neighborhood orientation", and 3DIM 2005, section 3.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.sparse.csgraph import breadth_first_order

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.mesh import Base, Cylinder, Plane, adjacency, perpendicular, unit

FRAMES = ("algebraic", "sweep", "reference")


def local_frames(
    normal: Array, faces: Array, base: Base, method: str | None = None, reference: Array | None = None, seed_vertex: int = 0
) -> tuple[Array, Array]:
    """Return tangent vectors u and v = n x u, both (N, 3), for every vertex.

    Parameters
    ----------
    normal : (N, 3) array
        Unit base normals.
    faces : (F, 3) array
        The combined triangulation, along whose edges frames are swept.
    base : Base
        Decides the default: a global reference on a plane and a cylinder (its axis), the sweep on a sphere.
    method : {"algebraic", "sweep", "reference"}, optional
        "algebraic": from the normal's smallest component (3DIM 2005). "sweep": neighbour to neighbour from
        ``seed_vertex``, each frame turned to agree with those already set (TPAMI 2008, after Wei & Levoy).
        "reference": the projection of one global vector.
    reference : (3,) array, optional
        The global vector for "reference"; default the cylinder's axis or the plane's chart direction.

    Raises
    ------
    InputError
        For an unknown method, or "reference" without a vector on a sphere.
    """
    if method is None:
        method = "reference" if isinstance(base, Plane | Cylinder) else "sweep"
    if method not in FRAMES:
        raise InputError(f"unknown frames {method!r}; known: {', '.join(FRAMES)}")
    if method == "algebraic":
        u = perpendicular(normal)
    elif method == "reference":
        u = _reference(normal, base, reference)
    else:
        u = _sweep(normal, faces, seed_vertex)
    return u, np.cross(normal, u)


def _reference(normal: Array, base: Base, reference: Array | None) -> Array:
    if reference is None:
        if isinstance(base, Cylinder):
            reference = base.axis
        elif isinstance(base, Plane):
            reference = base.direction
        else:
            raise InputError("frames='reference' on a sphere needs a reference vector; give one, or use 'sweep'")
    vector = np.asarray(reference, np.float64).reshape(-1)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise InputError(f"reference must be three finite numbers, not all zero; it is {reference!r}")
    along = vector - (normal @ vector)[:, None] * normal
    # Where the vector is the normal itself, its projection has no direction: the algebraic frame stands in.
    weak = np.linalg.norm(along, axis=1) < 1e-6 * np.linalg.norm(vector)
    return np.where(weak[:, None], perpendicular(normal), unit(along))


def _sweep(normal: Array, faces: Array, seed_vertex: int) -> Array:
    count = len(normal)
    graph = adjacency(faces, count)
    u = perpendicular(normal)
    done = np.zeros(count, bool)
    remaining = [seed_vertex, *np.flatnonzero(np.diff(graph.indptr) > 0)]
    for start in remaining:
        if done[start]:
            continue
        order, parent = breadth_first_order(graph, start, directed=False)
        depth = np.zeros(count, int)
        for i in order[1:]:
            depth[i] = depth[parent[i]] + 1
        done[start] = True
        level = depth[order]
        edges = np.searchsorted(level, np.arange(1, level[-1] + 2))
        for first, last in pairwise(edges):
            ring = order[first:last]
            rows = graph[ring]
            # Sum of the frames set before; their transport to here is the projection on this tangent plane.
            total = rows @ (u * done[:, None])
            total -= np.einsum("ij,ij->i", total, normal[ring])[:, None] * normal[ring]
            strong = np.linalg.norm(total, axis=1) > 1e-6
            u[ring[strong]] = unit(total[strong])
            done[ring] = True
    return u
