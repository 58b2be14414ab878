"""The smooth base shapes that relief stands on: plane, circular cylinder, sphere.

Relief is the signed distance from the base along its normal. Normals of cylinder and sphere point away from the axis and
centre; a plane's normal is as given. A surface seen from inside (a bowl) has negative orientation: see ``inward``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping


def unit(vectors: Array) -> Array:
    """Return ``vectors`` (..., 3) scaled to length 1; a zero vector stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def perpendicular(normal: Array) -> Array:
    """Return unit vectors (..., 3) perpendicular to ``normal``, from its smallest component (paper 000, section 3)."""
    normal = np.asarray(normal, np.float64)
    smallest = np.argmin(np.abs(normal), axis=-1)
    x, y, z = normal[..., 0], normal[..., 1], normal[..., 2]
    zero = np.zeros_like(x)
    choices = np.stack([np.stack([zero, -z, y], -1), np.stack([-z, zero, x], -1), np.stack([-y, x, zero], -1)], axis=-2)
    return unit(np.take_along_axis(choices, smallest[..., None, None], axis=-2)[..., 0, :])


@dataclass(frozen=True)
class BaseFit:
    """How a base was fitted.

    Attributes
    ----------
    rms : float
        Root mean square orthogonal distance of all points from the base, in the input's unit.
    robust_scale : float
        1.4826 times the median absolute distance from the median, in the input's unit.
    candidates : mapping of str to (float, float)
        For every kind that was tried: rms residual and score (lower is better).
    ambiguous : bool
        True where another kind explains the points about as well.
    poor : bool
        True where the residual is too large a share of the scan's size to be relief: the shape is another one.
    note : str
        One sentence for the user: what was chosen and why, or between what the data does not decide.
    """

    rms: float
    robust_scale: float
    candidates: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    ambiguous: bool = False
    poor: bool = False
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Base(ABC):
    """A smooth base shape; use `Plane`, `Cylinder` or `Sphere`.

    Attributes
    ----------
    inward : bool
        True where the outside of the scanned surface looks towards the axis or centre (the inside of a bowl): normals
        and signed distances are then turned round.
    fit : BaseFit or None
        How it was fitted; None for a base that was given.
    """

    kind: ClassVar[str] = ""
    parameter_count: ClassVar[int] = 0
    inward: bool = False
    fit: BaseFit | None = None

    @abstractmethod
    def foot(self, points: Array) -> tuple[Array, Array]:
        """Return the nearest points on the base and the base's unit normals there.

        Parameters
        ----------
        points : (N, 3) array
            In the input's unit.

        Returns
        -------
        foot : (N, 3) float64 array
        normal : (N, 3) float64 array
        """

    def distance(self, points: Array) -> Array:
        """Return signed distances (N,) along the base normal, in the input's unit."""
        foot, normal = self.foot(points)
        return np.einsum("ij,ij->i", np.asarray(points, np.float64) - foot, normal)

    def chart(self, points: Array) -> Array:
        """Return coordinates (N, 2) of the feet on the unrolled base, in the input's unit."""
        raise InputError(f"a {self.kind} can't be unrolled without distortion; it has no chart")

    @property
    def orientation(self) -> float:
        """1 for normals away from axis or centre, -1 for ``inward``."""
        return -1.0 if self.inward else 1.0

    @property
    @abstractmethod
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """Kind (0 plane, 1 cylinder, 2 sphere), origin, axis, radius, as the kernels' exponential map takes them."""

    @property
    @abstractmethod
    def parameters(self) -> dict[str, object]:
        """The model's parameters by name; lengths are in the input's unit."""

    def describe(self, unit_name: str = "units") -> str:
        """Return one line with the parameters and, where it was fitted, the residual."""
        text = f"{self.kind}: {', '.join(f'{k} {_format(v)}' for k, v in self.parameters.items())} ({unit_name})"
        if self.inward:
            text += ", seen from inside"
        if self.fit is not None:
            text += f"; rms residual {self.fit.rms:.6g} {unit_name}"
        return text


@dataclass(frozen=True, kw_only=True)
class Plane(Base):
    """A plane through ``point`` with unit ``normal``; ``direction`` is the chart's first axis (made perpendicular)."""

    kind: ClassVar[str] = "plane"
    parameter_count: ClassVar[int] = 3
    point: Array
    normal: Array
    direction: Array = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        normal = _vector(self.normal, "normal", unit_length=True)
        object.__setattr__(self, "point", _vector(self.point, "point"))
        object.__setattr__(self, "normal", normal)
        along = perpendicular(normal) if self.direction is None else _vector(self.direction, "direction")
        along = along - (along @ normal) * normal
        object.__setattr__(self, "direction", _vector(along, "direction", unit_length=True))

    def foot(self, points: Array) -> tuple[Array, Array]:
        """See `Base.foot`."""
        points = np.asarray(points, np.float64)
        normal = self.normal * self.orientation
        height = (points - self.point) @ normal
        return points - height[:, None] * normal, np.tile(normal, (len(points), 1))

    def chart(self, points: Array) -> Array:
        """See `Base.chart`."""
        axes = np.stack([self.direction, np.cross(self.normal * self.orientation, self.direction)], axis=1)
        return (np.asarray(points, np.float64) - self.point) @ axes

    def from_chart(self, coordinates: Array) -> Array:
        """Return points (N, 3) of the plane at chart ``coordinates`` (N, 2)."""
        axes = np.stack([self.direction, np.cross(self.normal * self.orientation, self.direction)], axis=0)
        return self.point + np.asarray(coordinates, np.float64) @ axes

    @property
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """See `Base.kernel_parameters`."""
        return 0, self.point, self.normal * self.orientation, 0.0

    @property
    def parameters(self) -> dict[str, object]:
        """See `Base.parameters`."""
        return {"point": self.point, "normal": self.normal * self.orientation}


