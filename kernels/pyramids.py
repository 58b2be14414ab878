"""Gaussian pyramids of pictures with a mask, and their inverse: Burt and Adelson's kernel, normalised by what is there."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch

wp.set_module_options({"enable_backward": False})


@wp.func
def kernel_weight(k: int) -> float:
    """Burt and Adelson's generating kernel (1983), a = 0.4, at -2 to 2."""
    result = float(0.4)
    if k == 1 or k == -1:
        result = 0.25
    if k == 2 or k == -2:
        result = 0.05
    return result


@wp.kernel
def reduce_kernel(
    start: int,
    fine: wp.array2d(dtype=wp.vec4),
    # output
    coarse: wp.array2d(dtype=wp.vec4),
):
    """Half the picture: sum over 5 x 5 of the kernel times it; nothing lies beyond the border."""
    y, x = wp.tid()
    y = start + y
    total = wp.vec4(0.0, 0.0, 0.0, 0.0)
    for j in range(-2, 3):
        row = 2 * y + j
        if row >= 0 and row < fine.shape[0]:
            part = wp.vec4(0.0, 0.0, 0.0, 0.0)
            for i in range(-2, 3):
                column = 2 * x + i
                if column >= 0 and column < fine.shape[1]:
                    part += kernel_weight(i) * fine[row, column]
            total += kernel_weight(j) * part
    coarse[y, x] = total


@wp.kernel
def expand_kernel(
    start: int,
    coarse: wp.array2d(dtype=wp.vec4),
    # output
    fine: wp.array2d(dtype=wp.vec4),
):
    """Twice the picture: mean of colour over the coarse pixels in reach where the fourth is not zero, kernel-weighted.

    The fourth becomes 1 where there is any, else all are 0.
    """
    y, x = wp.tid()
    y = start + y
    total = wp.vec3(0.0, 0.0, 0.0)
    weight = float(0.0)
    for j in range(-1, 2):
        row = y / 2 + j
        dy = y - 2 * row
        if row >= 0 and row < coarse.shape[0] and dy >= -2 and dy <= 2:
            for i in range(-1, 2):
                column = x / 2 + i
                dx = x - 2 * column
                if column >= 0 and column < coarse.shape[1] and dx >= -2 and dx <= 2:
                    value = coarse[row, column]
                    if value[3] > 0.0:
                        w = kernel_weight(dy) * kernel_weight(dx)
                        total += w * wp.vec3(value[0], value[1], value[2])
                        weight += w
    result = wp.vec4(0.0, 0.0, 0.0, 0.0)
    if weight > 0.0:
        result = wp.vec4(total[0] / weight, total[1] / weight, total[2] / weight, 1.0)
    fine[y, x] = result


@wp.kernel
def normalize_kernel(
    start: int,
    level: wp.array2d(dtype=wp.vec4),
    # output
    result: wp.array2d(dtype=wp.vec4),
):
    """Divide the first three by the fourth, where that is not zero."""
    y, x = wp.tid()
    y = start + y
    value = level[y, x]
    out = wp.vec4(0.0, 0.0, 0.0, 0.0)
    if value[3] > 0.0:
        out = wp.vec4(value[0] / value[3], value[1] / value[3], value[2] / value[3], value[3])
    result[y, x] = out


@wp.kernel
def add_band_kernel(
    start: int,
    here: wp.array2d(dtype=wp.vec4),
    below: wp.array2d(dtype=wp.vec4),
    share: wp.array2d(dtype=wp.vec4),
    # output
    total: wp.array2d(dtype=wp.vec4),
):
    """Add (here - below) times the mask to the first three of ``total``, and the mask to the fourth."""
    y, x = wp.tid()
    y = start + y
    value = here[y, x]
    m = share[y, x][0]
    if value[3] > 0.0 and m > 0.0:
        band = m * (value - below[y, x])
        sum = total[y, x]
        total[y, x] = wp.vec4(sum[0] + band[0], sum[1] + band[1], sum[2] + band[2], sum[3] + m)


@wp.kernel
def collapse_kernel(
    start: int,
    sums: wp.array2d(dtype=wp.vec4),
    below: wp.array2d(dtype=wp.vec4),
    # output
    result: wp.array2d(dtype=wp.vec4),
):
    """Add the mean band of the layers to what comes from the coarser level."""
    y, x = wp.tid()
    y = start + y
    value = sums[y, x]
    low = below[y, x]
    out = low
    if value[3] > 0.0:
        out = wp.vec4(low[0] + value[0] / value[3], low[1] + value[1] / value[3], low[2] + value[2] / value[3], 1.0)
    result[y, x] = out


def reduced(fine: wp.array, device: str) -> wp.array:
    """Return the next coarser level of an (H, W) array of vec4, (H + 1) // 2 by (W + 1) // 2."""
    shape = tuple((n + 1) // 2 for n in fine.shape)
    coarse = wp.empty(shape, dtype=wp.vec4, device=device)
    launch(reduce_kernel, shape, [fine], [coarse], device=device, work=40 * shape[1])
    return coarse


def expanded(coarse: wp.array, shape: tuple[int, int], device: str) -> wp.array:
    """Return a level at the next finer ``shape``: colour where there is any, 1 or 0 in the fourth."""
    fine = wp.empty(shape, dtype=wp.vec4, device=device)
    launch(expand_kernel, shape, [coarse], [fine], device=device, work=20 * shape[1])
    return fine


def uploaded(image: np.ndarray, device: str) -> wp.array:
    """Return (H, W, 4) as an array of vec4."""
    return wp.array(np.ascontiguousarray(image, np.float32), dtype=wp.vec4, device=device)


def normalized(level: wp.array, device: str) -> wp.array:
    """Return a level with colour divided by weight; weight as it was."""
    result = wp.empty(level.shape, dtype=wp.vec4, device=device)
    launch(normalize_kernel, level.shape, [level], [result], device=device, work=5 * level.shape[1])
    return result


def add_band(here: wp.array, below: wp.array | None, share: wp.array, total: wp.array, device: str) -> None:
    """Add one layer's band of one level to ``total``; None below the coarsest."""
    under = wp.zeros(here.shape, dtype=wp.vec4, device=device) if below is None else below
    launch(add_band_kernel, here.shape, [here, under, share], [total], device=device, work=5 * here.shape[1])


def collapsed(sums: wp.array, below: wp.array, device: str) -> wp.array:
    """Return a level of the result from the sums of its bands and the expanded coarser level."""
    result = wp.empty(sums.shape, dtype=wp.vec4, device=device)
    launch(collapse_kernel, sums.shape, [sums, below], [result], device=device, work=5 * sums.shape[1])
    return result
