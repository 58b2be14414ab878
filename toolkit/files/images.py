"""Reading and writing images: linear float32 inside."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.errors import FileError, InputError
from intaglio.files.exr import read_exr, write_exr
from intaglio.files.paths import check_readable, whole_file
from intaglio.kernels.transfer import decode_srgb, encode_srgb
from intaglio.render import mitsuba

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr")
READABLE_SUFFIXES = (*IMAGE_SUFFIXES, ".tga", ".bmp")


def read_image(path: PathLike, *, linear: bool | None = None, orient: bool = True) -> Array:
    """Read an image as linear float32 values.

    Parameters
    ----------
    path : path
        PNG, JPEG, TIFF, TGA or BMP with 8 or 16 bits per channel (or a float TIFF), or EXR; the suffix decides.
    linear : bool, optional
        Whether the stored values are linear already. Default None: 8-bit values are decoded from sRGB, as cameras and
        paint programs store them; 16-bit and float values are taken as linear. Integers are scaled to [0, 1] either way.
    orient : bool, optional
        Turn the image as its EXIF orientation says, so that row 0 is the top as viewers show it. Default True; False gives
        the pixels in the order in which they are stored, as calibrations of cameras count them.

    Returns
    -------
    (H, W) or (H, W, C) float32 array
        Linear values; row 0 is the top. A grey image is (H, W). C is 3, or 4 with alpha, which is never decoded; an EXR
        gives its R, G, B and A, or its single channel.

    Raises
    ------
    FileError
        If the file is missing, empty or damaged, its suffix is unknown or its content of another type, a TIFF has several
        pages, or an EXR has neither R, G, B nor a single channel.

    See Also
    --------
    intaglio.read_exr : All channels of an EXR, by name.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> ramp = np.linspace(0, 1, 5)[None, :] * np.ones((2, 1))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     intaglio.write_image(ramp, f"{folder}/ramp.png")
    ...     decoded = intaglio.read_image(f"{folder}/ramp.png")
    ...     stored = intaglio.read_image(f"{folder}/ramp.png", linear=True)
    >>> decoded.shape, decoded.dtype
    ((2, 5), dtype('float32'))
    >>> decoded[0].round(2)
    array([0.  , 0.25, 0.5 , 0.75, 1.  ], dtype=float32)
    >>> stored[0].round(2)
    array([0.  , 0.54, 0.74, 0.88, 1.  ], dtype=float32)
    """
    raw = read_samples(path, orient=orient)
    if linear is None:
        linear = raw.dtype != np.uint8
    if raw.dtype == np.uint8 and not linear:
        # 256 levels: a table is several times faster than as many powers as there are pixels.
        values = decode_srgb(np.arange(256, dtype=np.float32) / np.float32(255))[raw]
        if raw.ndim == 3 and raw.shape[2] == 4:
            values[..., 3] = raw[..., 3].astype(np.float32) / np.float32(255)
        return np.ascontiguousarray(values)
    values = raw.astype(np.float32)
    if np.issubdtype(raw.dtype, np.integer):
        values /= np.float32(np.iinfo(raw.dtype).max)
    if not linear:
        has_alpha = values.ndim == 3 and values.shape[2] == 4
        decoded = decode_srgb(values[..., :3] if has_alpha else values)
        values = np.concatenate([decoded, values[..., 3:]], axis=2) if has_alpha else decoded
    return np.ascontiguousarray(values, np.float32)


def read_samples(path: PathLike, *, orient: bool = True) -> Array:
    """Read an image's samples as they are stored.

    Parameters
    ----------
    path : path
        An image of any type that `read_image` knows.
    orient : bool, optional
        Turn the image as its EXIF orientation says; default True.

    Returns
    -------
    (H, W) or (H, W, C) array
        Integers or floats, of the type that the file holds; row 0 is the top.

    Raises
    ------
    FileError
        If the file is missing, damaged, or of no known kind.
    """
    path = check_readable(path)
    reader = _readers.get(path.suffix.lower())
    if reader is None:
        raise FileError(f"{path}: unknown image type {path.suffix!r}; known: {', '.join(sorted(_readers))}")
    try:
        raw = reader(path)
    except FileError:
        raise
    except Exception as error:
        raise FileError(f"{path}: can't be read as a {path.suffix[1:].upper()} image ({error})") from error
    if raw.ndim not in (2, 3) or raw.size == 0 or (raw.ndim == 3 and raw.shape[2] > 4):
        raise FileError(f"{path}: has shape {raw.shape}; an image is (H, W) or (H, W, C) with at most 4 channels")
    if raw.ndim == 3 and raw.shape[2] == 1:
        raw = raw[:, :, 0]
    return _upright(raw, _orientation(path)) if orient else raw


def _orientation(path: Path) -> int:
    """Return the EXIF orientation of an image, from 1 (as stored) to 8."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            found = image.getexif().get(0x0112, 1)
    except Exception:  # an image that Pillow does not know has no EXIF that it could read
        return 1
    return found if found in range(1, 9) else 1


