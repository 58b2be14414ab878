"""Reading stacks from .lp files and from folders with a lights.csv or plain tables of light directions."""

from __future__ import annotations

import contextlib
import math
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments, checked_flag
from intaglio.errors import FileError, InputError, IntaglioWarning
from intaglio.files import check_readable, read_image, read_samples
from intaglio.kernels.transfer import decode_srgb
from intaglio.photometric.choosing import (
    Choice,
    Names,
    check_enough,
    leave_out,
    leave_out_by_list,
    leave_out_odd,
    left_out_notes,
    lights_of,
)
from intaglio.photometric.examination import Examination, ImageFacts
from intaglio.photometric.image_search import find_images, images_of
from intaglio.photometric.light_positions import LightList, list_light_positions, list_lights_csv, read_table, unit_directions
from intaglio.photometric.mirror_sphere import fit_circle, lights_from_sphere
from intaglio.photometric.stack import ImageFiles, Kind, PhotometricStack, checked_stack_mask, kind_of, mismatch, not_finite

# Stacks up to this many bytes are held in memory as float32.
MEMORY_BYTES = 1 << 31

STACK_SUFFIXES = (".lp", ".csv", ".txt")
_LIGHT_FILES = ("lights.csv", "light_directions.txt", "lights.txt")


@checked_arguments
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
    keep: Names = (),
    skip: Names = (),
    strict: bool = False,
) -> PhotometricStack:
    r"""Read photographs of one scene under known lights.

    Photographs that can't be used are left out, and the stack's notes name them: those that are missing, damaged, or of
    another size or type than most, whose light is on or below the horizon or that of another photograph, and those that don't
    belong to the others — 1.45 times too bright or dark, lit from elsewhere than listed, shifted, black, or of something
    else. Where that is in doubt the photograph is kept, with an `IntaglioWarning`.

    Parameters
    ----------
    path : path
        One of these:

        * an .lp file: a line ``name x y z`` for each image, with or without the number of images in the first line; names
          are relative to the file, and lines without names take the folder's images in order. A name with another folder,
          case or type than the image at hand is understood if there is only one that it can mean;
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
    keep : str, int or sequence of them, optional
        Photographs that stay whatever is odd about them: names with or without suffix, patterns such as ``"image3*"``, or
        numbers in the list from 0; a text may hold several, with commas between them. The light of one that is up to 5
        degrees below the horizon is raised onto it. Default none.
    skip : str, int or sequence of them, optional
        Photographs to leave out, named likewise. Default none.
    strict : bool, optional
        Raise an error where a photograph would be left out or looked for under another name. Default False.

    Returns
    -------
    PhotometricStack
        Linear values divided by the lights' strengths; its ``names`` are the files, its ``notes`` say what was found and
        which photographs were left out, and why.

    Raises
    ------
    FileError
        If the lights' file is missing or of an unknown type, no image can be read, or one can't that is to be kept.
    InputError
        If the numbers of lights and images differ, images to be kept differ in size, fewer than three images or half of them
        can be used, a folder holds several lists of lights, ``keep`` or ``skip`` name no image, or ``response`` is unknown.
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
    with_them = Reading(mask, intensities, sphere, circle, gray, memory)
    choice = Choice(keep, skip, checked_flag("strict", strict))
    return _read(Path(path), response, with_them, choice)[0]


@dataclass(frozen=True)
class Reading:
    """What `read_stack` takes besides the photographs; its parameters say what each is.

    With ``glance`` photographs are looked at once and not used: that they stay on disk is nothing to note.
    """

    mask: PathLike | Array | None = None
    intensities: PathLike | None = None
    sphere: PathLike | None = None
    circle: tuple[float, float, float] | None = None
    gray: bool = False
    memory: int = MEMORY_BYTES
    glance: bool = False


def examine_capture(path: PathLike, response: str | float | None = None) -> tuple[PhotometricStack, list[ImageFacts]]:
    """Return the stack that `read_stack` reads, its images on disk, and what each photograph of the list is like.

    Every photograph is read once.

    Raises
    ------
    FileError
        As `read_stack`.
    InputError
        As `read_stack`.
    """
    return _read(Path(path), response, Reading(memory=0, glance=True), Choice())


def _read(
    path: Path, response: str | float | None, reading: Reading, choice: Choice
) -> tuple[PhotometricStack, list[ImageFacts]]:
    """Return the stack, and what each photograph of its list is like, those left out as well."""
    decode_value = _response(response)
    folder, listed, source = _lights(path, reading, choice.strict)
    paths, renamed = find_images(folder, listed.names, len(listed.lights), source, choice.strict)
    facts = [ImageFacts(k, p.name, light) for k, (p, light) in enumerate(zip(paths, listed.lights, strict=True))]
    kept = choice.apply(facts, listed.names)
    for one in facts:
        if not one.used:
            # What the user names is input, and never overwritten, even if it is not read.
            with contextlib.suppress(FileError):
                check_readable(paths[one.number])
    raised = leave_out_by_list(facts, paths, kept, source, choice.strict)
    check_enough(facts, source)
    known, masked = _mask(folder, reading.mask)
    photographs = _Photographs(tuple(paths), decode_value, _gain(folder, reading.intensities, len(paths)), known, reading)
    files, images, examination = photographs.take(facts, kept, choice.strict)
    check_enough(facts, source)
    examination.judge([one for one in facts if one.used])
    overruled, doubts = leave_out_odd(facts, kept, source, choice.strict, examination.disorder)
    check_enough(facts, source)
    for doubt in doubts:
        warnings.warn(doubt, IntaglioWarning, stacklevel=3)
    used = [one.number for one in facts if one.used]
    notes = [*listed.notes, *renamed, *masked, *raised, *overruled, *left_out_notes(facts)]
    files = files.chosen(used)
    size = 4 * math.prod(files.shape)
    values = files if images is None else _gathered(images, used)
    if images is None and not reading.glance:
        notes.append(f"the stack is {size / 2**30:.1f} GiB: images are read one at a time")
    labels = tuple(str(paths[k]) for k in used)
    ceiling = photographs.ceiling(files.dtype)
    ceiling = ceiling[used] if isinstance(ceiling, np.ndarray) else ceiling
    return PhotometricStack(values, lights_of(facts), known, labels, tuple(notes), ceiling), facts


@dataclass(frozen=True)
class _Photographs:
    """The files of a list's photographs, and what their values become."""

    paths: tuple[Path, ...]
    decode: Callable[[Array], Array]
    gain: Array | None
    mask: Array | None
    reading: Reading

    def ceiling(self, kind: np.dtype) -> Array | float:
        """Return the value from which on images of a type are overexposed, of one image per row if lights differ."""
        if kind.kind != "u":
            return np.inf
        if self.gain is None:
            return 1.0
        return self.gain.mean(axis=1, keepdims=True) if self.reading.gray else self.gain

    def take(self, facts: Sequence[ImageFacts], kept: set[int], strict: bool) -> tuple[ImageFiles, Array | None, Examination]:
        """Read the photographs in use, once each: return them, as values too where they fit memory, and small ones of them.

        Those that can't be read, or are of another size or type than most, are taken out.

        Raises
        ------
        FileError
            If one can't be read and is to be kept, or any and ``strict``.
        InputError
            If one is of another size and is to be kept, or any and ``strict``.
        """
        wanted = [one for one in facts if one.used]
        taken: _Taken | None = None
        kinds: dict[Kind, list[ImageFacts]] = {}
        for one in wanted:
            samples = self._samples(one, strict or one.number in kept)
            if samples is None:
                continue
            kind = kind_of(samples, self.gain)
            first = next(iter(kinds), kind)
            if strict and kind != first:
                raise mismatch(one.name, kind, first)
            kinds.setdefault(kind, []).append(one)
            if taken is None and (self.mask is None or self.mask.shape == (kind.rows, kind.columns)):
                taken = _Taken(self, kind, len(facts))
            if taken is not None and kind == taken.kind:
                taken.add(one, samples, strict or one.number in kept)
        if not kinds:
            raise FileError(f"{wanted[0].name}: {wanted[0].remark}; no photograph can be read")
        usual = max(kinds, key=lambda kind: len(kinds[kind]))
        if taken is None or usual != taken.kind:
            # The first photograph was the odd one.
            taken = _Taken(self, usual, len(facts))
            for one in kinds[usual]:
                samples = self._samples(one, one.number in kept)
                if samples is not None:
                    taken.add(one, samples, one.number in kept)
        for kind, images in kinds.items():
            for one in images if kind != usual else ():
                if one.number in kept:
                    raise mismatch(one.name, kind, usual)
                leave_out(one, f"is {kind.describe()}, most are {usual.describe()}")
        return taken.files, taken.images, taken.examination

    def _samples(self, one: ImageFacts, must: bool) -> Array | None:
        """Return a photograph's stored samples, or None, and take it out, if it can't be read and need not be."""
        path = self.paths[one.number]
        try:
            samples = read_samples(path)
            if samples.dtype.kind != "f" and samples.dtype not in (np.uint8, np.uint16):
                raise FileError(f"{path}: holds {samples.dtype} values; images of 8 or 16 bits, or floats, are needed")
            return samples
        except FileError as error:
            if must:
                raise
            leave_out(one, str(error).removeprefix(f"{path}: "))
            return None


