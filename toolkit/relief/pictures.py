"""Pictures of a completion: clay under raking light, provenance, colour-coded difference."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh import SmoothBase, Surface
from intaglio.relief.fillings import list_fillings
from intaglio.render import CLAY, Light, Viewpoint, frame, view

# How far around the largest filling a picture reaches, in its own radii.
_SURROUNDINGS = 1.8
# Rakes, and keeps what it leaves in shadow readable.
_LIGHT = Light(slant=60.0, strength=3.2, fill=0.75)
FILLED_TINT = (0.25, 0.42, 0.6)


def choose_viewpoints(surface: Surface) -> list[tuple[str, Array, Array]]:
    """Return (name, direction, up) of three views: the measured part, across the seam, the filled part."""
    normal = surface.normal
    if isinstance(surface.model, SmoothBase):
        return _about_largest_filling(surface)
    seen, made = (normal[m].mean(axis=0) if m.any() else np.zeros(3) for m in (surface.measured, ~surface.measured))
    kind = surface.model.kind if surface.model is not None else "plane"
    front = _unit(seen) if np.linalg.norm(seen) > 1e-3 else _unit(normal[surface.measured][0])
    if kind == "plane":
        u = np.cross(front, np.eye(3)[np.argmin(np.abs(front))])
        up = _unit(np.cross(u, front))
        oblique = _unit(front + 0.8 * _unit(u) - 0.5 * up)
        return [
            ("from the front", front, up),
            ("obliquely", oblique, up),
            ("from the other side", _unit(front - 0.8 * _unit(u)), up),
        ]
    axis = getattr(surface.model, "axis", None)
    up = np.eye(3)[np.argmin(np.abs(front))] if axis is None else np.asarray(axis)
    up = _unit(up - (up @ front) * front)
    side = np.cross(up, front)
    back = _unit(made) if np.linalg.norm(made) > 1e-3 else -front
    if back @ front > 0.9:
        # A hole among the measured: the side views look at it from left and right.
        return [
            ("the hole", back, up),
            ("from one side", _unit(back + side), up),
            ("from the other side", _unit(back - side), up),
        ]
    lift = 0.25 * up if axis is not None else 0.15 * up
    return [("the scanned side", front + lift, up), ("across the seam", side + lift, up), ("the completed side", back + lift, up)]


def mark_pictured(surface: Surface, completed: Surface) -> Array:
    """Return which vertices (N,) of ``surface`` belong into pictures of ``completed``.

    All of them on a plane, cylinder or sphere. A hole in any other scan is small beside it, and something may stand before it:
    it is shown with its surroundings alone.
    """
    if not isinstance(completed.model, SmoothBase):
        return np.ones(len(surface.vertices), bool)
    filled = completed.vertices[largest_filling(completed)]
    center = filled.mean(axis=0)
    reach = _SURROUNDINGS * float(np.linalg.norm(filled - center, axis=1).max())
    return np.asarray(np.linalg.norm(surface.vertices - center, axis=1) <= reach)


def largest_filling(surface: Surface) -> Array:
    """Return the vertices (K,) of the filled region that has most of them; all where nothing was filled."""
    fillings = list_fillings(surface)
    return fillings[0].vertices if fillings else np.arange(len(surface.vertices))


def _about_largest_filling(surface: Surface) -> list[tuple[str, Array, Array]]:
    normal = surface.normal[largest_filling(surface)].mean(axis=0)
    front = _unit(normal) if np.linalg.norm(normal) > 1e-3 else np.array([0.0, 0.0, 1.0])
    up = np.eye(3)[1] if abs(front[1]) < 0.8 else np.eye(3)[2]
    up = _unit(up - (up @ front) * front)
    side = np.cross(up, front)
    return [
        ("the largest hole", front, up),
        ("from one side", _unit(front + 0.8 * side), up),
        ("from the other side", _unit(front - 0.8 * side + 0.4 * up), up),
    ]


def fixed_cameras(surface: Surface, directions: list[tuple[str, Array, Array]]) -> list[Viewpoint]:
    """Return the cameras that see all of ``surface`` from the directions, to look at other surfaces from there too."""
    used = np.unique(surface.faces)
    used = used[mark_pictured(surface, surface)[used]]
    return [frame(surface.vertices[used], direction, up=up, margin=1.05) for _, direction, up in directions]


def clay_pictures(
    surface: Surface, cameras: list[Viewpoint], *, size: tuple[int, int] = (480, 480), color: bool = True
) -> list[Array]:
    """Return linear renderings (H, W, 3) of ``surface``, with ``color`` in its colours if it has any, else in clay."""
    return [picture(surface, camera, colors=surface.color if color else None, size=size) for camera in cameras]


def provenance_pictures(surface: Surface, cameras: list[Viewpoint], *, size: tuple[int, int] = (480, 480)) -> list[Array]:
    """Return renderings with the measured part in clay and the filled part in blue."""
    colors = np.where(surface.measured[:, None], CLAY, FILLED_TINT)
    return [picture(surface, camera, colors=colors, size=size) for camera in cameras]


def confidence_pictures(
    surface: Surface, confidence: Array, cameras: list[Viewpoint], *, size: tuple[int, int] = (480, 480)
) -> list[Array]:
    """Return renderings with the measured part in clay and the filled part from red (0) over yellow to green (1)."""
    sure = np.clip(np.nan_to_num(confidence), 0, 1)[:, None]
    red, yellow, green = np.array([0.6, 0.05, 0.03]), np.array([0.75, 0.6, 0.06]), np.array([0.08, 0.45, 0.08])
    scale = np.where(sure < 0.5, red + 2 * sure * (yellow - red), yellow + (2 * sure - 1) * (green - yellow))
    colors = np.where(surface.measured[:, None], CLAY, scale)
    return [picture(surface, camera, colors=colors, size=size) for camera in cameras]


def difference_pictures(
    surface: Surface, difference: Array, cameras: list[Viewpoint], *, limit: float, size: tuple[int, int] = (480, 480)
) -> list[Array]:
    """Return evenly lit renderings coloured by signed difference: blue below the truth, white none, red above."""
    colors = diverging(difference / limit)
    even = Light(slant=0.0, strength=0.0, fill=float(np.pi))
    return [picture(surface, camera, colors=colors, size=size, light=even) for camera in cameras]


def picture(
    surface: Surface,
    camera: Viewpoint,
    *,
    colors: Array | None = None,
    size: tuple[int, int] = (480, 480),
    light: Light = _LIGHT,
) -> Array:
    """Return one rendering (H, W, 3), linear, of ``surface``."""
    return view(surface.vertices, surface.faces, camera=camera, colors=colors, size=size, light=light)


def diverging(value: Array) -> Array:
    """Return linear colours (N, 3) of values in [-1, 1]: blue, white, red; grey where NaN."""
    v = np.clip(np.nan_to_num(value), -1, 1)[:, None]
    blue, red, white = np.array([0.02, 0.12, 0.55]), np.array([0.6, 0.04, 0.03]), np.array([0.9, 0.9, 0.9])
    colors = np.where(v < 0, white + (-v) * (blue - white), white + v * (red - white))
    return np.where(np.isfinite(value)[:, None], colors, 0.35)


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)
