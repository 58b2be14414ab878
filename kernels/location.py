"""Neighbourhood grids over a base: points around a vertex, found on the base's triangulation.

A grid is polar: ring ``j`` of ``w`` lies at geodesic distance ``j * spacing`` and has a multiple of R points, so that a
rotation by a multiple of ``2 pi / R`` is a permutation of the grid and needs no second look-up.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload
from intaglio.kernels.meshes import Frames, Triangles, build_mesh, face_barycentric, upload_frames

wp.set_module_options({"enable_backward": False})

_MOST_STEPS = wp.constant(96)
# A point belongs to a triangle whose barycentric coordinates of it are all above this: the prisms over neighbouring facets of a
# curved base, along their normals, leave gaps of this order. Heights are extrapolated there, so that linear ones stay exact.
_SLACK = wp.constant(-2.0e-3)
# A grid point is known where its textured corners have this share of the weight: on an edge or a corner, up to rounding, those of
# the edge or the corner are enough.
_TEXTURED_SHARE = wp.constant(0.999)


def polar_grid(window: int, rotations: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the grid's points in units of the spacing, their rings, and the permutation of every rotation.

    Parameters
    ----------
    window : int
        Number of rings w, at least 1.
    rotations : int
        R, at least 1.

    Returns
    -------
    offsets : (G, 2) float32 array
        Along u and v; the centre comes first, then ring by ring.
    ring : (G,) int32 array
    permutation : (R, G) int32 array
        Point k turned by ``2 pi q / R`` is point ``permutation[q, k]``.
    """
    points, ring = [(0.0, 0.0)], [0]
    permutation = [np.zeros((rotations, 1), np.int32)]
    for j in range(1, window + 1):
        count = rotations * max(1, round(6 * j / rotations))
        angle = 2 * np.pi * np.arange(count) / count
        first = len(points)
        points += list(zip(j * np.cos(angle), j * np.sin(angle), strict=True))
        ring += [j] * count
        turn = (np.arange(rotations) * (count // rotations))[:, None]
        permutation.append((first + (np.arange(count)[None, :] + turn) % count).astype(np.int32))
    return np.array(points, np.float32), np.array(ring, np.int32), np.concatenate(permutation, axis=1)


@wp.struct
class BaseModel:
    """A base: 0 plane, 1 cylinder, 2 sphere; a point of the axis or the centre, the unit axis, the radius."""

    kind: int
    origin: wp.vec3
    axis: wp.vec3
    radius: float


@wp.func
def exponential_map(base: BaseModel, foot: wp.vec3, tangent: wp.vec3) -> wp.vec3:
    """Return the base's point exp_foot(tangent), at the end of the geodesic that begins at ``foot`` along ``tangent``."""
    origin = base.origin
    axis = base.axis
    radius = base.radius
    point = foot + tangent
    if base.kind == 1:
        relative = foot - origin
        along = wp.dot(relative, axis)
        outward = wp.normalize(relative - along * axis)
        around = wp.cross(axis, outward)
        angle = wp.dot(tangent, around) / radius
        point = origin + (along + wp.dot(tangent, axis)) * axis + radius * (wp.cos(angle) * outward + wp.sin(angle) * around)
    if base.kind == 2:
        length = wp.length(tangent)
        if length > 0.0:
            angle = length / radius
            point = origin + wp.cos(angle) * (foot - origin) + (radius * wp.sin(angle) / length) * tangent
    return point


@wp.kernel
def locate_kernel(
    start: int,
    centers: Frames,
    first_face: wp.array[wp.int32],
    offsets: wp.array[wp.vec2],
    base: BaseModel,
    triangles: Triangles,
    mesh: wp.uint64,
    reach: float,
    # output
    face: wp.array2d[wp.int32],
    weight: wp.array2d[wp.vec2],
):
    """Find the triangle that holds exp_foot(g_x u + g_y v) for every grid point g of one vertex; -1 where the base ends before.

    The walk goes from triangle to triangle, from the one of the grid point before.
    """
    i = start + wp.tid()
    here = first_face[i]
    for k in range(offsets.shape[0]):
        g = offsets[k]
        p = exponential_map(base, centers.foot[i], g[0] * centers.u[i] + g[1] * centers.v[i])
        at = here
        found = int(-1)
        b = wp.vec3(0.0, 0.0, 0.0)
        step = int(0)
        while at >= 0 and step < _MOST_STEPS:
            b = face_barycentric(triangles, at, p)
            low = wp.min(b)
            if low >= _SLACK:
                found = at
                step = _MOST_STEPS
            else:
                # Leave through the edge that faces the most negative corner.
                if b[0] == low:
                    at = triangles.across[at, 1]
                elif b[1] == low:
                    at = triangles.across[at, 2]
                else:
                    at = triangles.across[at, 0]
            step = step + 1
        if found < 0:
            # The straight walk met a border or went in a circle. The point may lie beyond that: the nearest triangle is asked.
            query = wp.mesh_query_point_no_sign(mesh, p, reach)
            if query.result:
                found = query.face
                b = wp.vec3(query.u, query.v, 1.0 - query.u - query.v)
        if found >= 0:
            here = found
        face[i, k] = found
        weight[i, k] = wp.vec2(b[0], b[1])


@wp.kernel
def gather_kernel(
    start: int,
    rows: wp.array[wp.int32],
    face: wp.array2d[wp.int32],
    weight: wp.array2d[wp.vec2],
    faces: wp.array2d[wp.int32],
    height: wp.array[wp.float32],
    textured: wp.array[wp.uint8],
    # output
    value: wp.array2d[wp.float32],
    known: wp.array2d[wp.float32],
):
    """Write Σ w_i h_i / Σ w_i over the textured corners of the triangle at each grid point, and whether it is known.

    It is known (1, else 0) where the textured corners carry the whole weight.
    """
    i = start + wp.tid()
    row = rows[i]
    for k in range(face.shape[1]):
        f = face[row, k]
        h = float(0.0)
        m = float(0.0)
        if f >= 0:
            a = faces[f, 0]
            b = faces[f, 1]
            c = faces[f, 2]
            w = weight[row, k]
            wa = w[0] * float(textured[a])
            wb = w[1] * float(textured[b])
            wc = (1.0 - w[0] - w[1]) * float(textured[c])
            total = wa + wb + wc
            if total >= _TEXTURED_SHARE:
                h = (wa * height[a] + wb * height[b] + wc * height[c]) / total
                m = float(1.0)
        value[i, k] = h
        known[i, k] = m


class GridLocator:
    """Locates polar grids on one triangulated base.

    Parameters
    ----------
    points : (N, 3) array
        Base points of the combined triangulation, near the origin (float32 is enough there).
    faces, across : (F, 3) int32 arrays
        Its triangles and, per edge k -> k + 1, the triangle across or -1.
    kind, origin, axis, radius
        The base, in the same coordinates: 0 plane, 1 cylinder, 2 sphere.
    device : str
        From `choose_device`.
    """

    def __init__(
        self,
        points: np.ndarray,
        faces: np.ndarray,
        across: np.ndarray,
        kind: int,
        origin: np.ndarray,
        axis: np.ndarray,
        radius: float,
        device: str,
    ) -> None:
        self.device = device
        self.points = upload(points, wp.vec3, device)
        self.faces = upload(faces, wp.int32, device)
        self.across = upload(across, wp.int32, device)
        self._triangles = Triangles()
        self._triangles.points, self._triangles.faces, self._triangles.across = self.points, self.faces, self.across
        self._base = BaseModel()
        self._base.kind, self._base.radius = int(kind), float(radius)
        self._base.origin, self._base.axis = wp.vec3(*map(float, origin)), wp.vec3(*map(float, axis))
        self.mesh = build_mesh(self.points, faces)

    def locate(
        self, foot: np.ndarray, u: np.ndarray, v: np.ndarray, first_face: np.ndarray, offsets: np.ndarray, reach: float
    ) -> tuple[wp.array, wp.array]:
        """Return face (M, G) int32 and barycentric weights (M, G) vec2 of the grids around M points of the base.

        Parameters
        ----------
        foot, u, v : (M, 3) arrays
            Grid centres and tangent vectors.
        first_face : (M,) array
            A triangle at or near each centre.
        offsets : (G, 2) array
            Grid points along u and v, in length units.
        reach : float
            How far from the triangulation a point still counts as on it, a small part of the spacing.
        """
        count, grid = len(foot), len(offsets)
        face = wp.empty((count, grid), dtype=wp.int32, device=self.device)
        weight = wp.empty((count, grid), dtype=wp.vec2, device=self.device)
        launch(
            locate_kernel,
            count,
            inputs=[
                upload_frames(foot, u, v, self.device),
                upload(first_face, wp.int32, self.device),
                upload(offsets, wp.vec2, self.device),
                self._base,
                self._triangles,
                self.mesh.id,
                float(reach),
            ],
            outputs=[face, weight],
            device=self.device,
        )
        return face, weight

    def gather(
        self,
        rows: np.ndarray,
        located: tuple[wp.array, wp.array],
        height: wp.array,
        textured: wp.array,
    ) -> tuple[wp.array, wp.array]:
        """Return interpolated heights and known flags, both (len(rows), G) float32, at rows of ``located``."""
        face, weight = located
        shape = (len(rows), face.shape[1])
        value = wp.empty(shape, dtype=wp.float32, device=self.device)
        known = wp.empty(shape, dtype=wp.float32, device=self.device)
        launch(
            gather_kernel,
            len(rows),
            inputs=[upload(rows, wp.int32, self.device), face, weight, self.faces, height, textured],
            outputs=[value, known],
            device=self.device,
        )
        return value, known


@wp.kernel
def height_above_kernel(
    start: int,
    foot: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    mesh: wp.uint64,
    reach: float,
    # output
    height: wp.array[wp.float32],
):
    """Write h where foot + h normal is the crossing of the mesh that is nearest to the foot; NaN where there is none."""
    i = start + wp.tid()
    # Both rays start a little behind the foot, since a surface that runs through the foot would slip between them.
    back = 0.01 * reach
    up = wp.mesh_query_ray(mesh, foot[i] - back * normal[i], normal[i], reach + back)
    down = wp.mesh_query_ray(mesh, foot[i] + back * normal[i], -normal[i], reach + back)
    h = float(wp.nan)
    if up.result:
        h = up.t - back
    if down.result and (not up.result or wp.abs(down.t - back) < wp.abs(h)):
        h = back - down.t
    height[i] = h


def height_above(
    foot: np.ndarray, normal: np.ndarray, vertices: np.ndarray, faces: np.ndarray, reach: float, device: str
) -> np.ndarray:
    """Return the relief (M,) of a mesh above base points: where the normal's line meets it within ``reach``, else NaN.

    Parameters
    ----------
    foot, normal : (M, 3) arrays
        Base points and unit normals.
    vertices, faces : (N, 3), (F, 3) arrays
        The mesh, in the same coordinates; they are moved to its centre before single precision is used.
    reach : float
        How far to look on either side, in the same unit.
    device : str
        From `choose_device`.
    """
    center = vertices.mean(axis=0)
    mesh = build_mesh(upload(vertices - center, wp.vec3, device), faces)
    height = wp.empty(len(foot), dtype=wp.float32, device=device)
    launch(
        height_above_kernel,
        len(foot),
        inputs=[upload(foot - center, wp.vec3, device), upload(normal, wp.vec3, device), mesh.id, float(reach)],
        outputs=[height],
        device=device,
    )
    return height.numpy().astype(np.float64)
