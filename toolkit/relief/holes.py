"""The holes of a scan: border loops, which of them the scan encloses, and which are to be filled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from intaglio.errors import InputError
from intaglio.topology import directed_edges, following, opposite_edges, pieces

Array = np.ndarray
Holes = str | int | Sequence[int] | None

# A border whose flat filling would be larger than this share of its piece's area is where the scan ends, not a hole in it.
_OUTER = 0.2


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
        Whether it is where the piece ends: its filling would be larger than a fifth of the piece.
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
    _, label = pieces(faces, len(vertices))
    corners = vertices[faces]
    face_area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    piece_area = np.bincount(label[faces[:, 0]], face_area, label.max() + 1)
    loops: list[tuple[float, Array]] = []
    while step:
        first, edge = next(iter(step.items()))
        del step[first]
        loop = [first]
        while edge != first:
            loop.append(edge)
            edge = step.pop(edge)
        loops += [(_length(vertices[rim]), rim) for rim in _simple(edges[loop, 0])]
    loops.sort(key=lambda entry: -entry[0])
    holes = []
    for number, (length, rim) in enumerate(loops, 1):
        at = vertices[rim]
        center = at.mean(axis=0)
        area = 0.5 * float(np.linalg.norm(np.cross(at - center, np.roll(at, -1, axis=0) - center).sum(axis=0)))
        piece = int(label[rim[0]])
        outer = area > _OUTER * piece_area[piece]
        holes.append(Hole(number, rim.astype(np.int32), length, area, center, piece, bool(outer)))
    return holes


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
    enclosed = [hole for hole in holes if not hole.outer]
    if wanted is None or (isinstance(wanted, str) and wanted in ("all", "largest")):
        chosen = [hole for hole in enclosed if low <= hole.length <= high]
        if wanted == "largest":
            chosen = chosen[:1]
        if not chosen and holes and not enclosed:
            raise InputError(
                f"the scan encloses no hole: its {len(holes)} border{'s are' if len(holes) > 1 else ' is'} where the scan ends "
                f"({holes[0].describe()}); to close that all the same, give holes='every' or its number"
            )
    elif isinstance(wanted, str) and wanted == "every":
        chosen = [hole for hole in holes if low <= hole.length <= high]
    else:
        chosen = [hole for hole in _numbered(holes, wanted) if low <= hole.length <= high]
    if not chosen and holes:
        lengths = f"{holes[-1].length:.4g} to {holes[0].length:.4g}"
        raise InputError(f"no hole is left to fill: rims are {lengths} long, wanted are {low:.4g} to {high:.4g}")
    return chosen


def _numbered(holes: list[Hole], wanted: Holes) -> list[Hole]:
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
        raise InputError(f"there is no hole {unknown[0]}: the scan has {len(holes)} (1 to {len(holes)})")
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