def _upright(pixels: Array, orientation: int) -> Array:
    """Return (H, W, ...) pixels turned as an EXIF orientation says."""
    if orientation >= 5:
        pixels = np.swapaxes(pixels, 0, 1)
    if orientation in (3, 4, 7, 8):
        pixels = pixels[::-1]
    if orientation in (2, 3, 6, 7):
        pixels = pixels[:, ::-1]
    return np.ascontiguousarray(pixels)


def write_image(image: Array, path: PathLike, *, bits: int = 8, linear: bool | None = None, quality: int = 95) -> None:
    """Write linear values to an image file.

    Parameters
    ----------
    image : (H, W) or (H, W, C) float array
        Linear values with C = 1, 3 or 4 channels; clipped to [0, 1] in all types but EXR. Row 0 is the top, a fourth
        channel is alpha.
    path : path
        The file; its suffix decides the type: .png, .jpg, .jpeg, .tif, .tiff, .exr. It appears whole, or stays as it was.
    bits : {8, 16}, optional
        Bits per channel of PNG and TIFF. Default 8, which every viewer shows; JPEG always has 8, and EXR 32-bit floats.
    linear : bool, optional
        Store the linear values as they are instead of encoding them to sRGB. Default None: 8-bit images are encoded, as
        viewers expect, all others are stored linear, as programs that read maps and heights expect.
    quality : int, optional
        Quality of JPEG from 1 to 95. Default 95, at which blocks can't be seen.

    Raises
    ------
    InputError
        For a shape that is no image, integers, values that are not finite, or bits that the type does not have.
    FileError
        If the suffix is unknown or the file can't be written.

    See Also
    --------
    intaglio.write_exr : Named channels and a header.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> height = np.array([[0.0, 0.25], [0.5, 1.0]])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = f"{folder}/height.png"
    ...     intaglio.write_image(height, path, bits=16)
    ...     back = intaglio.read_image(path)
    >>> np.allclose(back, height, atol=1 / 65535)
    True
    """
    path = Path(path)
    kind = path.suffix.lower()
    try:
        image = np.asarray(image)
        if np.issubdtype(image.dtype, np.integer):
            raise InputError(
                f"{path}: an image holds linear values in [0, 1] as floats; divide {image.dtype} levels by their maximum"
            )
        image = image.astype(np.float64)
    except (TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: the image is not an array of numbers ({error})") from error
    if image.ndim not in (2, 3) or image.size == 0 or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)):
        raise InputError(f"{path}: an image is (H, W) or (H, W, 1, 3 or 4), not {image.shape}")
    if not (np.abs(image) <= float(np.finfo(np.float32).max)).all():
        raise InputError(f"{path}: the image has values that are not finite or too large for single precision")
    if kind == ".exr":
        names = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}
        planes = image[:, :, None] if image.ndim == 2 else image
        write_exr({n: planes[:, :, i] for i, n in enumerate(names[planes.shape[2]])}, path)
        return
    if kind not in (".png", ".jpg", ".jpeg", ".tif", ".tiff"):
        raise FileError(f"{path}: unknown image type {kind!r}; known: .png, .jpg, .jpeg, .tif, .tiff, .exr")
    if bits not in (8, 16) or (bits == 16 and kind in (".jpg", ".jpeg")):
        raise InputError(f"{path}: {kind} does not support {bits} bits; PNG and TIFF support 8 or 16, JPEG 8")
    if linear is None:
        linear = bits == 16
    values = image[:, :, 0] if image.ndim == 3 and image.shape[2] == 1 else image
    shown = np.clip(values, 0, 1) if linear else encode_srgb(values)
    if not linear and values.ndim == 3 and values.shape[2] == 4:
        shown = np.concatenate([shown[..., :3], np.clip(values[..., 3:], 0, 1)], axis=2)
    stored = np.round(shown * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)
    _write_levels(stored, path, quality)


def write_samples(samples: Array, path: PathLike, *, quality: int = 95) -> None:
    """Write an image's samples as they are.

    Parameters
    ----------
    samples : (H, W) or (H, W, C) array
        What `read_samples` returns. PNG and TIFF hold 8- and 16-bit integers, JPEG 8-bit ones; EXR holds linear floats,
        for which 8-bit samples are decoded from sRGB.
    path : path
        The file; its suffix decides the type.
    quality : int, optional
        Quality of JPEG from 1 to 95. Default 95.

    Raises
    ------
    InputError
        For a shape that is no image, or samples that the type can't hold.
    FileError
        If the file can't be written, or is of no known kind.
    """
    path = Path(path)
    kind = path.suffix.lower()
    samples = np.asarray(samples)
    if samples.ndim not in (2, 3) or samples.size == 0 or (samples.ndim == 3 and samples.shape[2] not in (1, 3, 4)):
        raise InputError(f"{path}: an image is (H, W) or (H, W, 1, 3 or 4), not {samples.shape}")
    if kind == ".exr":
        # EXR holds linear values; 8-bit samples are sRGB.
        values = samples.astype(np.float32)
        if samples.dtype.kind in "iu":
            values /= np.float32(np.iinfo(samples.dtype).max)
        if samples.dtype == np.uint8:
            has_alpha = values.ndim == 3 and values.shape[2] == 4
            values = np.dstack([decode_srgb(values[:, :, :3]), values[:, :, 3:]]) if has_alpha else decode_srgb(values)
        write_image(values, path)
        return
    if kind not in (".png", ".jpg", ".jpeg", ".tif", ".tiff"):
        raise FileError(f"{path}: unknown image type {kind!r}; known: .png, .jpg, .jpeg, .tif, .tiff, .exr")
    if samples.dtype not in (np.uint8, np.uint16) or (samples.dtype == np.uint16 and kind in (".jpg", ".jpeg")):
        raise InputError(f"{path}: {kind} can't hold {samples.dtype} samples; write {'.png' if kind[1] == 'j' else '.exr'}")
    _write_levels(samples[:, :, 0] if samples.ndim == 3 and samples.shape[2] == 1 else samples, path, quality)


