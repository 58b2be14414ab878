"""Simulated 2.5D range scans of a mesh, to make ground truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.render.arguments import checked, numbers, real_array
from intaglio.render.variants import mitsuba, variant
from intaglio.render.views import Viewpoint, make_mesh


@dataclass(frozen=True)
class RangeImage:
    """What a range scanner measures from one place.

    Attributes
    ----------
    points : (H, W, 3) float64 array
        Measured positions in the mesh's coordinates; NaN where nothing was measured.
    depth : (H, W) float64 array
        Distances from the scanner along the rays, in the mesh's unit; NaN likewise.
    view : (3,) float64 array
        Where the scanner stood, in the mesh's coordinates.

    Raises
    ------
    ValueError
        If an array is of another type or shape.

    See Also
    --------
    intaglio.render.range_scan : Makes one.
    intaglio.surface_from_range_image : Triangulates its points.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import Viewpoint, range_scan
    >>> triangle = np.array([[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]])
    >>> scan = range_scan(triangle, np.array([[0, 1, 2]]), camera=Viewpoint((0, 0, 5), (0, 0, 0)), size=(8, 8))
    >>> scan.view
    array([0., 0., 5.])
    """

    points: np.ndarray
    depth: np.ndarray
    view: np.ndarray

    def __post_init__(self) -> None:
        points, depth = (real_array(name, getattr(self, name), finite=False) for name in ("points", "depth"))
        if points.ndim != 3 or points.shape[2] != 3:
            raise ValueError(f"points must be (H, W, 3), not {points.shape}")
        if depth.shape != points.shape[:2]:
            raise ValueError(f"depth must be {points.shape[:2]} as points are, not {depth.shape}")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "depth", depth)
        object.__setattr__(self, "view", np.array(numbers("view", self.view, 3)))


def camera_rays(camera: Viewpoint, size: tuple[int, int]) -> np.ndarray:
    """Return unit directions (H, W, 3) through the pixel centres of a camera; row 0 is the top."""
    height, width = size
    origin = np.asarray(camera.origin, np.float64)
    z = np.asarray(camera.target, np.float64) - origin
    z /= np.linalg.norm(z)
    x = np.cross(z, np.asarray(camera.up, np.float64))
    x /= np.linalg.norm(x)
    y = np.cross(x, z)
    half = np.tan(np.radians(camera.fov) / 2)
    u = (np.arange(width) + 0.5 - width / 2) / (height / 2) * half
    v = (height / 2 - np.arange(height) - 0.5) / (height / 2) * half
    rays = z + u[None, :, None] * x + v[:, None, None] * y
    return rays / np.linalg.norm(rays, axis=2, keepdims=True)


@checked()
def range_scan(
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    camera: Viewpoint,
    size: tuple[int, int] = (256, 256),
    noise: float = 0.0,
    steepest: float = 75.0,
    seed: int = 0,
) -> RangeImage:
    """Scan a mesh from one place by casting a ray through every pixel's centre.

    Parameters
    ----------
    vertices, faces : (N, 3), (F, 3) arrays
        The object: positions in any unit of length, and triangles.
    camera : Viewpoint
        Where the scanner stands, and what it sees.
    size : (int, int), optional
        Rows and columns of rays. Default (256, 256).
    noise : float, optional
        Standard deviation of Gaussian noise along the rays, in the mesh's unit. Default 0.
    steepest : float, optional
        Nothing is measured where the surface is seen at more than this many degrees from its normal, as with real scanners.
        Default 75.
    seed : int, optional
        Seed of the noise. Default 0.

    Returns
    -------
    RangeImage
        Positions and distances. Pixels on both sides of a depth discontinuity are measured; `surface_from_range_image` does
        not bridge them.

    Raises
    ------
    ValueError
        If ``noise`` is negative, or there are no vertices or faces.

    See Also
    --------
    intaglio.surface_from_range_image : Triangulate the result.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import Viewpoint, range_scan
    >>> wall = np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]])
    >>> faces = np.array([[0, 1, 2], [0, 2, 3]])
    >>> scan = range_scan(wall, faces, camera=Viewpoint((0, 0, 5), (0, 0, 0)), size=(4, 6))
    >>> scan.points.shape, np.allclose(scan.points[..., 2], 0, atol=1e-5)
    ((4, 6, 3), True)
    """
    mi = mitsuba()
    origin = np.asarray(camera.origin, np.float64)
    shift = np.asarray(camera.target, np.float64)
    rays = camera_rays(camera, size)
    flat = rays.reshape(-1, 3)
    # Coordinates are moved to the target, so that single precision keeps the relief of survey coordinates.
    scene = mi.load_dict({"type": "scene", "mesh": make_mesh(np.asarray(vertices, np.float64) - shift, faces, flat=True)})
    distance, normal = _trace(mi, scene, origin - shift, flat)
    cosine = np.abs(np.einsum("ij,ij->i", normal, flat))
    distance[cosine < np.cos(np.radians(steepest))] = np.nan
    if noise > 0:
        distance = distance + np.random.default_rng(seed).normal(0.0, noise, distance.shape)
    depth = distance.reshape(rays.shape[:2])
    return RangeImage(origin + depth[:, :, None] * rays, depth, origin)


def _trace(mi: object, scene: object, origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance (N,), NaN for a miss, and the geometric normal (N, 3) at the hit of each ray from ``origin``."""
    count = len(directions)
    if variant().vectorized:
        single = directions.astype(np.float32)
        start = np.broadcast_to(origin.astype(np.float32), single.shape)
        ray = mi.Ray3f(mi.Point3f(np.ascontiguousarray(start.T)), mi.Vector3f(np.ascontiguousarray(single.T)))  # type: ignore[attr-defined]
        hit = scene.ray_intersect(ray)  # type: ignore[attr-defined]
        distance = np.array(hit.t, dtype=np.float64)
        normal = np.array(hit.n, dtype=np.float64).reshape(3, -1).T
    else:
        distance, normal = np.full(count, np.inf), np.zeros((count, 3))
        start = mi.Point3f(*map(float, origin))  # type: ignore[attr-defined]
        for i, direction in enumerate(directions):
            hit = scene.ray_intersect(mi.Ray3f(start, mi.Vector3f(*map(float, direction))))  # type: ignore[attr-defined]
            if hit.is_valid():
                distance[i] = hit.t
                normal[i] = np.array(hit.n)
    distance[~np.isfinite(distance)] = np.nan
    return distance, normal
