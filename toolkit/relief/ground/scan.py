"""Checks of a scan, the choice of its base, and the choice of its pieces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import checked_arguments
from intaglio.errors import FitError, InputError
from intaglio.mesh import (
    Base,
    Cylinder,
    Plane,
    Sphere,
    Surface,
    border_edges,
    directed_edges,
    edge_keys,
    edges_pair_up,
    equal_places,
    face_areas,
    pieces,
    used_vertices,
)
from intaglio.relief.ground.fit import JUDGED, KINDS, evenly, fit_base
from intaglio.relief.ground.holes import Borders, Hole, find_holes

# A piece of the scan lies on the base if its median distance from it is at most this many robust deviations of the largest piece.
_ON_BASE = 4.0
# If more than this share of the distances from a base is shape rather than relief, another base is needed.
_MOST_SHAPE = 0.5
# A piece of a few triangles holds no relief to copy, and would only be an island on the base.
_SMALLEST_PIECE = 50
# So many faces are looked at at once for one that has an area.
_AT_ONCE = 1 << 16


def check_scan(surface: Surface) -> Borders:
    """Return the borders of a scan.

    Raises
    ------
    InputError
        For a mesh whose relief can't be completed; the message says what is wrong and what would be right.
    """
    borders = check_faces(surface)
    if not borders:
        raise InputError("the surface has no border and no holes: nothing is missing, nothing to complete")
    return borders


def check_faces(surface: Surface) -> Borders:
    """Return the borders of a mesh, or raise `InputError` for faces that don't fit together, saying what would be right."""
    vertices, faces = surface.vertices, surface.faces
    if len(vertices) == 0 or len(faces) == 0:
        raise InputError(f"the surface is empty: {len(vertices)} vertices, {len(faces)} faces")
    first, second, third = faces.T
    repeated = (first == second) | (second == third) | (third == first)
    if repeated.any():
        raise InputError(
            f"{repeated.sum()} faces name one vertex twice, the first is face {np.flatnonzero(repeated)[0]}; "
            "intaglio.mend_surface(surface) leaves them out"
        )
    borders = Borders(vertices, faces)
    if not edges_pair_up(faces, borders.opposite, len(vertices)):
        unique, counts = np.unique(edge_keys(directed_edges(faces), len(vertices)), return_counts=True)
        a, b = divmod(int(unique[counts > 1][0]), len(vertices))
        raise InputError(
            f"{(counts > 1).sum()} edges are traversed twice in the same direction, the first from vertex {a} to {b}: "
            "neighbouring faces wind in opposite directions, or more than two share an edge; "
            "intaglio.mend_surface(surface) turns them and cuts them apart"
        )
    # What has been mended may have vertices in one place, where sheets touch that don't join.
    if surface.file_vertex is None:
        border = border_edges(faces, borders.opposite)
        rim = np.unique(border)
        place = equal_places(vertices[rim])[np.searchsorted(rim, border)]
        joinable = int(np.isin(edge_keys(place, len(rim)), edge_keys(place[:, ::-1], len(rim))).sum()) // 2
        if joinable:
            raise InputError(
                f"{joinable} pairs of border edges lie exactly on one another: faces that should be joined are not; "
                "intaglio.mend_surface(surface) joins them"
            )
    if not any((face_areas(vertices, faces[at : at + _AT_ONCE]) > 0).any() for at in range(0, len(faces), _AT_ONCE)):
        raise InputError("all faces have area zero: the surface is a line or a point")
    return borders


@checked_arguments
def list_holes(surface: Surface) -> list[Hole]:
    """List the holes and outer borders of a scan, longest first, with the numbers that `complete_relief` takes.

    Pieces of fewer than 50 vertices, other than the largest, are left out, as in completion.

    Parameters
    ----------
    surface : Surface
        The scan.

    Returns
    -------
    list of Hole
        The border loops; ``outer`` tells whether one is the end of the scan rather than a hole in it.

    Raises
    ------
    InputError
        If the argument is not a surface, is empty, or its faces don't fit together.

    Examples
    --------
    A sheet with one hole:

    >>> import numpy as np
    >>> import intaglio
    >>> x, y = np.meshgrid(np.arange(12.0), np.arange(12.0))
    >>> points = np.stack([x, y, np.zeros_like(x)], axis=-1)
    >>> points[5:7, 5:7] = np.nan
    >>> scan = intaglio.surface_from_range_image(points, view=(5, 5, 100))
    >>> [(hole.number, hole.outer, round(hole.length, 2)) for hole in intaglio.list_holes(scan)]
    [(1, True, 44.0), (2, False, 9.66)]
    """
    if not isinstance(surface, Surface):
        raise InputError(f"surface must be an intaglio.Surface, not {type(surface).__name__}; read_surface(path) gives one")
    borders = check_faces(surface)
    kept, faces, _ = pieces_on_base(None, surface.vertices, surface.faces)
    if kept.all():
        return borders.holes
    numbers = np.flatnonzero(kept).astype(np.int32)
    return [replace(hole, loop=numbers[hole.loop]) for hole in find_holes(surface.vertices[kept], faces)]


