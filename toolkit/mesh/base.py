"""The smooth base shapes that relief stands on: plane, circular cylinder, sphere.

Relief is the signed distance from the base along its normal. Normals of cylinder and sphere point away from the axis or the
centre, a plane's normal is as given; ``inward`` turns them round for a surface that is seen from inside, such as a bowl.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import (
    LARGEST,
    check_fields,
    checked_arguments,
    checked_direction,
    checked_shape,
    checked_vector,
    checked_vectors,
    shown,
)
from intaglio.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping


def unit(vectors: Array) -> Array:
    """Return ``vectors`` (..., 3) scaled to length 1; a zero vector stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def perpendicular(normal: Array) -> Array:
    """Return unit vectors (..., 3) perpendicular to ``normal``.

    The smallest component of the normal is replaced by zero, and the other two change places, one of them negated: Breckon &
    Fisher, "Non-parametric 3D Surface Completion", 3DIM 2005, section 3.
    """
    normal = np.asarray(normal, np.float64)
    smallest = np.argmin(np.abs(normal), axis=-1)
    x, y, z = normal[..., 0], normal[..., 1], normal[..., 2]
    zero = np.zeros_like(x)
    choices = np.stack([np.stack([zero, -z, y], -1), np.stack([-z, zero, x], -1), np.stack([-y, x, zero], -1)], axis=-2)
    return unit(np.take_along_axis(choices, smallest[..., None, None], axis=-2)[..., 0, :])


def tangents(normal: Array) -> tuple[Array, Array]:
    """Return unit vectors u and v = n x u (N, 3) that normals (N, 3) alone decide."""
    u = perpendicular(normal)
    return u, np.cross(normal, u)


