"""The page about an extended geometry texture."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from intaglio.geometry.assess import GeometryReport
from intaglio.geometry.mesh import mesh_geometry
from intaglio.geometry.point_set import GeometryTexture, PointSet
from intaglio.html_page import listing, picture_row, write_page
from intaglio.render.view import Light, frame, view
from intaglio.topology import used_vertices

Array = np.ndarray

# Towards the eye, in the frame (u, v, height): from above, and aslant.
VIEWS = {"from above": (0.0, -0.05, 1.0), "aslant": (0.25, -0.8, 0.75)}
_LIGHT = Light(tilt=135.0, slant=55.0)


def geometry_pictures(
    points: PointSet, axis: int, *, colors: Array | None = None, size: tuple[int, int] = (640, 480), device: str | None = None
) -> dict[str, Array]:
    """Return pictures (H, W, 3) of points, as the mesh of their surface, from above and aslant.

    Parameters
    ----------
    points : PointSet
    axis : int
        Height axis.
    colors : (N, 3) array, optional
        Linear colours to show them in; default their own, else clay.
    size : (width, height)
    device : str, optional
    """
    shown = points if colors is None else PointSet(points.points, points.normals, color=colors)
    mesh = mesh_geometry(shown, axis=axis, device=device)
    # The height axis towards the eye; the order of the three keeps its handedness.
    vertices = mesh.vertices[:, [(axis + 1) % 3, (axis + 2) % 3, axis]]
    used = used_vertices(mesh.faces, len(vertices))
    found = {}
    for name, direction in VIEWS.items():
        camera = frame(vertices[used], np.array(direction), up=(0.0, 1.0, 0.3), margin=0.85)
        found[name] = view(vertices, mesh.faces, camera=camera, colors=mesh.color, light=_LIGHT, size=size)
    return found


def provenance_colors(points: PointSet, texture: GeometryTexture) -> Array:
    """Return colours (N, 3) that tell where in the swatch each point comes from: red runs along u, green along v."""
    assert points.source is not None
    plane = list(texture.plane_axes)
    at = texture.points.points[:, plane]
    place = (at - at.min(axis=0)) / np.maximum(np.ptp(at, axis=0), 1e-300)
    return np.concatenate([0.1 + 0.8 * place, np.full((len(at), 1), 0.35)], axis=1)[points.source].astype(np.float32)


def write_geometry_report(
    path: str | os.PathLike[str],
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
    found = {
        "Swatch": geometry_pictures(texture.points, axis, device=device),
        "Result": geometry_pictures(points, axis, device=device),
    }
    if points.source is not None:
        colors = provenance_colors(points, texture)
        found["Where in the swatch each point comes from"] = geometry_pictures(points, axis, colors=colors, device=device)
    return found
