"""Pictures of a textured mesh in soft light, which shows its colours as well as its shape."""

from __future__ import annotations

from typing import Any

import numpy as np

from intaglio.render.arguments import checked
from intaglio.render.relightable import textured_mesh
from intaglio.render.variants import mitsuba
from intaglio.render.views import Light, Viewpoint, distant_light, light_towards, make_sensor, over_background


def color_bitmap(image: np.ndarray) -> dict[str, Any]:
    """Return Mitsuba's description of a linear texture (H, W, 3), row 0 at v = 1, clipped to reflectances."""
    mi = mitsuba()
    # Mitsuba's bitmaps have row 0 at v = 0, and are stored in half precision unless the format says otherwise.
    bitmap = mi.Bitmap(np.ascontiguousarray(np.clip(image, 0, 1)[::-1], np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "format": "variant", "wrap_mode": "clamp"}


@checked()
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
    """Render a matte, textured mesh, half in light from all around and half in a light from the upper left.

    Parameters
    ----------
    vertices, faces, uv : (N, 3), (F, 3), (N, 2) arrays
        Positions in any unit of length, triangles, and texture coordinates; (0, 0) is the texture's lower left corner.
    image : (H', W', 3) array
        Linear reflectance, clipped to [0, 1]; row 0 is at v = 1.
    camera : Viewpoint
        Where the picture is taken from; see `frame`.
    size : (int, int), optional
        Rows and columns of the picture. Default (512, 512).
    samples : int, optional
        Paths per pixel: more give less noise. Default 16.
    background : float, optional
        Linear value where nothing is seen. Default 1, white paper.
    seed : int, optional
        Seed of the paths: the same seed gives the same picture. Default 0.

    Returns
    -------
    (H, W, 3) float32 array
        Linear Rec.709 values; row 0 is the top.

    Raises
    ------
    ValueError
        If there is not one texture coordinate per vertex, or there are no vertices or faces.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import frame, lit_texture
    >>> vertices = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    >>> faces, uv = np.array([[0, 1, 2], [0, 2, 3]]), vertices[:, :2] / 2 + 0.5
    >>> red = np.zeros((4, 4, 3)) + [0.8, 0.1, 0.1]
    >>> picture = lit_texture(vertices, faces, uv, red, camera=frame(vertices, (0, 0, 1)), size=(16, 16), samples=4)
    >>> picture.shape, bool(picture[8, 8, 0] > 4 * picture[8, 8, 1])
    ((16, 16, 3), True)
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
