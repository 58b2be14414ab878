"""Polynomial texture map files (.ptm, version 1.2).

The header is text: version, format, width, height, six scales and six biases; in JPEG formats also one line each with the
streams' transforms, motion vectors, order, reference planes, sizes and sizes of side information. Rows go from bottom to
top; a pixel's six coefficients are in the order x², y², xy, x, y, 1, and a byte means (byte − bias) × scale, for intensities
from 0 to 255. LRGB files hold the polynomial of the luminance, and for every pixel a colour that it is multiplied by.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.errors import FileError
from intaglio.files import check_memory, check_readable, whole_file
from intaglio.photometric.bases import PolynomialBasis, coefficients
from intaglio.photometric.light_positions import spread_lights
from intaglio.photometric.relightable import Relightable

_STREAMS = {"PTM_FORMAT_JPEG_RGB": 18, "PTM_FORMAT_JPEG_LRGB": 9}


def write_ptm(texture: Relightable, path: PathLike) -> None:
    """Write an uncompressed .ptm: LRGB if the texture is grey or has a chromaticity, else RGB.

    Kinds other than ``"ptm"`` are written as the polynomial nearest to them over the hemisphere. Coefficients are rounded to
    256 levels each. Viewers show the values as they are, so a texture fitted to linear values looks dark in them: for .ptm
    viewers, fit to the photographs as they are stored (``read_stack(path, "linear")``).
    """
    maps = polynomial_maps(texture) * np.float32(255)
    if texture.chroma is not None or maps.shape[3] == 1:
        shares, peak = color_shares(np.ones((*maps.shape[1:3], 3)) if texture.chroma is None else texture.chroma)
        maps *= peak[None, :, :, None]
        color = np.round(255 * shares).astype(np.uint8)
        blocks, name = [maps[..., 0]], "PTM_FORMAT_LRGB"
    else:
        color = None
        blocks, name = [maps[..., c] for c in range(3)], "PTM_FORMAT_RGB"
    low = np.minimum(np.min([b.min(axis=(1, 2)) for b in blocks], axis=0), 0)
    high = np.maximum(np.max([b.max(axis=(1, 2)) for b in blocks], axis=0), 0)
    # One level is reserved for rounding the bias up to an integer; the header holds the scale with six decimals.
    scale = np.array([float(f"{s:.6f}") + 1e-6 for s in np.maximum((high - low) / 254, 1e-6)])
    bias = np.ceil(-low / scale).astype(int)
    header = [
        "PTM_1.2",
        name,
        str(maps.shape[2]),
        str(maps.shape[1]),
        " ".join(f"{s:.6f}" for s in scale),
        " ".join(str(b) for b in bias),
    ]
    with whole_file(path) as beside, open(beside, "wb") as file:
        file.write(("\n".join(header) + "\n").encode())
        for block in blocks:
            levels = np.empty((*block.shape[1:], 6), np.uint8)
            for j, plane in enumerate(block):
                levels[..., j] = np.clip(np.round(plane / scale[j] + bias[j]), 0, 255)
            file.write(np.ascontiguousarray(levels[::-1]).tobytes())
        if color is not None:
            file.write(np.ascontiguousarray(color[::-1]).tobytes())


def color_shares(chroma: Array) -> tuple[Array, Array]:
    """Return a chromaticity (H, W, 3) as shares of its largest channel, in [0, 1], and that channel (H, W).

    So the brightest channel of a pixel uses all levels of a file; the luminance is multiplied by the largest channel.
    """
    peak = np.maximum(chroma.max(axis=2), 1e-12).astype(np.float32)
    return np.clip(chroma / peak[..., None], 0, 1), peak


def polynomial_maps(texture: Relightable) -> Array:
    """Return the six maps (6, H, W, C) float32 of the polynomial nearest to a texture, which kind ``"ptm"`` has itself."""
    if isinstance(texture.basis, PolynomialBasis):
        return texture.maps
    lights = spread_lights(200, 80.0)
    to_polynomial = np.linalg.lstsq(coefficients(PolynomialBasis(), lights), coefficients(texture.basis, lights), rcond=None)[0]
    return np.tensordot(to_polynomial.astype(np.float32), texture.maps, axes=1)


def read_ptm(path: PathLike) -> Relightable:
    """Read a .ptm of format RGB, LRGB, JPEG_RGB or JPEG_LRGB.

    Returns
    -------
    Relightable
        Of kind ``"ptm"``; values are the file's over 255, as they are stored.

    Raises
    ------
    FileError
        If the file is not a PTM_1.2, of another format, or truncated.
    """
    path = check_readable(path)
    content = path.read_bytes()
    reader = _Header(path, content)
    if reader.line() != "PTM_1.2":
        raise FileError(f"{path}: is not a PTM_1.2 file")
    name = reader.line()
    known = ("PTM_FORMAT_RGB", "PTM_FORMAT_LRGB", *_STREAMS)
    if name not in known:
        raise FileError(f"{path}: format {name!r} can't be read; known: {', '.join(known)}")
    width, height = reader.integers(2)
    if not (0 < width <= 65536 and 0 < height <= 65536):
        raise FileError(f"{path}: gives a size of {width} x {height} pixels")
    scale, bias = np.array(reader.numbers(6)), np.array(reader.numbers(6))
    if not (np.abs(scale) <= 1e6).all() or not (np.abs(bias) <= 1e6).all():
        raise FileError(f"{path}: its scales and biases must be finite numbers, not {scale.tolist()} and {bias.tolist()}")
    count = 9 if name.endswith("LRGB") else 18
    # Levels, and coefficients as float64 and float32.
    check_memory(path, height * width * count * (1 + 8 + 4), f"a texture of {width} x {height} pixels with {count} planes")
    if name in _STREAMS:
        planes = _jpeg_planes(reader, _STREAMS[name], (height, width))
    else:
        planes = _raw_planes(reader, name, (height, width))
    planes = planes[:, ::-1]
    parts = [planes[6 * c : 6 * c + 6] for c in range(len(planes) // 6)]
    maps = np.stack([(part - bias[:, None, None]) * scale[:, None, None] / 255 for part in parts], axis=-1)
    chroma = np.moveaxis(planes[6:9], 0, 2).astype(np.float32) / 255 if name.endswith("LRGB") else None
    return Relightable("ptm", maps.astype(np.float32), PolynomialBasis(), chroma)


class _Header:
    """Reads a .ptm's text, then its bytes."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path, self.content, self.position = path, content, 0

    def line(self) -> str:
        """Return the next line."""
        end = self.content.find(b"\n", self.position)
        if end < 0:
            raise FileError(f"{self.path}: the file ends in its header")
        text = self.content[self.position : end].decode("ascii", "replace").strip()
        self.position = end + 1
        return text

    def numbers(self, count: int) -> list[float]:
        """Return the next ``count`` numbers, over as many lines as they take."""
        found: list[float] = []
        while len(found) < count:
            line = self.line()
            try:
                found += [float(word) for word in line.split()]
            except ValueError:
                raise FileError(f"{self.path}: has {line[:40]!r} in its header instead of numbers") from None
        if len(found) > count:
            raise FileError(f"{self.path}: has {len(found)} numbers in its header instead of {count}")
        return found

    def integers(self, count: int) -> list[int]:
        """Return the next ``count`` whole numbers."""
        found = self.numbers(count)
        if not all(abs(v) < 1e15 and v == int(v) for v in found):
            raise FileError(f"{self.path}: has {found} in its header instead of whole numbers")
        return [int(v) for v in found]

    def take(self, size: int) -> bytes:
        """Return the next ``size`` bytes."""
        if self.position + size > len(self.content):
            raise FileError(f"{self.path}: is truncated: {self.position + size - len(self.content)} bytes are missing")
        part = self.content[self.position : self.position + size]
        self.position += size
        return part


