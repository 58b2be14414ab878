"""Masks that commands are given as images."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.cli.options import known_suffix
from intaglio.errors import InputError
from intaglio.files import READABLE_SUFFIXES, read_samples


def read_mask(path: Path, shape: tuple[int, ...], image: Path) -> Array:
    """Return a mask file's bright pixels, (H, W) bool."""
    known_suffix(path, READABLE_SUFFIXES, "mask")
    values = read_samples(path)
    # Of a mask with alpha but one colour, the alpha is the mask.
    if values.ndim == 3 and values.shape[2] == 4 and np.ptp(values[:, :, :3]) == 0 < np.ptp(values[:, :, 3]):
        values = values[:, :, 3]
    elif values.ndim == 3:
        values = values[:, :, :3].max(axis=2)
    if values.shape != tuple(shape):
        raise InputError(
            f"{path}: the mask has {values.shape[1]} x {values.shape[0]} pixels, {image} has {shape[1]} x {shape[0]}; "
            "give a mask of the image's size"
        )
    top = np.iinfo(values.dtype).max if values.dtype.kind in "iu" and values.max() > 1 else 1.0
    return np.asarray(values >= top / 2)
