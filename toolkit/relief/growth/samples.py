"""The sample set: the scan's vertices, oversampled, as candidates whose relief a target may take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.mesh import directed_edges, largest_faces, unit, used_vertices
from intaglio.relief.ground import Ground


@dataclass(frozen=True)
class Samples:
    """Candidates whose relief can be carried to a target.

    Attributes
    ----------
    vertex : (S,) int32 array
        The measured vertex that counts as the source: itself, or the nearer end of the edge that was halved.
    foot, u, v : (S, 3) float64 arrays
        Base point and frame.
    height : (S,) float64 array
        Signed displacement.
    color : (S, 3) float32 array or None
    first_face : (S,) int32 array
        A triangle at the sample.
    turn : (S,) float32 array
        By how much the sample itself was turned against its source; 0 but for filled vertices that serve as samples.
    """

    vertex: Array
    foot: Array
    u: Array
    v: Array
    height: Array
    color: Array | None
    first_face: Array
    turn: Array

    def part(self, keep: Array) -> Samples:
        """Return the samples with the numbers ``keep`` (K,)."""
        return Samples(
            self.vertex[keep],
            self.foot[keep],
            self.u[keep],
            self.v[keep],
            self.height[keep],
            None if self.color is None else self.color[keep],
            self.first_face[keep],
            self.turn[keep],
        )

    def numbers(self, count: int) -> Array:
        """Return the number of the sample that each of ``count`` vertices is, or -1: (count,) int32."""
        number = np.full(count, -1, np.int32)
        # Midpoints of edges come after the vertices and count as one of them: the first stands.
        number[self.vertex[::-1]] = np.arange(len(self.vertex), dtype=np.int32)[::-1]
        return number


def sample_set(ground: Ground, oversample: bool) -> Samples:
    """Return the measured vertices and, oversampled, the midpoints of all measured edges.

    Halving every edge is what the 1-to-4 subdivision of every triangle adds (3DIM 2005, section 4): samples between the
    samples, so that a target out of phase with the scan's lattice still finds its match. A midpoint's displacement is the
    mean of the edge's two; its colour the Gaussian-weighted mean of its four nearest measured neighbours (section 6).
    """
    measured_face = ground.measured[ground.faces].all(axis=1)
    vertex = np.flatnonzero(used_vertices(ground.faces[measured_face], len(ground.measured)))
    faces = largest_faces(ground.faces[measured_face], ground.foot)
    number = np.flatnonzero(measured_face)
    first = number[faces[vertex]]
    height = ground.height
    foot, u = ground.foot[vertex], ground.u[vertex]
    sample_height = height[vertex]
    color = None if ground.color is None else ground.color[vertex]
    if oversample:
        # Each edge once, with a face that it belongs to.
        sides = np.sort(directed_edges(ground.faces[measured_face]), axis=1)
        edges, at = np.unique(sides, axis=0, return_index=True)
        middle, normal = ground.base.foot(ground.foot[edges].mean(axis=1))
        along = ground.u[edges].sum(axis=1)
        # Opposite frames cancel: the first end's frame then stands for the edge.
        lost = np.linalg.norm(along, axis=1) < 1e-3
        along[lost] = ground.u[edges[lost, 0]]
        along = unit(along - np.einsum("ij,ij->i", along, normal)[:, None] * normal)
        to_ends = np.linalg.norm(ground.vertices[edges] - (middle + height[edges].mean(1)[:, None] * normal)[:, None], axis=2)
        nearer = edges[np.arange(len(edges)), np.argmin(to_ends, axis=1)]
        if color is not None:
            color = np.concatenate([color, _blend(ground.foot[vertex], color, middle)])
        vertex = np.concatenate([vertex, nearer])
        foot, u = np.concatenate([foot, middle]), np.concatenate([u, along])
        sample_height = np.concatenate([sample_height, height[edges].mean(axis=1)])
        first = np.concatenate([first, number[at // 3]])
    normal = ground.base.foot(foot)[1]
    still = np.zeros(len(vertex), np.float32)
    return Samples(vertex.astype(np.int32), foot, u, np.cross(normal, u), sample_height, color, first.astype(np.int32), still)


def filled_sample_set(
    ground: Ground, textured: Array, height: Array, source: Array, rotation: Array, color: Array | None
) -> Samples:
    """Return all textured vertices, measured and filled, as samples (bootstrapped completion)."""
    topology = ground.topology
    vertex = np.flatnonzero(textured & (np.diff(topology.face_offsets) > 0))
    return Samples(
        source[vertex],
        ground.foot[vertex],
        ground.u[vertex],
        ground.v[vertex],
        height[vertex],
        None if color is None else color[vertex],
        topology.incident[topology.face_offsets[vertex]],
        rotation[vertex],
    )


def _blend(points: Array, color: Array, at: Array) -> Array:
    """Colour at ``at``: Gaussian-weighted mean of the four nearest points, the width their mean distance."""
    distance, index = cKDTree(points).query(at, k=min(4, len(points)))
    distance, index = distance.reshape(len(at), -1), index.reshape(len(at), -1)
    sigma = np.maximum(distance.mean(axis=1, keepdims=True), 1e-300)
    weight = np.exp(-0.5 * (distance / sigma) ** 2)
    weight /= weight.sum(axis=1, keepdims=True)
    return np.einsum("ij,ijc->ic", weight, color[index]).astype(np.float32)
