"""Chain mail, made by rule, extended to three times its points (Duranleau & Poulin, figures 5 and 6)."""

from __future__ import annotations

import numpy as np

from intaglio.geometry import GeometryTexture, PointSet, geometry_from_points
from intaglio.scenes.common import options
from intaglio.scenes.connections import closed_rings
from intaglio.scenes.extension import run_extension
from intaglio.scenes.swatches import chain_mail


def count(points: PointSet, spacing: float) -> list[str]:
    """Return how many rings are closed."""
    rings, closed = closed_rings(points, spacing, 1.0)
    return [f"{closed} of {rings} rings closed ({100 * closed / max(rings, 1):.1f} %)"]


def swatch() -> GeometryTexture:
    """Return the swatch."""
    points, normals, _ = chain_mail()
    low, high = points.min(axis=0), points.max(axis=0)
    return geometry_from_points(points, normals, bounds=np.array([[1.2, 0.9, low[2]], [15.0, 8.2, high[2]]]), axis="z")


def main() -> None:
    """Run the scene."""
    args = options(__doc__ or "")
    run_extension("chain_mail", "Chain mail", swatch(), (26.0, 19.0), 5.0, args, count=count)


if __name__ == "__main__":
    main()
