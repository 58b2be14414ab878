"""Slow, obvious float64 versions of what the kernels do, written from the papers."""

from __future__ import annotations

import numpy as np


def displacement_costs(value, weight, sample, exists, permutation):
    """Masked weighted mean square of every candidate, (R * S,), inf where a wanted grid point is missing."""
    wanted = weight > 0
    costs = []
    for turned in permutation:
        d = value[wanted].astype(np.float64) - sample[:, turned[wanted]]
        viable = np.asarray(exists, bool)[:, turned[wanted]].all(axis=1)
        costs.append(np.where(viable, (weight[wanted].astype(np.float64) * d * d).sum(axis=1), np.inf))
    return np.concatenate(costs)


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


def surface_costs(ground, height, textured, is_sample, target, window, sigma, candidates):
    """Eq. 2 of Breckon & Fisher, TPAMI 2008, for one target and every candidate, inf where it is not viable.

    A candidate is (foot, u, v, angle) of a sample; brute force over all vertices.
    """
    foot, position = ground.foot, ground.foot + height[:, None] * ground.normal
    near = [i for i in rings(ground.faces, target, window) if i != target and textured[i]]
    frame_t = np.stack([ground.u[target], ground.v[target], np.cross(ground.u[target], ground.v[target])])
    incident = [ground.faces[(ground.faces == i).any(axis=1)] for i in range(len(foot))]
    weight = np.exp(-0.5 * (np.linalg.norm(foot[near] - foot[target], axis=1) / sigma) ** 2)

    def cost(foot_s, u_s, v_s, angle):
        frame_s = np.stack([u_s, v_s, np.cross(u_s, v_s)])
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        move = frame_s.T @ turn @ frame_t
        on_base = foot_s + (foot[near] - foot[target]) @ move.T
        at = foot_s + (position[near] - foot[target]) @ move.T
        partners = np.argmin(((foot - on_base[:, None]) ** 2).sum(axis=2), axis=1)
        if not is_sample[partners].all():
            return np.inf
        total = 0.0
        for point, partner, g in zip(at, partners, weight, strict=True):
            faces = incident[partner]
            distances = point_triangles_squared(point, *position[faces].transpose(1, 0, 2))
            nearest = int(np.argmin(distances))
            if not is_sample[faces[nearest]].all():
                return np.inf
            total += g * distances[nearest]
        return total / weight.sum()

    return [cost(*candidate) for candidate in candidates]


def rings(faces, start, window):
    """Vertices within ``window`` edges of ``start``."""
    found = {start}
    for _ in range(window):
        touching = faces[np.isin(faces, list(found)).any(axis=1)]
        found |= set(touching.ravel().tolist())
    return sorted(found)
