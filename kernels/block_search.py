"""The search for the blocks of a sample that fit best what they overlap on the canvas.

The canvas holds, for every pixel, the sample pixel it copies (an index into a plane) or -1; values are read through it.

The sample lies in planes of padded rows, one after another, n of them: pixel (y, x) of map c is ``c * plane + y * width + x``.
A candidate is a block's upper left corner in the sample. Candidates are searched in groups of 4 rows and 16 columns: the 16
are one vector, read from the plane at any offset.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from intaglio.kernels.lanes import ABSOLUTE, LANES, RELATIVE, SLACK, UNUSABLE, absolute_terms, difference, squared_terms, vec16

# Loops unrolled to more than four rounds would take the compiler several times as long, and run no faster.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

ROWS = 4

# The overlap is summed in this many parts. After each, a group of candidates none of which can be chosen any more is given up.
_PARTS = wp.constant(8)

# Stands for the cost of a block that fits exactly, so that of several such the least used is chosen.
EQUAL = wp.constant(1.0e-3)

# A block continues at most this many neighbours. An entry of _OTHERS says that it has to fit more blocks than it can continue.
_CONTINUED = wp.constant(4)
_OTHERS = wp.constant(-2)


@wp.struct
class SamplePlanes:
    """A sample's maps, plane after plane: pixel (y, x) of map c is number ``c * plane + y * width + x``."""

    numbers: wp.array[wp.float32]
    # The same memory, as vectors of 16 that begin at every number.
    lanes: wp.array[vec16]
    maps: int
    plane: int
    width: int


@wp.struct
class Stencils:
    """The known pixels of blocks, listed once for each shape of overlap.

    Block b has shape ``index[b]``, whose pixels stand from ``first`` on, ``count`` of them: row and column within the block, and
    for every map the distance from the block's first pixel to the pixel in the sample's planes.
    """

    index: wp.array[wp.int32]
    first: wp.array[wp.int32]
    count: wp.array[wp.int32]
    pixel: wp.array[wp.vec2i]
    offset: wp.array[wp.int32]


@wp.struct
class Barred:
    """Candidates near which no block may start, for each block of a wave: pixels of the sample, -1 for none."""

    candidate: wp.array2d[wp.int32]
    # Distance in rows and columns up to which candidates are barred; -1 bars none.
    radius: int


@wp.kernel
def gather_overlaps_kernel(
    start: int,
    first_block: int,
    origin: wp.array[wp.vec2i],
    stencils: Stencils,
    box: int,
    canvas: wp.array2d[wp.int32],
    sample: SamplePlanes,
    # output
    value: wp.array2d[wp.float32],
):
    """Write what lies under a block's known pixels p: for every map c, Σ over ``box`` x ``box`` pixels from p of map c."""
    i, k = wp.tid()
    p = start + i
    b = first_block + k
    s = stencils.index[b]
    if p >= stencils.count[s]:
        return
    at = stencils.pixel[stencils.first[s] + p]
    height = canvas.shape[0]
    width = canvas.shape[1]
    for c in range(sample.maps):
        total = float(0.0)
        for dy in range(box):
            for dx in range(box):
                y = (origin[b][0] + at[0] + dy) % height
                x = (origin[b][1] + at[1] + dx) % width
                total += sample.numbers[c * sample.plane + canvas[y, x]]
        value[k, p * sample.maps + c] = total


@wp.func
def near_barred(barred: Barred, b: int, row: int, column: int, width: int):
    """Return 1 if a barred candidate lies within ``barred.radius`` of a group of candidates, else 0."""
    radius = barred.radius
    found = int(0)
    for j in range(_CONTINUED):
        at = barred.candidate[b, j]
        if at >= 0:
            y = at / width
            x = at - y * width
            if y > row - radius - 1 and y < row + ROWS + radius and x > column - radius - 1 and x < column + LANES + radius:
                found = 1
    return found


