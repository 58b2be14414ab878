"""Oversampling: the scan's triangles each replaced by four, as often as asked, over the same relief.

Halving every edge is what the 1-to-4 subdivision of every triangle adds (3DIM 2005, section 4): samples between the samples, so
that a target out of phase with the scan's lattice still finds its match.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.mesh import directed_edges, edge_keys, unit, used_vertices
from intaglio.relief.ground import Ground


@dataclass(frozen=True)
class FineGround:
    """A ground whose measured triangles are subdivided: its N vertices first, then the midpoints of edges, level by level.

    Attributes
    ----------
    vertex : (M,) int32 array
        The vertex of the ground that each one counts as: itself, or the nearer end of the edge that was halved.
    foot, u, v : (M, 3) float64 arrays
        Base points and frames.
    height : (M,) float64 array
        Signed displacement; a midpoint's is the mean of its edge's two.
    color : (M, 3) float32 array or None
    faces : (F, 3) int32 array
        Triangles beside the measured ones are cut where their edges were halved, so that the surface stays closed.
    face : (F,) int32 array
        The ground's triangle that each one is a part of.
    first_face : (M,) int32 array
        A triangle of the ground at each midpoint; 0 for the ground's own vertices.
    measured : (M,) bool array
    """

    vertex: Array
    foot: Array
    u: Array
    v: Array
    height: Array
    color: Array | None
    faces: Array
    face: Array
    first_face: Array
    measured: Array


def subdivide_measured(ground: Ground, halvings: int) -> FineGround:
    """Halve all edges of the measured triangles ``halvings`` times.

    A midpoint's colour is the Gaussian-weighted mean of its four nearest measured neighbours (3DIM 2005, section 6).
    """
    count = len(ground.measured)
    height = ground.height
    fine = FineGround(
        np.arange(count, dtype=np.int32),
        ground.foot,
        ground.u,
        ground.v,
        height,
        ground.color,
        ground.faces,
        np.arange(len(ground.faces), dtype=np.int32),
        np.zeros(count, np.int32),
        ground.measured,
    )
    points = ground.vertices
    for _ in range(halvings):
        fine, points = _halve(ground, fine, points)
    return fine


def _halve(ground: Ground, fine: FineGround, points: Array) -> tuple[FineGround, Array]:
    """Return the next finer level and where its vertices lie (M, 3)."""
    number = np.flatnonzero(fine.measured[fine.faces].all(axis=1))
    count = len(fine.vertex)
    # Each edge once, with a face that it belongs to.
    sides = np.sort(directed_edges(fine.faces[number]), axis=1)
    keys, at = np.unique(edge_keys(sides, count), return_index=True)
    edges = sides[at]
    middle, normal = ground.base.foot(fine.foot[edges].mean(axis=1))
    along = fine.u[edges].sum(axis=1)
    # Opposite frames cancel: the first end's frame then stands for the edge.
    lost = np.linalg.norm(along, axis=1) < 1e-3
    along[lost] = fine.u[edges[lost, 0]]
    along = unit(along - np.einsum("ij,ij->i", along, normal)[:, None] * normal)
    height = fine.height[edges].mean(axis=1)
    place = middle + height[:, None] * normal
    to_ends = np.linalg.norm(points[edges] - place[:, None], axis=2)
    nearer = edges[np.arange(len(edges)), np.argmin(to_ends, axis=1)]
    color = fine.color
    if color is not None and ground.color is not None:
        given = np.flatnonzero(used_vertices(ground.faces[ground.measured[ground.faces].all(axis=1)], len(ground.measured)))
        color = np.concatenate([color, blend_colors(ground.foot[given], ground.color[given], middle)])
    faces, part = _cut(fine.faces, keys, count)
    return (
        FineGround(
            np.concatenate([fine.vertex, fine.vertex[nearer]]),
            np.concatenate([fine.foot, middle]),
            np.concatenate([fine.u, along]),
            np.concatenate([fine.v, np.cross(normal, along)]),
            np.concatenate([fine.height, height]),
            color,
            faces,
            fine.face[part],
            np.concatenate([fine.first_face, fine.face[number[at // 3]]]),
            np.concatenate([fine.measured, np.ones(len(edges), bool)]),
        ),
        np.concatenate([points, place]),
    )


def _cut(faces: Array, keys: Array, count: int) -> tuple[Array, Array]:
    """Cut triangles where their edges have a midpoint: vertex ``count + k`` on the edge ``keys[k]``.

    Returns the triangles (F', 3) and the number (F',) of the one that each is a part of.
    """
    side = edge_keys(np.sort(directed_edges(faces), axis=1), count)
    at = np.minimum(np.searchsorted(keys, side), max(len(keys) - 1, 0))
    middle = np.where(keys[at] == side, count + at, -1).reshape(-1, 3)
    halved = (middle >= 0).sum(axis=1)
    # One halved edge comes first, of two the whole edge comes last.
    turn = np.where(halved == 1, np.argmax(middle >= 0, axis=1), (np.argmax(middle < 0, axis=1) + 1) % 3)
    order = (np.arange(3) + turn[:, None]) % 3
    (a, b, c), (ab, bc, ca) = (np.take_along_axis(m, order, axis=1).T for m in (faces, middle))
    pieces = {
        0: [(a, b, c)],
        1: [(a, ab, c), (ab, b, c)],
        2: [(ab, b, bc), (a, ab, c), (ab, bc, c)],
        3: [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)],
    }
    out, part = [], []
    for number, triangles in pieces.items():
        which = np.flatnonzero(halved == number)
        for corners in triangles:
            out.append(np.stack([corner[which] for corner in corners], axis=1))
            part.append(which)
    return np.concatenate(out).astype(np.int32), np.concatenate(part)


def blend_colors(points: Array, color: Array, at: Array) -> Array:
    """Colour at ``at`` (M, 3): Gaussian-weighted mean of the four nearest points, the width their mean distance."""
    distance, index = cKDTree(points).query(at, k=min(4, len(points)))
    distance, index = distance.reshape(len(at), -1), index.reshape(len(at), -1)
    sigma = np.maximum(distance.mean(axis=1, keepdims=True), 1e-300)
    weight = np.exp(-0.5 * (distance / sigma) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    return np.einsum("ij,ijc->ic", weight, color[index]).astype(np.float32)
