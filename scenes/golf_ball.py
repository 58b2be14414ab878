"""A dimpled ball scanned from one side, completed to the whole ball. ``make demo`` runs this.

The ball is made, so its back is known; the scan is simulated with a scanner's noise and its limit of grazing angles.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.mesh import Surface, adjacency, border_edges, surface_from_range_image
from intaglio.render import Viewpoint, range_scan
from intaglio.scenes.ball import RADIUS, ball
from intaglio.scenes.common import Result, largest_piece, main, run_scene

# Three quarters of the ball are unseen: there propagation with refinement keeps dimples round where pieces break them.
SETTINGS: dict[str, Any] = {"base": "sphere", "window": 8, "rotations": 12, "spacing": 0.4, "refine": 2}
NOISE = 0.004  # mm, a good scanner's at this distance between points


def one_view(surface: Surface, *, pixels: int = 250, noise: float = NOISE, seed: int = 0) -> Surface:
    """Return the scan of a ball about the origin from the +z side."""
    distance = 14 * RADIUS
    reach = 2 * np.degrees(np.arcsin(1.02 * RADIUS / distance))
    camera = Viewpoint((0.0, 0.0, distance), (0.0, 0.0, 0.0), (0.05, 1.0, 0.0), fov=float(reach))
    seen = range_scan(
        surface.vertices, surface.faces, camera=camera, size=(pixels, pixels), noise=noise, steepest=72.0, seed=seed
    )
    return without_strays(surface_from_range_image(seen.points, view=seen.view))


def without_strays(scan: Surface) -> Surface:
    """Return a scan without what hangs on its rim by a corner: vertices that touch none inside, and pieces of their own."""
    count = len(scan.vertices)
    inside = np.ones(count, bool)
    inside[border_edges(scan.faces)] = False
    return largest_piece(scan.part(inside | (adjacency(scan.faces, count) @ inside > 0)))


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    truth = ball(frequency=4, subdivisions=7)
    return run_scene("golf_ball", "Golf ball from one view", one_view(truth), args, truth=truth, **SETTINGS)


if __name__ == "__main__":
    main(run, __doc__)
