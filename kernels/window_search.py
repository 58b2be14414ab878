"""The search for the sample pixel whose neighbourhood looks most like that of a pixel to be synthesised.

A neighbourhood is a square window of the pixel's own level of a pyramid, of which only what is there already counts, and
3 x 3 pixels of the coarser level around the pixel's parent. Sample neighbourhoods lie in groups of 16, element by element:
element k of the 16 in group g is one vector. Four groups are compared at a time, and given up as soon as none of their 64
can be the best.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from intaglio.kernels.lanes import ABSOLUTE, LANES, RELATIVE, SLACK, UNUSABLE, absolute_terms, difference, squared_terms, vec16

wp.set_module_options({"enable_backward": False})

# The parent's surroundings: 3 x 3.
PARENTS = wp.constant(9)

# Groups compared at a time.
TOGETHER = wp.constant(4)

# Groups may be given up after any of this many parts.
PARTS = wp.constant(6)


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
def gather_windows(
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
def propose(
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
        if source >= 0 and source % sample_width + 1 < sample_width:
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


absolute_search = _search_kernel(absolute_terms)
squared_search = _search_kernel(squared_terms)


@wp.kernel
def pick_pixels(
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
