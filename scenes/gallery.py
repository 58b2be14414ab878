"""Every completion of relief, as small pictures side by side: scan, completion, smooth filling and truth, each from three sides.

Scenes whose data is absent say so and are left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np

from intaglio.files import read_image, write_image
from intaglio.scenes import (
    bark,
    bird_bath,
    bunny_scan,
    cut_statue,
    face_holes,
    golf_ball,
    golf_ball_hole,
    golf_ball_mesh,
    holed_scans,
    occluded_bumps,
    sea_vase,
    simple_patterns,
    tower,
)
from intaglio.scenes.common import Result, main

Array = np.ndarray

SCENES: tuple[Callable[[argparse.Namespace], Any], ...] = tuple(
    module.run
    for module in (
        golf_ball, golf_ball_hole, tower, occluded_bumps, simple_patterns, bark, cut_statue,
        holed_scans, golf_ball_mesh, bunny_scan, face_holes, sea_vase, bird_bath,
    )
)  # fmt: skip


def halved(picture: Array) -> Array:
    """Return a linear picture at half its size, each pixel the mean of four."""
    height, width = (n // 2 * 2 for n in picture.shape[:2])
    return np.asarray(picture[:height, :width].reshape(height // 2, 2, width // 2, 2, -1).mean(axis=(1, 3)), np.float32)


def run(args: argparse.Namespace) -> None:
    """Run the scene."""
    folder = args.output / "gallery"
    folder.mkdir(parents=True, exist_ok=True)
    for scene in SCENES:
        try:
            results = scene(args)
        except SystemExit:
            # Its data is not there; it has said so.
            continue
        for result in [results] if isinstance(results, Result) else results:
            write_image(halved(read_image(result.picture)), folder / f"{result.picture.stem}.jpg")


if __name__ == "__main__":
    main(run, __doc__)
