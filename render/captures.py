"""Simulated captures of a height field from straight above under many distant lights, to make ground truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from intaglio.render.arguments import checked, instance, number, real_array, shaped
from intaglio.render.relightable import orthographic_sensor, textured_mesh
from intaglio.render.variants import mitsuba
from intaglio.render.views import distant_light

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Gloss:
    """Coat of rough plastic over the matte colour.

    Parameters
    ----------
    alpha : float, optional
        Roughness of the GGX distribution, from 0.01 (polished) to 1. Default 0.2, a satin finish.
    ior : float, optional
        Index of refraction of the coat, over 1. Default 1.5, that of most plastics and varnishes.

    References
    ----------
    Walter, Marschner, Li & Torrance, "Microfacet Models for Refraction through Rough Surfaces", Eurographics Symposium on
    Rendering 2007: the GGX distribution.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import Gloss, photometric_capture
    >>> flat, grey, light = np.zeros((3, 3)), np.full((2, 2), 0.5), [[0, 0, 1]]
    >>> matte = photometric_capture(flat, grey, light, samples=4)
    >>> glossy = photometric_capture(flat, grey, light, gloss=Gloss(alpha=0.1), samples=4)
    >>> bool(glossy.mean() > matte.mean())
    True
    """

    alpha: float = 0.2
    ior: float = 1.5

    def __post_init__(self) -> None:
        number(0.01, 1)("alpha", self.alpha, {})
        number(1, 100, open_ends=True)("ior", self.ior, {})


@checked(gloss=instance("Gloss"))
def photometric_capture(
    height: np.ndarray,
    albedo: np.ndarray,
    lights: np.ndarray,
    *,
    size: tuple[int, int] | None = None,
    gloss: Gloss | None = None,
    shadows: bool = True,
    bounces: int = 0,
    samples: int = 16,
    seed: int = 0,
    progress: Progress | None = None,
) -> np.ndarray:
    """Render a height field under each of several lights, as a displaced mesh.

    The mesh has a vertex per height and is seen from straight above without perspective; relief shadows and occludes itself,
    which a bump map would not.

    Parameters
    ----------
    height : (h, w) array
        Heights towards the camera at the vertices of the mesh, in units of their distance; row 0 is the top.
    albedo : (H', W'), (H', W', 1) or (H', W', 3) array
        Linear reflectance in [0, 1] of any resolution, stretched over the mesh.
    lights : (K, 3) array
        Vectors towards the lights, of any length; x right, y up, z to the camera. Each light has an irradiance of π: a white,
        matte, level surface lit from straight above has the value 1.
    size : (int, int), optional
        Rows and columns of the images; pixels must be square. Default None: a pixel per cell of the mesh, (h − 1, w − 1).
    gloss : Gloss, optional
        Coat over the matte colour. Default None: matte.
    shadows : bool, optional
        Let relief cast shadows on itself. Default True.
    bounces : int, optional
        Number of interreflections that are followed, which need ``shadows``. Default 0: light from the source alone.
    samples : int, optional
        Paths per pixel, spread over it. Default 16.
    seed : int, optional
        Seed of the paths: the same seed gives the same images. Default 0.
    progress : callable, optional
        Called as ``progress(done, total)`` after every image. Default None.

    Returns
    -------
    (K, H, W, 3) float32 array
        Linear values without a ceiling; row 0 is the top.

    Raises
    ------
    ValueError
        For shapes that don't fit, heights or reflectances that are not finite, reflectances outside [0, 1], a light from
        below, images whose pixels are not square, or bounces without shadows.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import photometric_capture
    >>> level, grey = np.zeros((5, 9)), np.full((4, 8), 0.5)
    >>> images = photometric_capture(level, grey, lights=[[0, 0, 1], [0, 0.6, 0.8]], samples=4)
    >>> images.shape
    (2, 4, 8, 3)
    >>> images[:, 2, 4, 0].round(2)
    array([0.5, 0.4], dtype=float32)
    """
    height, albedo, lights = _checked(height, albedo, lights, shadows, bounces)
    mi = mitsuba()
    rows, columns = height.shape
    depth, width = (rows - 1, columns - 1) if size is None else size
    if abs((columns - 1) / width - (rows - 1) / depth) > 1e-6 * (columns - 1) / width:
        raise ValueError(
            f"size and height don't fit: pixels are not square in images of {depth} rows and {width} columns of a mesh of "
            f"{rows - 1} x {columns - 1} cells"
        )
    mesh = textured_mesh(*height_mesh(height), _material(albedo, gloss))
    reach = float(np.ptp(height)) + 2 * max(rows, columns)
    sensor_settings = orthographic_sensor((depth, width), (columns - 1) / width, float(height.max()) + reach, jitter=True)
    images = np.empty((len(lights), depth, width, 3), np.float32)
    for k, light in enumerate(lights):
        scene: dict[str, Any] = {"type": "scene", "mesh": mesh}
        if shadows:
            direct = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0}
            scene["integrator"] = direct if bounces == 0 else {"type": "path", "max_depth": bounces + 2}
            scene["light"] = distant_light(light, np.pi)
            integrator = None
        else:
            integrator = _unshadowed(mi.variant())(mi.Properties(), light)
        loaded = mi.load_dict(scene)
        options = {"sensor": mi.load_dict(sensor_settings), "spp": samples, "seed": (seed * 65537 + k) & 0xFFFFFFFF}
        if integrator is not None:
            options["integrator"] = integrator
        images[k] = np.array(mi.render(loaded, **options), dtype=np.float32)[:, :, :3]
        if progress is not None:
            progress(k + 1, len(lights))
    return images


def height_mesh(height: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices (N, 3), faces (F, 3) and texture coordinates (N, 2) of a height field, centred on the z axis."""
    rows, columns = height.shape
    i, j = np.mgrid[:rows, :columns]
    x, y = j - (columns - 1) / 2, (rows - 1) / 2 - i
    vertices = np.stack([x, y, height], axis=-1).reshape(-1, 3)
    uv = np.stack([j / (columns - 1), 1 - i / (rows - 1)], axis=-1).reshape(-1, 2)
    corner = (i[:-1, :-1] * columns + j[:-1, :-1]).ravel()
    upper = np.stack([corner, corner + columns, corner + 1], axis=1)
    lower = np.stack([corner + 1, corner + columns, corner + columns + 1], axis=1)
    return vertices, np.concatenate([upper, lower]), uv


