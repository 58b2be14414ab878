"""Pictures of a textured mesh through a calibrated camera: unlit, to compare with photographs, or under distant lights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from intaglio.render.arguments import checked, number, shaped, shown, vector
from intaglio.render.lit_textures import color_bitmap
from intaglio.render.relightable import textured_mesh
from intaglio.render.variants import mitsuba
from intaglio.render.views import distant_light


def _intrinsics(name: str, value: Any, before: dict[str, Any]) -> np.ndarray:
    matrix = shaped(3, 3)(name, value, before)
    if not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise ValueError(f"{name} must have positive focal lengths, not {matrix[0, 0]:g} and {matrix[1, 1]:g}")
    return matrix


def _lights(name: str, value: Any, before: dict[str, Any]) -> list[tuple[np.ndarray, float]]:
    if not isinstance(value, list | tuple) or not all(isinstance(one, list | tuple) and len(one) == 2 for one in value):
        raise ValueError(f"{name} must be pairs of a vector and an irradiance, not {shown(value)}")
    return [(vector(name, towards, before), number(0)(name, strength, before)) for towards, strength in value]


def _rotation(name: str, value: Any, before: dict[str, Any]) -> np.ndarray:
    turn = shaped(3, 3)(name, value, before)
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-3:
        raise ValueError(f"{name} must be a rotation, its rows of length 1 and perpendicular, not {turn.tolist()}")
    return turn


@checked(matrix=_intrinsics, turn=_rotation, shift=shaped(3), lights=_lights)
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
        Positions in any unit of length, triangles, and texture coordinates; (0, 0) is the texture's lower left corner.
    image : (H', W', 3) array
        Linear texture, clipped to [0, 1]; row 0 is at v = 1.
    matrix : (3, 3) array
        The camera's intrinsics in pixels, K; the centre of the first pixel is (0, 0).
    turn : (3, 3) array
        Rotation R from the mesh's coordinates to the camera's; there x is right, y down and z forwards.
    shift : (3,) array
        Translation t, in the mesh's unit.
    size : (int, int)
        Rows and columns of the picture.
    lights : sequence of ((3,) array, float), optional
        Vectors towards distant lights, in the mesh's coordinates, and their irradiances, for a matte surface with cast
        shadows. Default None: the texture's own values, unlit.
    ambient : float, optional
        Radiance from all around, beside lights. Default 0.
    samples : int, optional
        Paths per pixel. Default 16.
    seed : int, optional
        Seed of the paths: the same seed gives the same picture. Default 0.

    Returns
    -------
    image : (H, W, 3) float32 array
        Linear Rec.709 values; 0 where nothing is seen.
    alpha : (H, W) float32 array
        Share of each pixel that shows the mesh, from 0 to 1.

    Raises
    ------
    ValueError
        If there are lights and the camera's pixels are not square, there is not one texture coordinate per vertex, or there
        are no vertices or faces.

    Examples
    --------
    >>> import numpy as np
    >>> from intaglio.render import through_camera
    >>> vertices = np.array([[-9.0, -9, 5], [9, -9, 5], [9, 9, 5], [-9, 9, 5]])
    >>> faces, uv = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    >>> matrix = np.array([[16.0, 0, 7.5], [0, 16.0, 7.5], [0, 0, 1]])
    >>> texture = np.full((4, 4, 3), 0.25)
    >>> camera = {"matrix": matrix, "turn": np.eye(3), "shift": np.zeros(3), "size": (16, 16)}
    >>> image, alpha = through_camera(vertices, faces, uv, texture, **camera, samples=4)
    >>> image[8, 8].round(3), float(alpha.min())
    (array([0.25, 0.25, 0.25], dtype=float32), 1.0)
    """
    mi = mitsuba()
    focal, other, skew = float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 1])
    seen = np.asarray(vertices, np.float64) @ np.asarray(turn, np.float64).T + shift
    # Mitsuba's pixels are square and its axes perpendicular, so the geometry is stretched instead of the picture. That would
    # change how light falls on it, so lit scenes must have square pixels.
    stretched = np.stack([seen[:, 0] + skew / focal * seen[:, 1], seen[:, 1] * other / focal, seen[:, 2]], axis=1)
    if lights is not None and (abs(other / focal - 1) > 1e-6 or abs(skew) > 1e-6 * focal):
        raise ValueError("lit pictures need a matrix of square pixels: equal focal lengths and no skew")
    if not stretched[:, 2].any():
        raise ValueError("vertices all lie in the plane of the camera, where nothing is seen")
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
