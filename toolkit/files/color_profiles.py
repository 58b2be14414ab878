"""Colour profiles (ICC) of images: from stored values to linear Rec.709."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.kernels.transfer import decode_srgb

# Linear Rec.709 to XYZ under D50, as profiles hold it (Bradford adaptation).
_REC709_TO_XYZ = np.array(
    [[0.4360747, 0.3850649, 0.1430804], [0.2225045, 0.7168786, 0.0606169], [0.0139322, 0.0971045, 0.7141733]]
)

# Profiles that differ from sRGB by less than this, of the range, are taken for it: versions of sRGB differ by 0.001.
_SAME = 0.004


@dataclass(frozen=True)
class ColorProfile:
    """What a profile says about stored values.

    Attributes
    ----------
    name : str
        As the profile calls itself.
    curves : (C, n) array
        For each channel the linear value at n levels spread evenly from 0 to 1.
    matrix : (3, 3) array or None
        Linear channels to linear Rec.709; None for grey.
    """

    name: str
    curves: Array
    matrix: Array | None

    @property
    def is_srgb(self) -> bool:
        """Whether the colours are sRGB's, up to rounding."""
        levels = np.linspace(0, 1, 9)
        if self.matrix is None:
            return bool(np.abs(self.linear(levels[None]) - decode_srgb(levels[None])).max() < _SAME)
        grid = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(1, -1, 3)
        return bool(np.abs(self.linear(grid) - decode_srgb(grid)).max() < _SAME)

    def linear(self, values: Array) -> Array:
        """Return values (H, W) or (H, W, 3) in [0, 1] as linear Rec.709, none below 0."""
        levels = np.linspace(0, 1, self.curves.shape[1])
        if self.matrix is None:
            return np.interp(values, levels, self.curves[0]).astype(np.float32)
        straight = np.stack([np.interp(values[..., c], levels, self.curves[c]) for c in range(3)], axis=-1)
        # Colours outside Rec.709 have a negative part, which no later step could use.
        return np.maximum(straight @ self.matrix.T, 0).astype(np.float32)


# What cameras mean by the interoperability index R03 of EXIF (Adobe RGB (1998), gamma 563/256).
ADOBE_RGB = ColorProfile(
    "Adobe RGB (1998)",
    np.tile(np.linspace(0, 1, 4096) ** (563 / 256), (3, 1)),
    np.linalg.inv(_REC709_TO_XYZ)
    @ np.array([[0.6097559, 0.2052401, 0.1492240], [0.3111242, 0.6256560, 0.0632197], [0.0194811, 0.0608902, 0.7448387]]),
)


def read_profile(data: bytes) -> ColorProfile | None:
    """Return what an ICC profile of curves and a matrix says, None if it is damaged or of another kind."""
    try:
        return _parsed(data)
    except (struct.error, ValueError, IndexError, KeyError, OverflowError, np.linalg.LinAlgError):
        return None


def _parsed(data: bytes) -> ColorProfile | None:
    space = data[16:20]
    (count,) = struct.unpack_from(">I", data, 128)
    tags = {}
    for i in range(min(count, 200)):
        signature, offset, size = struct.unpack_from(">4sII", data, 132 + 12 * i)
        tags[signature] = data[offset : offset + size]
    name = _name(tags.get(b"desc", b""))
    if space == b"GRAY":
        return ColorProfile(name, _curve(tags[b"kTRC"])[None], None)
    if space != b"RGB " or data[20:24] != b"XYZ ":
        return None
    columns = [np.array(struct.unpack_from(">3i", tags[c], 8)) / 65536 for c in (b"rXYZ", b"gXYZ", b"bXYZ")]
    matrix = np.linalg.inv(_REC709_TO_XYZ) @ np.stack(columns, axis=1)
    return ColorProfile(name, np.stack([_curve(tags[c]) for c in (b"rTRC", b"gTRC", b"bTRC")]), matrix)


def _curve(tag: bytes) -> Array:
    """Return a tone curve at 4096 levels (ICC.1:2022, sections 10.6 and 10.18)."""
    x = np.linspace(0, 1, 4096)
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count == 0:
            return x
        values = np.array(struct.unpack_from(f">{min(count, 65536)}H", tag, 12), np.float64)
        return x ** (values[0] / 256) if count == 1 else np.interp(x, np.linspace(0, 1, len(values)), values / 65535)
    if tag[:4] != b"para":
        raise ValueError("no tone curve")
    (kind,) = struct.unpack_from(">H", tag, 8)
    count = (1, 3, 4, 5, 7)[kind]
    given = [value / 65536 for value in struct.unpack_from(f">{count}i", tag, 12)]
    g, a, b, c, d, e, f = given + [0.0] * (7 - count)
    if kind == 0:
        return x**g
    if kind in (1, 2):
        c, d, e, f = 0.0, -b / a, c, c
    power = np.maximum(a * x + b, 0) ** g + e
    return np.where(x >= d, power, c * x + f)


def _name(tag: bytes) -> str:
    """Return a profile's description (ICC.1:2022, section 10.15, or the older type of version 2)."""
    if tag[:4] == b"mluc" and len(tag) >= 28:
        size, offset = struct.unpack_from(">II", tag, 20)
        text = tag[offset : offset + min(size, 200)].decode("utf-16-be", "replace")
    elif tag[:4] == b"desc" and len(tag) >= 12:
        (size,) = struct.unpack_from(">I", tag, 8)
        text = tag[12 : 12 + min(size, 200)].decode("ascii", "replace")
    else:
        text = ""
    return text.strip("\0 ") or "an unnamed profile"