class _Taken:
    """The photographs of one kind: their files, their values where they fit memory, and small pictures of them."""

    def __init__(self, photographs: _Photographs, kind: Kind, count: int) -> None:
        reading = photographs.reading
        shape = (count, kind.rows, kind.columns, 1 if reading.gray else kind.channels)
        if photographs.mask is not None:
            try:
                checked_stack_mask(photographs.mask, shape[1:3])
            except InputError as error:
                raise InputError(f"{photographs.paths[0].parent}: {error}") from error
        mix = (1 / kind.channels,) * kind.channels if reading.gray else None
        self.kind = kind
        self.files = ImageFiles(photographs.paths, shape, kind.dtype, photographs.decode, photographs.gain, mix)
        self.images = np.empty(shape, np.float32) if 4 * math.prod(shape) <= reading.memory else None
        self.mask = photographs.mask
        self.ceiling = photographs.ceiling(kind.dtype)
        self.examination = Examination(shape[1:3], None if self.mask is None else np.asarray(self.mask) > 0.5)

    def add(self, one: ImageFacts, samples: Array, must: bool) -> None:
        """Take in one photograph, or take it out of the stack if it has pixels that are no numbers and need not be in it."""
        image = self.files.linear(one.number, samples)
        wrong = not_finite(image, self.examination.mask)
        if wrong and must:
            raise InputError(f"{self.files.paths[one.number]}: {wrong}; mask them out or repair the image")
        if wrong:
            leave_out(one, wrong)
            return
        if self.images is not None:
            self.images[one.number] = image
        self.examination.add(one, image, self.ceiling[one.number] if isinstance(self.ceiling, np.ndarray) else self.ceiling)


