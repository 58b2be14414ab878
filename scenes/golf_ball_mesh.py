"""The golf ball mesh of the data folder (its relief drawn as a normal map, not by this package), scanned from one side."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.mesh import Surface, read_surface
from intaglio.scenes.common import Result, main, real_data, run_scene
from intaglio.scenes.golf_ball import one_view

SETTINGS: dict[str, Any] = {"base": "sphere", "window": 9, "rotations": 12, "spacing": 0.5, "refine": 4}
NOISE = 0.01  # mm, a desktop scanner's


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    mesh = read_surface(real_data("meshes/golfball_derived/golfball_164k.ply"))
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    truth = Surface(vertices=mesh.vertices - np.round(middle, 6), faces=mesh.faces)
    scan = one_view(truth, pixels=160, noise=NOISE)
    return run_scene("golf_ball_mesh", "Golf ball mesh from one view", scan, args, truth=truth, **SETTINGS)


if __name__ == "__main__":
    main(run, __doc__)