@wp.func
def barred_lanes(barred: Barred, b: int, row: int, column: int, width: int):
    """Return `UNUSABLE` in the lanes of those candidates of a row that lie within ``barred.radius`` of a barred one, else 0."""
    radius = barred.radius
    bar = vec16(0.0)
    for j in range(_CONTINUED):
        at = barred.candidate[b, j]
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
    def overlap_costs_kernel(
        start: int,
        first_block: int,
        stencils: Stencils,
        value: wp.array2d[wp.float32],
        sample: SamplePlanes,
        penalty: wp.array2d[vec16],
        scale: float,
        barred: Barred,
        bound: wp.array[wp.float32],
        lower: wp.array3d[wp.float32],
        use_lower: int,
        # output
        cost: wp.array3d[vec16],
        least: wp.array3d[wp.float32],
    ):
        """Write scale Σ terms(sample, value) + penalty for 4 rows of 16 candidates of one block, and the least of these costs.

        The sum runs over the block's overlap and all maps (Dong, eq. 6.2.1). A group is given up when none of its 64
        candidates can come under the block's bound: at once, where its lower bound says so, or after a part of the overlap.
        What is written then is a lower bound too, above ``bound``.
        """
        i, k, g = wp.tid()
        group = start + i
        row = ROWS * group
        s = stencils.index[first_block + k]
        width = sample.width
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
        # Two tests, since kernels evaluate both sides of an "and".
        if barred.radius >= 0:
            if near_barred(barred, k, row, LANES * g, width) == 1:
                p0 += barred_lanes(barred, k, row, LANES * g, width)
                p1 += barred_lanes(barred, k, row + 1, LANES * g, width)
                p2 += barred_lanes(barred, k, row + 2, LANES * g, width)
                p3 += barred_lanes(barred, k, row + 3, LANES * g, width)
        t0 = vec16(0.0)
        t1 = vec16(0.0)
        t2 = vec16(0.0)
        t3 = vec16(0.0)
        terms_in_all = stencils.count[s] * sample.maps
        at = stencils.first[s] * sample.maps
        done = int(0)
        for part in range(_PARTS):
            stop = (terms_in_all * (part + 1)) / _PARTS
            for j in range(done, stop):
                o = base + stencils.offset[at + j]
                v = value[k, j]
                t0 += terms(sample.lanes[o], v)
                t1 += terms(sample.lanes[o + width], v)
                t2 += terms(sample.lanes[o + 2 * width], v)
                t3 += terms(sample.lanes[o + 3 * width], v)
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

    return overlap_costs_kernel


absolute_costs_kernel = _cost_kernel(absolute_terms)
squared_costs_kernel = _cost_kernel(squared_terms)


@wp.func
def exact_cost(
    candidate: int,
    first: int,
    terms: int,
    stencils: Stencils,
    value: wp.array2d[wp.float32],
    k: int,
    sample: SamplePlanes,
    squared: int,
):
    """Return one candidate's cost Σ_j difference(sample, value), over ``terms`` pixels and maps of its overlap."""
    total = float(0.0)
    for j in range(terms):
        total += difference(sample.numbers[candidate + stencils.offset[first + j]], value[k, j], squared)
    return total


@wp.kernel
def set_bounds_kernel(
    start: int,
    first_block: int,
    stencils: Stencils,
    value: wp.array2d[wp.float32],
    sample: SamplePlanes,
    penalty: wp.array2d[wp.float32],
    squared: int,
    tolerance: float,
    barred: Barred,
    lower: wp.array3d[wp.float32],
    lower_cost: wp.array3d[wp.float32],
    use_lower: int,
    # output
    bound: wp.array[wp.float32],
):
    """Write bound = (1 + tolerance) min c over the likeliest candidates, above which no candidate can be chosen.

    The likeliest are the one of least lower bound, and those that continue a neighbour, unless these are barred. The least
    cost of all candidates is at most the likeliest ones', so the bound leaves out nothing that could be chosen.
    """
    k = start + wp.tid()
    if bound[k] < 0.0:
        return
    s = stencils.index[first_block + k]
    width = sample.width
    terms = stencils.count[s] * sample.maps
    at = stencils.first[s] * sample.maps
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
                        best = wp.min(best, exact_cost(candidate, at, terms, stencils, value, k, sample, squared))
    if barred.radius < 0:
        for j in range(_CONTINUED):
            candidate = barred.candidate[k, j]
            if candidate >= 0:
                y = candidate / width
                if penalty[y, candidate - y * width] == 0.0:
                    best = wp.min(best, exact_cost(candidate, at, terms, stencils, value, k, sample, squared))
    rounding = SLACK + RELATIVE * float(terms)
    bound[k] = wp.min(float(UNUSABLE), best * (1.0 + tolerance) * rounding + 0.1 * ABSOLUTE * float(terms))


