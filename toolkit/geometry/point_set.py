"""Points with normals, and samples of geometry texture made of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_finite, checked_vectors
from intaglio.errors import InputError


@dataclass(frozen=True)
class PointSet:
    """Points of a surface, with the side they face.

    Attributes
    ----------
    points : (N, 3) float64 array
        In the input's unit.
    normals : (N, 3) float64 array
        Unit vectors that point out of the solid.
    color : (N, 3) float32 array, optional
        Linear Rec.709.
    source : (N,) int32 array, optional
        The point of the swatch that each was copied from; None for a swatch.
    moved : (N,) float32 array, optional
        How far warp and blending moved it from where plain copying would have put it, and spreading after them.
    patch : (N,) int32 array, optional
        The patch that laid it, in scan-line order.
    notes : tuple of str
        What was decided or repaired on the way.
    """

    points: Array
    normals: Array
    color: Array | None = None
    source: Array | None = None
    moved: Array | None = None
    patch: Array | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        points, normals = checked_vectors("points", self.points), checked_vectors("normals", self.normals)
        if normals.shape != points.shape:
            raise InputError(f"normals must be {points.shape} as points are, not {np.shape(self.normals)}")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "normals", normals)
        for name, kind, width in (
            ("color", np.float32, (3,)),
            ("source", np.int32, ()),
            ("moved", np.float32, ()),
            ("patch", np.int32, ()),
        ):
            value = getattr(self, name)
            if value is not None:
                value = np.ascontiguousarray(checked_finite(name, value), kind)
                if value.shape != (len(points), *width):
                    raise InputError(f"{name} must have the shape {(len(points), *width)}, not {value.shape}")
                object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.points)

    def part(self, chosen: Array) -> PointSet:
        """Return the points that ``chosen`` (a mask or indices) names."""
        return replace(
            self,
            **{
                name: value[chosen]
                for name in ("points", "normals", "color", "source", "moved", "patch")
                if (value := getattr(self, name)) is not None
            },
        )

    def write(self, path: PathLike) -> None:
        """Write PLY, XYZ or OBJ points; see `write_points`."""
        from intaglio.geometry.writing import write_points

        write_points(self, path)


def plane_axes(axis: int) -> tuple[int, int]:
    """Return the two axes of the reference plane, so that with the height axis they are right-handed."""
    return (axis + 1) % 3, (axis + 2) % 3


def axis_number(axis: int | str) -> int:
    """Return 0, 1 or 2 for an axis or its name, or raise `InputError`."""
    if isinstance(axis, str) and axis in ("x", "y", "z"):
        return "xyz".index(axis)
    if isinstance(axis, int | np.integer) and not isinstance(axis, bool) and 0 <= axis <= 2:
        return int(axis)
    raise InputError(f"axis must be x, y or z (0, 1, 2), not {axis!r}")


def checked_points(points: object) -> None:
    """Raise `InputError` for what is no PointSet with normals."""
    if not isinstance(points, PointSet):
        raise InputError(f"points must be a PointSet, not {type(points).__name__}")
    if len(points) and np.linalg.norm(points.normals, axis=1).min() == 0:
        raise InputError("points have normals of length 0")


@dataclass(frozen=True)
class GeometryTexture:
    """A swatch: points with normals over a rectangle of a reference plane (Duranleau & Poulin, section 3).

    Attributes
    ----------
    points : PointSet
        All of the geometry, also what reaches past the bounds.
    bounds : (2, 3) float64 array
        Least and greatest corner of the box that is the texture.
    axis : int
        The height axis, 0, 1 or 2; the plane is spanned by the two others.
    spacing : float
        Distance of samples: 1 over the root of their number on a unit of area.
    notes : tuple of str
        What was found, estimated or repaired on reading.
    """

    points: PointSet
    bounds: Array
    axis: int
    spacing: float
    notes: tuple[str, ...] = ()

    @property
    def plane_axes(self) -> tuple[int, int]:
        """The two axes of the reference plane, so that with the height axis they are right-handed."""
        return plane_axes(self.axis)

    @property
    def height(self) -> float:
        """Extent of the bounds along the height axis."""
        return float(self.bounds[1, self.axis] - self.bounds[0, self.axis])

    @property
    def base(self) -> Array:
        """(2,) sides of the bounds in the reference plane."""
        size = self.bounds[1] - self.bounds[0]
        return size[list(self.plane_axes)]
