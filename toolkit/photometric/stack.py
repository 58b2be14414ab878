"""Stacks of photographs of one scene from one place, each under one known distant light."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import LARGEST, check_fields, checked_arguments, checked_count, shown
from intaglio.errors import FileError, InputError
from intaglio.files import read_samples
from intaglio.photometric.light_positions import unit_directions

# Strips of all images are read and processed this many bytes at a time.
STRIP_BYTES = 1 << 28

# Rec.709.
LUMINANCE = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True)
class ImageFiles:
    """Images of a stack that stay on disk and are read one at a time.

    Attributes
    ----------
    paths : tuple of Path
        The files, one per light.
    shape : (int, int, int, int)
        Number K of images, rows H, columns W and channels C.
    dtype : numpy dtype
        Type of the stored samples.
    decode : callable
        Function from stored samples to linear float32 values.
    gain : (K, C) float64 array or None
        Factors of the images: one over the light's intensity.
    mix : tuple of float, optional
        Weights by which the channels are summed up to one.
    """

    paths: tuple[Path, ...]
    shape: tuple[int, int, int, int]
    dtype: np.dtype
    decode: Callable[[Array], Array]
    gain: Array | None = None
    mix: tuple[float, ...] | None = None

    def read(self, k: int) -> Array:
        """Read image ``k`` as linear (H, W, C) float32.

        Raises
        ------
        FileError
            If the file is missing or damaged, or its samples are of another type than the first image's.
        InputError
            If its size or number of channels is not that of the first.
        """
        samples = read_samples(self.paths[k])
        found, wanted = kind_of(samples, self.gain), self.kind
        if found != wanted:
            raise mismatch(str(self.paths[k]), found, wanted)
        return self.linear(k, samples)

    @property
    def kind(self) -> Kind:
        """What all images are like, before channels are summed up."""
        return Kind(self.shape[1], self.shape[2], self.shape[3] if self.mix is None else len(self.mix), self.dtype)

    def linear(self, k: int, samples: Array) -> Array:
        """Return the stored samples of image ``k`` as linear (H, W, C) float32."""
        if samples.ndim == 2:
            samples = samples[:, :, None]
        samples = samples[:, :, :3] if samples.shape[2] == 4 else samples[:, :, :1] if samples.shape[2] == 2 else samples
        if self.gain is not None and self.gain.shape[1] == 3 and samples.shape[2] == 1:
            samples = np.broadcast_to(samples, (*samples.shape[:2], 3))
        image = self.decode(samples)
        if self.gain is not None:
            image = image * self.gain[k].astype(np.float32)
        if self.mix is not None and image.shape[2] == len(self.mix):
            image = _mixed(image, self.mix)
        return np.ascontiguousarray(image, np.float32)

    def chosen(self, indices: Sequence[int]) -> ImageFiles:
        """Return some of the images, in the order of ``indices``."""
        gain = None if self.gain is None else self.gain[list(indices)]
        paths = tuple(self.paths[i] for i in indices)
        return replace(self, paths=paths, shape=(len(paths), *self.shape[1:]), gain=gain)


@dataclass(frozen=True)
class Kind:
    """What the images of a stack have in common.

    Attributes
    ----------
    rows, columns, channels : int
        Size of an image.
    dtype : numpy dtype
        Type of its stored samples.
    """

    rows: int
    columns: int
    channels: int
    dtype: np.dtype

    def describe(self) -> str:
        """Return size and type in words."""
        return f"{_size((self.rows, self.columns, self.channels))} of {self.dtype}"


def kind_of(samples: Array, gain: Array | None) -> Kind:
    """Return what an image with these stored samples is like; lights with an intensity per channel make it colour."""
    channels = 1 if samples.ndim == 2 or samples.shape[2] <= 2 else 3
    if gain is not None and gain.shape[1] == 3:
        channels = 3
    return Kind(samples.shape[0], samples.shape[1], channels, samples.dtype)


def mismatch(name: str, found: Kind, wanted: Kind) -> FileError | InputError:
    """Return the error about an image that is not like the others."""
    if found.dtype != wanted.dtype:
        return FileError(f"{name}: holds {found.dtype} values, the other images {wanted.dtype}; all must have one type")
    sizes = [_size((kind.rows, kind.columns, kind.channels)) for kind in (found, wanted)]
    return InputError(
        f"{name}: is {sizes[0]}, the other images are {sizes[1]}; all images of a stack must have the same size and channels"
    )


@dataclass(frozen=True)
class PhotometricStack:
    """Photographs of one scene from one place, each under one distant light.

    Parameters
    ----------
    images : (K, H, W, C) float array, (K, H, W) float array or ImageFiles
        Linear values, kept as float32; row 0 is the top. Three dimensions mean one channel. `read_stack` gives ImageFiles,
        which are read one at a time, where the images are large.
    lights : (K, 3) array
        Vectors towards the lights, of any length, made unit; x right, y up, z to the camera.
    mask : (H, W) bool array or None, optional
        Pixels to use; other types of array count as true over one half. Default None: all.
    names : tuple of str, optional
        What the images are called in messages. Default: their numbers.
    notes : tuple of str, optional
        What was noticed on reading, as sentences for the user. Default none.
    ceiling : float or (K, C) array, optional
        Value from which on images are overexposed. Default 1, the highest level of an image file; infinite for values
        without a ceiling, such as renderings.

    Raises
    ------
    InputError
        If shapes don't fit, images are integers, a light is zero or comes from below the surface, the mask is empty or of
        another size, or a pixel inside the mask is not finite.

    See Also
    --------
    intaglio.read_stack : Read a stack from files.
    intaglio.represent : Fit a relightable texture to it.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 3.3.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> lights = [[0, 0, 1], [1, 0, 1], [0, 1, 1]]
    >>> stack = intaglio.PhotometricStack(np.full((3, 4, 5, 3), 0.5), lights)
    >>> stack.shape
    (3, 4, 5, 3)
    >>> stack.lights[1].round(3)
    array([0.707, 0.   , 0.707])
    """

    images: Array | ImageFiles
    lights: Array
    mask: Array | None = None
    names: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    ceiling: Array | float = 1.0

    def __post_init__(self) -> None:
        check_fields(self, nan=True)
        if not isinstance(self.images, ImageFiles):
            _refuse_masked("images", self.images)
            try:
                images = np.asarray(self.images)
                if np.iscomplexobj(images):
                    raise InputError("images hold complex numbers, whose imaginary parts would be lost; give real values")
                if np.issubdtype(images.dtype, np.integer):
                    raise InputError(f"images hold linear values as floats; divide {images.dtype} levels by their maximum")
                images = np.ascontiguousarray(images, np.float32)
            except (TypeError, ValueError) as error:
                if isinstance(error, InputError):
                    raise
                raise InputError(f"images are not a (K, H, W, C) array of numbers ({error}); are all of one size?") from error
            images = images[..., None] if images.ndim == 3 else images
            if images.ndim != 4 or images.size == 0:
                raise InputError(f"images must be (K, H, W, C) or (K, H, W) with pixels, not {images.shape}")
            object.__setattr__(self, "images", images)
        object.__setattr__(self, "lights", checked_lights(self.lights, self.names))
        if len(self.lights) != self.shape[0]:
            raise InputError(f"there are {self.shape[0]} images but {len(self.lights)} lights; a stack needs one light each")
        if self.names and len(self.names) != self.shape[0]:
            raise InputError(f"there are {self.shape[0]} images but {len(self.names)} names")
        if self.mask is not None:
            object.__setattr__(self, "mask", checked_stack_mask(self.mask, self.shape[1:3]))
        object.__setattr__(self, "ceiling", _checked_ceiling(self.ceiling, self.shape))
        if not isinstance(self.images, ImageFiles):
            for k in range(self.shape[0]):
                self._check_finite(k, self.images[k])

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Shape of the images.

        Returns
        -------
        (int, int, int, int)
            Number K of images, rows H, columns W and channels C.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> intaglio.PhotometricStack(np.full((2, 4, 5), 0.5), [[0, 0, 1], [1, 0, 1]]).shape
        (2, 4, 5, 1)
        """
        k, h, w, c = self.images.shape
        return k, h, w, c

    @property
    def in_memory(self) -> bool:
        """Whether the images are an array rather than files that are read one at a time.

        Returns
        -------
        bool
            True for an array.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> intaglio.PhotometricStack(np.full((2, 4, 5), 0.5), [[0, 0, 1], [1, 0, 1]]).in_memory
        True
        """
        return not isinstance(self.images, ImageFiles)

    @checked_arguments
    def name(self, k: int) -> str:
        """Return what an image is called in messages.

        Parameters
        ----------
        k : int
            Number of the image, from 0.

        Returns
        -------
        str
            The name it was given, or its number.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> intaglio.PhotometricStack(np.full((2, 4, 5), 0.5), [[0, 0, 1], [1, 0, 1]]).name(1)
        'image 1'
        """
        return self.names[k] if self.names else f"image {k}"

    @checked_arguments
    def image(self, k: int) -> Array:
        """Return one image, read from its file unless the stack is in memory.

        Parameters
        ----------
        k : int
            Number of the image, from 0.

        Returns
        -------
        (H, W, C) float32 array
            Linear values; row 0 is the top.

        Raises
        ------
        FileError
            If the file is missing or damaged, or its samples are of another type than those of the first image.
        InputError
            If the image's size differs from the first one's, or a pixel inside the mask is not finite.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> images = np.stack([np.full((2, 2), 0.25), np.full((2, 2), 0.75)])
        >>> intaglio.PhotometricStack(images, [[0, 0, 1], [1, 0, 1]]).image(1)[:, :, 0]
        array([[0.75, 0.75],
               [0.75, 0.75]], dtype=float32)
        """
        if not -self.shape[0] <= k < self.shape[0]:
            raise InputError(f"k must be the number of one of {self.shape[0]} images, not {shown(k)}")
        if isinstance(self.images, ImageFiles):
            image = self.images.read(k)
            self._check_finite(k, image)
            return image
        return np.asarray(self.images[k])

    def gray(self) -> PhotometricStack:
        """Return the stack with the mean of the channels as its only channel.

        Returns
        -------
        PhotometricStack
            A stack of one channel with the same lights, mask and names.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> red = np.zeros((1, 2, 2, 3)) + [0.75, 0.0, 0.0]
        >>> intaglio.PhotometricStack(red, [[0, 0, 1]]).gray().image(0)[0, 0]
        array([0.25], dtype=float32)
        """
        return self.mixed((1.0 / self.shape[3],) * self.shape[3])

    def luminance(self) -> PhotometricStack:
        """Return the stack with Rec.709 luminance as its only channel.

        Returns
        -------
        PhotometricStack
            A stack of one channel with the same lights, mask and names; the stack itself if it has one channel already.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> green = np.zeros((1, 2, 2, 3)) + [0.0, 0.5, 0.0]
        >>> intaglio.PhotometricStack(green, [[0, 0, 1]]).luminance().image(0)[0, 0].round(4)
        array([0.3576], dtype=float32)
        """
        return self if self.shape[3] == 1 else self.mixed(LUMINANCE)

    @checked_arguments
    def mixed(self, weights: tuple[float, ...]) -> PhotometricStack:
        """Return the stack with a weighted sum of the channels as its only channel.

        Parameters
        ----------
        weights : tuple of float
            A weight per channel.

        Returns
        -------
        PhotometricStack
            A stack of one channel with the same lights, mask and names.

        Raises
        ------
        InputError
            If the number of weights is not that of the channels.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> color = np.zeros((1, 2, 2, 3)) + [0.5, 0.25, 1.0]
        >>> intaglio.PhotometricStack(color, [[0, 0, 1]]).mixed((0.5, 0.5, 0.0)).image(0)[0, 0]
        array([0.375], dtype=float32)
        """
        if len(weights) != self.shape[3]:
            raise InputError(f"{len(weights)} weights for {self.shape[3]} channels")
        if not all(abs(weight) <= LARGEST for weight in weights):
            raise InputError(f"weights must be finite numbers, not {shown(weights)}")
        if isinstance(self.images, ImageFiles):
            images: Array | ImageFiles = replace(self.images, shape=(*self.shape[:3], 1), mix=weights)
        else:
            images = np.stack([_mixed(image, weights) for image in self.images])
        ceiling = self.ceiling @ np.asarray(weights)[:, None] if isinstance(self.ceiling, np.ndarray) else self.ceiling
        return replace(self, images=images, ceiling=ceiling)

    @checked_arguments
    def subset(self, indices: Sequence[int] | Array) -> PhotometricStack:
        """Return the stack of some of the images.

        Parameters
        ----------
        indices : sequence of int
            Numbers of the images from 0, or from -1 backwards, in the order that the new stack takes.

        Returns
        -------
        PhotometricStack
            Their images, lights and names, with the same mask.

        Raises
        ------
        InputError
            If there are no indices, or one is not that of an image.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> lights = [[0, 0, 1], [3, 0, 4], [0, 3, 4]]
        >>> stack = intaglio.PhotometricStack(np.full((3, 2, 2), 0.5), lights)
        >>> stack.subset([2, 0]).lights
        array([[0. , 0.6, 0.8],
               [0. , 0. , 1. ]])
        """
        numbers = np.asarray(indices)
        if numbers.ndim != 1 or numbers.dtype.kind not in "iu" or not len(numbers):
            raise InputError(f"indices must be whole numbers of images, at least one, not {shown(indices)}")
        chosen = [int(i) for i in numbers]
        if not all(-self.shape[0] <= i < self.shape[0] for i in chosen):
            raise InputError(f"indices {shown(chosen)} are not numbers of the stack's {self.shape[0]} images")
        names = tuple(self.names[i] for i in chosen) if self.names else ()
        images: Array | ImageFiles
        images = self.images.chosen(chosen) if isinstance(self.images, ImageFiles) else self.images[chosen]
        ceiling = self.ceiling[chosen] if isinstance(self.ceiling, np.ndarray) else self.ceiling
        return replace(self, images=images, lights=self.lights[chosen], names=names, ceiling=ceiling)

    @checked_arguments
    def strips(self, size: int | None = None) -> Iterator[tuple[slice, Array]]:
        """Yield strips of rows of all images together.

        Images on disk are read again for every strip.

        Parameters
        ----------
        size : int, optional
            About how many bytes of float32 values to yield at a time; at least one row. Default None: 256 MiB, which keeps
            memory small and reads images on disk seldom.

        Yields
        ------
        rows : slice
            The rows of the strip.
        values : (K, h, W, C) float32 array
            Linear values of these rows.

        Raises
        ------
        FileError
            As `image`.
        InputError
            As `image`.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> stack = intaglio.PhotometricStack(np.full((2, 5, 4), 0.5), [[0, 0, 1], [1, 0, 1]])
        >>> [(rows.start, rows.stop, values.shape) for rows, values in stack.strips(size=64)]
        [(0, 2, (2, 2, 4, 1)), (2, 4, (2, 2, 4, 1)), (4, 5, (2, 1, 4, 1))]
        """
        k, h, w, c = self.shape
        size = STRIP_BYTES if size is None else checked_count("size", size, 1, sys.maxsize)
        rows = max(1, min(h, size // (4 * k * w * c)))
        for top in range(0, h, rows):
            part = slice(top, min(top + rows, h))
            if isinstance(self.images, ImageFiles):
                strip = np.empty((k, part.stop - top, w, c), np.float32)
                for i in range(k):
                    strip[i] = self.image(i)[part]
                yield part, strip
            else:
                yield part, self.images[:, part]

    def _check_finite(self, k: int, image: Array) -> None:
        wrong = not_finite(image, self.mask)
        if wrong:
            raise InputError(f"{self.name(k)}: {wrong}; mask them out or repair the image")


def not_finite(image: Array, mask: Array | None) -> str:
    """Return how many pixels inside the mask are no finite numbers and where the first is; empty if all are."""
    # The sum is finite if all values are, and is faster to find than to test every pixel.
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(image.sum(dtype=np.float64)):
            return ""
    bad = ~np.isfinite(image).all(axis=2)
    if mask is not None:
        bad &= mask
    if not bad.any():
        return ""
    row, column = np.argwhere(bad)[0]
    return f"{int(bad.sum())} pixels are not finite (NaN or infinite), the first at row {row}, column {column}"


def checked_stack_mask(mask: object, shape: tuple[int, int]) -> Array:
    """Return a mask as a bool array, or raise `InputError` unless it is one of the images' ``shape`` that is not empty."""
    _refuse_masked("mask", mask)
    try:
        array = np.asarray(mask)
    except ValueError as error:
        raise InputError(f"the mask is not an array of one size ({error})") from error
    if array.dtype.kind not in "buif":
        raise InputError(f"the mask is an array of {array.dtype}, not of bool")
    if array.shape != tuple(shape):
        raise InputError(f"the mask is {array.shape}, the images are {tuple(shape)}; they must be of one size")
    array = array if array.dtype == bool else array > 0.5
    if not array.any():
        raise InputError("the mask is empty: no pixel is to be used")
    return array


def _refuse_masked(name: str, value: object) -> None:
    if np.ma.isMaskedArray(value):
        raise InputError(
            f"{name}: is a masked array, whose mask would be lost; give plain values, and the pixels to use as mask="
        )


def _checked_ceiling(ceiling: object, shape: tuple[int, ...]) -> Array | float:
    """Return the ceiling as a float or (K, C) array, or raise `InputError` if it is none over 0."""
    _refuse_masked("ceiling", ceiling)
    try:
        values = np.asarray(ceiling)
    except ValueError as error:
        raise InputError(f"ceiling must be a number or an array ({error})") from error
    if values.dtype.kind not in "iuf" or np.isnan(values).any() or not (values > 0).all():
        raise InputError("ceiling must be over 0: a number, or one for each image and channel, and not NaN")
    if values.ndim == 0:
        return float(values)
    if values.ndim != 2 or values.shape[0] != shape[0] or values.shape[1] not in (1, shape[3]):
        raise InputError(f"ceiling must be a number or ({shape[0]}, {shape[3]}) like images and channels, not {values.shape}")
    return values


def checked_lights(lights: Array, names: tuple[str, ...] = ()) -> Array:
    """Return ``lights`` as (K, 3) float64 unit vectors from above the surface; `InputError` names one that is not."""
    _refuse_masked("lights", lights)
    try:
        if np.iscomplexobj(lights):
            raise InputError("lights are complex numbers; give real vectors x, y, z")
        vectors = np.array(lights, np.float64, ndmin=2)
    except (TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"lights are not a (K, 3) array of numbers ({error})") from error
    if vectors.ndim != 2 or vectors.shape[1] != 3 or len(vectors) == 0:
        raise InputError(f"lights must be (K, 3) vectors x, y, z, not {vectors.shape}")
    for k, vector in enumerate(vectors):
        name = f" ({names[k]})" if k < len(names) else ""
        if not np.isfinite(vector).all() or not vector.any():
            raise InputError(f"lights must be finite vectors that are not zero; light {k}{name} is {vector.tolist()}")
        if vector[2] <= 0:
            raise InputError(
                f"light {k}{name} is {vector.tolist()}: it comes from below the surface (z must be over 0, towards the camera)"
            )
    return np.ascontiguousarray(unit_directions(vectors))


@dataclass
class Exposure:
    """Counts of values at the ends of the range, inside the mask.

    Attributes
    ----------
    over : int
        Number of values at or over the ceiling.
    under : int
        Number of values at or under 0.
    total : int
        Number of all values.
    """

    over: int = 0
    under: int = 0
    total: int = 0

    def add(self, stack: PhotometricStack, k: int, image: Array) -> None:
        """Count the values of image ``k``."""
        self._count(image if stack.mask is None else image[stack.mask], stack.ceiling, k)

    def add_strip(self, stack: PhotometricStack, rows: slice, strip: Array) -> None:
        """Count the values of a strip of all images."""
        for k, part in enumerate(strip):
            self._count(part if stack.mask is None else part[stack.mask[rows]], stack.ceiling, k)

    def _count(self, values: Array, ceilings: Array | float, k: int) -> None:
        ceiling = np.asarray(ceilings, np.float32)
        self.over += int(np.count_nonzero(values >= (ceiling[k] if ceiling.ndim else ceiling)))
        self.under += int(np.count_nonzero(values <= 0))
        self.total += values.size

    @property
    def shares(self) -> tuple[float, float]:
        """Shares of overexposed and of black values."""
        return self.over / max(self.total, 1), self.under / max(self.total, 1)


def _mixed(image: Array, weights: tuple[float, ...]) -> Array:
    return np.asarray(image @ np.asarray(weights, np.float32))[..., None]


def _size(shape: Sequence[int]) -> str:
    return f"{shape[1]} x {shape[0]} pixels with {shape[2]} channel{'s' if shape[2] > 1 else ''}"
