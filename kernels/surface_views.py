"""A surface seen through cameras: which points are seen, and what colour its texels have in a picture."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload
from intaglio.kernels.lenses import coefficients, distort
from intaglio.kernels.meshes import build_mesh
from intaglio.kernels.pictures import Picture, Pyramid, at_level

wp.set_module_options({"enable_backward": False})

# The most samples along the longer axis of a texel's footprint.
_MOST_TAPS = wp.constant(8)


@wp.struct
class Pinhole:
    """A camera, in coordinates moved to the mesh's centre: pixel = K (R X + t), with its lens's distortion before K."""

    matrix: wp.mat33
    turn: wp.mat33
    shift: wp.vec3
    center: wp.vec3
    family: int
    lens: coefficients
    # Squared distance from the axis, before distortion, up to which the distortion does not turn back on itself.
    reach: float


@wp.func
def project(camera: Pinhole, point: wp.vec3) -> wp.vec3:
    """Return the pixel (x, y) of a point, centres at whole numbers, and its depth; depth -1 where the camera can't see it."""
    seen = camera.turn * point + camera.shift
    result = wp.vec3(0.0, 0.0, -1.0)
    if seen[2] > 0.0:
        x = seen[0] / seen[2]
        y = seen[1] / seen[2]
        if x * x + y * y < camera.reach:
            moved = distort(camera.family, camera.lens, x, y)
            pixel = camera.matrix * wp.vec3(moved[0], moved[1], 1.0)
            result = wp.vec3(pixel[0], pixel[1], seen[2])
    return result


@wp.kernel
def visible_kernel(
    start: int,
    points: wp.array[wp.vec3],
    mesh: wp.uint64,
    camera: Pinhole,
    width: float,
    height: float,
    clearance: float,
    # output
    pixel: wp.array[wp.vec2],
    visible: wp.array[wp.uint8],
):
    """Write the pixel K (R X + t) of each point X, and 1 if it is in the picture and nothing hides X from the camera, else 0."""
    i = start + wp.tid()
    p = points[i]
    at = project(camera, p)
    pixel[i] = wp.vec2(at[0], at[1])
    result = wp.uint8(0)
    inside = at[2] > 0.0 and at[0] >= 0.0 and at[1] >= 0.0 and at[0] <= width - 1.0 and at[1] <= height - 1.0
    if inside:
        way = camera.center - p
        distance = wp.length(way)
        towards = way / distance
        query = wp.mesh_query_ray(mesh, p + clearance * towards, towards, distance - clearance)
        if not query.result:
            result = wp.uint8(1)
    visible[i] = result


@wp.kernel
def sample_points_kernel(
    start: int,
    pixel: wp.array[wp.vec2],
    spacing: wp.array[wp.float32],
    picture: Pyramid,
    # output
    color: wp.array[wp.vec3],
):
    """Write a picture's colour at each pixel, averaged over ``spacing`` pixels: its pyramid at level log2(spacing)."""
    i = start + wp.tid()
    color[i] = at_level(picture, wp.log2(wp.max(spacing[i], 1.0)), pixel[i][0], pixel[i][1])


