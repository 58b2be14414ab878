"""Pictures on the device: their pyramids, and samples of them averaged over any size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.launch import upload

wp.set_module_options({"enable_backward": False})


@wp.struct
class Pyramid:
    """A picture's pyramid: its pixels level by level, the finest first, and every level's first pixel, width and height."""

    values: wp.array[wp.vec3]
    levels: wp.array2d[wp.int32]


@wp.func
def fetch(picture: Pyramid, offset: int, width: int, height: int, x: int, y: int) -> wp.vec3:
    """Return a pixel of one level of the picture's pyramid; the border's value beyond it."""
    column = wp.min(wp.max(x, 0), width - 1)
    row = wp.min(wp.max(y, 0), height - 1)
    return picture.values[offset + row * width + column]


@wp.func
def bilinear(picture: Pyramid, level: int, x: float, y: float) -> wp.vec3:
    """Return the bilinear sample of one level at finest-level coordinates (x, y)."""
    scale = 1.0 / float(1 << level)
    # Pixel centres of level 0 are at whole numbers; those of a level of side 2^l average them.
    sx = (x + 0.5) * scale - 0.5
    sy = (y + 0.5) * scale - 0.5
    fx = wp.floor(sx)
    fy = wp.floor(sy)
    ax = sx - fx
    ay = sy - fy
    offset = picture.levels[level, 0]
    w = picture.levels[level, 1]
    h = picture.levels[level, 2]
    ix = int(fx)
    iy = int(fy)
    upper = (1.0 - ax) * fetch(picture, offset, w, h, ix, iy) + ax * fetch(picture, offset, w, h, ix + 1, iy)
    lower = (1.0 - ax) * fetch(picture, offset, w, h, ix, iy + 1) + ax * fetch(picture, offset, w, h, ix + 1, iy + 1)
    return (1.0 - ay) * upper + ay * lower


@wp.func
def catmull_rom(t: float) -> wp.vec4:
    """Return the weights of four neighbours at t between the inner two (Keys 1981, a = -1/2)."""
    t2 = t * t
    t3 = t2 * t
    return wp.vec4(-0.5 * t3 + t2 - 0.5 * t, 1.5 * t3 - 2.5 * t2 + 1.0, -1.5 * t3 + 2.0 * t2 + 0.5 * t, 0.5 * t3 - 0.5 * t2)


@wp.func
def bicubic(picture: Pyramid, x: float, y: float) -> wp.vec3:
    """Return the bicubic sample of the finest level, not below zero."""
    fx = wp.floor(x)
    fy = wp.floor(y)
    wx = catmull_rom(x - fx)
    wy = catmull_rom(y - fy)
    total = wp.vec3(0.0, 0.0, 0.0)
    for j in range(4):
        for i in range(4):
            total += (
                wx[i] * wy[j] * fetch(picture, 0, picture.levels[0, 1], picture.levels[0, 2], int(fx) - 1 + i, int(fy) - 1 + j)
            )
    return wp.max(total, wp.vec3(0.0, 0.0, 0.0))


@wp.func
def at_level(picture: Pyramid, level: float, x: float, y: float) -> wp.vec3:
    """Return the trilinear sample between two levels; bicubic where the finest is not finer than needed."""
    result = wp.vec3(0.0, 0.0, 0.0)
    if level <= 0.0:
        result = bicubic(picture, x, y)
    else:
        low = wp.min(int(wp.floor(level)), picture.levels.shape[0] - 1)
        high = wp.min(low + 1, picture.levels.shape[0] - 1)
        part = wp.min(level - float(low), 1.0)
        # In mixtures too the finest level is sampled bicubically, since sharpness would jump at a footprint of one pixel.
        if low == 0:
            result = (1.0 - part) * bicubic(picture, x, y)
        else:
            result = (1.0 - part) * bilinear(picture, low, x, y)
        if part > 0.0:
            result += part * bilinear(picture, high, x, y)
    return result


@dataclass(frozen=True)
class Picture:
    """A photograph's pyramid on the device: every level halves the one before, by means of 2 x 2 pixels."""

    pyramid: Pyramid
    width: int
    height: int

    @classmethod
    def of(cls, image: np.ndarray, device: str) -> Picture:
        """Build it from (H, W, 3) linear values."""
        parts, table, offset = [], [], 0
        level = np.ascontiguousarray(image, np.float32)
        while True:
            height, width = level.shape[:2]
            parts.append(level.reshape(-1, 3))
            table.append((offset, width, height))
            offset += height * width
            if min(height, width) < 4:
                break
            even = np.pad(level, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
            level = 0.25 * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])
        pyramid = Pyramid()
        pyramid.values = upload(np.concatenate(parts), wp.vec3, device)
        pyramid.levels = upload(np.array(table), wp.int32, device)
        return cls(pyramid, image.shape[1], image.shape[0])
