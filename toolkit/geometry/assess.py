"""Measures of extended geometry textures: spread of samples, holes, normals, steps at patch borders, connected pieces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.geometry.point_set import GeometryTexture, PointSet, checked_points
from intaglio.geometry.swatch import SUPPORT
from intaglio.kernels.point_surface import PointSurface
from intaglio.kernels.relaxation import gaps

# Least cosine between the normals of neighbours on one surface.
_ALIKE = 0.7
# Widths, in usual distances of nearest neighbours, from which a gap counts as a hole and as an open border.
_HOLE, _BORDER = 3.0, 8.0
# The fewest points that can be measured.
FEWEST = 32


@dataclass(frozen=True)
class GeometryReport:
    """Measures of an extended geometry texture, compared with its swatch.

    Attributes
    ----------
    points : int
        Number of points.
    nearest : float
        Median distance of nearest neighbours over that of the swatch: 1 is alike.
    nearest_emd : float
        Earth mover's distance between the distributions of these distances, over the swatch's median.
    holes : float
        Share of the points that are beside a hole wider than three of the swatch's median distances.
    swatch_holes : float
        The same share of the swatch.
    widest : float
        Width of the widest hole over the swatch's median distance, up to 8; wider ones count as open borders.
    normal_angle : float
        Median angle between the normals and the surface of their neighbours, in degrees.
    step, step_high : float
        Median and 99 % quantile of the step between the surfaces of neighbouring patches, over the distance of samples;
        NaN if no patches meet.
    moved : float
        Median distance by which points were moved, over the distance of samples; NaN if none were.

    See Also
    --------
    intaglio.assess_geometry : Computes it.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:24, :24]
    >>> swatch = intaglio.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))
    >>> report = intaglio.assess_geometry(swatch.points, swatch, device="cpu")
    >>> report.points, report.nearest
    (576, 1.0)
    """

    points: int
    nearest: float
    nearest_emd: float
    holes: float
    swatch_holes: float
    widest: float
    normal_angle: float
    step: float
    step_high: float
    moved: float

    def __post_init__(self) -> None:
        check_fields(self, nan=True)

    def lines(self) -> list[str]:
        """Return the measures as lines of text.

        Returns
        -------
        list of str
            Sentences for the user, one line each.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> y, x = np.mgrid[:24, :24]
        >>> swatch = intaglio.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))
        >>> intaglio.assess_geometry(swatch.points, swatch, device="cpu").lines()[0][:46]
        '576 points; nearest neighbours 1.000 of the sw'
        """
        lines = [
            f"{self.points} points; nearest neighbours {self.nearest:.3f} of the swatch's median, EMD {self.nearest_emd:.3f}",
            f"beside a hole wider than {_HOLE:g} distances: {100 * self.holes:.3f} % of points "
            f"(swatch {100 * self.swatch_holes:.3f} %); widest {self.widest:.1f}",
            f"normals against the local surface: {self.normal_angle:.2f}° median",
        ]
        if np.isfinite(self.step):
            lines.append(f"step at patch borders: {self.step:.3f} of the distance of samples, 99 % below {self.step_high:.3f}")
        if np.isfinite(self.moved):
            lines.append(f"moved by fitting: {self.moved:.2f} of the distance of samples (median)")
        return lines


@checked_arguments
def assess_geometry(points: PointSet, texture: GeometryTexture, *, device: str | None = None) -> GeometryReport:
    """Measure an extended geometry texture against its swatch.

    Parameters
    ----------
    points : PointSet
        From `extend_geometry`, at least 32 points.
    texture : GeometryTexture
        The swatch from which they were made.
    device : str, optional
        Where distances are computed, such as "cpu" or "cuda:0". Default None: CUDA if there is a GPU, else the CPU.

    Returns
    -------
    GeometryReport
        Measures of spread, holes, normals, patch borders and moves.

    Raises
    ------
    InputError
        If an argument is of the wrong type, there are too few points, or the device does not exist.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:24, :24]
    >>> swatch = intaglio.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))
    >>> larger = intaglio.extend_geometry(swatch, 18, device="cpu")
    >>> report = intaglio.assess_geometry(larger, swatch, device="cpu")
    >>> 0.5 < report.nearest < 2, report.points == len(larger)
    (True, True)
    """
    # SciPy's statistics take long to import.
    from scipy.stats import wasserstein_distance

    device = device_or_error(device)
    checked_points("points", points)
    if not isinstance(texture, GeometryTexture):
        raise InputError(f"texture must be a GeometryTexture, not {type(texture).__name__}")
    if len(points) < FEWEST:
        raise InputError(f"{len(points)} points are too few to be measured; at least {FEWEST} are needed")
    spacing = texture.spacing
    swatch, tree = nearest_distances(cKDTree(texture.points.points)), cKDTree(points.points)
    usual = float(np.median(swatch))
    low, high = points.points.min(axis=0), points.points.max(axis=0)
    plane = list(texture.plane_axes)
    at = points.points - low
    inner = ((at[:, plane] > 3 * spacing) & (at[:, plane] < (high - low)[plane] - 3 * spacing)).all(axis=1)
    inner = inner if inner.any() else np.ones(len(points), bool)
    distance = nearest_distances(tree)[inner]
    surface = PointSurface(at, points.normals, SUPPORT * spacing, device=device)
    feet = surface.project(at, facing=points.normals, reach=spacing)
    alike = (feet.normals * points.normals).sum(axis=1)[feet.found & inner]
    width = gaps(surface, _HOLE * usual, _BORDER * usual)[1][inner]
    corner = texture.points.points.min(axis=0)
    of_swatch = PointSurface(texture.points.points - corner, texture.points.normals, SUPPORT * spacing, device=device)
    step, step_high = _steps(points, at, tree, spacing, device)
    return GeometryReport(
        points=len(points),
        nearest=float(np.median(distance)) / usual,
        # Not in standard deviations, as elsewhere, since these are zero on a lattice.
        nearest_emd=float(wasserstein_distance(distance, swatch)) / usual,
        holes=float((width > 0).mean()),
        swatch_holes=float((gaps(of_swatch, _HOLE * usual, _BORDER * usual)[1] > 0).mean()),
        widest=float(width.max(initial=0)) / usual,
        normal_angle=float(np.degrees(np.median(np.arccos(np.clip(alike, -1, 1))))),
        step=step,
        step_high=step_high,
        moved=float("nan") if points.moved is None else float(np.median(points.moved)) / spacing,
    )


def _steps(points: PointSet, at: Array, tree: cKDTree, spacing: float, device: str) -> tuple[float, float]:
    """Return median and 99 % quantile of the steps across patch borders, in distances of samples."""
    if points.patch is None:
        return float("nan"), float("nan")
    near, index = tree.query(points.points, 8, distance_upper_bound=1.5 * spacing)
    index = np.where(np.isfinite(near), index, np.arange(len(points))[:, None])
    other = points.patch[index] != points.patch[:, None]
    other &= (points.normals[index] * points.normals[:, None]).sum(axis=2) > _ALIKE
    here = np.flatnonzero(other.any(axis=1))
    if not len(here):
        return float("nan"), float("nan")
    across = points.patch[index[here, np.argmax(other[here], axis=1)]]
    surface = PointSurface(at, points.normals, SUPPORT * spacing, group=points.patch, device=device)
    feet = surface.project(at[here], facing=points.normals[here], group=across, reach=1.5 * spacing)
    step = np.abs(((at[here] - feet.points) * feet.normals).sum(axis=1))[feet.found] / spacing
    return float(np.median(step)), float(np.quantile(step, 0.99))


def nearest_distances(tree: cKDTree) -> Array:
    """Return the distance (N,) of every point of a tree to the nearest other."""
    distance, _ = tree.query(tree.data, 2)
    return np.asarray(distance[:, 1])


def label_pieces(points: PointSet, reach: float) -> Array:
    """Return the connected piece of each point (N,): neighbours within ``reach`` whose normals agree are joined.

    Two threads that touch face each other there, so they stay apart.
    """
    pairs = cKDTree(points.points).query_pairs(reach, output_type="ndarray")
    alike = (points.normals[pairs[:, 0]] * points.normals[pairs[:, 1]]).sum(axis=1) > _ALIKE
    pairs = pairs[alike]
    graph = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    return connected_components(graph, directed=False)[1]
