"""Reading stacks from .lp files and from folders with a lights.csv or plain tables of light directions."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.errors import FileError, InputError
from intaglio.files import READABLE_SUFFIXES, check_readable, read_image, read_samples
from intaglio.kernels.transfer import decode_srgb
from intaglio.photometric.light_positions import read_light_positions, read_lights_csv, read_table
from intaglio.photometric.mirror_sphere import lights_from_sphere
from intaglio.photometric.stack import ImageFiles, PhotometricStack

# Stacks up to this many bytes are held in memory as float32.
MEMORY_BYTES = 1 << 31

STACK_SUFFIXES = (".lp", ".csv", ".txt")
# Files with these names are not photographs of the stack: a mask, a sphere's reference, or maps that were written there.
_NO_IMAGES = ("mask", "ref", "normal", "albedo", "height", "maps")
_LIGHT_FILES = ("lights.csv", "light_directions.txt", "lights.txt")


def read_stack(
    path: PathLike,
    response: str | float | None = None,
    *,
    mask: PathLike | Array | None = None,
    intensities: PathLike | None = None,
    sphere: PathLike | None = None,
    circle: tuple[float, float, float] | None = None,
    gray: bool = False,
    memory: int = MEMORY_BYTES,
) -> PhotometricStack:
    r"""Read photographs of one scene under known lights.

    Parameters
    ----------
    path : path
        One of these:

        * an .lp file: a line ``name x y z`` for each image, with or without the number of images in the first line; names
          are relative to the file, and lines without names take the folder's images in order;
        * a ``lights.csv``: image and tilt, slant in degrees, or image and x, y, z;
        * a table of light directions (``light_directions.txt``, 3 x K or K x 3). Beside it, ``filenames.txt`` may name the
          images; without it they are those of the folder, or of its one subfolder that holds K of them (of several, the one
          named images or objects), in natural order;
        * a folder that holds one of them.
    response : {"linear", "srgb"} or float, optional
        How stored values depend on light: in proportion; encoded by sRGB; or with an exponent (linear = stored ** gamma,
        such as 2.2). Default None: 8-bit values are decoded from sRGB, 16-bit and float values are linear.
    mask : path or (H, W) array, optional
        Pixels to use: values over one half. Default None: ``mask.png`` beside the lights, if there is one, else all.
    intensities : path, optional
        Table of the lights' strengths, K x 1 or K x 3 (a column per channel), by which images are divided. Default None:
        ``light_intensities.txt`` beside the lights, if there is one.
    sphere : path, optional
        Folder with a picture of a mirror sphere per image, in the same order, from which the lights are computed; ``path`` is
        then the folder of the images, which may be the same one if the sphere is in the photographs. Default None: the
        lights come from ``path``. See `lights_from_sphere`.
    circle : (float, float, float), optional
        Centre x, y and radius of the sphere's outline in pixels of its pictures, from the upper left. Default None: found by
        `fit_circle`, which needs a sphere that fills a good part of its pictures.
    gray : bool, optional
        Take the mean of the channels. Default False.
    memory : int, optional
        Stacks of more bytes (as float32) stay on disk and are read one image at a time. Default 2 GiB.

    Returns
    -------
    PhotometricStack
        Linear values divided by the lights' strengths; its ``names`` are the files, its ``notes`` say what was found.

    Raises
    ------
    FileError
        If a file is missing (all that are missing are listed), damaged, or of an unknown type.
    InputError
        If the numbers of lights and images differ, images differ in size, a light is not a direction, a folder holds several
        lists of lights, or ``response`` is unknown.
    FitError
        If no sphere is found in its pictures.

    Examples
    --------
    >>> import pathlib
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name, value in (("a", 0.25), ("b", 0.5)):
    ...         intaglio.write_image(np.full((4, 6), value), f"{folder}/{name}.png", bits=16)
    ...     _ = pathlib.Path(folder, "capture.lp").write_text("a.png 0 0 1\nb.png 0.6 0 0.8\n")
    ...     stack = intaglio.read_stack(f"{folder}/capture.lp")
    >>> stack.shape
    (2, 4, 6, 1)
    >>> stack.lights
    array([[0. , 0. , 1. ],
           [0.6, 0. , 0.8]])
    >>> stack.image(1)[0, 0].round(3)
    array([0.5], dtype=float32)
    """
    decode_value = _response(response)
    folder, names, lights, source = _lights(Path(path), sphere, circle)
    paths = _image_paths(folder, names, len(lights), source)
    missing = [p for p in paths if not p.exists()]
    if missing:
        listed = ", ".join(str(p) for p in missing[:8]) + (f" and {len(missing) - 8} more" if len(missing) > 8 else "")
        raise FileError(f"{source}: {len(missing)} of its {len(paths)} images are missing: {listed}")
    first = read_samples(paths[0])
    if first.dtype.kind != "f" and first.dtype not in (np.uint8, np.uint16):
        raise FileError(f"{paths[0]}: holds {first.dtype} values; images of 8 or 16 bits, or floats, are needed")
    channels = 1 if first.ndim == 2 or first.shape[2] <= 2 else 3
    strengths = folder / "light_intensities.txt" if intensities is None else Path(intensities)
    gain = _gain(strengths, len(lights)) if intensities is not None or strengths.exists() else None
    if gain is not None and gain.shape[1] == 3:
        channels = 3
    shape = (len(paths), first.shape[0], first.shape[1], 1 if gray else channels)
    files = ImageFiles(tuple(paths), shape, first.dtype, decode_value, gain, (1 / 3, 1 / 3, 1 / 3) if gray else None)
    known, notes = _mask(folder, mask)
    labels = tuple(str(p) for p in paths)
    ceiling: Array | float = 1.0 if first.dtype.kind == "u" else np.inf
    if gain is not None and np.isfinite(ceiling):
        ceiling = gain.mean(axis=1, keepdims=True) if gray else gain
    if 4 * math.prod(shape) > memory:
        notes = (*notes, f"the stack is {4 * math.prod(shape) / 2**30:.1f} GiB: images are read one at a time")
        return PhotometricStack(files, lights, known, labels, notes, ceiling)
    images = np.empty(shape, np.float32)
    for k in range(shape[0]):
        images[k] = files.read(k)
    return PhotometricStack(images, lights, known, labels, notes, ceiling)


def _lights(
    path: Path, sphere: PathLike | None, circle: tuple[float, float, float] | None
) -> tuple[Path, list[str], Array, Path]:
    """Return the folder of the images, their names (may be empty), the lights, and the file that gave them."""
    if sphere is not None:
        if not path.is_dir():
            raise FileError(f"{path}: with a sphere's pictures, give the folder of the images")
        pictures = _images_of(Path(sphere))
        if not pictures:
            raise FileError(f"{sphere}: holds no pictures of a sphere")
        count = len(_images_of(path))
        if len(pictures) != count:
            raise InputError(f"{sphere}: holds {len(pictures)} pictures of a sphere for {count} images in {path}; give one each")
        found = lights_from_sphere([read_image(p, linear=True) for p in pictures], circle)
        return path, [], found.lights, Path(sphere)
    if circle is not None:
        raise InputError("a circle outlines a mirror sphere: give the folder of its pictures as well")
    if path.is_dir():
        candidates = [path / n for n in _LIGHT_FILES if (path / n).exists()] or sorted(path.glob("*.lp"))
        if not candidates:
            raise FileError(f"{path}: holds neither an .lp file nor any of {', '.join(_LIGHT_FILES)}")
        if len(candidates) > 1:
            listed = ", ".join(p.name for p in candidates)
            raise InputError(f"{path}: holds more than one file of lights ({listed}); give the one to use")
        path = candidates[0]
    check_readable(path)
    suffix = path.suffix.lower()
    if suffix == ".lp":
        names, lights = read_light_positions(path)
    elif suffix == ".csv":
        names, lights = read_lights_csv(path)
    elif suffix == ".txt":
        lights = read_table(path, (3,), "light directions x, y, z")
        listing = path.parent / "filenames.txt"
        text = check_readable(listing).read_text(encoding="utf-8-sig", errors="replace") if listing.exists() else ""
        names = [line.strip() for line in text.splitlines() if line.strip()]
    else:
        raise FileError(f"{path}: is not a list of lights; known are .lp, .csv, .txt, or a folder that holds one")
    return path.parent, names, lights, path


def _image_paths(folder: Path, names: list[str], count: int, source: Path) -> list[Path]:
    if names:
        if len(names) != count:
            raise InputError(f"{source}: {count} lights, but {len(names)} images are named")
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(f"{source}: names {twice[0]} more than once; every light has its own image")
        return [folder / name for name in names]
    found = _images_of(folder)
    if len(found) > count:
        # Other images in the folder, such as a texture that was written there, are of another type.
        kinds = [p.suffix.lower() for p in found]
        found = [p for p in found if p.suffix.lower() == max(kinds, key=kinds.count)]
    if len(found) == count:
        return found
    below = {d.name.lower(): _images_of(d) for d in sorted(folder.iterdir()) if d.is_dir()}
    below = {name: images for name, images in below.items() if len(images) == count}
    if len(below) > 1:
        below = {name: images for name, images in below.items() if name in ("images", "objects")}
    if not found and len(below) == 1:
        return next(iter(below.values()))
    raise InputError(f"{source}: gives {count} lights, but {folder} holds {len(found)} images; name them in an .lp or lights.csv")


def _images_of(folder: Path) -> list[Path]:
    """Return the folder's images in natural order (2 before 10), without masks and sphere references."""
    if not folder.is_dir():
        raise FileError(f"{folder}: no such folder")
    images = [p for p in folder.iterdir() if p.suffix.lower() in READABLE_SUFFIXES and p.stem.lower() not in _NO_IMAGES]

    def natural(path: Path) -> list[tuple[int, str]]:
        return [
            (int(part), "") if part.isdecimal() and part.isascii() else (-1, part)
            for part in re.split("([0-9]+)", path.name.lower())
        ]

    return sorted(images, key=natural)


