"""Pictures of a textured mesh in soft light, so that its colours show and its shape can be told."""

from __future__ import annotations

from typing import Any

import numpy as np

from intaglio.render.relightable import textured_mesh
from intaglio.render.variants import mitsuba
from intaglio.render.views import Light, Viewpoint, distant_light, light_towards, make_sensor, over_background


def color_bitmap(image: np.ndarray) -> dict[str, Any]:
    """Return Mitsuba's description of a linear texture (H, W, 3), row 0 at v = 1, clipped to reflectances."""
    mi = mitsuba()
    # Mitsuba's bitmaps have row 0 at v = 0, and are stored in half precision unless told.
    bitmap = mi.Bitmap(np.ascontiguousarray(np.clip(image, 0, 1)[::-1], np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "format": "variant", "wrap_mode": "clamp"}


def lit_texture(
    vertices: np.ndarray,
    faces: np.ndarray,
    uv: np.ndarray,
    image: np.ndarray,
    *,
    camera: Viewpoint,
    size: tuple[int, int] = (512, 512),
    samples: int = 16,
    background: float = 1.0,
    seed: int = 0,
) -> np.ndarray:
    """Render a matte, textured mesh, half in light from all around and half in a light over the eye's left shoulder.

    Parameters
    ----------
    vertices, faces, uv : (N, 3), (F, 3), (N, 2) arrays
    image : (H, W, 3) array
        Linear reflectance, row 0 at v = 1.
    camera : Viewpoint
    size : (rows, columns)
    samples : int
        Paths per pixel.
    background : float
        Linear value where nothing is seen.
    seed : int

    Returns
    -------
    (H, W, 3) float32 array
    """
    mi = mitsuba()
    shift = np.asarray(camera.target, np.float64)
    origin = np.asarray(camera.origin, np.float64) - shift
    bsdf = mi.load_dict({"type": "twosided", "nested": {"type": "diffuse", "reflectance": color_bitmap(image)}})
    towards = light_towards(origin, camera.up, Light(tilt=135.0, slant=35.0))
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2, "hide_emitters": True},
            "mesh": textured_mesh(np.asarray(vertices, np.float64) - shift, faces, uv, bsdf),
            "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 0.55}},
            "sun": distant_light(towards, 1.8),
        }
    )
    sensor = mi.load_dict(make_sensor(origin, np.zeros(3), np.asarray(camera.up), camera.fov, size))
    rendered = np.array(mi.render(scene, sensor=sensor, spp=samples, seed=seed & 0xFFFFFFFF), dtype=np.float32)
    return over_background(rendered, background)
