"""A swatch made ready for extension: in its own frame, with surface variation, bounds that leave padding, and its field."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.geometry.buckets import RECORD, Buckets
from intaglio.geometry.point_set import GeometryTexture
from intaglio.geometry.sampling import usual_nearest
from intaglio.kernels.distance_fields import signed_distance
from intaglio.kernels.point_surface import PointSurface

# Support of the point surface's weights, in distances of samples: about 20 neighbours.
SUPPORT = 2.5


class Swatch:
    """A geometry texture in the frame (u, v, height) with the bounds' least corner at the origin.

    Parameters
    ----------
    texture : GeometryTexture
    padding : float
        How far geometry must reach past the bounds; where it does not, the bounds shrink.
    device : str
        From `choose_device`.

    Attributes
    ----------
    records : (N,) array of RECORD
    base : (2,) array
        Sides of the bounds after shrinking.
    height : float
    spacing, support : float
    notes : list of str
    """

    def __init__(self, texture: GeometryTexture, padding: float, device: str) -> None:
        self.device = device
        self.axes = [*texture.plane_axes, texture.axis]
        self.spacing, self.support = texture.spacing, SUPPORT * texture.spacing
        self.notes: list[str] = []
        bounds = texture.bounds[:, self.axes].copy()
        points = texture.points.points[:, self.axes]
        low, high = points.min(axis=0), points.max(axis=0)
        for axis in range(2):
            short = padding - (bounds[0, axis] - low[axis]), padding - (high[axis] - bounds[1, axis])
            # Half a distance of samples less than required is accepted.
            if max(short) > 0.5 * self.spacing:
                bounds[0, axis] += max(short[0], 0.0)
                bounds[1, axis] -= max(short[1], 0.0)
                name = "xyz"[self.axes[axis]]
                self.notes.append(
                    f"geometry does not reach {padding:.4g} past the bounds along {name}; they were shrunk to "
                    f"{bounds[0, axis]:.10g} … {bounds[1, axis]:.10g}"
                )
        self.origin = bounds[0]
        self.base = bounds[1, :2] - bounds[0, :2]
        self.height = float(bounds[1, 2] - bounds[0, 2])
        if self.base.min() <= 0:
            raise InputError(
                f"the swatch is too small: nothing is left of its bounds once {padding:.4g} on every side is kept as padding; "
                "give a smaller patch or extra, or a larger swatch"
            )
        self.records = np.zeros(len(points), RECORD)
        self.records["point"] = points - self.origin
        self.records["normal"] = texture.points.normals[:, self.axes]
        self.records["source"] = np.arange(len(points))
        self.surface = PointSurface(self.records["point"], self.records["normal"], self.support, device=device)
        self.nearest = usual_nearest(self.records["point"])
        self.records["variation"] = self.surface.variation(2 * self.support)

    def buckets(self, side: float) -> Buckets:
        """Return all records in buckets."""
        made = Buckets(side)
        made.add(self.records)
        return made

    def field(self, cell: float, reach: float) -> Array:
        """Return the signed distances and gradients (columns, rows, layers, 4) at nodes ``cell`` apart over the bounds."""
        counts = [int(np.floor(side / cell + 1e-9)) + 1 for side in self.base]
        layers = layer_heights(self.height, cell)
        nodes = np.stack(
            np.meshgrid(np.arange(counts[0]) * cell, np.arange(counts[1]) * cell, layers, indexing="ij"), axis=-1
        ).reshape(-1, 3)
        return signed_distance(self.surface, nodes, reach=reach).reshape(*counts, len(layers), 4)

    def to_world(self, vectors: Array) -> Array:
        """Return vectors of the swatch's frame with their components in the texture's order."""
        out = np.empty_like(vectors)
        out[:, self.axes] = vectors
        return out


def layer_heights(height: float, cell: float) -> Array:
    """Return the heights of the field's nodes: about ``cell`` apart from bottom to top, at least two layers."""
    if height <= 0:
        return np.array([-cell / 2, cell / 2])
    return np.linspace(0, height, max(2, round(height / cell) + 1))
