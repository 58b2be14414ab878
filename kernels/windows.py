"""Pixel synthesis: the search for the sample pixel whose neighbourhood looks most like that of a pixel to be synthesised.

A neighbourhood is a square window of the pixel's own level of a pyramid, of which only what is there already counts, and
3 x 3 pixels of the coarser level around the pixel's parent. Sample neighbourhoods lie in groups of 16, element by element:
element k of the 16 in group g is one vector. Four groups are compared at a time, and given up as soon as none of their 64
can be the best.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from intaglio.kernels.lanes import ABSOLUTE, LANES, RELATIVE, SLACK, UNUSABLE, absolute_terms, difference, squared_terms, vec16
from intaglio.kernels.launch import launch, single_threaded_blas

wp.set_module_options({"enable_backward": False})

# The parent's surroundings: 3 x 3.
PARENTS = wp.constant(9)

# Groups compared at a time.
TOGETHER = wp.constant(4)

# Groups may be given up after any of this many parts.
PARTS = wp.constant(6)

# Bytes of sample neighbourhoods that a thread compares with one target after the other: they stay in its cache.
_CHUNK_BYTES = 200_000


@wp.func
def enlist(
    t: int,
    listed: int,
    position: int,
    source: int,
    planes: wp.array2d[wp.float32],
    sign: wp.array[wp.float32],
    positions: int,
    element: wp.array2d[wp.int32],
    value: wp.array2d[wp.float32],
):
    """Append one known pixel to a target's lists: its summary, and all its maps."""
    maps = planes.shape[0]
    total = float(0.0)
    for c in range(maps):
        v = planes[c, source]
        total += sign[c] * v
        element[t, positions + listed * maps + c] = positions + position * maps + c
        value[t, positions + listed * maps + c] = v
    element[t, listed] = position
    value[t, listed] = total


@wp.kernel
def _gather(
    start: int,
    first: int,
    target: wp.array[wp.vec2i],
    window: int,
    wrap: int,
    canvas: wp.array2d[wp.int32],
    planes: wp.array2d[wp.float32],
    coarse_canvas: wp.array2d[wp.int32],
    coarse_planes: wp.array2d[wp.float32],
    has_coarse: int,
    sign: wp.array[wp.float32],
    positions: int,
    # output
    element: wp.array2d[wp.int32],
    value: wp.array2d[wp.float32],
    count: wp.array[wp.int32],
):
    """List what is known of one target's neighbourhood, first the coarser level's pixels, then its own.

    The first ``positions`` entries are for summaries of pixels, the others for their maps.
    """
    t = start + wp.tid()
    at = target[first + t]
    area = window * window
    listed = int(0)
    if has_coarse == 1:
        rows = coarse_canvas.shape[0]
        columns = coarse_canvas.shape[1]
        for j in range(PARENTS):
            y = at[0] / 2 + j / 3 - 1
            x = at[1] / 2 + j % 3 - 1
            if wrap == 1:
                y = (y + rows) % rows
                x = (x + columns) % columns
            if y >= 0 and x >= 0 and y < rows and x < columns:
                source = coarse_canvas[y, x]
                if source >= 0:
                    enlist(t, listed, area + j, source, coarse_planes, sign, positions, element, value)
                    listed += 1
    reach = window / 2
    rows = canvas.shape[0]
    columns = canvas.shape[1]
    for j in range(area):
        y = at[0] + j / window - reach
        x = at[1] + j % window - reach
        if wrap == 1:
            y = (y + rows * window) % rows
            x = (x + columns * window) % columns
        # On a torus no larger than the window, the pixel itself comes again.
        if y >= 0 and x >= 0 and y < rows and x < columns and (y != at[0] or x != at[1]):
            source = canvas[y, x]
            if source >= 0:
                enlist(t, listed, j, source, planes, sign, positions, element, value)
                listed += 1
    count[t] = listed


