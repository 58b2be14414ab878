"""A vase from photogrammetry: the nearly cylindrical band of its belly, a third of the turn unseen and completed."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.mesh import Surface, read_surface
from intaglio.scenes.common import Result, largest_piece, main, real_data, run_scene

BAND = (8.0, 72.0)  # millimetres above the middle, where the wall is nearly upright
UNSEEN = 120.0  # degrees


def band(vase: Surface) -> Surface:
    """Return the belly's band, all around."""
    z = vase.vertices[:, 2]
    return largest_piece(vase.part((z > BAND[0]) & (z < BAND[1])))


def seen(whole: Surface) -> Surface:
    """Return the band without the unseen arc."""
    middle = whole.vertices.mean(axis=0)
    angle = np.degrees(np.arctan2(whole.vertices[:, 1] - middle[1], whole.vertices[:, 0] - middle[0]))
    return largest_piece(whole.part(np.abs(angle) > UNSEEN / 2))


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    truth = band(read_surface(real_data("meshes/nikolov_seaVase/seaVase_decimated.ply")))
    settings: dict[str, Any] = {"base": "cylinder", "window": 7, "rotations": 1, "spacing": 4.0, "refine": 4}
    return run_scene("sea_vase", "Vase, a third of the turn unseen", seen(truth), args, truth=truth, **settings)


if __name__ == "__main__":
    main(run, __doc__)
