"""Straight lines on a triangle mesh, and nearest points on it: the exponential map where the base has no formula.

A geodesic crosses an edge without turning: the two triangles are unfolded into one plane about it (the straightest geodesics of
Polthier & Schmies 1998, inside faces and across edges).
"""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch
from intaglio.kernels.location import barycentric

wp.set_module_options({"enable_backward": False})

# Ends a walk that rounding keeps turning about a vertex; any real one is over long before.
_MOST_CROSSINGS = wp.constant(1_000_000)


@wp.func
def face_normal(points: wp.array(dtype=wp.vec3), faces: wp.array2d(dtype=wp.int32), f: int) -> wp.vec3:
    """Unit normal of triangle ``f``; zero where it has no area."""
    a = points[faces[f, 0]]
    return wp.normalize(wp.cross(points[faces[f, 1]] - a, points[faces[f, 2]] - a))


@wp.kernel
def trace_kernel(
    start: int,
    foot: wp.array(dtype=wp.vec3),
    u: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    first_face: wp.array(dtype=wp.int32),
    offsets: wp.array(dtype=wp.vec2),
    points: wp.array(dtype=wp.vec3),
    faces: wp.array2d(dtype=wp.int32),
    across: wp.array2d(dtype=wp.int32),
    # output
    face: wp.array2d(dtype=wp.int32),
    weight: wp.array2d(dtype=wp.vec2),
):
    """Walk from a foot straight on along every offset; -1 where the surface ends before it."""
    i = start + wp.tid()
    origin_face = first_face[i]
    b0 = barycentric(foot[i], points[faces[origin_face, 0]], points[faces[origin_face, 1]], points[faces[origin_face, 2]])
    # The foot is put into its triangle: normals of base and facet differ a little.
    b0 = wp.vec3(wp.max(b0[0], 0.0), wp.max(b0[1], 0.0), wp.max(b0[2], 0.0))
    b0 = b0 / wp.max(b0[0] + b0[1] + b0[2], 1.0e-12)
    n0 = face_normal(points, faces, origin_face)
    for k in range(offsets.shape[0]):
        g = offsets[k]
        at = origin_face
        b = b0
        left = wp.length(g)
        direction = g[0] * u[i] + g[1] * v[i]
        direction = wp.normalize(direction - wp.dot(direction, n0) * n0)
        entered = int(-1)
        found = int(-1)
        step = int(0)
        if left == 0.0 and wp.length_sq(n0) > 0.0:
            found = at
        if wp.length_sq(n0) == 0.0:
            at = -1
        while found < 0 and at >= 0 and step < _MOST_CROSSINGS:
            p0 = points[faces[at, 0]]
            p1 = points[faces[at, 1]]
            p2 = points[faces[at, 2]]
            n = wp.cross(p1 - p0, p2 - p0)
            area = wp.dot(n, n)
            if area == 0.0:
                at = -1
            else:
                # Change of the barycentric coordinates per unit of length.
                slope = wp.vec3(
                    wp.dot(wp.cross(p2 - p1, direction), n) / area,
                    wp.dot(wp.cross(p0 - p2, direction), n) / area,
                    wp.dot(wp.cross(p1 - p0, direction), n) / area,
                )
                travel = left
                leave = int(-1)
                for c in range(3):
                    if c != entered and slope[c] < 0.0:
                        t = wp.max(b[c], 0.0) / (-slope[c])
                        if t < travel:
                            travel = t
                            leave = c
                b = b + travel * slope
                left = left - travel
                if leave < 0:
                    found = at
                else:
                    # The edge that faces corner ``leave``, from corner ``leave + 1`` to ``leave + 2``.
                    edge = (leave + 1) % 3
                    first = faces[at, edge]
                    last = faces[at, (edge + 1) % 3]
                    share = b[(edge + 1) % 3] / wp.max(b[edge] + b[(edge + 1) % 3], 1.0e-12)
                    beyond = across[at, edge]
                    if beyond >= 0:
                        along = wp.normalize(points[last] - points[first])
                        outward = wp.cross(along, wp.normalize(n))
                        m = face_normal(points, faces, beyond)
                        # Unfolded: what pointed out of this triangle points into the next.
                        direction = wp.normalize(
                            wp.dot(direction, along) * along + wp.max(wp.dot(direction, outward), 0.0) * wp.cross(along, m)
                        )
                        b = wp.vec3(0.0, 0.0, 0.0)
                        for c in range(3):
                            vertex = faces[beyond, c]
                            if vertex == first:
                                b[c] = 1.0 - share
                            elif vertex == last:
                                b[c] = share
                            else:
                                entered = c
                    at = beyond
            step = step + 1
        face[i, k] = found
        weight[i, k] = wp.vec2(b[0], b[1])