def _gathered(images: Array, used: list[int]) -> Array:
    """Return the used images, moved together in place: a copy would need twice the memory."""
    for place, k in enumerate(used):
        if place != k:
            images[place] = images[k]
    return images[: len(used)]


def _lights(path: Path, reading: Reading, strict: bool) -> tuple[Path, LightList, Path]:
    """Return the folder of the images, the list of their lights, and the file that gave it."""
    if reading.sphere is not None:
        return path, _lights_of_sphere(path, Path(reading.sphere), reading.circle, strict), Path(reading.sphere)
    if reading.circle is not None:
        raise InputError("a circle outlines a mirror sphere: give the folder of its pictures as well")
    if os.path.isdir(path):
        candidates = [path / n for n in _LIGHT_FILES if (path / n).exists()] or sorted(path.glob("*.[lL][pP]"))
        if not candidates:
            raise FileError(f"{path}: holds neither an .lp file nor any of {', '.join(_LIGHT_FILES)}")
        if len(candidates) > 1:
            listed = ", ".join(p.name for p in candidates)
            raise InputError(f"{path}: holds more than one file of lights ({listed}); give the one to use")
        path = candidates[0]
    check_readable(path)
    suffix = path.suffix.lower()
    if suffix == ".lp":
        return path.parent, list_light_positions(path, strict=strict), path
    if suffix == ".csv":
        return path.parent, list_lights_csv(path, strict=strict), path
    if suffix == ".txt":
        lights = read_table(path, (3,), "light directions x, y, z")
        lights = np.array([unit_directions(v) if v.any() else np.full(3, np.nan) for v in lights])
        listing = path.parent / "filenames.txt"
        text = check_readable(listing).read_text(encoding="utf-8-sig", errors="replace") if listing.exists() else ""
        names = [line.strip().replace("\\", "/") for line in text.splitlines() if line.strip()]
        return path.parent, LightList(names, lights, []), path
    raise FileError(f"{path}: is not a list of lights; known are .lp, .csv, .txt, or a folder that holds one")


def _lights_of_sphere(path: Path, sphere: Path, circle: tuple[float, float, float] | None, strict: bool) -> LightList:
    """Return the lights that pictures of a mirror sphere show; NaN for a picture without a highlight."""
    if not os.path.isdir(path):
        raise FileError(f"{path}: with a sphere's pictures, give the folder of the images")
    files = images_of(sphere)
    if not files:
        raise FileError(f"{sphere}: holds no pictures of a sphere")
    count = len(images_of(path))
    if len(files) != count:
        raise InputError(f"{sphere}: holds {len(files)} pictures of a sphere for {count} images in {path}; give one each")
    pictures = [read_image(p, linear=True) for p in files]
    try:
        return LightList([], lights_from_sphere(pictures, circle).lights, [])
    except InputError as error:
        if strict or len({picture.shape for picture in pictures}) > 1:
            raise
        problem = error
    outline = fit_circle(np.mean(pictures, axis=0)) if circle is None else circle
    lights = np.full((count, 3), np.nan)
    for k, picture in enumerate(pictures):
        with contextlib.suppress(InputError):
            lights[k] = lights_from_sphere([picture], outline).lights[0]
    if 2 * np.isnan(lights[:, 0]).sum() >= count:
        raise problem
    return LightList([], lights, [])


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


def _gain(folder: Path, intensities: PathLike | None, count: int) -> Array | None:
    """Return (K, 1 or 3) factors that undo the lights' intensities; None if no table gives any."""
    path = folder / "light_intensities.txt" if intensities is None else Path(intensities)
    if intensities is None and not path.exists():
        return None
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