@wp.func
def weigh_use(cost: float, y: int, x: int, evenness: float, use: wp.array2d[wp.float32]) -> float:
    """Return a candidate's cost weighed by its use; where use doesn't count, the same for all."""
    weighed = float(0.0)
    if evenness >= 0.0:
        weighed = (cost + EQUAL) * (1.0 + evenness * use[y, x])
    return weighed


@wp.kernel
def choose_blocks_kernel(
    start: int,
    first_block: int,
    cost: wp.array3d[wp.float32],
    least: wp.array3d[wp.float32],
    width: int,
    tolerance: float,
    evenness: float,
    uniform: wp.array[wp.float32],
    use: wp.array2d[wp.float32],
    # output
    choice: wp.array[wp.int32],
):
    """Choose, of the candidates whose cost is at most (1 + tolerance) min c, the one of least c (1 + evenness use).

    ``use`` is a candidate's share of what even use would give it in the end. Of several equal ones the choice is random; all are
    where ``evenness`` is negative.
    """
    k = start + wp.tid()
    best = float(UNUSABLE)
    for i in range(least.shape[1]):
        for g in range(least.shape[2]):
            best = wp.min(best, least[k, i, g])
    limit = wp.min(best * (1.0 + tolerance), 0.5 * float(UNUSABLE))
    lowest = float(UNUSABLE)
    listed = int(0)
    for i in range(least.shape[1]):
        for g in range(least.shape[2]):
            if least[k, i, g] <= limit:
                for r in range(ROWS):
                    for lane in range(LANES):
                        c = cost[k, ROWS * i + r, LANES * g + lane]
                        if c <= limit:
                            weighed = weigh_use(c, ROWS * i + r, LANES * g + lane, evenness, use)
                            if weighed < lowest:
                                lowest = weighed
                                listed = 0
                            if weighed == lowest:
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
                        c = cost[k, ROWS * i + r, LANES * g + lane]
                        if c <= limit:
                            if weigh_use(c, ROWS * i + r, LANES * g + lane, evenness, use) == lowest:
                                if passed == wanted:
                                    chosen = (ROWS * i + r) * width + LANES * g + lane
                                passed += 1
    choice[first_block + k] = chosen


@wp.kernel
def count_use_kernel(
    start: int,
    first_block: int,
    count: int,
    choice: wp.array[wp.int32],
    width: int,
    block: int,
    share: float,
    # output
    use: wp.array2d[wp.float32],
):
    """Add to every candidate's use the share of its pixels that the wave's blocks take, times ``share``."""
    y = start + wp.tid()
    for k in range(count):
        row = choice[first_block + k] / width
        column = choice[first_block + k] - row * width
        down = block - wp.abs(y - row)
        if down > 0:
            for x in range(wp.max(0, column - block + 1), wp.min(use.shape[1], column + block)):
                use[y, x] += share * float(down * (block - wp.abs(x - column))) / float(block * block)


@wp.kernel
def continue_neighbors_kernel(
    start: int,
    first_block: int,
    neighbor: wp.array2d[wp.int32],
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
    for j in range(_CONTINUED):
        continued[k, j] = -1
        n = neighbor[b, j]
        if n == _OTHERS:
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
def bound_taken_kernel(
    start: int,
    taken: wp.array[wp.int32],
    # output
    bound: wp.array[wp.float32],
):
    """Write bound = -1, which no cost is under, for blocks that are taken without a search, and `UNUSABLE` for the others."""
    k = start + wp.tid()
    bound[k] = wp.where(taken[k] >= 0, -1.0, float(UNUSABLE))


@wp.kernel
def take_agreed_kernel(
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
