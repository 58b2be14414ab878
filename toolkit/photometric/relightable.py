"""A texture that answers to light: maps, and a basis that says how to combine them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments, checked_mask
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.lighting import weighted_sums
from intaglio.photometric.bases import Basis, coefficients
from intaglio.photometric.stack import checked_lights

KINDS = ("3i", "gradient", "ptm", "hsh", "eigen3", "eigen6", "rbf", "height")

# Maps, chroma and coefficients within this multiply to what single precision holds.
LARGEST = 1e12


@dataclass(frozen=True)
class Relightable:
    """Texture that can be lit from any direction above it: image = Σ_j c_j(light) maps_j.

    Usually made by `represent` from photographs, or read by `read_relightable`.

    Parameters
    ----------
    kind : str
        One of "3i", "gradient", "ptm", "hsh", "eigen3", "eigen6", "rbf", "height"; see `represent`.
    maps : (n, H, W, C) float32 array
        Linear values of any sign, with C = 1 or 3 channels. Pixels outside the mask are 0.
    basis : Basis
        The coefficients c(l) as functions of the light: an object with ``size`` n, ``evaluate`` and ``parameters``.
    chroma : (H, W, 3) float32 array or None, optional
        Colour over luminance. If given, ``maps`` have one channel, luminance, and images are its product with the chroma.
        Default None: the maps have the colours.
    mask : (H, W) bool array or None, optional
        Pixels that were fitted. Default None: all.
    height : (H, W) float32 array or None, optional
        Heights in pixels towards the camera, for kind "height". Default None.
    confidence : (H, W) float32 array or None, optional
        The share of the lights that a robust fit explains, from 0 to 1. Default None: the fit was not robust.
    notes : tuple of str, optional
        What was chosen in fitting, as sentences for the user. Default none.

    Raises
    ------
    InputError
        If the kind is unknown, shapes don't fit each other, or the maps have values that are not finite.

    See Also
    --------
    intaglio.represent : Fit a texture to photographs.
    intaglio.write_relightable : Write it to a file.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 4.4.1, eq. 4.4.5.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
    >>> images = 0.5 * np.ones((4, 2, 3, 1)) * lights[:, 2, None, None, None]
    >>> texture = intaglio.represent(intaglio.PhotometricStack(images, lights), "gradient", device="cpu")
    >>> texture.kind, texture.maps.shape
    ('gradient', (3, 2, 3, 1))
    >>> texture.relight([0, 0, 1])[0, 0].round(3)
    array([0.5], dtype=float32)
    """

    kind: str
    maps: Array
    basis: Basis
    chroma: Array | None = None
    mask: Array | None = None
    height: Array | None = None
    confidence: Array | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self, nan=True)
        if self.kind not in KINDS:
            raise InputError(f"kind {self.kind!r} is not known; known: {', '.join(KINDS)}")
        maps = np.ascontiguousarray(self.maps, np.float32)
        if maps.ndim != 4 or maps.size == 0 or maps.shape[3] not in (1, 3):
            raise InputError(f"maps must be (n, H, W, C) with 1 or 3 channels, not {maps.shape}")
        if len(maps) != self.basis.size:
            raise InputError(f"there are {len(maps)} maps but the basis has {self.basis.size} coefficients")
        with np.errstate(over="ignore", invalid="ignore"):
            if not np.isfinite(maps.sum(dtype=np.float64)) and not np.isfinite(maps).all():
                raise InputError("maps have values that are not finite (NaN or infinite)")
            if max(maps.max(), -maps.min()) > LARGEST:
                raise InputError(f"maps have values over {LARGEST:g}: images would not be finite")
        object.__setattr__(self, "maps", maps)
        if self.chroma is not None and (maps.shape[3] != 1 or self.chroma.shape != (*maps.shape[1:3], 3)):
            raise InputError(f"chroma {self.chroma.shape} does not fit maps {maps.shape}: it is (H, W, 3), beside one channel")
        if self.mask is not None:
            object.__setattr__(self, "mask", checked_mask("mask", self.mask, maps.shape[1:3]))
        for name in ("chroma", "height", "confidence"):
            plane = getattr(self, name)
            if plane is not None and name != "chroma" and plane.shape != maps.shape[1:3]:
                raise InputError(f"{name} is {plane.shape}, the maps are {maps.shape[1:3]}")
            if plane is not None and not np.isfinite(plane).all():
                raise InputError(f"{name} has values that are not finite (NaN or infinite)")
        if self.chroma is not None and np.abs(self.chroma).max() > LARGEST:
            raise InputError(f"chroma has values over {LARGEST:g}: images would not be finite")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of relit images.

        Returns
        -------
        (int, int, int)
            Rows H, columns W, and channels C, 1 or 3.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
        >>> stack = intaglio.PhotometricStack(np.full((4, 2, 3, 3), 0.5), lights)
        >>> intaglio.represent(stack, "gradient", device="cpu").shape
        (2, 3, 3)
        """
        return self.maps.shape[1], self.maps.shape[2], 3 if self.chroma is not None else self.maps.shape[3]

    @checked_arguments
    def coefficients(self, light: Array) -> Array:
        """Return the weights of the maps under one light, or under many.

        Parameters
        ----------
        light : (3,) or (L, 3) array
            Vectors towards the light, of any length; x right, y up, z to the camera.

        Returns
        -------
        (n,) or (L, n) float64 array
            The coefficients c(l).

        Raises
        ------
        InputError
            If a light is zero, not finite, or comes from below the surface.

        Examples
        --------
        The maps of kind "gradient" are scaled normals, and c(l) is the light itself (Lambert's law):

        >>> import numpy as np
        >>> import intaglio
        >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
        >>> stack = intaglio.PhotometricStack(np.full((4, 2, 2, 1), 0.5), lights)
        >>> intaglio.represent(stack, "gradient", device="cpu").coefficients([0, 3, 4])
        array([0. , 0.6, 0.8])
        """
        if light.ndim not in (1, 2) or light.shape[-1] != 3 or not light.size:
            raise InputError(f"light must be a vector x, y, z or (L, 3) of them, not {light.shape}")
        lights = checked_lights(light)
        found = coefficients(self.basis, lights)
        return found if np.ndim(light) == 2 else found[0]

    @checked_arguments
    def relight(self, light: Array, *, clip: bool = True, device: str | None = None) -> Array:
        """Return the image under one light, or under many.

        Parameters
        ----------
        light : (3,) or (L, 3) array
            Vectors towards the light, of any length; x right, y up, z to the camera.
        clip : bool, optional
            Set negative values to 0. Default True: no surface sends back less than nothing.
        device : str, optional
            Where images are summed up, such as "cpu" or "cuda:0". Default None: the CPU, since the maps would be copied to
            a GPU for every call.

        Returns
        -------
        (H, W, C) or (L, H, W, C) float32 array
            Linear values; row 0 is the top.

        Raises
        ------
        InputError
            If a light is zero, not finite, or comes from below the surface, or the device does not exist.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
        >>> images = 0.5 * np.ones((4, 2, 2, 1)) * lights[:, 2, None, None, None]
        >>> texture = intaglio.represent(intaglio.PhotometricStack(images, lights), "gradient", device="cpu")
        >>> image = texture.relight(intaglio.light_direction(tilt=30, slant=60))
        >>> image.shape, image[0, 0].round(3)
        ((2, 2, 1), array([0.25], dtype=float32))
        """
        weights = np.atleast_2d(self.coefficients(light))
        planes = self.maps.reshape(len(self.maps), -1)
        chosen = "cpu" if device is None else device_or_error(device)
        relit = weighted_sums(planes, weights, floor=0.0 if clip else None, device=chosen)
        images = relit.reshape(len(weights), *self.maps.shape[1:])
        if self.chroma is not None:
            images = images * self.chroma
        return images if np.ndim(light) == 2 else images[0]

    def color_maps(self) -> Array:
        """Return the maps in colour: their products with the chroma, if there is one.

        Returns
        -------
        (n, H, W, C) float32 array
            With C = 3 if there is a chroma, else the maps themselves.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
        >>> stack = intaglio.PhotometricStack(np.full((4, 2, 2, 3), 0.5), lights)
        >>> texture = intaglio.represent(stack, "gradient", color="luminance", device="cpu")
        >>> texture.maps.shape, texture.color_maps().shape
        ((3, 2, 2, 1), (3, 2, 2, 3))
        """
        return self.maps if self.chroma is None else self.maps * self.chroma
