"""Even spreading of points over their surface: crowded ones are pushed apart, gaps are filled."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.geometry.sampling import thin_points
from intaglio.kernels.point_surface import PointSurface
from intaglio.kernels.relaxation import gaps, repel_points

# The share of the sum of all pushes by which a point moves in a round.
_STRENGTH = 0.25
# In usual distances of nearest neighbours: what counts as a gap, as a border, and how near a new point may come to others.
_GAP, _BORDER, _ROOM = 2.8, 4.5, 0.7


def spread(
    records: Array, *, nearest: float, support: float, rounds: int, period: tuple[float | None, float | None], device: str
) -> Array:
    """Return ``records`` evenly spread: gaps filled, then neighbours nearer than ``nearest`` pushed apart along the surface.

    The surface is that of the records as given, so that spreading moves points on it, never it.

    Parameters
    ----------
    records : array of RECORD
    nearest : float
        Usual distance of nearest neighbours.
    support : float
        Of the point surface.
    rounds : int
        Rounds of pushing; 0 leaves all as it is.
    period : (float or None, float or None)
        What the plane repeats after.
    device : str
    """
    if rounds == 0 or not len(records):
        return records
    ring = _add_images(records, period, 2 * support)
    fixed = PointSurface(ring["point"], ring["normal"], support, device=device)
    added = _fill_gaps(records, fixed, nearest, support)
    for axis, length in enumerate(period):
        if length is not None:
            # What lies past the border is found again on the other side.
            added = added[(added["point"][:, axis] >= 0) & (added["point"][:, axis] < length)]
    out = np.concatenate([records, added])
    for _ in range(rounds):
        ring = _add_images(out, period, 2 * support)
        moving = PointSurface(ring["point"], ring["normal"], support, device=device)
        pushed = repel_points(moving, nearest, _STRENGTH)[: len(out)]
        # Points that nothing pushes keep their bits.
        moved = np.flatnonzero((pushed != out["point"].astype(np.float32)).any(axis=1))
        feet = fixed.project(pushed[moved], facing=out["normal"][moved], reach=support)
        moved, point, normal = moved[feet.found], feet.points[feet.found], feet.normals[feet.found]
        out["moved"][moved] += np.linalg.norm(point - out["point"][moved], axis=1)
        out["point"][moved], out["normal"][moved] = point, normal
    return out


def _fill_gaps(records: Array, fixed: PointSurface, nearest: float, support: float) -> Array:
    """Return new records in the middle of gaps; each is said to come from the swatch point of the gap's rim."""
    middle, width = gaps(fixed, _GAP * nearest, _BORDER * nearest)
    rim = np.flatnonzero(width[: len(records)] > 0)
    feet = fixed.project(middle[rim], facing=records["normal"][rim], reach=support)
    rim, point, normal = rim[feet.found], feet.points[feet.found], feet.normals[feet.found]
    free = fixed.nearest(point, facing=normal, reach=_ROOM * nearest) < 0
    rim, point, normal = rim[free], point[free], normal[free]
    if not len(rim):
        return records[:0]
    chosen = thin_points(point, normal, _ROOM * nearest)
    made = records[rim[chosen]].copy()
    made["moved"] += np.linalg.norm(point[chosen] - made["point"], axis=1)
    made["point"], made["normal"] = point[chosen], normal[chosen]
    return made


def _add_images(records: Array, period: tuple[float | None, float | None], margin: float) -> Array:
    """Return the records followed by copies of those near a border that repeats."""
    out = records
    for axis, length in enumerate(period):
        if length is not None:
            along = out["point"][:, axis]
            left, right = out[along < margin].copy(), out[along >= length - margin].copy()
            left["point"][:, axis] += length
            right["point"][:, axis] -= length
            out = np.concatenate([out, left, right])
    return out
