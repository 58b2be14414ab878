"""A raw single-view range scan (Stanford bunny, view 000): its haunch, completed over a hole and beyond its edge.

Plane, cylinder and sphere can't carry a whole bunny; the haunch is close to a sphere, so that part is used. The merged
surface of all views, which the completion does not see, is the truth.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.mesh import Surface, read_surface
from intaglio.scenes.common import Result, cut_out, main, real_data, run_scene

CENTER = np.array([0.036, 0.086, 0.038])  # metres, on the haunch
PATCH, HOLE, REST = 0.022, 0.005, 0.016


def by_hole(scan: Surface) -> Surface:
    """Return the haunch with a round hole cut into it."""
    patch = cut_out(scan, CENTER, PATCH)
    middle = patch.vertices[np.argmin(np.linalg.norm(patch.vertices - CENTER, axis=1))]
    return patch.part(np.linalg.norm(patch.vertices - middle, axis=1) > HOLE)


def by_extent(scan: Surface) -> Surface:
    """Return the inner part of the haunch, to be continued outwards."""
    return cut_out(scan, CENTER, REST)


def run(args: argparse.Namespace) -> list[Result]:
    """Run the scene."""
    scan = read_surface(real_data("meshes/bunny_range_scans/bun000.ply"))
    truth = cut_out(read_surface(real_data("meshes/bunny_range_scans/bun_zipper.ply")), CENTER, 1.5 * PATCH)
    note = ("the truth is merged from other views: its own smoothing and alignment are part of the difference",)
    shared: dict[str, Any] = {"base": "sphere", "window": 9, "rotations": 24, "spacing": 0.00075, "refine": 4}
    hole = run_scene(
        "bunny_hole", "Bunny's haunch, a hole", by_hole(scan), args, truth=truth, extra=note, extent="holes", **shared
    )
    wide = run_scene(
        "bunny_extent",
        "Bunny's haunch, beyond its edge",
        by_extent(scan),
        args,
        truth=truth,
        extra=note,
        extent=(25.0,),
        **shared,
    )
    return [hole, wide]


if __name__ == "__main__":
    main(run, __doc__)