@wp.kernel
def _propose(
    start: int,
    first: int,
    target: wp.array[wp.vec2i],
    exhaustive: wp.array[wp.uint8],
    window: int,
    wrap: int,
    canvas: wp.array2d[wp.int32],
    sample_width: int,
    slot: wp.array[wp.int32],
    elements: int,
    neighbourhoods: wp.array[wp.float32],
    element: wp.array2d[wp.int32],
    value: wp.array2d[wp.float32],
    positions: int,
    maps: int,
    squared: int,
    # output
    count: wp.array[wp.int32],
    bound: wp.array[wp.float32],
    pixel: wp.array[wp.int32],
):
    """Bound the best cost by that of the pixels that continue what was copied around the target (Ashikhmin 2001).

    A target that need not be searched takes the pixel next to its left neighbour's source, if there is one (Dong, section
    5.3.1); its list is emptied then, with a count of -1.
    """
    t = start + wp.tid()
    at = target[first + t]
    rows = canvas.shape[0]
    columns = canvas.shape[1]
    area = window * window
    reach = window / 2
    best = float(UNUSABLE)
    chosen = int(-1)
    if exhaustive[first + t] == wp.uint8(0) and at[1] > 0:
        source = canvas[at[0], at[1] - 1]
        if source >= 0 and source % sample_width + 1 < sample_width:  # noqa: SIM102
            if slot[source + 1] >= 0:
                chosen = source + 1
    if chosen >= 0:
        count[t] = -1
        pixel[t] = chosen
        bound[t] = -1.0
        return
    before = int(-1)
    for j in range(area):
        dy = j / window - reach
        dx = j % window - reach
        y = at[0] + dy
        x = at[1] + dx
        if wrap == 1:
            y = (y + rows * window) % rows
            x = (x + columns * window) % columns
        if y >= 0 and x >= 0 and y < rows and x < columns:
            source = canvas[y, x]
            if source >= 0:
                column = source % sample_width - dx
                candidate = source - dy * sample_width - dx
                inside = column >= 0 and column < sample_width and candidate >= 0 and candidate < slot.shape[0]
                # Most neighbours continue one piece.
                if inside and candidate != before:
                    before = candidate
                    s = slot[candidate]
                    if s >= 0:
                        total = float(0.0)
                        lane = (s / LANES) * elements * LANES + s % LANES
                        for i in range(positions, positions + count[t] * maps):
                            total += difference(neighbourhoods[lane + element[t, i] * LANES], value[t, i], squared)
                        if total < best:
                            best = total
                            chosen = candidate
    # Rounding may differ from the search's: the bound must let the candidate itself pass.
    bound[t] = best * (SLACK + RELATIVE * float(count[t] * maps))
    pixel[t] = chosen