@wp.kernel
def sample_texels_kernel(
    start: int,
    face: wp.array2d[wp.int32],
    weight: wp.array2d[wp.vec2],
    wanted: wp.array[wp.uint8],
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    faces: wp.array2d[wp.int32],
    along_u: wp.array[wp.vec3],
    along_v: wp.array[wp.vec3],
    camera: Pinhole,
    picture: Pyramid,
    gain: wp.vec3,
    # output
    color: wp.array2d[wp.vec4],
):
    """Write gain times the picture's colour over each texel's footprint, and <N, V> in the fourth, for the wanted faces.

    The footprint is the ellipse by which the texel's square appears in the picture, whose axes are the eigenvectors of J J^T.
    Samples are taken along its longer axis, each averaged over its shorter one. The weight <N, V> is the first case of
    Yamauchi et al., section 4.1.
    """
    y, x = wp.tid()
    y = start + y
    f = face[y, x]
    result = wp.vec4(0.0, 0.0, 0.0, 0.0)
    if f >= 0 and wanted[f] != wp.uint8(0):
        w = weight[y, x]
        wc = 1.0 - w[0] - w[1]
        a = faces[f, 0]
        b = faces[f, 1]
        c = faces[f, 2]
        p = w[0] * points[a] + w[1] * points[b] + wc * points[c]
        n = w[0] * normals[a] + w[1] * normals[b] + wc * normals[c]
        here = project(camera, p)
        facing = wp.dot(wp.normalize(n), wp.normalize(camera.center - p))
        beside_u = project(camera, p + along_u[f])
        beside_v = project(camera, p + along_v[f])
        if here[2] > 0.0 and beside_u[2] > 0.0 and beside_v[2] > 0.0 and facing > 0.0:
            ux = beside_u[0] - here[0]
            uy = beside_u[1] - here[1]
            vx = beside_v[0] - here[0]
            vy = beside_v[1] - here[1]
            # The ellipse's axes are the eigenvectors of J J^T, J = [[ux, vx], [uy, vy]].
            xx = ux * ux + vx * vx
            yy = uy * uy + vy * vy
            xy = ux * uy + vx * vy
            mean = 0.5 * (xx + yy)
            apart = wp.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
            major = wp.sqrt(mean + apart)
            minor = wp.sqrt(wp.max(mean - apart, 0.0))
            angle = 0.5 * wp.atan2(2.0 * xy, xx - yy)
            step_x = wp.cos(angle) * major
            step_y = wp.sin(angle) * major
            wide = wp.max(minor, wp.max(major / float(_MOST_TAPS), 1.0))
            taps = wp.min(wp.max(int(wp.ceil(major / wide - 0.01)), 1), _MOST_TAPS)
            level = wp.log2(wide)
            total = wp.vec3(0.0, 0.0, 0.0)
            for k in range(taps):
                off = (float(k) + 0.5) / float(taps) - 0.5
                total += at_level(picture, level, here[0] + off * step_x, here[1] + off * step_y)
            total = wp.cw_mul(total / float(taps), gain)
            result = wp.vec4(total[0], total[1], total[2], facing)
    color[y, x] = result


