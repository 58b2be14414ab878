"""Texture space: which triangle each texel lies in, what a photograph sees of a surface, and sampling it there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch

wp.set_module_options({"enable_backward": False})

# Side of the tiles that triangles are sorted into, in texels.
_TILE = 32
_TILE_SIDE = wp.constant(_TILE)

# Texels this far outside a triangle, in its barycentric coordinates, still belong to it where no triangle holds them, so that
# rounding leaves no gaps between neighbours.
_SLACK = wp.constant(-1.0e-5)

# Samples along the longer axis of a texel's footprint, at most.
_MOST_TAPS = wp.constant(8)


@wp.kernel
def rasterize_kernel(
    start: int,
    uv: wp.array(dtype=wp.vec2),
    faces: wp.array2d(dtype=wp.int32),
    first: wp.array(dtype=wp.int32),
    member: wp.array(dtype=wp.int32),
    tiles_across: int,
    # output
    face: wp.array2d(dtype=wp.int32),
    weight: wp.array2d(dtype=wp.vec2),
):
    """Write to each texel of one tile the first triangle that holds its centre, and the weights of its first two corners."""
    tile = start + wp.tid()
    top = (tile / tiles_across) * _TILE_SIDE
    left = (tile % tiles_across) * _TILE_SIDE
    bottom = wp.min(top + _TILE_SIDE, face.shape[0])
    right = wp.min(left + _TILE_SIDE, face.shape[1])
    for k in range(first[tile], first[tile + 1]):
        f = member[k]
        a = uv[faces[f, 0]]
        b = uv[faces[f, 1]]
        c = uv[faces[f, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area != 0.0:
            low_x = wp.max(left, int(wp.ceil(wp.min(a[0], wp.min(b[0], c[0])) - 0.5)))
            high_x = wp.min(right - 1, int(wp.floor(wp.max(a[0], wp.max(b[0], c[0])) - 0.5)) + 1)
            low_y = wp.max(top, int(wp.ceil(wp.min(a[1], wp.min(b[1], c[1])) - 0.5)))
            high_y = wp.min(bottom - 1, int(wp.floor(wp.max(a[1], wp.max(b[1], c[1])) - 0.5)) + 1)
            for y in range(low_y, high_y + 1):
                for x in range(low_x, high_x + 1):
                    px = float(x) + 0.5
                    py = float(y) + 0.5
                    wa = ((b[0] - px) * (c[1] - py) - (b[1] - py) * (c[0] - px)) / area
                    wb = ((c[0] - px) * (a[1] - py) - (c[1] - py) * (a[0] - px)) / area
                    if wa >= _SLACK and wb >= _SLACK and 1.0 - wa - wb >= _SLACK and face[y, x] < 0:
                        face[y, x] = f
                        weight[y, x] = wp.vec2(wa, wb)


def rasterize(uv: np.ndarray, faces: np.ndarray, height: int, width: int, device: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangle that holds each texel's centre, (H, W) int32, -1 outside, and weights of two corners (H, W, 2).

    Parameters
    ----------
    uv : (N, 2) array
        Positions in [0, 1]^2, v up: row 0 of the texture is at v = 1.
    faces : (F, 3) int array
    height, width : int
    device : str
    """
    placed = np.stack([uv[:, 0] * width, (1 - uv[:, 1]) * height], axis=1)
    across, down = -(-width // _TILE), -(-height // _TILE)
    corner = placed[faces]
    # One texel more on each side than the triangle covers, for the slack.
    low = np.clip(np.floor((corner.min(axis=1) - 1) / _TILE), 0, (across - 1, down - 1)).astype(np.int64)
    high = np.clip(np.floor((corner.max(axis=1) + 1) / _TILE), 0, (across - 1, down - 1)).astype(np.int64)
    span = high - low + 1
    number = span[:, 0] * span[:, 1]
    member = np.repeat(np.arange(len(faces)), number)
    within = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    row, column = low[member, 1] + within // span[member, 0], low[member, 0] + within % span[member, 0]
    tile = row * across + column
    order = np.argsort(tile, kind="stable")
    first = np.searchsorted(tile[order], np.arange(across * down + 1)).astype(np.int32)
    face = wp.full((height, width), -1, dtype=wp.int32, device=device)
    weight = wp.zeros((height, width), dtype=wp.vec2, device=device)
    inputs = [
        wp.array(placed.astype(np.float32), dtype=wp.vec2, device=device),
        wp.array(np.ascontiguousarray(faces, np.int32), dtype=wp.int32, ndim=2, device=device),
        wp.array(first, dtype=wp.int32, device=device),
        wp.array(member[order].astype(np.int32), dtype=wp.int32, device=device),
        across,
    ]
    launch(rasterize_kernel, across * down, inputs, [face, weight], device=device, work=20_000)
    return face.numpy(), weight.numpy()


@wp.struct
class Pinhole:
    """A camera, in coordinates moved to the mesh's centre: pixel = K (R X + t), with radial distortion k1, k2."""

    matrix: wp.mat33
    turn: wp.mat33
    shift: wp.vec3
    center: wp.vec3
    distortion: wp.vec2
    # Squared distance from the axis, before distortion, up to which the distortion does not turn back on itself.
    reach: float


@wp.func
def project(camera: Pinhole, point: wp.vec3) -> wp.vec3:
    """Pixel (x, y) of a point, centres at whole numbers, and its depth; depth -1 where the camera cannot see it at all."""
    seen = camera.turn * point + camera.shift
    result = wp.vec3(0.0, 0.0, -1.0)
    if seen[2] > 0.0:
        x = seen[0] / seen[2]
        y = seen[1] / seen[2]
        r = x * x + y * y
        k1 = camera.distortion[0]
        k2 = camera.distortion[1]
        if r < camera.reach:
            factor = 1.0 + k1 * r + k2 * r * r
            pixel = camera.matrix * wp.vec3(x * factor, y * factor, 1.0)
            result = wp.vec3(pixel[0], pixel[1], seen[2])
    return result


@wp.kernel
def visible_kernel(
    start: int,
    points: wp.array(dtype=wp.vec3),
    mesh: wp.uint64,
    camera: Pinhole,
    width: float,
    height: float,
    clearance: float,
    # output
    pixel: wp.array(dtype=wp.vec2),
    visible: wp.array(dtype=wp.uint8),
):
    """Project points, and tell which lie in the picture with nothing between them and the camera."""
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


@wp.func
def fetch(picture: wp.array(dtype=wp.vec3), offset: int, width: int, height: int, x: int, y: int) -> wp.vec3:
    """Pixel of one level of the picture's pyramid; the border's value beyond it."""
    column = wp.min(wp.max(x, 0), width - 1)
    row = wp.min(wp.max(y, 0), height - 1)
    return picture[offset + row * width + column]


@wp.func
def bilinear(picture: wp.array(dtype=wp.vec3), levels: wp.array2d(dtype=wp.int32), level: int, x: float, y: float) -> wp.vec3:
    """Bilinear sample of one level at finest-level coordinates (x, y)."""
    scale = 1.0 / float(1 << level)
    # Pixel centres of level 0 are at whole numbers; those of a level of side 2^l average them.
    sx = (x + 0.5) * scale - 0.5
    sy = (y + 0.5) * scale - 0.5
    fx = wp.floor(sx)
    fy = wp.floor(sy)
    ax = sx - fx
    ay = sy - fy
    offset = levels[level, 0]
    w = levels[level, 1]
    h = levels[level, 2]
    ix = int(fx)
    iy = int(fy)
    upper = (1.0 - ax) * fetch(picture, offset, w, h, ix, iy) + ax * fetch(picture, offset, w, h, ix + 1, iy)
    lower = (1.0 - ax) * fetch(picture, offset, w, h, ix, iy + 1) + ax * fetch(picture, offset, w, h, ix + 1, iy + 1)
    return (1.0 - ay) * upper + ay * lower


@wp.func
def catmull_rom(t: float) -> wp.vec4:
    """Weights of four neighbours at t between the inner two (Keys 1981, a = -1/2)."""
    t2 = t * t
    t3 = t2 * t
    return wp.vec4(-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2)


@wp.func
def bicubic(picture: wp.array(dtype=wp.vec3), levels: wp.array2d(dtype=wp.int32), x: float, y: float) -> wp.vec3:
    """Bicubic sample of the finest level, not below zero."""
    fx = wp.floor(x)
    fy = wp.floor(y)
    wx = catmull_rom(x - fx)
    wy = catmull_rom(y - fy)
    total = wp.vec3(0.0, 0.0, 0.0)
    for j in range(4):
        for i in range(4):
            total += wx[i] * wy[j] * fetch(picture, 0, levels[0, 1], levels[0, 2], int(fx) - 1 + i, int(fy) - 1 + j)
    return wp.max(total, wp.vec3(0.0, 0.0, 0.0))


@wp.func
def at_level(picture: wp.array(dtype=wp.vec3), levels: wp.array2d(dtype=wp.int32), level: float, x: float, y: float) -> wp.vec3:
    """Trilinear sample between two levels; bicubic where the finest is not finer than needed."""
    result = wp.vec3(0.0, 0.0, 0.0)
    if level <= 0.0:
        result = bicubic(picture, levels, x, y)
    else:
        low = wp.min(int(wp.floor(level)), levels.shape[0] - 1)
        high = wp.min(low + 1, levels.shape[0] - 1)
        part = wp.min(level - float(low), 1.0)
        # The finest level is bicubic in mixtures too: sharpness would jump at a footprint of one pixel.
        if low == 0:
            result = (1.0 - part) * bicubic(picture, levels, x, y)
        else:
            result = (1.0 - part) * bilinear(picture, levels, low, x, y)
        if part > 0.0:
            result += part * bilinear(picture, levels, high, x, y)
    return result


@wp.kernel
def sample_points_kernel(
    start: int,
    pixel: wp.array(dtype=wp.vec2),
    spacing: wp.array(dtype=float),
    picture: wp.array(dtype=wp.vec3),
    levels: wp.array2d(dtype=wp.int32),
    # output
    color: wp.array(dtype=wp.vec3),
):
    """Sample a picture at pixels, averaged over ``spacing`` pixels."""
    i = start + wp.tid()
    color[i] = at_level(picture, levels, wp.log2(wp.max(spacing[i], 1.0)), pixel[i][0], pixel[i][1])


@wp.kernel
def sample_texels_kernel(
    start: int,
    face: wp.array2d(dtype=wp.int32),
    weight: wp.array2d(dtype=wp.vec2),
    wanted: wp.array(dtype=wp.uint8),
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    faces: wp.array2d(dtype=wp.int32),
    along_u: wp.array(dtype=wp.vec3),
    along_v: wp.array(dtype=wp.vec3),
    camera: Pinhole,
    picture: wp.array(dtype=wp.vec3),
    levels: wp.array2d(dtype=wp.int32),
    gain: wp.vec3,
    # output
    color: wp.array2d(dtype=wp.vec4),
):
    """Sample a picture over the footprint of every texel of the wanted faces: colour times gain, and <N, V> in the fourth.

    The footprint is the ellipse by which the texel's square appears in the picture: samples along its longer axis, each
    averaged over its shorter one. (Yamauchi et al., section 4.1, first case, for the weight.)
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
            # Axes of the ellipse: eigenvectors of J J^T.
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
                total += at_level(picture, levels, level, here[0] + off * step_x, here[1] + off * step_y)
            total = wp.cw_mul(total / float(taps), gain)
            result = wp.vec4(total[0], total[1], total[2], facing)
    color[y, x] = result


@dataclass(frozen=True)
class Picture:
    """A photograph's pyramid on the device: every level halves the one before, by means of 2 x 2 pixels."""

    values: wp.array
    levels: wp.array
    width: int
    height: int

    @classmethod
    def of(cls, image: np.ndarray, device: str) -> Picture:
        """Build it from (H, W, 3) linear values."""
        parts, table, offset = [], [], 0
        level = np.ascontiguousarray(image, np.float32)
        while True:
            height, width = level.shape[:2]
            parts.append(level.reshape(-1, 3))
            table.append((offset, width, height))
            offset += height * width
            if min(height, width) < 4:
                break
            even = np.pad(level, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
            level = 0.25 * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])
        values = wp.array(np.concatenate(parts), dtype=wp.vec3, device=device)
        levels = wp.array(np.array(table, np.int32), dtype=wp.int32, ndim=2, device=device)
        return cls(values, levels, image.shape[1], image.shape[0])


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
        self._points = wp.array((vertices - self._center).astype(np.float32), dtype=wp.vec3, device=device)
        self._normals = wp.array(normals.astype(np.float32), dtype=wp.vec3, device=device)
        self._faces = wp.array(np.ascontiguousarray(faces, np.int32), dtype=wp.int32, ndim=2, device=device)
        self._mesh = wp.Mesh(points=self._points, indices=self._faces.flatten())

    def pinhole(self, matrix: np.ndarray, turn: np.ndarray, shift: np.ndarray, distortion: np.ndarray, reach: float) -> Pinhole:
        """Return a camera for the kernels: pixel = matrix (turn X + shift); points further than ``reach`` are not seen."""
        camera = Pinhole()
        camera.matrix = wp.mat33(*map(float, np.asarray(matrix).reshape(-1)))
        camera.turn = wp.mat33(*map(float, np.asarray(turn).reshape(-1)))
        camera.shift = wp.vec3(*map(float, turn @ self._center + shift))
        camera.center = wp.vec3(*map(float, -turn.T @ shift - self._center))
        camera.distortion = wp.vec2(*map(float, distortion))
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
        launch(visible_kernel, count, inputs, [pixel, seen], device=self.device, work=1000)
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
            wp.array(np.ascontiguousarray(pixel, np.float32), dtype=wp.vec2, device=self.device),
            wp.array(np.ascontiguousarray(spacing, np.float32), dtype=float, device=self.device),
            picture.values,
            picture.levels,
        ]
        launch(sample_points_kernel, len(pixel), inputs, [out], device=self.device, work=100)
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
        self._face = wp.array(np.ascontiguousarray(face), dtype=wp.int32, ndim=2, device=device)
        self._weight = wp.array(np.ascontiguousarray(weight), dtype=wp.vec2, device=device)
        self._steps = [wp.array(np.ascontiguousarray(s, np.float32), dtype=wp.vec3, device=device) for s in steps]

    def sample(self, camera: Pinhole, picture: Picture, wanted: np.ndarray, gain: np.ndarray) -> np.ndarray:
        """Return colours times ``gain`` (3,), and <N, V>, of the texels of the ``wanted`` (F,) faces: (H, W, 4), else zero."""
        views = self._views
        out = wp.empty(self._face.shape, dtype=wp.vec4, device=views.device)
        inputs = [
            self._face,
            self._weight,
            wp.array(np.ascontiguousarray(wanted, np.uint8), dtype=wp.uint8, device=views.device),
            views._points,
            views._normals,
            views._faces,
            *self._steps,
            camera,
            picture.values,
            picture.levels,
            wp.vec3(*map(float, gain)),
        ]
        launch(sample_texels_kernel, self._face.shape, inputs, [out], device=views.device, work=100 * self._face.shape[1])
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