@dataclass(frozen=True)
class BaseFit:
    """How well a base fits the points, and how it compares with the other kinds.

    Attributes
    ----------
    rms : float
        Root mean square orthogonal distance of all points from the base, in the input's unit.
    robust_scale : float
        1.4826 times the median absolute deviation of the signed distances from their median, in the input's unit.
    candidates : mapping of str to (float, float)
        Root mean square distance and score of every kind that was tried; the lowest score is best.
    ambiguous : bool
        True if another kind explains the points about as well.
    poor : bool
        True if the distances are too large a share of the scan's size to be relief: the shape is of another kind.
    note : str
        One sentence for the user: what was chosen and why, or which kinds the data can't tell apart.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> rng = np.random.default_rng(0)
    >>> points = np.column_stack([rng.uniform(-1, 1, (200, 2)), 0.01 * rng.standard_normal(200)])
    >>> fit = intaglio.fit_base(points, kinds="plane").fit
    >>> round(fit.rms, 3), fit.ambiguous, fit.poor
    (0.01, False, False)
    """

    rms: float
    robust_scale: float
    candidates: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    ambiguous: bool = False
    poor: bool = False
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Base(ABC):
    """Smooth base shape that relief stands on: what `Plane`, `Cylinder`, `Sphere` and `SmoothBase` have in common.

    Relief is the signed distance of the surface from its base along the base's normal.

    Parameters
    ----------
    inward : bool, optional
        Turn the normals, and with them the signs of distances, round. Default False: normals of cylinders and spheres point
        away from the axis or centre. True is right for a surface seen from inside, such as a bowl.
    fit : BaseFit or None, optional
        How well the base fits the points; set by `fit_base`. Default None: the base was given, not fitted.

    See Also
    --------
    intaglio.fit_base : Fit the kind that explains points best.

    Notes
    -----
    The class is abstract: make one of its subclasses.

    References
    ----------
    Breckon & Fisher, "Three-Dimensional Surface Relief Completion via Nonparametric Techniques", IEEE TPAMI 30(12), 2008,
    section 2.

    Examples
    --------
    >>> import intaglio
    >>> ball = intaglio.Sphere(center=(0, 0, 0), radius=2.0)
    >>> isinstance(ball, intaglio.Base)
    True
    >>> ball.distance([[0, 0, 2.5], [0, 1, 0]])
    array([ 0.5, -1. ])
    >>> bowl = intaglio.Sphere(center=(0, 0, 0), radius=2.0, inward=True)
    >>> bowl.distance([[0, 0, 2.5], [0, 1, 0]])
    array([-0.5,  1. ])
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
            Positions in the base's unit of length.

        Returns
        -------
        foot : (N, 3) float64 array
            The nearest points on the base.
        normal : (N, 3) float64 array
            Unit normals at the feet, turned round if the base is ``inward``.

        Examples
        --------
        >>> import intaglio
        >>> ground = intaglio.Plane(point=(0, 0, 0), normal=(0, 0, 1))
        >>> foot, normal = ground.foot([[1.0, 2.0, 3.0]])
        >>> print(foot, normal)
        [[1. 2. 0.]] [[0. 0. 1.]]
        """

    @checked_arguments
    def distance(self, points: Array) -> Array:
        """Return the signed distances of points from the base along its normal.

        Parameters
        ----------
        points : (N, 3) array
            Positions in the base's unit of length.

        Returns
        -------
        (N,) float64 array
            Distances in the base's unit of length, positive on the side that the normal points to.

        Examples
        --------
        >>> import intaglio
        >>> ground = intaglio.Plane(point=(0, 0, 1), normal=(0, 0, 1))
        >>> ground.distance([[5.0, 5.0, 1.5], [0.0, 0.0, 0.0]])
        array([ 0.5, -1. ])
        """
        foot, normal = self.foot(points)
        return np.einsum("ij,ij->i", checked_vectors("points", points) - foot, normal)

    @checked_arguments
    def chart(self, points: Array) -> Array:
        """Return the coordinates of the feet of points on the unrolled base.

        Planes and cylinders can be unrolled without distortion; other bases have no chart.

        Parameters
        ----------
        points : (N, 3) array
            Positions in the base's unit of length.

        Returns
        -------
        (N, 2) float64 array
            Coordinates on the unrolled base, in the base's unit of length.

        Raises
        ------
        InputError
            If the base is neither a plane nor a cylinder.

        Examples
        --------
        >>> import intaglio
        >>> intaglio.Sphere(center=(0, 0, 0), radius=1).chart([[0, 0, 1]])
        Traceback (most recent call last):
            ...
        intaglio.errors.InputError: a sphere can't be unrolled without distortion; it has no chart
        """
        raise InputError(f"a {self.kind} can't be unrolled without distortion; it has no chart")

    @property
    def orientation(self) -> float:
        """Factor of the normals: 1, or -1 if the base is ``inward``.

        Returns
        -------
        float
            1.0 or -1.0.

        Examples
        --------
        >>> import intaglio
        >>> intaglio.Sphere(center=(0, 0, 0), radius=1, inward=True).orientation
        -1.0
        """
        return -1.0 if self.inward else 1.0

    @property
    @abstractmethod
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """Parameters of the base in the form that the kernels' exponential map takes.

        Returns
        -------
        kind : int
            0 for a plane, 1 for a cylinder, 2 for a sphere, 3 for a smoothed surface.
        origin : (3,) float64 array
            A point of the plane or on the cylinder's axis, or the sphere's centre.
        axis : (3,) float64 array
            The plane's unit normal or the cylinder's unit axis; (0, 0, 1) for the others.
        radius : float
            Radius of cylinder or sphere; 0 for the others.

        Examples
        --------
        >>> import intaglio
        >>> kind, origin, axis, radius = intaglio.Sphere(center=(1, 2, 3), radius=4).kernel_parameters
        >>> kind, origin, radius
        (2, array([1., 2., 3.]), 4.0)
        """

    @property
    @abstractmethod
    def parameters(self) -> dict[str, object]:
        """Parameters of the base by name.

        Returns
        -------
        dict of str to object
            Lengths are in the base's unit of length.

        Examples
        --------
        >>> import intaglio
        >>> intaglio.Sphere(center=(1, 2, 3), radius=4).parameters
        {'radius': 4.0, 'center': array([1., 2., 3.])}
        """

    @checked_arguments
    def describe(self, unit_name: str = "units") -> str:
        """Return one line of text with the parameters and, if the base was fitted, the residual.

        Parameters
        ----------
        unit_name : str, optional
            What to call the unit of length. Default "units", since a scan does not say what its unit is.

        Returns
        -------
        str
            One line of text.

        Examples
        --------
        >>> import intaglio
        >>> intaglio.Sphere(center=(1, 2, 3), radius=4).describe("mm")
        'sphere: radius 4, center (1, 2, 3) (mm)'
        """
        text = f"{self.kind}: {', '.join(f'{k} {_format(v)}' for k, v in self.parameters.items())} ({unit_name})"
        if self.inward:
            text += ", seen from inside"
        if self.fit is not None:
            text += f"; rms residual {self.fit.rms:.6g} {unit_name}"
        return text


