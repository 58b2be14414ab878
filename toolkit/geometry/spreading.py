"""Even spreading of points over their surface."""

from __future__ import annotations

import numpy as np

from intaglio.geometry.swatch import Swatch
from intaglio.kernels.points import PointSurface
from intaglio.kernels.relaxation import repelled

Array = np.ndarray


def relaxed(records: Array, swatch: Swatch, period, rounds: int) -> Array:
    fixed = PointSurface(records["point"], records["normal"], swatch.support, device=swatch.device)
    out = records.copy()
    moving = fixed
    for _ in range(rounds):
        pushed = repelled(moving, 1.2 * swatch.spacing, 0.25)
        feet = fixed.project(pushed, facing=out["normal"], reach=swatch.support)
        out["point"] = feet.points
        out["normal"] = feet.normals
        moving = PointSurface(out["point"], out["normal"], swatch.support, device=swatch.device)
    return out
