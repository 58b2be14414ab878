"""Reading and writing images: linear float32 inside."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments, checked_count, checked_flag, checked_path
from intaglio.errors import FileError, InputError, IntaglioError, IntaglioWarning
from intaglio.files.color_profiles import ColorProfile
from intaglio.files.exr import read_exr_image, write_exr
from intaglio.files.hdr import read_hdr
from intaglio.files.image_kinds import image_kind
from intaglio.files.paths import check_readable, whole_file
from intaglio.files.pillow import read_by_pillow
from intaglio.files.pixels import Pixels, upright
from intaglio.files.quiet import hushed, reason
from intaglio.files.raw import read_raw
from intaglio.files.tiff import read_tiff
from intaglio.kernels.transfer import decode_srgb, encode_srgb
from intaglio.render import mitsuba


def read_image(path: PathLike, *, linear: bool | None = None, orient: bool = True) -> Array:
    """Read an image as linear float32 values.

    Parameters
    ----------
    path : path
        PNG, JPEG, TIFF (8, 16 bits or floats, however compressed), EXR, WebP, Radiance HDR, TGA, BMP, JPEG 2000, or a raw
        photograph (with the extra ``raw``). The content decides; where the name says another type, a warning tells.
    linear : bool, optional
        Whether the stored values are linear already. Default None: 8-bit values are decoded from sRGB, as cameras and
        paint programs store them, or by the colour profile in the file; so are 16-bit colours where the file says that they
        are encoded (a profile, EXIF, PNG's sRGB chunk). All others, 16-bit grey and floats among them, are taken as linear.
        Integers are scaled to [0, 1] either way.
    orient : bool, optional
        Turn the image as its EXIF orientation says, so that row 0 is the top as viewers show it. Default True; False gives
        the pixels in the order in which they are stored, as calibrations of cameras count them.

    Returns
    -------
    (H, W) or (H, W, C) float32 array
        Linear values of Rec.709; row 0 is the top. A grey image is (H, W). C is 3, or 4 with alpha, which is never decoded;
        an EXR gives its R, G, B and A, or its single channel. Of several pages, frames or parts the first is read, and a
        warning tells.

    Raises
    ------
    FileError
        If the file is missing, empty or damaged, holds no image of a known type, or an EXR has neither R, G, B nor a single
        channel.
    InputError
        If decoding it would take more memory than `--memory`, ``INTAGLIO_MEMORY`` (GiB) or half of what is available.

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
    return read_image_with_type(path, linear=linear, orient=orient)[0]


def read_image_with_type(
    path: PathLike, *, linear: bool | None = None, orient: bool = True
) -> tuple[Array, np.dtype[np.generic]]:
    """Return what `read_image` returns, and the type of the samples that the file holds."""
    pixels = _read(path)
    samples = upright(pixels.samples, pixels.orientation) if checked_flag("orient", orient) else pixels.samples
    if linear is None:
        # 16 bits in colour are encoded only where the file says so.
        said = samples.ndim == 3 and (pixels.srgb or pixels.profile is not None)
        linear = not (samples.dtype == np.uint8 or (samples.dtype == np.uint16 and said))
    return _decoded(samples, None if checked_flag("linear", linear) else pixels.profile or "srgb"), samples.dtype


def _decoded(samples: Array, encoding: ColorProfile | Literal["srgb"] | None) -> Array:
    """Return samples as linear float32; alpha is never decoded, and integers are scaled to [0, 1]."""
    if samples.ndim == 3 and samples.shape[2] == 4 and encoding is not None:
        return np.concatenate([_decoded(samples[..., :3], encoding), _decoded(samples[..., 3:], None)], axis=2)
    if encoding == "srgb" and samples.dtype == np.uint8:
        # 256 levels: a table is several times faster than as many powers as there are pixels.
        return np.ascontiguousarray(decode_srgb(np.arange(256, dtype=np.float32) / np.float32(255))[samples])
    with np.errstate(over="ignore"):
        values = samples.astype(np.float32)
    if np.issubdtype(samples.dtype, np.integer):
        values /= np.float32(np.iinfo(samples.dtype).max)
    if encoding == "srgb":
        values = decode_srgb(values)
    elif encoding is not None:
        values = encoding.linear(values)
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
    pixels = _read(path)
    if pixels.profile is not None and pixels.profile.matrix is not None:
        warnings.warn(
            f"{path}: its colour profile is {pixels.profile.name}, not sRGB; colours are taken as sRGB",
            IntaglioWarning,
            stacklevel=1,
        )
    return upright(pixels.samples, pixels.orientation) if checked_flag("orient", orient) else pixels.samples


def _read(path: PathLike) -> Pixels:
    """Read an image of any type; warn of what the user should know."""
    path = check_readable(path)
    kind = image_kind(path)
    try:
        with hushed():
            pixels = _readers[kind](path)
    except IntaglioError:
        raise
    except MemoryError as error:
        raise InputError(f"{path}: there is not enough memory to read it; give a smaller image") from error
    except Exception as error:
        raise FileError(f"{path}: is damaged, or no {kind} image that can be read ({reason(error, path)})") from error
    samples = pixels.samples
    if samples.ndim not in (2, 3) or samples.size == 0 or (samples.ndim == 3 and samples.shape[2] > 4):
        raise FileError(f"{path}: has shape {samples.shape}; an image is (H, W) or (H, W, C) with at most 4 channels")
    for note in pixels.notes:
        warnings.warn(f"{path}: {note}", IntaglioWarning, stacklevel=1)
    return replace(pixels, samples=samples[:, :, 0]) if samples.ndim == 3 and samples.shape[2] == 1 else pixels


@checked_arguments
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
    path = checked_path("path", path)
    kind = path.suffix.lower()
    quality = checked_count("quality", quality, 1, 95)
    linear = None if linear is None else checked_flag("linear", linear)
    image = _checked_image(image, path)
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
    if checked_count("bits", bits, 8, 16) not in (8, 16) or (bits == 16 and kind in (".jpg", ".jpeg")):
        raise InputError(f"{path}: {kind} does not support {bits} bits; PNG and TIFF support 8 or 16, JPEG 8")
    if linear is None:
        linear = bits == 16
    values = image[:, :, 0] if image.ndim == 3 and image.shape[2] == 1 else image
    shown = np.clip(values, 0, 1) if linear else encode_srgb(values)
    if not linear and values.ndim == 3 and values.shape[2] == 4:
        shown = np.concatenate([shown[..., :3], np.clip(values[..., 3:], 0, 1)], axis=2)
    stored = np.round(shown * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)
    _write_levels(stored, path, quality)


def _checked_image(image: Array, path: Path) -> Array:
    """Return an image as float64, or raise `InputError`."""
    try:
        array = np.asarray(image)
        if array.dtype.kind in "iu":
            raise InputError(
                f"{path}: an image holds linear values in [0, 1] as floats; divide {array.dtype} levels by their maximum"
            )
        if array.dtype.kind not in "fb":
            raise InputError(f"{path}: the image is not an array of numbers, but of {array.dtype}")
        return array.astype(np.float64)
    except (TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: the image is not an array of numbers ({reason(error)})") from error


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
    path = checked_path("path", path)
    kind = path.suffix.lower()
    quality = checked_count("quality", quality, 1, 95)
    try:
        samples = np.asarray(samples)
    except ValueError as error:
        raise InputError(f"{path}: the samples are no array of numbers ({reason(error)})") from error
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
                raise FileError(f"{path}: could not be written ({reason(error, beside)})") from error
        else:
            from PIL import Image

            if kind in (".jpg", ".jpeg") and stored.ndim == 3 and stored.shape[2] == 4:
                raise InputError(f"{path}: JPEG has no alpha channel; write PNG or drop it")
            options = {"quality": quality, "subsampling": 0} if kind in (".jpg", ".jpeg") else {}
            Image.fromarray(stored).save(beside, **options)


_readers: dict[str, Callable[[Path], Pixels]] = {
    **{kind: functools.partial(read_by_pillow, kind=kind) for kind in ("PNG", "JPEG", "WebP", "BMP", "TGA", "JPEG 2000")},
    "TIFF": read_tiff,
    "Radiance HDR": read_hdr,
    "EXR": read_exr_image,
    "raw": read_raw,
}
