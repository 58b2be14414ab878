"""A hole in an otherwise complete dimpled ball, filled and compared with the known surface.

After Breckon & Fisher, TPAMI 2008, figure 13.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.mesh import Surface
from intaglio.scenes.ball import RADIUS, ball
from intaglio.scenes.common import Result, main, run_scene

SETTINGS: dict[str, Any] = {"base": "sphere", "window": 7, "rotations": 12, "extent": "holes", "refine": 4}


def with_hole(surface: Surface, *, radius: float = 9.0, noise: float = 0.01, seed: int = 0) -> Surface:
    """Return the ball with noise along the normal and without what lies within ``radius`` mm of the -z pole."""
    jitter = np.random.default_rng(seed).normal(0.0, noise, len(surface.vertices))
    outward = surface.vertices / np.linalg.norm(surface.vertices, axis=1, keepdims=True)
    noisy = Surface(vertices=surface.vertices + jitter[:, None] * outward, faces=surface.faces)
    return noisy.part(np.linalg.norm(surface.vertices - (0.0, 0.0, -RADIUS), axis=1) > radius)


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    truth = ball(frequency=4, subdivisions=5)
    return run_scene("golf_ball_hole", "Hole in a golf ball", with_hole(truth), args, truth=truth, **SETTINGS)


if __name__ == "__main__":
    main(run, __doc__)
