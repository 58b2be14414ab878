"""Small meshes of known topology."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import Delaunay

from intaglio.mesh.surface import Surface


def half_sphere(triangles: int = 2000, height: float = 0.2, waves: float = 9) -> Surface:
    """Return a bumpy half sphere, its points evenly spread."""
    count = triangles // 2
    number = np.arange(count) + 0.5
    radius, turn = np.sqrt(number / count), np.pi * (1 + 5**0.5) * number
    flat = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    rim = 2 * np.pi * np.arange(round(2.5 * np.sqrt(count))) / round(2.5 * np.sqrt(count))
    flat = np.concatenate([flat[radius < 1 - 0.6 / np.sqrt(count)], np.stack([np.cos(rim), np.sin(rim)], axis=1)])
    faces = Delaunay(flat).simplices
    p, q = flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]]
    turned = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] < 0
    faces[turned] = faces[turned][:, ::-1]
    r = np.linalg.norm(flat, axis=1)
    z = 1 - r**2
    up = np.sqrt(np.maximum(1 - z**2, 0))
    unit = np.concatenate([flat / np.maximum(r, 1e-12)[:, None] * up[:, None], z[:, None]], axis=1)
    bumps = np.sin(waves * unit[:, 0]) * np.sin(waves * unit[:, 1] + 1) * np.cos(waves * unit[:, 2])
    return Surface(vertices=unit * (1 + height * bumps)[:, None], faces=faces)


def grid(rows: int = 9, columns: int = 9, seed: int = 3) -> Surface:
    """Return a flat, irregular rectangle of area 1, facing +z."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    move = rng.uniform(-0.3, 0.3, (2, rows, columns)) / max(rows, columns)
    move[:, [0, -1]] = 0
    move[:, :, [0, -1]] = 0
    points = np.stack([x + move[0], y + move[1], 0 * x], axis=2).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (p.reshape(-1) for p in (index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]))
    return Surface(vertices=points, faces=np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)]))


def cylinder(around: int = 24, along: int = 12, holes: tuple[int, ...] = ()) -> Surface:
    """Return an open cylinder of radius 1 and height 4, without the faces ``holes``."""
    angle = 2 * np.pi * np.arange(around) / around
    z = np.linspace(0, 4, along)
    points = np.stack([np.tile(np.cos(angle), along), np.tile(np.sin(angle), along), np.repeat(z, around)], axis=1)
    index = np.arange(around * along).reshape(along, around)
    right = np.roll(index, -1, axis=1)
    a, b, c, d = (p.reshape(-1) for p in (index[:-1], right[:-1], index[1:], right[1:]))
    faces = np.concatenate([np.stack([a, b, d], 1), np.stack([a, d, c], 1)])
    return Surface(vertices=points, faces=np.delete(faces, list(holes), axis=0))


def sphere(subdivisions: int = 3) -> Surface:
    """Return a closed sphere of radius 1."""
    made = trimesh.creation.icosphere(subdivisions=subdivisions)
    return Surface(vertices=np.array(made.vertices), faces=np.array(made.faces))


def torus() -> Surface:
    """Return a torus."""
    made = trimesh.creation.torus(1.0, 0.4, major_sections=32, minor_sections=16)
    return Surface(vertices=np.array(made.vertices), faces=np.array(made.faces))
