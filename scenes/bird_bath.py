"""A bird bath from photogrammetry: the outside of its bowl, close to a sphere, with a hole cut and filled again."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.mesh import Sphere, Surface, read_surface, vertex_normals
from intaglio.relief import fit_base
from intaglio.scenes.common import Result, largest_piece, main, real_data, run_scene

HOLE = 28.0  # millimetres


def bowl(bath: Surface) -> Surface:
    """Return the part of the outside that lies within 14 mm of the sphere fitted to all that looks down."""
    normal = vertex_normals(bath.vertices, bath.faces)
    base = fit_base(bath.vertices[normal[:, 2] < -0.2], ("sphere",))
    assert isinstance(base, Sphere)
    outward = np.einsum("ij,ij->i", normal, base.foot(bath.vertices)[1])
    return largest_piece(bath.part((np.abs(base.distance(bath.vertices)) < 14) & (outward > 0.15)))


def with_hole(whole: Surface) -> Surface:
    """Return the bowl without what lies within HOLE of a point on its side."""
    side = whole.vertices[np.argmax(whole.vertices[:, 0] - 0.7 * np.abs(whole.vertices[:, 2] - 40))]
    return largest_piece(whole.part(np.linalg.norm(whole.vertices - side, axis=1) > HOLE))


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    truth = bowl(read_surface(real_data("meshes/nikolov_birdBath/birdBath_decimated.ply")))
    settings: dict[str, Any] = {"base": "sphere", "extent": "holes", "window": 7, "rotations": 12, "spacing": 3.0, "refine": 4}
    return run_scene("bird_bath", "Bird bath, a hole in the bowl", with_hole(truth), args, truth=truth, **settings)


if __name__ == "__main__":
    main(run, __doc__)
