"""A brick wall as a height field, from scikit-image's photograph (Duranleau & Poulin, figure 4)."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from skimage import data

from intaglio.geometry import GeometryTexture, geometry_from_height
from intaglio.scenes.common import options
from intaglio.scenes.extension import run_extension


def swatch() -> GeometryTexture:
    """Return the swatch: the photograph's grey values, smoothed, as heights."""
    picture = data.brick().astype(np.float64) / 255
    height = ndimage.zoom(ndimage.gaussian_filter(picture, 4), 182 / 512, order=1)
    return geometry_from_height(10 * height)


def main() -> None:
    """Run the scene."""
    args = options(__doc__ or "")
    run_extension("brick_height", "Brick height field", swatch(), (295.0, 295.0), 60.0, args)


if __name__ == "__main__":
    main()