def _response(response: str | float | None) -> Callable[[Array], Array]:
    """Return a function from stored samples to linear float32 values."""
    if isinstance(response, str) and response not in ("linear", "srgb"):
        raise InputError(f"response {response!r} is not known; give 'linear', 'srgb' or a gamma such as 2.2")
    is_gamma = isinstance(response, (int, float, np.number)) and 0.1 <= response <= 10
    if response is not None and not isinstance(response, str) and not is_gamma:
        raise InputError(f"response {response} is no gamma: it must be a number from 0.1 to 10")
    tables: dict[np.dtype, Array] = {}

    def curve(values: Array, eight_bit: bool) -> Array:
        if response == "srgb" or (response is None and eight_bit):
            return decode_srgb(values)
        if response is None or response == "linear":
            return values
        return np.power(np.maximum(values, 0), np.float32(response))

    def decode(samples: Array) -> Array:
        if samples.dtype.kind == "f":
            return curve(samples.astype(np.float32), False)
        if samples.dtype not in tables:
            # A table of all levels avoids temporary copies of large images.
            levels = np.arange(np.iinfo(samples.dtype).max + 1, dtype=np.float32) / np.float32(np.iinfo(samples.dtype).max)
            tables[samples.dtype] = curve(levels, samples.dtype == np.uint8).astype(np.float32)
        return tables[samples.dtype][samples]

    return decode


def _gain(path: Path, count: int) -> Array:
    """Return (K, 1 or 3) factors that undo the lights' intensities."""
    table = read_table(path, (1, 3), "light intensities")
    if len(table) != count:
        table = table.T if table.T.shape == (count, 3) else table
    if len(table) != count:
        raise InputError(f"{path}: holds {len(table)} light intensities for {count} images")
    if not (table > 0).all():
        raise InputError(f"{path}: light intensities must be over 0")
    return 1.0 / table


def _mask(folder: Path, mask: PathLike | Array | None) -> tuple[Array | None, tuple[str, ...]]:
    if mask is None:
        beside = folder / "mask.png"
        if not beside.exists():
            return None, ()
        return _mask_image(beside), (f"{beside} masks the stack",)
    if isinstance(mask, (str, os.PathLike)):
        return _mask_image(Path(mask)), ()
    return np.asarray(mask), ()


def _mask_image(path: Path) -> Array:
    values = read_image(path, linear=True)
    if values.ndim == 3 and values.shape[2] == 4:
        values = values[:, :, :3] * values[:, :, 3:]
    return np.asarray((values if values.ndim == 2 else values[:, :, :3].max(axis=2)) > 0.5)
