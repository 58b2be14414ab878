"""Holes in groups, a frame about each, and the canvas on which frames lie side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.kernels.patch_match import SIDE

# On its coarsest level a hole reaches at most so many pixels inwards: there its surroundings say what it holds. Coarser levels
# would know no more of its edges.
_INWARDS = 14

_DEEPEST = 7


@dataclass(frozen=True)
class Frame:
    """A rectangle of the image about a group of holes; it may reach beyond the image.

    Attributes
    ----------
    top, left, height, width : int
        Pixels of the finest level; multiples of twice the coarsest level's pixel.
    chart : int
        The chart that the holes are in.
    group : int
        The number of the group.
    """

    top: int
    left: int
    height: int
    width: int
    chart: int
    group: int


def group_holes(hole: Array, chart: Array) -> tuple[Array, dict[int, list[Frame]]]:
    """Return the number of each hole's group, (H, W) int, 0 elsewhere, and the groups' frames by their number of levels.

    Holes of a chart whose patches could meet are one group.
    """
    label = np.zeros(hole.shape, np.int32)
    frames: dict[int, list[Frame]] = {}
    count = 0
    for number, box in enumerate(ndimage.find_objects(np.where(hole, chart, 0)), 1):
        if box is None:
            continue
        own = hole[box] & (chart[box] == number)
        near = ndimage.binary_dilation(np.pad(own, SIDE), np.ones((3, 3)), iterations=SIDE // 2)[SIDE:-SIDE, SIDE:-SIDE]
        parts = np.where(own, ndimage.label(near, np.ones((3, 3)))[0], 0)
        inwards = ndimage.distance_transform_edt(np.pad(own, 1))[1:-1, 1:-1]
        for part, place in enumerate(ndimage.find_objects(parts), 1):
            if place is None:
                continue
            count += 1
            here = parts[place] == part
            label[box][place][here] = count
            depth = int(np.clip(np.ceil(np.log2(float(inwards[place][here].max()) / _INWARDS)), 0, _DEEPEST))
            (top, bottom), (left, right) = (
                _aligned(outer.start + inner.start, outer.start + inner.stop, depth)
                for outer, inner in zip(box, place, strict=True)
            )
            frames.setdefault(depth, []).append(Frame(top, left, bottom - top, right - left, number, count))
    return label, frames


def _aligned(start: int, stop: int, depth: int) -> tuple[int, int]:
    """Return a range with a patch's margin on the coarsest level, at whole pairs of its pixels."""
    unit, margin = 2 << depth, (SIDE + 1) << depth
    return (start - margin) // unit * unit, -(-(stop + margin) // unit) * unit


@dataclass(frozen=True)
class Canvas:
    """Frames side by side, on one level.

    Attributes
    ----------
    frame : (H, W) int array
        The place of each pixel's frame in the list, from 1 on; 0 between frames.
    place : (H, W, 2) int array
        The image's pixel on this level; it may lie beyond the image.
    corners : list of (int, int)
        Where on the canvas each frame begins.
    """

    frame: Array
    place: Array
    corners: list[tuple[int, int]]


def lay_frames(frames: list[Frame], depth: int, level: int) -> Canvas:
    """Return the canvas of a level; on all levels down to ``depth`` frames lie at the same places, as far as pixels allow."""
    unit = 2 << depth
    sizes = [(f.height // unit, f.width // unit) for f in frames]
    widest = max(max(w for _, w in sizes), int(np.ceil(np.sqrt(1.2 * sum(h * w for h, w in sizes)))))
    corners: list[tuple[int, int]] = [(0, 0)] * len(frames)
    y = x = tallest = 0
    for i in sorted(range(len(frames)), key=lambda i: (-sizes[i][0], i)):
        if x + sizes[i][1] > widest:
            y, x, tallest = y + tallest, 0, 0
        corners[i] = (y, x)
        x, tallest = x + sizes[i][1], max(tallest, sizes[i][0])
    pixels = unit >> level
    shape = ((y + tallest) * pixels, widest * pixels)
    number = np.zeros(shape, np.int32)
    place = np.zeros((*shape, 2), np.int32)
    laid = []
    for i, f in enumerate(frames):
        top, left = corners[i][0] * pixels, corners[i][1] * pixels
        rows, columns = f.height >> level, f.width >> level
        box = (slice(top, top + rows), slice(left, left + columns))
        number[box] = i + 1
        place[box] = np.moveaxis(np.indices((rows, columns)), 0, 2) + ((f.top >> level), (f.left >> level))
        laid.append((top, left))
    return Canvas(number, place, laid)
