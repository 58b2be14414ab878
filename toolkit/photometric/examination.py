"""What each photograph of a capture is like, and which of them don't belong to it.

Of every image a small picture is kept as it is read. Then, for each in turn, the others say how it should look:

* its brightness, and the pattern of light and shade on it, are smooth functions of the light's direction. They are
  interpolated from the other images by a Gaussian process with a polynomial drift (kriging), whose error for a left-out image
  and the spread of that error have a closed form (Dubrule 1983);
* its edges lie where those of the images lit most alike lie: a shift is the peak of their phase correlation.

An image is off if it differs far more than the others of its own capture do, and by more than any honest capture does. Those that
are off most are taken out first, since they mislead the rest, and come back if they fit what is left.

References
----------
Dubrule, "Cross Validation of Kriging in a Unique Neighborhood", Mathematical Geology 15(6), 1983.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import fft, ndimage

from intaglio.arrays import Array
from intaglio.photometric.light_positions import tilt_and_slant

# Longest sides, in blocks of pixels, of the pictures that shifts are found in and of the grids that shading is compared on.
_PICTURE, _GRID = 192, 16
# Fewer images say too little of each other.
_LEAST = 10
# Smaller pictures have too few edges to find a shift by.
_LEAST_SIDE = 32
# Widths and noise of the Gaussian process, of which those with the least error are taken.
_WIDTHS, _NOISES = (0.25, 0.5, 1.0), (0.01, 0.1, 1.0)
# Limits as (marked, left out). Brightness: natural logarithm, and spreads of its error.
_FACTOR = np.log((1.25, 1.45))
_SPREADS = (4.5, 6.0)
# How many times better an image fits another light than its own; of two images, each the other's.
_ELSEWHERE = (4.0, 5.0)
_SWAPPED = (3.3, 4.0)
# Lights nearer to each other than this, in degrees, are not told apart.
_APART = 20.0
# Share of the shading's spread that is left if each image is predicted: of real captures in the right order less than a third, in
# another order nine tenths. And the spreads of logarithms from which on an order can be told.
_UNEXPLAINED, _SHADED = 0.6, 0.02
# Shift in blocks of the small picture, and in multiples of what most images of the capture show.
_SHIFT = (1.0, 2.0)
_SHIFTS = (4.0, 6.0)


@dataclass
class ImageFacts:
    """What one photograph of a capture is like.

    Attributes
    ----------
    number : int
        Its place in the list of lights, from 0.
    name : str
        What it is called.
    light : (3,) float64 array
        Unit vector towards its light.
    mean, over, black, sharpness : float
        Mean of its linear values, share of values at or over the ceiling and of those at or under 0, and mean difference of
        neighbouring pixels over the mean; NaN if it was not read.
    shift : (float, float) or None
        Rows and columns in pixels by which it lies off the images lit most alike; None where that can't be told.
    factor : float
        How many times as bright it is as the other images suggest; NaN where they suggest nothing.
    remark : str
        What is odd about it; empty if nothing is.
    odd : bool
        Whether it is so far off that it does not belong to the others.
    used : bool
        Whether it is part of the stack.
    """

    number: int
    name: str
    light: Array
    mean: float = np.nan
    over: float = np.nan
    black: float = np.nan
    sharpness: float = np.nan
    shift: tuple[float, float] | None = None
    factor: float = np.nan
    remark: str = ""
    odd: bool = False
    used: bool = True


@dataclass
class Examination:
    """Small pictures of a capture's images, taken one at a time, from which `judge` finds those that don't belong.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the images.
    mask : (H, W) bool array or None
        Pixels that count.

    Attributes
    ----------
    disorder : bool
        Whether the images, by `judge`, have so little to do with their lights that these must be in another order.
    """

    shape: tuple[int, int]
    mask: Array | None
    disorder: bool = False
    _grids: dict[int, Array] = field(default_factory=dict)
    _edges: dict[int, Array] = field(default_factory=dict)

    def add(self, facts: ImageFacts, image: Array, ceiling: Array | float) -> None:
        """Fill in what ``image`` (H, W, C) itself tells, and keep it small."""
        values = image if self.mask is None else image[self.mask]
        facts.over = float(np.count_nonzero(values >= np.asarray(ceiling, np.float32)) / values.size)
        facts.black = float(np.count_nonzero(values <= 0) / values.size)
        gray = sum((image[:, :, c] for c in range(1, image.shape[2])), start=image[:, :, 0].copy()) / np.float32(image.shape[2])
        gray = np.nan_to_num(gray, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
        inside = gray if self.mask is None else gray * self.mask
        share = 1.0 if self.mask is None else float(self.mask.mean())
        facts.mean = float(inside.mean(dtype=np.float64) / share)
        if min(gray.shape) > 1 and facts.mean > 0:
            across = np.abs(np.diff(inside[::2], axis=1)).mean() + np.abs(np.diff(inside[:, ::2], axis=0)).mean()
            facts.sharpness = float(across / 2 / share / facts.mean)
        step = -(-max(self.shape) // _PICTURE)
        small = _blocks(gray, step)
        self._grids[facts.number] = self._grid(small if self.mask is None else _blocks(inside, step), step)
        if min(small.shape) >= _LEAST_SIDE:
            self._edges[facts.number] = _edges(small)

    def judge(self, facts: Sequence[ImageFacts]) -> None:
        """Fill in shifts, factors and remarks of the images that were added."""
        read = [f for f in facts if f.number in self._grids and np.isfinite(f.light).all() and f.light[2] > 0]
        bright = float(np.median([f.mean for f in read])) if read else 0.0
        for one in read:
            if one.mean <= 1e-3 * bright:
                one.remark, one.odd = "black", True
        rest = [one for one in read if not one.odd]
        if len(rest) < _LEAST:
            return
        self._find_shifts(rest)
        lit = [one for one in rest if not one.odd]
        if len(lit) >= _LEAST:
            self._find_wrong_lights(lit)
        right = [one for one in lit if not one.odd]
        if len(right) >= _LEAST and not self.disorder:
            self._find_wrong_levels(lit, right)

    def _grid(self, small: Array, step: int) -> Array:
        block = -(-max(small.shape) // _GRID)
        cells = _blocks(small, block).ravel()
        if self.mask is None:
            return cells
        weights = _blocks(_blocks(self.mask.astype(np.float32), step), block).ravel()
        well = weights >= min(0.5, float(weights.max()))
        return np.asarray(cells[well] / weights[well])

    def _find_shifts(self, images: list[ImageFacts]) -> None:
        images = [one for one in images if one.number in self._edges]
        if len(images) < _LEAST:
            return
        step = -(-max(self.shape) // _PICTURE)
        shape = (self.shape[0] // step, self.shape[1] // step)
        lights = np.array([one.light for one in images])
        near = np.argsort(-(lights @ lights.T), axis=1, kind="stable")
        shifts, likeness = np.zeros((len(images), 2)), np.zeros(len(images))
        for k, one in enumerate(images):
            others = [self._edges[images[j].number] for j in near[k, :7] if j != k]
            shifts[k], likeness[k] = _shift(self._edges[one.number], np.mean(others, axis=0), shape)
            one.shift = float(shifts[k, 0] * step), float(shifts[k, 1] * step)
        length = np.hypot(*shifts.T)
        usual = float(np.quantile(length, 0.85, method="lower"))
        alike = float(np.quantile(likeness, 0.15))
        for k, one in enumerate(images):
            if length[k] <= max(_SHIFT[0], _SHIFTS[0] * usual):
                continue
            if likeness[k] < 0.5 * alike:
                one.odd, one.remark = True, "shows something else"
            elif length[k] > max(_SHIFT[1], _SHIFTS[1] * usual):
                one.odd, one.remark = True, f"shifted by {_pixels(one.shift)}"
            else:
                one.remark = f"perhaps shifted by {_pixels(one.shift)}"

    def _find_wrong_lights(self, images: list[ImageFacts]) -> None:
        """Mark images whose light and shade fit another light of the capture far better than their own."""
        lights = np.array([one.light for one in images])
        shade = _shading(np.array([self._grids[one.number] for one in images]))
        if not shade.any():
            return
        settings = _best_settings(shade, lights)
        if _unexplained(shade, lights, settings):
            level = np.log([[max(one.mean, 1e-12)] for one in images])
            level -= np.median(level)
            self.disorder = _unexplained(level, lights, _best_settings(level, lights)) and bool(
                min(np.median(np.abs(level)), np.median(np.abs(shade))) > _SHADED
            )
            return
        apart = np.degrees(np.arccos(np.clip(lights @ lights.T, -1, 1))) > _APART
        inside, gone = list(range(len(images))), list[list[int]]()

        def better_of(chosen: list[int]) -> Array:
            return np.where(apart[np.ix_(chosen, chosen)], _better(shade[chosen], lights[chosen], settings), 0)

        while len(inside) >= _LEAST:
            better = better_of(inside)
            mutual = np.sqrt(better * better.T)
            if mutual.max() > _SWAPPED[1]:
                group = [inside[i] for i in np.unravel_index(int(mutual.argmax()), mutual.shape)]
            elif better.max() > _ELSEWHERE[1]:
                group = [inside[int(better.max(axis=1).argmax())]]
            else:
                break
            inside = [k for k in inside if k not in group]
            gone.append(group)
        if len(inside) < _LEAST:
            return
        for group in gone:
            # Against those that are left: were they misled by others that went?
            tried = [*inside, *group]
            better = better_of(tried)
            swapped = len(group) == 2 and np.sqrt(better[-1, -2] * better[-2, -1]) > _SWAPPED[0]
            for k in group:
                row = better[tried.index(k)]
                if swapped or row.max() > _ELSEWHERE[0]:
                    other = next((j for j in group if j != k), tried[int(row.argmax())])
                    images[k].odd, images[k].remark = True, f"lit from elsewhere: it fits the light of {images[other].name}"
        better = better_of(inside)
        for k, most, pair in zip(inside, better.max(axis=1), np.sqrt(better * better.T).max(axis=1), strict=True):
            if (most > _ELSEWHERE[0] or pair > _SWAPPED[0]) and not images[k].remark:
                images[k].remark = "perhaps lit from elsewhere than listed"

    def _find_wrong_levels(self, images: list[ImageFacts], right: list[ImageFacts]) -> None:
        """Fill in the factors of all ``images``, and mark those brighter or darker than the ``right`` ones suggest."""
        level = np.log([max(one.mean, 1e-12) for one in images])
        lights = np.array([one.light for one in images])
        numbers = {id(one): k for k, one in enumerate(images)}
        inside, out = [numbers[id(one)] for one in right], list[int]()
        settings = _best_settings(level[inside, None], lights[inside])
        while len(inside) >= _LEAST:
            off, limit = _off(level[inside], lights[inside], settings)
            excess = np.abs(off) / limit[1]
            if excess.max() <= 1:
                break
            out.append(inside.pop(int(excess.argmax())))
        if len(inside) < _LEAST:
            return
        off, limit = _off(level[inside], lights[inside], settings)
        for k, by, most in zip(inside, off, limit[0], strict=True):
            images[k].factor = float(np.exp(by))
            if abs(by) > most and not images[k].remark:
                images[k].remark = f"perhaps {_times(by)}"
        for k in range(len(images)):
            if k in inside:
                continue
            off, limit = _off(level[[*inside, k]], lights[[*inside, k]], settings)
            images[k].factor = float(np.exp(off[-1]))
            if k in out and abs(off[-1]) > limit[1][-1]:
                images[k].odd, images[k].remark = True, _times(off[-1])


def _blocks(image: Array, step: int) -> Array:
    """Return the means over square blocks of pixels; rows and columns over are left out."""
    step = min(step, *image.shape)
    rows, columns = image.shape[0] // step, image.shape[1] // step
    return np.asarray(image[: rows * step, : columns * step].reshape(rows, step, columns, step).mean(axis=(1, 3)))


def _edges(small: Array) -> Array:
    """Return the Fourier transform of a picture's edges: gradients of values over their surroundings, faded at the border."""
    around = ndimage.gaussian_filter(small, 3 * max(1.0, max(small.shape) / 100), mode="nearest")
    even = small / (around + 0.02 * abs(float(small.mean())) + 1e-9)
    slope = np.hypot(*(ndimage.gaussian_filter(even, 1.0, order=order, mode="nearest") for order in ((0, 1), (1, 0))))
    slope = np.minimum(slope / (slope.mean() + 1e-12), 4)
    fade = np.outer(*(np.hanning(n + 2)[1:-1] for n in slope.shape))
    return np.asarray(fft.rfft2(((slope - slope.mean()) * fade).astype(np.float32)))


