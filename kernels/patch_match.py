"""Patches of a canvas matched to a sample, the vote of matched patches, and the copying of pixels from where patches point.

A patch is a square of `SIDE` pixels. Canvas patches begin at every `STRIDE`-th pixel of every `STRIDE`-th row, so that a pixel
lies in several. The field holds, for every patch, the pixel of the sample at which its match begins. It is improved by PatchMatch
(Barnes et al. 2009) with jumps in place of scan order: every patch tries what its neighbours' matches imply for it, and a few
places by chance, and all patches move at once, so that results do not depend on an order.

Pictures are stored pixel by pixel, all maps of a pixel together: a row of a patch is a run of ``SIDE * maps`` numbers, compared
eight at a time.
"""

from __future__ import annotations

import warp as wp

# Loops unrolled to more than four rounds would take the compiler several times as long, and run no faster.
wp.set_module_options({"enable_backward": False, "max_unroll": 4})

SIDE, STRIDE = 8, 2
_SIDE = wp.constant(SIDE)
_STRIDE = wp.constant(STRIDE)
vec8 = wp.types.vector(length=8, dtype=wp.float32)

_NEVER = wp.constant(1.0e30)


@wp.struct
class Picture:
    """Maps of a picture, pixel by pixel: map c of pixel (y, x) is number ``(y * width + x) * maps + c``."""

    numbers: wp.array[wp.float32]
    # The same memory, as vectors of 8 that begin at every number.
    lanes: wp.array[vec8]
    maps: int
    width: int


@wp.struct
class Starts:
    """Where a patch may begin in the sample, (rows, columns), and how much more than evenly its pixels are used."""

    usable: wp.array2d[wp.int32]
    excess: wp.array2d[wp.float32]


@wp.struct
class Layout:
    """Rows and columns of a canvas and of its patches, and whether it wraps around."""

    shape: wp.vec2i
    grid: wp.vec2i
    wrap: int


@wp.struct
class Sweep:
    """How patches look for better matches.

    ``jump`` is how far the neighbours are that are asked, in patches; ``chances`` places are tried at random, the first up to
    ``radius`` pixels away; ``evenness`` is the weight of a match's excess use.
    """

    jump: int
    chances: int
    radius: int
    evenness: float
    seed: int


@wp.func
def patch_cost(canvas: Picture, at: int, sample: Picture, there: int, bound: float) -> float:
    """Return Σ (canvas - sample)² over a patch that begins at pixels ``at`` and ``there``, given up once above ``bound``."""
    total = float(0.0)
    a = at * canvas.maps
    b = there * sample.maps
    row = int(0)
    while row < _SIDE:
        squares = vec8(0.0)
        for c in range(sample.maps):
            d = canvas.lanes[a + 8 * c] - sample.lanes[b + 8 * c]
            squares += wp.cw_mul(d, d)
        total += wp.dot(squares, vec8(1.0))
        a += canvas.width * canvas.maps
        b += sample.width * sample.maps
        row += 1
        if total > bound:
            row = _SIDE
    return total


@wp.func
def try_place(
    y: int,
    x: int,
    canvas: Picture,
    at: int,
    sample: Picture,
    starts: Starts,
    evenness: float,
    best: wp.vec2i,
    least: float,
    cost: float,
):
    """Return the better of two matches of a patch, what it weighs, and its cost without the weight of its use."""
    found = best
    weighed = least
    plain = cost
    if y >= 0 and x >= 0 and y < starts.usable.shape[0] and x < starts.usable.shape[1]:
        if starts.usable[y, x] != 0 and (y != best[0] or x != best[1]):
            factor = 1.0 + evenness * starts.excess[y, x]
            value = patch_cost(canvas, at, sample, y * sample.width + x, least / factor)
            if value * factor < least:
                found = wp.vec2i(y, x)
                weighed = value * factor
                plain = value
    return found, weighed, plain


@wp.kernel
def match_kernel(
    start: int,
    active: wp.array[wp.int32],
    layout: Layout,
    canvas: Picture,
    sample: Picture,
    starts: Starts,
    sweep: Sweep,
    field: wp.array[wp.vec2i],
    # output
    found: wp.array[wp.vec2i],
    cost: wp.array[wp.float32],
):
    """Improve one patch's match: the least Σ (canvas - sample)² (1 + evenness excess) of what neighbours and chance offer."""
    k = active[start + wp.tid()]
    grid = layout.grid
    evenness = sweep.evenness
    row = k / grid[1]
    column = k - row * grid[1]
    at = _STRIDE * (row * canvas.width + column)
    best = field[k]
    plain = patch_cost(canvas, at, sample, best[0] * sample.width + best[1], _NEVER)
    least = plain * (1.0 + evenness * starts.excess[best[0], best[1]])
    for side in range(8):
        turn = side + wp.where(side > 3, 1, 0)
        dy = (turn / 3 - 1) * sweep.jump
        dx = (turn % 3 - 1) * sweep.jump
        y = row + dy
        x = column + dx
        if layout.wrap == 1:
            y = (y + grid[0]) % grid[0]
            x = (x + grid[1]) % grid[1]
        if y >= 0 and x >= 0 and y < grid[0] and x < grid[1]:
            there = field[y * grid[1] + x]
            best, least, plain = try_place(
                there[0] - _STRIDE * dy, there[1] - _STRIDE * dx, canvas, at, sample, starts, evenness, best, least, plain
            )  # fmt: skip
    state = wp.rand_init(sweep.seed, k)
    reach = int(sweep.radius)
    for _ in range(sweep.chances):
        y = best[0] + wp.randi(state, -reach, reach + 1)
        x = best[1] + wp.randi(state, -reach, reach + 1)
        best, least, plain = try_place(y, x, canvas, at, sample, starts, evenness, best, least, plain)
        reach = wp.max(reach / 2, 1)
    found[k] = best
    cost[k] = plain


