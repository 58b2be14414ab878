"""The search for blocks of a sample whose overlap with what is laid fits best.

The canvas holds, for every pixel, the sample pixel it copies (an index into a plane) or -1; values are read through it.

The sample lies in planes of padded rows, one after another, n of them: pixel (y, x) of map c is ``c * plane + y * width + x``.
A candidate is a block's upper left corner in the sample. Candidates are searched in groups of 4 rows and 16 columns: the 16
are one vector, read from the plane at any offset.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from intaglio.kernels.lanes import ABSOLUTE, LANES, RELATIVE, SLACK, UNUSABLE, absolute_terms, difference, squared_terms, vec16

wp.set_module_options({"enable_backward": False})

ROWS = 4

# A search gives a group up after any of this many parts of the overlap, as soon as it can't be chosen any more.
PARTS = wp.constant(8)

# The most blocks that a block can continue; and what stands in their list if it has to fit others too.
CONTINUED = wp.constant(4)
OTHERS = wp.constant(-2)


@wp.kernel
def gather_overlaps(
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
        if radius >= 0:
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


absolute_costs = _cost_kernel(absolute_terms)
squared_costs = _cost_kernel(squared_terms)


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
def set_bounds(
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
def choose_blocks(
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
def continue_neighbours(
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
def bound_taken(
    start: int,
    taken: wp.array[wp.int32],
    # output
    bound: wp.array[wp.float32],
):
    """Leave no search to blocks that are taken without one: every cost is above a bound of -1."""
    k = start + wp.tid()
    bound[k] = wp.where(taken[k] >= 0, -1.0, float(UNUSABLE))


@wp.kernel
def take_agreed(
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