def _search_kernel(terms: Any) -> wp.Kernel:
    """Return the search kernel for one metric."""

    @wp.kernel
    def window_search(
        start: int,
        groups: int,
        chunk: int,
        elements: int,
        neighbourhoods: wp.array[vec16],
        place: wp.array[wp.int32],
        element: wp.array2d[wp.int32],
        value: wp.array2d[wp.float32],
        count: wp.array[wp.int32],
        bound: wp.array[wp.float32],
        positions: int,
        maps: int,
        scale: float,
        # output
        cost: wp.array2d[wp.float32],
        pixel: wp.array2d[wp.int32],
    ):
        """Find the nearest of one chunk's neighbourhoods; of equal ones, the pixel that comes first in the sample.

        Summaries, signed sums over a pixel's maps, bound the cost from below: |Σ±d| <= Σ|d|, and (Σ±d)^2 <= n Σd^2.
        """
        i, t = wp.tid()
        c = start + i
        listed = count[t]
        best = bound[t]
        found = int(-1)
        if listed > 0:
            for g in range(c * chunk, wp.min(groups, (c + 1) * chunk), TOGETHER):
                base = g * elements
                passes = int(1)
                if maps > 1:
                    # Rounding may lift a bound above the cost it bounds: a summary is a sum of ``maps`` values up to 1.
                    amount = ABSOLUTE + 2.0 * RELATIVE * float(maps * maps)
                    limit = (best * (SLACK + RELATIVE * float(listed * maps)) + amount * float(listed)) / scale
                    s0 = vec16(0.0)
                    s1 = vec16(0.0)
                    s2 = vec16(0.0)
                    s3 = vec16(0.0)
                    begun = int(0)
                    for part in range(PARTS):
                        stop = (listed * (part + 1)) / PARTS
                        for j in range(begun, stop):
                            v = value[t, j]
                            k = base + element[t, j]
                            s0 += terms(neighbourhoods[k], v)
                            s1 += terms(neighbourhoods[k + elements], v)
                            s2 += terms(neighbourhoods[k + 2 * elements], v)
                            s3 += terms(neighbourhoods[k + 3 * elements], v)
                        begun = stop
                        if wp.min(wp.min(wp.min(s0, s1), wp.min(s2, s3))) > limit:
                            passes = 0
                            break
                if passes == 1:
                    t0 = vec16(0.0)
                    t1 = vec16(0.0)
                    t2 = vec16(0.0)
                    t3 = vec16(0.0)
                    in_all = positions + listed * maps
                    done = positions
                    least = float(0.0)
                    for part in range(PARTS):
                        stop = positions + (listed * maps * (part + 1)) / PARTS
                        for j in range(done, stop):
                            v = value[t, j]
                            k = base + element[t, j]
                            t0 += terms(neighbourhoods[k], v)
                            t1 += terms(neighbourhoods[k + elements], v)
                            t2 += terms(neighbourhoods[k + 2 * elements], v)
                            t3 += terms(neighbourhoods[k + 3 * elements], v)
                        done = stop
                        least = wp.min(wp.min(wp.min(t0, t1), wp.min(t2, t3)))
                        if least > best:
                            break
                    if least <= best and done == in_all:
                        for q in range(TOGETHER):
                            total = t0
                            if q == 1:
                                total = t1
                            if q == 2:
                                total = t2
                            if q == 3:
                                total = t3
                            for lane in range(LANES):
                                if total[lane] == least:
                                    at = place[(g + q) * LANES + lane]
                                    if least < best or found < 0 or at < found:
                                        best = least
                                        found = at
        cost[t, c] = wp.where(found >= 0, best, float(UNUSABLE))
        pixel[t, c] = found

    return window_search


_absolute_search = _search_kernel(absolute_terms)
_squared_search = _search_kernel(squared_terms)


@wp.kernel
def _pick(
    start: int,
    first: int,
    target: wp.array[wp.vec2i],
    count: wp.array[wp.int32],
    cost: wp.array2d[wp.float32],
    nearest: wp.array2d[wp.int32],
    pixel: wp.array[wp.int32],
    uniform: wp.array[wp.float32],
    place: wp.array[wp.int32],
    candidates: int,
    # output
    canvas: wp.array2d[wp.int32],
):
    """Copy the best of all chunks; a pixel of which nothing is known, any."""
    t = start + wp.tid()
    at = target[first + t]
    chosen = int(-1)
    if count[t] < 0:
        chosen = pixel[t]
    elif count[t] == 0:
        chosen = place[wp.min(candidates - 1, int(uniform[first + t] * float(candidates)))]
    else:
        # What is found continues the neighbours at worst.
        chosen = pixel[t]
        best = float(UNUSABLE)
        for c in range(cost.shape[1]):
            if nearest[t, c] >= 0 and (cost[t, c] < best or (cost[t, c] == best and nearest[t, c] < chosen)):
                best = cost[t, c]
                chosen = nearest[t, c]
    canvas[at[0], at[1]] = chosen


@dataclass(frozen=True)
class Level:
    """One level of a pyramid, as the search sees it.

    Attributes
    ----------
    planes : (n, H, W) float32 array
        The sample's maps, scaled for matching.
    canvas : (h, w) int32 array
        For each pixel of the result the flat index of the sample pixel it copies, -1 where there is none (yet).
    """

    planes: np.ndarray
    canvas: np.ndarray