def choose_base(borders: Borders, base: Base | str, notes: list[str]) -> Base | str:
    """Return the base as given or fitted, or "smooth", and add to ``notes`` what was chosen and why.

    "auto" takes the plane, cylinder or sphere that fits best. If none fits, two fit equally well, or most of the distances from
    the base are shape rather than relief, and the scan encloses a hole, the smoothed scan is the base.

    Raises
    ------
    InputError
        For an unknown base.
    FitError
        If no base fits.
    """
    if isinstance(base, Plane | Cylinder | Sphere):
        notes.append(f"base as given: {base.describe()}")
        return base
    if not isinstance(base, str) or base not in ("auto", "smooth", *KINDS):
        raise InputError(
            f"unknown base {base!r}; known: 'auto', 'smooth', {', '.join(map(repr, KINDS))}, or a Plane, Cylinder or Sphere"
        )
    if base == "smooth":
        return base
    vertices = borders.vertices
    used = used_vertices(borders.faces, len(vertices))
    points = vertices if used.all() else vertices[used]
    fitted = fit_base(points, KINDS if base == "auto" else (base,))
    assert fitted.fit is not None
    share = _shape_share(fitted, points)
    unfit = fitted.fit.ambiguous or fitted.fit.poor or share > _MOST_SHAPE
    if base == "auto" and unfit and not all(h.outer for h in borders.holes):
        why = "no plane, cylinder or sphere fits the scan"
        if fitted.fit.ambiguous:
            why = "two kinds fit equally well"
        elif not fitted.fit.poor:
            why = f"{share:.0%} of the distances from a {fitted.kind} is shape, in waves longer than a fifth of the scan"
        notes.append(f"base: the smoothed scan, since {why} ({fitted.fit.note})")
        return "smooth"
    if fitted.fit.ambiguous:
        table = ", ".join(f"{k} rms {v[0]:.6g}" for k, v in sorted(fitted.fit.candidates.items()))
        raise FitError(f"several bases fit the scan equally well ({table}): choose base='plane', 'cylinder' or 'sphere'")
    if fitted.fit.poor and base == "auto":
        raise FitError(
            f"no plane, cylinder or sphere fits this scan ({fitted.fit.note}), and it encloses no hole that a smooth base "
            f"could fill: cut out a part that one of them fits, or choose one nevertheless, base='{fitted.kind}'"
        )
    notes += [f"base fitted: {fitted.describe()}", fitted.fit.note]
    return fitted


def _shape_share(base: Base, points: Array) -> float:
    """Return the share of the variance of distances from ``base`` that is in waves longer than a fifth of the scan.

    That is the variance between the means of cubic cells whose side is a tenth of the scan.
    """
    points = evenly(points, JUDGED)
    distance = base.distance(points)
    variance = float(distance.var())
    low = points.min(axis=0)
    cell = float(np.linalg.norm(points.max(axis=0) - low)) / 10
    if variance <= (1e-6 * cell) ** 2:
        return 0.0
    # There are at most eleven cells along an axis.
    own = np.zeros(len(points), np.int32)
    for axis in range(3):
        own *= 16
        own += np.floor((points[:, axis] - low[axis]) / cell).astype(np.int32)
    count = np.bincount(own)
    held = count > 0
    mean = np.bincount(own, distance)[held] / count[held]
    count = count[held]
    return float((count * (mean - distance.mean()) ** 2).sum() / (len(points) * variance))


def pieces_on_base(distance: Array | None, vertices: Array, faces: Array) -> tuple[Array, Array, str]:
    """Choose the connected pieces that lie on the base; vertices that no face uses are left out.

    Parameters
    ----------
    distance : (N,) array or None
        Unsigned distances from the base; None chooses every piece that is not tiny.
    vertices, faces : (N, 3), (F, 3) arrays
        The scan.

    Returns
    -------
    kept : (N,) bool array
        The vertices of the chosen pieces.
    faces : (F', 3) int32 array
        Their faces, renumbered; where all are chosen, the given ones.
    note : str
        What was left out; empty if nothing was.
    """
    number, label = pieces(faces, len(vertices))
    used = used_vertices(faces, len(vertices))
    sizes = np.bincount(label[used] if number > 1 else np.zeros(int(used.sum()), np.int8), minlength=number)
    largest = int(np.argmax(sizes))
    enough = np.flatnonzero(sizes >= _SMALLEST_PIECE).tolist()
    if distance is not None:
        main = used & (label == largest)
        size = float(np.linalg.norm(np.ptp(vertices[main], axis=0)))
        tolerance = _ON_BASE * max(1.4826 * float(np.median(distance[main])), 1e-9 * size)
        enough = [p for p in enough if np.median(distance[used & (label == p)]) <= tolerance]
    chosen = np.zeros(number, bool)
    chosen[[largest, *enough]] = True
    taken = chosen[label] & used
    real = int((sizes > 0).sum())
    note = ""
    if real > 1 or not used.all():
        left = int((used & ~taken).sum())
        where = "" if distance is None else "on the base "
        note = (
            f"the scan is in {real} pieces: {len({largest, *enough})} {where}taken ({taken.sum()} vertices), the "
            f"others left out ({left} vertices), {int((~used).sum())} vertices in no face"
        )
    if taken.all():
        return taken, faces.astype(np.int32, copy=False), note
    renumber = np.cumsum(taken, dtype=np.int32) - 1
    return taken, renumber[faces[taken[faces[:, 0]]]].astype(np.int32, copy=False), note


def check_joined(faces: Array, count: int, scanned: int) -> None:
    """Raise `InputError` if a piece of the triangulation holds no scanned vertex, so that no relief could grow there."""
    number_of_pieces, label = pieces(faces, count)
    reached = np.zeros(number_of_pieces, bool)
    reached[label[:scanned]] = True
    if not reached.all():
        raise InputError(
            "part of what is to be completed is not joined to the scan, so no relief can grow there: choose an extent that "
            "touches the scan, or cut spikes off the scan's border"
        )
