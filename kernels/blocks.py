"""Block synthesis: the search for blocks whose overlap fits, the boundary cuts through it, and the laying of blocks.

The canvas holds, for every pixel, the sample pixel it copies (an index into a plane) or -1; values are read through it.
Blocks that don't touch each other are worked on in one launch.

The sample lies in planes of padded rows, one after another, n of them: pixel (y, x) of map c is ``c * plane + y * width + x``.
A candidate is a block's upper left corner in the sample. Candidates are searched in groups of 4 rows and 16 columns: the 16
are one vector, read from the plane at any offset.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from intaglio.kernels.lanes import ABSOLUTE, LANES, RELATIVE, SLACK, UNUSABLE, absolute_terms, difference, squared_terms, vec16
from intaglio.kernels.launch import launch

wp.set_module_options({"enable_backward": False})

ROWS = 4

# A search gives a group up after any of this many parts of the overlap, as soon as it can't be chosen any more.
PARTS = wp.constant(8)

# The most blocks that a block can continue; and what stands in their list if it has to fit others too.
CONTINUED = wp.constant(4)
OTHERS = wp.constant(-2)

# Costs held at a time, in bytes; fixed, so that results do not depend on the machine.
_COST_BYTES = 64_000_000


@wp.kernel
def _gather(
    start: int,
    first_block: int,
    origin: wp.array[wp.vec2i],
    stencil: wp.array[wp.int32],
    first: wp.array[wp.int32],
    count: wp.array[wp.int32],
    pixel: wp.array[wp.vec2i],
    box: int,
    canvas: wp.array2d[wp.int32],
    planes: wp.array[wp.float32],
    maps: int,
    plane: int,
    # output
    value: wp.array2d[wp.float32],
):
    """Write what lies under a block's known pixels: sums over ``box`` x ``box`` pixels, ``maps`` of them a pixel."""
    i, k = wp.tid()
    p = start + i
    b = first_block + k
    s = stencil[b]
    if p >= count[s]:
        return
    at = pixel[first[s] + p]
    height = canvas.shape[0]
    width = canvas.shape[1]
    for c in range(maps):
        total = float(0.0)
        for dy in range(box):
            for dx in range(box):
                y = (origin[b][0] + at[0] + dy) % height
                x = (origin[b][1] + at[1] + dx) % width
                total += planes[c * plane + canvas[y, x]]
        value[k, p * maps + c] = total


@wp.func
def near_continued(continued: wp.array2d[wp.int32], b: int, row: int, column: int, width: int, radius: int):
    """Return whether a block that this one would continue starts within ``radius`` of a group of candidates."""
    found = int(0)
    for j in range(CONTINUED):
        at = continued[b, j]
        if at >= 0:
            y = at / width
            x = at - y * width
            if y > row - radius - 1 and y < row + ROWS + radius and x > column - radius - 1 and x < column + LANES + radius:
                found = 1
    return found


@wp.func
def barred(continued: wp.array2d[wp.int32], b: int, row: int, column: int, width: int, radius: int):
    """Return lanes of `UNUSABLE` where a candidate of the row lies within ``radius`` of a block this one would continue."""
    bar = vec16(0.0)
    for j in range(CONTINUED):
        at = continued[b, j]
        if at >= 0:
            y = at / width
            x = at - y * width
            if wp.abs(row - y) <= radius:
                for lane in range(LANES):
                    if wp.abs(column + lane - x) <= radius:
                        bar[lane] = UNUSABLE
    return bar


