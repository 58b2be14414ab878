"""Geometry textures made by rule: a plain weave, chain mail, flowers, and yarn along given lines; none of them repeats."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from intaglio.geometry import RADIUS, thin_points

Array = np.ndarray


def swept(line: Array, radius: float | Array, spacing: float, *, closed: bool = False, seed: int = 0) -> tuple[Array, Array]:
    """Return points and normals, about ``spacing`` apart, of a tube along a polyline (N, 3) of closely set points."""
    line = np.asarray(line, float)
    tangent = np.roll(line, -1, axis=0) - np.roll(line, 1, axis=0) if closed else np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    step = np.linalg.norm(np.diff(line, axis=0, append=line[:1] if closed else line[-1:]), axis=1)
    across = np.empty_like(line)
    side = np.cross(tangent[0], [0.31, 0.57, 0.76])
    for i, t in enumerate(tangent):
        side = side - t * (side @ t)
        side /= np.linalg.norm(side)
        across[i] = side
    along = np.concatenate([[0], np.cumsum(step)])[: len(line)]
    length = along[-1] + (step[-1] if closed else 0)
    rng = np.random.default_rng(seed)
    radii = np.broadcast_to(radius, len(line))
    count = int(8 * length * 2 * np.pi * radii.mean() / spacing**2)
    where, angle = rng.random(count) * length, rng.random(count) * 2 * np.pi
    index = np.minimum(np.searchsorted(along, where, side="right") - 1, len(line) - 1)
    following = (index + 1) % len(line) if closed else np.minimum(index + 1, len(line) - 1)
    part = ((where - along[index]) / np.maximum(step[index], 1e-12))[:, None]
    center = line[index] * (1 - part) + line[following] * part
    u = across[index] * (1 - part) + across[following] * part
    t = tangent[index] * (1 - part) + tangent[following] * part
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    u -= t * (u * t).sum(axis=1, keepdims=True)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    normal = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * np.cross(t, u)
    points = center + normal * radii[index][:, None]
    chosen = thin_points(points, normal, RADIUS * spacing, seed)
    return points[chosen], normal[chosen]


def _wander(at: Array, rng: np.random.Generator, amount: float, length: float) -> Array:
    """Return a smooth random function of ``at`` of about the given amount and wavelength."""
    waves = rng.uniform(0.6, 1.6, 4) * 2 * np.pi / length
    return amount * np.sin(at[:, None] * waves + rng.uniform(0, 2 * np.pi, 4)).sum(axis=1) / np.sqrt(2)


def weave(threads: int = 10, spacing: float = 0.088, seed: int = 1) -> tuple[Array, Array, Array]:
    """Return points, normals and thread number of a plain weave of ``threads`` each way, a unit apart; no two cross alike."""
    rng = np.random.default_rng(seed)
    radius, rise = 0.24, 0.3
    points: list[Array] = []
    normals: list[Array] = []
    labels: list[Array] = []
    at = np.linspace(-0.7, threads - 0.3, 40 * threads)
    for direction in range(2):
        for k in range(threads):
            lift = rise * np.cos(np.pi * (at + k)) * (1 if direction == 0 else -1)
            line = np.stack([k + _wander(at, rng, 0.045, 5.0), at, lift + _wander(at, rng, 0.012, 7.0)], axis=1)
            if direction:
                line = line[:, [1, 0, 2]]
            p, n = swept(line, radius * (1 + _wander(at, rng, 0.02, 3.0)), spacing, seed=seed + len(labels))
            points.append(p)
            normals.append(n)
            labels.append(np.full(len(p), direction * threads + k))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(labels)


def ring_line(center: Array, tilt: float, radius: float, turn: float = 0.0, count: int = 160) -> Array:
    """Return a circle (N, 3) whose plane is tilted about x by ``tilt`` and about z by ``turn``."""
    angle = np.arange(count) * 2 * np.pi / count
    circle = np.stack([np.cos(angle), np.cos(tilt) * np.sin(angle), np.sin(tilt) * np.sin(angle)], axis=1) * radius
    c, s = np.cos(turn), np.sin(turn)
    return circle @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + center


def chain_mail(columns: int = 7, rows: int = 14, spacing: float = 0.096, seed: int = 2) -> tuple[Array, Array, Array]:
    """Return points, normals and ring number of four-in-one mail: each ring hangs in two of the row above and two below."""
    rng = np.random.default_rng(seed)
    radius, wire = 1.0, 0.17
    across, along, tilt = MAIL
    points: list[Array] = []
    normals: list[Array] = []
    labels: list[Array] = []
    for row in range(rows):
        for column in range(columns):
            center = np.array([(column + 0.5 * (row % 2)) * across, row * along, 0]) + rng.normal(0, 0.02, 3)
            line = ring_line(center, (tilt if row % 2 else -tilt) + rng.normal(0, 0.025), radius, rng.normal(0, 0.03))
            p, n = swept(line, wire, spacing, closed=True, seed=seed + len(labels))
            points.append(p)
            normals.append(n)
            labels.append(np.full(len(p), len(labels)))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(labels)


# Distance of rings in a row, of rows, and the tilt of a ring, for rings of radius 1 and wire of 0.17.
MAIL = (2.5, 0.7, 0.6)


def flowers(columns: int = 7, rows: int = 7, spacing: float = 0.0535, seed: int = 3) -> tuple[Array, Array, Array]:
    """Return points, normals and flower number of flowers that don't touch: a dome and five petals each, all different."""
    rng = np.random.default_rng(seed)
    points: list[Array] = []
    normals: list[Array] = []
    labels: list[Array] = []
    for row in range(rows):
        for column in range(columns):
            center = np.array([column + 0.5 * (row % 2), 0.9 * row, 0.0]) * 1.5 + np.append(rng.normal(0, 0.05, 2), 0)
            turn, size, lift = rng.normal(0, 0.1), rng.uniform(0.94, 1.06), rng.uniform(0.14, 0.24)
            parts = [(np.array([0, 0, 0.14]), np.eye(3), np.array([0.2, 0.2, 0.18]) * size)]
            for petal in range(5):
                angle = turn + petal * 2 * np.pi / 5
                out = np.array([np.cos(angle) * np.cos(lift), np.sin(angle) * np.cos(lift), np.sin(lift)])
                side = np.array([-np.sin(angle), np.cos(angle), 0.0])
                axes = np.stack([out, side, np.cross(out, side)])
                parts.append((0.34 * size * out, axes, np.array([0.26, 0.17, 0.13]) * size))
            p, n = _union(parts, spacing, seed + len(labels))
            points.append(p + center)
            normals.append(n)
            labels.append(np.full(len(p), len(labels)))
    return np.concatenate(points), np.concatenate(normals), np.concatenate(labels)


