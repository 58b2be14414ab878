"""The page about an extended geometry texture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array, PathLike
from intaglio.files import listing, picture_row, write_page
from intaglio.geometry.assess import GeometryReport
from intaglio.geometry.mesh import mesh_geometry
from intaglio.geometry.point_set import GeometryTexture, PointSet, plane_axes
from intaglio.mesh import Surface, used_vertices
from intaglio.render import Light, frame, view

# Towards the eye, in the frame (u, v, height): from above, and aslant.
VIEWS = {"from above": (0.0, -0.05, 1.0), "aslant": (0.25, -0.8, 0.75)}
_LIGHT = Light(tilt=135.0, slant=55.0)


def geometry_pictures(
    surface: Surface, axis: int, *, colors: Array | None = None, size: tuple[int, int] = (640, 480)
) -> dict[str, Array]:
    """Return pictures (H, W, 3) of a surface from above and aslant.

    Parameters
    ----------
    surface : Surface
        Of `mesh_geometry`.
    axis : int
        Height axis.
    colors : (N, 3) array, optional
        Linear colours to show it in; default its own, else clay.
    size : (rows, columns)
    """
    # The height axis towards the eye; the order of the three keeps its handedness.
    vertices = surface.vertices[:, [*plane_axes(axis), axis]]
    used = used_vertices(surface.faces, len(vertices))
    shown = surface.color if colors is None else colors
    found = {}
    for name, direction in VIEWS.items():
        camera = frame(vertices[used], np.array(direction), up=(0.0, 1.0, 0.3), margin=0.85)
        found[name] = view(vertices, surface.faces, camera=camera, colors=shown, light=_LIGHT, size=size)
    return found


def provenance_colors(points: PointSet, texture: GeometryTexture) -> Array:
    """Return colours (N, 3) that tell where in the swatch each point comes from: red runs along u, green along v."""
    assert points.source is not None
    plane = list(texture.plane_axes)
    at = texture.points.points[:, plane]
    place = (at - at.min(axis=0)) / np.maximum(np.ptp(at, axis=0), 1e-300)
    return np.concatenate([0.1 + 0.8 * place, np.full((len(at), 1), 0.35)], axis=1)[points.source].astype(np.float32)


def write_geometry_report(
    path: PathLike,
    points: PointSet,
    texture: GeometryTexture,
    report: GeometryReport,
    *,
    title: str,
    extra: Sequence[str] = (),
    pictures: dict[str, dict[str, Array]] | None = None,
    device: str | None = None,
) -> None:
    """Write a page with pictures of swatch and result from two views, where each point comes from, and the figures."""
    shown = comparison_pictures(points, texture, device=device) if pictures is None else pictures
    rows = [picture_row(heading, row) for heading, row in shown.items()]
    lines = [*report.lines(), *extra, *texture.notes, *points.notes]
    write_page(path, title, [*rows, listing("Figures", lines)])


def comparison_pictures(points: PointSet, texture: GeometryTexture, *, device: str | None = None) -> dict[str, dict[str, Array]]:
    """Return the pictures of a report by heading: swatch, result, and provenance."""
    axis = texture.axis
    mesh = mesh_geometry(points, axis=axis, device=device)
    found = {
        "Swatch": geometry_pictures(mesh_geometry(texture.points, axis=axis, device=device), axis),
        "Result": geometry_pictures(mesh, axis),
    }
    if points.source is not None:
        nearest = cKDTree(points.points).query(mesh.vertices)[1]
        colors = provenance_colors(points, texture)[nearest]
        found["Where in the swatch each point comes from"] = geometry_pictures(mesh, axis, colors=colors)
    return found
