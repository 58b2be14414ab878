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
    equal_places,
    pieces,
    used_vertices,
)
from intaglio.relief.ground.fit import KINDS, fit_base
from intaglio.relief.ground.holes import Hole, find_holes

# A piece of the scan lies on the base if its median distance from it is at most this many robust deviations of the largest piece.
_ON_BASE = 4.0
# If more than this share of the distances from a base is shape rather than relief, another base is needed.
_MOST_SHAPE = 0.5
# A piece of a few triangles holds no relief to copy, and would only be an island on the base.
_SMALLEST_PIECE = 50


def check_scan(surface: Surface) -> None:
    """Raise `InputError` for a mesh whose relief can't be completed, saying what is wrong and what would be right."""
    check_faces(surface)
    if len(border_edges(surface.faces)) == 0:
        raise InputError("the surface has no border and no holes: nothing is missing, nothing to complete")


def check_faces(surface: Surface) -> None:
    """Raise `InputError` for faces that don't fit together, saying what is wrong and what would be right."""
    vertices, faces = surface.vertices, surface.faces
    if len(vertices) == 0 or len(faces) == 0:
        raise InputError(f"the surface is empty: {len(vertices)} vertices, {len(faces)} faces")
    corners = vertices[faces]
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    if repeated.any():
        raise InputError(
            f"{repeated.sum()} faces name one vertex twice, the first is face {np.flatnonzero(repeated)[0]}; "
            "intaglio.mend_surface(surface) leaves them out"
        )
    keys = edge_keys(directed_edges(faces), len(vertices))
    unique, counts = np.unique(keys, return_counts=True)
    if (counts > 1).any():
        a, b = divmod(int(unique[counts > 1][0]), len(vertices))
        raise InputError(
            f"{(counts > 1).sum()} edges are traversed twice in the same direction, the first from vertex {a} to {b}: "
            "neighbouring faces wind in opposite directions, or more than two share an edge; "
            "intaglio.mend_surface(surface) turns them and cuts them apart"
        )
    # What has been mended may have vertices in one place, where sheets touch that don't join.
    if surface.file_vertex is None:
        border = border_edges(faces)
        place = equal_places(vertices)[border]
        joinable = int(np.isin(edge_keys(place, len(vertices)), edge_keys(place[:, ::-1], len(vertices))).sum()) // 2
        if joinable:
            raise InputError(
                f"{joinable} pairs of border edges lie exactly on one another: faces that should be joined are not; "
                "intaglio.mend_surface(surface) joins them"
            )
    if not (np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0).any():
        raise InputError("all faces have area zero: the surface is a line or a point")


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
    check_faces(surface)
    kept, faces, _ = pieces_on_base(None, surface.vertices, surface.faces)
    numbers = np.flatnonzero(kept).astype(np.int32)
    return [replace(hole, loop=numbers[hole.loop]) for hole in find_holes(surface.vertices[kept], faces)]


def choose_base(vertices: Array, faces: Array, base: Base | str, notes: list[str]) -> Base | str:
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
    fitted = fit_base(vertices[used_vertices(faces, len(vertices))], KINDS if base == "auto" else (base,))
    assert fitted.fit is not None
    share = _shape_share(fitted, vertices[used_vertices(faces, len(vertices))])
    unfit = fitted.fit.ambiguous or fitted.fit.poor or share > _MOST_SHAPE
    if base == "auto" and unfit and not all(h.outer for h in find_holes(vertices, faces)):
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
    distance = base.distance(points)
    variance = float(distance.var())
    low = points.min(axis=0)
    cell = float(np.linalg.norm(points.max(axis=0) - low)) / 10
    if variance <= (1e-6 * cell) ** 2:
        return 0.0
    _, own = np.unique(np.floor((points - low) / cell).astype(np.int64), axis=0, return_inverse=True)
    own = own.reshape(-1)
    count = np.bincount(own)
    mean = np.bincount(own, distance) / count
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
        Their faces, renumbered.
    note : str
        What was left out; empty if nothing was.
    """
    number, label = pieces(faces, len(vertices))
    used = used_vertices(faces, len(vertices))
    sizes = np.bincount(label[used], minlength=number)
    largest = int(np.argmax(sizes))
    main = used & (label == largest)
    enough = np.flatnonzero(sizes >= _SMALLEST_PIECE).tolist()
    if distance is not None:
        size = float(np.linalg.norm(np.ptp(vertices[main], axis=0)))
        tolerance = _ON_BASE * max(1.4826 * float(np.median(distance[main])), 1e-9 * size)
        enough = [p for p in enough if np.median(distance[used & (label == p)]) <= tolerance]
    taken = np.isin(label, np.array([largest, *enough])) & used
    real = int((sizes > 0).sum())
    note = ""
    if real > 1 or not used.all():
        left = int((used & ~taken).sum())
        where = "" if distance is None else "on the base "
        note = (
            f"the scan is in {real} pieces: {len({largest, *enough})} {where}taken ({taken.sum()} vertices), the "
            f"others left out ({left} vertices), {int((~used).sum())} vertices in no face"
        )
    renumber = np.cumsum(taken) - 1
    return taken, renumber[faces[taken[faces].all(axis=1)]].astype(np.int32), note


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
