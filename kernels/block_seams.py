"""Boundary cuts through the overlaps of blocks, by dynamic programming, and the laying of blocks on the canvas."""

from __future__ import annotations

import warp as wp

from intaglio.kernels.block_search import SamplePlanes
from intaglio.kernels.lanes import difference

wp.set_module_options({"enable_backward": False})


@wp.kernel
def overlap_errors_kernel(
    start: int,
    first_block: int,
    origin: wp.array[wp.vec2i],
    choice: wp.array[wp.int32],
    canvas: wp.array2d[wp.int32],
    sample: SamplePlanes,
    squared: int,
    # output
    error: wp.array3d[wp.float32],
):
    """Write Σ_c difference(new, old) between a block's pixel and the one it would cover; 0 where it covers nothing."""
    i, k, x = wp.tid()
    y = start + i
    b = first_block + k
    old = canvas[(origin[b][0] + y) % canvas.shape[0], (origin[b][1] + x) % canvas.shape[1]]
    total = float(0.0)
    if old >= 0:
        new = choice[b] + y * sample.width + x
        for c in range(sample.maps):
            at = c * sample.plane
            total += difference(sample.numbers[at + new], sample.numbers[at + old], squared)
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
    """Return the cost of a seam's step across pixel ``across``, between the lines ``along - 1`` and ``along``."""
    return strip_error(error, k, side, along - 1, across, block) + strip_error(error, k, side, along, across, block)


@wp.kernel
def cut_paths_kernel(
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
    """Find the path of least error through the overlap at one side of one block, by dynamic programming.

    S(a, x) = e(a, x) + e(a, x - 1) + min over x' in {x - 1, x, x + 1} of S(a - 1, x') + the cost of the step from x' to x.
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
            # The seam runs between pixels x - 1 and x and costs the errors of both, as an edge between them costs a graph cut.
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
            # Of paths that cost the same, the straight one is taken.
            best = summed[k, side, a - 1, at]
            to = at
            if at > 0 and summed[k, side, a - 1, at - 1] + step_error(error, k, side, a, at - 1, block) < best:
                best = summed[k, side, a - 1, at - 1] + step_error(error, k, side, a, at - 1, block)
                to = at - 1
            if at + 1 < wide and summed[k, side, a - 1, at + 1] + step_error(error, k, side, a, at, block) < best:
                to = at + 1
            at = to


@wp.kernel
def mark_kept_kernel(
    start: int,
    block: int,
    cut: wp.array3d[wp.int32],
    # output
    take: wp.array3d[wp.uint8],
):
    """Write 1 for the pixels of a block that lie within its four cuts, else 0."""
    i, k, x = wp.tid()
    y = start + i
    inside = x >= cut[k, 0, y] and y >= cut[k, 1, x] and block - 1 - x >= cut[k, 2, y] and block - 1 - y >= cut[k, 3, x]
    take[k, y, x] = wp.uint8(wp.where(inside, 1, 0))


@wp.kernel
def lay_blocks_kernel(
    start: int,
    first_block: int,
    origin: wp.array[wp.vec2i],
    choice: wp.array[wp.int32],
    take: wp.array3d[wp.uint8],
    width: int,
    # output
    canvas: wp.array2d[wp.int32],
):
    """Copy a block to the canvas: its marked pixels, and all those under which there was nothing."""
    i, k, x = wp.tid()
    y = start + i
    b = first_block + k
    cy = (origin[b][0] + y) % canvas.shape[0]
    cx = (origin[b][1] + x) % canvas.shape[1]
    if take[k, y, x] > wp.uint8(0) or canvas[cy, cx] < 0:
        canvas[cy, cx] = choice[b] + y * width + x
