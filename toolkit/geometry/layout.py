"""Positions of patches: scan-line order, overlaps, and which of them can be made at the same time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from intaglio.arrays import Array


@dataclass(frozen=True)
class PatchPlace:
    """A patch to be laid (Duranleau & Poulin, figure 1); lengths from its lower left corner unless said otherwise.

    Attributes
    ----------
    number : int
        In scan-line order.
    origin : (2,) array
        Lower left corner on the plane.
    size : (2,) array
        Sides of the patch.
    overlap : (4,) array
        How far what is there already reaches in from the left, bottom, right and top; 0 where nothing is.
    extra : (4,) array
        Width of the extra region E on those sides.
    part : int
        0, or which quarter of a patch it is, from 1.
    """

    number: int
    origin: Array
    size: Array
    overlap: Array
    extra: Array
    part: int = 0

    @property
    def low(self) -> Array:
        """Lower corner of the box that is replaced."""
        return self.origin - self.extra[:2]

    @property
    def high(self) -> Array:
        """Upper corner of the box that is replaced."""
        return self.origin + self.size + self.extra[2:]

    def overlapping(self, x: Array, y: Array) -> Array:
        """Return which positions of the patch lie in an overlap."""
        left, bottom, right, top = self.overlap
        inside = (x >= 0) & (x <= self.size[0]) & (y >= 0) & (y <= self.size[1])
        strips = ((left > 0) & (x <= left)) | ((bottom > 0) & (y <= bottom))
        strips |= ((right > 0) & (x >= self.size[0] - right)) | ((top > 0) & (y >= self.size[1] - top))
        return inside & strips

    def share_of_old(self, x: Array, y: Array) -> Array:
        """Return how much the old geometry counts at positions of the box: 1 at its border, 0 past the overlap (figure 3c).

        Beside the extra region, where a strip of overlap goes on past the patch, it returns to 1 at the box's end, so that
        what the next patch meets there has no step.
        """
        (left, bottom, right, top), (width, height) = self.overlap, self.size
        sides = [
            _ramp(x, left),
            _ramp(y, bottom),
            _ramp(width - x, right),
            _ramp(height - y, top),
        ]
        keep = np.ones_like(x)
        for side in sides:
            keep = keep * (1 - side)
        extra_left, _, extra_right, _ = self.extra
        outward = np.maximum(_ramp(width + extra_right - x, extra_right), _ramp(x + extra_left, extra_left))
        reach = max(extra_left, extra_right)
        beside = np.maximum(_ramp(y - bottom, reach) * (bottom > 0), _ramp(height - top - y, reach) * (top > 0))
        return 1 - keep * (1 - outward * beside)

    def free_places(self, margin: float) -> Array:
        """Return the corners and sides' middles (K, 2) of the box and its margin that are far from every overlap."""
        low, high = -self.extra[:2] - margin, self.size + self.extra[2:] + margin
        middle = (low + high) / 2
        places = np.array([(x, y) for x in (low[0], middle[0], high[0]) for y in (low[1], middle[1], high[1])])
        places = places[(places != middle).any(axis=1)]
        left, bottom, right, top = self.overlap
        gap = np.full(len(places), np.inf)
        for width, value in ((left, places[:, 0]), (bottom, places[:, 1])):
            if width > 0:
                gap = np.minimum(gap, value - width)
        for width, value, end in ((right, places[:, 0], self.size[0]), (top, places[:, 1], self.size[1])):
            if width > 0:
                gap = np.minimum(gap, end - width - value)
        return places[gap > 0.5 * float(max(self.overlap.max(), 1e-300))]

    def quarters(self) -> list[PatchPlace]:
        """Return four patches of about half the size in its place, in scan-line order."""
        made: list[PatchPlace] = []
        share = self.overlap.max() / 2
        half = (self.size + share) / 2
        step = self.size - half
        for row, column in product((0, 1), (0, 1)):
            overlap, extra = np.zeros(4), np.zeros(4)
            for axis, far in ((0, column), (1, row)):
                before, after = self.overlap[axis], self.overlap[axis + 2]
                overlap[axis] = max(share, before - step[axis]) if far else min(before, half[axis])
                # The overlap from the other side may extend past the middle.
                overlap[axis + 2] = min(after, half[axis]) if far else max(0.0, after - step[axis])
                extra[axis] = 0.0 if far else self.extra[axis]
                inner = max(0.0, step[axis] - after) if after > 0 else step[axis]
                extra[axis + 2] = self.extra[axis + 2] if far else min(self.extra.max(), inner)
            made.append(PatchPlace(self.number, self.origin + step * (column, row), half, overlap, extra, len(made) + 1))
        return made


