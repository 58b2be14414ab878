"""From photographs or a relightable texture to a larger one: the thesis' approaches, and two others to compare them with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_arguments, checked_mask
from intaglio.errors import InputError
from intaglio.kernels.launch import single_threaded_blas
from intaglio.photometric import (
    PhotometricStack,
    Relightable,
    checked_lights,
    gradients_from_height,
    integrable,
    represent,
    surface_maps,
)
from intaglio.synthesis.growing import grow
from intaglio.synthesis.material import Material
from intaglio.synthesis.options import GrowOptions, QuiltOptions, WeaveOptions
from intaglio.synthesis.quilting import quilt
from intaglio.synthesis.result import Synthesis
from intaglio.synthesis.sample import stack_maps
from intaglio.synthesis.weaving import weave


@checked_arguments
def synthesize(
    source: Any,
    size: int | tuple[int, int],
    options: WeaveOptions | QuiltOptions | GrowOptions | None = None,
    *,
    kind: str = "gradient",
    color: str = "channels",
    robust: bool = False,
    tileable: bool = False,
    mask: Array | None = None,
    match: Any = None,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> Synthesis:
    """Make a larger texture of a sample: an image, any maps, a relightable texture, or photographs under known lights.

    Photographs are first represented; then all maps of the representation are synthesised together, so that the result can
    be relit. The kinds ``"3i"``, ``"gradient"``, ``"ptm"``, ``"eigen3"`` and ``"eigen6"`` give the five approaches of the
    thesis, section 6.2.

    Parameters
    ----------
    source : PhotometricStack, Relightable, Material, (H, W) or (H, W, n) array, or sequence of arrays of one size
        The sample.
    size : int or (int, int)
        Rows and columns of the result in pixels, 1 to 65536; one number makes a square.
    options : WeaveOptions, QuiltOptions or GrowOptions, optional
        The method, by coherent pieces, by blocks or pixel by pixel, and its options. Default None: ``WeaveOptions()``, by
        coherent pieces, which suits most textures; the others are as published.
    kind : str, optional
        How photographs are represented; see `represent`. With ``"height"``, and with relightable textures of that kind,
        height and albedo are synthesised, and the normals are those of the synthesised heights (section 7.3.2, figure
        7.3.3).
    color : {"channels", "luminance"}, optional
        Of photographs: represent every channel, or the luminance with one chromaticity for each pixel.
    robust : bool, optional
        Of photographs: leave shadows and highlights out of the fit of normals.
    tileable : bool, optional
        Make a result that wraps around without a seam. Default False, since most results are not repeated.
    mask : (H, W) bool array, optional
        Pixels of the sample that may be used. Default None: all.
    match : array like the maps, or Match, optional
        What is compared in place of the maps themselves, or how; see `Match`.
    seed : int, optional
        The same seed gives the same bits.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the amount done and the total, of the synthesis.

    Returns
    -------
    Synthesis
        With ``.texture`` if the sample is relightable.

    Raises
    ------
    InputError
        If ``options`` is of another class, and as `represent`, `weave`, `quilt` and `grow`.

    See Also
    --------
    intaglio.weave, intaglio.quilt, intaglio.grow : The methods, for maps alone.
    intaglio.assess_synthesis : How similar a result is to its sample.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, sections 6.2 and 7.3.2.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
    >>> images = np.random.default_rng(0).random((4, 24, 24, 1))
    >>> stack = intaglio.PhotometricStack(images, lights)
    >>> made = intaglio.synthesize(stack, (32, 40), intaglio.QuiltOptions(block=8), device="cpu")
    >>> made.texture.kind, made.texture.relight(lights[0]).shape
    ('gradient', (32, 40, 1))
    """
    common = {"tileable": tileable, "match": match, "seed": seed, "device": device, "progress": progress}
    make = _choose_method(options, size, common)
    if isinstance(source, PhotometricStack):
        source = represent(source, kind, color=color, robust=robust, device=device)
    if not isinstance(source, Relightable | Material):
        source = stack_maps(source, "source")
    if isinstance(source, Relightable) and source.kind == "height":
        return _synthesize_height(source, make, mask, match)
    return make(source, mask=mask)


@checked_arguments
def synthesize_each_light(
    source: PhotometricStack | Relightable,
    size: int | tuple[int, int],
    lights: Array,
    options: WeaveOptions | QuiltOptions | GrowOptions | None = None,
    *,
    kind: str = "gradient",
    color: str = "channels",
    robust: bool = False,
    tileable: bool = False,
    mask: Array | None = None,
    match: Any = None,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> list[Synthesis]:
    """Relight first, then synthesise the image under each light on its own: the other order, for comparison.

    The images of different lights show different arrangements of the texture, so the light can't be changed over the result.

    Parameters
    ----------
    source : PhotometricStack or Relightable
        The sample.
    size : int or (int, int)
        Rows and columns of the results in pixels, 1 to 65536; one number makes a square.
    lights : (L, 3) array
        Vectors towards the lights, of any length above 0; x right, y up, z to the camera.
    options : WeaveOptions, QuiltOptions or GrowOptions, optional
        The method and its options, as for `synthesize`.
    kind : str, optional
        How photographs are represented; see `represent`.
    color : {"channels", "luminance"}, optional
        Of photographs, as for `synthesize`.
    robust : bool, optional
        Of photographs, as for `synthesize`.
    tileable : bool, optional
        Make results that wrap around without a seam.
    mask : (H, W) bool array, optional
        Pixels of the sample that may be used. Default None: all.
    match : array like the images, or Match, optional
        What is compared in place of the relit images, or how; see `Match`.
    seed : int, optional
        The same seed gives the same bits; all lights share it.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the amount done and the total, of each synthesis.

    Returns
    -------
    list of Synthesis
        One for each light; ``.maps`` (H, W, C) is its image.

    Raises
    ------
    InputError
        If ``source`` can't be relit, a light is from below, and as `synthesize`.

    See Also
    --------
    intaglio.synthesize : Synthesis first, relighting afterwards.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 6.2.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
    >>> stack = intaglio.PhotometricStack(np.random.default_rng(0).random((4, 24, 24, 1)), lights)
    >>> made = intaglio.synthesize_each_light(stack, 32, lights[:2], intaglio.QuiltOptions(block=8), device="cpu")
    >>> [each.maps.shape for each in made]
    [(32, 32, 1), (32, 32, 1)]
    """
    common = {"tileable": tileable, "match": match, "seed": seed, "device": device, "progress": progress}
    make = _choose_method(options, size, common)
    towards = np.atleast_2d(checked_lights(lights))
    texture = source
    if isinstance(source, PhotometricStack):
        texture = represent(source, kind, color=color, robust=robust, device=device)
    if not isinstance(texture, Relightable):
        raise InputError(f"source must be a PhotometricStack or a Relightable, not {type(source).__name__}")
    if texture.mask is not None:
        mask = texture.mask if mask is None else checked_mask("mask", mask, texture.mask.shape) & texture.mask
    return [make(image, mask=mask) for image in texture.relight(towards)]


def _choose_method(
    options: WeaveOptions | QuiltOptions | GrowOptions | None, size: int | tuple[int, int], common: dict[str, Any]
) -> Callable[..., Synthesis]:
    """Return `weave`, `quilt` or `grow` with all arguments but the sample and its mask."""
    chosen = WeaveOptions() if options is None else options
    if isinstance(chosen, WeaveOptions):
        return partial(weave, size=size, **vars(chosen), **common)
    if isinstance(chosen, QuiltOptions):
        return partial(quilt, size=size, **vars(chosen), **common)
    if isinstance(chosen, GrowOptions):
        return partial(grow, size=size, **vars(chosen), **common)
    raise InputError(f"options must be WeaveOptions, QuiltOptions or GrowOptions, not {options!r}")


def _synthesize_height(texture: Relightable, make: Callable[..., Synthesis], mask: Array | None, match: Any) -> Synthesis:
    """Synthesise height and albedo; the normals of the result are those of its heights."""
    maps = surface_maps(texture)
    height = texture.height if texture.height is not None else integrable(texture).height
    assert height is not None
    # Pieces of a slope would not fit together; the sample's mean slope is added to the normals of the result instead.
    slope, level = _fit_plane(height.astype(np.float64), maps.valid)
    usable = maps.valid if mask is None else maps.valid & checked_mask("mask", mask, maps.valid.shape)
    flat = (height - level).astype(np.float32)
    sample = replace(texture, height=flat, chroma=None, confidence=None)
    found = make(sample, mask=usable, match=[flat, maps.albedo] if match is None else match)
    assert found.texture is not None
    assert found.texture.height is not None
    heights = found.texture.height
    copied = np.concatenate([found.copy_of(flat)[..., None], found.copy_of(maps.albedo)], axis=2)
    # Copies keep the sample's albedo to the bit; joined, it is that of the joined scaled normals.
    albedo = copied[..., 1:] if found.moved is None else surface_maps(replace(found.texture, mask=None)).albedo
    # Central differences: forward ones lie half a pixel off, Fourier's ring beyond a step.
    around = np.pad(heights, 1, mode="wrap") if found.tileable else heights
    p, q = gradients_from_height(around, method="central")
    if found.tileable:
        p, q = p[1:-1, 1:-1], q[1:-1, 1:-1]
    p, q = p + slope[0], q + slope[1]
    normal = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(p * p + q * q + 1)
    scaled = (normal[..., None] * albedo[None]).astype(np.float32)
    made = replace(texture, maps=scaled, chroma=None, mask=None, height=heights, confidence=None)
    made = replace(made, notes=(*texture.notes, "synthesised from a sample"))
    laid = np.concatenate([heights[..., None], albedo], axis=2).astype(np.float32)
    moved = None if found.moved is None else (laid.astype(np.float64) - copied).astype(np.float32)
    return replace(found, maps=laid, moved=moved, texture=made)


def _fit_plane(height: Array, valid: Array) -> tuple[tuple[float, float], Array]:
    """Return slopes (x right, y up) and values of the plane of best fit."""
    y, x = np.mgrid[: height.shape[0], : height.shape[1]]
    columns = np.stack([x.ravel(), -y.ravel(), np.ones(x.size)], axis=1)
    use = valid.ravel()
    with single_threaded_blas():
        fitted = np.linalg.lstsq(columns[use], height.ravel()[use], rcond=None)[0]
    return (float(fitted[0]), float(fitted[1])), (columns @ fitted).reshape(height.shape)
