"""TIFF images: any samples that pixels can be made of, whatever compresses them."""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError
from intaglio.files.color_profiles import ADOBE_RGB, read_profile
from intaglio.files.pillow import read_by_pillow
from intaglio.files.pixels import Pixels, as_stored, check_image_memory
from intaglio.files.quiet import hushed_streams
from intaglio.files.raw import read_raw

_COLORS = ("MINISBLACK", "MINISWHITE", "RGB", "PALETTE", "YCBCR", "SEPARATED")

# Compressions of bytes that tifffile undoes by itself, and those that libtiff, inside Pillow, undoes for it.
_BY_TIFFFILE = ("NONE", "ADOBE_DEFLATE", "DEFLATE", "PACKBITS", "LZMA")
_BY_LIBTIFF = ("LZW", "ADOBE_DEFLATE", "DEFLATE", "PACKBITS", "LZMA", "ZSTD")


def read_tiff(path: Path) -> Pixels:
    """Read the first image of a TIFF file."""
    # libtiff prints what it stumbles over.
    with hushed_streams():
        return _read(path)


def _read(path: Path) -> Pixels:
    import tifffile

    with tifffile.TiffFile(path) as file:
        page: Any = file.pages.first
        name = getattr(page.photometric, "name", str(page.photometric))
        if name in ("CFA", "LINEAR_RAW"):
            return read_raw(path)
        _check(path, page, name)
        orientation = _integer(page.tags, "Orientation", 1)
        orientation = orientation if orientation in range(1, 9) else 1
        notes = _page_notes(file)
        compression = getattr(page.compression, "name", str(page.compression))
        whole_bytes = page.bitspersample in (8, 16, 32, 64)
        if name in ("YCBCR", "SEPARATED") or (compression not in (*_BY_TIFFFILE, *_BY_LIBTIFF) and page.bitspersample <= 8):
            found = read_by_pillow(path, "TIFF")
            # Pillow has turned it already.
            return Pixels(as_stored(found.samples, orientation), orientation, found.profile, found.srgb, (*notes, *found.notes))
        if compression in _BY_TIFFFILE and page.predictor in (1, 2) and (whole_bytes or page.bitspersample == 1):
            values = np.asarray(page.asarray())
        elif compression in _BY_LIBTIFF and whole_bytes and page.predictor in (1, 2, 3):
            values = _by_libtiff(path, file, page)
        elif page.bitspersample <= 8:
            found = read_by_pillow(path, "TIFF")
            return Pixels(as_stored(found.samples, orientation), orientation, found.profile, found.srgb, (*notes, *found.notes))
        else:
            raise FileError(
                f"{path}: {page.bitspersample} bits compressed as {compression} are not read; save it uncompressed, or with LZW"
            )
        profile, srgb = _profile(page)
        colormap = page.colormap
    if values.ndim == 3 and page.planarconfig.name == "SEPARATE" and page.samplesperpixel > 1:
        values = np.moveaxis(values, 0, 2)
    if name == "PALETTE":
        if colormap is None or values.dtype != np.uint8:
            raise FileError(f"{path}: is damaged: it has a palette, but no 8-bit indices into one")
        values = (np.asarray(colormap) >> 8).astype(np.uint8).T[values]
    if values.dtype.kind == "b":
        values = values.astype(np.uint8) * np.uint8(255)
    if name == "MINISWHITE" and values.dtype.kind == "u":
        values = np.iinfo(values.dtype).max - values
    if values.ndim == 3 and values.shape[2] == 2:
        values = _gray_and_alpha(path, page, values)
    return Pixels(values, orientation, profile, srgb, notes)


def _check(path: Path, page: Any, name: str) -> None:
    """Raise unless the page can be pixels, and of a size that fits into memory and into the file."""
    if name not in _COLORS:
        raise FileError(f"{path}: stores colours as {name}; save it as grey or RGB")
    if page.dtype is None:
        raise FileError(f"{path}: has samples of {page.bitspersample} bits that are not read; save 8 or 16 bits, or floats")
    kind = np.dtype(page.dtype)
    if kind.kind not in "biuf":
        what = "complex values" if kind.kind == "c" else f"samples of type {kind}"
        raise FileError(f"{path}: holds {what}; an image holds real numbers")
    if page.imagewidth < 1 or page.imagelength < 1 or page.imagedepth != 1 or not 1 <= page.samplesperpixel <= 64:
        raise FileError(
            f"{path}: is {page.imagewidth} x {page.imagelength} x {page.imagedepth} samples in {page.samplesperpixel} channels; "
            "an image is flat and has 1 to 4"
        )
    check_image_memory(path, page.imagewidth, page.imagelength, page.samplesperpixel, kind.itemsize)
    needed = page.imagewidth * page.imagelength * page.samplesperpixel * page.bitspersample // 8
    if getattr(page.compression, "name", "") == "NONE" and needed > os.path.getsize(path):
        raise FileError(f"{path}: is cut short: it holds less than its {page.imagewidth} x {page.imagelength} pixels")


def _page_notes(file: Any) -> tuple[str, ...]:
    """Return what is to be said of further images in the file; smaller copies of the first are none."""
    others = 0
    for number, page in enumerate(file.pages):
        if number == 1000:
            break
        subfile = getattr(page, "subfiletype", 0) or 0
        others += number > 0 and not int(subfile) & 1
    if not others:
        return ()
    return (f"holds {others + 1} pages; the first is read",)


def _integer(tags: Any, name: str, fallback: int) -> int:
    tag = tags.get(name)
    value = None if tag is None else tag.value
    return int(value) if isinstance(value, int) else fallback