def _shift(first: Array, second: Array, shape: tuple[int, int]) -> tuple[tuple[float, float], float]:
    """Return rows and columns from the second picture to the first, and how alike they are there, up to 1."""
    product = first * second.conj()
    # Half way between correlation and phase correlation: sharp peaks that noise does not make.
    peaks = fft.irfft2(product / np.sqrt(np.maximum(np.abs(product), 1e-12)), shape)
    top = np.unravel_index(int(peaks.argmax()), shape)
    found = []
    for axis, n in enumerate(shape):
        before, at, after = (peaks[tuple((top[a] + (d if a == axis else 0)) % shape[a] for a in (0, 1))] for d in (-1, 0, 1))
        bend = before - 2 * at + after
        place = top[axis] + (0.5 * (before - after) / bend if bend < 0 else 0.0)
        found.append(float(place - n if place > n / 2 else place))
    energy = [float((fft.irfft2(f, shape) ** 2).sum()) for f in (first, second)]
    like = float(fft.irfft2(product, shape).max()) / max(np.sqrt(energy[0] * energy[1]), 1e-12)
    return (found[0], found[1]), like


def _drift(lights: Array) -> Array:
    """Return the polynomial of light directions, and the logarithm of the cosine, that brightness follows roughly."""
    x, y, z = lights.T
    terms = [np.ones_like(x), x, y, np.log(z + 0.05)]
    return np.stack(terms + ([x * x, y * y, x * y] if len(lights) >= 16 else []), axis=1)


