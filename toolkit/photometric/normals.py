"""Surface normals, gradients and albedo of a relightable texture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.photometric.bases import coefficients
from intaglio.photometric.light_positions import spread_lights
from intaglio.photometric.relightable import Relightable

# Slopes are cut off at 87 degrees: a normal that lies in the image plane has no gradient.
STEEPEST = 0.05


@dataclass(frozen=True)
class SurfaceMaps:
    """Lambert's description of a texture (Dong, eq. 4.4.6).

    Attributes
    ----------
    normal : (H, W, 3) float32 array
        Unit vectors; x right, y up, z to the camera. (0, 0, 1) where there is none.
    albedo : (H, W, C) float32 array
        Reflectance times the light's strength.
    p, q : (H, W) float32 arrays
        ∂s/∂x and ∂s/∂y of the height s, per pixel; y points up, against the rows.
    valid : (H, W) bool array
        Where a normal was found: inside the mask, and not black.
    """

    normal: Array
    albedo: Array
    p: Array
    q: Array
    valid: Array

    def gradients(self) -> tuple[Array, Array]:
        """Return p and q, 0 where no normal was found."""
        return np.where(self.valid, self.p, 0), np.where(self.valid, self.q, 0)


def scaled_normals(texture: Relightable) -> Array:
    """Return normals times albedo (3, H, W, C) that fit the texture as it is relit over the hemisphere.

    For kinds that follow Lambert's law they are its own maps (recombined, for ``"3i"``); for others the least-squares fit of
    n·l to c(l) over lights spread evenly down to a slant of 70 degrees.
    """
    lights = spread_lights(200, 70.0)
    to_normals = np.linalg.lstsq(lights, coefficients(texture.basis, lights), rcond=None)[0]
    return np.tensordot(to_normals.astype(np.float32), texture.color_maps(), axes=1)


def surface_maps(texture: Relightable) -> SurfaceMaps:
    """Return normals, albedo and gradients of a texture.

    All channels share one normal, that of the sum of their scaled normals; a channel's albedo is its scaled normal's length
    along it.
    """
    scaled = scaled_normals(texture)
    total = scaled.sum(axis=3)
    length = np.linalg.norm(total, axis=0)
    valid = length > 1e-6 * max(float(length.max()), 1e-30)
    if texture.mask is not None:
        valid &= texture.mask
    straight = np.array([0.0, 0.0, 1.0], np.float32)[:, None, None]
    normal = np.where(valid, total / np.where(valid, length, 1), straight)
    albedo = np.maximum(np.einsum("ihw,ihwc->hwc", normal, scaled), 0)
    steep = np.maximum(normal[2], STEEPEST)
    return SurfaceMaps(np.moveaxis(normal, 0, 2), albedo, -normal[0] / steep, -normal[1] / steep, valid)
