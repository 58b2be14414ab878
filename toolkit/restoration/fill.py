"""Multiresolution synthesis inside a mask by causal kernels of eight orientations (Yamauchi et al. 2005, section 5.4)."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array, Progress
from intaglio.errors import InputError
from intaglio.kernels.launch import single_threaded_blas
from intaglio.synthesis import NearestWindows, smooth_plane

# The 5 x 5 causal kernel: two rows above, and two pixels to the left.
_CAUSAL = [(-2, dx) for dx in range(-2, 3)] + [(-1, dx) for dx in range(-2, 3)] + [(0, -2), (0, -1)]
_AROUND = [(dy, dx) for dy in range(-1, 2) for dx in range(-1, 2)]

# Its eight orientations (figure 14): quarter turns, and their mirror images.
_QUARTER = np.array([[0, 1], [-1, 0]])
_MIRROR = np.array([[1, 0], [0, -1]])
ORIENTATIONS = np.stack([np.linalg.matrix_power(_QUARTER, q) @ m for m in (np.eye(2, dtype=int), _MIRROR) for q in range(4)])

# _AFTER[a, b]: the orientation that applies b and then a. _FROM[a, b]: the one that leads from b to a.
_AFTER = np.array([[[np.array_equal(a @ b, c) for c in ORIENTATIONS].index(True) for b in ORIENTATIONS] for a in ORIENTATIONS])
_FROM = np.array([[[np.array_equal(a @ b.T, c) for c in ORIENTATIONS].index(True) for b in ORIENTATIONS] for a in ORIENTATIONS])

# The steps of the kernel in each orientation: on a pixel's own level, and on the next coarser one.
_OWN, _COARSE = (np.stack([np.array(pattern) @ turn.T for turn in ORIENTATIONS]) for pattern in (_CAUSAL, _AROUND))

# The most neighbourhoods in one search structure; larger images are searched at evenly spread ones. Coherent candidates may lie
# anywhere.
_MOST_WINDOWS = 8_000

# Principal components by which neighbourhoods are searched; the candidates found are then compared in full.
_COMPONENTS = 24

# Rings behind the outermost one that are filled at the same time.
_RINGS = 8

# Pixels whose kernels are examined at a time, to bound memory.
_AT_ONCE = 100_000

# Width of the frame around an image that kernels may reach into.
_FRAME = 2


class _Level:
    """One level of the pyramid.

    Attributes
    ----------
    values : (H, W, C) float32 array
        What is known, and estimates elsewhere, replaced as they are synthesised.
    known : (H, W) bool array
        Pixels that no missing one contributed to.
    chart : (H, W) int32 array
        Number of the chart that a pixel lies in, 0 outside.
    source : (H, W, 2) int32 array
        Place that each pixel copies; itself where known, -1 where nothing yet.
    turn : (H, W) int8 array
        Orientation in which the pixel's surroundings appear about its source.
    """

    def __init__(self, values: Array, known: Array, chart: Array) -> None:
        self.known, self.chart = known, chart
        # With a frame around, neighbours of a pixel are at fixed steps from it in one flat array.
        framed = np.pad(values, ((_FRAME, _FRAME), (_FRAME, _FRAME), (0, 0)), mode="edge")
        self.values = framed[_FRAME:-_FRAME, _FRAME:-_FRAME]
        self._flat, self._width = framed.reshape(-1, values.shape[2]), framed.shape[1]
        places = np.moveaxis(np.indices(known.shape), 0, 2).astype(np.int32)
        self.source = np.where(known[:, :, None], places, -1)
        self.turn = np.zeros(known.shape, np.int8)

    def around(self, pixels: Array, steps: Array) -> Array:
        """Return the values (M, K C) at ``steps`` (M, K, 2) or (K, 2), at most `_FRAME` long, from pixels (M, 2)."""
        at = (pixels[:, 0] + _FRAME) * self._width + pixels[:, 1] + _FRAME
        step = steps[..., 0] * self._width + steps[..., 1]
        return self._flat.take(at[:, None] + step, axis=0).reshape(len(pixels), -1)


def synthesize_hole(
    high: Array,
    missing: Array,
    chart: Array,
    *,
    levels: int,
    coherence: float,
    orientations: int,
    progress: Progress | None = None,
) -> tuple[Array, Array]:
    """Return the pixel (H, W, 2) that every pixel of a band copies, itself where known, and the orientation (H, W).

    Parameters
    ----------
    high : (H, W, C) float32 array
        The band; values where ``missing`` are estimates, used where a kernel has nothing better.
    missing : (H, W) bool array
    chart : (H, W) int array
        0 outside; neighbourhoods do not leave the chart of their pixel.
    levels : int
        Levels of the Gaussian pyramid, n + 1 in section 5.4.
    coherence : float
        Kappa of coherent matching (Hertzmann et al. 2001): on the finest level, the pixel next to the source of
        a neighbour is taken if its squared distance is at most 1 + coherence times that of the nearest neighbourhood; on each
        coarser level the coherence is halved.
    orientations : int
        1 compares with neighbourhoods as they are, 8 also with turned and mirrored ones.
    progress : callable, optional
        Called with the pixels done and all pixels, over all levels.

    Raises
    ------
    InputError
        If no whole neighbourhood is known.

    References
    ----------
    Yamauchi et al., "Textures Revisited", The Visual Computer 21, 2005, section 5.4.
    """
    pyramid = _build_pyramid(high, missing, chart, levels)
    total = sum(int((~level.known & (level.chart > 0)).sum()) for level in pyramid)
    done = 0
    with single_threaded_blas():
        for number in range(len(pyramid) - 1, -1, -1):
            if number + 1 < len(pyramid):
                _expand_level(pyramid[number], pyramid[number + 1])
            done = _fill_level(pyramid, number, coherence / 2**number, orientations, done, total, progress)
    return pyramid[0].source, pyramid[0].turn


def _build_pyramid(high: Array, missing: Array, chart: Array, levels: int) -> list[_Level]:
    """Return levels, finest first, as many as leave whole neighbourhoods to copy from."""
    found: list[_Level] = []
    values, known, chart = high.astype(np.float32), ~missing & (chart > 0), chart.astype(np.int32)
    for number in range(levels):
        if number and not find_whole_neighborhoods(known, chart).any():
            break
        found.append(_Level(values, known, chart))
        # A coarse pixel is known if no missing pixel has any weight in it (the quantised mask pyramid of section 5.4).
        touched = ndimage.maximum_filter(~known & (chart > 0), 5, mode="constant")
        inside = (chart > 0).astype(np.float32)
        weight = smooth_plane(inside)
        planes = [smooth_plane(values[:, :, c] * inside) / np.maximum(weight, 1e-6) for c in range(values.shape[2])]
        values = np.stack(planes, axis=2)[::2, ::2].astype(np.float32)
        known, chart = (~touched & (chart > 0))[::2, ::2], chart[::2, ::2]
        if min(known.shape) < 16:
            break
    return found


def find_whole_neighborhoods(known: Array, chart: Array) -> Array:
    """Return the pixels, (H, W) bool, whose 5 x 5 surroundings are known and of one chart."""
    same = ndimage.minimum_filter(chart, 5, mode="constant") == ndimage.maximum_filter(chart, 5, mode="constant")
    return np.asarray(ndimage.minimum_filter(known, 5, mode="constant", cval=0) & same)


def _expand_level(level: _Level, coarse: _Level) -> None:
    """Copy the values of the coarser level to the missing pixels of this one."""
    height, width = level.known.shape
    large = np.repeat(np.repeat(coarse.values, 2, axis=0), 2, axis=1)[:height, :width]
    open_now = ~level.known & (level.chart > 0)
    level.values[open_now] = large[open_now]


def _fill_level(
    pyramid: list[_Level],
    number: int,
    coherence: float,
    orientations: int,
    done: int,
    total: int,
    progress: Progress | None,
) -> int:
    """Synthesise the missing pixels of one level from the border inwards; return the number of pixels done."""
    level = pyramid[number]
    open_now = ~level.known & (level.chart > 0)
    if not open_now.any():
        return done
    whole = find_whole_neighborhoods(level.known, level.chart)
    if not whole.any():
        raise InputError("no 5 x 5 neighbourhood of known pixels is left to copy from; the mask covers nearly everything")
    table = _Table(pyramid, number, np.argwhere(whole), orientations)
    pixels = np.argwhere(open_now)
    ring = ndimage.distance_transform_cdt(open_now, metric="taxicab")[open_now]
    front = _Front(open_now, level.chart, pixels, ring)
    finished = 0
    while finished < len(pixels):
        chosen = front.next_pixels()
        source, turn = _match_pixels(pyramid, number, table, pixels[chosen], front.orientation(chosen), coherence, whole)
        y, x = pixels[chosen].T
        level.source[y, x], level.turn[y, x] = source, turn
        level.values[y, x] = level.values[source[:, 0], source[:, 1]]
        front.fill(chosen)
        finished += len(chosen)
        if progress is not None:
            progress(done + finished, total)
    return done + finished


class _Front:
    """The pixels to fill next: the missing pixels of all kernels are counted, and the counts follow as pixels are filled.

    Parameters
    ----------
    open_now : (H, W) bool array
    chart : (H, W) int array
    pixels : (M, 2) int array
        The open ones, in order.
    ring : (M,) int array
        Their distances from the border; nearer ones come first.
    """

    def __init__(self, open_now: Array, chart: Array, pixels: Array, ring: Array) -> None:
        self._number: Array = np.full(open_now.shape, -1)
        self._number[open_now] = np.arange(len(pixels))
        self._chart, self._pixels, self._ring = chart, pixels, ring
        self._filled = np.zeros(len(pixels), bool)
        self._by_ring = np.argsort(ring, kind="stable")
        self._first = 0
        self._limit = int(ring.min())
        self._lacking = np.empty((len(pixels), 8), np.int16)
        for first in range(0, len(pixels), _AT_ONCE):
            part = pixels[first : first + _AT_ONCE]
            within, y, x = self._places(part[:, None, None, :] + _OWN, chart[part[:, 0], part[:, 1]][:, None, None])
            self._lacking[first : first + _AT_ONCE] = len(_CAUSAL) - (within & ~open_now[y, x]).sum(axis=2)
        self._ready = np.flatnonzero((self._lacking == 0).any(axis=1))

    def next_pixels(self) -> Array:
        """Return the numbers of all pixels with a complete kernel, up to a few rings behind the outermost one that has any.

        Pixels without a complete kernel wait for the next ring. A front moves along a ring pixel by pixel; large holes are
        fast because several rings are filled at the same time, each a step behind the one before. If no kernel is complete
        anywhere (a hole at the image's border, or only slivers known), the outermost pixels are next, with the kernels that
        lack least.
        """
        if len(self._ready):
            self._limit = max(self._limit, int(self._ring[self._ready].min()))
            now = self._ring[self._ready] <= self._limit + _RINGS
            chosen, self._ready = self._ready[now], self._ready[~now]
            return np.sort(chosen)
        while self._filled[self._by_ring[self._first]]:
            self._first += 1
        rest = self._by_ring[self._first :]
        rest = rest[self._ring[rest] == self._ring[rest[0]]]
        return np.sort(rest[~self._filled[rest]])

    def _places(self, at: Array, chart: Array) -> tuple[Array, Array, Array]:
        """Return which positions (…, 2) are in the image and the ``chart``, and their rows and columns, clipped to the image."""
        height, width = self._number.shape
        y, x = np.clip(at[..., 0], 0, height - 1), np.clip(at[..., 1], 0, width - 1)
        within = (y == at[..., 0]) & (x == at[..., 1]) & (self._chart[y, x] == chart)
        return within, y, x

    def orientation(self, which: Array) -> Array:
        """Return, for each open pixel of ``which`` (by number), an orientation whose kernel lacks least; few different ones."""
        lacking = self._lacking[which]
        possible = lacking == lacking.min(axis=1, keepdims=True)
        found = np.full(len(which), -1)
        while (found < 0).any():
            common = int(possible[found < 0].sum(axis=0).argmax())
            found[(found < 0) & possible[:, common]] = common
        return found

    def fill(self, chosen: Array) -> None:
        """Count pixels, by number, as filled."""
        self._filled[chosen] = True
        pixels = self._pixels[chosen]
        self._number[pixels[:, 0], pixels[:, 1]] = -1
        within, y, x = self._places(pixels[:, None, None, :] - _OWN, self._chart[pixels[:, 0], pixels[:, 1]][:, None, None])
        number = np.where(within, self._number[y, x], -1)
        orientation = np.nonzero(number >= 0)[1]
        number = number[number >= 0]
        was_ready = (self._lacking[number] == 0).any(axis=1)
        np.subtract.at(self._lacking, (number, orientation), 1)
        fresh = number[~was_ready]
        self._ready = np.union1d(self._ready, fresh[(self._lacking[fresh] == 0).any(axis=1)])


def _neighborhoods(pyramid: list[_Level], number: int, pixels: Array, orientation: Array) -> Array:
    """Return neighbourhood vectors (M, D): the kernel here, 3 x 3 on the next level, single pixels on all higher ones."""
    parts = [pyramid[number].around(pixels, _OWN[orientation])]
    for above in range(number + 1, len(pyramid)):
        steps = _COARSE[orientation] if above == number + 1 else np.zeros((1, 2), int)
        parts.append(pyramid[above].around(pixels >> (above - number), steps))
    return np.concatenate(parts, axis=1)


class _Table:
    """Known neighbourhoods of one level: a search structure for each orientation, or one over all of them."""

    def __init__(self, pyramid: list[_Level], number: int, candidates: Array, orientations: int) -> None:
        # With eight orientations every candidate has eight neighbourhoods: together at most twice _MOST_WINDOWS.
        most = _MOST_WINDOWS // 4 if orientations > 1 else _MOST_WINDOWS
        if len(candidates) > most:
            candidates = candidates[np.linspace(0, len(candidates) - 1, most).astype(int)]
        self._pyramid, self._number, self._all = pyramid, number, orientations > 1
        self._candidates = candidates
        self._nearest: dict[int, NearestWindows] = {}
        self._places = np.tile(candidates, (8, 1)) if self._all else candidates

    def find(self, orientation: int, queries: Array) -> tuple[Array, Array]:
        """Return the place (Q, 2) and orientation (Q,) of the nearest neighbourhood for queries (Q, D) of one orientation."""
        key = 0 if self._all else orientation
        if key not in self._nearest:
            turned = range(8) if self._all else (orientation,)
            rows = [
                _neighborhoods(self._pyramid, self._number, self._candidates, np.full(len(self._candidates), o)) for o in turned
            ]
            self._nearest[key] = NearestWindows(np.concatenate(rows), _COMPONENTS, relative=True)
        found = self._nearest[key].find(queries)
        seen = found // len(self._candidates) if self._all else np.full(len(found), orientation)
        return self._places[found], seen


def _match_pixels(
    pyramid: list[_Level], number: int, table: _Table, pixels: Array, orientation: Array, coherence: float, whole: Array
) -> tuple[Array, Array]:
    """Return the pixel (M, 2) that each pixel copies, and the orientation (M,) in which its surroundings appear there.

    The pixel has the nearest neighbourhood, or continues what a neighbour copies.
    """
    level = pyramid[number]
    query = _neighborhoods(pyramid, number, pixels, orientation)
    place, seen = np.zeros_like(pixels), np.zeros(len(pixels), int)
    for o in np.unique(orientation):
        which = orientation == o
        place[which], seen[which] = table.find(int(o), query[which])
    turn = _FROM[seen, orientation]
    least = _relative_distance(_neighborhoods(pyramid, number, place, seen), query)
    height, width = level.known.shape
    steps = _OWN[orientation]
    around = pixels[:, None, :] + steps
    y, x = np.clip(around[..., 0], 0, height - 1), np.clip(around[..., 1], 0, width - 1)
    turned = level.turn[y, x]
    continued = level.source[y, x] - np.einsum("mkij,mkj->mki", ORIENTATIONS[turned], steps)
    # Known neighbours copy themselves: what continues them is the missing pixel.
    inside = ~level.known[y, x] & (continued >= 0).all(axis=2) & (continued < (height, width)).all(axis=2)
    inside &= level.source[y, x, 0] >= 0
    row, slot = np.nonzero(inside)
    spot = continued[row, slot]
    # Neighbours often agree: one number for pixel, place and orientation.
    size = height * width
    key = np.unique((row * size + spot[:, 0] * width + spot[:, 1]) * 8 + turned[row, slot])
    row, at, leads = key // (8 * size), key // 8 % size, key % 8
    spot = np.stack([at // width, at % width], axis=1)
    usable = whole[spot[:, 0], spot[:, 1]]
    row, spot, leads = row[usable], spot[usable], leads[usable]
    if len(row) == 0:
        return place, turn
    away = _relative_distance(_neighborhoods(pyramid, number, spot, _AFTER[leads, orientation[row]]), query[row])
    order = np.lexsort((away, row))
    order = order[np.concatenate([[True], np.diff(row[order]) != 0])]
    row, spot, leads, away = row[order], spot[order], leads[order], away[order]
    take = away <= least[row] * (1 + coherence)
    place[row[take]], turn[row[take]] = spot[take], leads[take]
    return place, turn


def _relative_distance(a: Array, b: Array) -> Array:
    """Return |a - b|^2 / (|a|^2 + |b|^2) of neighbourhoods (M, D): unlike |a - b|^2, it does not prefer low contrast."""
    both = np.einsum("ij,ij->i", a, a) + np.einsum("ij,ij->i", b, b)
    found: Array = np.einsum("ij,ij->i", a - b, a - b) / np.maximum(both, 1e-12)
    return found
