"""Triangle meshes of point sets: marching cubes on the signed distance to the point-set surface."""

from __future__ import annotations

import warnings

import numpy as np
from scipy import ndimage
from skimage.measure import marching_cubes

from intaglio.arrays import Array
from intaglio.checks import checked_arguments, checked_positive
from intaglio.devices import device_or_error
from intaglio.errors import InputError, IntaglioWarning
from intaglio.geometry.point_set import PointSet, axis_number, checked_points, plane_axes
from intaglio.geometry.sampling import local_spacing
from intaglio.geometry.swatch import SUPPORT
from intaglio.kernels.distance_fields import signed_distance
from intaglio.kernels.point_surface import PointSurface
from intaglio.mesh import Surface, border_edges, pieces

_MOST_NODES = 150_000_000
# Nodes this many cells, and this many distances of samples, from a sample get a distance of their own.
_BAND, _COVER = 2, 1.5
# The largest cell in distances of samples; larger ones lose thin parts.
_COARSE = 2.0
# In distances of samples: triangles farther from every sample close the rim of an open surface, and are dropped.
_RIM = 1.6
# Pieces of fewer vertices come from single nodes in gaps narrower than a cell, and are dropped.
_SMALLEST = 20
_AT_ONCE = 2_000_000


@checked_arguments
def mesh_geometry(
    points: PointSet, cell: float | None = None, *, closed: bool = False, axis: int | str | None = 2, device: str | None = None
) -> Surface:
    """Make a triangle mesh of points with normals.

    Marching cubes run on the signed distance from the point-set surface, which is computed near the samples; elsewhere the
    sign is that of the nodes around. If the surface of the points is closed, so is the mesh. Sheets that are closer to each
    other than a cell grow together.

    Parameters
    ----------
    points : PointSet
        At least 32 points, such as from `extend_geometry`.
    cell : float, optional
        Side of the cubes, in the unit of the points. Default None: the distance of samples.
    closed : bool, optional
        Close by flat faces what is cut at the border of the points, if they bound a solid; a sheet, such as a height field,
        stays open. The notes count the open edges. Default False.
    axis : {0, 1, 2, "x", "y", "z"} or None, optional
        Height axis: the points were cut at the borders along the other two. None: they were not cut anywhere. Default 2.
    device : str, optional
        Where distances are computed, such as "cpu" or "cuda:0". Default None: CUDA if there is a GPU, else the CPU.

    Returns
    -------
    Surface
        The mesh, with colours from the nearest points; ``measured`` is False throughout.

    Raises
    ------
    InputError
        If there are fewer than 32 points, the cell is not positive, the grid would exceed 150 million nodes, or the device
        does not exist.

    Warns
    -----
    IntaglioWarning
        If the cell is more than two distances of samples, so that thin parts are lost.

    References
    ----------
    Lorensen & Cline, "Marching Cubes: A High Resolution 3D Surface Construction Algorithm", SIGGRAPH 1987.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:24, :24]
    >>> swatch = intaglio.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))
    >>> mesh = intaglio.mesh_geometry(swatch.points, device="cpu")
    >>> len(mesh.faces) > 1000, bool(np.abs(mesh.vertices[:, 2]).max() < 2.1)
    (True, True)
    """
    device = device_or_error(device)
    checked_points("points", points)
    axis = None if axis is None else axis_number(axis)
    if len(points) < 32:
        raise InputError(f"{len(points)} points are too few for a mesh; at least 32 are needed")
    spacing = float(np.median(local_spacing(points.points, points.normals)))
    side = spacing if cell is None else checked_positive("cell", cell)
    if side > _COARSE * spacing:
        warnings.warn(
            f"cell {side:.4g} is more than {_COARSE:g} distances of samples ({spacing:.4g}): what is thinner than a cell is lost",
            IntaglioWarning,
            stacklevel=3,
        )
    if float(np.prod(np.ptp(points.points, axis=0) / side + 1)) > _MOST_NODES:
        raise InputError(f"cell {side:.4g} makes a grid of more than {_MOST_NODES:.3g} nodes; give a larger one, or a part")
    band = max(_BAND, int(np.ceil(_COVER * spacing / side)))
    low, high = points.points.min(axis=0), points.points.max(axis=0)
    plane = [] if axis is None else list(plane_axes(axis))
    begin, counts = low - band * side, np.ceil((high - low) / side).astype(np.int64) + 2 * band + 1
    steps = np.full(3, side)
    for k in plane:
        # Nodes on the border itself: the cut is where it was made.
        begin[k], counts[k] = low[k], max(2, round((high[k] - low[k]) / side) + 1)
        steps[k] = (high[k] - low[k]) / (counts[k] - 1)
    if float(np.prod(counts.astype(float))) > _MOST_NODES:
        raise InputError(f"cell {side:.4g} makes a grid of {' x '.join(map(str, counts))} nodes; give a larger one, or a part")
    surface = PointSurface(points.points - low, points.normals, SUPPORT * spacing, device=device)
    volume, known = _near_field(points.points, surface, begin - low, steps, counts, band, SUPPORT * spacing)
    _fill_sides(volume, known, SUPPORT * spacing)
    if closed:
        wide = [(1, 1) if k in plane else (0, 0) for k in range(3)]
        volume = np.pad(volume, wide, constant_values=SUPPORT * spacing)
        begin[plane] -= steps[plane]
    if volume.min() >= 0 or volume.max() <= 0:
        raise InputError("the points bound no volume and no sheet that this cell can show; give a smaller one")
    vertices, faces, _, _ = marching_cubes(volume, 0.0, spacing=tuple(steps), gradient_direction="descent")
    vertices = vertices.astype(np.float64) + begin
    if closed:
        vertices[:, plane] = np.clip(vertices[:, plane], low[plane], high[plane])
    if not closed:
        near = surface.nearest(vertices - low, reach=_RIM * spacing) >= 0
        faces = faces[near[faces].all(axis=1)]
    _, label = pieces(faces, len(vertices))
    faces = faces[np.bincount(label)[label[faces[:, 0]]] >= _SMALLEST]
    if not len(faces):
        raise InputError(f"nothing of the points' surface is left at cell {side:.4g}; give a smaller one")
    used = np.unique(faces)
    renumber = np.zeros(len(vertices), np.int64)
    renumber[used] = np.arange(len(used))
    vertices, faces = vertices[used], renumber[faces]
    color = None
    if points.color is not None:
        nearest = surface.nearest(vertices - low, reach=4 * spacing)
        color = points.color[np.maximum(nearest, 0)]
    nothing = np.zeros(len(vertices), bool)
    left = len(border_edges(faces))
    rims = f"; {left} edges stay open" if left else ", closed"
    notes = (*points.notes, f"mesh by marching cubes of side {side:.4g}{rims}")
    return Surface(vertices=vertices, faces=faces, color=color, measured=nothing, notes=notes)


