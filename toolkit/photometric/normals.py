"""Surface normals, gradients and albedo of a relightable texture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments
from intaglio.photometric.bases import coefficients
from intaglio.photometric.light_positions import spread_lights
from intaglio.photometric.relightable import Relightable

# Slopes end at 87 degrees: a normal that lies in the image plane has no gradient.
STEEPEST = 0.05


@dataclass(frozen=True)
class SurfaceMaps:
    """Normals, albedo and gradients of a texture under Lambert's law.

    Attributes
    ----------
    normal : (H, W, 3) float32 array
        Unit vectors; x right, y up, z to the camera. (0, 0, 1) where no normal was found.
    albedo : (H, W, C) float32 array
        Reflectance times the light's strength, linear, at least 0.
    p, q : (H, W) float32 arrays
        Slopes ∂s/∂x and ∂s/∂y of the height s, without a unit; y points up, against the rows. Slopes end at 87 degrees.
    valid : (H, W) bool array
        Where a normal was found: inside the mask, and not black.

    See Also
    --------
    intaglio.surface_maps : Computes them.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 4.4.2, eq. 4.4.6.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
    >>> slope = np.array([0.6, 0.0, 0.8])
    >>> images = 0.5 * np.ones((4, 2, 2, 1)) * (lights @ slope)[:, None, None, None]
    >>> texture = intaglio.represent(intaglio.PhotometricStack(images, lights), "gradient", device="cpu")
    >>> maps = intaglio.surface_maps(texture)
    >>> print(maps.normal[0, 0].round(3), maps.albedo[0, 0].round(3), maps.p[0, 0].round(3))
    [0.6 0.  0.8] [0.5] -0.75
    """

    normal: Array
    albedo: Array
    p: Array
    q: Array
    valid: Array

    def __post_init__(self) -> None:
        check_fields(self, nan=True)

    def gradients(self) -> tuple[Array, Array]:
        """Return the slopes, with 0 where no normal was found.

        Returns
        -------
        p : (H, W) float32 array
            Slopes ∂s/∂x along the columns, as `height_from_gradients` takes them.
        q : (H, W) float32 array
            Slopes ∂s/∂y upwards, against the rows, likewise.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> flat = np.zeros((2, 2, 3), np.float32) + np.float32([0, 0, 1])
        >>> slope = np.full((2, 2), 0.5, np.float32)
        >>> valid = np.array([[True, False], [True, True]])
        >>> maps = intaglio.SurfaceMaps(flat, np.ones((2, 2, 1), np.float32), slope, slope, valid)
        >>> p, q = maps.gradients()
        >>> p
        array([[0.5, 0. ],
               [0.5, 0.5]], dtype=float32)
        """
        return np.where(self.valid, self.p, 0), np.where(self.valid, self.q, 0)


def scaled_normals(texture: Relightable) -> Array:
    """Return normals times albedo (3, H, W, C) that fit the texture as it is relit over the hemisphere.

    For kinds that follow Lambert's law these are the texture's own maps (recombined for ``"3i"``); for others they come from the
    least-squares fit of n·l to c(l) over lights that are spread evenly down to a slant of 70 degrees.
    """
    lights = spread_lights(200, 70.0)
    to_normals = np.linalg.lstsq(lights, coefficients(texture.basis, lights), rcond=None)[0]
    return np.tensordot(to_normals.astype(np.float32), texture.color_maps(), axes=1)


@checked_arguments
def surface_maps(texture: Relightable) -> SurfaceMaps:
    """Compute normals, albedo and gradients of a texture of any kind.

    All channels share one normal, that of the sum of their scaled normals; the albedo of a channel is the length of its
    scaled normal along the shared one. For kinds that do not follow Lambert's law, the scaled normals are those of the matte
    texture that is nearest to them over the hemisphere.

    Parameters
    ----------
    texture : Relightable
        From `represent` or `read_relightable`.

    Returns
    -------
    SurfaceMaps
        Normals, albedo, slopes, and where they are valid.

    See Also
    --------
    intaglio.height_of : The height map of a texture.
    intaglio.write_maps : Write all of it as images.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 4.4.2.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
    >>> images = 0.5 * np.ones((4, 2, 2, 1)) * lights[:, 2, None, None, None]
    >>> texture = intaglio.represent(intaglio.PhotometricStack(images, lights), "gradient", device="cpu")
    >>> maps = intaglio.surface_maps(texture)
    >>> print(np.abs(maps.normal[0, 0]).round(3), maps.albedo[0, 0].round(3))
    [0. 0. 1.] [0.5]
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