@dataclass(frozen=True, kw_only=True)
class Cylinder(Base):
    """A circular cylinder about the line through ``point`` along unit ``axis``, with ``radius``."""

    kind: ClassVar[str] = "cylinder"
    parameter_count: ClassVar[int] = 5
    point: Array
    axis: Array
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", _vector(self.point, "point"))
        object.__setattr__(self, "axis", _vector(self.axis, "axis", unit_length=True))
        object.__setattr__(self, "radius", _radius(self.radius))

    def foot(self, points: Array) -> tuple[Array, Array]:
        """See `Base.foot`."""
        relative = np.asarray(points, np.float64) - self.point
        along = relative @ self.axis
        outward = unit(relative - along[:, None] * self.axis)
        # A point on the axis has every direction; one is chosen so that no NaN goes out.
        outward[~outward.any(axis=1)] = perpendicular(self.axis)
        foot = self.point + along[:, None] * self.axis + self.radius * outward
        return foot, outward * self.orientation

    def chart(self, points: Array) -> Array:
        """See `Base.chart`."""
        relative = np.asarray(points, np.float64) - self.point
        e1 = perpendicular(self.axis)
        e2 = np.cross(self.axis, e1)
        angle = np.arctan2(relative @ e2, relative @ e1)
        return np.stack([self.radius * angle, relative @ self.axis], axis=1)

    def from_chart(self, coordinates: Array) -> Array:
        """Return points (N, 3) of the cylinder at chart ``coordinates`` (N, 2): arc length and height."""
        coordinates = np.asarray(coordinates, np.float64)
        e1 = perpendicular(self.axis)
        e2 = np.cross(self.axis, e1)
        angle = coordinates[:, 0] / self.radius
        ring = np.cos(angle)[:, None] * e1 + np.sin(angle)[:, None] * e2
        return self.point + self.radius * ring + coordinates[:, 1:] * self.axis

    @property
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """See `Base.kernel_parameters`."""
        return 1, self.point, self.axis, self.radius

    @property
    def parameters(self) -> dict[str, object]:
        """See `Base.parameters`."""
        return {"radius": self.radius, "point on axis": self.point, "axis": self.axis}


@dataclass(frozen=True, kw_only=True)
class Sphere(Base):
    """A sphere about ``center`` with ``radius``."""

    kind: ClassVar[str] = "sphere"
    parameter_count: ClassVar[int] = 4
    center: Array
    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "center", _vector(self.center, "center"))
        object.__setattr__(self, "radius", _radius(self.radius))

    def foot(self, points: Array) -> tuple[Array, Array]:
        """See `Base.foot`."""
        outward = unit(np.asarray(points, np.float64) - self.center)
        outward[~outward.any(axis=1)] = (0.0, 0.0, 1.0)
        return self.center + self.radius * outward, outward * self.orientation

    @property
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """See `Base.kernel_parameters`."""
        return 2, self.center, np.array([0.0, 0.0, 1.0]), self.radius

    @property
    def parameters(self) -> dict[str, object]:
        """See `Base.parameters`."""
        return {"radius": self.radius, "center": self.center}


def face_the_scan(base: Base, points: Array, faces: Array) -> Base:
    """Return ``base`` with normals on the side that the triangles ``faces`` (F, 3) of ``points`` (N, 3) show."""
    if len(faces) == 0:
        return base
    corners = points[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = base.foot(corners.mean(axis=1))[1]
    agrees = np.einsum("ij,ij->", area, normal) >= 0
    return base if agrees else replace(base, inward=not base.inward)


def _vector(value: Array, name: str, unit_length: bool = False) -> Array:
    try:
        vector = np.asarray(value, np.float64).reshape(-1)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{name} must be three finite numbers, not {value!r}")
    if unit_length:
        length = np.linalg.norm(vector)
        if length == 0:
            raise InputError(f"{name} must not be the zero vector")
        vector = vector / length
    return vector


def _radius(value: float) -> float:
    try:
        radius = float(value)
    except (TypeError, ValueError):
        radius = float("nan")
    if not (np.isfinite(radius) and radius > 0):
        raise InputError(f"radius must be a positive length, not {value!r}")
    return radius


def _format(value: object) -> str:
    if isinstance(value, np.ndarray):
        return "(" + ", ".join(f"{v:.6g}" for v in value) + ")"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