@checked(height=shaped(None, None))
def height_normals(height: np.ndarray) -> np.ndarray:
    """Compute the true normals of a height field at the centres of its cells.

    Parameters
    ----------
    height : (h, w) array
        Heights towards the camera at the vertices, in units of their distance; row 0 is the top.

    Returns
    -------
    (h − 1, w − 1, 3) float64 array
        Unit normals; x right, y up, z to the camera.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import height_normals
    >>> ramp = 0.75 * np.arange(3.0) * np.ones((2, 1))  # rises by 0.75 to the right
    >>> height_normals(ramp)[0, 0]
    array([-0.6, -0. ,  0.8])
    """
    p = (height[:-1, 1:] - height[:-1, :-1] + height[1:, 1:] - height[1:, :-1]) / 2
    q = (height[:-1, :-1] - height[1:, :-1] + height[:-1, 1:] - height[1:, 1:]) / 2
    normal = np.stack([-p, -q, np.ones_like(p)], axis=-1)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def _material(albedo: np.ndarray, gloss: Gloss | None) -> Any:
    mi = mitsuba()
    color = np.repeat(albedo, 3, axis=2) if albedo.shape[2] == 1 else albedo
    # Mitsuba's bitmaps have row 0 at v = 0.
    image = mi.Bitmap(np.ascontiguousarray(color[::-1], np.float32))
    texture = {"type": "bitmap", "bitmap": image, "raw": True, "wrap_mode": "clamp", "format": "variant"}
    if gloss is None:
        return mi.load_dict({"type": "diffuse", "reflectance": texture})
    return mi.load_dict(
        {
            "type": "roughplastic",
            "distribution": "ggx",
            "alpha": float(gloss.alpha),
            "int_ior": float(gloss.ior),
            "diffuse_reflectance": texture,
        }
    )


@cache
def _unshadowed(variant_name: str) -> type:
    """Return an integrator that lights every point it sees from one direction, without shadows."""
    mi = mitsuba()
    import drjit as dr

    class Unshadowed(mi.SamplingIntegrator):  # type: ignore[name-defined]
        def __init__(self, properties: Any, towards: np.ndarray | None = None) -> None:
            mi.SamplingIntegrator.__init__(self, properties)
            if towards is None:
                raise ValueError("a light is needed")
            self.towards = [float(t) for t in towards]

        def sample(
            self, scene: Any, sampler: Any, ray: Any, medium: Any = None, active: Any = True
        ) -> tuple[Any, Any, list[Any]]:
            si = scene.ray_intersect(mi.Ray3f(ray), active)
            hit = active & si.is_valid()
            wo = si.to_local(mi.Vector3f(*self.towards))
            value = si.bsdf().eval(mi.BSDFContext(), si, wo, hit) * dr.pi
            return dr.select(hit, value, mi.Color3f(0)), hit, []

    return Unshadowed


def _checked(
    height: np.ndarray, albedo: np.ndarray, lights: np.ndarray, shadows: bool, bounces: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    height, albedo = real_array("height", height), real_array("albedo", albedo)
    albedo = albedo[..., None] if albedo.ndim == 2 else albedo
    if height.ndim != 2 or min(height.shape) < 2:
        raise ValueError(f"the height field, height, must be (h, w) with at least 2 x 2 vertices, not {height.shape}")
    if albedo.ndim != 3 or albedo.shape[2] not in (1, 3) or albedo.size == 0:
        raise ValueError(f"albedo must be (H, W) or (H, W, 1 or 3), not {albedo.shape}")
    if np.abs(height).max() > 1e9:
        raise ValueError(f"height reaches {np.abs(height).max():.3g} pixels, which can't be rendered; at most 1e9")
    if albedo.min() < 0 or albedo.max() > 1:
        raise ValueError(f"albedo must lie in [0, 1], not in [{albedo.min():.3g}, {albedo.max():.3g}]")
    vectors = np.atleast_2d(real_array("lights", lights))
    if vectors.shape[1:] != (3,) or not len(vectors) or not (vectors[:, 2] > 1e-9 * np.abs(vectors).max()).all():
        raise ValueError("lights must be (K, 3) finite vectors from above, z over 0")
    if bounces < 0 or (bounces > 0 and not shadows):
        raise ValueError(f"bounces must be 0 or more, and need shadows; got {bounces}")
    vectors = vectors / np.abs(vectors).max(axis=1, keepdims=True)
    return height, albedo, vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
