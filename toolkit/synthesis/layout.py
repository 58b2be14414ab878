"""Positions of blocks, how far each is overlapped by those laid before it, and which can be laid at the same time."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.kernels.blocks import Blocks

LEFT, TOP, RIGHT, BOTTOM = range(4)


def _starts(length: int, block: int, overlap: int, wrap: bool) -> Array:
    """Return where blocks begin along one side: one step apart, or evenly around a circle of ``length``."""
    step = block - overlap
    if not wrap:
        return np.arange(max(1, -(-(length - overlap) // step))) * step
    count = max(2, -(-length // step))
    return np.arange(count) * length // count


def plan_blocks(shape: tuple[int, int], block: int, overlap: int, *, tileable: bool, continued: bool) -> Blocks:
    """Return the blocks that cover ``shape``, in waves that are equivalent to raster order.

    A block comes in a later wave than all blocks before it, in raster order, that it touches: so every block meets exactly
    what it would meet in raster order, and blocks of one wave don't touch.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the result; without ``tileable`` the canvas may be larger, to be cropped.
    block, overlap : int
        Side of a block, and how far blocks overlap at least.
    tileable : bool
        The canvas wraps around.
    continued : bool
        List the block to the upper right among those a block can continue.
    """
    ys, xs = (_starts(n, block, overlap, tileable) for n in shape)
    rows, columns = len(ys), len(xs)
    canvas = shape if tileable else (int(ys[-1]) + block, int(xs[-1]) + block)
    # A block touches those of the row above as far as ``reach - 1`` columns to the right of it; on a torus the first block of a
    # row touches the last one of the row above, and nothing can be laid at the same time.
    step = int(min(np.diff(ys).min(initial=block), np.diff(xs).min(initial=block)))
    reach = -(-block // step)
    row, column = np.indices((rows, columns))
    wave = row * columns + column if tileable else row * reach + column
    order = np.argsort(wave.ravel(), kind="stable")
    place = np.argsort(order).reshape(rows, columns)

    overlaps = np.zeros((rows, columns, 4), np.int32)
    neighbor = np.full((rows, columns, 4), -1, np.int32)
    overlaps[:, 1:, LEFT] = block - np.diff(xs)[None, :]
    overlaps[1:, :, TOP] = block - np.diff(ys)[:, None]
    neighbor[:, 1:, 0] = place[:, :-1]
    neighbor[1:, :, 1] = place[:-1, :]
    neighbor[1:, 1:, 2] = place[:-1, :-1]
    if continued:
        neighbor[1:, :-1, 3] = place[:-1, 1:]
    if tileable:
        # Blocks that extend over the edge overlap the first ones.
        overlaps[:, :, RIGHT] = np.maximum(xs + block - canvas[1], 0)[None, :]
        overlaps[:, :, BOTTOM] = np.maximum(ys + block - canvas[0], 0)[:, None]
        if not continued:
            neighbor[:, :, 3][(overlaps[..., RIGHT] > 0) | (overlaps[..., BOTTOM] > 0)] = -2
    origin = np.stack(np.meshgrid(ys, xs, indexing="ij"), axis=2).astype(np.int32)
    waves = np.concatenate([[0], np.cumsum(np.bincount(wave.ravel()))])
    flat = [a.reshape(rows * columns, -1)[order] for a in (origin, np.minimum(overlaps, block), neighbor)]
    return Blocks(block, flat[0], flat[1], flat[2], waves, canvas)
