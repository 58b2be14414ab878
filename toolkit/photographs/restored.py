"""Restoring what no photograph saw of a texture."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from intaglio.arrays import Progress
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.pull_push import continued
from intaglio.kernels.transfer import decode_srgb, encode_srgb
from intaglio.photographs.texture import Texture
from intaglio.restoration import restore_in_detail


def restore_texture(
    texture: Texture,
    method: str = "split",
    *,
    device: str | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Texture:
    """Return a texture whose unknown texels are restored from the known ones; neighbourhoods stay within their chart.

    Known texels keep their bits, and ``known`` stays as it is: what was restored was not photographed.

    Parameters
    ----------
    texture : Texture
    method : {"split", "inpaint", "synthesize"}
    device, progress
        As for `restore_in_detail`, and all its other ``options``.

    Raises
    ------
    InputError
        If nothing is known.

    References
    ----------
    Yamauchi et al., Textures revisited (2005), sections 4.2 (the mask) and 5.
    """
    missing = texture.inside & ~texture.known
    if not missing.any():
        return replace(texture, notes=(*texture.notes, "every texel was photographed, there is nothing to restore"))
    if not texture.known.any():
        raise InputError("no texel of the texture is known; there is nothing to restore from")
    # Charts without a known texel can't be restored from themselves; their interpolated colours stay.
    charts = np.unique(texture.chart[texture.known])
    usable = np.where(np.isin(texture.chart, charts), texture.chart, 0)
    if {"inside", "missing"} & options.keys():
        raise InputError("inside and missing follow from the texture; leave them out")
    # Brighter than white is brought below it meanwhile.
    peak = max(1.0, float(texture.image[texture.inside].max()))
    shown = encode_srgb(texture.image / peak)
    found = restore_in_detail(shown, missing, method, inside=usable, device=device, progress=progress, **options)
    filled = found.missing
    image = np.where(filled[:, :, None], decode_srgb(found.image) * peak, texture.image).astype(np.float32)
    share = 100 * missing.sum() / max(int(texture.inside.sum()), 1)
    notes = (*texture.notes, f"{share:.1f} % of the surface's texels restored", *found.notes)
    return replace(texture, image=continued(image, texture.inside, device_or_error(device)), notes=notes)
