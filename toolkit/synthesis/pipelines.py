"""From photographs or a relightable texture to a larger one: the thesis' approaches, and two others to hold them against."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_choice
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
from intaglio.synthesis.quilting import quilt
from intaglio.synthesis.result import Synthesis
from intaglio.synthesis.sample import checked_mask

METHODS: dict[str, Callable[..., Synthesis]] = {"quilt": quilt, "grow": grow}


def synthesize(
    source: Any,
    size: int | tuple[int, int],
    *,
    method: str = "quilt",
    kind: str = "gradient",
    color: str = "channels",
    robust: bool = False,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> Synthesis:
    """Make a larger texture of a sample: an image, any maps, a relightable texture, or photographs under known lights.

    Photographs are first represented, all maps of the representation synthesised together, and the result can be relit: with
    ``kind`` ``"3i"``, ``"gradient"``, ``"ptm"``, ``"eigen3"`` and ``"eigen6"`` the five approaches of Dong, section 6.2.

    Parameters
    ----------
    source : PhotometricStack, Relightable, (H, W) or (H, W, n) array, or sequence of arrays
        The sample.
    size : int or (int, int)
        Rows and columns of the result.
    method : {"quilt", "grow"}
        By blocks, refined (``refine=2``), or by pixels.
    kind : str
        Of a stack: how to represent it, see `represent`. With ``"height"``, and with relightable textures of that kind, height
        and albedo are synthesised, and normals are those of the synthesised heights (section 7.3.2, figure 7.3.3).
    color : {"channels", "luminance"}
        Of a stack, as for `represent`.
    robust : bool
        Of a stack, as for `represent`.
    seed : int
        The same seed gives the same bits.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``; default CUDA if there is one.
    progress : callable, optional
        Called with what is done and what there is to do, of the synthesis.
    **settings
        Further options of `quilt` or `grow`.

    Returns
    -------
    Synthesis
        With ``.texture`` where the sample is relightable.

    Raises
    ------
    InputError
        As `represent`, `quilt` and `grow`.
    """
    checked_choice("method", method, tuple(METHODS))
    settings |= {"seed": seed, "device": device, "progress": progress}
    if method == "quilt":
        settings.setdefault("refine", 2)
    make = METHODS[method]
    known = inspect.signature(make).parameters
    for name in settings:
        if name not in known or name == "missing":
            raise InputError(f"{method} has no option {name!r}; it has {', '.join(n for n in list(known)[2:] if n != 'missing')}")
    if isinstance(source, PhotometricStack):
        source = represent(source, kind, color=color, robust=robust, device=device)
    if isinstance(source, Relightable) and source.kind == "height":
        return _by_height(source, size, make, settings)
    return make(source, size, **settings)


def synthesize_each_light(
    source: PhotometricStack | Relightable,
    size: int | tuple[int, int],
    lights: Array,
    *,
    kind: str = "gradient",
    color: str = "channels",
    robust: bool = False,
    **settings: Any,
) -> list[Synthesis]:
    """Relight first, then synthesise the image under each light on its own: the other order, for comparison.

    Images of different lights show different arrangements of the texture: no light can change over the result.

    Parameters
    ----------
    source : PhotometricStack or Relightable
        The sample.
    size : int or (int, int)
        Rows and columns of the results.
    lights : (L, 3) array
        Vectors towards the lights.
    kind, color, robust
        Of a stack: how to represent it, see `represent`.
    **settings
        Further options of `synthesize`.

    Returns
    -------
    list of Synthesis
        One for each light; ``.maps`` (H, W, C) is its image.
    """
    towards = np.atleast_2d(checked_lights(lights))
    texture = source
    if isinstance(source, PhotometricStack):
        texture = represent(source, kind, color=color, robust=robust, device=settings.get("device"))
    if not isinstance(texture, Relightable):
        raise InputError(f"source must be a PhotometricStack or a Relightable, not {type(source).__name__}")
    if texture.mask is not None:
        given = settings.get("mask")
        settings["mask"] = texture.mask if given is None else checked_mask("mask", given, texture.mask.shape) & texture.mask
    return [synthesize(image, size, **settings) for image in texture.relight(towards)]


def _by_height(texture: Relightable, size: Any, make: Callable[..., Synthesis], settings: dict[str, Any]) -> Synthesis:
    """Synthesise height and albedo; the result's normals are those of its heights."""
    maps = surface_maps(texture)
    height = texture.height if texture.height is not None else integrable(texture).height
    assert height is not None
    # Pieces of a slope would not fit; the sample's mean slope is given back to the result's normals.
    slope, level = _plane(height.astype(np.float64), maps.valid)
    given = settings.get("mask")
    mask = maps.valid if given is None else maps.valid & checked_mask("mask", given, maps.valid.shape)
    found = make([(height - level).astype(np.float32), maps.albedo], size, **{**settings, "mask": mask})
    heights = found.maps[..., 0]
    p, q = gradients_from_height(heights, method="forward")
    if found.tileable:
        p = np.roll(heights, -1, axis=1) - heights
        q = np.roll(heights, 1, axis=0) - heights
    p, q = p + slope[0], q + slope[1]
    normal = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(p * p + q * q + 1)
    scaled = (normal[..., None] * found.maps[None, ..., 1:]).astype(np.float32)
    made = replace(texture, maps=scaled, chroma=None, mask=None, height=heights.astype(np.float32), confidence=None)
    made = replace(made, notes=(*texture.notes, "synthesised from a sample"))
    return replace(found, texture=made)


def _plane(height: Array, valid: Array) -> tuple[tuple[float, float], Array]:
    """Return slopes (x right, y up) and values of the plane of best fit."""
    y, x = np.mgrid[: height.shape[0], : height.shape[1]]
    columns = np.stack([x.ravel(), -y.ravel(), np.ones(x.size)], axis=1)
    use = valid.ravel()
    with single_threaded_blas():
        fitted = np.linalg.lstsq(columns[use], height.ravel()[use], rcond=None)[0]
    return (float(fitted[0]), float(fitted[1])), (columns @ fitted).reshape(height.shape)
