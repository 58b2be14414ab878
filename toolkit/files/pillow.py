"""Images that Pillow reads: PNG, JPEG, WebP, BMP, TGA, JPEG 2000."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError
from intaglio.files.color_profiles import ADOBE_RGB, ColorProfile, read_profile
from intaglio.files.pixels import Pixels, check_image_memory
from intaglio.render import mitsuba

# The names Pillow has for formats, by ours.
_FORMATS = {
    "PNG": ["PNG"],
    "JPEG": ["JPEG", "MPO"],
    "TIFF": ["TIFF"],
    "WebP": ["WEBP"],
    "BMP": ["BMP"],
    "TGA": ["TGA"],
    "JPEG 2000": ["JPEG2000"],
}

_ORIENTATION, _EXIF, _INTEROPERABILITY, _COLOR_SPACE = 0x0112, 0x8769, 0xA005, 0xA001


def read_by_pillow(path: Path, kind: str) -> Pixels:
    """Read the first image of a file of the given kind."""
    with _opened(path, kind) as image:
        deep = _too_deep(path, kind, image)
        width, height = image.size
        channels = 3 if image.mode == "P" else len(image.getbands())
        check_image_memory(path, width, height, channels, 2 if deep else 1)
        notes = []
        frames = getattr(image, "n_frames", 1) if kind in ("PNG", "WebP") else 1
        if frames > 1:
            notes.append(f"holds {frames} frames; the first is read")
        # Of a PNG, Pillow decodes the pixels to see whether EXIF follows them; it must not in vain.
        orientation, by_exif = (1, None) if deep and "exif" not in image.info else _exif(image)
        profile, srgb, convert = _profile(image)
        if by_exif is not None and profile is None and not srgb:
            profile, srgb = (ADOBE_RGB, False) if by_exif == "adobe" else (None, True)
        if image.mode in ("CMYK", "LAB", "HSV") or convert:
            samples = _converted(path, image)
            notes.append(f"stores {image.mode} colours; they are converted to sRGB by the file's profile")
            profile, srgb = None, True
        elif deep:
            samples = _sixteen_bits(path)
        else:
            samples = _samples(image)
    if profile is not None and (profile.matrix is None) != (samples.ndim == 2):
        profile = None  # a profile for grey in a colour image, or the other way round, says nothing
    return Pixels(samples, orientation, profile, srgb, tuple(notes))


@contextmanager
def _opened(path: Path, kind: str) -> Iterator[Any]:
    """Open an image with Pillow, without Pillow's limit of size: there is one of memory."""
    from PIL import Image

    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        with Image.open(path, formats=_FORMATS[kind]) as image:
            yield image
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def _samples(image: Any) -> Array:
    """Return 8-bit grey, colour, or colour with alpha; 16-bit grey; or what the image has."""
    mode = image.mode
    if mode.startswith("I;16"):
        return np.asarray(image).astype(np.uint16, copy=False)
    if mode in ("I", "F"):
        return np.asarray(image)
    alpha = "A" in mode or "a" in mode or "transparency" in image.info
    gray = mode in ("1", "L")
    return np.asarray(image.convert("RGBA" if alpha else "L" if gray else "RGB"))


def _too_deep(path: Path, kind: str, image: Any) -> bool:
    """Whether the file holds 16 bits per channel in colour, which Pillow would silently read as 8 bits."""
    if kind == "PNG":
        with open(path, "rb") as file:
            head = file.read(26)
        # Byte 24 is the depth, byte 25 the kind of colour: 0 is grey.
        return head[24] == 16 and head[25] != 0
    if kind == "JPEG 2000" and image.mode not in ("L", "I;16"):
        with open(path, "rb") as file:
            head = file.read(4096)
        at = head.find(b"\xff\x4f\xff\x51")
        # The first component's depth less one, and its sign (ISO 15444-1, A.5.1).
        bits = (head[at + 42] & 0x7F) + 1 if 0 <= at < len(head) - 42 else 8
        if bits > 8:
            raise FileError(
                f"{path}: has {bits} bits per channel, of which JPEG 2000 in colour gives 8; convert it to TIFF or PNG"
            )
    return False


def _sixteen_bits(path: Path) -> Array:
    """Return the samples of a 16-bit PNG in colour or with alpha."""
    samples = np.asarray(mitsuba().Bitmap(str(path)))
    if samples.ndim == 3 and samples.shape[2] == 2:
        samples = np.stack([samples[..., 0]] * 3 + [samples[..., 1]], axis=-1)
    return samples


def _exif(image: Any) -> tuple[int, str | None]:
    """Return the orientation, and "srgb" or "adobe" where EXIF names the colours; damaged EXIF says nothing."""
    try:
        exif = image.getexif()
        orientation = exif.get(_ORIENTATION, 1)
        inner = exif.get_ifd(_EXIF)
        space = inner.get(_COLOR_SPACE)
        adobe = str(exif.get_ifd(_INTEROPERABILITY).get(1, "")).startswith("R03")
    except MemoryError:
        raise
    except Exception:
        return 1, None
    named = "adobe" if adobe else "srgb" if space == 1 else None
    return (orientation if orientation in range(1, 9) else 1), named


def _profile(image: Any) -> tuple[ColorProfile | None, bool, bool]:
    """Return the profile of colours other than sRGB, whether they are said to be sRGB, whether only Pillow can convert them."""
    data = image.info.get("icc_profile")
    if not isinstance(data, bytes) or len(data) < 132:
        return None, "srgb" in image.info, False
    profile = read_profile(data)
    if profile is None:
        return None, False, data[16:20] == b"RGB " and image.mode == "RGB" and b"A2B0" in data[:2000]
    return (None, True, False) if profile.is_srgb else (profile, False, False)


def _converted(path: Path, image: Any) -> Array:
    """Return colours of another kind as sRGB, by the profile in the file."""
    data = image.info.get("icc_profile")
    if not data:
        raise FileError(f"{path}: stores {image.mode} colours without a profile that says what they look like; save it as RGB")
    from PIL import ImageCms

    given = ImageCms.ImageCmsProfile(io.BytesIO(data))
    return np.asarray(ImageCms.profileToProfile(image, given, ImageCms.createProfile("sRGB"), outputMode="RGB"))