@functools.lru_cache(maxsize=6)
def _modes(places: bytes, width: float) -> tuple[Array, Array]:
    """Return the directions (K, n) free of the drift in which the Gaussian process varies, and its variance along each.

    The lights come as the bytes of their array, by which they are found again: brightness and shading need the same ones.
    """
    lights = np.frombuffer(places).reshape(-1, 3)
    left, singular, _ = np.linalg.svd(_drift(lights), full_matrices=False)
    bound = left[:, singular > 1e-6 * singular[0]]
    apart = ((lights[:, None] - lights[None]) ** 2).sum(axis=2)
    free = np.eye(len(lights)) - bound @ bound.T
    # The drift's own directions are given variances that put them last.
    variances, directions = np.linalg.eigh(free @ np.exp(-apart / (2 * width * width)) @ free + 1e6 * (bound @ bound.T))
    count = len(lights) - bound.shape[1]
    return directions[:, :count], np.maximum(variances[:count], 0)


def _left_out(values: Array, lights: Array, settings: tuple[float, float]) -> tuple[Array, Array]:
    """Return (K, n) values less what the others predict, and (K,) the standard deviations of that up to one factor."""
    width, noise = settings
    return _errors(values, *_modes(lights.tobytes(), width), noise)


def _errors(values: Array, directions: Array, variances: Array, noise: float) -> tuple[Array, Array]:
    """Return the errors and their spreads in the closed form (Dubrule, equation 13)."""
    weighted = directions / (variances + noise)
    own = np.maximum((weighted * directions).sum(axis=1), 1e-9)
    return (weighted @ (directions.T @ values)) / own[:, None], 1 / np.sqrt(own)


