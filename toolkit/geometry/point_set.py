"""Points with normals, and swatches of geometry texture made of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import check_fields, checked_arguments, checked_finite, checked_positive, checked_shape, checked_vectors
from intaglio.errors import InputError


@dataclass(frozen=True)
class PointSet:
    """Points of a surface, with normals.

    Parameters
    ----------
    points : (N, 3) array
        Positions in any unit of length, kept as float64.
    normals : (N, 3) array
        Unit vectors that point out of the solid, kept as float64.
    color : (N, 3) array or None, optional
        Linear Rec.709 colours, kept as float32. Default None: no colours.
    source : (N,) int32 array or None, optional
        The point of the swatch from which each was copied. Default None: the points are a swatch.
    moved : (N,) float32 array or None, optional
        Distance by which warping, blending and spreading moved each point from where plain copying would have put it, in the
        unit of the points. Default None.
    patch : (N,) int32 array or None, optional
        Number of the patch that each point belongs to, in scan-line order. Default None.
    notes : tuple of str, optional
        What was chosen or repaired on the way, as sentences for the user. Default none.

    Raises
    ------
    InputError
        For arrays of the wrong shape, or values that are not finite.

    See Also
    --------
    intaglio.extend_geometry : Makes one from a swatch.
    intaglio.mesh_geometry : Makes a mesh of it.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> points = intaglio.PointSet(points=np.eye(3), normals=np.eye(3))
    >>> len(points), points.source is None
    (3, True)
    """

    points: Array
    normals: Array
    color: Array | None = None
    source: Array | None = None
    moved: Array | None = None
    patch: Array | None = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self, nan=True)
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

    @checked_arguments
    def part(self, chosen: Array) -> PointSet:
        """Return some of the points, with their normals and provenance.

        Parameters
        ----------
        chosen : (N,) bool array or (K,) int array
            Which points to take: a mask, or their numbers.

        Returns
        -------
        PointSet
            The chosen points, with the same notes.

        Raises
        ------
        InputError
            If ``chosen`` is neither a mask of all points nor numbers of some.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> points = intaglio.PointSet(points=np.eye(3), normals=np.eye(3))
        >>> points.part(points.points[:, 0] > 0.5).points
        array([[1., 0., 0.]])
        """
        count = len(self)
        if chosen.dtype == bool and chosen.shape != (count,):
            raise InputError(f"chosen must be a mask of shape ({count},), not {chosen.shape}")
        if chosen.ndim != 1 or (chosen.size and chosen.dtype.kind not in "biu"):
            raise InputError(f"chosen must be a mask or numbers of points, not {chosen.dtype} {chosen.shape}")
        if chosen.dtype != bool and chosen.size and not -count <= chosen.min() <= chosen.max() < count:
            raise InputError(f"chosen must hold numbers of points from 0 to {count - 1}, not {chosen.min()} to {chosen.max()}")
        which = chosen if chosen.dtype == bool else chosen.astype(np.int64)
        return replace(
            self,
            **{
                name: value[which]
                for name in ("points", "normals", "color", "source", "moved", "patch")
                if (value := getattr(self, name)) is not None
            },
        )

    @checked_arguments
    def write(self, path: PathLike) -> None:
        """Write the points to a file; PLY keeps their provenance.

        Parameters
        ----------
        path : path
            The file; its suffix decides the type: .ply, .xyz or .obj.

        Raises
        ------
        FileError
            If the suffix is unknown, or the file can't be written.

        See Also
        --------
        intaglio.write_points : The same as a function, with what each type keeps.

        Examples
        --------
        >>> import tempfile
        >>> import numpy as np
        >>> import intaglio
        >>> points = intaglio.PointSet(points=np.eye(3), normals=np.eye(3))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     points.write(f"{folder}/points.xyz")
        ...     rows = np.loadtxt(f"{folder}/points.xyz")
        >>> rows[0]
        array([1., 0., 0., 1., 0., 0.])
        """
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


def checked_points(name: str, value: object) -> None:
    """Raise `InputError` unless ``value`` is a PointSet with normals."""
    if not isinstance(value, PointSet):
        raise InputError(f"{name} must be a PointSet, not {type(value).__name__}")
    if len(value) and np.linalg.norm(value.normals, axis=1).min() == 0:
        raise InputError(f"{name} have normals of length 0")


@dataclass(frozen=True)
class GeometryTexture:
    """Swatch of geometry texture: points with normals over a rectangle of a reference plane.

    Usually made by `geometry_from_points`, `geometry_from_mesh`, `geometry_from_height` or `read_geometry_texture`.

    Parameters
    ----------
    points : PointSet
        All of the geometry, including what reaches past the bounds.
    bounds : (2, 3) float64 array
        Least and greatest corner of the box that is the texture.
    axis : int
        The height axis, 0, 1 or 2; the reference plane is spanned by the two others.
    spacing : float
        Distance of samples: 1 over the root of their number per unit of area.
    notes : tuple of str, optional
        What was found, estimated or repaired, as sentences for the user. Default none.

    Raises
    ------
    InputError
        If a field is of another type or shape, or the bounds are not a least and a greatest corner.

    See Also
    --------
    intaglio.extend_geometry : Makes a larger piece of it.

    References
    ----------
    Duranleau & Poulin, "Patch-based Synthesis of Geometry Textures with Point-set Surfaces", section 3.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:24, :24]
    >>> swatch = intaglio.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))
    >>> swatch.axis, len(swatch.points)
    (2, 576)
    """

    points: PointSet
    bounds: Array
    axis: int
    spacing: float
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self)
        bounds = checked_shape("bounds", self.bounds, np.float64, (2, 3), finite=True)
        if not (bounds[0] <= bounds[1]).all():
            raise InputError(f"bounds must be a least and a greatest corner, not {bounds.tolist()}")
        for name, value in (
            ("bounds", bounds),
            ("axis", axis_number(self.axis)),
            ("spacing", checked_positive("spacing", self.spacing)),
        ):
            object.__setattr__(self, name, value)

    @property
    def plane_axes(self) -> tuple[int, int]:
        """The two axes of the reference plane, which form a right-handed system with the height axis.

        Returns
        -------
        (int, int)
            Numbers of the axes.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> y, x = np.mgrid[:24, :24]
        >>> swatch = intaglio.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))
        >>> swatch.plane_axes
        (0, 1)
        """
        return plane_axes(self.axis)

    @property
    def height(self) -> float:
        """Extent of the bounds along the height axis.

        Returns
        -------
        float
            Length in the unit of the points.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> y, x = np.mgrid[:24, :24]
        >>> swatch = intaglio.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))
        >>> swatch.height
        4.0
        """
        return float(self.bounds[1, self.axis] - self.bounds[0, self.axis])

    @property
    def base(self) -> Array:
        """Sides of the bounds in the reference plane.

        Returns
        -------
        (2,) float64 array
            Lengths along the plane's axes, in the unit of the points.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> y, x = np.mgrid[:24, :24]
        >>> swatch = intaglio.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))
        >>> swatch.base
        array([23., 23.])
        """
        size = self.bounds[1] - self.bounds[0]
        return size[list(self.plane_axes)]
