"""Radiance pictures (.hdr): colours with a common exponent, run-length encoded."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError
from intaglio.files.pixels import Pixels, check_image_memory

# Widths outside of this are stored without run lengths by channel.
_RUNS = range(8, 0x8000)


def read_hdr(path: Path) -> Pixels:
    """Read a Radiance picture as linear float32 colours.

    References
    ----------
    Ward, "Real Pixels", Graphics Gems II, 1991; Radiance's filefmts.pdf, "Picture files (.hdr)".
    """
    data = path.read_bytes()
    head, blank, body = data.partition(b"\n\n")
    resolution, newline, body = body.partition(b"\n")
    found = re.fullmatch(rb"([-+])([XY]) (\d{1,9}) ([-+])([XY]) (\d{1,9})\s*", resolution)
    if not blank or not newline or found is None or found[2] == found[5]:
        raise FileError(f"{path}: is damaged: its header does not end in the picture's size")
    kinds = re.findall(rb"^FORMAT=\s*(\S+)", head, re.MULTILINE)
    if kinds and kinds[-1] != b"32-bit_rle_rgbe":
        raise FileError(f"{path}: stores colours as {kinds[-1].decode('ascii', 'replace')}; save it as RGB (32-bit_rle_rgbe)")
    rows, columns = int(found[3]), int(found[6])
    if rows == 0 or columns == 0:
        raise FileError(f"{path}: is damaged: it has {columns} x {rows} pixels")
    check_image_memory(path, columns, rows, 4, 4)
    # Each row takes four bytes for its beginning and two for each 127 equal values at least.
    if rows * (4 if columns in _RUNS else 1) > len(body):
        raise FileError(f"{path}: is damaged: it holds less than the {columns} x {rows} pixels of its header")
    encoded = _rows(path, body, rows, columns)
    scale = np.ldexp(np.float32(1), encoded[..., 3].astype(np.int32) - 136)
    scale[encoded[..., 3] == 0] = 0
    values = encoded[..., :3] * scale[..., None]
    for exposure in re.findall(rb"^EXPOSURE=\s*([-+.\deE]+)", head, re.MULTILINE):
        factor = _number(exposure)
        if not 0 < factor < np.inf:
            raise FileError(f"{path}: is damaged: its EXPOSURE is no number above 0")
        values /= np.float32(factor)
    # Rows usually run down and columns to the right; the header can say otherwise.
    if found[2] == b"X":
        values = np.swapaxes(values, 0, 1)
    signs = {found[2]: found[1], found[5]: found[4]}
    values = values[::-1] if signs[b"Y"] == b"+" else values
    values = values[:, ::-1] if signs[b"X"] == b"-" else values
    return Pixels(np.ascontiguousarray(values, np.float32))


def _number(text: bytes) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


def _rows(path: Path, body: bytes, rows: int, columns: int) -> Array:
    """Return the encoded pixels (rows, columns, 4) uint8."""
    pixels = np.empty((rows, columns, 4), np.uint8)
    at = 0
    for y in range(rows):
        if columns in _RUNS and body[at : at + 2] == b"\x02\x02" and at + 3 < len(body) and not body[at + 2] & 0x80:
            if (body[at + 2] << 8 | body[at + 3]) != columns:
                raise FileError(f"{path}: is damaged in row {y}")
            at = _run_lengths(path, body, at + 4, pixels[y], y)
        else:
            at = _old_row(path, body, at, pixels[y], y)
    return pixels


def _run_lengths(path: Path, body: bytes, at: int, row: Array, y: int) -> int:
    """Decode a row whose four channels are run-length encoded one after another; return where the next begins."""
    columns = len(row)
    for channel in range(4):
        line = bytearray()
        while len(line) < columns:
            count = body[at] if at < len(body) else 0
            if count > 128:
                line += body[at + 1 : at + 2] * (count - 128)
                at += 2
            else:
                line += body[at + 1 : at + 1 + count]
                at += 1 + count
            if count == 0 or at > len(body):
                raise FileError(f"{path}: is damaged in row {y}")
        if len(line) != columns:
            raise FileError(f"{path}: is damaged in row {y}")
        row[:, channel] = np.frombuffer(line, np.uint8)
    return at


def _old_row(path: Path, body: bytes, at: int, row: Array, y: int) -> int:
    """Decode a row of whole pixels, where 1, 1, 1, n repeats the one before; return where the next begins."""
    columns, x, shift = len(row), 0, 0
    while x < columns:
        pixel = body[at : at + 4]
        at += 4
        if len(pixel) < 4:
            raise FileError(f"{path}: is damaged in row {y}")
        if pixel[:3] == b"\1\1\1":
            count = pixel[3] << shift
            if x == 0 or count > columns - x:
                raise FileError(f"{path}: is damaged in row {y}")
            row[x : x + count] = row[x - 1]
            x += count
            shift = min(shift + 8, 24)
        else:
            row[x] = np.frombuffer(pixel, np.uint8)
            x += 1
            shift = 0
    return at