@wp.kernel
def nearest_kernel(
    start: int,
    at: wp.array(dtype=wp.vec3),
    mesh: wp.uint64,
    reach: float,
    # output
    face: wp.array(dtype=wp.int32),
    weight: wp.array(dtype=wp.vec2),
):
    """Nearest point of a mesh, as face and barycentric weights; -1 beyond ``reach``."""
    i = start + wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, at[i], reach)
    face[i] = -1
    if query.result:
        face[i] = query.face
        weight[i] = wp.vec2(query.u, query.v)


def trace(
    foot: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
    first_face: np.ndarray,
    offsets: np.ndarray,
    points: wp.array,
    faces: wp.array,
    across: wp.array,
    device: str,
) -> tuple[wp.array, wp.array]:
    """Return face (M, G) int32 and barycentric weights (M, G) vec2 of the polar grids around M points of a mesh.

    Parameters
    ----------
    foot, u, v : (M, 3) arrays
        Grid centres and tangent vectors.
    first_face : (M,) array
        The triangle that each centre lies in or is a corner of.
    offsets : (G, 2) array
        Grid points along u and v, in length units.
    points, faces, across : warp arrays
        The mesh; per edge k -> k + 1, the triangle across or -1.
    device : str
        From `choose_device`.
    """
    count, grid = len(foot), len(offsets)
    face = wp.empty((count, grid), dtype=wp.int32, device=device)
    weight = wp.empty((count, grid), dtype=wp.vec2, device=device)

    def vectors(a: np.ndarray, kind: type = wp.vec3) -> wp.array:
        return wp.array(np.ascontiguousarray(a, np.float32), dtype=kind, device=device)

    launch(
        trace_kernel,
        count,
        inputs=[
            vectors(foot),
            vectors(u),
            vectors(v),
            wp.array(np.ascontiguousarray(first_face, np.int32), dtype=wp.int32, device=device),
            vectors(offsets, wp.vec2),
            points,
            faces,
            across,
        ],
        outputs=[face, weight],
        device=device,
    )
    return face, weight


def nearest_on_mesh(at: np.ndarray, vertices: np.ndarray, faces: np.ndarray, device: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the face (M,) and barycentric weights (M, 3) of the mesh's nearest points.

    Parameters
    ----------
    at : (M, 3) array
        Finite points, in the mesh's coordinates.
    vertices, faces : (N, 3), (F, 3) arrays
        The mesh; it is moved to its centre before single precision is used.
    device : str
        From `choose_device`.
    """
    center = vertices.mean(axis=0)
    reach = float(np.linalg.norm(np.ptp(np.concatenate([vertices, at]), axis=0))) + 1.0

    def vectors(a: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(a - center, np.float32), dtype=wp.vec3, device=device)

    indices = wp.array(np.ascontiguousarray(faces, np.int32).reshape(-1), dtype=wp.int32, device=device)
    mesh = wp.Mesh(points=vectors(vertices), indices=indices)
    face = wp.empty(len(at), dtype=wp.int32, device=device)
    weight = wp.zeros(len(at), dtype=wp.vec2, device=device)
    launch(nearest_kernel, len(at), inputs=[vectors(at), mesh.id, reach], outputs=[face, weight], device=device)
    first = weight.numpy().astype(np.float64)
    return face.numpy().copy(), np.column_stack([first, 1.0 - first.sum(axis=1)])