def _cost_kernel(terms: Any) -> wp.Kernel:
    """Return the search kernel for one metric."""

    @wp.kernel
    def overlap_costs(
        start: int,
        first_block: int,
        stencil: wp.array[wp.int32],
        first: wp.array[wp.int32],
        count: wp.array[wp.int32],
        offset: wp.array[wp.int32],
        value: wp.array2d[wp.float32],
        sample: wp.array[vec16],
        penalty: wp.array2d[vec16],
        maps: int,
        width: int,
        scale: float,
        continued: wp.array2d[wp.int32],
        radius: int,
        bound: wp.array[wp.float32],
        lower: wp.array3d[wp.float32],
        use_lower: int,
        # output
        cost: wp.array3d[vec16],
        least: wp.array3d[wp.float32],
    ):
        """Costs of 4 rows of 16 candidates for one block, summed over its overlap and all maps (Dong, eq. 6.2.1).

        A group is given up when none of its 64 candidates can come under the block's bound: at once, where its lower bound
        says so, or after a part of the overlap. What is written then is a lower bound too, above ``bound``.
        """
        i, k, g = wp.tid()
        group = start + i
        row = ROWS * group
        s = stencil[first_block + k]
        limit = bound[k]
        if limit < 0.0:
            least[k, group, g] = float(UNUSABLE)
            return
        if use_lower == 1 and lower[k, group, g] > limit:
            least[k, group, g] = lower[k, group, g]
            return
        base = row * width + LANES * g
        p0 = penalty[row, g]
        p1 = penalty[row + 1, g]
        p2 = penalty[row + 2, g]
        p3 = penalty[row + 3, g]
        # Kernels evaluate both sides of an "and".
        if radius >= 0:  # noqa: SIM102
            if near_continued(continued, k, row, LANES * g, width, radius) == 1:
                p0 += barred(continued, k, row, LANES * g, width, radius)
                p1 += barred(continued, k, row + 1, LANES * g, width, radius)
                p2 += barred(continued, k, row + 2, LANES * g, width, radius)
                p3 += barred(continued, k, row + 3, LANES * g, width, radius)
        t0 = vec16(0.0)
        t1 = vec16(0.0)
        t2 = vec16(0.0)
        t3 = vec16(0.0)
        terms_in_all = count[s] * maps
        at = first[s] * maps
        done = int(0)
        for part in range(PARTS):
            stop = (terms_in_all * (part + 1)) / PARTS
            for j in range(done, stop):
                o = base + offset[at + j]
                v = value[k, j]
                t0 += terms(sample[o], v)
                t1 += terms(sample[o + width], v)
                t2 += terms(sample[o + 2 * width], v)
                t3 += terms(sample[o + 3 * width], v)
            done = stop
            nearest = wp.min(
                wp.min(wp.min(scale * t0 + p0), wp.min(scale * t1 + p1)), wp.min(wp.min(scale * t2 + p2), wp.min(scale * t3 + p3))
            )
            if nearest > limit:
                done = terms_in_all
                break
        t0 = scale * t0 + p0
        t1 = scale * t1 + p1
        t2 = scale * t2 + p2
        t3 = scale * t3 + p3
        cost[k, row, g] = t0
        cost[k, row + 1, g] = t1
        cost[k, row + 2, g] = t2
        cost[k, row + 3, g] = t3
        least[k, group, g] = wp.min(wp.min(wp.min(t0), wp.min(t1)), wp.min(wp.min(t2), wp.min(t3)))

    return overlap_costs


_absolute_costs = _cost_kernel(absolute_terms)
_squared_costs = _cost_kernel(squared_terms)


@wp.func
def exact_cost(
    candidate: int,
    first: int,
    terms: int,
    offset: wp.array[wp.int32],
    value: wp.array2d[wp.float32],
    k: int,
    planes: wp.array[wp.float32],
    squared: int,
):
    """Return one candidate's cost."""
    total = float(0.0)
    for j in range(terms):
        total += difference(planes[candidate + offset[first + j]], value[k, j], squared)
    return total


