"""The page about a restored image."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.files import listing, picture_row, write_page
from intaglio.kernels.transfer import decode_srgb
from intaglio.restoration.assess import assess_restoration
from intaglio.restoration.pipeline import Restoration

_MISSING = np.array([0.85, 0.1, 0.1])


def write_restoration_report(
    path: PathLike, image: Array, found: Restoration, *, title: str, method: str, truth: Array | None = None
) -> list[str]:
    """Write a page of an image before and after, its bands, where detail was copied from, and the figures; return these.

    Parameters
    ----------
    path : path
    image : (H, W) or (H, W, C) array
        Before restoration, as it was given.
    found : Restoration
    title, method : str
    truth : like ``image``, optional
    """
    if not found.missing.any():
        lines = ["nothing is missing"]
        write_page(path, title, [picture_row("Image", {"image": _shown(image)}), listing("Figures", lines)])
        return lines
    report = assess_restoration(found.image, found.missing, truth)
    lines = report.lines()
    before = np.where(found.missing[:, :, None], decode_srgb(_MISSING), _shown(image))
    rows = [picture_row("Before and after", {"missing, in red": before, "restored": _shown(found.image)})]
    if truth is not None:
        rows.append(picture_row("Truth", {"truth": _shown(truth)}))
    if method == "split":
        span = np.iinfo(found.image.dtype).max if found.image.dtype.kind in "iu" else 1
        rows.append(picture_row("Bands", {"low": _shown(found.low / span), "copied from": _source(found)}))
    write_page(path, title, [*rows, listing("Figures", [f"method {method}", *lines, *found.notes])])
    return lines


def _source(found: Restoration) -> Array:
    """Return provenance as colours: red runs with the rows of the source, green with its columns; known pixels are white."""
    place = found.source / np.maximum(np.array(found.missing.shape) - 1, 1)
    color = np.stack([place[..., 0], place[..., 1], np.full(found.missing.shape, 0.4)], axis=2)
    return decode_srgb(np.where(found.missing[:, :, None], color, 1.0))


def _shown(image: Array) -> Array:
    """Return an image of display values as linear colours (H, W, 3)."""
    scale = np.iinfo(image.dtype).max if image.dtype.kind in "iu" else 1
    values = np.clip(image.astype(np.float64) / scale, 0, 1)
    if values.ndim == 2 or values.shape[2] < 3:
        plane = values if values.ndim == 2 else values[:, :, 0]
        values = np.repeat(plane[:, :, None], 3, axis=2)
    return decode_srgb(values[:, :, :3])