@dataclass(frozen=True, kw_only=True)
class Plane(Base):
    """Plane through a point, with a normal.

    Parameters
    ----------
    inward : bool, optional
        Turn the normal round. Default False.
    fit : BaseFit or None, optional
        How well the plane fits the points; set by `fit_base`. Default None: it was given.
    point : (3,) array
        A point of the plane.
    normal : (3,) array
        Normal of any length but zero; made unit.
    direction : (3,) array, optional
        First axis of the chart, made perpendicular to the normal and unit. Default: the perpendicular that follows from the
        normal's smallest component.

    Raises
    ------
    InputError
        If point, normal or direction are not three finite numbers, the normal is zero, or the direction has no part
        perpendicular to it.

    Examples
    --------
    >>> import intaglio
    >>> ground = intaglio.Plane(point=(0, 0, 2), normal=(0, 0, 5))
    >>> ground.normal
    array([0., 0., 1.])
    >>> ground.distance([[1.0, 1.0, 3.0]])
    array([1.])
    """

    kind: ClassVar[str] = "plane"
    parameter_count: ClassVar[int] = 3
    point: Array
    normal: Array
    direction: Array = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        check_fields(self)
        normal = checked_direction("normal", self.normal)
        object.__setattr__(self, "point", checked_vector("point", self.point))
        object.__setattr__(self, "normal", normal)
        along = perpendicular(normal) if self.direction is None else checked_vector("direction", self.direction)
        along = along - (along @ normal) * normal
        object.__setattr__(self, "direction", checked_direction("direction", along))

    @checked_arguments
    def foot(self, points: Array) -> tuple[Array, Array]:
        """Return the nearest points on the plane and its unit normal there.

        Parameters
        ----------
        points : (N, 3) array
            Positions in the plane's unit of length.

        Returns
        -------
        foot : (N, 3) float64 array
            The nearest points on the plane.
        normal : (N, 3) float64 array
            The plane's unit normal, once for every point.

        Examples
        --------
        >>> import intaglio
        >>> foot, normal = intaglio.Plane(point=(0, 0, 2), normal=(0, 0, 1)).foot([[5.0, 6.0, 7.0]])
        >>> print(foot, normal)
        [[5. 6. 2.]] [[0. 0. 1.]]
        """
        points = checked_vectors("points", points)
        normal = self.normal * self.orientation
        height = (points - self.point) @ normal
        return points - height[:, None] * normal, np.tile(normal, (len(points), 1))

    @checked_arguments
    def chart(self, points: Array) -> Array:
        """Return the coordinates of the feet of points in the plane.

        Parameters
        ----------
        points : (N, 3) array
            Positions in the plane's unit of length.

        Returns
        -------
        (N, 2) float64 array
            Lengths from ``point`` along ``direction`` and along the axis that, seen against the normal, is a quarter turn
            to the left of it.

        Examples
        --------
        >>> import intaglio
        >>> ground = intaglio.Plane(point=(1, 0, 0), normal=(0, 0, 1), direction=(1, 0, 0))
        >>> ground.chart([[3.0, 4.0, 9.0]])
        array([[2., 4.]])
        """
        axes = np.stack([self.direction, np.cross(self.normal * self.orientation, self.direction)], axis=1)
        return (checked_vectors("points", points) - self.point) @ axes

    @checked_arguments
    def from_chart(self, coordinates: Array) -> Array:
        """Return the points of the plane at coordinates of its chart.

        Parameters
        ----------
        coordinates : (N, 2) array
            What `chart` returns.

        Returns
        -------
        (N, 3) float64 array
            Points on the plane.

        Examples
        --------
        >>> import intaglio
        >>> ground = intaglio.Plane(point=(1, 0, 0), normal=(0, 0, 1), direction=(1, 0, 0))
        >>> ground.from_chart([[2.0, 4.0]])
        array([[3., 4., 0.]])
        """
        axes = np.stack([self.direction, np.cross(self.normal * self.orientation, self.direction)], axis=0)
        return self.point + checked_shape("coordinates", coordinates, np.float64, (None, 2), finite=True) @ axes

    @property
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """Parameters of the plane in the form that the kernels take; see `Base.kernel_parameters`.

        Returns
        -------
        kind : int
            0, a plane.
        origin : (3,) float64 array
            The plane's point.
        axis : (3,) float64 array
            The plane's unit normal, turned round if it is ``inward``.
        radius : float
            0, which has no meaning here.

        Examples
        --------
        >>> import intaglio
        >>> intaglio.Plane(point=(0, 0, 2), normal=(0, 0, 1)).kernel_parameters
        (0, array([0., 0., 2.]), array([0., 0., 1.]), 0.0)
        """
        return 0, self.point, self.normal * self.orientation, 0.0

    @property
    def parameters(self) -> dict[str, object]:
        """Parameters of the plane by name.

        Returns
        -------
        dict of str to object
            Arrays ``point`` and ``normal``, each (3,).

        Examples
        --------
        >>> import intaglio
        >>> intaglio.Plane(point=(0, 0, 2), normal=(0, 0, 1)).parameters
        {'point': array([0., 0., 2.]), 'normal': array([0., 0., 1.])}
        """
        return {"point": self.point, "normal": self.normal * self.orientation}


