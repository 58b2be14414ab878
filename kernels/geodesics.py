"""Straight lines on a triangle mesh, and nearest points on it: the exponential map where the base has no formula.

A geodesic crosses an edge without turning: the two triangles are unfolded into one plane about it (the straightest geodesics of
Polthier & Schmies 1998, inside faces and across edges).
"""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload
from intaglio.kernels.meshes import Frames, Triangles, build_mesh, face_barycentric, face_normal, upload_frames

wp.set_module_options({"enable_backward": False})

# Rounding may keep a walk turning about a vertex; this many edges end it. No real walk is so long.
_MOST_CROSSINGS = wp.constant(1_000_000)
# Newton's steps along a normal to a mesh, the longest, and the least cosine between a step and the mesh's normal that counts.
_STEPS_TO_COPY = wp.constant(12)
_LONGEST_STEP = wp.constant(4.0)
_STEEPEST = wp.constant(0.25)
# A line that ends further than this from the mesh has not met it.
_MET = wp.constant(0.5)
_ARRIVED = wp.constant(1.0e-4)


@wp.func
def go_straight(mesh: Triangles, face: int, weight: wp.vec3, ahead: wp.vec3, behind: int, length: float):
    """Walk straight on by ``length``; return the face (-1 beyond a border), the place in it, the direction, the edge behind.

    ``behind`` is the corner opposite the edge that the walk came in by, or -1. Within a triangle barycentric coordinates change
    by travel * slope; across an edge the direction is unfolded.
    """
    at = int(face)
    b = weight
    direction = ahead
    entered = int(behind)
    left = float(length)
    found = int(-1)
    step = int(0)
    while found < 0 and at >= 0 and step < _MOST_CROSSINGS:
        p0 = mesh.points[mesh.faces[at, 0]]
        p1 = mesh.points[mesh.faces[at, 1]]
        p2 = mesh.points[mesh.faces[at, 2]]
        n = wp.cross(p1 - p0, p2 - p0)
        area = wp.dot(n, n)
        if area == 0.0:
            at = -1
        else:
            # The barycentric coordinates' change for a unit of length along the direction.
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
                # The walk leaves through the edge opposite corner ``leave``, from corner ``leave + 1`` to ``leave + 2``.
                edge = (leave + 1) % 3
                first = mesh.faces[at, edge]
                last = mesh.faces[at, (edge + 1) % 3]
                share = b[(edge + 1) % 3] / wp.max(b[edge] + b[(edge + 1) % 3], 1.0e-12)
                beyond = mesh.across[at, edge]
                if beyond >= 0:
                    along = wp.normalize(mesh.points[last] - mesh.points[first])
                    outward = wp.cross(along, wp.normalize(n))
                    m = face_normal(mesh, beyond)
                    # The triangles are unfolded about the edge: what pointed out of this one points into the next.
                    direction = wp.normalize(
                        wp.dot(direction, along) * along + wp.max(wp.dot(direction, outward), 0.0) * wp.cross(along, m)
                    )
                    b = wp.vec3(0.0, 0.0, 0.0)
                    for c in range(3):
                        vertex = mesh.faces[beyond, c]
                        if vertex == first:
                            b[c] = 1.0 - share
                        elif vertex == last:
                            b[c] = share
                        else:
                            entered = c
                at = beyond
        step = step + 1
    return found, b, direction, entered


@wp.func
def into_face(mesh: Triangles, face: int, point: wp.vec3) -> wp.vec3:
    """Return where a point at or near a face lies in it: it may lie a little outside, where base and facet differ."""
    b = face_barycentric(mesh, face, point)
    b = wp.vec3(wp.max(b[0], 0.0), wp.max(b[1], 0.0), wp.max(b[2], 0.0))
    return b / wp.max(b[0] + b[1] + b[2], 1.0e-12)


@wp.kernel
def trace_kernel(
    start: int,
    centers: Frames,
    first_face: wp.array[wp.int32],
    offsets: wp.array[wp.vec2],
    mesh: Triangles,
    # output
    face: wp.array2d[wp.int32],
    weight: wp.array2d[wp.vec2],
):
    """Walk from a foot straight on along every offset g, by |g| in direction g_x u + g_y v; -1 where the surface ends before."""
    i = start + wp.tid()
    origin_face = first_face[i]
    b0 = into_face(mesh, origin_face, centers.foot[i])
    n0 = face_normal(mesh, origin_face)
    for k in range(offsets.shape[0]):
        g = offsets[k]
        length = wp.length(g)
        found = int(-1)
        b = b0
        if wp.length_sq(n0) > 0.0:
            found = origin_face
            if length > 0.0:
                direction = g[0] * centers.u[i] + g[1] * centers.v[i]
                direction = wp.normalize(direction - wp.dot(direction, n0) * n0)
                found, b, direction, _ = go_straight(mesh, origin_face, b0, direction, -1, length)
        face[i, k] = found
        weight[i, k] = wp.vec2(b[0], b[1])


