"""Gaussian pyramids of pictures with a mask, and their inverse: Burt and Adelson's kernel, normalised by what is there."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload

wp.set_module_options({"enable_backward": False})


@wp.func
def kernel_weight(k: int) -> float:
    """Return Burt and Adelson's generating kernel (1983) at ``k`` from -2 to 2: 0.05, 0.25, 0.4, 0.25, 0.05 (a = 0.4)."""
    result = float(0.4)
    if k == 1 or k == -1:
        result = 0.25
    if k == 2 or k == -2:
        result = 0.05
    return result


@wp.kernel
def reduce_kernel(
    start: int,
    fine: wp.array2d[wp.vec4],
    # output
    coarse: wp.array2d[wp.vec4],
):
    """Write coarse(y, x) = Σ_j Σ_i w_j w_i fine(2 y + j, 2 x + i), i and j from -2 to 2; nothing lies beyond the border."""
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
    coarse: wp.array2d[wp.vec4],
    # output
    fine: wp.array2d[wp.vec4],
):
    """Write fine(y, x) = Σ w c / Σ w over the coarse pixels in reach whose fourth is above 0, c their first three.

    w is the kernel's weight at the distance y - 2 row, times that at x - 2 column. The fourth becomes 1 where there is any
    such pixel; else all four are 0.
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
    level: wp.array2d[wp.vec4],
    # output
    result: wp.array2d[wp.vec4],
):
    """Write the first three divided by the fourth, and the fourth; all 0 where the fourth is not above 0."""
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
    here: wp.array2d[wp.vec4],
    below: wp.array2d[wp.vec4],
    share: wp.array2d[wp.vec4],
    # output
    total: wp.array2d[wp.vec4],
):
    """Add m (here - below) to the first three of ``total`` and m to the fourth, m being the first of ``share``."""
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
    sums: wp.array2d[wp.vec4],
    below: wp.array2d[wp.vec4],
    # output
    result: wp.array2d[wp.vec4],
):
    """Write below + sums / w: the mean band of the layers, their sum over its weight w, on top of the coarser level."""
    y, x = wp.tid()
    y = start + y
    value = sums[y, x]
    low = below[y, x]
    out = low
    if value[3] > 0.0:
        out = wp.vec4(low[0] + value[0] / value[3], low[1] + value[1] / value[3], low[2] + value[2] / value[3], 1.0)
    result[y, x] = out


def reduce_level(fine: wp.array, device: str) -> wp.array:
    """Return the next coarser level of an (H, W) array of vec4, (H + 1) // 2 by (W + 1) // 2."""
    shape = tuple((n + 1) // 2 for n in fine.shape)
    coarse = wp.empty(shape, dtype=wp.vec4, device=device)
    launch(reduce_kernel, shape, inputs=[fine], outputs=[coarse], device=device, work=40 * shape[1])
    return coarse


def expand_level(coarse: wp.array, shape: tuple[int, int], device: str) -> wp.array:
    """Return a level at the next finer ``shape``: colour where there is any, 1 or 0 in the fourth."""
    fine = wp.empty(shape, dtype=wp.vec4, device=device)
    launch(expand_kernel, shape, inputs=[coarse], outputs=[fine], device=device, work=20 * shape[1])
    return fine


def upload_image(image: np.ndarray, device: str) -> wp.array:
    """Return (H, W, 4) as an array of vec4."""
    return upload(image, wp.vec4, device)


def normalize_level(level: wp.array, device: str) -> wp.array:
    """Return a level with colour divided by weight; weight as it was."""
    result = wp.empty(level.shape, dtype=wp.vec4, device=device)
    launch(normalize_kernel, level.shape, inputs=[level], outputs=[result], device=device, work=5 * level.shape[1])
    return result


def add_band(here: wp.array, below: wp.array | None, share: wp.array, total: wp.array, device: str) -> None:
    """Add one layer's band of one level to ``total``; ``below`` is None for the coarsest level."""
    under = wp.zeros(here.shape, dtype=wp.vec4, device=device) if below is None else below
    launch(add_band_kernel, here.shape, inputs=[here, under, share], outputs=[total], device=device, work=5 * here.shape[1])


def collapse_level(sums: wp.array, below: wp.array, device: str) -> wp.array:
    """Return a level of the result from the sums of its bands and the expanded coarser level."""
    result = wp.empty(sums.shape, dtype=wp.vec4, device=device)
    launch(collapse_kernel, sums.shape, inputs=[sums, below], outputs=[result], device=device, work=5 * sums.shape[1])
    return result
