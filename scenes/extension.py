"""What the scenes of geometry textures share: extend a swatch, measure, render swatch and result, write all of it."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

from intaglio.files import write_image
from intaglio.geometry import (
    GeometryTexture,
    PointSet,
    assess_geometry,
    comparison_pictures,
    extend_geometry,
    write_geometry_report,
)
from intaglio.progress import ProgressBar
from intaglio.scenes.common import contact_sheet

Count = Callable[[PointSet, float], list[str]]


def run_extension(
    name: str,
    title: str,
    texture: GeometryTexture,
    size: tuple[float, float],
    patch: float,
    args: argparse.Namespace,
    *,
    count: Count | None = None,
    **settings: Any,
) -> PointSet:
    """Extend ``texture``, measure, render swatch and result from two views, and write points, picture and report.

    ``count`` returns further lines about points and the distance of samples; it is asked about swatch and result.
    """
    print(f"{title}: extending {len(texture.points)} points to {size[0]:g} x {size[1]:g} …")
    start = time.perf_counter()
    with ProgressBar("laying patches") as bar:
        made = extend_geometry(texture, size, patch, seed=args.seed, device=args.device, progress=bar.update, **settings)
    seconds = time.perf_counter() - start
    report = assess_geometry(made, texture, device=args.device)
    extra = [f"{seconds:.2f} s, {1e6 * seconds / len(made):.1f} microseconds a point"]
    if count is not None:
        extra += [f"swatch: {line}" for line in count(texture.points, texture.spacing)]
        extra += [f"result: {line}" for line in count(made, texture.spacing)]
    points, page, sheet = (args.output / f"{name}{suffix}" for suffix in (".ply", ".html", ".png"))
    made.write(points)
    print("rendering …")
    pictures = comparison_pictures(made, texture, device=args.device)
    write_geometry_report(page, made, texture, report, title=title, extra=extra, pictures=pictures, device=args.device)
    write_image(contact_sheet({heading: list(row.values()) for heading, row in pictures.items()}, tuple(pictures)), sheet)
    for line in (*texture.notes, *made.notes, *report.lines(), *extra):
        print(f"  {line}")
    print(f"wrote {points}, {sheet} and {page}")
    return made
