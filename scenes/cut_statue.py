"""A hole cut into a watertight statue: relief over a smooth base beside the truth and a smooth filling."""

from __future__ import annotations

import argparse

import numpy as np

from intaglio.mesh import Surface, read_surface
from intaglio.relief import without_relief
from intaglio.scenes.common import Result, main, real_data, run_scene
from intaglio.scenes.holed_scans import relief_energy, smooth_pictures

# Where the hole is cut, as shares of the statue's bounds, and its radius as a share of the diagonal.
PLACE, RADIUS = (0.5, 1.0, 0.2), 0.05


def with_hole(whole: Surface) -> Surface:
    """Return the statue without what lies within the radius of the surface point nearest to the place."""
    low, high = whole.vertices.min(axis=0), whole.vertices.max(axis=0)
    center = whole.vertices[np.argmin(np.linalg.norm(whole.vertices - (low + PLACE * (high - low)), axis=1))]
    return whole.part(np.linalg.norm(whole.vertices - center, axis=1) > RADIUS * np.linalg.norm(high - low))


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    truth = read_surface(real_data("meshes/nefertiti_50k/nefertiti.obj"))
    result = run_scene(
        "cut_statue", "A hole cut into a statue", with_hole(truth), args,
        truth=truth, base="smooth", refine=3, more=smooth_pictures,
    )  # fmt: skip
    own, smooth = (relief_energy(s) for s in (result.whole, without_relief(result.whole)))
    print(f"  roughness of the filling / of what surrounds it: {own:.2f}; filled smoothly only: {smooth:.2f}")
    return result


if __name__ == "__main__":
    main(run, __doc__)
