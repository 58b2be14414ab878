"""Speed and memory of the extension of geometry textures, beside what this machine can do.

``make bench`` runs it. The rows are those of Duranleau & Poulin's Table 1, with swatches of about their sizes made by rule.
"""

from __future__ import annotations

import argparse
import resource
import time
import warnings

import numpy as np

from intaglio import GeometryTexture, IntaglioWarning, PatchFit, assess_geometry, extend_geometry
from intaglio.kernels.point_surface import PointSurface
from intaglio.scenes.connections import broken_threads, closed_rings
from intaglio.scenes.geometry_textures import brick_swatch, chain_mail_swatch, flowers_swatch, weave_swatch
from tests.benchmarks.timing import best


def machine() -> None:
    a = np.random.default_rng(0).random((3000, 3000)).astype(np.float32)
    seconds = best(lambda: a @ a, 2)
    block = np.ones(2**26, np.float32)
    copied = best(block.copy, 2)
    print(f"machine: sgemm {2 * 3000**3 / seconds / 1e9:.0f} GFLOP/s, copy {2 * block.nbytes / copied / 1e9:.1f} GB/s")


def projection(texture: GeometryTexture) -> None:
    """Print what a projection costs, and its operations: about twenty neighbours of thirty operations, in each iteration."""
    low = texture.points.points.min(axis=0)
    points, normals = texture.points.points - low, texture.points.normals
    surface = PointSurface(points, normals, 2.5 * texture.spacing)
    at = points + 0.3 * texture.spacing * np.random.default_rng(0).normal(size=points.shape)
    for along in (False, True):
        seconds = best(lambda a=along: surface.project(at, facing=normals, reach=3 * texture.spacing, along=a), 3)
        print(f"  {'along the normal' if along else 'quasi-orthogonal'}: {1e6 * seconds / len(at):.2f} microseconds a point")


def row(
    name: str, texture: GeometryTexture, size: tuple[float, float], patch: float, repeats: int, fit: PatchFit | None = None
) -> None:
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        made = extend_geometry(texture, size, patch, fit=fit, seed=1)
        seconds.append(time.perf_counter() - start)
    took = min(seconds)
    report = assess_geometry(made, texture)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"{name}: {len(texture.points)} -> {len(made)} points in {took:.2f} s, {1e6 * took / len(made):.1f} microseconds "
        f"a point, peak {peak:.2f} GiB"
    )
    for line in report.lines():
        print(f"  {line}")
    if name.startswith("weave"):
        threads, broken = broken_threads(made, texture.spacing)
        print(f"  {broken} of {threads} threads broken")
    if name.startswith("chain"):
        rings, closed = closed_rings(made, texture.spacing, 1.0)
        print(f"  {closed} of {rings} rings closed")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--large", type=float, default=3.0, help="millions of points of the largest chain mail")
    args = parser.parse_args()
    warnings.simplefilter("ignore", IntaglioWarning)
    machine()
    mail = chain_mail_swatch()
    projection(mail)
    extend_geometry(mail, 8.0, 5.0)
    row("height field", brick_swatch(), (295.0, 295.0), 60.0, 3)
    row("weave", weave_swatch(), (17.0, 17.0), 3.9, 3)
    row("flowers", flowers_swatch(), (13.5, 11.5), 3.2, 3, PatchFit(weights="flowers"))
    for millions in (0.1, 0.2, 0.4, 1.0, args.large):
        side = np.sqrt(millions * 1e6 / 0.197e6 * 26 * 19.5)
        row(f"chain mail, {millions:g} million", mail, (side, side), 5.0, 3 if millions < 0.3 else 1)


if __name__ == "__main__":
    main()
