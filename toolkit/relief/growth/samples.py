"""The sample set: the scan's vertices, oversampled, as candidates whose relief a target may take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh import largest_faces, used_vertices
from intaglio.randomness import Stream, uniform
from intaglio.relief.ground import Ground
from intaglio.relief.growth.oversampling import subdivide_measured


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
    halvings : int
        How often the scan's edges were halved for them.
    """

    vertex: Array
    foot: Array
    u: Array
    v: Array
    height: Array
    color: Array | None
    first_face: Array
    turn: Array
    halvings: int = 0

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
            self.halvings,
        )

    def subsampled(self, share: float, seed: int) -> Samples:
        """Return a share of the samples, chosen at random (TPAMI 2008, section 3.1); what they are compared on stays whole."""
        if share >= 1:
            return self
        count = len(self.vertex)
        order = np.argsort(uniform(seed, Stream.RELIEF_SUBSAMPLING, np.arange(count)), kind="stable")
        return self.part(np.sort(order[: max(1, round(share * count))]))

    def numbers(self, count: int) -> Array:
        """Return the number of the sample that each of ``count`` vertices is, or -1: (count,) int32."""
        number = np.full(count, -1, np.int32)
        # Midpoints of edges come after the vertices and count as one of them: the first stands.
        number[self.vertex[::-1]] = np.arange(len(self.vertex), dtype=np.int32)[::-1]
        return number


def sample_set(ground: Ground, halvings: int = 0) -> Samples:
    """Return the measured vertices, and with them the midpoints of all measured edges, halved as often as asked.

    Parameters
    ----------
    ground : Ground
    halvings : int
        How often the edges are halved: see `subdivide_measured`.
    """
    measured_face = ground.measured[ground.faces].all(axis=1)
    vertex = np.flatnonzero(used_vertices(ground.faces[measured_face], len(ground.measured)))
    faces = largest_faces(ground.faces[measured_face], ground.foot)
    first = np.flatnonzero(measured_face)[faces[vertex]]
    fine = subdivide_measured(ground, int(halvings))
    own = np.concatenate([vertex, np.arange(len(ground.measured), len(fine.vertex))])
    first = np.concatenate([first, fine.first_face[len(ground.measured) :]])
    foot, u = fine.foot[own], fine.u[own]
    normal = ground.base.foot(foot)[1]
    color = None if fine.color is None else fine.color[own]
    return Samples(
        fine.vertex[own],
        foot,
        u,
        np.cross(normal, u),
        fine.height[own],
        color,
        first.astype(np.int32),
        np.zeros(len(own), np.float32),
        int(halvings),
    )


def with_filled(
    samples: Samples, ground: Ground, textured: Array, height: Array, source: Array, rotation: Array, color: Array | None
) -> Samples:
    """Return ``samples``, and after them all filled vertices (bootstrapped completion).

    What was filled lies on the targets' own lattice, which targets are never out of phase with: its edges are not halved.
    """
    topology = ground.topology
    vertex = np.flatnonzero(textured & ~ground.measured & (np.diff(topology.face_offsets) > 0))
    both = None if samples.color is None or color is None else np.concatenate([samples.color, color[vertex]])
    return Samples(
        np.concatenate([samples.vertex, source[vertex]]),
        np.concatenate([samples.foot, ground.foot[vertex]]),
        np.concatenate([samples.u, ground.u[vertex]]),
        np.concatenate([samples.v, ground.v[vertex]]),
        np.concatenate([samples.height, height[vertex]]),
        both,
        np.concatenate([samples.first_face, topology.incident[topology.face_offsets[vertex]]]),
        np.concatenate([samples.turn, rotation[vertex]]),
        samples.halvings,
    )
