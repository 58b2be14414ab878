"""Pixel synthesis: the pixels of one level of a pyramid, wave by wave, by the kernels of `window_search`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from intaglio.kernels.lanes import LANES, UNUSABLE, vec16
from intaglio.kernels.launch import launch, single_threaded_blas
from intaglio.kernels.window_search import TOGETHER, absolute_search, gather_windows, pick_pixels, propose, squared_search

# Bytes of sample neighbourhoods that a thread compares with one target after the other: they stay in its cache.
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
        Their `neighbourhoods`.
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
        flat = candidates[:, 0] * self._width + candidates[:, 1]
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
        kernel = squared_search if self._squared else absolute_search
        for first, stop in zip(waves[:-1].tolist(), waves[1:].tolist(), strict=True):
            size = stop - first
            if size == 0:
                continue
            self._launch(
                gather_windows,
                size,
                [
                    first, target, self._window, self._wrap, self._canvas, self._planes, self._coarse_canvas,
                    self._coarse_planes, self._has_coarse, self._sign, self._positions,
                ],
                [element, value, count],
                work=4 * self._elements,
            )  # fmt: skip
            self._launch(
                propose,
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
                pick_pixels,
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