@dataclass(frozen=True, kw_only=True)
class Cylinder(Base):
    """Circular cylinder about an axis, without ends.

    Parameters
    ----------
    inward : bool, optional
        Let the normals point towards the axis, for the inside of a tube. Default False: away from it.
    fit : BaseFit or None, optional
        How well the cylinder fits the points; set by `fit_base`. Default None: it was given.
    point : (3,) array
        A point on the axis.
    axis : (3,) array
        Direction of the axis, of any length but zero; made unit.
    radius : float
        Radius, positive.

    Raises
    ------
    InputError
        If point or axis are not three finite numbers, the axis is zero, or the radius is not a positive length.

    Examples
    --------
    >>> import intaglio
    >>> tower = intaglio.Cylinder(point=(0, 0, 0), axis=(0, 0, 1), radius=2.0)
    >>> tower.distance([[3.0, 0.0, 10.0], [0.0, 1.5, -10.0]])
    array([ 1. , -0.5])
    """

    kind: ClassVar[str] = "cylinder"
    parameter_count: ClassVar[int] = 5
    point: Array
    axis: Array
    radius: float

    def __post_init__(self) -> None:
        check_fields(self)
        object.__setattr__(self, "point", checked_vector("point", self.point))
        object.__setattr__(self, "axis", checked_direction("axis", self.axis))
        object.__setattr__(self, "radius", _radius(self.radius))

    @checked_arguments
    def foot(self, points: Array) -> tuple[Array, Array]:
        """Return the nearest points on the cylinder and its unit normals there.

        Parameters
        ----------
        points : (N, 3) array
            Positions in the cylinder's unit of length. A point on the axis, to which all points of a ring are equally near,
            is given one of them.

        Returns
        -------
        foot : (N, 3) float64 array
            The nearest points on the cylinder.
        normal : (N, 3) float64 array
            Unit normals, away from the axis, or towards it if the cylinder is ``inward``.

        Examples
        --------
        >>> import intaglio
        >>> tower = intaglio.Cylinder(point=(0, 0, 0), axis=(0, 0, 1), radius=2.0)
        >>> foot, normal = tower.foot([[5.0, 0.0, 7.0]])
        >>> print(foot, normal)
        [[2. 0. 7.]] [[1. 0. 0.]]
        """
        relative = checked_vectors("points", points) - self.point
        along = relative @ self.axis
        outward = unit(relative - along[:, None] * self.axis)
        # A point on the axis has every direction; one is chosen so that no NaN goes out.
        outward[~outward.any(axis=1)] = perpendicular(self.axis)
        foot = self.point + along[:, None] * self.axis + self.radius * outward
        return foot, outward * self.orientation

    @checked_arguments
    def chart(self, points: Array) -> Array:
        """Return the coordinates of the feet of points on the unrolled cylinder.

        Parameters
        ----------
        points : (N, 3) array
            Positions in the cylinder's unit of length.

        Returns
        -------
        (N, 2) float64 array
            Arc length about the axis, from -π to π times the radius, and length along the axis from ``point``.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> tower = intaglio.Cylinder(point=(0, 0, 0), axis=(0, 0, 1), radius=2.0)
        >>> a, b = tower.chart([[3.0, 0.0, 1.0], [0.0, 3.0, 4.0]])
        >>> print((b - a) / [np.pi, 1])
        [1. 3.]
        """
        relative = checked_vectors("points", points) - self.point
        e1 = perpendicular(self.axis)
        e2 = np.cross(self.axis, e1)
        angle = np.arctan2(relative @ e2, relative @ e1)
        return np.stack([self.radius * angle, relative @ self.axis], axis=1)

    @checked_arguments
    def from_chart(self, coordinates: Array) -> Array:
        """Return the points of the cylinder at coordinates of its chart.

        Parameters
        ----------
        coordinates : (N, 2) array
            What `chart` returns: arc length about the axis and length along it.

        Returns
        -------
        (N, 3) float64 array
            Points on the cylinder.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> tower = intaglio.Cylinder(point=(0, 0, 0), axis=(0, 0, 1), radius=2.0)
        >>> point = [[0.0, -2.0, 5.0]]
        >>> np.allclose(tower.from_chart(tower.chart(point)), point)
        True
        """
        coordinates = checked_shape("coordinates", coordinates, np.float64, (None, 2), finite=True)
        e1 = perpendicular(self.axis)
        e2 = np.cross(self.axis, e1)
        angle = coordinates[:, 0] / self.radius
        ring = np.cos(angle)[:, None] * e1 + np.sin(angle)[:, None] * e2
        return self.point + self.radius * ring + coordinates[:, 1:] * self.axis

    @property
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """Parameters of the cylinder in the form that the kernels take; see `Base.kernel_parameters`.

        Returns
        -------
        kind : int
            1, a cylinder.
        origin : (3,) float64 array
            A point on the axis.
        axis : (3,) float64 array
            The axis' unit direction.
        radius : float
            The radius.

        Examples
        --------
        >>> import intaglio
        >>> intaglio.Cylinder(point=(0, 0, 0), axis=(0, 0, 1), radius=2).kernel_parameters
        (1, array([0., 0., 0.]), array([0., 0., 1.]), 2.0)
        """
        return 1, self.point, self.axis, self.radius

    @property
    def parameters(self) -> dict[str, object]:
        """Parameters of the cylinder by name.

        Returns
        -------
        dict of str to object
            The float ``radius``, and arrays ``point on axis`` and ``axis``, each (3,).

        Examples
        --------
        >>> import intaglio
        >>> tower = intaglio.Cylinder(point=(0, 0, 0), axis=(0, 0, 1), radius=2)
        >>> tower.parameters["radius"], tower.parameters["axis"]
        (2.0, array([0., 0., 1.]))
        """
        return {"radius": self.radius, "point on axis": self.point, "axis": self.axis}


