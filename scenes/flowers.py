"""Flowers that don't touch, made by rule, extended (Duranleau & Poulin, figure 8)."""

from __future__ import annotations

import numpy as np

from intaglio.geometry import GeometryTexture, geometry_from_points
from intaglio.scenes.common import options
from intaglio.scenes.extension import run_extension
from intaglio.scenes.swatches import flowers


def swatch() -> GeometryTexture:
    """Return the swatch."""
    points, normals, _ = flowers()
    low, high = points.min(axis=0), points.max(axis=0)
    return geometry_from_points(points, normals, bounds=np.array([[0.3, 0.3, low[2]], [9.3, 7.8, high[2]]]), axis="z")


def main() -> None:
    """Run the scene."""
    args = options(__doc__ or "")
    run_extension("flowers", "Flowers", swatch(), (13.5, 11.5), 3.2, args, weights="flowers")


if __name__ == "__main__":
    main()
