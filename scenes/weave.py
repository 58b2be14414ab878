"""A plain weave of threads that pass over each other, made by rule, extended (Duranleau & Poulin, figure 7)."""

from __future__ import annotations

import numpy as np

from intaglio.geometry import GeometryTexture, PointSet, geometry_from_points
from intaglio.scenes.common import options
from intaglio.scenes.connections import broken_threads
from intaglio.scenes.extension import run_extension
from intaglio.scenes.swatches import weave


def count(points: PointSet, spacing: float) -> list[str]:
    """Return how many threads end inside."""
    threads, broken = broken_threads(points, spacing)
    return [f"{broken} of {threads} threads broken ({100 * broken / max(threads, 1):.1f} %)"]


def swatch() -> GeometryTexture:
    """Return the swatch."""
    points, normals, _ = weave()
    low, high = points.min(axis=0), points.max(axis=0)
    return geometry_from_points(points, normals, bounds=np.array([[0.2, 0.2, low[2]], [8.8, 8.8, high[2]]]), axis="z")


def main() -> None:
    """Run the scene."""
    args = options(__doc__ or "")
    run_extension("weave", "Weave", swatch(), (17.0, 17.0), 3.9, args, count=count)


if __name__ == "__main__":
    main()