def _union(parts: list[tuple[Array, Array, Array]], spacing: float, seed: int) -> tuple[Array, Array]:
    """Return points and normals on the outside of ellipsoids (centre, axes, half sides)."""
    rng = np.random.default_rng(seed)
    points: list[Array] = []
    normals: list[Array] = []
    for center, axes, half in parts:
        direction = rng.normal(size=(int(60 * 4 * np.pi * half.max() ** 2 / spacing**2), 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        # Directions even over the sphere are kept as often as the ellipsoid stretches area there.
        slope = direction / half
        length = np.linalg.norm(slope, axis=1)
        kept = rng.random(len(length)) * length.max() < length
        direction, slope, length = direction[kept], slope[kept], length[kept]
        points.append((direction * half) @ axes + center)
        normals.append((slope / length[:, None]) @ axes)
    found, facing = np.concatenate(points), np.concatenate(normals)
    outside = np.ones(len(found), bool)
    for center, axes, half in parts:
        outside &= (((found - center) @ axes.T / half) ** 2).sum(axis=1) > 1 - 1e-9
    found, facing = found[outside], facing[outside]
    chosen = thin_points(found, facing, RADIUS * spacing, seed)
    return found[chosen], facing[chosen]


def yarn(control: Array, low: Array, high: Array, radius: float, spacing: float) -> tuple[Array, Array]:
    """Return points and normals of yarn along control points (N, 3), where these lie in the box of the plane."""
    inside = ((control[:, :2] >= low) & (control[:, :2] <= high)).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    points: list[Array] = []
    normals: list[Array] = []
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first < 4:
            continue
        number = np.arange(first, last)
        fine = CubicSpline(number, control[first:last])(np.arange(first, last - 1 + 1e-9, 0.1))
        p, n = swept(fine, radius, spacing, seed=int(first))
        points.append(p)
        normals.append(n)
    return np.concatenate(points), np.concatenate(normals)
