"""Surfaces from points: a range image in its own grid, or points seen along one direction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from intaglio.arrays import Array
from intaglio.checks import (
    checked_arguments,
    checked_direction,
    checked_number,
    checked_numeric,
    checked_rows,
    checked_shape,
    checked_vector,
    refuse_huge,
)
from intaglio.errors import InputError
from intaglio.mesh.surface import Surface
from intaglio.mesh.topology import Topology


@checked_arguments
def surface_from_range_image(
    points: Array, *, view: ArrayLike = (0.0, 0.0, 0.0), color: Array | None = None, steepest: float = 80.0
) -> Surface:
    """Triangulate a range image in its own grid, without bridging depth discontinuities.

    Every cell of four measured neighbours gives two triangles, cut along the shorter diagonal, and every cell of three
    gives one.

    Parameters
    ----------
    points : (H, W, 3) array
        Positions in any unit of length; NaN where nothing was measured.
    view : (3,) array, optional
        Where the scanner stood, in the same coordinates: faces look towards it. For parallel rays give a far point.
        Default the origin, where most scanners put themselves.
    color : (H, W, 3) array, optional
        Linear colours in [0, 1]. Default None: no colours.
    steepest : float, optional
        A triangle whose normal is this many degrees or more from the line of sight is taken for a bridge over a
        discontinuity and left out. Default 80, since scanners hardly measure surfaces that are seen at a lower angle.

    Returns
    -------
    Surface
        Its vertices are the measured points that some triangle uses, row by row.

    Raises
    ------
    InputError
        If points or view have the wrong shape, no three measured points are neighbours, or all triangles are too steep.

    See Also
    --------
    intaglio.render.range_scan : Simulated range images.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[2:-1:-1, 0:3].astype(float)
    >>> points = np.stack([x, y, np.full((3, 3), -10.0)], axis=-1)
    >>> points[0, 0] = np.nan
    >>> surface = intaglio.surface_from_range_image(points)
    >>> len(surface.vertices), len(surface.faces)
    (8, 7)
    >>> surface.normal[0]
    array([0., 0., 1.])
    """
    points = checked_numeric("points", points, np.float64)
    stood = checked_vector("view", view)
    if points.ndim != 3 or points.shape[2] != 3:
        raise InputError(f"points of a range image must have shape (H, W, 3), not {points.shape}")
    steepest = checked_number("steepest", steepest, 0, 90)
    if color is not None:
        color = checked_shape("color", color, np.float32, points.shape)
    valid = np.isfinite(points).all(axis=2)
    index = np.full(valid.shape, -1)
    index[valid] = np.arange(valid.sum())
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    vertices = points[valid]
    refuse_huge("points", vertices)
    faces = _grid_faces(a, b, c, d, vertices)
    if len(faces) == 0:
        raise InputError("points have no three neighbours in the range image: no triangle can be made")
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sight = stood - corners.mean(axis=1)
    facing = np.einsum("ij,ij->i", normal, sight)
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(sight, axis=1)
    seen = np.abs(facing) > np.cos(np.radians(steepest)) * size
    if not seen.any():
        raise InputError(
            f"no triangle of the points is less than steepest={steepest:g} degrees from the line of sight, seen from the view"
        )
    faces = faces[seen]
    if facing[seen].sum() < 0:
        faces = faces[:, ::-1]
    faces = _without_pinched(faces, len(vertices))
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    renumber = (np.cumsum(used) - 1).astype(np.int32)
    return Surface(
        vertices=vertices[used],
        faces=renumber[faces],
        color=None if color is None else color[valid][used],
    )


@checked_arguments
def surface_from_points(points: Array, direction: ArrayLike, *, color: Array | None = None, longest: float = 3.0) -> Surface:
    """Triangulate the points of one view, by Delaunay's triangulation in the plane of view.

    Parameters
    ----------
    points : (N, 3) array
        Points of a 2.5D scan, in any unit of length: along the direction of sight none lies behind another.
    direction : (3,) array
        The direction of sight, from the scanner to the object, of any length.
    color : (N, 3) array, optional
        Linear colours in [0, 1]. Default None: no colours.
    longest : float, optional
        Triangles with an edge of more than this many median edges are taken for bridges over gaps or discontinuities and
        left out. Default 3.

    Returns
    -------
    Surface
        Its vertices are the points that some triangle uses, in their order; faces look towards the scanner.

    Raises
    ------
    InputError
        For fewer than three points, points that are not finite or lie on a line, a direction of zeros, or a ``longest``
        that is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> x, y = np.meshgrid(np.arange(5.0), np.arange(4.0))
    >>> points = np.column_stack([x.ravel(), y.ravel(), 0.1 * np.sin(x.ravel())])
    >>> surface = intaglio.surface_from_points(points, direction=(0, 0, -1))
    >>> len(surface.vertices), len(surface.faces)
    (20, 24)
    >>> bool((surface.normal[:, 2] > 0.9).all())
    True
    """
    from scipy.spatial import Delaunay, QhullError

    points = checked_rows("points", points, np.float64)
    sight = checked_direction("direction", direction)
    if not longest > 0:
        raise InputError(f"longest must be a positive number of median edges, not {longest!r}")
    if color is not None:
        color = checked_rows("color", color, np.float32, len(points))
    if len(points) < 3:
        raise InputError(f"{len(points)} points make no triangle; at least 3 are needed")
    towards = -sight
    e1 = np.cross(towards, np.eye(3)[np.argmin(np.abs(towards))])
    e1 /= np.linalg.norm(e1)
    flat = (points - points.mean(axis=0)) @ np.stack([e1, np.cross(towards, e1)], axis=1)
    try:
        faces = Delaunay(flat).simplices
    except QhullError as error:
        raise InputError("the points lie on a line as seen along the view direction: no triangle can be made") from error
    a, b, c = (flat[faces[:, i]] for i in range(3))
    turned = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0] < 0
    faces[turned] = faces[turned][:, ::-1]
    corners = points[faces]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    faces = faces[lengths.max(axis=1) <= longest * np.median(lengths)]
    faces = _without_pinched(faces, len(points))
    used = np.zeros(len(points), bool)
    used[faces] = True
    renumber = (np.cumsum(used) - 1).astype(np.int32)
    return Surface(
        vertices=points[used],
        faces=renumber[faces],
        color=None if color is None else np.asarray(color, np.float32)[used],
    )


def _grid_faces(a: Array, b: Array, c: Array, d: Array, vertices: Array) -> Array:
    """Return two triangles per full cell, cut along the shorter diagonal, and one per cell that lacks a corner."""
    a, b, c, d = (x.reshape(-1) for x in (a, b, c, d))
    missing = (a < 0).astype(int) + (b < 0) + (c < 0) + (d < 0)
    full = missing == 0
    ad = np.full(len(a), np.inf)
    bc = np.full(len(a), np.inf)
    ad[full] = np.linalg.norm(vertices[a[full]] - vertices[d[full]], axis=1)
    bc[full] = np.linalg.norm(vertices[b[full]] - vertices[c[full]], axis=1)
    cut_bc, cut_ad = full & (bc <= ad), full & (bc > ad)
    one = missing == 1
    triangles = [
        np.stack([a, c, b], -1)[cut_bc | (one & (d < 0))],
        np.stack([b, c, d], -1)[cut_bc | (one & (a < 0))],
        np.stack([a, c, d], -1)[cut_ad | (one & (b < 0))],
        np.stack([a, d, b], -1)[cut_ad | (one & (c < 0))],
    ]
    return np.concatenate(triangles).astype(np.int32)


def _without_pinched(faces: Array, count: int) -> Array:
    """Drop all but the largest fan of faces at vertices where the surface would touch itself in a single point."""
    while len(faces):
        topology = Topology.of(faces, count)
        out = np.zeros(len(faces), bool)
        # A vertex with one fan has as many edges as faces, or one more on a border; further edges mean further fans.
        edges = np.diff(topology.offsets)
        at = np.diff(topology.face_offsets)
        for vertex in np.flatnonzero(edges > at + 1):
            fans = _fans(topology, faces, int(vertex))
            for fan in sorted(fans, key=len)[:-1]:
                out[fan] = True
        if not out.any():
            return faces
        faces = faces[~out]
    return faces


def _fans(topology: Topology, faces: Array, vertex: int) -> list[list[int]]:
    incident = topology.incident[topology.face_offsets[vertex] : topology.face_offsets[vertex + 1]]
    left = set(incident.tolist())
    fans = []
    while left:
        stack, fan = [left.pop()], []
        while stack:
            face = stack.pop()
            fan.append(face)
            for corner in range(3):
                if vertex in (faces[face, corner], faces[face, (corner + 1) % 3]):
                    beyond = int(topology.across[face, corner])
                    if beyond in left:
                        left.remove(beyond)
                        stack.append(beyond)
        fans.append(fan)
    return fans
