"""Slow, obvious float64 versions of the kernels of point surfaces, fields, pairing and splines."""

from __future__ import annotations

import numpy as np


def fibonacci_sphere(count):
    """Return points, which are also the normals, spread evenly over the unit sphere, and their distance."""
    i = np.arange(count) + 0.5
    polar, turn = np.arccos(1 - 2 * i / count), np.pi * (1 + 5**0.5) * i
    points = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    return points, np.sqrt(4 * np.pi / count)


def local_plane(points, normals, x, facing, support, hermite):
    """Return average position and normal about x, or None."""
    d = points - x
    w = np.maximum(1 - (d**2).sum(axis=1) / support**2, 0) ** 4 * (normals @ facing >= 0)
    if hermite:
        w = w * (normals @ facing) ** 2
    if w.sum() == 0:
        return None
    normal = w @ normals
    normal /= np.linalg.norm(normal)
    position = w @ d / w.sum()
    if hermite:
        position = position + normal * 0.5 * (w @ (normals * d).sum(axis=1) / w.sum() - normal @ position)
    return x + position, normal


def nearest(points, normals, x, facing):
    """Return the index of the nearest point that faces."""
    distance = np.linalg.norm(points - x, axis=1)
    return int(np.argmin(np.where(normals @ facing >= 0, distance, np.inf)))


def project(points, normals, x, facing, support, hermite, steps=150):
    """Return foot and normal of x, by small steps that can't swing."""
    start = nearest(points, normals, x, facing)
    side = facing if facing.any() else normals[start]
    at = x if np.linalg.norm(points[start] - x) < 0.5 * support else points[start]
    normal = side
    for _ in range(steps):
        found = local_plane(points, normals, at, side, support, hermite)
        if found is None:
            break
        position, normal = found
        foot = x - normal * (normal @ (x - position))
        away = foot - position
        length = np.linalg.norm(away)
        if length > 0.5 * support:
            foot = position + away * 0.5 * support / length
        at = at + 0.25 * (foot - at)
    return at, normal


def signed_distance(points, normals, x, support):
    """Return distance and gradient at x."""
    foot, normal = project(points, normals, x, np.zeros(3), support, True)
    distance = np.linalg.norm(x - foot)
    return np.array([np.copysign(distance, (x - foot) @ normal), *normal])


def patch_distances(field, node, value, positions):
    """Return the squared distance of an overlap to the patch at each position."""
    out = np.empty(positions)
    for i in range(positions[0]):
        for j in range(positions[1]):
            there = field[node[:, 0] + i, node[:, 1] + j, node[:, 2]].astype(np.float64)
            out[i, j] = ((there - value) ** 2).sum()
    return out


def pair(sources, targets, costs, rounds):
    """Return the iterated greedy pairing: sources and targets are (points, normals, variation)."""
    (ps, ns, vs), (pq, nq, vq) = sources, targets
    distance = np.linalg.norm(ps[None] - pq[:, None], axis=2) / costs.unit
    turned = (1 - nq @ ns.T) / 2
    varied = (vs[None] - vq[:, None]) ** 2
    c = costs.position * distance + costs.normal * turned + costs.variation * varied
    c[(distance > costs.most_position) | (turned > costs.most_normal) | (varied > costs.most_variation)] = np.inf

    def greedy(cost):
        taken, found = set(), np.full(len(pq), -1)
        for q in range(len(pq)):
            for s in np.argsort(cost[q], kind="stable"):
                if np.isfinite(cost[q, s]) and s not in taken:
                    taken.add(s)
                    found[q] = s
                    break
        return found

    found = greedy(c)
    for _ in range(rounds):
        there = found >= 0
        move = ps[found[there]] - pq[there]
        w = np.exp(-((pq[:, None] - pq[None, there]) ** 2).sum(axis=2) / (2 * costs.radius**2))
        length = w @ np.linalg.norm(move, axis=1) / w.sum(axis=1) / costs.unit
        direction = w @ move
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        toward = (ps[None] - pq[:, None]) / costs.unit
        along = (toward * direction[:, None]).sum(axis=2) / np.maximum(distance, 1e-300)
        g = costs.length * np.abs(distance - length[:, None]) + 0.5 * costs.direction * np.where(distance > 0, 1 - along, 0)
        found = greedy(c + g)
    return found


def spline(centers, weights, linear, offset, x):
    """Return W(x)."""
    return linear @ x + offset + (weights * np.linalg.norm(x - centers, axis=1)[:, None]).sum(axis=0)
