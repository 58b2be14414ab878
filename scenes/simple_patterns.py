"""Bumps and a wave on a cylinder, a wave on a plane, at about the sizes and with the parameters of Breckon & Fisher's figure 7.

The base is known, w = 2, e = 0.1.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from intaglio.mesh import Surface
from intaglio.scenes.common import Result, main, run_scene
from intaglio.scenes.patterns import (
    PLANE_LENGTH,
    PLANE_SIDE,
    bumps,
    cylinder_base,
    on_cylinder,
    on_plane,
    plane_base,
    plane_wave,
    wave,
)

# Title, what makes scan and truth, and the settings of their own.
PATTERNS: dict[str, tuple[str, Callable[[], tuple[Surface, Surface]], dict[str, Any]]] = {
    "cylinder_bumps": ("Bumps on a cylinder", lambda: on_cylinder(bumps), {"base": cylinder_base()}),
    "cylinder_wave": ("A wave on a cylinder", lambda: on_cylinder(wave), {"base": cylinder_base()}),
    "plane_wave": (
        "A wave on a plane",
        lambda: on_plane(plane_wave),
        {"base": plane_base(), "extent": (0.0, PLANE_LENGTH - 1.0, 0.0, PLANE_SIDE - 1.0)},
    ),
}
SETTINGS: dict[str, Any] = {"window": 2, "error": 0.1, "rotations": 1}


def run(args: argparse.Namespace, *, names: tuple[str, ...] = tuple(PATTERNS)) -> list[Result]:
    """Run the scenes of these names."""
    results = []
    for name in names:
        title, make, own = PATTERNS[name]
        scan, truth = make()
        results.append(run_scene(name, title, scan, args, truth=truth, **SETTINGS, **own))
    return results


if __name__ == "__main__":
    main(run, __doc__, PATTERNS)