def _raw_planes(reader: _Header, name: str, shape: tuple[int, int]) -> Array:
    """Return (18 or 9, H, W) levels, from blocks of six coefficients per pixel and, for LRGB, one of three colours."""
    height, width = shape
    planes = []
    for size in (6, 6, 6) if name == "PTM_FORMAT_RGB" else (6, 3):
        block = np.frombuffer(reader.take(height * width * size), np.uint8).reshape(height, width, size)
        planes.append(np.moveaxis(block, 2, 0))
    return np.concatenate(planes)


def _jpeg_planes(reader: _Header, count: int, shape: tuple[int, int]) -> Array:
    """Return (count, H, W) levels of JPEG streams, some of which hold the difference from another plane.

    Streams are decoded in the given order. A plane with a reference is stream + reference − 128 modulo 256, where the reference
    is inverted first if the plane's transform is 1; side information then overwrites single pixels.
    """
    from PIL import Image

    reader.numbers(1)
    transforms = reader.integers(count)
    motion = reader.integers(count) + reader.integers(count)
    order, reference, sizes, side = (np.array(reader.integers(count)) for _ in range(4))
    if any(motion):
        raise FileError(f"{reader.path}: uses motion compensation, which can't be read")
    predicted_from = np.flatnonzero(reference >= 0)
    if (
        sorted(order) != list(range(count))
        or (reference >= count).any()
        or (order[reference[predicted_from]] >= order[predicted_from]).any()
        or (sizes < 0).any()
        or (side < 0).any()
    ):
        raise FileError(f"{reader.path}: its lines of order, references or sizes are inconsistent")
    planes: list[Array] = []
    extra: list[bytes] = []
    for i in range(count):
        stream = io.BytesIO(reader.take(int(sizes[i])))
        # Pillow's own limit of size is not needed: a stream is decoded only if it has the size that memory was found for.
        limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            with Image.open(stream, formats=["JPEG"]) as image:
                size = image.size
                plane = np.array(image.convert("L")) if size == (shape[1], shape[0]) else None
        except (OSError, SyntaxError, ValueError) as error:
            raise FileError(f"{reader.path}: stream {i} can't be read as JPEG ({error})") from error
        finally:
            Image.MAX_IMAGE_PIXELS = limit
        if plane is None:
            raise FileError(f"{reader.path}: stream {i} is {size[0]} x {size[1]}, not {shape[1]} x {shape[0]}")
        planes.append(plane)
        extra.append(reader.take(int(side[i])))
    for i in np.argsort(order):
        if reference[i] >= 0:
            other = planes[reference[i]].astype(np.int16)
            predicted = 255 - other if int(transforms[i]) & 1 else other
            planes[i] = ((planes[i].astype(np.int16) + predicted - 128) % 256).astype(np.uint8)
        entries = np.frombuffer(extra[i][: len(extra[i]) // 5 * 5], np.uint8).reshape(-1, 5).astype(np.int64)
        where = (entries[:, :4] * np.array([1 << 24, 1 << 16, 1 << 8, 1])).sum(axis=1)
        inside = where < planes[i].size
        planes[i].reshape(-1)[where[inside]] = entries[inside, 4]
    return np.stack(planes)
