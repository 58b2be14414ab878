"""Every completion of relief: scan, completion, smooth filling and truth from three sides, close by, and some going round.

Scenes whose data is absent say so and are left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.files import read_image, write_image
from intaglio.relief import choose_viewpoints, without_relief
from intaglio.render import frame
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
    statue_hole,
    tower,
)
from intaglio.scenes.common import Result, close_camera, main, write_turntable

SCENES: tuple[Callable[[argparse.Namespace], Any], ...] = tuple(
    module.run
    for module in (
        golf_ball, golf_ball_hole, tower, occluded_bumps, simple_patterns, bark, statue_hole,
        cut_statue, holed_scans, golf_ball_mesh, bunny_scan, face_holes, sea_vase, bird_bath,
    )
)  # fmt: skip


# Those that turn: whole objects all around, holes from side to side.
TURNED = ("golf_ball", "bark", "carved_hair")
FRAMES = 36
SWING = 0.7  # radians
QUALITY = 85


def turntable(result: Result, path: Path) -> None:
    """Write completion and truth side by side as they turn; of a hole the smooth filling first, from side to side."""
    whole = result.whole
    _, front, up = choose_viewpoints(whole)[0]
    angles = 2 * np.pi * np.arange(FRAMES) / FRAMES
    assert result.truth is not None
    if whole.model is not None and whole.model.kind == "smooth":
        shown = [without_relief(whole), whole, result.truth]
        write_turntable(shown, path, camera=close_camera(whole), axis=up, angles=SWING * np.sin(angles))
    else:
        axis = getattr(whole.model, "axis", up)
        camera = frame(whole.vertices[np.unique(whole.faces)], front, up=axis, margin=1.05)
        write_turntable([result.scan, whole, result.truth], path, camera=camera, axis=np.asarray(axis), angles=angles)


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
            name = result.page.stem
            write_image(read_image(result.picture), folder / f"{name}.jpg", quality=QUALITY)
            write_image(read_image(result.close), folder / f"{name}_close.jpg", quality=QUALITY)
            if name in TURNED:
                turntable(result, folder / f"{name}.webp")


if __name__ == "__main__":
    main(run, __doc__)
