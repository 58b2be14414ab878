"""Bumps scanned from one side, so that each hides what is behind it (Breckon & Fisher, TPAMI 2008, figure 8)."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.mesh import Plane, Surface, surface_from_range_image
from intaglio.render import Viewpoint, range_scan
from intaglio.scenes.common import Result, main, run_scene
from intaglio.scenes.patterns import grid_faces

Array = np.ndarray

SIDE, PERIOD, BUMP, HEIGHT = 60.0, 6.0, 2.4, 2.0  # mm
NOISE = 0.01
SETTINGS: dict[str, Any] = {"extent": "holes", "refine": 4, "rotations": 12}
BASE = Plane(point=np.zeros(3), normal=np.array([0.0, 0.0, 1.0]), direction=np.array([1.0, 0.0, 0.0]))


def bumpy(steps: int = 400) -> Surface:
    """Return the whole square: round bumps in a triangular lattice on a flat floor."""
    x, y = np.meshgrid(*2 * [np.linspace(-SIDE / 2, SIDE / 2, steps)], indexing="ij")
    row = np.round(y / (PERIOD * np.sqrt(0.75)))
    shift = 0.5 * PERIOD * (row % 2)
    dx = x - shift - PERIOD * np.round((x - shift) / PERIOD)
    dy = y - row * PERIOD * np.sqrt(0.75)
    height = HEIGHT * np.sqrt(np.maximum(1 - (dx**2 + dy**2) / BUMP**2, 0))
    vertices = np.stack([x, y, height], axis=-1).reshape(-1, 3)
    return Surface(vertices=vertices, faces=grid_faces(steps, steps, False))


def one_side(whole: Surface, *, pixels: int = 150, noise: float = NOISE, seed: int = 0) -> Surface:
    """Return what a scanner sees from 40 degrees off the normal."""
    away = np.radians(40.0)
    camera = Viewpoint((0.0, -600 * np.sin(away), 600 * np.cos(away)), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), fov=7.0)
    seen = range_scan(whole.vertices, whole.faces, camera=camera, size=(pixels, pixels), noise=noise, steepest=80.0, seed=seed)
    return surface_from_range_image(seen.points, view=seen.view)


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    truth = bumpy()
    return run_scene("occluded_bumps", "Bumps that hide one another", one_side(truth), args, truth=truth, base=BASE, **SETTINGS)


if __name__ == "__main__":
    main(run, __doc__)
