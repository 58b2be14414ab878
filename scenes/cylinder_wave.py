"""A wave on a cylinder, at about the size and with the parameters of paper 001, figure 7: the base is known, w = 2, e = 0.1."""

from __future__ import annotations

import argparse
from typing import Any

from intaglio.scenes.common import Result, options, run_scene
from intaglio.scenes.patterns import cylinder_base, on_cylinder, wave


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    scan, truth = on_cylinder(wave)
    settings: dict[str, Any] = {"base": cylinder_base(), "window": 2, "error": 0.1, "rotations": 1}
    return run_scene("cylinder_wave", "A wave on a cylinder", scan, args, truth=truth, **settings)


if __name__ == "__main__":
    run(options(__doc__ or ""))
