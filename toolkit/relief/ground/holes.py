"""The holes of a scan: border loops, which of them the scan encloses, and which are to be filled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array
from intaglio.checks import check_fields
from intaglio.errors import InputError
from intaglio.mesh import LARGE, face_areas, following, numbered_sets, opposite_edges

Holes = str | int | Sequence[int] | None

# The border of a piece that encloses the largest area is where the scan ends if that area is more than _OUTER of the piece's
# own; any other border is if its area is more than _LARGER of the piece's.
_OUTER, _LARGER = 0.2, 1.0


@dataclass(frozen=True)
class Hole:
    """Border loop of a scan: a hole, or where the scan ends.

    Attributes
    ----------
    number : int
        Number from 1, by decreasing length, as `complete_relief` takes it.
    loop : (K,) int32 array
        The scan's vertices in order, each once, with its faces on the left. A border that touches itself is several loops.
    length : float
        Length of the loop, in the input's unit.
    area : float
        Area of the flat surface inside the loop (its vector area), in the square of the input's unit.
    center : (3,) float64 array
        Mean of the vertices.
    piece : int
        Number of the connected piece of the scan that the loop belongs to.
    outer : bool
        Whether the piece ends here: the loop has the largest area of the piece's loops, and more than a fifth of the area of
        the piece itself, or it has more than the whole area of the piece.

    See Also
    --------
    intaglio.list_holes : Lists the holes of a scan.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> x, y = np.meshgrid(np.arange(12.0), np.arange(12.0))
    >>> points = np.stack([x, y, np.zeros_like(x)], axis=-1)
    >>> points[5:7, 5:7] = np.nan
    >>> scan = intaglio.surface_from_range_image(points, view=(5, 5, 100))
    >>> hole = intaglio.list_holes(scan)[1]
    >>> hole.outer, hole.center, round(hole.area, 2)
    (False, array([5.5, 5.5, 0. ]), 7.0)
    """

    number: int
    loop: Array
    length: float
    area: float
    center: Array
    piece: int
    outer: bool

    def __post_init__(self) -> None:
        check_fields(self, nan=True)

    def describe(self) -> str:
        """Return one line of text about the hole.

        Returns
        -------
        str
            Number, edges, length, area and position.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> x, y = np.meshgrid(np.arange(12.0), np.arange(12.0))
        >>> points = np.stack([x, y, np.zeros_like(x)], axis=-1)
        >>> scan = intaglio.surface_from_range_image(points, view=(5, 5, 100))
        >>> intaglio.list_holes(scan)[0].describe()
        'outer border 1: 44 edges, rim 44 long, area 121, at (5.5, 5.5, 0)'
        """
        what = "outer border" if self.outer else "hole"
        at = ", ".join(f"{v:.6g}" for v in self.center)
        return f"{what} {self.number}: {len(self.loop)} edges, rim {self.length:.6g} long, area {self.area:.6g}, at ({at})"


class Borders:
    """The borders of a scan: found once, whoever asks for them.

    Parameters
    ----------
    vertices, faces : (N, 3), (F, 3) arrays
        As given.
    """

    def __init__(self, vertices: Array, faces: Array) -> None:
        self.vertices, self.faces = vertices, faces

    def __bool__(self) -> bool:
        return bool((self.opposite < 0).any())

    @cached_property
    def opposite(self) -> Array:
        """The `opposite_edges` (3F,) of the faces."""
        return opposite_edges(self.faces, len(self.vertices))

    @cached_property
    def holes(self) -> list[Hole]:
        """The holes, as `find_holes` finds them."""
        return find_holes(self.vertices, self.faces, self.opposite)


def find_holes(vertices: Array, faces: Array, opposite: Array | None = None) -> list[Hole]:
    """Return all border loops of a triangulated scan, longest first.

    A border that touches itself in a vertex is cut there into several.

    Parameters
    ----------
    vertices, faces : (N, 3), (F, 3) arrays
        No directed edge may belong to two faces.
    opposite : (3F,) int array, optional
        The `opposite_edges`, where they are known.
    """
    if len(faces) == 0:
        return []
    if opposite is None:
        opposite = opposite_edges(faces, len(vertices))
    border = np.flatnonzero(opposite < 0)
    # The following border edge is found by turning about the end vertex, through its fan of faces, until none is left.
    ahead = following(border)
    inside = np.flatnonzero(opposite[ahead] >= 0)
    while len(inside):
        ahead[inside] = following(opposite[ahead[inside]])
        inside = inside[opposite[ahead[inside]] >= 0]
    step = dict(zip(border.tolist(), ahead.tolist(), strict=True))
    label = _face_pieces(opposite)
    piece_area = np.bincount(label, face_areas(vertices, faces))
    loops: list[tuple[float, Array, int]] = []
    for first in border.tolist():
        if first not in step:
            continue
        edge = step.pop(first)
        loop = [first]
        while edge != first:
            loop.append(edge)
            edge = step.pop(edge)
        loops += [(_length(vertices[rim]), rim, int(label[first // 3])) for rim in _simple(faces.reshape(-1)[loop])]
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
    count = len(opposite) // 3
    if count > LARGE:
        across = opposite.astype(np.int32, copy=False).reshape(-1, 3) // np.int32(3)
        face = np.arange(count, dtype=np.int32)
        return numbered_sets(count, [(face, np.ascontiguousarray(across[:, k])) for k in range(3)])[1]
    joined = np.flatnonzero(opposite >= 0)
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
        "all": the holes that the scan encloses. "largest": the longest of these. "every": outer borders as well. Numbers: the
        holes of these numbers.
    size : (low, high), optional
        Only holes whose rim is at least ``low`` and at most ``high`` long, in the input's unit.

    Raises
    ------
    InputError
        For an unknown choice or number, or if nothing is left to fill.
    """
    low, high = _limits(size)
    if not holes:
        raise InputError("the scan has no border, apart from tiny pieces: nothing is missing, nothing to fill")
    enclosed = [hole for hole in holes if not hole.outer]
    if wanted is None or (isinstance(wanted, str) and wanted in ("all", "largest")):
        chosen = [hole for hole in enclosed if low <= hole.length <= high]
        if wanted == "largest":
            chosen = chosen[:1]
        if not enclosed:
            raise InputError(
                f"the scan encloses no hole: its {len(holes)} border{'s are' if len(holes) > 1 else ' is'} where the scan ends "
                f"({holes[0].describe()}); to close that nevertheless, give holes='every' or its number"
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
