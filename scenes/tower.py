"""Storeys of arched windows on a tower, with a hole in them (Breckon & Fisher, TPAMI 2008, figure 12)."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.mesh import Cylinder, Surface
from intaglio.scenes.common import Result, main, run_scene
from intaglio.scenes.patterns import grid_faces

Array = np.ndarray

RADIUS, STEP = 8.0, 0.12  # metres
BAYS, STOREYS, STOREY = 15, 6, 3.0
NOISE = 0.004
SETTINGS: dict[str, Any] = {"extent": "holes", "refine": 4, "rotations": 1, "window": 10}


def facade(angle: Array, height: Array) -> Array:
    """Depth in metres, from the wall: half columns and a cornice before it, arched windows behind it."""
    bay = 2 * np.pi * RADIUS / BAYS
    x = (angle * RADIUS) % bay - bay / 2
    z = height % STOREY
    depth = np.zeros_like(angle)
    column = np.abs(np.abs(x) - bay / 2)
    depth += np.where((column < 0.3) & (z > 0.3), np.sqrt(np.maximum(0.09 - column**2, 0)), 0)
    depth = np.where(z < 0.3, 0.3, depth)
    inside = ((np.abs(x) < 0.7) & (z > 0.9) & (z < 1.9)) | (np.hypot(x, z - 1.9) < 0.7)
    return np.where(inside & (z > 0.9), -0.45, depth)


def tower(step: float = STEP) -> tuple[Surface, Cylinder]:
    """Return the whole tower wall, sampled at about ``step`` metres, and its axis."""
    base = Cylinder(point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), radius=RADIUS)
    # Whole steps to a bay, so that bays are alike.
    columns = BAYS * round(2 * np.pi * RADIUS / BAYS / step)
    rows = round(STOREYS * STOREY / step)
    c, r = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    angle, z = 2 * np.pi * c / columns, r * step
    reach = RADIUS + facade(angle, z)
    points = np.stack([reach * np.cos(angle), reach * np.sin(angle), z], axis=-1)
    return Surface(vertices=points.reshape(-1, 3), faces=grid_faces(columns, rows, True)), base


def with_hole(whole: Surface, seed: int = 0) -> Surface:
    """Return the half of the tower about +x, with noise, and a hole two bays wide and a storey and a half high."""
    outward = whole.vertices * (1, 1, 0) / np.linalg.norm(whole.vertices[:, :2], axis=1, keepdims=True)
    jitter = np.random.default_rng(seed).normal(0, NOISE, len(whole.vertices))
    noisy = Surface(vertices=whole.vertices + jitter[:, None] * outward, faces=whole.faces)
    angle = np.arctan2(whole.vertices[:, 1], whole.vertices[:, 0])
    bay = 2 * np.pi / BAYS
    hole = (np.abs(angle - 0.35 * bay) / bay) ** 2 + ((whole.vertices[:, 2] - 8.6) / (0.75 * STOREY)) ** 2 < 1
    return noisy.part((np.abs(angle) < np.pi / 2) & ~hole)


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    truth, base = tower()
    return run_scene("tower", "Tower with windows and a hole", with_hole(truth), args, truth=truth, base=base, **SETTINGS)


if __name__ == "__main__":
    main(run, __doc__)
