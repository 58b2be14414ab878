"""Openwork trellis: yarn along the centre lines of a real knitted swatch, extended."""

from __future__ import annotations

import numpy as np

from intaglio.geometry import GeometryTexture, geometry_from_points
from intaglio.scenes.common import options, real_data
from intaglio.scenes.extension import run_extension
from intaglio.scenes.swatches import yarn


def swatch() -> GeometryTexture:
    """Return the swatch: yarn of radius 0.085 along the lines, which pass each other at about 0.18."""
    lines = np.load(real_data("geotex/yarn_bcc/openwork_trellis_pattern.npz"))
    low, high = np.array([-6.0, -4.6]), np.array([6.0, 4.6])
    points, normals = yarn(lines["points"].astype(np.float64), low, high, 0.085, 0.05)
    box = np.array([[*(low + 0.1), points[:, 2].min()], [*(high - 0.1), points[:, 2].max()]])
    return geometry_from_points(points, normals, bounds=box, axis="z")


def main() -> None:
    """Run the scene."""
    args = options(__doc__ or "")
    run_extension("trellis", "Openwork trellis", swatch(), (15.0, 12.0), 3.6, args)


if __name__ == "__main__":
    main()
