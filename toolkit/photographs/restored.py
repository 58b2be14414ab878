"""Restoring the part of a texture that no photograph shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from intaglio.arrays import Progress
from intaglio.checks import checked_arguments
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.pull_push import continue_image
from intaglio.kernels.transfer import decode_srgb, encode_srgb
from intaglio.photographs.texture import Texture, checked_texture
from intaglio.restoration import restore


@checked_arguments
def restore_texture(
    texture: Texture,
    method: str = "auto",
    *,
    kappa: int | None = None,
    levels: int = 3,
    coherence: float = 10.0,
    orientations: int = 1,
    refine: int = 1,
    seams: bool | None = None,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> Texture:
    """Restore the unknown texels of a texture from the known ones; neighbourhoods stay within their chart.

    Known texels keep their bits, and ``known`` stays as it is, since restored texels were not photographed. The texture is
    restored in display values, so that equal differences are equally visible.

    Parameters
    ----------
    texture : Texture
        From `combine_photographs`; texels on the surface that are not ``known`` are filled.
    method : {"auto", "weave", "split", "inpaint", "synthesize"}, optional
        Thin gaps by a plate and the rest by coherent pieces; or one of the methods for all of the texture. See `restore`.
    kappa : int, optional
        Number of subbands in the low band, 0 to 512. Default None: the smallest number that leaves the high band homogeneous.
    levels : int, optional
        Levels of the pyramid, 1 to 6.
    coherence : float, optional
        Preference for continuing what neighbours copy over the nearest neighbourhood, 0 to 100.
    orientations : {1, 8}, optional
        1 compares with neighbourhoods as they are, 8 also with those turned by quarters and mirrored.
    refine : int, optional
        Passes of texture optimisation over the filled region, 0 to 10.
    seams : bool, optional
        Fit the filled texels to the known ones around them by the differences of their sources. Default None: not
        for "synthesize".
    seed : int, optional
        Of "weave": the same seed gives the same bits.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the amount done and the total.

    Returns
    -------
    Texture
        The same texture with a complete ``image``; a note says how many of its texels were restored.

    Raises
    ------
    InputError
        If ``texture`` is no Texture, none of its texels is known, or an option is out of range.

    See Also
    --------
    intaglio.restore : The same for an image.

    References
    ----------
    Yamauchi et al., "Textures Revisited", The Visual Computer 21, 2005, sections 4.2 (the mask) and 5.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> known = np.ones((32, 32), bool)
    >>> known[10:14, 10:14] = False
    >>> grey = np.where(known, 0.25, 0.0)[:, :, None] * np.ones(3, np.float32)
    >>> chart = np.ones((32, 32), np.int32)
    >>> photograph = np.where(known, 0, -1).astype(np.int16)[:, :, None]
    >>> weight = known.astype(np.float16)[:, :, None]
    >>> texture = intaglio.Texture(grey, known, chart, photograph, weight, ("front",), np.ones((1, 3)))
    >>> whole = intaglio.restore_texture(texture, device="cpu")
    >>> bool(np.allclose(whole.image, 0.25, atol=1e-4))
    True
    """
    checked_texture("texture", texture)
    missing = texture.inside & ~texture.known
    if not missing.any():
        return replace(texture, notes=(*texture.notes, "every texel was photographed, there is nothing to restore"))
    if not texture.known.any():
        raise InputError("no texel of the texture is known; there is nothing to restore from")
    # Charts without a known texel have nothing to be restored from; their interpolated colours stay.
    charts = np.unique(texture.chart[texture.known])
    usable = np.where(np.isin(texture.chart, charts), texture.chart, 0)
    # Values brighter than white are scaled below it meanwhile.
    peak = max(1.0, float(texture.image[texture.inside].max()))
    found = restore(
        encode_srgb(texture.image / peak),
        missing,
        method,
        kappa=kappa,
        levels=levels,
        coherence=coherence,
        orientations=orientations,
        refine=refine,
        seams=seams,
        inside=usable,
        seed=seed,
        device=device,
        progress=progress,
    )
    filled = found.missing
    image = np.where(filled[:, :, None], decode_srgb(found.image) * peak, texture.image).astype(np.float32)
    share = 100 * missing.sum() / max(int(texture.inside.sum()), 1)
    notes = (*texture.notes, f"{share:.1f} % of the surface's texels restored", *found.notes)
    return replace(texture, image=continue_image(image, texture.inside, device_or_error(device)), notes=notes)
