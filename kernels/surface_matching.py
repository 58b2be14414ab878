"""The metric of Breckon & Fisher: a target's neighbours are laid on the surface at a sample, and measured against it.

The error is the weighted sum of the squared distances to the nearest triangle there.

References
----------
[1] T. P. Breckon and R. B. Fisher, "Non-parametric 3D Surface Completion", 3DIM 2005.
[2] T. P. Breckon and R. B. Fisher, "Three-Dimensional Surface Relief Completion via Nonparametric Techniques", IEEE TPAMI
    30(12), 2008.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload
from intaglio.kernels.meshes import Frames, upload_frames

wp.set_module_options({"enable_backward": False})

NOT_VIABLE = 1.0e30
_NOT_VIABLE = wp.constant(NOT_VIABLE)
_MOST_STEPS = wp.constant(64)

# Threads that share a target's candidates. On a CPU they are few, since a thread drops candidates by the best it has seen itself.
_STRIDE_CPU, _STRIDE_CUDA = 4, 1024


@wp.struct
class Ground:
    """A surface over its base: vertices with their frames on the base, who is joined to whom, and which are samples."""

    frames: Frames
    # The vertices joined to vertex i are neighbors[offsets[i]] to neighbors[offsets[i + 1] - 1]; so are its faces.
    offsets: wp.array[wp.int32]
    neighbors: wp.array[wp.int32]
    face_offsets: wp.array[wp.int32]
    incident: wp.array[wp.int32]
    faces: wp.array2d[wp.int32]
    is_sample: wp.array[wp.uint8]


@wp.struct
class NeighborLists:
    """What is known around each target: vertices from ``offsets`` on, and weights that sum to 1."""

    offsets: wp.array[wp.int32]
    vertex: wp.array[wp.int32]
    weight: wp.array[wp.float32]


@wp.func
def squared_distance_to_triangle(p: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3) -> float:
    """Return the least squared distance from ``p`` to triangle (a, b, c) (Ericson, Real-Time Collision Detection, 5.1.5)."""
    ab = b - a
    ac = c - a
    ap = p - a
    d1 = wp.dot(ab, ap)
    d2 = wp.dot(ac, ap)
    bp = p - b
    d3 = wp.dot(ab, bp)
    d4 = wp.dot(ac, bp)
    cp = p - c
    d5 = wp.dot(ab, cp)
    d6 = wp.dot(ac, cp)
    va = d3 * d6 - d5 * d4
    vb = d5 * d2 - d1 * d6
    vc = d1 * d4 - d3 * d2
    q = a
    if d1 <= 0.0 and d2 <= 0.0:
        q = a
    elif d3 >= 0.0 and d4 <= d3:
        q = b
    elif d6 >= 0.0 and d5 <= d6:
        q = c
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        q = a + (d1 / (d1 - d3)) * ab
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        q = a + (d2 / (d2 - d6)) * ac
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        q = b + ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (c - b)
    else:
        total = va + vb + vc
        if total > 0.0:
            q = a + (vb / total) * ab + (vc / total) * ac
    return wp.length_sq(p - q)


@wp.func
def nearest_vertex(
    p: wp.vec3,
    first: int,
    ground: Ground,
) -> int:
    """Return the vertex whose base point is nearest to ``p``, by descent over the triangulation's edges from ``first``.

    Exact on a Delaunay triangulation; a scan's own triangles may stop it one vertex short.
    """
    here = first
    best = wp.length_sq(ground.frames.foot[here] - p)
    step = int(0)
    while step < _MOST_STEPS:
        better = here
        for e in range(ground.offsets[here], ground.offsets[here + 1]):
            d = wp.length_sq(ground.frames.foot[ground.neighbors[e]] - p)
            if d < best:
                best = d
                better = ground.neighbors[e]
        if better == here:
            step = _MOST_STEPS
        here = better
        step = step + 1
    return here


@wp.kernel
def surface_ssd_kernel(
    start: int,
    target: wp.array[wp.int32],
    lists: NeighborLists,
    position: wp.array[wp.vec3],
    color: wp.array[wp.vec3],
    shape_weight: float,
    ground: Ground,
    samples: Frames,
    sample_vertex: wp.array[wp.int32],
    rotation: wp.array[wp.vec2],
    stride: int,
    factor: float,
    # output
    cost: wp.array2d[wp.float32],
):
    """Write Σ_n w_n (m d²(n) + |c(n) - c(v)|²) over a target's textured neighbours n, for every ``stride``-th candidate.

    d(n) is the distance of n, laid on the surface at the candidate, to the nearest triangle there: equation 2 of [2]; m is
    ``shape_weight``; c are colours (none where ``color`` is empty), v the vertex nearest to n on the base: [1], section 6. Viable
    are, after [1], candidates where the vertex that is nearest to n on the base, and the corners of the triangle nearest to n
    in space, are all samples. A candidate is dropped once its sum exceeds ``factor`` times the best that this thread has
    seen; what is within ``factor`` of the best of all is never dropped.
    """
    i, first = wp.tid()
    row = start + i
    t = target[row]
    ut = ground.frames.u[t]
    vt = ground.frames.v[t]
    nt = wp.cross(ut, vt)
    sample_count = samples.foot.shape[0]
    best = float(_NOT_VIABLE)
    c = first
    while c < cost.shape[1]:
        s = c % sample_count
        turn = rotation[c / sample_count]
        us = samples.u[s]
        vs = samples.v[s]
        ns = wp.cross(us, vs)
        total = float(0.0)
        partner = sample_vertex[s]
        e = lists.offsets[row]
        while e < lists.offsets[row + 1]:
            n = lists.vertex[e]
            r = ground.frames.foot[n] - ground.frames.foot[t]
            x = wp.dot(r, ut)
            y = wp.dot(r, vt)
            p = samples.foot[s] + (turn[0] * x - turn[1] * y) * us + (turn[1] * x + turn[0] * y) * vs + wp.dot(r, nt) * ns
            partner = nearest_vertex(p, partner, ground)
            r = position[n] - ground.frames.foot[t]
            x = wp.dot(r, ut)
            y = wp.dot(r, vt)
            p = samples.foot[s] + (turn[0] * x - turn[1] * y) * us + (turn[1] * x + turn[0] * y) * vs + wp.dot(r, nt) * ns
            nearest = float(_NOT_VIABLE)
            viable = int(0)
            if ground.is_sample[partner] != wp.uint8(0):
                for k in range(ground.face_offsets[partner], ground.face_offsets[partner + 1]):
                    f = ground.incident[k]
                    i0 = ground.faces[f, 0]
                    i1 = ground.faces[f, 1]
                    i2 = ground.faces[f, 2]
                    d = squared_distance_to_triangle(p, position[i0], position[i1], position[i2])
                    if d < nearest:
                        nearest = d
                        viable = int(0)
                        if (
                            ground.is_sample[i0] != wp.uint8(0)
                            and ground.is_sample[i1] != wp.uint8(0)
                            and ground.is_sample[i2] != wp.uint8(0)
                        ):
                            viable = int(1)
            if color.shape[0] > 0:
                nearest = shape_weight * nearest + wp.length_sq(color[n] - color[partner])
            total = total + lists.weight[e] * nearest
            if viable == 0 or total > factor * best:
                total = float(_NOT_VIABLE)
                e = lists.offsets[row + 1]
            e = e + 1
        cost[row, c] = total
        best = wp.min(best, total)
        c = c + stride


@dataclass(frozen=True)
class SurfaceMesh:
    """A triangulated surface over a base.

    Attributes
    ----------
    foot, u, v : (N, 3) arrays
        Vertices' base points, and unit vectors along the base; lengths in a unit in which heights are about 1.
    offsets, neighbors : (N + 1,), (E,) int arrays
        Which vertices are joined by an edge.
    face_offsets, incident : (N + 1,), (3 F,) int arrays
        Which faces have a vertex as corner.
    faces : (F, 3) int array
    """

    foot: np.ndarray
    u: np.ndarray
    v: np.ndarray
    offsets: np.ndarray
    neighbors: np.ndarray
    face_offsets: np.ndarray
    incident: np.ndarray
    faces: np.ndarray


class SurfaceMatcher:
    """Compares targets with all samples at all rotations by distances to the surface.

    Candidate ``rotation * S + sample`` is one of S samples at one of R rotations.

    Parameters
    ----------
    mesh : SurfaceMesh
    turns : (R, 2) array
        Cosine and sine of each rotation.
    device : str
        From `choose_device`.
    """

    def __init__(self, mesh: SurfaceMesh, turns: np.ndarray, device: str) -> None:
        self.device = device
        self._rotations = len(turns)
        self._turns = upload(turns, wp.vec2, device)
        self._ground = Ground()
        self._ground.frames = upload_frames(mesh.foot, mesh.u, mesh.v, device)
        for name in ("offsets", "neighbors", "face_offsets", "incident", "faces"):
            setattr(self._ground, name, upload(getattr(mesh, name), wp.int32, device))
        self._samples = Frames()

    def take_samples(self, foot: np.ndarray, u: np.ndarray, v: np.ndarray, vertex: np.ndarray, is_sample: np.ndarray) -> None:
        """Set what targets are compared with.

        Parameters
        ----------
        foot, u, v : (S, 3) arrays
            Samples' base points and frames, in the mesh's unit.
        vertex : (S,) int array
            A vertex at or near each sample, where the descent to its neighbours begins.
        is_sample : (N,) bool array
            The mesh's vertices that a match may use.
        """
        self._samples = upload_frames(foot, u, v, self.device)
        self._sample_vertex = upload(vertex, wp.int32, self.device)
        self.take_partners(is_sample)

    def take_partners(self, is_sample: np.ndarray) -> None:
        """Set which of the mesh's vertices (N,) a target's neighbours may fall on."""
        self._ground.is_sample = upload(is_sample, wp.uint8, self.device)

    def costs(
        self,
        targets: np.ndarray,
        position: np.ndarray,
        offsets: np.ndarray,
        neighbors: np.ndarray,
        weight: np.ndarray,
        factor: float,
        *,
        color: np.ndarray | None = None,
        shape_weight: float = 1.0,
    ) -> wp.array:
        """Return the error (T, R * S) float32 of every candidate, `NOT_VIABLE` where it is none.

        Parameters
        ----------
        targets : (T,) int array
            Vertices.
        position : (N, 3) array
            All vertices' places on the surface, in the mesh's unit; anything where they are not known.
        offsets, neighbors, weight : (T + 1,), (K,), (K,) arrays
            The known vertices around each target, and their weights, which sum to 1.
        factor : float
            Candidates worse than this times the best may be dropped: they get `NOT_VIABLE` too.
        color : (N, 3) array, optional
            All vertices' colours; their squared differences are added to ``shape_weight`` times the squared distances.
        shape_weight : float
        """
        candidates = len(self._sample_vertex) * self._rotations
        stride = min(candidates, _STRIDE_CPU if self.device.startswith("cpu") else _STRIDE_CUDA)
        lists = NeighborLists()
        lists.offsets = upload(offsets, wp.int32, self.device)
        lists.vertex = upload(neighbors, wp.int32, self.device)
        lists.weight = upload(weight, wp.float32, self.device)
        cost = wp.full((len(targets), candidates), NOT_VIABLE, dtype=wp.float32, device=self.device)
        launch(
            surface_ssd_kernel,
            (len(targets), stride),
            inputs=[
                upload(targets, wp.int32, self.device),
                lists,
                upload(position, wp.vec3, self.device),
                upload(np.zeros((0, 3)) if color is None else color, wp.vec3, self.device),
                float(shape_weight),
                self._ground,
                self._samples,
                self._sample_vertex,
                self._turns,
                stride,
                float(factor),
            ],
            outputs=[cost],
            device=self.device,
            grain=1,
        )
        return cost