def _near_field(
    points: Array, surface: PointSurface, begin: Array, steps: Array, counts: Array, band: int, reach: float
) -> tuple[Array, Array]:
    """Return distances at the nodes near a sample, and which those are."""
    known = np.zeros(counts, bool)
    at = np.round((points - points.min(axis=0) - begin) / steps).astype(np.int64)
    at = np.clip(at, 0, counts - 1)
    known[at[:, 0], at[:, 1], at[:, 2]] = True
    for axis in range(3):
        known = ndimage.maximum_filter1d(known.view(np.uint8), 2 * band + 1, axis=axis, mode="constant").view(bool)
    volume = np.full(counts, np.float32(reach))
    node = np.flatnonzero(known)
    flat = volume.reshape(-1)
    for first in range(0, len(node), _AT_ONCE):
        part = node[first : first + _AT_ONCE]
        place = np.stack(np.unravel_index(part, counts), axis=1) * steps + begin
        field = signed_distance(surface, place, reach=reach)
        flat[part] = field[:, 0]
        # The side of nodes out of reach is unknown.
        known.reshape(-1)[part[(field[:, 1:] == 0).all(axis=1)]] = False
    return volume, known


def _fill_sides(volume: Array, known: Array, reach: float) -> None:
    """Give every connected region without distances the side of the nodes around it, in place."""
    label, count = ndimage.label(~known)
    if not count:
        return
    votes = np.zeros(count + 1)
    for axis in range(3):
        for here, there in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
            a = tuple(here if k == axis else slice(None) for k in range(3))
            b = tuple(there if k == axis else slice(None) for k in range(3))
            touching = (label[a] > 0) & known[b]
            votes += np.bincount(label[a][touching], np.sign(volume[b][touching]), count + 1)
    inside = votes < 0
    volume[inside[label] & ~known] = -reach
