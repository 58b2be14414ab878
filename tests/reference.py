"""Slow, obvious float64 versions of what the kernels do, written from the papers."""

from __future__ import annotations

import numpy as np


def displacement_costs(value, weight, sample, exists, permutation):
    """Masked weighted mean square of every candidate, (R * S,), inf where a wanted grid point is missing."""
    costs = []
    for turned in permutation:
        for y, have in zip(sample, exists, strict=True):
            wanted = weight > 0
            if not have[turned][wanted].all():
                costs.append(np.inf)
                continue
            d = value[wanted].astype(np.float64) - y[turned][wanted]
            costs.append(float((weight[wanted].astype(np.float64) * d * d).sum()))
    return np.array(costs)


def point_triangles_squared(p, a, b, c):
    """Least squared distance of p to each triangle (K,): by projection where it falls inside, else to its three sides."""
    n = cross(b - a, c - a)
    best = np.minimum(np.minimum(_segments(p, a, b), _segments(p, b, c)), _segments(p, c, a))
    area = (n * n).sum(axis=1)
    q = p - (((p - a) * n).sum(axis=1) / np.where(area > 0, area, 1))[:, None] * n
    inside = area > 0
    for s, t in ((a, b), (b, c), (c, a)):
        inside &= (cross(t - s, q - s) * n).sum(axis=1) >= 0
    return np.where(inside, np.minimum(best, ((p - q) ** 2).sum(axis=1)), best)


def cross(a, b):
    """Cross products of vectors (K, 3); NumPy's own takes five times as long for a few."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def _segments(p, a, b):
    t = np.clip(((p - a) * (b - a)).sum(axis=1) / np.maximum(((b - a) ** 2).sum(axis=1), 1e-300), 0, 1)
    return ((p - a - t[:, None] * (b - a)) ** 2).sum(axis=1)


def surface_cost(ground, height, textured, is_sample, target, window, sigma, foot_s, u_s, v_s, angle):
    """Eq. 2 of Breckon & Fisher, TPAMI 2008, for one target and candidate, inf where it is not viable.

    Brute force over all vertices.
    """
    foot, position = ground.foot, ground.foot + height[:, None] * ground.normal
    ring = rings(ground.faces, target, window)
    near = [i for i in ring if i != target and textured[i]]
    frame_t = np.stack([ground.u[target], ground.v[target], np.cross(ground.u[target], ground.v[target])])
    frame_s = np.stack([u_s, v_s, np.cross(u_s, v_s)])
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    total = norm = 0.0
    for i in near:
        g = np.exp(-0.5 * (np.linalg.norm(foot[i] - foot[target]) / sigma) ** 2)
        on_base = foot_s + frame_s.T @ (turn @ (frame_t @ (foot[i] - foot[target])))
        at = foot_s + frame_s.T @ (turn @ (frame_t @ (position[i] - foot[target])))
        partner = int(np.argmin(((foot - on_base) ** 2).sum(axis=1)))
        if not is_sample[partner]:
            return np.inf
        incident = ground.faces[(ground.faces == partner).any(axis=1)]
        distances = point_triangles_squared(at, *position[incident].transpose(1, 0, 2))
        nearest = int(np.argmin(distances))
        if not is_sample[incident[nearest]].all():
            return np.inf
        total += g * distances[nearest]
        norm += g
    return total / norm


def rings(faces, start, window):
    """Vertices within ``window`` edges of ``start``."""
    found = {start}
    for _ in range(window):
        touching = faces[np.isin(faces, list(found)).any(axis=1)]
        found |= set(touching.ravel().tolist())
    return sorted(found)