@wp.kernel
def vote_kernel(
    start: int,
    pixels: wp.array[wp.int32],
    layout: Layout,
    sample: Picture,
    field: wp.array[wp.vec2i],
    weight: wp.array[wp.float32],
    falloff: wp.array[wp.float32],
    voting: int,
    # output
    canvas: Picture,
):
    """Give a pixel the weighted mean of what the patches over it say, Σ w_k f(p) S(match_k + p) / Σ w_k f(p)."""
    i = pixels[start + wp.tid()]
    shape = layout.shape
    grid = layout.grid
    wrap = layout.wrap
    y = i / shape[1]
    x = i - y * shape[1]
    for c in range(voting):
        total = float(0.0)
        weights = float(0.0)
        for down in range(_SIDE):
            top = y - down
            if wrap == 1 and top < 0:
                top += shape[0]
            row = top / _STRIDE
            if top >= 0 and row * _STRIDE == top and row < grid[0]:
                for right in range(_SIDE):
                    left = x - right
                    if wrap == 1 and left < 0:
                        left += shape[1]
                    column = left / _STRIDE
                    if left >= 0 and column * _STRIDE == left and column < grid[1]:
                        k = row * grid[1] + column
                        w = weight[k] * falloff[down] * falloff[right]
                        there = (field[k][0] + down) * sample.width + field[k][1] + right
                        total += w * sample.numbers[there * sample.maps + c]
                        weights += w
        value = total / weights
        canvas.numbers[(y * canvas.width + x) * canvas.maps + c] = value
        # A canvas that wraps around is continued by a patch's width.
        if wrap == 1:
            if y < _SIDE:
                canvas.numbers[((y + shape[0]) * canvas.width + x) * canvas.maps + c] = value
            if x < _SIDE:
                canvas.numbers[(y * canvas.width + x + shape[1]) * canvas.maps + c] = value
            if y < _SIDE:
                if x < _SIDE:
                    canvas.numbers[((y + shape[0]) * canvas.width + x + shape[1]) * canvas.maps + c] = value


@wp.func
def away_from_vote(
    y: int, x: int, there: wp.vec2i, shape: wp.vec2i, wrap: int, canvas: Picture, sample: Picture, usable: wp.array2d[wp.int32]
) -> float:
    """Return the mean of (vote - sample)² over the 3 x 3 pixels about a pixel copied as one piece; huge where none may be."""
    result = float(_NEVER)
    if there[0] >= 0 and there[1] >= 0 and there[0] < usable.shape[0] and there[1] < usable.shape[1]:
        if usable[there[0], there[1]] != 0:
            total = float(0.0)
            count = float(0.0)
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    v = y + dy
                    u = x + dx
                    if wrap == 1:
                        v = (v + shape[0]) % shape[0]
                        u = (u + shape[1]) % shape[1]
                    b = there[0] + dy
                    a = there[1] + dx
                    if v >= 0 and u >= 0 and v < shape[0] and u < shape[1]:
                        if b >= 0 and a >= 0 and b < usable.shape[0] and a < usable.shape[1]:
                            if usable[b, a] != 0:
                                for c in range(sample.maps):
                                    d = (
                                        canvas.numbers[(v * canvas.width + u) * canvas.maps + c]
                                        - sample.numbers[(b * sample.width + a) * sample.maps + c]
                                    )
                                    total += d * d
                                count += 1.0
            result = total / count
    return result