def _best_settings(values: Array, lights: Array) -> tuple[float, float]:
    """Return the width and noise with which the images predict each other best."""
    errors = {}
    for width in _WIDTHS:
        modes = _modes(lights.tobytes(), width)
        for noise in _NOISES:
            errors[width, noise] = np.sqrt((_errors(values, *modes, noise)[0] ** 2).mean(axis=1)).mean()
    return min(errors, key=lambda setting: errors[setting])


def _unexplained(values: Array, lights: Array, settings: tuple[float, float]) -> bool:
    """Return whether the other images and the lights hardly say what an image is like."""
    left, spread = (np.median(np.sqrt((v**2).mean(axis=1))) for v in (_left_out(values, lights, settings)[0], values))
    return bool(left > _UNEXPLAINED * spread)


def _off(level: Array, lights: Array, settings: tuple[float, float]) -> tuple[Array, tuple[Array, Array]]:
    """Return by how much each logarithm of brightness is off, and the limits over which it is marked and left out."""
    off, spread = _left_out(level[:, None], lights, settings)
    usual = 1.4826 * float(np.median(np.abs(off[:, 0]) / spread))
    marked, gone = (np.maximum(least, times * usual * spread) for least, times in zip(_FACTOR, _SPREADS, strict=True))
    return off[:, 0], (marked, gone)