@wp.kernel
def _set_bounds(
    start: int,
    first_block: int,
    stencil: wp.array[wp.int32],
    first: wp.array[wp.int32],
    count: wp.array[wp.int32],
    offset: wp.array[wp.int32],
    value: wp.array2d[wp.float32],
    planes: wp.array[wp.float32],
    penalty: wp.array2d[wp.float32],
    maps: int,
    width: int,
    squared: int,
    tolerance: float,
    continued: wp.array2d[wp.int32],
    radius: int,
    lower: wp.array3d[wp.float32],
    lower_cost: wp.array3d[wp.float32],
    use_lower: int,
    # output
    bound: wp.array[wp.float32],
):
    """Bound the cost of what can be chosen: (1 + tolerance) times that of the likeliest candidates, which is no less.

    The likeliest are the one of least lower bound, and those that continue a neighbour, unless these are barred.
    """
    k = start + wp.tid()
    if bound[k] < 0.0:
        return
    s = stencil[first_block + k]
    terms = count[s] * maps
    at = first[s] * maps
    best = float(UNUSABLE)
    if use_lower == 1:
        smallest = float(UNUSABLE)
        group = int(-1)
        column = int(0)
        for i in range(lower.shape[1]):
            for g in range(lower.shape[2]):
                if lower[k, i, g] < smallest:
                    smallest = lower[k, i, g]
                    group = i
                    column = g
        if group >= 0:
            for r in range(ROWS):
                for lane in range(LANES):
                    x = LANES * column + lane
                    if lower_cost[k, ROWS * group + r, x] == smallest:
                        candidate = (ROWS * group + r) * width + x
                        best = wp.min(best, exact_cost(candidate, at, terms, offset, value, k, planes, squared))
    if radius < 0:
        for j in range(CONTINUED):
            candidate = continued[k, j]
            if candidate >= 0:
                y = candidate / width
                if penalty[y, candidate - y * width] == 0.0:
                    best = wp.min(best, exact_cost(candidate, at, terms, offset, value, k, planes, squared))
    rounding = SLACK + RELATIVE * float(terms)
    bound[k] = wp.min(float(UNUSABLE), best * (1.0 + tolerance) * rounding + 0.1 * ABSOLUTE * float(terms))


@wp.kernel
def _choose(
    start: int,
    first_block: int,
    cost: wp.array3d[wp.float32],
    least: wp.array3d[wp.float32],
    width: int,
    tolerance: float,
    uniform: wp.array[wp.float32],
    # output
    choice: wp.array[wp.int32],
):
    """Choose a candidate at random among those within (1 + tolerance) of the least cost."""
    k = start + wp.tid()
    best = float(UNUSABLE)
    for i in range(least.shape[1]):
        for g in range(least.shape[2]):
            best = wp.min(best, least[k, i, g])
    limit = wp.min(best * (1.0 + tolerance), 0.5 * float(UNUSABLE))
    listed = int(0)
    for i in range(least.shape[1]):
        for g in range(least.shape[2]):
            if least[k, i, g] <= limit:
                for r in range(ROWS):
                    for lane in range(LANES):
                        if cost[k, ROWS * i + r, LANES * g + lane] <= limit:
                            listed += 1
    wanted = wp.min(listed - 1, int(uniform[first_block + k] * float(listed)))
    passed = int(0)
    chosen = int(-1)
    for i in range(least.shape[1]):
        if chosen >= 0:
            break
        for g in range(least.shape[2]):
            if least[k, i, g] <= limit:
                for r in range(ROWS):
                    for lane in range(LANES):
                        if cost[k, ROWS * i + r, LANES * g + lane] <= limit:
                            if passed == wanted:
                                chosen = (ROWS * i + r) * width + LANES * g + lane
                            passed += 1
    choice[first_block + k] = chosen


@wp.kernel
def _continue(
    start: int,
    first_block: int,
    neighbour: wp.array2d[wp.int32],
    step: wp.array2d[wp.vec2i],
    reaches: wp.array[wp.vec2i],
    choice: wp.array[wp.int32],
    width: int,
    penalty: wp.array2d[wp.float32],
    shortcut: int,
    # output
    continued: wp.array2d[wp.int32],
    taken: wp.array[wp.int32],
):
    """Write the candidates that would continue a block's laid neighbours, -1 where the sample ends.

    With ``shortcut``, where all neighbours agree on one usable candidate, it is ``taken`` (Dong, section 5.3.2); else -1.
    """
    k = start + wp.tid()
    b = first_block + k
    agreed = int(-1)
    differ = int(0)
    for j in range(CONTINUED):
        continued[k, j] = -1
        n = neighbour[b, j]
        if n == OTHERS:
            differ = 1
        if n >= 0:
            y = choice[n] / width
            x = choice[n] - y * width
            y += step[b, j][0]
            x += step[b, j][1]
            candidate = int(-1)
            if y >= 0 and x >= 0 and y < reaches[0][0] and x < reaches[0][1]:
                candidate = y * width + x
                continued[k, j] = candidate
                if penalty[y, x] > 0.0:
                    candidate = -1
            if candidate < 0 or (agreed >= 0 and agreed != candidate):
                differ = 1
            agreed = candidate
    if shortcut == 0 or differ == 1:
        agreed = -1
    taken[k] = agreed


