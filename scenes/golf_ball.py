"""A dimpled ball scanned from one side, completed to the whole ball. ``make demo`` runs this.

The ball is made, so its back is known; the scan is simulated with a scanner's noise and its limit of grazing angles.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.mesh import Surface, surface_from_range_image
from intaglio.render import Viewpoint, range_scan
from intaglio.scenes.ball import RADIUS, ball
from intaglio.scenes.common import Result, main, run_scene

SETTINGS: dict[str, Any] = {"base": "sphere", "window": 9, "rotations": 24, "spacing": 0.62, "refine": 4}
NOISE = 0.01  # mm, a good desktop scanner's


def one_view(surface: Surface, *, pixels: int = 76, noise: float = NOISE, seed: int = 0) -> Surface:
    """Return the scan of a ball about the origin from the +z side."""
    distance = 14 * RADIUS
    reach = 2 * np.degrees(np.arcsin(1.02 * RADIUS / distance))
    camera = Viewpoint((0.0, 0.0, distance), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), fov=float(reach))
    seen = range_scan(
        surface.vertices, surface.faces, camera=camera, size=(pixels, pixels), noise=noise, steepest=72.0, seed=seed
    )
    return surface_from_range_image(seen.points, view=seen.view)


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    truth = ball(frequency=4, subdivisions=7)
    return run_scene("golf_ball", "Golf ball from one view", one_view(truth), args, truth=truth, **SETTINGS)


if __name__ == "__main__":
    main(run, __doc__)