def _write_levels(stored: Array, path: Path, quality: int) -> None:
    """Write 8- or 16-bit levels (H, W), (H, W, 3) or (H, W, 4)."""
    kind = path.suffix.lower()
    with whole_file(path) as beside:
        if kind in (".tif", ".tiff"):
            import tifffile

            photometric = "rgb" if stored.ndim == 3 else "minisblack"
            tifffile.imwrite(beside, stored, photometric=photometric)
        elif stored.dtype == np.uint16:
            # Pillow does not support 16-bit colour and would silently write 8 bits.
            try:
                mitsuba().Bitmap(np.ascontiguousarray(stored)).write(str(beside))
            except RuntimeError as error:
                raise FileError(f"{path}: could not be written ({error})") from error
        else:
            from PIL import Image

            if kind in (".jpg", ".jpeg") and stored.ndim == 3 and stored.shape[2] == 4:
                raise InputError(f"{path}: JPEG has no alpha channel; write PNG or drop it")
            options = {"quality": quality, "subsampling": 0} if kind in (".jpg", ".jpeg") else {}
            Image.fromarray(stored).save(beside, **options)


def _read_png(path: Path) -> Array:
    with open(path, "rb") as file:
        head = file.read(26)
    if head[:8] != b"\x89PNG\r\n\x1a\n":
        raise FileError(f"{path}: is named .png, but its content is not PNG")
    if head[24] == 16:
        # Pillow silently reads 16-bit colour as 8 bits.
        return np.asarray(mitsuba().Bitmap(str(path)))
    with _open_checked(path, "PNG") as image:
        has_alpha = "A" in image.mode or "transparency" in image.info
        gray = image.mode in ("1", "L", "LA") and not has_alpha
        return np.asarray(image.convert("L" if gray else "RGBA" if has_alpha else "RGB"))


def _read_jpeg(path: Path) -> Array:
    with _open_checked(path, "JPEG") as image:
        return np.asarray(image.convert("L" if image.mode == "L" else "RGB"))


def _read_by_pillow(path: Path) -> Array:
    with _open_checked(path, path.suffix[1:].upper()) as image:
        has_alpha = "A" in image.mode
        return np.asarray(image.convert("L" if image.mode in ("1", "L") else "RGBA" if has_alpha else "RGB"))


@contextmanager
def _open_checked(path: Path, kind: str) -> Iterator[Any]:
    """Open an image with Pillow, without its limit of size, if the content is of the type that the name says."""
    from PIL import Image

    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        with Image.open(path) as image:
            if image.format not in (kind, "MPO" if kind == "JPEG" else kind):
                raise FileError(f"{path}: is named {path.suffix}, but its content is {image.format}, not {kind}")
            yield image
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def _read_tiff(path: Path) -> Array:
    import tifffile

    with tifffile.TiffFile(path) as file:
        page = file.pages.first
        if len(file.pages) != 1:
            raise FileError(f"{path}: holds {len(file.pages)} pages; an image has one")
        name = page.photometric.name
        if name not in ("MINISBLACK", "MINISWHITE", "RGB"):
            raise FileError(f"{path}: stores colours as {name}; save it as grey or RGB")
        values = np.asarray(page.asarray())
        if values.ndim == 3 and page.planarconfig.name == "SEPARATE":
            values = np.moveaxis(values, 0, 2)
    if name == "MINISWHITE" and values.dtype.kind in "ub":
        values = ~values if values.dtype.kind == "b" else np.iinfo(values.dtype).max - values
    return values


def _read_exr_image(path: Path) -> Array:
    channels, _ = read_exr(path)
    if {"R", "G", "B"} <= channels.keys():
        names = ["R", "G", "B", *(["A"] if "A" in channels else [])]
        return np.stack([channels[n] for n in names], axis=-1)
    if len(channels) == 1:
        return next(iter(channels.values()))
    raise FileError(f"{path}: has channels {', '.join(sorted(channels))}, no R, G, B; read them by name with read_exr")


_readers: dict[str, Callable[[Path], Array]] = {
    ".png": _read_png,
    ".jpg": _read_jpeg,
    ".jpeg": _read_jpeg,
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
    ".exr": _read_exr_image,
    ".tga": _read_by_pillow,
    ".bmp": _read_by_pillow,
}
