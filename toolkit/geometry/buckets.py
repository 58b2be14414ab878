"""Growing sets of points in a hashed regular grid of buckets: points in a box are found, removed and added quickly."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array

# The record of a point: position and normal in the swatch's frame, Pauly's surface variation, the swatch point it comes
# from, how far warp and blending moved it, and the patch that laid it.
RECORD = np.dtype(
    [("point", "f8", 3), ("normal", "f4", 3), ("variation", "f4"), ("source", "i4"), ("moved", "f4"), ("patch", "i4")],
)


def wrap(points: Array, period: tuple[float | None, float | None]) -> None:
    """Bring points (N, 3) into the period, in place."""
    for axis, length in enumerate(period):
        if length is not None:
            points[:, axis] -= np.floor(points[:, axis] / length) * length


def within(points: Array, low: Array, high: Array) -> Array:
    """Return which points (N, 3) lie in the box [low, high) of the plane; its corners may be (2,) or (N, 2)."""
    low, high = np.asarray(low), np.asarray(high)
    inside = np.ones(len(points), bool)
    for axis in range(2):
        along = points[:, axis]
        inside &= (along >= low[..., axis]) & (along < high[..., axis])
    return inside


class Buckets:
    """Records in square buckets over the reference plane (Duranleau & Poulin, section 4).

    Parameters
    ----------
    side : float
        Side of a bucket.
    period : (float or None, float or None)
        The plane closes on itself after so much, along either axis; None: it does not.
    """

    def __init__(self, side: float, period: tuple[float | None, float | None] = (None, None)) -> None:
        self.side, self.period = float(side), period
        self._buckets: dict[tuple[int, int], list[Array]] = {}

    def __len__(self) -> int:
        return sum(len(part) for parts in self._buckets.values() for part in parts)

    def add(self, records: Array) -> None:
        """Add records, wrapped into the period."""
        if not len(records):
            return
        records = records.copy()
        wrap(records["point"], self.period)
        cell = np.floor(records["point"][:, :2] / self.side).astype(np.int64)
        order = np.lexsort((cell[:, 1], cell[:, 0]))
        cell, records = cell[order], records[order]
        edge = np.flatnonzero(np.concatenate([[True], (np.diff(cell, axis=0) != 0).any(axis=1)]))
        for begin, end in zip(edge, [*edge[1:], len(records)], strict=True):
            self._buckets.setdefault((int(cell[begin, 0]), int(cell[begin, 1])), []).append(records[begin:end])

    def inside(self, low: Array, high: Array) -> Array:
        """Return copies of the records in the box [low, high), shifted by periods into it."""
        found = []
        for shift, begin, end in self._images(low, high):
            for key in self._touched(begin, end):
                parts = self._buckets.get(key)
                if parts is None:
                    continue
                part = self._join_parts(key, parts)
                if not self._covered(key, begin, end):
                    part = part[within(part["point"], begin, end)]
                if shift.any():
                    part = part.copy()
                    part["point"][:, :2] += shift
                found.append(part)
        return np.concatenate(found) if found else np.empty(0, RECORD)

    def remove(self, low: Array, high: Array) -> None:
        """Remove the records in the box [low, high) and its periodic images."""
        for _, begin, end in self._images(low, high):
            for key in self._touched(begin, end):
                parts = self._buckets.get(key)
                if parts is None:
                    continue
                if self._covered(key, begin, end):
                    del self._buckets[key]
                    continue
                part = self._join_parts(key, parts)
                self._buckets[key] = [part[~within(part["point"], begin, end)]]

    def everything(self) -> Array:
        """Return all records, ordered by bucket."""
        parts = [part for key in sorted(self._buckets) for part in self._buckets[key]]
        return np.concatenate(parts) if parts else np.empty(0, RECORD)

    def _join_parts(self, key: tuple[int, int], parts: list[Array]) -> Array:
        if len(parts) > 1:
            self._buckets[key] = parts = [np.concatenate(parts)]
        return parts[0]

    def _images(self, low: Array, high: Array) -> list[tuple[Array, Array, Array]]:
        """Return (shift, low, high) of every part of a box that lies in another period."""
        turns = []
        for axis, length in enumerate(self.period):
            if length is None:
                turns.append([0.0])
            else:
                first, last = int(np.floor(low[axis] / length)), int(np.floor(high[axis] / length))
                turns.append([turn * length for turn in range(first, last + 1)])
        shifts = [np.array([x, y]) for x in turns[0] for y in turns[1]]
        return [(shift, np.asarray(low)[:2] - shift, np.asarray(high)[:2] - shift) for shift in shifts]

    def _touched(self, low: Array, high: Array) -> list[tuple[int, int]]:
        first = np.floor(low / self.side).astype(int)
        last = np.floor(high / self.side).astype(int)
        return [(i, j) for i in range(first[0], last[0] + 1) for j in range(first[1], last[1] + 1)]

    def _covered(self, key: tuple[int, int], low: Array, high: Array) -> bool:
        return all(key[i] * self.side >= low[i] and (key[i] + 1) * self.side <= high[i] for i in range(2))