def _ramp(distance: Array, width: float) -> Array:
    """Return 1 at distance 0 falling smoothly to 0 at ``width``; 0 where there is no width."""
    if width <= 0:
        return np.zeros_like(distance)
    t = np.clip(1 - np.clip(distance, -width, width) / width, 0, 1)
    return t * t * (3 - 2 * t)


@dataclass(frozen=True)
class Layout:
    """All patches of an output.

    Attributes
    ----------
    places : tuple of PatchPlace
        In scan-line order.
    levels : list of lists of int
        Patches, by number, that touch none of their level: each level follows those before it.
    low, high : (2,) arrays
        The part of the plane that is kept.
    period : (float or None, float or None)
    """

    places: tuple[PatchPlace, ...]
    levels: list[list[int]]
    low: Array
    high: Array
    period: tuple[float | None, float | None]


def lay_out(size: Array, patch: Array, overlap: float, extra: float, margin: float, *, tileable: bool) -> Layout:
    """Return the patches that cover ``size``, evenly spaced so that the last ones end with it; overlaps are at least ``overlap``.

    Parameters
    ----------
    size, patch : (2,) arrays
        Sides of the output and of a patch.
    overlap : float
        Least overlap of neighbours.
    extra : float
        Width w_E of the extra region; unless ``tileable``, also of the border that is cut off at the end.
    margin : float
        How far beyond its box a patch looks at what is there.
    tileable : bool
        The output closes on itself.
    """
    low, high = np.zeros(2), np.asarray(size, float)
    begin, length = (low, high) if tileable else (low - extra, high + 2 * extra)
    counts, steps = [], []
    for axis in range(2):
        if tileable:
            count = max(1, int(np.ceil(length[axis] / (patch[axis] - overlap) - 1e-9)))
            steps.append(length[axis] / count)
        else:
            count = max(1, int(np.ceil((length[axis] - overlap) / (patch[axis] - overlap) - 1e-9)))
            steps.append((length[axis] - patch[axis]) / (count - 1) if count > 1 else patch[axis])
        counts.append(count)
    over = patch - np.array(steps)
    columns, rows = counts
    places: list[PatchPlace] = []
    for row, column in product(range(rows), range(columns)):
        origin = begin + np.array([column, row]) * steps
        overlaps = np.array([over[0] if column else 0.0, over[1] if row else 0.0, 0.0, 0.0])
        extras = np.array([0.0, 0.0, extra, extra])
        if tileable:
            # Past the period is the geometry of the first column and row, which is overlapped but not replaced.
            room = length - (origin + patch)
            overlaps[2:] = np.maximum(-room, 0)
            extras = np.array([extra if column == 0 else 0.0, extra if row == 0 else 0.0, *np.clip(room, 0, extra)])
        places.append(PatchPlace(len(places), origin, np.asarray(patch, float), overlaps, extras))
    period = (float(length[0]), float(length[1])) if tileable else (None, None)
    levels = _levels(places, (columns, rows), np.array(steps), margin, period)
    return Layout(tuple(places), levels, low, high, period)


def _levels(
    places: list[PatchPlace], shape: tuple[int, int], steps: Array, margin: float, period: tuple[float | None, float | None]
) -> list[list[int]]:
    """Group patches whose boxes, and what they look at, don't meet; the result is that of scan-line order."""
    columns, rows = shape
    widest = max(float((p.high - p.low).max()) for p in places) + margin
    span = [min(int(np.ceil(widest / step)), count) for step, count in zip(steps, shape, strict=True)]
    level = np.zeros(len(places), int)
    for number, place in enumerate(places):
        row, column = divmod(number, columns)
        near = [
            (row + dy) % rows * columns + (column + dx) % columns
            for dy in range(-span[1], span[1] + 1)
            for dx in range(-span[0], span[0] + 1)
            if (period[1] is not None or 0 <= row + dy < rows) and (period[0] is not None or 0 <= column + dx < columns)
        ]
        earlier = [other for other in set(near) if other < number and _meet(place, places[other], margin, period)]
        level[number] = 1 + max((level[other] for other in earlier), default=-1)
    return [np.flatnonzero(level == k).tolist() for k in range(level.max() + 1)]


def _meet(a: PatchPlace, b: PatchPlace, margin: float, period: tuple[float | None, float | None]) -> bool:
    for axis in range(2):
        low, high = a.low[axis] - margin, a.high[axis] + margin
        shifts = [0.0] if period[axis] is None else [-float(period[axis] or 0), 0.0, float(period[axis] or 0)]
        if not any(low < b.high[axis] + shift and high > b.low[axis] + shift for shift in shifts):
            return False
    return True
