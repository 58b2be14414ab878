"""Pixel synthesis: the pixels of one level of a pyramid, wave by wave, by the kernels of `window_search`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from intaglio.kernels.lanes import LANES, UNUSABLE, vec16
from intaglio.kernels.launch import launch, single_threaded_blas, upload
from intaglio.kernels.window_search import (
    TOGETHER,
    LevelPixels,
    SampleWindows,
    Window,
    absolute_search_kernel,
    gather_windows_kernel,
    pick_pixels_kernel,
    propose_kernel,
    squared_search_kernel,
)

# Bytes of sample neighbourhoods that a thread compares with one target after the other. So many stay in its cache.
_CHUNK_BYTES = 200_000


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
        Pixels that may be copied: their windows, and the 3 x 3 pixels around their parents, lie in the sample. They are
        searched in groups, so similar ones should be together.
    rows : (M, K) float32 array
        Their `neighborhoods`.
    usable : (H, W) bool array
        All of the sample's pixels that may be copied: where a pixel is not searched for, also those without a whole window.
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
        rows: np.ndarray,
        usable: np.ndarray,
        *,
        window: int,
        squared: bool,
        wrap: bool,
        device: str,
    ) -> None:
        self.device = device
        self._squared = int(squared)
        self._window = Window()
        self._window.side, self._window.wrap = window, int(wrap)
        maps, _, width = level.planes.shape
        self._count = len(candidates)
        flat = candidates[:, 0] * width + candidates[:, 1]
        signs = _signs(level.planes)
        self._sign = upload(signs, wp.float32, device)
        self._sample = sample = SampleWindows()
        sample.maps, sample.positions, sample.width = maps, rows.shape[1] // maps, width
        rows = np.concatenate([_summaries(rows, signs), rows], axis=1)
        sample.elements = rows.shape[1]
        padded = -len(rows) % (LANES * int(TOGETHER))
        # The cost of a neighbourhood of padding is above any bound.
        rows = np.concatenate([rows, np.full((padded, sample.elements), UNUSABLE, np.float32)])
        sample.groups = len(rows) // LANES
        blocked = rows.reshape(sample.groups, LANES, -1).transpose(0, 2, 1)
        sample.numbers = upload(blocked.ravel(), wp.float32, device)
        sample.lanes = wp.array(ptr=sample.numbers.ptr, dtype=vec16, shape=(blocked.size // LANES,), device=device)
        sample.place = upload(np.concatenate([flat, np.zeros(padded)]), wp.int32, device)
        slot = np.where(usable, -1, -2).astype(np.int32).ravel()
        slot[flat] = np.arange(len(flat))
        sample.slot = upload(slot, wp.int32, device)
        self._chunk = int(TOGETHER) * max(1, _CHUNK_BYTES // (int(TOGETHER) * 4 * LANES * sample.elements))
        self._chunks = -(-sample.groups // self._chunk)
        self._has_coarse = int(coarse is not None)
        self._level = self._upload(level)
        self._coarse = self._upload(level if coarse is None else coarse)

    def _upload(self, level: Level) -> LevelPixels:
        pixels = LevelPixels()
        pixels.planes = upload(level.planes.reshape(len(level.planes), -1), wp.float32, self.device)
        pixels.canvas = upload(level.canvas, wp.int32, self.device)
        return pixels

    @property
    def canvas(self) -> np.ndarray:
        """(h, w) int32: flat index of the sample pixel that each pixel copies."""
        return np.array(self._level.canvas.numpy())

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
        sample, canvas = self._sample, self._level.canvas
        target = upload(targets, wp.vec2i, device)
        searched = upload(exhaustive, wp.uint8, device)
        random = upload(uniform, wp.float32, device)
        most = int(np.diff(waves).max(initial=1))
        element = wp.zeros((most, sample.elements), dtype=wp.int32, device=device)
        value = wp.zeros((most, sample.elements), dtype=wp.float32, device=device)
        count = wp.zeros(most, dtype=wp.int32, device=device)
        bound = wp.zeros(most, dtype=wp.float32, device=device)
        pixel = wp.zeros(most, dtype=wp.int32, device=device)
        cost = wp.zeros((most, self._chunks), dtype=wp.float32, device=device)
        nearest = wp.zeros((most, self._chunks), dtype=wp.int32, device=device)
        kernel = squared_search_kernel if self._squared else absolute_search_kernel
        for first, stop in zip(waves[:-1].tolist(), waves[1:].tolist(), strict=True):
            size = stop - first
            if size == 0:
                continue
            self._launch(
                gather_windows_kernel,
                size,
                inputs=[
                    first,
                    target,
                    self._window,
                    self._level,
                    self._coarse,
                    self._has_coarse,
                    self._sign,
                    sample.positions,
                ],
                outputs=[element, value, count],
                work=4 * sample.elements,
            )
            self._launch(
                propose_kernel,
                size,
                inputs=[first, target, searched, self._window, canvas, sample, element, value, self._squared],
                outputs=[count, bound, pixel],
                work=8 * self._window.side * sample.elements,
            )
            self._launch(
                kernel,
                (self._chunks, size),
                inputs=[
                    sample,
                    self._chunk,
                    element,
                    value,
                    count,
                    bound,
                    1 / sample.maps if self._squared else 1.0,
                ],
                outputs=[cost, nearest],
                work=size * self._chunk * sample.elements / 3,
            )
            self._launch(
                pick_pixels_kernel,
                size,
                inputs=[first, target, count, cost, nearest, pixel, random, sample.place, self._count],
                outputs=[canvas],
                work=2 * self._chunks,
            )
            if done is not None:
                done(stop)

    def _launch(self, kernel: wp.Kernel, dim: Any, inputs: list[Any], outputs: list[Any], work: float) -> None:
        launch(kernel, dim, inputs=inputs, outputs=outputs, device=self.device, work=work)


def neighborhoods(level: Level, coarse: Level | None, candidates: np.ndarray, window: int) -> np.ndarray:
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