@dataclass(frozen=True, kw_only=True)
class Sphere(Base):
    """Sphere about a centre.

    Parameters
    ----------
    inward : bool, optional
        Let the normals point towards the centre, for the inside of a bowl. Default False: away from it.
    fit : BaseFit or None, optional
        How well the sphere fits the points; set by `fit_base`. Default None: it was given.
    center : (3,) array
        The centre.
    radius : float
        Radius, positive.

    Raises
    ------
    InputError
        If the centre is not three finite numbers or the radius is not a positive length.

    Examples
    --------
    >>> import intaglio
    >>> ball = intaglio.Sphere(center=(0, 0, 10), radius=2.0)
    >>> ball.distance([[0.0, 0.0, 13.0], [0.0, 1.0, 10.0]])
    array([ 1., -1.])
    """

    kind: ClassVar[str] = "sphere"
    parameter_count: ClassVar[int] = 4
    center: Array
    radius: float

    def __post_init__(self) -> None:
        check_fields(self)
        object.__setattr__(self, "center", checked_vector("center", self.center))
        object.__setattr__(self, "radius", _radius(self.radius))

    @checked_arguments
    def foot(self, points: Array) -> tuple[Array, Array]:
        """Return the nearest points on the sphere and its unit normals there.

        Parameters
        ----------
        points : (N, 3) array
            Positions in the sphere's unit of length. The centre, to which all points of the sphere are equally near, is
            given the one along z.

        Returns
        -------
        foot : (N, 3) float64 array
            The nearest points on the sphere.
        normal : (N, 3) float64 array
            Unit normals, away from the centre, or towards it if the sphere is ``inward``.

        Examples
        --------
        >>> import intaglio
        >>> foot, normal = intaglio.Sphere(center=(0, 0, 0), radius=2).foot([[0.0, 5.0, 0.0]])
        >>> print(foot, normal)
        [[0. 2. 0.]] [[0. 1. 0.]]
        """
        outward = unit(checked_vectors("points", points) - self.center)
        outward[~outward.any(axis=1)] = (0.0, 0.0, 1.0)
        return self.center + self.radius * outward, outward * self.orientation

    @property
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """Parameters of the sphere in the form that the kernels take; see `Base.kernel_parameters`.

        Returns
        -------
        kind : int
            2, a sphere.
        origin : (3,) float64 array
            The centre.
        axis : (3,) float64 array
            (0, 0, 1), which has no meaning here.
        radius : float
            The radius.

        Examples
        --------
        >>> import intaglio
        >>> intaglio.Sphere(center=(1, 2, 3), radius=4).kernel_parameters
        (2, array([1., 2., 3.]), array([0., 0., 1.]), 4.0)
        """
        return 2, self.center, np.array([0.0, 0.0, 1.0]), self.radius

    @property
    def parameters(self) -> dict[str, object]:
        """Parameters of the sphere by name.

        Returns
        -------
        dict of str to object
            The float ``radius`` and the array ``center``, (3,).

        Examples
        --------
        >>> import intaglio
        >>> intaglio.Sphere(center=(1, 2, 3), radius=4).parameters
        {'radius': 4.0, 'center': array([1., 2., 3.])}
        """
        return {"radius": self.radius, "center": self.center}


def face_the_scan(base: Base, points: Array, faces: Array) -> Base:
    """Return ``base`` with its normals on the side from which the triangles ``faces`` (F, 3) of ``points`` (N, 3) are seen."""
    if len(faces) == 0:
        return base
    corners = points[faces]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = base.foot(corners.mean(axis=1))[1]
    agrees = np.einsum("ij,ij->", area, normal) >= 0
    return base if agrees else replace(base, inward=not base.inward)


def _radius(value: float) -> float:
    if not 0 < value < LARGEST:
        raise InputError(f"radius must be a positive length, not {shown(value)}")
    return float(value)


def _format(value: object) -> str:
    if isinstance(value, np.ndarray):
        return "(" + ", ".join(f"{v:.6g}" for v in value) + ")"
    return f"{value:.6g}" if isinstance(value, float) else str(value)
