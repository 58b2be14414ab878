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

# Loops unrolled to more than four rounds would take the compiler several times as long, and run no faster.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

# Pixels of the coarser level that count: 3 x 3 around the parent.
_PARENTS = wp.constant(9)

# Groups of 16 neighbourhoods that are compared at a time.
TOGETHER = wp.constant(4)

# Differences are summed in this many parts. After each, groups that cannot hold the best any more are given up.
_PARTS = wp.constant(6)


@wp.struct
class LevelPixels:
    """One level of a pyramid: the sample's maps (n, H W), and the sample pixel that each pixel of the result copies, or -1."""

    planes: wp.array2d[wp.float32]
    canvas: wp.array2d[wp.int32]


@wp.struct
class SampleWindows:
    """Neighbourhoods of the sample's pixels in groups of 16, element by element.

    Of a neighbourhood's ``elements`` the first ``positions`` are summaries of a pixel's ``maps``, the others these maps.
    """

    numbers: wp.array[wp.float32]
    # The same memory, as vectors of 16 neighbourhoods.
    lanes: wp.array[vec16]
    # The pixel that each neighbourhood belongs to, and the neighbourhood of each pixel, -1 where it has none, -2 where the pixel
    # may not be copied.
    place: wp.array[wp.int32]
    slot: wp.array[wp.int32]
    groups: int
    elements: int
    positions: int
    maps: int
    # Pixels in a row of the sample.
    width: int


