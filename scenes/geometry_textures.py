"""Swatches of geometry textures, made by rule and real, extended (Duranleau & Poulin, figures 4 to 8, and beyond).

Chain mail, a plain weave and flowers that don't touch are made by rule; a brick wall is the height field of a photograph. Yarn
follows the centre lines of real knitted swatches: ribbing and an openwork trellis. The scanned mail is the visible side of a
real piece, points without normals.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from intaglio.files import write_image
from intaglio.geometry import (
    GeometryTexture,
    PatchFit,
    PointSet,
    assess_geometry,
    comparison_pictures,
    extend_geometry,
    geometry_from_height,
    geometry_from_points,
    read_geometry_texture,
    write_geometry_report,
)
from intaglio.progress import ProgressBar
from intaglio.scenes.common import contact_sheet, has_data, main, real_data
from intaglio.scenes.connections import broken_threads, closed_rings
from intaglio.scenes.swatches import chain_mail, flowers, weave, yarn

Array = np.ndarray


def in_box(points: Array, normals: Array, low: tuple[float, float], high: tuple[float, float]) -> GeometryTexture:
    """Return a swatch between two corners of the plane, as high as its points reach."""
    box = np.array([[*low, points[:, 2].min()], [*high, points[:, 2].max()]])
    return geometry_from_points(points, normals, bounds=box, axis="z")


def brick_swatch() -> GeometryTexture:
    """Return scikit-image's photograph of bricks: its grey values, smoothed, as heights."""
    from scipy import ndimage
    from skimage import data

    picture = data.brick().astype(np.float64) / 255
    height = ndimage.zoom(ndimage.gaussian_filter(picture, 4), 182 / 512, order=1)
    return geometry_from_height(10 * height)


def chain_mail_swatch() -> GeometryTexture:
    """Return four-in-one mail."""
    points, normals, _ = chain_mail()
    return in_box(points, normals, (1.2, 0.9), (15.0, 8.2))


def weave_swatch() -> GeometryTexture:
    """Return a plain weave of threads that pass over each other."""
    points, normals, _ = weave()
    return in_box(points, normals, (0.2, 0.2), (8.8, 8.8))


def flowers_swatch() -> GeometryTexture:
    """Return flowers that don't touch."""
    points, normals, _ = flowers()
    return in_box(points, normals, (0.3, 0.3), (9.3, 7.8))


def yarn_swatch(file: str, low: tuple[float, float], high: tuple[float, float]) -> GeometryTexture:
    """Return yarn of radius 0.085 along the lines of a file, which pass each other at about 0.18."""
    lines = np.load(real_data(file))["points"].astype(np.float64)
    first, last = np.array(low), np.array(high)
    points, normals = yarn(lines, first, last, 0.085, 0.05)
    return in_box(points, normals, tuple(first + 0.1), tuple(last - 0.1))


def scanned_mail_swatch() -> GeometryTexture:
    """Return scanned chain mail; its normals are estimated."""
    return read_geometry_texture(real_data(_MAIL_SCAN), axis="z", spacing=0.0035)


def count_threads(points: PointSet, spacing: float) -> str:
    """Return how many threads end inside."""
    threads, broken = broken_threads(points, spacing)
    return f"{broken} of {threads} threads broken ({100 * broken / max(threads, 1):.1f} %)"


def count_rings(points: PointSet, spacing: float) -> str:
    """Return how many rings are closed."""
    rings, closed = closed_rings(points, spacing, 1.0)
    return f"{closed} of {rings} rings closed ({100 * closed / max(rings, 1):.1f} %)"


@dataclass(frozen=True)
class Extension:
    """A swatch and how it is extended.

    Attributes
    ----------
    title : str
        Heading of the report.
    swatch : callable
        Makes or reads the swatch.
    size : (float, float)
        Size of the result along x and y, in the swatch's unit.
    patch : float
        Size of a patch.
    count : callable, optional
        Returns a line about points and the distance of samples; asked about swatch and result.
    settings : mapping
        Further options of `extend_geometry`.
    data : str, optional
        What the swatch needs of the data folder.
    """

    title: str
    swatch: Callable[[], GeometryTexture]
    size: tuple[float, float]
    patch: float
    count: Callable[[PointSet, float], str] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    data: str | None = None


_RIBBING = "geotex/yarn_bcc/flame_ribbing_pattern.npz"
_TRELLIS = "geotex/yarn_bcc/openwork_trellis_pattern.npz"
_MAIL_SCAN = "geotex/chainmail004_points/chainmail004_points.ply"

EXTENSIONS = {
    "brick_height": Extension("Brick height field", brick_swatch, (295.0, 295.0), 60.0),
    "chain_mail": Extension("Chain mail", chain_mail_swatch, (26.0, 19.0), 5.0, count_rings),
    "weave": Extension("Weave", weave_swatch, (17.0, 17.0), 3.9, count_threads),
    "flowers": Extension("Flowers", flowers_swatch, (13.5, 11.5), 3.2, settings={"fit": PatchFit(weights="flowers")}),
    "knit": Extension("Knitted ribbing", lambda: yarn_swatch(_RIBBING, (-0.6, -4.2), (4.9, 1.3)), (9.0, 9.0), 1.7, data=_RIBBING),
    "trellis": Extension(
        "Openwork trellis", lambda: yarn_swatch(_TRELLIS, (-6.0, -4.6), (6.0, 4.6)), (15.0, 12.0), 3.6, data=_TRELLIS
    ),
    "chain_mail_scan": Extension("Scanned chain mail", scanned_mail_swatch, (1.6, 1.6), 0.3, data=_MAIL_SCAN),
}


def extend(name: str, scene: Extension, args: argparse.Namespace) -> PointSet:
    """Extend a swatch, measure, render swatch and result from two views, and write points, picture and report."""
    texture, size = scene.swatch(), scene.size
    print(f"{scene.title}: extending {len(texture.points)} points to {size[0]:g} x {size[1]:g} …")
    start = time.perf_counter()
    with ProgressBar("laying patches") as bar:
        made = extend_geometry(
            texture, size, scene.patch, seed=args.seed, device=args.device, progress=bar.update, **scene.settings
        )
    seconds = time.perf_counter() - start
    report = assess_geometry(made, texture, device=args.device)
    extra = [f"{seconds:.2f} s, {1e6 * seconds / len(made):.1f} microseconds a point"]
    if scene.count is not None:
        extra.append(f"swatch: {scene.count(texture.points, texture.spacing)}")
        extra.append(f"result: {scene.count(made, texture.spacing)}")
    points, page, sheet = (args.output / f"{name}{suffix}" for suffix in (".ply", ".html", ".png"))
    made.write(points)
    print("rendering …")
    pictures = comparison_pictures(made, texture, device=args.device)
    write_geometry_report(page, made, texture, report, title=scene.title, extra=extra, pictures=pictures, device=args.device)
    write_image(contact_sheet({heading: list(row.values()) for heading, row in pictures.items()}, tuple(pictures)), sheet)
    for line in (*texture.notes, *made.notes, *report.lines(), *extra):
        print(f"  {line}")
    print(f"wrote {points}, {sheet} and {page}")
    return made


def run(args: argparse.Namespace, *, names: tuple[str, ...] = tuple(EXTENSIONS)) -> dict[str, PointSet]:
    """Run the scenes of these names, as far as their data is there."""
    chosen = {name: EXTENSIONS[name] for name in names}
    return {name: extend(name, scene, args) for name, scene in chosen.items() if scene.data is None or has_data(scene.data)}


if __name__ == "__main__":
    main(run, __doc__, EXTENSIONS)
