"""The holes of a scan: border loops, which of them the scan encloses, and which are to be filled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.mesh import directed_edges, following, opposite_edges

Holes = str | int | Sequence[int] | None

# The border of a piece that encloses most is where the scan ends, if its flat filling would be larger than this share of the
# piece; any other border is, if it is larger than all of it.
_OUTER, _LARGER = 0.2, 1.0


@dataclass(frozen=True)
class Hole:
    """One border loop of a scan.

    Attributes
    ----------
    number : int
        From 1, by falling length.
    loop : (K,) int32 array
        Its vertices in order, each once, the scan's faces on the left. Where a border touches itself there are several holes.
    length, area : float
        Of the rim, and of the flat surface that the rim encloses (its vector area), in the input's unit and its square.
    center : (3,) array
        Mean of its vertices.
    piece : int
        The connected piece of the scan it belongs to.
    outer : bool
        Whether it is where the piece ends: it encloses most of all the piece's borders and more than a fifth of the piece's
        area, or more than all of it.
    """

    number: int
    loop: Array
    length: float
    area: float
    center: Array
    piece: int
    outer: bool

    def describe(self) -> str:
        """Return one line about the hole."""
        what = "outer border" if self.outer else "hole"
        at = ", ".join(f"{v:.6g}" for v in self.center)
        return f"{what} {self.number}: {len(self.loop)} edges, rim {self.length:.6g} long, area {self.area:.6g}, at ({at})"


def find_holes(vertices: Array, faces: Array) -> list[Hole]:
    """Return all border loops of a triangulated scan, longest first.

    A border that touches itself in a vertex is cut there into several.

    Parameters
    ----------
    vertices, faces : (N, 3), (F, 3) arrays
        No directed edge may belong to two faces.
    """
    if len(faces) == 0:
        return []
    edges = directed_edges(faces)
    opposite = opposite_edges(faces, len(vertices))
    border = np.flatnonzero(opposite < 0)
    # The border edge that follows: turn about the end vertex through its fan until no face is left.
    ahead = following(border)
    inside = np.flatnonzero(opposite[ahead] >= 0)
    while len(inside):
        ahead[inside] = following(opposite[ahead[inside]])
        inside = inside[opposite[ahead[inside]] >= 0]
    step = dict(zip(border.tolist(), ahead.tolist(), strict=True))
    label = _face_pieces(opposite)
    corners = vertices[faces]
    face_area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    piece_area = np.bincount(label, face_area)
    loops: list[tuple[float, Array, int]] = []
    for first in border.tolist():
        if first not in step:
            continue
        edge = step.pop(first)
        loop = [first]
        while edge != first:
            loop.append(edge)
            edge = step.pop(edge)
        loops += [(_length(vertices[rim]), rim, int(label[first // 3])) for rim in _simple(edges[loop, 0])]
    loops.sort(key=lambda entry: -entry[0])
    holes: list[Hole] = []
    for number, (length, rim, piece) in enumerate(loops, 1):
        at = vertices[rim]
        center = at.mean(axis=0)
        area = 0.5 * float(np.linalg.norm(np.cross(at - center, np.roll(at, -1, axis=0) - center).sum(axis=0)))
        holes.append(Hole(number, rim.astype(np.int32), length, area, center, piece, False))
    largest = np.zeros(len(piece_area))
    np.maximum.at(largest, [h.piece for h in holes], [h.area for h in holes])
    return [
        replace(h, outer=bool(h.area > (_OUTER if h.area == largest[h.piece] else _LARGER) * piece_area[h.piece])) for h in holes
    ]


def _face_pieces(opposite: Array) -> Array:
    """Return the piece (F,) of every face; pieces that share only a vertex are two."""
    joined = np.flatnonzero(opposite >= 0)
    count = len(opposite) // 3
    graph = coo_array((np.ones(len(joined), bool), (joined // 3, opposite[joined] // 3)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _simple(loop: Array) -> list[Array]:
    """Cut a closed loop wherever it comes back to a vertex."""
    if len(np.unique(loop)) == len(loop):
        return [loop]
    out: list[Array] = []
    path: list[int] = []
    place: dict[int, int] = {}
    for vertex in loop.tolist():
        if vertex in place:
            first = place[vertex]
            out.append(np.array(path[first:]))
            for left in path[first:]:
                del place[left]
            del path[first:]
        place[vertex] = len(path)
        path.append(vertex)
    return [*out, np.array(path)]


def choose_holes(holes: list[Hole], wanted: Holes, size: Sequence[float] | None = None) -> list[Hole]:
    """Return the holes that are to be filled.

    Parameters
    ----------
    holes : list of Hole
        From `find_holes`.
    wanted : {"all", "largest", "every"}, int or sequence of int
        "all": what the scan encloses. "largest": the longest of these. "every": outer borders as well. Numbers: these.
    size : (low, high), optional
        Only holes whose rim is at least ``low`` and at most ``high`` long, in the input's unit.

    Raises
    ------
    InputError
        For an unknown choice or number, or where nothing is left to fill.
    """
    low, high = _limits(size)
    if not holes:
        raise InputError("the scan has no border once tiny pieces are left out: nothing is missing, nothing to fill")
    enclosed = [hole for hole in holes if not hole.outer]
    if wanted is None or (isinstance(wanted, str) and wanted in ("all", "largest")):
        chosen = [hole for hole in enclosed if low <= hole.length <= high]
        if wanted == "largest":
            chosen = chosen[:1]
        if not enclosed:
            raise InputError(
                f"the scan encloses no hole: its {len(holes)} border{'s are' if len(holes) > 1 else ' is'} where the scan ends "
                f"({holes[0].describe()}); to close that all the same, give holes='every' or its number"
            )
    elif isinstance(wanted, str) and wanted == "every":
        chosen = [hole for hole in holes if low <= hole.length <= high]
    else:
        chosen = [hole for hole in _number(holes, wanted) if low <= hole.length <= high]
    if not chosen:
        lengths = f"{holes[-1].length:.4g} to {holes[0].length:.4g}"
        raise InputError(
            f"no hole is left to fill: rims are {lengths} long, wanted are {low:.4g} to {high:.4g}; widen hole_size, or choose "
            "among what `intaglio complete --holes list` shows"
        )
    return chosen


def _number(holes: list[Hole], wanted: Holes) -> list[Hole]:
    meaning = "holes must be 'all', 'largest', 'every' or numbers of holes as `intaglio info` lists them"
    if isinstance(wanted, str):
        raise InputError(f"{meaning}, not {wanted!r}")
    try:
        numbers = np.atleast_1d(np.asarray(wanted))
    except ValueError:
        numbers = np.zeros(0)
    if numbers.ndim != 1 or numbers.dtype.kind not in "iu" or len(numbers) == 0:
        raise InputError(f"{meaning}, not {wanted!r}")
    unknown = [int(n) for n in numbers if not 1 <= n <= len(holes)]
    if unknown:
        raise InputError(
            f"there is no hole {unknown[0]}: the scan has {len(holes)} (1 to {len(holes)}), "
            "`intaglio complete --holes list` shows them"
        )
    return [holes[n - 1] for n in sorted(set(numbers.tolist()))]


def _limits(size: Sequence[float] | None) -> tuple[float, float]:
    if size is None:
        return 0.0, np.inf
    try:
        low, high = (float(v) for v in size)
    except (TypeError, ValueError):
        low = high = float("nan")
    if not 0 <= low <= high:
        raise InputError(f"hole_size must be (low, high), lengths of the rim in the input's unit with low <= high, not {size!r}")
    return low, high


def _length(points: Array) -> float:
    return float(np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1).sum())