@wp.struct
class Window:
    """The square window: its side, and 1 if the result wraps around."""

    side: int
    wrap: int


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
    """Append one known pixel to a target's lists: its summary Σ_c sign_c v_c, and all its maps v_c."""
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
def gather_windows_kernel(
    start: int,
    first: int,
    target: wp.array[wp.vec2i],
    window: Window,
    level: LevelPixels,
    coarse: LevelPixels,
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
    side = window.side
    wrap = window.wrap
    area = side * side
    listed = int(0)
    if has_coarse == 1:
        rows = coarse.canvas.shape[0]
        columns = coarse.canvas.shape[1]
        for j in range(_PARENTS):
            y = at[0] / 2 + j / 3 - 1
            x = at[1] / 2 + j % 3 - 1
            if wrap == 1:
                y = (y + rows) % rows
                x = (x + columns) % columns
            if y >= 0 and x >= 0 and y < rows and x < columns:
                source = coarse.canvas[y, x]
                if source >= 0:
                    enlist(t, listed, area + j, source, coarse.planes, sign, positions, element, value)
                    listed += 1
    reach = side / 2
    rows = level.canvas.shape[0]
    columns = level.canvas.shape[1]
    for j in range(area):
        y = at[0] + j / side - reach
        x = at[1] + j % side - reach
        if wrap == 1:
            y = (y + rows * side) % rows
            x = (x + columns * side) % columns
        # Where the result wraps around and is no larger than the window, the pixel itself comes again and is left out.
        if y >= 0 and x >= 0 and y < rows and x < columns and (y != at[0] or x != at[1]):
            source = level.canvas[y, x]
            if source >= 0:
                enlist(t, listed, j, source, level.planes, sign, positions, element, value)
                listed += 1
    count[t] = listed


@wp.kernel
def propose_kernel(
    start: int,
    first: int,
    target: wp.array[wp.vec2i],
    exhaustive: wp.array[wp.uint8],
    window: Window,
    canvas: wp.array2d[wp.int32],
    sample: SampleWindows,
    element: wp.array2d[wp.int32],
    value: wp.array2d[wp.float32],
    squared: int,
    # output
    count: wp.array[wp.int32],
    bound: wp.array[wp.float32],
    pixel: wp.array[wp.int32],
):
    """Write bound = min Σ difference(sample, value) over the pixels that continue what was copied around the target.

    These are the candidates of Ashikhmin (2001). A target that need not be searched takes the pixel next to its left
    neighbour's source, if the sample has one (Dong, section 5.3.1); its list is emptied then, with a count of -1.
    """
    t = start + wp.tid()
    at = target[first + t]
    rows = canvas.shape[0]
    columns = canvas.shape[1]
    side = window.side
    area = side * side
    reach = side / 2
    elements = sample.elements
    positions = sample.positions
    maps = sample.maps
    best = float(UNUSABLE)
    chosen = int(-1)
    if exhaustive[first + t] == wp.uint8(0) and at[1] > 0:
        source = canvas[at[0], at[1] - 1]
        if source >= 0 and source % sample.width + 1 < sample.width:
            if sample.slot[source + 1] > -2:
                chosen = source + 1
    if chosen >= 0:
        count[t] = -1
        pixel[t] = chosen
        bound[t] = -1.0
        return
    before = int(-1)
    for j in range(area):
        dy = j / side - reach
        dx = j % side - reach
        y = at[0] + dy
        x = at[1] + dx
        if window.wrap == 1:
            y = (y + rows * side) % rows
            x = (x + columns * side) % columns
        if y >= 0 and x >= 0 and y < rows and x < columns:
            source = canvas[y, x]
            if source >= 0:
                column = source % sample.width - dx
                candidate = source - dy * sample.width - dx
                inside = column >= 0 and column < sample.width and candidate >= 0 and candidate < sample.slot.shape[0]
                # Neighbours that continue one piece propose the same candidate, which is compared once.
                if inside and candidate != before:
                    before = candidate
                    s = sample.slot[candidate]
                    if s >= 0:
                        total = float(0.0)
                        lane = (s / LANES) * elements * LANES + s % LANES
                        for i in range(positions, positions + count[t] * maps):
                            total += difference(sample.numbers[lane + element[t, i] * LANES], value[t, i], squared)
                        if total < best:
                            best = total
                            chosen = candidate
    # The search may round differently, and must not reject the candidate that the bound comes from.
    bound[t] = best * (SLACK + RELATIVE * float(count[t] * maps))
    pixel[t] = chosen


def _search_kernel(terms: Any) -> wp.Kernel:
    """Return the search kernel for one metric."""

    @wp.kernel
    def window_search_kernel(
        start: int,
        sample: SampleWindows,
        chunk: int,
        element: wp.array2d[wp.int32],
        value: wp.array2d[wp.float32],
        count: wp.array[wp.int32],
        bound: wp.array[wp.float32],
        scale: float,
        # output
        cost: wp.array2d[wp.float32],
        pixel: wp.array2d[wp.int32],
    ):
        """Find the neighbourhood of one chunk that has the least Σ terms(sample, value); of equal ones, the sample's first pixel.

        Summaries, signed sums over a pixel's maps, bound the cost from below: |Σ±d| <= Σ|d|, and (Σ±d)^2 <= n Σd^2.
        """
        i, t = wp.tid()
        c = start + i
        elements = sample.elements
        positions = sample.positions
        maps = sample.maps
        listed = count[t]
        best = bound[t]
        found = int(-1)
        if listed > 0:
            for g in range(c * chunk, wp.min(sample.groups, (c + 1) * chunk), TOGETHER):
                base = g * elements
                passes = int(1)
                if maps > 1:
                    # Rounding may lift a lower bound above the cost: a summary is a sum of ``maps`` values up to 1.
                    amount = ABSOLUTE + 2.0 * RELATIVE * float(maps * maps)
                    limit = (best * (SLACK + RELATIVE * float(listed * maps)) + amount * float(listed)) / scale
                    s0 = vec16(0.0)
                    s1 = vec16(0.0)
                    s2 = vec16(0.0)
                    s3 = vec16(0.0)
                    begun = int(0)
                    for part in range(_PARTS):
                        stop = (listed * (part + 1)) / _PARTS
                        for j in range(begun, stop):
                            v = value[t, j]
                            k = base + element[t, j]
                            s0 += terms(sample.lanes[k], v)
                            s1 += terms(sample.lanes[k + elements], v)
                            s2 += terms(sample.lanes[k + 2 * elements], v)
                            s3 += terms(sample.lanes[k + 3 * elements], v)
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
                    for part in range(_PARTS):
                        stop = positions + (listed * maps * (part + 1)) / _PARTS
                        for j in range(done, stop):
                            v = value[t, j]
                            k = base + element[t, j]
                            t0 += terms(sample.lanes[k], v)
                            t1 += terms(sample.lanes[k + elements], v)
                            t2 += terms(sample.lanes[k + 2 * elements], v)
                            t3 += terms(sample.lanes[k + 3 * elements], v)
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
                                    at = sample.place[(g + q) * LANES + lane]
                                    if least < best or found < 0 or at < found:
                                        best = least
                                        found = at
        cost[t, c] = wp.where(found >= 0, best, float(UNUSABLE))
        pixel[t, c] = found

    return window_search_kernel


absolute_search_kernel = _search_kernel(absolute_terms)
squared_search_kernel = _search_kernel(squared_terms)


@wp.kernel
def pick_pixels_kernel(
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
    """Copy the sample pixel of least cost over all chunks; where nothing is known around the target, one at random."""
    t = start + wp.tid()
    at = target[first + t]
    chosen = int(-1)
    if count[t] < 0:
        chosen = pixel[t]
    elif count[t] == 0:
        chosen = place[wp.min(candidates - 1, int(uniform[first + t] * float(candidates)))]
    else:
        # Where no chunk has a better one, the pixel that `propose_kernel` found is taken.
        chosen = pixel[t]
        best = float(UNUSABLE)
        for c in range(cost.shape[1]):
            if nearest[t, c] >= 0 and (cost[t, c] < best or (cost[t, c] == best and nearest[t, c] < chosen)):
                best = cost[t, c]
                chosen = nearest[t, c]
    canvas[at[0], at[1]] = chosen
