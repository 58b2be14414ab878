"""Uneven light over a photographed sample: found, and taken out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments, checked_mask, checked_number, checked_shape, real_array
from intaglio.errors import InputError
from intaglio.kernels.launch import single_threaded_blas

# Blocks along each side whose mean tones tell light from texture.
_BLOCKS = 6

# Light is found where the tones of blocks follow a slope or a bow that spreads them so many times as far as what is left, and so
# far at all (in natural logarithms, from the darkest to the brightest place).
_CLEARLY, _LEAST = 2.2, 0.3

# Tones below this share of the brightest are noise.
_DARKEST = 0.01

_REC709 = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True)
class EvenLight:
    """A sample in even light.

    Attributes
    ----------
    image : (H, W) or (H, W, C) array
        The given image over ``light``, of its type.
    light : (H, W) float64 array
        What the image was divided by; 1 on average of its logarithm.
    note : str
        What was found, in words.

    Raises
    ------
    InputError
        If an array is of another type or shape.

    See Also
    --------
    intaglio.even_light : Makes one.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> even = intaglio.even_light(np.random.default_rng(0).random((60, 60)))
    >>> even.image.shape, bool((even.light == 1).all())
    ((60, 60), True)
    """

    image: Array
    light: Array
    note: str

    def __post_init__(self) -> None:
        # Pixels that are masked out may be NaN.
        check_fields(self, nan=True)
        if self.image.ndim not in (2, 3):
            raise InputError(f"image must be (H, W) or (H, W, C), not {self.image.shape}")
        object.__setattr__(self, "light", checked_shape("light", self.light, np.float64, self.image.shape[:2]))


@checked_arguments
def even_light(image: Array, radius: float | str = "auto", *, mask: Array | None = None) -> EvenLight:
    """Find light that is uneven over a photographed sample, and divide it out.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Linear values, none negative; of integers 8 or 16 bits.
    radius : float or "auto", optional
        ``"auto"``: a slope and a bow of the logarithm of luminance (a polynomial of second degree), where these clearly stand
        out from the texture's own changes; nothing otherwise. A number: all that is broader than a Gaussian of so many pixels,
        at least 1, whatever it comes from. Default "auto".
    mask : (H, W) bool array, optional
        Pixels that count. Default None: all.

    Returns
    -------
    EvenLight
        ``.image``, of the given type, clipped to its range if integers; ``.light``, by which to multiply to have it back;
        ``.note``.

    Raises
    ------
    InputError
        For negative values or such that are not finite, a radius below 1, and a mask that leaves nothing.

    See Also
    --------
    intaglio.weave : Textures that vary less over the sample are continued better.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> texture = 0.4 + 0.1 * np.random.default_rng(0).random((90, 90))
    >>> slope = np.linspace(0.5, 1.5, 90)
    >>> even = intaglio.even_light(texture * slope)
    >>> even.note
    'light falls from 1.6 to 0.53 of its mean over the sample: taken out'
    """
    given = real_array("image", image)
    if given.ndim not in (2, 3) or given.size == 0:
        raise InputError(f"image must be (H, W) or (H, W, C), not {given.shape}")
    shape = (given.shape[0], given.shape[1])
    use = np.ones(shape, bool) if mask is None else checked_mask("mask", mask, shape)
    if not use.any():
        raise InputError("mask leaves no pixel to find the light from")
    values = given.reshape(*shape, -1).astype(np.float64)
    if not np.isfinite(values[use]).all() or (values[use] < 0).any():
        raise InputError("image must hold finite values, none negative, to be divided by the light over it; mask others out")
    luminance = values @ _REC709 if values.shape[2] == 3 else values.mean(axis=2)
    if isinstance(radius, str):
        if radius != "auto":
            raise InputError(f'radius must be a number of pixels or "auto", not {radius!r}')
        found = _slope_and_bow(luminance, use)
    else:
        sigma = checked_number("radius", radius, 1, max(shape) * 4)
        least = max(_DARKEST * float(np.quantile(luminance[use], 0.99)), 1e-30)
        tone = np.log(np.maximum(luminance, least, where=use, out=np.ones(shape)))
        weight = ndimage.gaussian_filter(use.astype(np.float64), sigma)
        found = ndimage.gaussian_filter(np.where(use, tone, 0), sigma) / np.maximum(weight, 1e-12)
    if found is None:
        return EvenLight(given.copy(), np.ones(shape), "the light over the sample is even")
    found = found - found[use].mean()
    light = np.exp(found)
    even = values / light[..., None]
    if given.dtype.kind in "iu":
        limits = np.iinfo(given.dtype)
        even = np.clip(np.rint(even), limits.min, limits.max)
    inside = light[use]
    note = f"light falls from {inside.max():.2g} to {inside.min():.2g} of its mean over the sample: taken out"
    return EvenLight(np.where(use[..., None], even, values).reshape(given.shape).astype(given.dtype), light, note)


def _slope_and_bow(luminance: Array, use: Array) -> Array | None:
    """Return the polynomial of second degree nearest to the tones of blocks (H, W); None where these don't clearly follow it."""
    if min(luminance.shape) < 4 * _BLOCKS:
        return None
    places = [(np.arange(n) * _BLOCKS // n, np.linspace(-1, 1, n)) for n in luminance.shape]
    block = (places[0][0][:, None] * _BLOCKS + places[1][0])[use]
    count = np.bincount(block, minlength=_BLOCKS**2)
    known = count > 0.25 * count.max()
    # Of means, the logarithm: that of single dark pixels would scatter far.
    mean = np.bincount(block, luminance[use], _BLOCKS**2)[known] / count[known]
    tone = np.log(np.maximum(mean, max(_DARKEST * float(mean.max()), 1e-30)))

    def terms(y: Array, x: Array) -> Array:
        return np.stack(np.broadcast_arrays(1.0, x, y, x * y, x**2, y**2), axis=-1)

    middle = (2 * np.arange(_BLOCKS) + 1) / _BLOCKS - 1
    blocks = terms(middle[:, None], middle).reshape(_BLOCKS**2, -1)[known]
    if len(blocks) <= 2 * blocks.shape[1]:
        return None
    with single_threaded_blas():
        factors = np.linalg.lstsq(blocks, tone, rcond=None)[0]
    near = blocks @ factors
    if near.std() <= _CLEARLY * (tone - near).std() or np.ptp(near) <= _LEAST:
        return None
    return terms(places[0][1][:, None], places[1][1]) @ factors