@wp.kernel
def trace_rays_kernel(
    start: int,
    centers: Frames,
    first_face: wp.array[wp.int32],
    directions: wp.array[wp.vec2],
    point: wp.array2d[wp.int32],
    step: float,
    mesh: Triangles,
    # output
    face: wp.array2d[wp.int32],
    weight: wp.array2d[wp.vec2],
):
    """Walk from a foot along rays and note every ``step``: ring j of ray d is grid point ``point[d, j]``, unless -1."""
    i = start + wp.tid()
    origin_face = first_face[i]
    b0 = into_face(mesh, origin_face, centers.foot[i])
    n0 = face_normal(mesh, origin_face)
    face[i, 0] = -1
    if wp.length_sq(n0) > 0.0:
        face[i, 0] = origin_face
    weight[i, 0] = wp.vec2(b0[0], b0[1])
    for d in range(directions.shape[0]):
        g = directions[d]
        direction = g[0] * centers.u[i] + g[1] * centers.v[i]
        direction = wp.normalize(direction - wp.dot(direction, n0) * n0)
        at = face[i, 0]
        b = b0
        entered = int(-1)
        for j in range(point.shape[1]):
            if at >= 0:
                at, b, direction, entered = go_straight(mesh, at, b, direction, entered, step)
            k = point[d, j]
            if k >= 0:
                face[i, k] = at
                weight[i, k] = wp.vec2(b[0], b[1])


@wp.kernel
def nearest_kernel(
    start: int,
    at: wp.array[wp.vec3],
    mesh: wp.uint64,
    reach: float,
    # output
    face: wp.array[wp.int32],
    weight: wp.array[wp.vec2],
):
    """Write the mesh's point nearest to each position, argmin |x - at|, as face and barycentric weights; -1 beyond ``reach``."""
    i = start + wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, at[i], reach)
    face[i] = -1
    if query.result:
        face[i] = query.face
        weight[i] = wp.vec2(query.u, query.v)


@wp.kernel
def copy_kernel(
    start: int,
    foot: wp.array[wp.vec3],
    way: wp.array[wp.vec3],
    mesh: wp.uint64,
    normal: wp.array[wp.vec3],
    # output
    height: wp.array[wp.float32],
    source: wp.array[wp.int32],
    reached: wp.array[wp.uint8],
):
    """Move heights along normals ``way`` over feet onto a mesh: Newton's steps to the tangent plane at the nearest point.

    Writes the nearest vertex, and whether the line met a face that looks its way. ``height`` holds the start. Lengths are in
    spacings.
    """
    i = start + wp.tid()
    h = height[i]
    best = int(0)
    met = int(0)
    step = float(0.0)
    for k in range(_STEPS_TO_COPY):
        at = foot[i] + h * way[i]
        query = wp.mesh_query_point_no_sign(mesh, at, 1.0e6)
        if query.result:
            there = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
            w = 1.0 - query.u - query.v
            a = wp.mesh_get_index(mesh, 3 * query.face)
            b = wp.mesh_get_index(mesh, 3 * query.face + 1)
            c = wp.mesh_get_index(mesh, 3 * query.face + 2)
            n = wp.normalize(query.u * normal[a] + query.v * normal[b] + w * normal[c])
            best = c
            if query.u >= query.v and query.u >= w:
                best = a
            elif query.v >= w:
                best = b
            met = int(0)
            if wp.length(there - at) < _MET and wp.dot(wp.mesh_eval_face_normal(mesh, query.face), way[i]) > 0.0:
                met = int(1)
            step = wp.dot(there - at, n) / wp.max(wp.dot(n, way[i]), _STEEPEST)
            if wp.abs(step) < _ARRIVED:
                break
            if k < _STEPS_TO_COPY - 1:
                h = h + wp.clamp(step, -_LONGEST_STEP, _LONGEST_STEP)
    height[i] = h
    source[i] = best
    reached[i] = wp.uint8(met)


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
    mesh = Triangles()
    mesh.points, mesh.faces, mesh.across = points, faces, across
    launch(
        trace_kernel,
        count,
        inputs=[upload_frames(foot, u, v, device), upload(first_face, wp.int32, device), upload(offsets, wp.vec2, device), mesh],
        outputs=[face, weight],
        device=device,
    )
    return face, weight


def trace_rays(
    foot: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
    first_face: np.ndarray,
    directions: np.ndarray,
    point: np.ndarray,
    step: float,
    mesh: Triangles,
    device: str,
) -> tuple[wp.array, wp.array]:
    """Return face (M, G) int32 and barycentric weights (M, G) vec2 of grids of rays around M points of a mesh.

    Parameters
    ----------
    foot, u, v : (M, 3) arrays
        Grid centres and tangent vectors.
    first_face : (M,) array
        The triangle that each centre lies in or is a corner of.
    directions : (D, 2) array
        Unit vectors of the rays, along u and v.
    point : (D, J) int array
        The grid point, from 1, that lies j + 1 steps along each ray, or -1; point 0 is the centre.
    step : float
        In length units.
    mesh : Triangles
    device : str
        From `choose_device`.
    """
    grid = int(point.max()) + 1
    face = wp.empty((len(foot), grid), dtype=wp.int32, device=device)
    weight = wp.empty((len(foot), grid), dtype=wp.vec2, device=device)
    launch(
        trace_rays_kernel,
        len(foot),
        inputs=[
            upload_frames(foot, u, v, device),
            upload(first_face, wp.int32, device),
            upload(directions, wp.vec2, device),
            upload(point, wp.int32, device),
            float(step),
            mesh,
        ],
        outputs=[face, weight],
        device=device,
        grain=16,
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
    mesh = build_mesh(upload(vertices - center, wp.vec3, device), faces)
    face = wp.empty(len(at), dtype=wp.int32, device=device)
    weight = wp.zeros(len(at), dtype=wp.vec2, device=device)
    launch(
        nearest_kernel,
        len(at),
        inputs=[upload(at - center, wp.vec3, device), mesh.id, reach],
        outputs=[face, weight],
        device=device,
    )
    first = weight.numpy().astype(np.float64)
    return face.numpy().copy(), np.column_stack([first, 1.0 - first.sum(axis=1)])
