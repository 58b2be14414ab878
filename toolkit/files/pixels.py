"""Pixels as a file stores them, with what it says about them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.files.color_profiles import ColorProfile
from intaglio.files.limits import check_memory


@dataclass(frozen=True)
class Pixels:
    """Pixels of an image file.

    Attributes
    ----------
    samples : (H, W) or (H, W, C) array
        As they are stored, in the order in which they are stored.
    orientation : int
        EXIF orientation, from 1 (row 0 is the top, column 0 the left) to 8.
    profile : ColorProfile or None
        What the colours mean, if it is something else than sRGB or than linear values.
    srgb : bool
        Whether the file says that its colours are sRGB.
    notes : tuple of str
        What the user should know of the reading, without the file's name.
    """

    samples: Array
    orientation: int = 1
    profile: ColorProfile | None = None
    srgb: bool = False
    notes: tuple[str, ...] = ()


def upright(samples: Array, orientation: int) -> Array:
    """Return (H, W, ...) samples turned as an EXIF orientation says."""
    if orientation >= 5:
        samples = np.swapaxes(samples, 0, 1)
    if orientation in (3, 4, 7, 8):
        samples = samples[::-1]
    if orientation in (2, 3, 6, 7):
        samples = samples[:, ::-1]
    return np.ascontiguousarray(samples)


def as_stored(samples: Array, orientation: int) -> Array:
    """Return what `upright` turned in the order in which it was stored."""
    return upright(samples, {6: 8, 8: 6}.get(orientation, orientation))


def check_image_memory(path: Path, width: int, height: int, channels: int, itemsize: int) -> None:
    """Raise `InputError` if decoding an image would take too much memory.

    At the peak there are two copies of the samples, and single-precision values of them beside a copy of those.
    """
    check_memory(path, width * height * channels * (2 * itemsize + 8), f"an image of {width} x {height} pixels")