class SurfaceViews:
    """A surface, to be looked at through cameras: which points are seen, and what colour texels have.

    Parameters
    ----------
    vertices, normals : (N, 3) arrays
    faces : (F, 3) int array
    device : str
    """

    def __init__(self, vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray, device: str) -> None:
        self.device = device
        self._center = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        self._points = upload(vertices - self._center, wp.vec3, device)
        self._normals = upload(normals, wp.vec3, device)
        self._faces = upload(faces, wp.int32, device)
        self._mesh = build_mesh(self._points, faces)

    def pinhole(
        self, matrix: np.ndarray, turn: np.ndarray, shift: np.ndarray, lens: tuple[int, np.ndarray], reach: float
    ) -> Pinhole:
        """Return a camera for the kernels: pixel = matrix (turn X + shift); points further than ``reach`` are not seen.

        ``lens`` is the family of the lens and its coefficients; see `intaglio.kernels.lenses`.
        """
        camera = Pinhole()
        camera.matrix = wp.mat33(*map(float, np.asarray(matrix).reshape(-1)))
        camera.turn = wp.mat33(*map(float, np.asarray(turn).reshape(-1)))
        camera.shift = wp.vec3(*map(float, turn @ self._center + shift))
        camera.center = wp.vec3(*map(float, -turn.T @ shift - self._center))
        camera.family = int(lens[0])
        camera.lens = coefficients(*map(float, lens[1]))
        camera.reach = float(min(reach, 1e30))
        return camera

    def visible(self, camera: Pinhole, size: tuple[int, int], clearance: float) -> tuple[np.ndarray, np.ndarray]:
        """Return pixels (N, 2) of the vertices in a picture of ``size`` (width, height), and which are seen, (N,) bool.

        What lies within ``clearance`` of a vertex does not hide it.
        """
        count = len(self._points)
        pixel = wp.empty(count, dtype=wp.vec2, device=self.device)
        seen = wp.empty(count, dtype=wp.uint8, device=self.device)
        inputs = [self._points, self._mesh.id, camera, float(size[0]), float(size[1]), float(clearance)]
        launch(visible_kernel, count, inputs=inputs, outputs=[pixel, seen], device=self.device, work=1000)
        return pixel.numpy(), seen.numpy().astype(bool)

    def texels(
        self,
        face: np.ndarray,
        weight: np.ndarray,
        uv: np.ndarray,
        texture_faces: np.ndarray,
        vertices: np.ndarray,
        faces: np.ndarray,
    ) -> TexelSampler:
        """Return what samples pictures at the texels of `rasterize`."""
        return TexelSampler(self, face, weight, _texel_steps(face.shape, uv, texture_faces, vertices, faces))

    def colors(self, picture: Picture, pixel: np.ndarray, spacing: np.ndarray) -> np.ndarray:
        """Return colours (M, 3) of a picture at pixels (M, 2), averaged over ``spacing`` (M,) pixels."""
        out = wp.empty(len(pixel), dtype=wp.vec3, device=self.device)
        inputs = [
            upload(pixel, wp.vec2, self.device),
            upload(spacing, wp.float32, self.device),
            picture.pyramid,
        ]
        launch(sample_points_kernel, len(pixel), inputs=inputs, outputs=[out], device=self.device, work=100)
        return out.numpy()


class TexelSampler:
    """Samples pictures at the texels of one texture.

    Parameters
    ----------
    views : SurfaceViews
    face, weight : (H, W), (H, W, 2) arrays
        From `rasterize`.
    steps : (2, F, 3) array
        By how much a point of each face moves from one texel to the next, to the right and down.
    """

    def __init__(self, views: SurfaceViews, face: np.ndarray, weight: np.ndarray, steps: np.ndarray) -> None:
        self._views = views
        device = views.device
        self._face = upload(face, wp.int32, device)
        self._weight = upload(weight, wp.vec2, device)
        self._steps = [upload(s, wp.vec3, device) for s in steps]

    def sample(self, camera: Pinhole, picture: Picture, wanted: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Return colours times ``gain`` (3,), and <N, V>, of the texels of the ``wanted`` (F,) faces: (H, W, 4), else zero."""
        views = self._views
        out = wp.empty(self._face.shape, dtype=wp.vec4, device=views.device)
        inputs = [
            self._face,
            self._weight,
            upload(wanted, wp.uint8, views.device),
            views._points,
            views._normals,
            views._faces,
            *self._steps,
            camera,
            picture.pyramid,
            wp.vec3(*map(float, gain)),
        ]
        launch(
            sample_texels_kernel,
            self._face.shape,
            inputs=inputs,
            outputs=[out],
            device=views.device,
            work=100 * self._face.shape[1],
        )
        return out.numpy()


def _texel_steps(
    shape: tuple[int, ...], uv: np.ndarray, texture_faces: np.ndarray, vertices: np.ndarray, faces: np.ndarray
) -> np.ndarray:
    """Return by how much a point of each face moves from one texel to the next, (2, F, 3), to the right and down."""
    a, b, c = (uv[texture_faces[:, k]] * (shape[1], -shape[0]) for k in range(3))
    p, q = b - a, c - a
    det = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    safe = np.where(det == 0, np.inf, det)[:, None]
    along, beside = vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]
    right = (q[:, 1:] * along - p[:, 1:] * beside) / safe
    down = (p[:, :1] * beside - q[:, :1] * along) / safe
    return np.stack([right, down])
