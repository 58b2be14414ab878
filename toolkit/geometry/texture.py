"""Geometry textures from points, meshes and height maps: checked, measured, with normals."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from intaglio.arrays import Array
from intaglio.checks import checked_arguments, checked_numeric, checked_positive, checked_vectors, refuse_huge
from intaglio.errors import InputError, IntaglioWarning
from intaglio.geometry.normals import estimate_normals, mend_sides
from intaglio.geometry.point_set import GeometryTexture, PointSet, axis_number, plane_axes
from intaglio.geometry.sampling import RADIUS, local_spacing, sample_triangles, thin_points
from intaglio.mesh import grid_faces
from intaglio.randomness import checked_seed

_FEWEST = 32
# Share of a height map that may be steeper than 45° before its pixels are too uneven as samples.
_STEEP = 0.1
# The smallest and largest extents that single precision can represent well.
_SMALLEST, _LARGEST = 1e-12, 1e12
# Samples that are closer than this share of the extent are copies that differ by rounding.
_CLOSEST = 1e-9
# Local distances of samples (2 % and 98 % quantiles) may differ by this factor.
_MOST_UNEVEN = 3.0
# A warning is given if a larger share of the points has an opposing surface nearer than this many distances of samples.
_OPPOSED_NEAR, _OPPOSED_SHARE = 0.5, 0.01
# Below this share of the bounds covered by the points' hull, the swatch does not count as a rectangle.
_FULL = 0.9


@checked_arguments
def geometry_from_points(
    points: Array,
    normals: Array | None = None,
    *,
    color: Array | None = None,
    bounds: Array | None = None,
    axis: int | str | None = None,
    spacing: float | None = None,
) -> GeometryTexture:
    """Make a geometry texture of points.

    Parameters
    ----------
    points : (N, 3) array
        At least 32 points, in any unit of length.
    normals : (N, 3) array, optional
        Vectors of any length but zero that point out of the solid. Where some face the other side than those around them on
        the same surface, they are turned. Default None: estimated (see the texture's notes).
    color : (N, 3) array, optional
        Linear colours, at least 0. Default None: no colours.
    bounds : (2, 3) array, optional
        Least and greatest corner of the box that is the texture; geometry should reach past it in the reference plane.
        Default None: the extent of the points, of which `extend_geometry` takes off the padding that it needs.
    axis : {0, 1, 2, "x", "y", "z"}, optional
        Height axis. Default None: the one along which the points extend least.
    spacing : float, optional
        Thin the points evenly to about this distance, in their unit. Default None: all are kept.

    Returns
    -------
    GeometryTexture
        The points, their bounds and the distance of samples. Of points that lie exactly on one another one is kept.

    Raises
    ------
    InputError
        For too few points, NaN, wrong shapes, normals of zero, bounds without area, height or points in them, and for
        samples whose distances differ by more than a factor of 3 (2 % and 98 % quantiles).

    Warns
    -----
    IntaglioWarning
        If opposing surfaces are closer than the sampling can resolve, the points do not fill a rectangle, or points lie
        above or below the bounds.

    References
    ----------
    Duranleau & Poulin, "Patch-based Synthesis of Geometry Textures with Point-set Surfaces", section 3.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:16, :16]
    >>> points = np.column_stack([x.ravel(), y.ravel(), np.sin(x.ravel())])
    >>> normals = np.column_stack([-np.cos(x.ravel()), 0 * x.ravel(), np.ones(256)])
    >>> swatch = intaglio.geometry_from_points(points, normals)
    >>> swatch.axis, swatch.base
    (2, array([15., 15.]))
    """
    positions = checked_vectors("points", points)
    if len(positions) < _FEWEST:
        raise InputError(
            f"{len(positions)} points are too few for a geometry texture; at least {_FEWEST} are needed: give more, or a smaller "
            "spacing"
        )
    notes: list[str] = []
    directions = None if normals is None else _unit(checked_vectors("normals", normals), len(positions))
    colors = None if color is None else _colors(color, len(positions))
    extent = float(np.ptp(positions, axis=0).max())
    if not _SMALLEST < extent < _LARGEST and extent > 0:
        raise InputError(
            f"the points extend over {extent:.3g}: bring them to a unit (of points, vertices, or pixel) in which that is from "
            "1e-12 to 1e12"
        )
    _, first = np.unique(positions, axis=0, return_index=True)
    if len(first) < len(positions):
        notes.append(f"{len(positions) - len(first)} points that lie exactly on another were left out")
        first = np.sort(first)
        positions = positions[first]
        directions = None if directions is None else directions[first]
        colors = None if colors is None else colors[first]
        if len(positions) < _FEWEST:
            raise InputError(f"only {len(positions)} points differ; at least {_FEWEST} are needed")
    height_axis = _axis(axis, positions)
    given = None if bounds is None else _bounds(bounds, height_axis)
    measured = float(np.median(local_spacing(positions)))
    if not measured > _CLOSEST * extent:
        raise InputError(
            f"half of the points are within {measured:.3g} of another one, though all extend over {extent:.3g}: they are copies "
            "of few points; leave these out"
        )
    if directions is None:
        directions, note = estimate_normals(positions, height_axis, measured)
        notes.append(note)
    else:
        directions, mended = mend_sides(positions, directions, height_axis, measured)
        notes += [mended] if mended else []
    if spacing is not None:
        keep = thin_points(positions, directions, RADIUS * checked_positive("spacing", spacing))
        if len(keep) < _FEWEST:
            raise InputError(f"spacing {spacing:g} leaves {len(keep)} points; at least {_FEWEST} are needed: give a smaller one")
        notes.append(f"thinned from {len(positions)} to {len(keep)} points")
        positions, directions = positions[keep], directions[keep]
        colors = None if colors is None else colors[keep]
    local = local_spacing(positions, directions)
    local = local[np.isfinite(local)] if np.isfinite(local).any() else local_spacing(positions)
    low, typical, high = np.quantile(local, [0.02, 0.5, 0.98])
    if high > _MOST_UNEVEN * low:
        raise InputError(
            f"the points are spread unevenly: distances of samples range from {low:.4g} to {high:.4g}, a factor of "
            f"{high / max(low, 1e-300):.1f} (at most {_MOST_UNEVEN:g}); give spacing={high:.3g} to thin them evenly, "
            "or sample the surface again"
        )
    box = np.stack([positions.min(axis=0), positions.max(axis=0)]) if given is None else given
    _check_inside(positions, box, height_axis)
    if given is None:
        _warn_of_shape(positions, height_axis)
    _warn_of_opposing(positions, directions, float(typical))
    return GeometryTexture(PointSet(positions, directions, color=colors), box, height_axis, float(typical), tuple(notes))


@checked_arguments
def geometry_from_mesh(
    vertices: Array,
    faces: Array,
    *,
    color: Array | None = None,
    spacing: float | None = None,
    bounds: Array | None = None,
    axis: int | str | None = None,
    seed: int = 0,
) -> GeometryTexture:
    """Make a geometry texture of a triangle mesh, by sampling it evenly (Poisson disks).

    Parameters
    ----------
    vertices : (N, 3) array
        Positions in any unit of length.
    faces : (F, 3) int array
        Triangles, counter-clockwise from outside: normals are those of the triangles.
    color : (N, 3) array, optional
        Linear colours at the vertices, at least 0. Default None: no colours.
    spacing : float, optional
        Distance of samples, in the unit of the vertices. Default None: one that gives about 50,000 samples.
    bounds : (2, 3) array, optional
        Least and greatest corner of the box that is the texture; see `geometry_from_points`. Default None: the extent of
        the samples.
    axis : {0, 1, 2, "x", "y", "z"}, optional
        Height axis. Default None: the one along which the samples extend least.
    seed : int, optional
        Seed of the sampling: the same seed gives the same points. Default 0.

    Returns
    -------
    GeometryTexture
        The samples, their bounds and their distance.

    Raises
    ------
    InputError
        For a mesh without area, and as `geometry_from_points`.

    Warns
    -----
    IntaglioWarning
        As `geometry_from_points`.

    References
    ----------
    Duranleau & Poulin, "Patch-based Synthesis of Geometry Textures with Point-set Surfaces", section 3.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[0.0, 0, 0], [24, 0, 0], [24, 24, 0], [0, 24, 0]])
    >>> faces, bounds = np.array([[0, 1, 2], [0, 2, 3]]), [[2, 2, -1], [22, 22, 1]]
    >>> swatch = intaglio.geometry_from_mesh(corners, faces, spacing=1.0, bounds=bounds)
    >>> 0.9 < swatch.spacing < 1.2, swatch.points.normals[0]
    (True, array([0., 0., 1.]))
    """
    corners = checked_vectors("vertices", vertices)
    triangles = np.asarray(faces)
    if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu" or not len(triangles):
        raise InputError(f"faces must be an (F, 3) array of vertex numbers, not {triangles.dtype} {triangles.shape}")
    if triangles.min() < 0 or triangles.max() >= len(corners):
        raise InputError(f"faces name vertices {triangles.min()} to {triangles.max()}; there are {len(corners)}")
    distance = None if spacing is None else checked_positive("spacing", spacing)
    at_corners = None if color is None else _colors(color, len(corners))
    points, normals, face, weights = sample_triangles(corners, triangles, distance, checked_seed(seed))
    colors = None if at_corners is None else np.einsum("nk,nkc->nc", weights, at_corners[triangles[face]])
    return geometry_from_points(points, normals, color=colors, bounds=bounds, axis=axis)


@checked_arguments
def geometry_from_height(
    height: Array,
    *,
    pixel: float = 1.0,
    spacing: float | None = None,
    bounds: Array | None = None,
    seed: int = 0,
) -> GeometryTexture:
    """Make a geometry texture of a height map: x right, y up (row 0 is the top), z the height.

    Parameters
    ----------
    height : (H, W) array
        Heights of at least 6 x 6 pixels, in the unit of ``pixel``.
    pixel : float, optional
        Side of a pixel. Default 1: heights are in pixels.
    spacing : float, optional
        Sample the surface evenly at this distance. Default None: a point for each pixel, unless more than a tenth of the map
        is steeper than 45°, where pixels would leave the slopes bare; then evenly, a pixel apart.
    bounds : (2, 3) array, optional
        Least and greatest corner of the box that is the texture; see `geometry_from_points`. Default None: the extent of
        the points.
    seed : int, optional
        Seed of the sampling: the same seed gives the same points. Default 0.

    Returns
    -------
    GeometryTexture
        The points, their bounds and the distance of samples; the height axis is z.

    Raises
    ------
    InputError
        If the map is not a finite (H, W) array of at least 6 x 6, and as `geometry_from_points`.

    Warns
    -----
    IntaglioWarning
        As `geometry_from_points`.

    References
    ----------
    Duranleau & Poulin, "Patch-based Synthesis of Geometry Textures with Point-set Surfaces", section 3.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:24, :24]
    >>> swatch = intaglio.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))
    >>> len(swatch.points), swatch.base, swatch.height
    (576, array([23., 23.]), 4.0)
    """
    heights = checked_numeric("height", height, np.float64)
    if heights.ndim != 2 or min(heights.shape) < 6:
        raise InputError(f"height must be an (H, W) array of at least 6 x 6, not {heights.shape}")
    if not np.isfinite(heights).all():
        raise InputError(f"height has {int((~np.isfinite(heights)).sum())} values that are not finite; fill or crop them")
    refuse_huge("height", heights)
    side = checked_positive("pixel", pixel)
    rows, columns = heights.shape
    x, y = np.meshgrid((np.arange(columns) + 0.5) * side, (rows - 0.5 - np.arange(rows)) * side)
    points = np.stack([x, y, heights], axis=-1).reshape(-1, 3)
    down, right = np.gradient(heights, side)
    steep = float((np.hypot(down, right) > 1).mean())
    if spacing is None and steep <= _STEEP:
        normals = np.stack([-right, down, np.ones_like(heights)], axis=-1).reshape(-1, 3)
        return geometry_from_points(points, normals, bounds=bounds, axis=2)
    made = geometry_from_mesh(
        points, grid_faces(rows, columns), spacing=side if spacing is None else spacing, bounds=bounds, axis=2, seed=seed
    )
    if spacing is not None:
        return made
    note = f"{100 * steep:.0f} % of the height map is steeper than 45°: its surface was sampled evenly, a pixel apart"
    return replace(made, notes=(note, *made.notes))


def _colors(color: Array, count: int) -> Array:
    try:
        colors = np.asarray(color, np.float32)
    except (TypeError, ValueError) as problem:
        raise InputError(f"color must be a ({count}, 3) array of linear values ({problem})") from problem
    if colors.shape != (count, 3):
        raise InputError(f"color must have the shape ({count}, 3), not {colors.shape}")
    if not np.isfinite(colors).all() or colors.min(initial=0) < 0:
        raise InputError("color holds NaN, infinity or negative values; give linear ones from 0 to 1")
    return colors


def _unit(normals: Array, count: int) -> Array:
    if len(normals) != count:
        raise InputError(f"there are {len(normals)} normals for {count} points")
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    zero = int((length == 0).sum())
    if zero:
        raise InputError(f"{zero} normals are zero; leave the normals out to have them estimated")
    return normals / length


def _axis(axis: int | str | None, points: Array) -> int:
    return int(np.argmin(np.ptp(points, axis=0))) if axis is None else axis_number(axis)


def _bounds(bounds: Array | Sequence[Sequence[float]], axis: int) -> Array:
    try:
        box = np.asarray(bounds, np.float64)
    except (TypeError, ValueError) as problem:
        raise InputError(f"bounds must be two finite corners, a (2, 3) array ({problem})") from problem
    if box.shape != (2, 3) or not np.isfinite(box).all():
        raise InputError(f"bounds must be two finite corners, a (2, 3) array, not {box.tolist()}")
    size = box[1] - box[0]
    for k in range(3):
        if size[k] <= 0:
            what = "height" if k == axis else "extent"
            raise InputError(f"bounds have no {what} along {'xyz'[k]}: from {box[0, k]:g} to {box[1, k]:g}")
    return box


def _check_inside(points: Array, box: Array, axis: int) -> None:
    plane = list(plane_axes(axis))
    within = ((points[:, plane] >= box[0, plane]) & (points[:, plane] <= box[1, plane])).all(axis=1)
    if within.sum() < _FEWEST:
        low, high = points.min(axis=0), points.max(axis=0)
        raise InputError(
            f"only {int(within.sum())} points lie within the bounds; the points reach from {np.round(low, 4).tolist()} "
            f"to {np.round(high, 4).tolist()}"
        )
    if (box[1, plane] <= box[0, plane]).any():
        raise InputError("the points lie on a line: a geometry texture needs extent along two axes")
    inside = within & (points[:, axis] >= box[0, axis]) & (points[:, axis] <= box[1, axis])
    if not inside.any():
        raise InputError(
            f"no point lies between the bounds' heights {box[0, axis]:g} and {box[1, axis]:g}; the points within them reach "
            f"from {points[within, axis].min():g} to {points[within, axis].max():g}"
        )
    tall = float(((points[within, axis] < box[0, axis]) | (points[within, axis] > box[1, axis])).mean())
    if tall > 0.01:
        warnings.warn(
            f"{100 * tall:.0f} % of the points lie above or below the bounds along {'xyz'[axis]}; matching does not look there",
            IntaglioWarning,
            stacklevel=4,
        )


def _warn_of_shape(points: Array, axis: int) -> None:
    plane = points[:, plane_axes(axis)]
    try:
        share = ConvexHull(plane).volume / np.prod(np.ptp(plane, axis=0))
    except QhullError:
        return
    if share < _FULL:
        warnings.warn(
            f"the points fill only {100 * share:.0f} % of their rectangle; give bounds that lie inside of them",
            IntaglioWarning,
            stacklevel=4,
        )


def _warn_of_opposing(points: Array, normals: Array, spacing: float) -> None:
    chosen = np.linspace(0, len(points) - 1, min(len(points), 20_000)).astype(int)
    near = _OPPOSED_NEAR * spacing
    distance, index = cKDTree(points).query(points[chosen], min(16, len(points)), distance_upper_bound=near)
    found = np.isfinite(distance)
    index = np.where(found, index, 0)
    opposed = (found & ((normals[index] * normals[chosen, None]).sum(axis=2) < -0.5)).any(axis=1)
    if opposed.mean() > _OPPOSED_SHARE:
        warnings.warn(
            f"{100 * opposed.mean():.0f} % of the points have an opposing surface nearer than {near:.3g}, half the "
            "distance of samples: such sheets may grow together; sample more densely",
            IntaglioWarning,
            stacklevel=4,
        )