@wp.kernel
def _bound_taken(
    start: int,
    taken: wp.array[wp.int32],
    # output
    bound: wp.array[wp.float32],
):
    """Leave no search to blocks that are taken without one: every cost is above a bound of -1."""
    k = start + wp.tid()
    bound[k] = wp.where(taken[k] >= 0, -1.0, float(UNUSABLE))


@wp.kernel
def _take(
    start: int,
    first_block: int,
    taken: wp.array[wp.int32],
    # output
    choice: wp.array[wp.int32],
):
    """Put the block that the neighbours agreed on in place of the search's."""
    k = start + wp.tid()
    if taken[k] >= 0:
        choice[first_block + k] = taken[k]


@wp.kernel
def _overlap_errors(
    start: int,
    first_block: int,
    origin: wp.array[wp.vec2i],
    choice: wp.array[wp.int32],
    canvas: wp.array2d[wp.int32],
    planes: wp.array[wp.float32],
    maps: int,
    plane: int,
    width: int,
    squared: int,
    # output
    error: wp.array3d[wp.float32],
):
    """Write the difference between a block and what it would cover, over all maps; 0 where it covers nothing."""
    i, k, x = wp.tid()
    y = start + i
    b = first_block + k
    old = canvas[(origin[b][0] + y) % canvas.shape[0], (origin[b][1] + x) % canvas.shape[1]]
    total = float(0.0)
    if old >= 0:
        new = choice[b] + y * width + x
        for c in range(maps):
            total += difference(planes[c * plane + new], planes[c * plane + old], squared)
    error[k, y, x] = total


@wp.func
def strip_error(error: wp.array3d[wp.float32], k: int, side: int, along: int, across: int, block: int):
    """Return the error ``across`` pixels from a side (left, top, right, bottom), ``along`` it."""
    if side == 0:
        return error[k, along, across]
    if side == 1:
        return error[k, across, along]
    if side == 2:
        return error[k, along, block - 1 - across]
    return error[k, block - 1 - across, along]


@wp.func
def step_error(error: wp.array3d[wp.float32], k: int, side: int, along: int, across: int, block: int):
    """Return what it costs that a seam steps aside over pixel ``across``, between ``along - 1`` and ``along``."""
    return strip_error(error, k, side, along - 1, across, block) + strip_error(error, k, side, along, across, block)


@wp.kernel
def _cut_paths(
    start: int,
    first_block: int,
    overlap: wp.array[wp.vec4i],
    block: int,
    error: wp.array3d[wp.float32],
    # scratch
    summed: wp.array4d[wp.float32],
    # output
    cut: wp.array3d[wp.int32],
):
    """Find, by dynamic programming, the path of least error through the overlap at one side of one block.

    ``cut[k, side, along]`` is how far from that side the new block begins; 0 where there is no overlap.
    """
    i, side = wp.tid()
    k = start + i
    wide = overlap[first_block + k][side]
    if wide == 0:
        for a in range(block):
            cut[k, side, a] = 0
        return
    for a in range(block):
        for x in range(wide):
            # The seam runs between pixels x - 1 and x, and costs the errors of both, as an edge of a graph cut would.
            here = strip_error(error, k, side, a, x, block)
            beside = strip_error(error, k, side, a, wp.max(x - 1, 0), block)
            before = float(0.0)
            if a > 0:
                before = summed[k, side, a - 1, x]
                if x > 0:
                    before = wp.min(before, summed[k, side, a - 1, x - 1] + step_error(error, k, side, a, x - 1, block))
                if x + 1 < wide:
                    before = wp.min(before, summed[k, side, a - 1, x + 1] + step_error(error, k, side, a, x, block))
            summed[k, side, a, x] = before + here + beside
    at = int(0)
    for x in range(1, wide):
        if summed[k, side, block - 1, x] < summed[k, side, block - 1, at]:
            at = x
    for j in range(block):
        a = block - 1 - j
        cut[k, side, a] = at
        if a > 0:
            # Straight on where it costs the same.
            best = summed[k, side, a - 1, at]
            to = at
            if at > 0 and summed[k, side, a - 1, at - 1] + step_error(error, k, side, a, at - 1, block) < best:
                best = summed[k, side, a - 1, at - 1] + step_error(error, k, side, a, at - 1, block)
                to = at - 1
            if at + 1 < wide and summed[k, side, a - 1, at + 1] + step_error(error, k, side, a, at, block) < best:
                to = at + 1
            at = to


