"""A stack of photographs of one scene from one place, each under one known distant light."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError
from intaglio.files import read_samples
from intaglio.photometric.light_positions import unit

# Strips of all images are read and worked on this many bytes at a time.
STRIP_BYTES = 1 << 28

# Rec.709.
LUMINANCE = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True)
class ImageFiles:
    """Images of a stack that stay on disk and are read one at a time.

    Attributes
    ----------
    paths : tuple of Path
    shape : (K, H, W, C)
    dtype : numpy dtype
        Of the stored samples.
    decode : callable
        From stored samples to linear float32 values.
    gain : (K, C) float64 array or None
        What every image is multiplied by: one over the light's intensity.
    mix : tuple of float, optional
        Weights by which the channels are added up to one.
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
        if samples.dtype != self.dtype:
            raise FileError(f"{self.paths[k]}: holds {samples.dtype} values, the first image {self.dtype}; all must be alike")
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
        if image.shape != self.shape[1:]:
            raise InputError(
                f"{self.paths[k]}: is {_size(image.shape)}, the first image is {_size(self.shape[1:])}; "
                "all images of a stack must be alike"
            )
        return np.ascontiguousarray(image, np.float32)


@dataclass(frozen=True)
class PhotometricStack:
    """Photographs of one scene from one place, each under one distant light.

    Attributes
    ----------
    images : (K, H, W, C) float32 array, or ImageFiles
        Linear values; row 0 is the top. An array (K, H, W) is taken as grey.
    lights : (K, 3) float64 array
        Vectors towards the light, made unit; x right, y up, z to the camera.
    mask : (H, W) bool array, optional
        Pixels to use; None means all.
    names : tuple of str
        What the images are called in messages.
    notes : tuple of str
        What was noticed on reading.
    ceiling : float or (K, C) array
        Value from which on images are overexposed; infinite for values without a ceiling, such as renderings.

    Raises
    ------
    InputError
        If shapes don't fit, a light is zero or comes from below the surface, the mask is empty or of another size, or a
        pixel inside the mask is not finite.
    """

    images: Array | ImageFiles
    lights: Array
    mask: Array | None = None
    names: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    ceiling: Array | float = 1.0

    def __post_init__(self) -> None:
        if not isinstance(self.images, ImageFiles):
            try:
                images = np.asarray(self.images)
                if np.issubdtype(images.dtype, np.integer):
                    raise InputError(f"images hold linear values as floats; divide {images.dtype} levels by their maximum")
                images = np.ascontiguousarray(images, np.float32)
            except (TypeError, ValueError) as error:
                if isinstance(error, InputError):
                    raise
                raise InputError(f"images are no (K, H, W, C) array of numbers ({error}); are all of one size?") from error
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
            mask = np.asarray(self.mask)
            if mask.dtype.kind not in "buif":
                raise InputError(f"the mask is an array of {mask.dtype}, not of true and false")
            if mask.shape != self.shape[1:3]:
                raise InputError(f"the mask is {mask.shape}, the images are {self.shape[1:3]}; they must be of one size")
            mask = mask if mask.dtype == bool else mask > 0.5
            if not mask.any():
                raise InputError("the mask is empty: no pixel is to be used")
            object.__setattr__(self, "mask", mask)
        if not isinstance(self.images, ImageFiles):
            for k in range(self.shape[0]):
                self._check_finite(k, self.images[k])

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(K, H, W, C)."""
        k, h, w, c = self.images.shape
        return k, h, w, c

    @property
    def in_memory(self) -> bool:
        """Whether the images are an array, not files."""
        return not isinstance(self.images, ImageFiles)

    def name(self, k: int) -> str:
        """Return what image ``k`` is called in messages."""
        return self.names[k] if self.names else f"image {k}"

    def image(self, k: int) -> Array:
        """Return image ``k``, linear (H, W, C) float32, read from disk if it has to be."""
        if isinstance(self.images, ImageFiles):
            image = self.images.read(k)
            self._check_finite(k, image)
            return image
        return np.asarray(self.images[k])

    def grey(self) -> PhotometricStack:
        """Return the stack with the mean of the channels as its only one."""
        return self.mixed((1.0 / self.shape[3],) * self.shape[3])

    def luminance(self) -> PhotometricStack:
        """Return the stack with Rec.709 luminance as its only channel."""
        return self if self.shape[3] == 1 else self.mixed(LUMINANCE)

    def mixed(self, weights: tuple[float, ...]) -> PhotometricStack:
        """Return the stack with the weighted sum of the channels as its only one."""
        if len(weights) != self.shape[3]:
            raise InputError(f"{len(weights)} weights for {self.shape[3]} channels")
        if isinstance(self.images, ImageFiles):
            images: Array | ImageFiles = replace(self.images, shape=(*self.shape[:3], 1), mix=weights)
        else:
            images = np.stack([_mixed(image, weights) for image in self.images])
        ceiling = self.ceiling @ np.asarray(weights)[:, None] if isinstance(self.ceiling, np.ndarray) else self.ceiling
        return replace(self, images=images, ceiling=ceiling)

    def subset(self, indices: Sequence[int] | Array) -> PhotometricStack:
        """Return the stack of some of the images, by number."""
        chosen = [int(i) for i in indices]
        if not chosen or not all(-self.shape[0] <= i < self.shape[0] for i in chosen):
            raise InputError(f"images {chosen} are not all of the stack's {self.shape[0]}")
        names = tuple(self.names[i] for i in chosen) if self.names else ()
        if isinstance(self.images, ImageFiles):
            files = self.images
            gain = None if files.gain is None else files.gain[chosen]
            shape = (len(chosen), *files.shape[1:])
            paths = tuple(files.paths[i] for i in chosen)
            images: Array | ImageFiles = replace(files, paths=paths, shape=shape, gain=gain)
        else:
            images = self.images[chosen]
        ceiling = self.ceiling[chosen] if isinstance(self.ceiling, np.ndarray) else self.ceiling
        return replace(self, images=images, lights=self.lights[chosen], names=names, ceiling=ceiling)

    def strips(self, size: int | None = None) -> Iterator[tuple[slice, Array]]:
        """Yield (rows, (K, h, W, C) values) of all images together, about ``size`` bytes at a time (default `STRIP_BYTES`).

        Images on disk are read again for every strip.
        """
        k, h, w, c = self.shape
        rows = max(1, min(h, (size or STRIP_BYTES) // (4 * k * w * c)))
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
        # A sum is finite if all values are; the slow look at every pixel is for when it is not.
        with np.errstate(over="ignore", invalid="ignore"):
            if np.isfinite(image.sum(dtype=np.float64)):
                return
        bad = ~np.isfinite(image).all(axis=2)
        if self.mask is not None:
            bad &= self.mask
        if bad.any():
            row, column = np.argwhere(bad)[0]
            raise InputError(
                f"{self.name(k)}: {int(bad.sum())} pixels are not finite (NaN or infinite), the first at row {row}, "
                f"column {column}; mask them out or mend the image"
            )


def checked_lights(lights: Array, names: tuple[str, ...] = ()) -> Array:
    """Return ``lights`` as (K, 3) float64 unit vectors from above the surface; `InputError` names one that is not."""
    try:
        vectors = np.array(lights, np.float64, ndmin=2)
    except (TypeError, ValueError) as error:
        raise InputError(f"lights are no (K, 3) array of numbers ({error})") from error
    if vectors.ndim != 2 or vectors.shape[1] != 3 or len(vectors) == 0:
        raise InputError(f"lights must be (K, 3) vectors x, y, z, not {vectors.shape}")
    for k, vector in enumerate(vectors):
        name = f" ({names[k]})" if k < len(names) else ""
        if not np.isfinite(vector).all() or not vector.any():
            raise InputError(f"light {k}{name} is {vector.tolist()}: a light must be a finite vector that is not zero")
        if vector[2] <= 0:
            raise InputError(
                f"light {k}{name} is {vector.tolist()}: it comes from below the surface (z must be over 0, towards the camera)"
            )
    return np.ascontiguousarray(unit(vectors))


@dataclass
class Exposure:
    """Counts of values at the ends of the range, inside the mask.

    Attributes
    ----------
    over, under, total : int
        Values at or over the ceiling, at or under 0, and all.
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