@wp.func
def seam_cost(one: wp.vec2i, other: wp.vec2i, step: wp.vec2i, sample: Picture, usable: wp.array2d[wp.int32]) -> float:
    """Return Kwatra's cost of a border between neighbouring pixels: how far both places are from agreeing on either pixel."""
    a = other - step
    b = one + step
    result = float(0.0)
    if one[0] != a[0] or one[1] != a[1]:
        for c in range(sample.maps):
            # A place beyond the sample says nothing: the pixel's own step stands for it.
            p = sample.numbers[(one[0] * sample.width + one[1]) * sample.maps + c]
            q = sample.numbers[(other[0] * sample.width + other[1]) * sample.maps + c]
            first = p - q
            second = p - q
            if a[0] >= 0 and a[1] >= 0 and a[0] < usable.shape[0] and a[1] < usable.shape[1]:
                if usable[a[0], a[1]] != 0:
                    first = p - sample.numbers[(a[0] * sample.width + a[1]) * sample.maps + c]
            if b[0] >= 0 and b[1] >= 0 and b[0] < usable.shape[0] and b[1] < usable.shape[1]:
                if usable[b[0], b[1]] != 0:
                    second = sample.numbers[(b[0] * sample.width + b[1]) * sample.maps + c] - q
            result += first * first + second * second
    return result


@wp.func
def border_cost(
    y: int,
    x: int,
    there: wp.vec2i,
    source: wp.array2d[wp.vec2i],
    wrap: int,
    sample: Picture,
    usable: wp.array2d[wp.int32],
    price: float,
) -> float:
    """Return the seam costs of a pixel against its four neighbours, each border also at a fixed price."""
    height = source.shape[0]
    width = source.shape[1]
    total = float(0.0)
    for side in range(4):
        step = wp.vec2i(0, 0)
        if side < 2:
            step[0] = 2 * side - 1
        else:
            step[1] = 2 * side - 5
        v = y + step[0]
        u = x + step[1]
        if wrap == 1:
            v = (v + height) % height
            u = (u + width) % width
        if v >= 0 and u >= 0 and v < height and u < width:
            other = source[v, u]
            if other[0] != there[0] + step[0] or other[1] != there[1] + step[1]:
                total += seam_cost(there, other, step, sample, usable) + price
    return total


@wp.kernel
def copy_kernel(
    start: int,
    pixels: wp.array[wp.int32],
    layout: Layout,
    canvas: Picture,
    sample: Picture,
    usable: wp.array2d[wp.int32],
    field: wp.array[wp.vec2i],
    before: wp.array2d[wp.vec2i],
    # output
    source: wp.array2d[wp.vec2i],
):
    """Copy a pixel from where one of the patches over it points: the place whose 3 x 3 surroundings are nearest to the vote."""
    i = pixels[start + wp.tid()]
    shape = layout.shape
    grid = layout.grid
    wrap = layout.wrap
    y = i / shape[1]
    x = i - y * shape[1]
    best = before[y, x]
    least = away_from_vote(y, x, best, shape, wrap, canvas, sample, usable)
    for down in range(_SIDE):
        top = y - down
        if wrap == 1 and top < 0:
            top += shape[0]
        row = top / _STRIDE
        if top >= 0 and row * _STRIDE == top and row < grid[0]:
            for right in range(_SIDE):
                left = x - right
                if wrap == 1 and left < 0:
                    left += shape[1]
                column = left / _STRIDE
                if left >= 0 and column * _STRIDE == left and column < grid[1]:
                    there = field[row * grid[1] + column] + wp.vec2i(down, right)
                    if there[0] != best[0] or there[1] != best[1]:
                        value = away_from_vote(y, x, there, shape, wrap, canvas, sample, usable)
                        if value < least:
                            least = value
                            best = there
    source[y, x] = best


@wp.kernel
def settle_kernel(
    start: int,
    pixels: wp.array[wp.int32],
    wrap: int,
    canvas: Picture,
    sample: Picture,
    usable: wp.array2d[wp.int32],
    faith: float,
    price: float,
    # output
    source: wp.array2d[wp.vec2i],
):
    """Let a pixel join the piece of a neighbour where that costs less: faith (vote - sample)² + seams.

    The pixels of a launch are not neighbours, so that each meets what the others were before.
    """
    i = pixels[start + wp.tid()]
    shape = wp.vec2i(source.shape[0], source.shape[1])
    y = i / shape[1]
    x = i - y * shape[1]
    own = source[y, x]
    border = border_cost(y, x, own, source, wrap, sample, usable, price)
    if border > 0.0:
        best = own
        least = border + faith * away_from_vote(y, x, own, shape, wrap, canvas, sample, usable)
        for side in range(8):
            turn = side + wp.where(side > 3, 1, 0)
            dy = turn / 3 - 1
            dx = turn % 3 - 1
            v = y + dy
            u = x + dx
            if wrap == 1:
                v = (v + shape[0]) % shape[0]
                u = (u + shape[1]) % shape[1]
            if v >= 0 and u >= 0 and v < shape[0] and u < shape[1]:
                there = source[v, u] - wp.vec2i(dy, dx)
                if there[0] != best[0] or there[1] != best[1]:
                    away = away_from_vote(y, x, there, shape, wrap, canvas, sample, usable)
                    if away < _NEVER:
                        value = faith * away + border_cost(y, x, there, source, wrap, sample, usable, price)
                        if value < least:
                            least = value
                            best = there
        source[y, x] = best
