"""Block synthesis: blocks of a sample are searched, cut and laid, wave by wave.

Blocks that don't touch each other are worked on in one launch. The kernels are those of `block_search` and `block_seams`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from intaglio.kernels.block_seams import cut_paths_kernel, lay_blocks_kernel, mark_kept_kernel, overlap_errors_kernel
from intaglio.kernels.block_search import (
    ROWS,
    Barred,
    SamplePlanes,
    Stencils,
    absolute_costs_kernel,
    bound_taken_kernel,
    choose_blocks_kernel,
    continue_neighbors_kernel,
    count_use_kernel,
    gather_overlaps_kernel,
    set_bounds_kernel,
    squared_costs_kernel,
    take_agreed_kernel,
)
from intaglio.kernels.lanes import LANES, UNUSABLE, vec16
from intaglio.kernels.launch import launch, upload

# Bytes of costs that are held at a time. The number is fixed, so that results do not depend on the machine.
_COST_BYTES = 64_000_000


@dataclass(frozen=True)
class Sample:
    """A sample prepared for the search.

    Attributes
    ----------
    planes : (n, H, W) float32 array
        Maps, scaled for matching.
    usable : (rows, columns) bool array
        Where a block may start.
    """

    planes: np.ndarray
    usable: np.ndarray


@dataclass(frozen=True)
class Blocks:
    """Blocks in the order in which they are laid; those of one wave don't touch each other.

    Attributes
    ----------
    block : int
        Side of a block.
    origin : (N, 2) int32 array
        Row and column of each block's first pixel on the canvas.
    overlap : (N, 4) int32 array
        How far what was laid before reaches in from the left, top, right and bottom.
    neighbor : (N, 4) int32 array
        Blocks laid before that a block may continue, -1 for none, -2 where it has to fit others too.
    waves : (waves + 1,) array
        Where each wave begins.
    shape : (int, int)
        Height and width of the canvas.
    """

    block: int
    origin: np.ndarray
    overlap: np.ndarray
    neighbor: np.ndarray
    waves: np.ndarray
    shape: tuple[int, int]


def known_pixels(overlap: np.ndarray, block: int) -> np.ndarray:
    """Return (K, block, block) bool: which pixels of a block lie in its ``overlap`` (K, 4)."""
    at = np.arange(block)
    left, top, right, bottom = (np.asarray(overlap)[:, i, None] for i in range(4))
    columns = (at < left) | (at >= block - right)
    rows = (at < top) | (at >= block - bottom)
    return rows[:, :, None] | columns[:, None, :]


def box_sums(planes: np.ndarray, box: int) -> np.ndarray:
    """Return sums over ``box`` x ``box`` pixels from each pixel on, added up as the kernels add; 0 beyond the edge."""
    total = np.zeros_like(planes)
    height, width = planes.shape[1:]
    for dy in range(box):
        for dx in range(box):
            total[:, : height - box + 1, : width - box + 1] += planes[:, dy : height - box + 1 + dy, dx : width - box + 1 + dx]
    return total


class BlockLayer:
    """Lays blocks of a sample on a canvas.

    Every wave is searched over all candidates at once: lower bounds from sums over small boxes, |Σ(a - b)| <= Σ|a - b|,
    leave most candidates out; what they leave is compared in full. The choice is that of a search without bounds.

    Parameters
    ----------
    sample : Sample
    blocks : Blocks
    squared : bool
        Squared differences instead of absolute ones.
    tolerance : float
        A block is chosen among those within (1 + tolerance) of the least cost.
    shortcut : bool
        Take the block that all neighbours agree on without a search.
    radius : int
        Candidates this near to one that continues a neighbour are left out; -1: none.
    uniform : (N,) array
        A random number in [0, 1) for each block.
    device : str
        From `choose_device`.
    prune : bool
        False: compare every candidate in full.
    evenness : float, optional
        Within the tolerance the block of least cost times (1 + evenness use) is chosen, with the candidate's use in units of
        what even use would give it in the end. None: one is drawn, all alike.
    """

    def __init__(
        self,
        sample: Sample,
        blocks: Blocks,
        *,
        squared: bool,
        tolerance: float,
        shortcut: bool,
        radius: int,
        uniform: np.ndarray,
        device: str,
        prune: bool = True,
        evenness: float | None = None,
    ) -> None:
        self.device = device
        self.blocks = blocks
        self._squared, self._tolerance, self._shortcut, self._radius = int(squared), float(tolerance), int(shortcut), radius
        self._maps, height, width = sample.planes.shape
        rows, columns = sample.usable.shape
        self._groups = (-(-rows // ROWS), -(-columns // LANES))
        # Groups of candidates at the sample's edge read past it: rows and columns of padding are there.
        self._width = width + LANES
        self._plane = (height + ROWS) * self._width
        self._sample = self._upload(sample.planes)
        penalty = np.full((self._groups[0] * ROWS, self._groups[1] * LANES), UNUSABLE, np.float32)
        penalty[:rows, :columns][sample.usable] = 0
        self._penalty = upload(penalty, wp.float32, device)
        self._penalty_lanes = upload(penalty.reshape(len(penalty), -1, LANES), vec16, device)
        self._reaches = upload(np.array([[rows, columns]]), wp.vec2i, device)

        self._origin = upload(blocks.origin, wp.vec2i, device)
        self._overlap = upload(blocks.overlap, wp.vec4i, device)
        self._neighbor = upload(blocks.neighbor, wp.int32, device)
        self._step = upload(blocks.origin[:, None, :] - blocks.origin[np.maximum(blocks.neighbor, 0)], wp.vec2i, device)
        self._uniform = upload(uniform, wp.float32, device)
        self._choice = wp.full(len(blocks.origin), -1, dtype=wp.int32, device=device)
        self._canvas = wp.full(blocks.shape, -1, dtype=wp.int32, device=device)

        self._full, self._longest = self._stencils(1)
        widest = int(blocks.overlap.max(initial=0))
        narrowest = int(blocks.overlap[blocks.overlap > 0].min(initial=widest + 1)) if widest else 0
        self._box = 0
        if prune and narrowest >= 4:
            self._box = 8 if narrowest >= 16 else 4 if narrowest >= 8 else 2
            self._boxes = self._upload(box_sums(sample.planes, self._box))
            self._cells, self._most_cells = self._stencils(self._box)
        self._prune = prune
        self._evenness = -1.0 if evenness is None else float(evenness)
        counted = (self._groups[0] * ROWS, self._groups[1] * LANES) if evenness is not None else (1, 1)
        self._use = wp.zeros(counted, dtype=wp.float32, device=device)
        # All blocks together, laid evenly, would take each candidate's pixels so often.
        self._use_share = float(sample.usable.sum()) / max(1.0, float(len(blocks.origin) * blocks.block**2))
        self._make_buffers()

    @property
    def choice(self) -> np.ndarray:
        """(N, 2) int: row and column in the sample of each block laid."""
        flat = self._choice.numpy()
        return np.stack([flat // self._width, flat % self._width], axis=1)

    @property
    def canvas(self) -> np.ndarray:
        """(H, W, 2) int32: row and column in the sample of each canvas pixel."""
        flat = self._canvas.numpy()
        return np.stack([flat // self._width, flat % self._width], axis=2).astype(np.int32)

    def lay(
        self,
        *,
        seams: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        """Lay all blocks.

        Parameters
        ----------
        seams : callable, optional
            (error (K, B, B), overlap (K, 4)) to what each block keeps, (K, B, B) bool; default: the boundary cut.
        progress : callable, optional
            Called with blocks laid and all blocks.
        """
        for start, stop in zip(self.blocks.waves[:-1], self.blocks.waves[1:], strict=True):
            for first in range(int(start), int(stop), self._at_once):
                count = min(self._at_once, int(stop) - first)
                self._search(first, count)
                self._sew(first, count, seams)
            if progress is not None:
                progress(int(stop), len(self.blocks.origin))

    def _upload(self, planes: np.ndarray) -> SamplePlanes:
        """Return padded planes on the device, as numbers and as vectors that begin at any number."""
        padded = np.zeros((self._maps, self._plane // self._width, self._width), np.float32)
        padded[:, : planes.shape[1], : planes.shape[2]] = planes
        sample = SamplePlanes()
        sample.numbers = upload(np.concatenate([padded.ravel(), np.zeros(LANES, np.float32)]), wp.float32, self.device)
        sample.lanes = wp.array(
            ptr=sample.numbers.ptr, dtype=vec16, shape=(self._maps * self._plane,), strides=(4,), device=self.device
        )
        sample.maps, sample.plane, sample.width = self._maps, self._plane, self._width
        return sample

    def _stencils(self, box: int) -> tuple[Stencils, int]:
        """Return the lists of the overlaps' pixels, or of the ``box`` x ``box`` cells in them, and the longest list's length."""
        block = self.blocks.block
        shapes, index = np.unique(self.blocks.overlap, axis=0, return_inverse=True)
        known = known_pixels(shapes, block)
        lists = []
        for mask in known:
            cells = np.zeros(mask.shape, bool)
            for y in range(0, block - box + 1, box):
                for x in range(0, block - box + 1, box):
                    cells[y, x] = mask[y : y + box, x : x + box].all()
            pixels = np.argwhere(cells).astype(np.int32)
            # The list takes every eighth pixel first, so that each of its parts is spread over the whole overlap.
            lists.append(np.concatenate([pixels[i::8] for i in range(8)]))
        counts = np.array([len(p) for p in lists], np.int32)
        pixels = np.concatenate(lists) if counts.sum() else np.zeros((1, 2), np.int32)
        flat = pixels[:, 0] * self._width + pixels[:, 1]
        stencils = Stencils()
        stencils.index = upload(index.ravel(), wp.int32, self.device)
        stencils.first = upload(np.concatenate([[0], np.cumsum(counts)[:-1]]), wp.int32, self.device)
        stencils.count = upload(counts, wp.int32, self.device)
        stencils.pixel = upload(pixels, wp.vec2i, self.device)
        stencils.offset = upload((flat[:, None] + self._plane * np.arange(self._maps)).ravel(), wp.int32, self.device)
        return stencils, int(max(counts.max(), 1))

    def _make_buffers(self) -> None:
        """Make what a wave is worked out in."""
        rows, columns = self._groups
        block, device = self.blocks.block, self.device
        candidates = rows * columns * ROWS * LANES
        most = int(np.diff(self.blocks.waves).max(initial=1))
        self._at_once = count = int(np.clip(_COST_BYTES // (4 * candidates), 1, most))
        self._value = wp.zeros((count, self._longest * self._maps), dtype=wp.float32, device=device)
        self._cost = wp.zeros((count, rows * ROWS, columns * LANES), dtype=wp.float32, device=device)
        self._cost_lanes = wp.array(ptr=self._cost.ptr, dtype=vec16, shape=(count, rows * ROWS, columns), device=device)
        self._least = wp.zeros((count, rows, columns), dtype=wp.float32, device=device)
        self._lower = wp.zeros((count, rows, columns), dtype=wp.float32, device=device)
        self._bound = wp.zeros(count, dtype=wp.float32, device=device)
        self._barred = Barred()
        self._barred.candidate = wp.zeros((count, 4), dtype=wp.int32, device=device)
        self._barred.radius = self._radius
        self._taken = wp.zeros(count, dtype=wp.int32, device=device)
        self._error = wp.zeros((count, block, block), dtype=wp.float32, device=device)
        widest = max(1, int(self.blocks.overlap.max(initial=0)))
        self._summed = wp.zeros((count, 4, block, widest), dtype=wp.float32, device=device)
        self._cut = wp.zeros((count, 4, block), dtype=wp.int32, device=device)
        self._take = wp.zeros((count, block, block), dtype=wp.uint8, device=device)

    def _launch(self, kernel: wp.Kernel, dim: Any, inputs: list[Any], outputs: list[Any], work: float) -> None:
        launch(kernel, dim, inputs=inputs, outputs=outputs, device=self.device, work=work)

    def _costs(self, first: int, count: int, *, boxes: bool) -> None:
        """Search one wave, with pixels or with boxes."""
        rows, columns = self._groups
        stencils, longest = (self._cells, self._most_cells) if boxes else (self._full, self._longest)
        scale = 1.0 / (self._box * self._box) if boxes and self._squared else 1.0
        self._launch(
            squared_costs_kernel if self._squared else absolute_costs_kernel,
            (rows, count, columns),
            inputs=[
                first,
                stencils,
                self._value,
                self._boxes if boxes else self._sample,
                self._penalty_lanes,
                scale,
                self._barred,
                self._bound,
                self._lower,
                int(self._box > 0 and not boxes),
            ],
            outputs=[self._cost_lanes, self._lower if boxes else self._least],
            work=count * columns * longest * self._maps * ROWS,
        )

    def _gather(self, first: int, count: int, *, boxes: bool) -> None:
        """Write what lies under the overlaps of one wave, pixel by pixel or summed over boxes."""
        stencils, longest = (self._cells, self._most_cells) if boxes else (self._full, self._longest)
        box = self._box if boxes else 1
        self._launch(
            gather_overlaps_kernel,
            (longest, count),
            inputs=[first, self._origin, stencils, box, self._canvas, self._sample],
            outputs=[self._value],
            work=3 * count * self._maps * box * box,
        )

    def _search(self, first: int, count: int) -> None:
        """Choose the blocks ``first`` to ``first + count``."""
        rows, columns = self._groups
        self._launch(
            continue_neighbors_kernel,
            count,
            inputs=[
                first,
                self._neighbor,
                self._step,
                self._reaches,
                self._choice,
                self._width,
                self._penalty,
                self._shortcut,
            ],
            outputs=[self._barred.candidate, self._taken],
            work=20,
        )
        self._launch(bound_taken_kernel, count, inputs=[self._taken], outputs=[self._bound], work=1)
        if self._box:
            self._gather(first, count, boxes=True)
            self._costs(first, count, boxes=True)
        self._gather(first, count, boxes=False)
        if self._prune:
            self._launch(
                set_bounds_kernel,
                count,
                inputs=[
                    first,
                    self._full,
                    self._value,
                    self._sample,
                    self._penalty,
                    self._squared,
                    self._tolerance,
                    self._barred,
                    self._lower,
                    self._cost,
                    int(self._box > 0),
                ],
                outputs=[self._bound],
                work=3 * self._longest * self._maps + rows * columns,
            )
        self._costs(first, count, boxes=False)
        self._launch(
            choose_blocks_kernel,
            count,
            inputs=[first, self._cost, self._least, self._width, self._tolerance, self._evenness, self._uniform, self._use],
            outputs=[self._choice],
            work=6 * rows * columns,
        )
        if self._evenness >= 0:
            self._launch(
                count_use_kernel,
                rows * ROWS,
                inputs=[first, count, self._choice, self._width, self.blocks.block, self._use_share],
                outputs=[self._use],
                work=4 * count * self.blocks.block,
            )
        if self._shortcut:
            self._launch(take_agreed_kernel, count, inputs=[first, self._taken], outputs=[self._choice], work=1)

    def _sew(self, first: int, count: int, seams: Callable[[np.ndarray, np.ndarray], np.ndarray] | None) -> None:
        """Cut the blocks ``first`` to ``first + count`` to shape and lay them."""
        block = self.blocks.block
        dim = (block, count, block)
        area = block * self._summed.shape[3] * 4
        self._launch(
            overlap_errors_kernel,
            dim,
            inputs=[first, self._origin, self._choice, self._canvas, self._sample, self._squared],
            outputs=[self._error],
            work=2 * count * block * self._maps,
        )
        if seams is None:
            self._launch(
                cut_paths_kernel,
                (count, 4),
                inputs=[first, self._overlap, block, self._error],
                outputs=[self._summed, self._cut],
                work=5 * area,
            )
            self._launch(mark_kept_kernel, dim, inputs=[block, self._cut], outputs=[self._take], work=2 * count * block)
        else:
            kept = np.zeros(self._take.shape, np.uint8)
            kept[:count] = seams(self._error.numpy()[:count], self.blocks.overlap[first : first + count])
            self._take.assign(kept)
        self._launch(
            lay_blocks_kernel,
            dim,
            inputs=[first, self._origin, self._choice, self._take, self._width],
            outputs=[self._canvas],
            work=2 * count * block,
        )
