"""The Utah teapot's shape, from Newell's profile curves, with texture coordinates in proportion to lengths."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

# Cubic Bézier curves (radius, height): rim and body; lid. Newell, The Utilization of Procedure Models in Digital Image
# Synthesis, 1975.
_BODY = [
    [(1.4, 2.4), (1.3375, 2.53125), (1.4375, 2.53125), (1.5, 2.4)],
    [(1.5, 2.4), (1.75, 1.875), (2.0, 1.35), (2.0, 0.9)],
    [(2.0, 0.9), (2.0, 0.45), (1.5, 0.225), (1.5, 0.15)],
    [(1.5, 0.15), (1.5, 0.075), (1.3, 0.0), (0.02, 0.0)],
]
_LID = [
    [(0.02, 3.15), (0.8, 3.15), (0.1, 2.7), (0.2, 2.55)],
    [(0.2, 2.55), (0.4, 2.4), (1.3, 2.4), (1.3, 2.25)],
]
# Curves (x, height) along the outside and the inside of handle and spout, and half widths at their ends.
_HANDLE = (
    [[(-1.5, 2.25), (-2.5, 2.25), (-3.0, 2.25), (-3.0, 1.8)], [(-3.0, 1.8), (-3.0, 1.35), (-2.65, 0.9375), (-1.9, 0.6)]],
    [[(-1.6, 2.025), (-2.3, 2.025), (-2.7, 2.025), (-2.7, 1.8)], [(-2.7, 1.8), (-2.7, 1.575), (-2.5, 1.125), (-2.0, 0.9)]],
    (0.3, 0.3),
)
_SPOUT = (
    [[(1.5, 1.425), (2.6, 1.425), (2.3, 2.1), (2.7, 2.4)]],
    [[(1.5, 0.6), (3.1, 0.825), (2.4, 2.025), (3.3, 2.4)]],
    (0.66, 0.25),
)


def _bezier(curves: list[list[tuple[float, float]]], steps: int) -> Array:
    """Return points (N, 2) along joined cubic Bézier curves."""
    t = np.linspace(0, 1, steps + 1)[:, None]
    parts = []
    for number, curve in enumerate(curves):
        a, b, c, d = (np.array(p) for p in curve)
        points = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
        parts.append(points if number == 0 else points[1:])
    return np.concatenate(parts)


def _sheet(points: Array, u: Array, v: Array) -> tuple[Array, Array, Array]:
    """Return vertices, faces and texture coordinates of a grid of points (H, W, 3); u and v are (H, W)."""
    rows, columns = points.shape[:2]
    i, j = np.mgrid[: rows - 1, : columns - 1]
    a = (i * columns + j).ravel()
    faces = np.concatenate([np.stack([a, a + columns, a + 1], 1), np.stack([a + 1, a + columns, a + columns + 1], 1)])
    return points.reshape(-1, 3), faces, np.stack([u, v], axis=-1).reshape(-1, 2)


def _turned(profile: Array, repeats: int, steps: int) -> tuple[Array, Array, Array]:
    """Return a surface of revolution about the y axis; the texture goes round ``repeats`` times, and as fast along."""
    angle = np.linspace(0, 2 * np.pi, steps + 1)
    radius, height = profile[:, :1], profile[:, 1:]
    points = np.stack([radius * np.cos(angle), np.broadcast_to(height, (len(profile), steps + 1)), -radius * np.sin(angle)], -1)
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
    around = 2 * np.pi * profile[:, 0].max()
    u = np.broadcast_to(repeats * angle / (2 * np.pi), points.shape[:2])
    v = np.broadcast_to(-(repeats * length / around)[:, None], points.shape[:2])
    return _sheet(points, u, v)


def _tube(outside: Array, inside: Array, widths: tuple[float, float], scale: float, steps: int) -> tuple[Array, Array, Array]:
    """Return a tube of elliptic section between two curves in the plane z = 0."""
    angle = np.linspace(0, 2 * np.pi, steps + 1)
    middle, half = (outside + inside) / 2, (outside - inside) / 2
    width = np.linspace(*widths, len(middle))[:, None]
    across = middle[:, None] + half[:, None] * np.cos(angle)[None, :, None]
    points = np.concatenate([across, (width * np.sin(angle))[..., None]], axis=2)
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(middle, axis=0), axis=1))])
    girth = np.pi * (np.linalg.norm(half, axis=1).mean() + width.mean())
    turns = max(1, round(girth * scale))
    u = np.broadcast_to(turns * angle / (2 * np.pi), points.shape[:2])
    v = np.broadcast_to((length * turns / girth)[:, None], points.shape[:2])
    return _sheet(points, u, v)


def teapot(repeats: int = 5, steps: int = 128) -> tuple[Array, Array, Array]:
    """Return vertices (N, 3), faces (F, 3) and texture coordinates (N, 2) of the teapot, y up.

    ``repeats`` is how often the texture goes round the belly.
    """
    body, lid = _bezier(_BODY, steps // 4), _bezier(_LID, steps // 4)
    scale = repeats / (2 * np.pi * 2.0)
    lid_repeats = max(1, round(repeats * 1.3 / 2.0))
    parts = [_turned(body, repeats, steps), _turned(lid, lid_repeats, steps)]
    for outside, inside, widths in (_HANDLE, _SPOUT):
        parts.append(_tube(_bezier(outside, steps // 3), _bezier(inside, steps // 3), widths, scale, steps // 2))
    count = np.cumsum([0, *(len(v) for v, _, _ in parts)])
    vertices = np.concatenate([v for v, _, _ in parts])
    faces = np.concatenate([f + start for (_, f, _), start in zip(parts, count, strict=False)])
    return vertices, faces, np.concatenate([uv for _, _, uv in parts])
