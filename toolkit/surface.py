"""Surface: a triangulated surface as smooth base plus relief, with colour and provenance."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from intaglio.errors import InputError
from intaglio.mesh_writing import write_surface

if TYPE_CHECKING:
    from intaglio.relief.base import Base

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A triangulated surface: smooth base + relief (+ colour, provenance).

    Parameters
    ----------
    vertices : (N, 3) array
        Positions in the input's own unit, kept as float64.
    faces : (F, 3) integer array
        Triangles, counter-clockwise seen from outside.
    base : (N, 3) array, optional
        Point of the smooth base below every vertex; default the vertex itself (a scan just read has no base yet).
    normal : (N, 3) array, optional
        Unit normal of the base there; default from the faces.
    color : (N, 3) array, optional
        Linear Rec.709, float32 in [0, 1].
    measured : (N,) bool array, optional
        True where the vertex was measured, False where it was filled; default all True.
    source : (N,) int32 array, optional
        The measured vertex whose relief vertex i carries: itself where measured, -1 where not yet filled.
    rotation : (N,) float32 array, optional
        By how much the source's neighbourhood was turned about the normal to match, in radians; 0 where measured.
    error : (N,) float32 array, optional
        Matching error of the accepted match: weighted mean squared distance, in squared input units; 0 where measured,
        infinite where no sample could be compared and a neighbour's relief was taken.
    model : Base, optional
        The base shape, where there is one.
    notes : tuple of str
        What was chosen on the way, for the user.

    Raises
    ------
    InputError
        For arrays of the wrong shape, coordinates that are not finite, or face indices out of range.
    """

    vertices: Array
    faces: Array
    base: Array = None  # type: ignore[assignment]
    normal: Array = None  # type: ignore[assignment]
    color: Array | None = None
    measured: Array = None  # type: ignore[assignment]
    source: Array = None  # type: ignore[assignment]
    rotation: Array | None = None
    error: Array | None = None
    model: Base | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        def put(name: str, value: Array) -> None:
            object.__setattr__(self, name, value)

        vertices = _rows(self.vertices, "vertices", np.float64)
        count = len(vertices)
        put("vertices", vertices)
        put("faces", _faces(self.faces, count))
        put("base", vertices if self.base is None else _rows(self.base, "base", np.float64, count))
        if self.normal is None:
            put("normal", vertex_normals(vertices, self.faces))
        else:
            put("normal", _rows(self.normal, "normal", np.float64, count))
        if self.color is not None:
            put("color", _rows(self.color, "color", np.float32, count))
        measured = np.ones(count, bool) if self.measured is None else np.asarray(self.measured)
        if measured.dtype.kind not in "bui":
            raise InputError(f"measured must be bool, not {measured.dtype}")
        if measured.shape != (count,):
            raise InputError(f"measured must have shape ({count},), not {measured.shape}")
        put("measured", measured.astype(bool))
        if self.source is None:
            put("source", np.where(self.measured, np.arange(count), -1).astype(np.int32))
        for name, dtype in (("source", np.int32), ("rotation", np.float32), ("error", np.float32)):
            value = getattr(self, name)
            if value is None:
                continue
            value = _numeric(value, name, dtype)
            if value.shape != (count,):
                raise InputError(f"{name} must have shape ({count},), not {value.shape}")
            put(name, value)
        if count and not (self.source.min() >= -1 and self.source.max() < count):
            raise InputError(f"source must hold vertex numbers from 0 to {count - 1}, or -1; it holds {self.source.max()}")

    @property
    def displacement(self) -> Array:
        """Vertices minus base, (N, 3): the papers' vector D."""
        return self.vertices - self.base

    @property
    def relief(self) -> Array:
        """Signed displacement along the base normal, (N,), in the input's unit."""
        return np.einsum("ij,ij->i", self.displacement, self.normal)

    def write(self, path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
        """Write the surface; provenance is kept in PLY. See `intaglio.write_surface`."""
        write_surface(self, path, overwrite=overwrite)

    def part(self, keep: Array) -> Surface:
        """Return the part whose vertices ``keep`` (N,) bool selects, with the faces all of whose corners are kept.

        Vertices are renumbered; a source outside the part becomes -1.
        """
        keep = np.asarray(keep)
        if keep.shape != (len(self.vertices),) or keep.dtype != bool:
            raise InputError(f"keep must be a bool array of shape ({len(self.vertices)},), not {keep.dtype} {keep.shape}")
        renumber = np.where(keep, np.cumsum(keep) - 1, -1).astype(np.int32)
        source = self.source[keep]
        return Surface(
            vertices=self.vertices[keep],
            faces=renumber[self.faces[keep[self.faces].all(axis=1)]],
            base=self.base[keep],
            normal=self.normal[keep],
            color=None if self.color is None else self.color[keep],
            measured=self.measured[keep],
            source=np.where(source >= 0, renumber[source], -1),
            rotation=None if self.rotation is None else self.rotation[keep],
            error=None if self.error is None else self.error[keep],
            model=self.model,
            notes=self.notes,
        )


def vertex_normals(vertices: Array, faces: Array) -> Array:
    """Return area-weighted unit normals (N, 3); (0, 0, 1) where no face of any area meets."""
    faces = np.asarray(faces)
    normal = np.zeros((len(vertices), 3))
    corners = vertices[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for axis in range(3):
        normal[:, axis] = np.bincount(faces.reshape(-1), np.repeat(area[:, axis], 3), len(vertices))
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.where(length > 0, normal / np.maximum(length, 1e-300), (0.0, 0.0, 1.0))


def surface_from_range_image(
    points: Array, *, view: ArrayLike = (0.0, 0.0, 0.0), color: Array | None = None, steepest: float = 80.0
) -> Surface:
    """Triangulate an organised range image in its own grid; depth discontinuities are not bridged.

    Parameters
    ----------
    points : (H, W, 3) array
        Positions; NaN where nothing was seen.
    view : (3,) array
        Where the scanner stood, so that faces look towards it. Infinite components mean a direction: use a far point.
    color : (H, W, 3) array, optional
        Linear colours.
    steepest : float
        Degrees: a triangle whose normal is further than this from the line of sight bridges a discontinuity.

    Raises
    ------
    InputError
        If points have the wrong shape or no triangle can be made.
    """
    points = _numeric(points, "points", np.float64)
    stood = _numeric(view, "view", np.float64)
    if stood.shape != (3,):
        raise InputError(f"view must be three numbers, not {view!r}")
    if points.ndim != 3 or points.shape[2] != 3:
        raise InputError(f"a range image must have shape (H, W, 3), not {points.shape}")
    valid = np.isfinite(points).all(axis=2)
    index = np.full(valid.shape, -1)
    index[valid] = np.arange(valid.sum())
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    vertices = points[valid]
    faces = _grid_faces(a, b, c, d, vertices)
    if len(faces) == 0:
        raise InputError("the range image has no three neighbouring points: no triangle can be made")
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sight = stood - corners.mean(axis=1)
    facing = np.einsum("ij,ij->i", normal, sight)
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(sight, axis=1)
    seen = np.abs(facing) > np.cos(np.radians(steepest)) * size
    if not seen.any():
        raise InputError(f"no triangle of the range image is less than {steepest} degrees from the line of sight")
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
        color=None if color is None else np.asarray(color, np.float32)[valid][used],
    )


def surface_from_points(points: Array, direction: ArrayLike, *, color: Array | None = None, longest: float = 3.0) -> Surface:
    """Triangulate a point cloud seen along a view direction, by Delaunay in the view plane.

    Parameters
    ----------
    points : (N, 3) array
        One view's points (2.5D: no two behind one another).
    direction : (3,) array
        The direction of sight, from the scanner to the object.
    color : (N, 3) array, optional
        Linear colours.
    longest : float
        An edge longer than this many times the median edge bridges a gap or discontinuity; its triangles are dropped.

    Raises
    ------
    InputError
        For fewer than three points, points on a line, or a zero direction.
    """
    from scipy.spatial import Delaunay, QhullError

    points = _rows(points, "points", np.float64)
    sight = _numeric(direction, "direction", np.float64).reshape(-1)
    if sight.shape != (3,) or not np.isfinite(sight).all() or not sight.any():
        raise InputError(f"direction must be three finite numbers, not all zero; it is {direction!r}")
    if not longest > 0:
        raise InputError(f"longest must be a positive number of median edges, not {longest!r}")
    if len(points) < 3:
        raise InputError(f"{len(points)} points make no triangle; at least 3 are needed")
    towards = -sight / np.linalg.norm(sight)
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
    """Two triangles per full cell, cut along the shorter diagonal; one where a corner is missing."""
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
    """Drop the smaller fans of faces that meet others only in a vertex, where the surface would touch itself in a point."""
    from intaglio.topology import Topology

    while len(faces):
        topology = Topology.of(faces, count)
        out = np.zeros(len(faces), bool)
        # A vertex on one fan has one more edge than faces on a border, as many inside; more edges mean more fans.
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


def _fans(topology: object, faces: Array, vertex: int) -> list[list[int]]:
    incident = topology.incident[topology.face_offsets[vertex] : topology.face_offsets[vertex + 1]]  # type: ignore[attr-defined]
    left = set(incident.tolist())
    fans = []
    while left:
        stack, fan = [left.pop()], []
        while stack:
            face = stack.pop()
            fan.append(face)
            for corner in range(3):
                if vertex in (faces[face, corner], faces[face, (corner + 1) % 3]):
                    beyond = int(topology.across[face, corner])  # type: ignore[attr-defined]
                    if beyond in left:
                        left.remove(beyond)
                        stack.append(beyond)
        fans.append(fan)
    return fans


def _numeric(value: ArrayLike, name: str, dtype: type) -> Array:
    try:
        if np.iscomplexobj(value):
            raise InputError(f"{name} must be real numbers")
        return np.ascontiguousarray(value, dtype)
    except (TypeError, ValueError) as problem:
        if isinstance(problem, InputError):
            raise
        raise InputError(f"{name} is no array of numbers ({problem})") from problem


def _rows(value: Array, name: str, dtype: type, count: int | None = None) -> Array:
    array = _numeric(value, name, dtype)
    if array.ndim != 2 or array.shape[1] != 3 or (count is not None and len(array) != count):
        raise InputError(f"{name} must have shape ({'N' if count is None else count}, 3), not {array.shape}")
    finite = np.isfinite(array).all(axis=1)
    if not finite.all():
        first = int(np.flatnonzero(~finite)[0])
        raise InputError(f"{name}: {(~finite).sum()} rows are not finite, the first is row {first}: {array[first]}")
    return array


def _faces(value: Array, count: int) -> Array:
    try:
        array = np.asarray(value)
    except ValueError as problem:
        raise InputError(f"faces are no (F, 3) array of integers ({problem})") from problem
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"faces must have shape (F, 3), not {array.shape}; polygons with more corners must be triangulated")
    if array.size and not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"faces must be integers, not {array.dtype}")
    if array.size and (array.min() < 0 or array.max() >= count):
        row = int(np.flatnonzero(((array < 0) | (array >= count)).any(axis=1))[0])
        raise InputError(f"face {row} names vertices {array[row].tolist()}, but there are only {count} (0 to {count - 1})")
    return np.ascontiguousarray(array, np.int32)
