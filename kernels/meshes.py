"""Triangle meshes and tangent frames as kernels take them."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import upload

wp.set_module_options({"enable_backward": False})


@wp.struct
class Frames:
    """Points of a surface, and two unit vectors that span its tangent plane at each."""

    foot: wp.array[wp.vec3]
    u: wp.array[wp.vec3]
    v: wp.array[wp.vec3]


@wp.struct
class Triangles:
    """A mesh that can be walked over: per edge k -> k + 1 of a face, the face across it, or -1."""

    points: wp.array[wp.vec3]
    faces: wp.array2d[wp.int32]
    across: wp.array2d[wp.int32]


@wp.func
def face_barycentric(mesh: Triangles, f: int, p: wp.vec3) -> wp.vec3:
    """Return the `barycentric` coordinates of ``p`` in face ``f``."""
    return barycentric(p, mesh.points[mesh.faces[f, 0]], mesh.points[mesh.faces[f, 1]], mesh.points[mesh.faces[f, 2]])


@wp.func
def barycentric(p: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3) -> wp.vec3:
    """Return barycentric coordinates of ``p`` seen along the normal of triangle (a, b, c); (-1e9, ..) where it has no area."""
    n = wp.cross(b - a, c - a)
    area = wp.dot(n, n)
    result = wp.vec3(-1.0e9, -1.0e9, -1.0e9)
    if area > 0.0:
        u = wp.dot(wp.cross(c - b, p - b), n) / area
        v = wp.dot(wp.cross(a - c, p - c), n) / area
        result = wp.vec3(u, v, 1.0 - u - v)
    return result


@wp.func
def face_normal(mesh: Triangles, f: int) -> wp.vec3:
    """Return the unit normal of face ``f``; zero where it has no area."""
    a = mesh.points[mesh.faces[f, 0]]
    return wp.normalize(wp.cross(mesh.points[mesh.faces[f, 1]] - a, mesh.points[mesh.faces[f, 2]] - a))


def upload_frames(foot: np.ndarray, u: np.ndarray, v: np.ndarray, device: str) -> Frames:
    """Return points and tangent vectors, (N, 3) each, on ``device``."""
    frames = Frames()
    frames.foot, frames.u, frames.v = (upload(a, wp.vec3, device) for a in (foot, u, v))
    return frames


def build_mesh(points: wp.array, faces: np.ndarray) -> wp.Mesh:
    """Return the triangles ``faces`` (F, 3) of ``points`` in a hierarchy of boxes, for rays and nearest points."""
    return wp.Mesh(points=points, indices=upload(np.asarray(faces).reshape(-1), wp.int32, str(points.device)))
