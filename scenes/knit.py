"""Knitted ribbing: yarn along the centre lines of a real knitted swatch, extended."""

from __future__ import annotations

import numpy as np

from intaglio.geometry import GeometryTexture, geometry_from_points
from intaglio.scenes.common import options, real_data
from intaglio.scenes.extension import run_extension
from intaglio.scenes.swatches import yarn


def swatch() -> GeometryTexture:
    """Return the swatch: yarn of radius 0.085 along the lines, which pass each other at about 0.18."""
    lines = np.load(real_data("geotex/yarn_bcc/flame_ribbing_pattern.npz"))
    low, high = np.array([-0.6, -4.2]), np.array([4.9, 1.3])
    points, normals = yarn(lines["points"].astype(np.float64), low, high, 0.085, 0.05)
    box = np.array([[*(low + 0.1), points[:, 2].min()], [*(high - 0.1), points[:, 2].max()]])
    return geometry_from_points(points, normals, bounds=box, axis="z")


def main() -> None:
    """Run the scene."""
    args = options(__doc__ or "")
    run_extension("knit", "Knitted ribbing", swatch(), (9.0, 9.0), 1.7, args)


if __name__ == "__main__":
    main()
