"""A wave on a plane, at about the size and with the parameters of paper 001, figure 7: the base is known, w = 2, e = 0.1."""

from __future__ import annotations

import argparse
from typing import Any

from intaglio.scenes.common import Result, options, run_scene
from intaglio.scenes.patterns import PLANE_LENGTH, PLANE_SIDE, on_plane, plane_base, plane_wave


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    scan, truth = on_plane(plane_wave)
    extent = (0.0, PLANE_LENGTH - 1.0, 0.0, PLANE_SIDE - 1.0)
    settings: dict[str, Any] = {"base": plane_base(), "window": 2, "error": 0.1, "rotations": 1, "extent": extent}
    return run_scene("plane_wave", "A wave on a plane", scan, args, truth=truth, **settings)


if __name__ == "__main__":
    run(options(__doc__ or ""))
