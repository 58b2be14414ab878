"""A textured mesh seen through a calibrated camera: unlit, to be compared with photographs, or under distant lights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from intaglio.render.lit_textures import color_bitmap
from intaglio.render.relightable import textured_mesh
from intaglio.render.variants import mitsuba
from intaglio.render.views import distant_light


def through_camera(
    vertices: np.ndarray,
    faces: np.ndarray,
    uv: np.ndarray,
    image: np.ndarray,
    *,
    matrix: np.ndarray,
    turn: np.ndarray,
    shift: np.ndarray,
    size: tuple[int, int],
    lights: Sequence[tuple[np.ndarray, float]] | None = None,
    ambient: float = 0.0,
    samples: int = 16,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Render a textured mesh as a pinhole camera sees it: pixel = matrix (turn X + shift).

    Parameters
    ----------
    vertices, faces, uv : (N, 3), (F, 3), (N, 2) arrays
    image : (H', W', 3) array
        Linear texture, row 0 at v = 1.
    matrix, turn, shift : (3, 3), (3, 3), (3,) arrays
        Intrinsics in pixels (centres at whole numbers), rotation and translation; x right, y down, z forwards.
    size : (rows, columns)
    lights : sequence of ((3,) array, float), optional
        Vectors towards distant lights and their irradiances, for a matte surface with cast shadows; None shows the texture's
        own values, unlit.
    ambient : float
        Radiance from all around, with lights.
    samples : int
        Paths per pixel.
    seed : int

    Returns
    -------
    image : (H, W, 3) float32 array
        Linear; 0 where nothing is seen.
    alpha : (H, W) float32 array
        Share of each pixel that shows the mesh.
    """
    mi = mitsuba()
    focal, other, skew = float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 1])
    seen = np.asarray(vertices, np.float64) @ np.asarray(turn, np.float64).T + shift
    # Mitsuba's pixels are square and its axes upright: what the camera stretches, the geometry is stretched by instead. Light
    # would fall differently on that, so lit scenes must have square pixels.
    stretched = np.stack([seen[:, 0] + skew / focal * seen[:, 1], seen[:, 1] * other / focal, seen[:, 2]], axis=1)
    if lights is not None and (abs(other / focal - 1) > 1e-6 or abs(skew) > 1e-6 * focal):
        raise ValueError("lit pictures need square pixels: equal focal lengths and no skew")
    height, width = size
    sensor = mi.load_dict(
        {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(width / (2 * focal)))),
            "fov_axis": "x",
            "principal_point_offset_x": float(0.5 - (matrix[0, 2] + 0.5) / width),
            "principal_point_offset_y": float(0.5 - (matrix[1, 2] + 0.5) / height),
            "near_clip": float(
                0.1 * stretched[:, 2].min() if stretched[:, 2].min() > 0 else 1e-4 * np.abs(stretched[:, 2]).max()
            ),
            "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 0], target=[0, 0, 1], up=[0, -1, 0]),
            "film": {
                "type": "hdrfilm",
                "width": int(width),
                "height": int(height),
                "pixel_format": "rgba",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        }
    )
    bsdf = mi.load_dict({"type": "twosided", "nested": {"type": "diffuse", "reflectance": color_bitmap(image)}})
    scene: dict[str, Any] = {"type": "scene", "mesh": textured_mesh(stretched, faces, uv, bsdf)}
    if lights is None:
        scene["integrator"] = {"type": "aov", "aovs": "value:albedo", "nested": {"type": "direct"}}
    else:
        scene["integrator"] = {"type": "path", "max_depth": 2, "hide_emitters": True}
        if ambient > 0:
            scene["ambient"] = {"type": "constant", "radiance": {"type": "rgb", "value": float(ambient)}}
        for number, (towards, irradiance) in enumerate(lights):
            there = np.asarray(turn, np.float64) @ np.asarray(towards, np.float64)
            scene[f"light{number}"] = distant_light(there / np.linalg.norm(there), irradiance)
    picture = np.array(mi.render(mi.load_dict(scene), sensor=sensor, spp=samples, seed=seed & 0xFFFFFFFF), dtype=np.float32)
    alpha = np.clip(picture[:, :, 3], 0, 1)
    return np.ascontiguousarray(picture[:, :, 4:7] if lights is None else picture[:, :, :3]), alpha
