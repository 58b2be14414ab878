"""Surface: a triangulated surface as smooth base plus relief, with colour and provenance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_numeric, checked_rows
from intaglio.errors import InputError
from intaglio.mesh.writing import write_surface

if TYPE_CHECKING:
    from intaglio.mesh.base import Base


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

        vertices = checked_rows("vertices", self.vertices, np.float64)
        count = len(vertices)
        put("vertices", vertices)
        put("faces", _faces(self.faces, count))
        put("base", vertices if self.base is None else checked_rows("base", self.base, np.float64, count))
        if self.normal is None:
            put("normal", vertex_normals(vertices, self.faces))
        else:
            put("normal", checked_rows("normal", self.normal, np.float64, count))
        if self.color is not None:
            put("color", checked_rows("color", self.color, np.float32, count))
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
            value = checked_numeric(name, value, dtype)
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

    def write(self, path: PathLike, *, overwrite: bool = True) -> None:
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
