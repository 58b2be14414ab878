"""Sides of a closed cloud of points, told by how often the surface winds around both sides of each point."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array

# Points that stand for all others: as sources of the winding number, and as places where it is looked at, so many for each piece.
_SOURCES, _FEWEST_PLACES, _PLACES, _A_PIECE = 16000, 500, 2500, 100
# Pieces whose sides are decided; further ones keep theirs.
_PIECES = 64
# Outside the winding number is 0, inside 1; a cloud is closed if its points miss that by less, in the median.
_CLOSED = 0.25
_AT_ONCE = 1 << 19


def turn_outwards(points: Array, normals: Array, label: Array, area: Array) -> bool:
    """Turn the normals of whole pieces so that they point out of the solid that a closed cloud bounds, in place.

    Where normals point outwards, the winding number W (the solid angle of all oriented points, over 4 pi) is 0 on the outer
    side of every point and 1 on its inner side. Sides of pieces are changed one by one, each time the one that lessens most
    the sum of W² outside and (W - 1)² inside, until none does. So the inner wall of a hollow solid faces its cavity.

    Parameters
    ----------
    points, normals : (N, 3) array
        Points and unit normals that agree within each piece.
    label : (N,) int array
        The piece of each point.
    area : (N,) array
        Area that each point stands for.

    Returns
    -------
    bool
        Whether the cloud is closed; the normals of an open one are left as they are.

    References
    ----------
    Barill et al., "Fast Winding Numbers for Soups and Clouds", SIGGRAPH 2018, equation 4.
    """
    pieces, size = np.unique(label, return_counts=True)
    pieces = pieces[np.argsort(-size, kind="stable")][:_PIECES]
    number = np.full(label.max() + 1, len(pieces))
    number[pieces] = np.arange(len(pieces))
    piece = number[label]
    source = np.linspace(0, len(points) - 1, min(len(points), _SOURCES)).astype(int)
    looked = min(len(points), _PLACES, _FEWEST_PLACES + _A_PIECE * len(pieces))
    place = np.linspace(0, len(points) - 1, looked).astype(int)
    # An even choice stands for all of the area.
    share = area[source] * (len(points) / len(source))
    step = np.sqrt(area[place] * (len(points) / len(source)))[:, None] * normals[place]
    sources = (points[source], normals[source] * share[:, None], piece[source], len(pieces))
    above, below = (_winding_by_piece(points[place] + way * step, *sources) for way in (1.0, -1.0))
    sides = _best_sides(above, below, piece[place])
    outside, inside = _both_sides(above, below, sides, piece[place])
    if np.median(np.maximum(np.abs(outside), np.abs(inside - 1))) > _CLOSED:
        return False
    normals[sides[piece] < 0] *= -1
    return True


def _winding_by_piece(places: Array, points: Array, weighted: Array, piece: Array, count: int) -> Array:
    """Return what each piece adds to the winding number at each place, (count + 1, K); the last row is of all further pieces."""
    out = np.zeros((count + 1, len(places)))
    order = np.argsort(piece, kind="stable")
    middle = points.mean(axis=0)
    points, weighted, piece, places = points[order] - middle, weighted[order], piece[order], places - middle
    first = np.flatnonzero(np.diff(piece, prepend=-1))
    own, square = (points * weighted).sum(axis=1), (points**2).sum(axis=1)
    rows = max(1, _AT_ONCE // len(points))
    for begin in range(0, len(places), rows):
        part = places[begin : begin + rows]
        away = square - 2 * (part @ points.T) + (part**2).sum(axis=1)[:, None]
        # Its power of 3/2 must not vanish.
        np.maximum(away, 1e-200, out=away)
        angle = (own - part @ weighted.T) / (away * np.sqrt(away))
        out[piece[first], begin : begin + rows] = np.add.reduceat(angle, first, axis=1).T / (4 * np.pi)
    return out


def _best_sides(above: Array, below: Array, piece: Array) -> Array:
    """Return the side (1 or -1) of each piece, and 1 for all further ones."""
    count = len(above) - 1
    sides = np.ones(count + 1)
    own = np.arange(count)[:, None] == piece
    for _ in range(4 * count):
        outside, inside = _both_sides(above, below, sides, piece)
        cost = _miss(outside, inside).sum()
        up = sides[piece] > 0
        change = 2 * sides[:-1, None]
        without = outside - change * np.where(up, above[:-1], below[:-1])
        within = inside - change * np.where(up, below[:-1], above[:-1])
        trials = np.where(own, _miss(within, without), _miss(without, within)).sum(axis=1)
        best = int(np.argmin(trials))
        if not trials[best] < cost * (1 - 1e-9):
            break
        sides[best] *= -1
    return sides


def _miss(outside: Array, inside: Array) -> Array:
    return outside**2 + (inside - 1) ** 2


def _both_sides(above: Array, below: Array, sides: Array, piece: Array) -> tuple[Array, Array]:
    up = sides[piece] > 0
    above, below = sides @ above, sides @ below
    return np.where(up, above, below), np.where(up, below, above)