@wp.kernel
def _mark(
    start: int,
    block: int,
    cut: wp.array3d[wp.int32],
    # output
    take: wp.array3d[wp.uint8],
):
    """Mark the pixels of a block that lie within its cuts."""
    i, k, x = wp.tid()
    y = start + i
    inside = x >= cut[k, 0, y] and y >= cut[k, 1, x] and block - 1 - x >= cut[k, 2, y] and block - 1 - y >= cut[k, 3, x]
    take[k, y, x] = wp.uint8(wp.where(inside, 1, 0))


@wp.kernel
def _lay(
    start: int,
    first_block: int,
    origin: wp.array[wp.vec2i],
    choice: wp.array[wp.int32],
    take: wp.array3d[wp.uint8],
    width: int,
    # output
    canvas: wp.array2d[wp.int32],
):
    """Lay a block: its marked pixels, and all where there was nothing."""
    i, k, x = wp.tid()
    y = start + i
    b = first_block + k
    cy = (origin[b][0] + y) % canvas.shape[0]
    cx = (origin[b][1] + x) % canvas.shape[1]
    if take[k, y, x] > wp.uint8(0) or canvas[cy, cx] < 0:
        canvas[cy, cx] = choice[b] + y * width + x


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
    neighbour : (N, 4) int32 array
        Blocks laid before that a block may continue, -1 for none, -2 where it has to fit others too.
    waves : (waves + 1,) array
        Where each wave begins.
    shape : (int, int)
        Height and width of the canvas.
    """

    block: int
    origin: np.ndarray
    overlap: np.ndarray
    neighbour: np.ndarray
    waves: np.ndarray
    shape: tuple[int, int]


@dataclass(frozen=True)
class _Stencils:
    """Pixel lists of the overlaps' shapes, on the device."""

    index: wp.array
    first: wp.array
    count: wp.array
    pixel: wp.array
    offset: wp.array
    longest: int


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
    ) -> None:
        self.device = device
        self.blocks = blocks
        self._squared, self._tolerance, self._shortcut, self._radius = int(squared), float(tolerance), int(shortcut), radius
        self._maps, height, width = sample.planes.shape
        rows, columns = sample.usable.shape
        self._groups = (-(-rows // ROWS), -(-columns // LANES))
        # Groups at the edge read past it, into padding.
        self._width = width + LANES
        self._plane = (height + ROWS) * self._width
        self._planes, self._lanes = self._upload(sample.planes)
        penalty = np.full((self._groups[0] * ROWS, self._groups[1] * LANES), UNUSABLE, np.float32)
        penalty[:rows, :columns][sample.usable] = 0
        self._penalty = wp.array(penalty, dtype=float, device=device)
        self._penalty_lanes = wp.array(penalty.reshape(len(penalty), -1, LANES), dtype=vec16, device=device)
        self._reaches = wp.array(np.array([[rows, columns]], np.int32), dtype=wp.vec2i, device=device)

        self._origin = wp.array(np.ascontiguousarray(blocks.origin, np.int32), dtype=wp.vec2i, device=device)
        self._overlap = wp.array(np.ascontiguousarray(blocks.overlap, np.int32), dtype=wp.vec4i, device=device)
        self._neighbour = wp.array(np.ascontiguousarray(blocks.neighbour, np.int32), dtype=wp.int32, device=device)
        step = blocks.origin[:, None, :] - blocks.origin[np.maximum(blocks.neighbour, 0)]
        self._step = wp.array(np.ascontiguousarray(step, np.int32), dtype=wp.vec2i, device=device)
        self._uniform = wp.array(np.ascontiguousarray(uniform, np.float32), dtype=float, device=device)
        self._choice = wp.full(len(blocks.origin), -1, dtype=wp.int32, device=device)
        self._canvas = wp.full(blocks.shape, -1, dtype=wp.int32, device=device)

        self._full = self._stencils(1)
        widest = int(blocks.overlap.max(initial=0))
        narrowest = int(blocks.overlap[blocks.overlap > 0].min(initial=widest + 1)) if widest else 0
        self._box = 0
        if prune and narrowest >= 4:
            self._box = 8 if narrowest >= 16 else 4 if narrowest >= 8 else 2
            self._boxes, self._box_lanes = self._upload(box_sums(sample.planes, self._box))
            self._cells = self._stencils(self._box)
        self._prune = prune
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

    def _upload(self, planes: np.ndarray) -> tuple[wp.array, wp.array]:
        """Return padded planes on the device, as numbers and as vectors that begin at any number."""
        padded = np.zeros((self._maps, self._plane // self._width, self._width), np.float32)
        padded[:, : planes.shape[1], : planes.shape[2]] = planes
        flat = wp.array(np.concatenate([padded.ravel(), np.zeros(LANES, np.float32)]), dtype=float, device=self.device)
        lanes = wp.array(ptr=flat.ptr, dtype=vec16, shape=(self._maps * self._plane,), strides=(4,), device=self.device)
        return flat, lanes

    def _stencils(self, box: int) -> _Stencils:
        """Return the lists of the overlaps' pixels, or of the ``box`` x ``box`` cells that lie in them."""
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
            # Interleaved, so that any part of the list is spread over the overlap.
            lists.append(np.concatenate([pixels[i::8] for i in range(8)]))
        counts = np.array([len(p) for p in lists], np.int32)
        pixels = np.concatenate(lists) if counts.sum() else np.zeros((1, 2), np.int32)
        flat = pixels[:, 0] * self._width + pixels[:, 1]
        offset = (flat[:, None] + self._plane * np.arange(self._maps)[None, :]).astype(np.int32)
        return _Stencils(
            index=wp.array(index.ravel().astype(np.int32), dtype=wp.int32, device=self.device),
            first=wp.array(np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int32), dtype=wp.int32, device=self.device),
            count=wp.array(counts, dtype=wp.int32, device=self.device),
            pixel=wp.array(pixels, dtype=wp.vec2i, device=self.device),
            offset=wp.array(offset.ravel(), dtype=wp.int32, device=self.device),
            longest=int(max(counts.max(), 1)),
        )

    def _make_buffers(self) -> None:
        """Make what a wave is worked out in."""
        rows, columns = self._groups
        block, device = self.blocks.block, self.device
        candidates = rows * columns * ROWS * LANES
        most = int(np.diff(self.blocks.waves).max(initial=1))
        self._at_once = count = int(np.clip(_COST_BYTES // (4 * candidates), 1, most))
        self._value = wp.zeros((count, self._full.longest * self._maps), dtype=float, device=device)
        self._cost = wp.zeros((count, rows * ROWS, columns * LANES), dtype=float, device=device)
        self._cost_lanes = wp.array(ptr=self._cost.ptr, dtype=vec16, shape=(count, rows * ROWS, columns), device=device)
        self._least = wp.zeros((count, rows, columns), dtype=float, device=device)
        self._lower = wp.zeros((count, rows, columns), dtype=float, device=device)
        self._bound = wp.zeros(count, dtype=float, device=device)
        self._continued = wp.zeros((count, 4), dtype=wp.int32, device=device)
        self._taken = wp.zeros(count, dtype=wp.int32, device=device)
        self._error = wp.zeros((count, block, block), dtype=float, device=device)
        widest = max(1, int(self.blocks.overlap.max(initial=0)))
        self._summed = wp.zeros((count, 4, block, widest), dtype=float, device=device)
        self._cut = wp.zeros((count, 4, block), dtype=wp.int32, device=device)
        self._take = wp.zeros((count, block, block), dtype=wp.uint8, device=device)

    def _launch(self, kernel: wp.Kernel, dim: Any, inputs: list[Any], outputs: list[Any], work: float) -> None:
        launch(kernel, dim, inputs, outputs, device=self.device, work=work)

    def _costs(self, stencils: _Stencils, lanes: wp.array, first: int, count: int, *, box: int, use_lower: bool) -> None:
        """Search one wave, with pixels or with boxes."""
        rows, columns = self._groups
        kernel = _squared_costs if self._squared else _absolute_costs
        least = self._least if box == 1 else self._lower
        scale = 1.0 / (box * box) if self._squared else 1.0
        self._launch(
            kernel,
            (rows, count, columns),
            [
                first, stencils.index, stencils.first, stencils.count, stencils.offset, self._value, lanes, self._penalty_lanes,
                self._maps, self._width, scale, self._continued, self._radius, self._bound, self._lower, int(use_lower),
            ],
            [self._cost_lanes, least],
            work=count * columns * stencils.longest * self._maps * ROWS,
        )  # fmt: skip

    def _gather(self, stencils: _Stencils, planes: wp.array, first: int, count: int, box: int) -> None:
        self._launch(
            _gather,
            (stencils.longest, count),
            [
                first, self._origin, stencils.index, stencils.first, stencils.count, stencils.pixel, box, self._canvas,
                planes, self._maps, self._plane,
            ],
            [self._value],
            work=3 * count * self._maps * box * box,
        )  # fmt: skip

    def _search(self, first: int, count: int) -> None:
        """Choose the blocks ``first`` to ``first + count``."""
        stencils = self._full
        rows, columns = self._groups
        self._launch(
            _continue,
            count,
            [
                first, self._neighbour, self._step, self._reaches, self._choice, self._width, self._penalty, self._shortcut,
            ],
            [self._continued, self._taken],
            work=20,
        )  # fmt: skip
        self._launch(_bound_taken, count, [self._taken], [self._bound], work=1)
        if self._box:
            self._gather(self._cells, self._planes, first, count, self._box)
            self._costs(self._cells, self._box_lanes, first, count, box=self._box, use_lower=False)
        self._gather(stencils, self._planes, first, count, 1)
        if self._prune:
            self._launch(
                _set_bounds,
                count,
                [
                    first, stencils.index, stencils.first, stencils.count, stencils.offset, self._value, self._planes,
                    self._penalty, self._maps, self._width, self._squared, self._tolerance, self._continued, self._radius,
                    self._lower, self._cost, int(self._box > 0),
                ],
                [self._bound],
                work=3 * stencils.longest * self._maps + rows * columns,
            )  # fmt: skip
        self._costs(stencils, self._lanes, first, count, box=1, use_lower=self._box > 0)
        self._launch(
            _choose,
            count,
            [first, self._cost, self._least, self._width, self._tolerance, self._uniform],
            [self._choice],
            work=3 * rows * columns,
        )
        if self._shortcut:
            self._launch(_take, count, [first, self._taken], [self._choice], work=1)

    def _sew(self, first: int, count: int, seams: Callable[[np.ndarray, np.ndarray], np.ndarray] | None) -> None:
        """Cut the blocks ``first`` to ``first + count`` to shape and lay them."""
        block = self.blocks.block
        dim = (block, count, block)
        area = block * self._summed.shape[3] * 4
        self._launch(
            _overlap_errors,
            dim,
            [
                first, self._origin, self._choice, self._canvas, self._planes, self._maps, self._plane, self._width,
                self._squared,
            ],
            [self._error],
            work=2 * count * block * self._maps,
        )  # fmt: skip
        if seams is None:
            self._launch(
                _cut_paths, (count, 4), [first, self._overlap, block, self._error], [self._summed, self._cut], work=5 * area
            )
            self._launch(_mark, dim, [block, self._cut], [self._take], work=2 * count * block)
        else:
            kept = np.zeros(self._take.shape, np.uint8)
            kept[:count] = seams(self._error.numpy()[:count], self.blocks.overlap[first : first + count])
            self._take.assign(kept)
        self._launch(
            _lay, dim, [first, self._origin, self._choice, self._take, self._width], [self._canvas], work=2 * count * block
        )
