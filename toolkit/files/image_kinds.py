"""Which type of image a file holds: its first bytes decide, not its name."""

from __future__ import annotations

import warnings
from pathlib import Path

from intaglio.errors import FileError, IntaglioWarning

# Suffixes that are written.
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr")

# Photographs as a camera's sensor saw them; read with the extra `raw`.
RAW_SUFFIXES = (".dng", ".nef", ".nrw", ".cr2", ".cr3", ".arw", ".orf", ".raf", ".rw2", ".pef", ".srw")

# Suffixes by type of content.
_SUFFIXES = {
    "PNG": (".png", ".apng"),
    "JPEG": (".jpg", ".jpeg", ".jpe", ".jfif", ".mpo"),
    "TIFF": (".tif", ".tiff"),
    "WebP": (".webp",),
    "Radiance HDR": (".hdr", ".rgbe", ".pic"),
    "EXR": (".exr",),
    "TGA": (".tga",),
    "BMP": (".bmp", ".dib"),
    "JPEG 2000": (".jp2", ".j2k", ".jpf", ".jpx"),
    "raw": RAW_SUFFIXES,
}

READABLE_SUFFIXES = (*IMAGE_SUFFIXES, ".tga", ".bmp", ".webp", ".hdr", ".jp2", *RAW_SUFFIXES)

_TIFF_STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")

# First bytes, and the type they begin.
_STARTS = (
    (b"\x89PNG\r\n\x1a\n", "PNG"),
    (b"\xff\xd8\xff", "JPEG"),
    *((start, "TIFF") for start in _TIFF_STARTS),
    (b"#?RADIANCE", "Radiance HDR"),
    (b"#?RGBE", "Radiance HDR"),
    (b"v/1\x01", "EXR"),
    (b"BM", "BMP"),
    (b"\0\0\0\x0cjP  \r\n\x87\n", "JPEG 2000"),
    (b"\xff\x4f\xff\x51", "JPEG 2000"),
    (b"FUJIFILMCCD-RAW", "raw"),
    (b"IIRO", "raw"),
    (b"IIRS", "raw"),
    (b"IIU\0", "raw"),
)

# What is recognised, so that the message can name it, but not read.
_OTHERS = (
    (b"GIF8", "a GIF image"),
    (b"8BPS", "a Photoshop document"),
    (b"DDS ", "a DDS texture"),
    (b"\xabKTX", "a KTX texture"),
    (b"qoif", "a QOI image"),
    (b"%PDF", "a PDF document"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"<svg", "an SVG drawing"),
    (b"<?xml", "XML"),
    (b"<!DOCTYPE", "a page of HTML"),
    (b"<html", "a page of HTML"),
    (b"ply", "a PLY mesh"),
    (b"version https://git-lfs", "a pointer of Git LFS, not the image itself"),
)


def image_kind(path: Path) -> str:
    """Return the type of image that a file holds, one of the keys of `_SUFFIXES`; warn if its name says another.

    Raises
    ------
    FileError
        If the file begins like none of them.
    """
    with open(path, "rb") as file:
        start = file.read(64)
    suffix = path.suffix.lower()
    kind = next((kind for begin, kind in _STARTS if start.startswith(begin)), None)
    if start[:4] == b"RIFF" and start[8:12] == b"WEBP":
        kind = "WebP"
    if start[4:12] == b"ftypcrx " or (kind == "TIFF" and suffix in RAW_SUFFIXES):
        kind = "raw"
    if kind is None and suffix in _SUFFIXES["TGA"] and _is_tga(start):
        # Targa has no first bytes of its own.
        kind = "TGA"
    if kind is None:
        raise FileError(f"{path}: {_otherwise(start)}; known: PNG, JPEG, TIFF, EXR, WebP, HDR, TGA, BMP, JPEG 2000, raw")
    known = [s for suffixes in _SUFFIXES.values() for s in suffixes]
    if suffix in known and suffix not in _SUFFIXES[kind]:
        # Reported where it is found, so that Python shows it once of a file that is read several times.
        article = "an" if kind == "EXR" else "a"
        warnings.warn(f"{path}: is named {suffix}, but holds {article} {kind} image; read as that", IntaglioWarning, stacklevel=1)
    return kind


def _is_tga(start: bytes) -> bool:
    """Whether the 18 bytes of a Targa header make sense: kind of palette, kind of image, bits per pixel."""
    return len(start) >= 18 and start[1] in (0, 1) and start[2] in (1, 2, 3, 9, 10, 11) and start[16] in (1, 8, 15, 16, 24, 32)


def _otherwise(start: bytes) -> str:
    if start[4:8] == b"ftyp":
        brand = start[8:12].decode("ascii", "replace")
        return "is AVIF, which is not read" if brand.startswith("avi") else "is HEIC or video, which is not read"
    for begin, name in _OTHERS:
        if start.lstrip().startswith(begin):
            return (
                f"is {name}, no image that can be read" if name != "a pointer of Git LFS, not the image itself" else f"is {name}"
            )
    return "is no image of a known type"
