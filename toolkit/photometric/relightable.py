"""A texture that answers to light: maps, and a basis that says how to combine them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.lighting import weighted_sums
from intaglio.photometric.bases import Basis, coefficients
from intaglio.photometric.stack import checked_lights

KINDS = ("3i", "gradient", "ptm", "hsh", "eigen3", "eigen6", "rbf", "height")


@dataclass(frozen=True)
class Relightable:
    """A texture that can be lit from any direction above it: image = Σ_j c_j(light) maps_j.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    maps : (n, H, W, C) float32 array
        Linear values, of any sign. Pixels outside the mask are 0.
    basis : Basis
        c(l).
    chroma : (H, W, 3) float32 array, optional
        Colour over luminance. Where given, ``maps`` has one channel, luminance, and images are its product with it.
    mask : (H, W) bool array, optional
        Pixels that were fitted; None means all.
    height : (H, W) float32 array, optional
        Of kind ``"height"``: heights in pixels, towards the camera.
    confidence : (H, W) float32 array, optional
        Of robust fits: the share of the lights that the fit explains, from 0 to 1.
    notes : tuple of str
        What was chosen in fitting.
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
        object.__setattr__(self, "maps", maps)
        if self.chroma is not None and (maps.shape[3] != 1 or self.chroma.shape != (*maps.shape[1:3], 3)):
            raise InputError(f"chroma {self.chroma.shape} does not fit maps {maps.shape}: it is (H, W, 3), beside one channel")
        for name in ("mask", "height", "confidence"):
            plane = getattr(self, name)
            if plane is not None and not isinstance(plane, np.ndarray):
                raise InputError(f"{name} must be an array (H, W), not {type(plane).__name__}")
            if plane is not None and plane.shape != maps.shape[1:3]:
                raise InputError(f"{name} is {plane.shape}, the maps are {maps.shape[1:3]}")

    @property
    def shape(self) -> tuple[int, int, int]:
        """(H, W, C) of relit images."""
        return self.maps.shape[1], self.maps.shape[2], 3 if self.chroma is not None else self.maps.shape[3]

    def coefficients(self, light: Array) -> Array:
        """Return c(l): (n,) float64 for a ``light`` (3,), or (L, n) for (L, 3).

        Raises
        ------
        InputError
            If a light is zero, not finite, or comes from below the surface.
        """
        lights = checked_lights(light)
        found = coefficients(self.basis, lights)
        return found if np.ndim(light) == 2 else found[0]

    def relight(self, light: Array, *, clip: bool = True, device: str | None = None) -> Array:
        """Return the image under one light, or under many.

        Parameters
        ----------
        light : (3,) or (L, 3) array
            Vectors towards the light, of any length; x right, y up, z to the camera.
        clip : bool
            Set negative values to 0.
        device : str, optional
            Default the CPU: the maps would travel to a GPU for every call.

        Returns
        -------
        (H, W, C) or (L, H, W, C) float32 array
            Linear values.

        Raises
        ------
        InputError
            If a light is zero, not finite, or comes from below the surface.
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
        """Return maps (n, H, W, C) in which chromaticity is multiplied in."""
        return self.maps if self.chroma is None else self.maps * self.chroma
