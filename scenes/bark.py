"""A tree trunk seen from one side: real bark, relief and colour, on a cylinder (Breckon & Fisher, 3DIM 2005, section 6).

The material repeats without a seam, so that it closes around the trunk, and the truth of the unseen half is known.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.files import read_image
from intaglio.mesh import Cylinder, Surface
from intaglio.scenes.common import Result, main, real_data, run_scene
from intaglio.scenes.patterns import grid_faces

Array = np.ndarray

RADIUS, DEPTH = 60.0, 9.0  # mm
COLUMNS, ROWS = 288, 160
SETTINGS: dict[str, Any] = {"base": "cylinder", "refine": 4, "color_weight": 0.5, "rotations": 1}


def material(name: str) -> Array:
    """Return a picture of the bark (288, 288, C), each pixel the mean of those of the file it stands for."""
    image = read_image(real_data(f"materials/ambientcg_Bark014/{name}.jpg"))
    image = image[:, :, None] if image.ndim == 2 else image
    for axis in (0, 1):
        edges = np.linspace(0, image.shape[axis], COLUMNS + 1).round().astype(int)
        width = np.diff(edges).reshape([-1 if a == axis else 1 for a in range(3)])
        image = np.add.reduceat(image, edges[:-1], axis=axis) / width
    return image


def trunk() -> Surface:
    """Return the whole trunk: the bark's columns run up it."""
    from intaglio.kernels.transfer import encode_srgb

    color = material("albedo")[:ROWS, :, :3]
    # Heights are stored as they are: decoding them as display values would bend them.
    height = encode_srgb(material("displacement"))[:ROWS, :, 0]
    # The base lies at the bottom of the furrows, as a trunk lies under its bark.
    height = DEPTH * (height - height.min()) / np.ptp(height)
    step = 2 * np.pi * RADIUS / COLUMNS
    c, r = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS), indexing="ij")
    angle = 2 * np.pi * c / COLUMNS
    reach = RADIUS + height[r, c]
    points = np.stack([reach * np.cos(angle), reach * np.sin(angle), (ROWS - 1 - r) * step], axis=-1)
    faces = grid_faces(COLUMNS, ROWS, True)[:, ::-1]
    return Surface(vertices=points.reshape(-1, 3), faces=np.ascontiguousarray(faces), color=color[r, c].reshape(-1, 3))


def seen(whole: Surface) -> Surface:
    """Return the half of the trunk that is seen."""
    return whole.part(np.repeat(np.arange(COLUMNS) < COLUMNS // 2, ROWS))


def run(args: argparse.Namespace) -> Result:
    """Run the scene."""
    truth = trunk()
    base = Cylinder(point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), radius=RADIUS)
    return run_scene("bark", "Bark, relief and colour", seen(truth), args, truth=truth, **{**SETTINGS, "base": base})


if __name__ == "__main__":
    main(run, __doc__)