def _shading(grids: Array) -> Array:
    """Return (K, n) logarithms of values over the image's mean and over what is usual at their place."""
    grids = np.maximum(grids, 0)
    grids = grids[:, grids.mean(axis=0) > 0.15 * grids.mean()]
    level = grids / np.maximum(grids.mean(axis=1, keepdims=True), 1e-12)
    usual = np.median(level, axis=0)
    shade = np.log(level / np.maximum(usual, 0.05 * usual.mean() + 1e-12) + 0.05)
    return np.asarray(shade - shade.mean(axis=1, keepdims=True))


def _better(shade: Array, lights: Array, settings: tuple[float, float]) -> Array:
    """Return (K, K) how many times nearer each image is to what is predicted for a light than for its own."""
    predicted = shade - _left_out(shade, lights, settings)[0]
    predicted -= predicted.mean(axis=1, keepdims=True)
    square = (shade**2).sum(axis=1)[:, None] + (predicted**2).sum(axis=1)[None] - 2 * shade @ predicted.T
    far = np.sqrt(np.maximum(square, 1e-12))
    return np.asarray(np.diag(far)[:, None] / far)


def _times(off: float) -> str:
    return f"{np.exp(abs(off)):.2f} times too {'bright' if off > 0 else 'dark'}"


def _pixels(shift: tuple[float, float] | None) -> str:
    rows, columns = shift or (0.0, 0.0)
    return f"{np.hypot(rows, columns):.1f} pixels"


def table_lines(facts: Sequence[ImageFacts]) -> list[str]:
    """Return the lines of a table with a row per photograph."""
    width = min(36, max([len("photograph"), *(len(one.name) for one in facts)]))
    heads = f"{'tilt':>5} {'slant':>5} {'mean/cos':>8} {'over':>6} {'black':>6} {'sharp':>6} {'shift':>7}"
    lines = [f"{'no.':>4} {'photograph':<{width}} {heads}"]
    for one in facts:
        tilt, slant = (float(a) for a in tilt_and_slant(one.light)) if np.isfinite(one.light).all() else (np.nan, np.nan)
        name = one.name if len(one.name) <= width else f"…{one.name[1 - width :]}"
        with np.errstate(over="ignore"):
            over_cosine = one.mean / one.light[2] if one.light[2] > 0 else np.nan
        cells = [
            f"{one.number:>4} {name:<{width}}",
            *(f"{v:>5.1f}" if np.isfinite(v) else f"{'-':>5}" for v in (tilt, slant)),
            f"{over_cosine:>8.3f}" if np.isfinite(over_cosine) else f"{'-':>8}",
            *(f"{v:>6.1%}" if np.isfinite(v) else f"{'-':>6}" for v in (one.over, one.black)),
            f"{one.sharpness:>6.3f}" if np.isfinite(one.sharpness) else f"{'-':>6}",
            f"{'-':>7}" if one.shift is None else f"{np.hypot(*one.shift):>7.1f}",
        ]
        mark = "" if not one.remark else f"  * {one.remark}" + ("" if one.used else ", left out")
        lines.append(" ".join(cells) + mark)
    return lines
