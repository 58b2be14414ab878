"""Points of a flat texture carried to the shell over a triangle mesh: base point plus height along the interpolated normal."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload
from intaglio.kernels.meshes import build_mesh

wp.set_module_options({"enable_backward": False})


@wp.kernel
def shell_kernel(
    start: int,
    at: wp.array[wp.vec3],
    facing: wp.array[wp.vec3],
    chart: wp.uint64,
    uv: wp.array[wp.vec2],
    corner: wp.array[wp.vec3],
    normal: wp.array[wp.vec3],
    height: float,
    # output
    point: wp.array[wp.vec3],
    turned: wp.array[wp.vec3],
    face: wp.array[wp.int32],
):
    """Write X(u, v) + height h N(u, v) and its normal for each position (u, v, h), with the triangle that holds (u, v), or -1.

    The normal is carried by the cofactors of the Jacobian [X_u + height h N_u, X_v + height h N_v, height N].
    """
    i = start + wp.tid()
    p = at[i]
    found = wp.mesh_query_ray(chart, wp.vec3(p[0], p[1], 1.0), wp.vec3(0.0, 0.0, -1.0), 2.0)
    face[i] = -1
    point[i] = wp.vec3()
    turned[i] = wp.vec3()
    if found.result:
        f = found.face
        a = found.u
        b = found.v
        c = 1.0 - a - b
        base = a * corner[3 * f] + b * corner[3 * f + 1] + c * corner[3 * f + 2]
        n = wp.normalize(a * normal[3 * f] + b * normal[3 * f + 1] + c * normal[3 * f + 2])
        d1 = uv[3 * f + 1] - uv[3 * f]
        d2 = uv[3 * f + 2] - uv[3 * f]
        area = d1[0] * d2[1] - d1[1] * d2[0]
        if area != 0.0:
            rise = height * p[2]
            e1 = corner[3 * f + 1] - corner[3 * f] + rise * (normal[3 * f + 1] - normal[3 * f])
            e2 = corner[3 * f + 2] - corner[3 * f] + rise * (normal[3 * f + 2] - normal[3 * f])
            x_u = (d2[1] * e1 - d1[1] * e2) / area
            x_v = (d1[0] * e2 - d2[0] * e1) / area
            x_h = height * n
            m = facing[i]
            carried = wp.cross(x_v, x_h) * m[0] + wp.cross(x_h, x_u) * m[1] + wp.cross(x_u, x_v) * m[2]
            # Where the layout mirrors the surface, the cofactors have the opposite sign.
            if wp.dot(wp.cross(x_u, x_v), n) < 0.0:
                carried = -carried
            length = wp.length(carried)
            # Where the shell folds to nothing, no normal is left.
            if length > 0.0:
                face[i] = f
                point[i] = base + rise * n
                turned[i] = carried / length


class Shell:
    """The space over a triangle mesh with texture coordinates.

    Parameters
    ----------
    uv : (F, 3, 2) array
        Texture coordinates of the triangles' corners.
    corner, normal : (F, 3, 3) arrays
        Their positions and unit normals.
    device : str
        From `choose_device`.
    """

    def __init__(self, uv: np.ndarray, corner: np.ndarray, normal: np.ndarray, device: str) -> None:
        self.device = device
        flat = np.zeros((3 * len(uv), 3), np.float32)
        flat[:, :2] = uv.reshape(-1, 2)
        self._chart = build_mesh(self._vectors(flat), np.arange(3 * len(uv)))
        self._uv = upload(np.asarray(uv).reshape(-1, 2), wp.vec2, device)
        self._corner, self._normal = self._vectors(corner), self._vectors(normal)

    def _vectors(self, value: np.ndarray) -> wp.array:
        return upload(np.asarray(value).reshape(-1, 3), wp.vec3, self.device)

    def carry(self, at: np.ndarray, facing: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return points and normals (N, 3) float32 on the shell, and the triangle of each (N,), -1 where (u, v) is in none.

        Parameters
        ----------
        at : (N, 3) array
            u, v and height.
        facing : (N, 3) array
            Normals, in coordinates scaled as ``at``.
        height : float
            Lengths on the mesh for a unit of height, above 0.
        """
        count = len(at)
        point = wp.empty(count, dtype=wp.vec3, device=self.device)
        turned = wp.empty(count, dtype=wp.vec3, device=self.device)
        face = wp.empty(count, dtype=wp.int32, device=self.device)
        launch(
            shell_kernel,
            count,
            inputs=[
                self._vectors(at),
                self._vectors(facing),
                self._chart.id,
                self._uv,
                self._corner,
                self._normal,
                float(height),
            ],
            outputs=[point, turned, face],
            device=self.device,
            work=1000,
        )
        return point.numpy().copy(), turned.numpy().copy(), face.numpy().copy()