def _profile(page: Any) -> tuple[Any, bool]:
    """Return the profile of colours that are not sRGB's, and whether the file says that they are."""
    tag = page.tags.get("InterColorProfile")
    if tag is not None and isinstance(tag.value, bytes):
        profile = read_profile(tag.value)
        if profile is None:
            return None, False
        return (None, True) if profile.is_srgb else (profile, False)
    tag = page.tags.get("ExifTag")
    exif = tag.value if tag is not None and isinstance(tag.value, Mapping) else {}
    if exif.get("InteroperabilityTag") and "R03" in str(exif["InteroperabilityTag"]):
        return ADOBE_RGB, False
    return None, exif.get("ColorSpace") == 1


def _gray_and_alpha(path: Path, page: Any, values: Array) -> Array:
    """Return grey and alpha as colour and alpha."""
    extra = [int(e) for e in page.extrasamples]
    if extra not in ([1], [2]):
        raise FileError(f"{path}: has 2 channels, neither of them alpha; an image has 1, 3 or 4")
    return np.stack([values[..., 0]] * 3 + [values[..., 1]], axis=-1)


def _by_libtiff(path: Path, file: Any, page: Any) -> Array:
    """Return a page whose strips or tiles libtiff decompresses, as (H, W, C), or (C, H, W) where channels are apart.

    Pillow, which brings libtiff, can't return all kinds of samples, but it can return bytes: each strip or tile is handed to it
    as a grey image of as many bytes in a row.
    """
    kind = np.dtype(page.dtype).newbyteorder(page.parent.byteorder)
    apart = page.planarconfig.name == "SEPARATE" and page.samplesperpixel > 1
    planes, channels = (page.samplesperpixel, 1) if apart else (1, page.samplesperpixel)
    height, width = page.imagelength, page.imagewidth
    tile_rows, tile_columns = (page.tilelength, page.tilewidth) if page.is_tiled else (min(page.rowsperstrip, height), width)
    if not 1 <= tile_rows <= 2**20 or not 1 <= tile_columns <= 2**20:
        raise FileError(f"{path}: is damaged: its tiles are {tile_columns} x {tile_rows} pixels")
    # A tile is decompressed whole, even if it is larger than the image.
    check_image_memory(path, tile_columns, tile_rows, channels, kind.itemsize)
    down, across = -(-height // tile_rows), -(-width // tile_columns)
    if not len(page.dataoffsets) == len(page.databytecounts) == planes * down * across:
        raise FileError(f"{path}: is damaged: it has {len(page.dataoffsets)} strips or tiles, not {planes * down * across}")
    result = np.zeros((planes, height, width, channels), kind)
    for number, (offset, count) in enumerate(zip(page.dataoffsets, page.databytecounts, strict=True)):
        plane, place = divmod(number, down * across)
        y, x = place // across * tile_rows, place % across * tile_columns
        rows = tile_rows if page.is_tiled else min(tile_rows, height - y)
        file.filehandle.seek(offset)
        data = _decompressed(file.filehandle.read(count), rows, tile_columns * channels * kind.itemsize, page)
        tile = _without_predictor(data, (rows, tile_columns, channels), kind, page.predictor)
        part = result[plane, y : y + rows, x : x + tile_columns]
        part[:] = tile[: part.shape[0], : part.shape[1]]
    native = result.astype(kind.newbyteorder("="), copy=False)
    return native[:, :, :, 0] if apart else (native[0] if channels > 1 else native[0, :, :, 0])


def _decompressed(data: bytes, rows: int, row_bytes: int, page: Any) -> Array:
    """Return (rows, row_bytes) uint8."""
    from PIL import Image

    # A little TIFF: header, data, directory of width, length, bits, compression, colour, offset, orders, rows and bytes.
    directory = 8 + len(data) + len(data) % 2
    entries = [
        (256, row_bytes),
        (257, rows),
        (258, 8),
        (259, int(page.compression)),
        (262, 1),
        (266, int(page.fillorder)),
        (273, 8),
        (277, 1),
        (278, rows),
        (279, len(data)),
    ]
    little = struct.pack("<2sHI", b"II", 42, directory) + data + b"\0" * (len(data) % 2) + struct.pack("<H", len(entries))
    little += b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in entries) + b"\0\0\0\0"
    with Image.open(io.BytesIO(little), formats=["TIFF"]) as image:
        return np.asarray(image)


def _without_predictor(data: Array, shape: tuple[int, int, int], kind: Any, predictor: int) -> Array:
    """Return samples (rows, columns, channels) from decompressed bytes (TIFF 6.0, section 14; Adobe's technical note 3)."""
    rows, _, channels = shape
    if predictor == 3:
        # Bytes of a row are differences; summed up, they are the samples' most significant bytes, then the next ones.
        summed = np.cumsum(data.reshape(rows, -1, channels), axis=1, dtype=np.uint8).reshape(rows, kind.itemsize, -1)
        big = np.ascontiguousarray(np.swapaxes(summed, 1, 2)).view(kind.newbyteorder(">"))
        return np.asarray(big.reshape(shape).astype(kind))
    samples = np.ascontiguousarray(data).view(kind).reshape(shape)
    if predictor == 2:
        unsigned = samples.view(np.dtype(f"u{kind.itemsize}").newbyteorder(kind.byteorder))
        whole = np.cumsum(unsigned, axis=1, dtype=f"u{kind.itemsize}")
        samples = whole.view(kind.newbyteorder("="))
    return samples