class WindowSearch:
    """Synthesises the pixels of one level.

    Parameters
    ----------
    level : Level
    coarse : Level, optional
        The next coarser one, synthesised.
    candidates : (M, 2) int array
        Pixels that may be copied: their windows, and the 3 x 3 pixels around their parents, lie in the sample.
    order : (M,) int array
        In which order to group candidates: similar ones together.
    window : int
        Odd.
    squared, wrap : bool
        Squared instead of absolute differences; whether the result wraps around.
    device : str
    """

    def __init__(
        self,
        level: Level,
        coarse: Level | None,
        candidates: np.ndarray,
        order: np.ndarray,
        *,
        window: int,
        squared: bool,
        wrap: bool,
        device: str,
    ) -> None:
        self.device = device
        self._window, self._squared, self._wrap = window, int(squared), int(wrap)
        maps, height, self._width = level.planes.shape
        self._count = len(candidates)
        flat = (candidates[:, 0] * self._width + candidates[:, 1])[order]
        rows = neighbourhoods(level, coarse, candidates[order], window)
        self._maps, self._positions = maps, rows.shape[1] // maps
        signs = _signs(level.planes)
        rows = np.concatenate([_summaries(rows, signs), rows], axis=1)
        self._sign = wp.array(signs, dtype=float, device=device)
        self._elements = rows.shape[1]
        padded = -len(rows) % (LANES * int(TOGETHER))
        # Padding costs more than any bound.
        rows = np.concatenate([rows, np.full((padded, self._elements), UNUSABLE, np.float32)])
        self._groups = len(rows) // LANES
        blocked = np.ascontiguousarray(rows.reshape(self._groups, LANES, -1).transpose(0, 2, 1))
        self._numbers = wp.array(blocked.ravel(), dtype=float, device=device)
        self._lanes = wp.array(ptr=self._numbers.ptr, dtype=vec16, shape=(blocked.size // LANES,), device=device)
        self._place = wp.array(np.concatenate([flat, np.zeros(padded)]).astype(np.int32), dtype=wp.int32, device=device)
        slot = np.full(height * self._width, -1, np.int32)
        slot[flat] = np.arange(len(flat))
        self._slot = wp.array(slot, dtype=wp.int32, device=device)
        self._chunk = int(TOGETHER) * max(1, _CHUNK_BYTES // (int(TOGETHER) * 4 * LANES * self._elements))
        self._chunks = -(-self._groups // self._chunk)

        self._planes = wp.array(level.planes.reshape(maps, -1), dtype=float, device=device)
        self._canvas = wp.array(np.ascontiguousarray(level.canvas, np.int32), dtype=wp.int32, device=device)
        self._has_coarse = int(coarse is not None)
        above = level if coarse is None else coarse
        self._coarse_planes = wp.array(above.planes.reshape(maps, -1), dtype=float, device=device)
        self._coarse_canvas = wp.array(np.ascontiguousarray(above.canvas, np.int32), dtype=wp.int32, device=device)

    @property
    def canvas(self) -> np.ndarray:
        """(h, w) int32: flat index of the sample pixel that each pixel copies."""
        return np.array(self._canvas.numpy())

    def synthesise(
        self, targets: np.ndarray, waves: np.ndarray, exhaustive: np.ndarray, uniform: np.ndarray, done: Any = None
    ) -> None:
        """Synthesise ``targets`` (T, 2), wave after wave; what a wave makes is seen by the next ones alone.

        Parameters
        ----------
        targets : (T, 2) array
            Rows and columns.
        waves : (waves + 1,) array
            Where each begins.
        exhaustive : (T,) bool array
            Search in any case; else the left neighbour's continuation is taken where there is one.
        uniform : (T,) array
            A random number in [0, 1) for each.
        done : callable, optional
            Called with the number of targets synthesised.
        """
        if len(targets) == 0:
            return
        device = self.device
        target = wp.array(np.ascontiguousarray(targets, np.int32), dtype=wp.vec2i, device=device)
        searched = wp.array(exhaustive.astype(np.uint8), dtype=wp.uint8, device=device)
        random = wp.array(uniform.astype(np.float32), dtype=float, device=device)
        most = int(np.diff(waves).max(initial=1))
        element = wp.zeros((most, self._elements), dtype=wp.int32, device=device)
        value = wp.zeros((most, self._elements), dtype=float, device=device)
        count = wp.zeros(most, dtype=wp.int32, device=device)
        bound = wp.zeros(most, dtype=float, device=device)
        pixel = wp.zeros(most, dtype=wp.int32, device=device)
        cost = wp.zeros((most, self._chunks), dtype=float, device=device)
        nearest = wp.zeros((most, self._chunks), dtype=wp.int32, device=device)
        kernel = _squared_search if self._squared else _absolute_search
        for first, stop in zip(waves[:-1].tolist(), waves[1:].tolist(), strict=True):
            size = stop - first
            if size == 0:
                continue
            self._launch(
                _gather,
                size,
                [
                    first, target, self._window, self._wrap, self._canvas, self._planes, self._coarse_canvas,
                    self._coarse_planes, self._has_coarse, self._sign, self._positions,
                ],
                [element, value, count],
                work=4 * self._elements,
            )  # fmt: skip
            self._launch(
                _propose,
                size,
                [
                    first, target, searched, self._window, self._wrap, self._canvas, self._width, self._slot,
                    self._elements, self._numbers, element, value, self._positions, self._maps, self._squared,
                ],
                [count, bound, pixel],
                work=8 * self._window * self._elements,
            )  # fmt: skip
            self._launch(
                kernel,
                (self._chunks, size),
                [
                    self._groups, self._chunk, self._elements, self._lanes, self._place, element, value, count, bound,
                    self._positions, self._maps, 1 / self._maps if self._squared else 1.0,
                ],
                [cost, nearest],
                work=size * self._chunk * self._elements / 3,
            )  # fmt: skip
            self._launch(
                _pick,
                size,
                [first, target, count, cost, nearest, pixel, random, self._place, self._count],
                [self._canvas],
                work=2 * self._chunks,
            )
            if done is not None:
                done(stop)

    def _launch(self, kernel: wp.Kernel, dim: Any, inputs: list[Any], outputs: list[Any], work: float) -> None:
        launch(kernel, dim, inputs, outputs, device=self.device, work=work)


def neighbourhoods(level: Level, coarse: Level | None, candidates: np.ndarray, window: int) -> np.ndarray:
    """Return the sample's neighbourhoods (M, K) of ``candidates`` (M, 2): the window, then the parent's 3 x 3, all maps."""
    reach = window // 2
    at = np.arange(window) - reach
    y, x = candidates[:, 0, None, None], candidates[:, 1, None, None]
    own = level.planes[:, y + at[None, :, None], x + at[None, None, :]]
    parts = [np.moveaxis(own, 0, -1).reshape(len(candidates), -1)]
    if coarse is not None:
        at = np.arange(3) - 1
        above = coarse.planes[:, y // 2 + at[None, :, None], x // 2 + at[None, None, :]]
        parts.append(np.moveaxis(above, 0, -1).reshape(len(candidates), -1))
    return np.ascontiguousarray(np.concatenate(parts, axis=1), np.float32)


def _signs(planes: np.ndarray) -> np.ndarray:
    """Return +1 or -1 for each map, so that maps which vary together add up."""
    flat = planes.reshape(len(planes), -1).astype(np.float64)
    flat = flat - flat.mean(axis=1, keepdims=True)
    with single_threaded_blas():
        return np.where(np.linalg.eigh(flat @ flat.T)[1][:, -1] < 0, -1, 1).astype(np.float32)


def _summaries(rows: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """Return the signed sum over the maps of each pixel of neighbourhoods (M, K): (M, K / n), added up as the kernel does."""
    maps = len(signs)
    total = np.zeros((len(rows), rows.shape[1] // maps), np.float32)
    for c in range(maps):
        total += signs[c] * rows[:, c::maps]
    return total
