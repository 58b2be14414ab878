"""Geometry textures over surfaces: points carried to a shell over a mesh with texture coordinates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import (
    checked_arguments,
    checked_count,
    checked_faces,
    checked_finite,
    checked_number,
    checked_positive,
    checked_vectors,
)
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.geometry.options import checked_pair
from intaglio.geometry.point_set import PointSet, axis_number, checked_points, plane_axes
from intaglio.kernels.shells import Shell
from intaglio.mesh import read_mesh_file, vertex_normals


@checked_arguments
def wrap_geometry(
    points: PointSet,
    vertices: Array,
    faces: Array,
    uv: Array,
    *,
    size: float | tuple[float, float],
    repeat: tuple[int, int] = (1, 1),
    axis: int | str = 2,
    thickness: float | None = None,
    base: float | None = None,
    normals: Array | None = None,
    device: str | None = None,
) -> PointSet:
    """Place a geometry texture on a mesh: every point goes to its base point plus its height along the normal there.

    Parameters
    ----------
    points : PointSet
        From `extend_geometry`: from 0 to ``size`` in the plane. It should be tileable if it is repeated or the mesh closes on
        itself, or else a seam shows there.
    vertices : (N, 3) array
        Positions of the mesh, in any unit of length.
    faces : (F, 3) int array
        Triangles of the mesh.
    uv : (N, 2) or (F, 3, 2) array
        Texture coordinates of the vertices, or of the corners of the faces; the texture covers [0, 1] ``repeat`` times.
    size : float or (float, float)
        Sides of the texture in the plane, in the unit of the points.
    repeat : (int, int), optional
        How often the texture is repeated along u and v, from 1 to 1000. Default (1, 1).
    axis : {0, 1, 2, "x", "y", "z"}, optional
        Height axis of the texture. Default 2.
    thickness : float, optional
        Length on the mesh for a unit of the texture's height. Default None: the mean factor by which lengths in the plane are
        scaled, which keeps proportions.
    base : float, optional
        The height in the texture that lies on the mesh. Default None: the middle of its heights.
    normals : (N, 3) array, optional
        Normals at the vertices. Default None: from the faces, with vertices at the same place counted as one.
    device : str, optional
        Where triangles are searched, such as "cpu" or "cuda:0". Default None: CUDA if there is a GPU, else the CPU.

    Returns
    -------
    PointSet
        The points on the mesh, with ``source``, ``moved`` and ``color``. Points outside the texture coordinates of all
        triangles are left out. The notes say how lengths were scaled.

    Raises
    ------
    InputError
        For arrays of the wrong shape, options out of range, texture coordinates without area, points of which none reaches
        them, or a device that does not exist.

    References
    ----------
    Duranleau & Poulin, "Patch-based Synthesis of Geometry Textures with Point-set Surfaces", section 7 (future work).

    Porumbescu, Budge, Feng & Joy, "Shell Maps", SIGGRAPH 2005.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:24, :24]
    >>> swatch = intaglio.geometry_from_height(np.sin(2 * np.pi * x / 8) + np.cos(2 * np.pi * y / 8))
    >>> corners = np.array([[0.0, 0, 0], [48, 0, 0], [48, 48, 0], [0, 48, 0]])
    >>> faces, uv = np.array([[0, 1, 2], [0, 2, 3]]), corners[:, :2] / 48
    >>> wrapped = intaglio.wrap_geometry(swatch.points, corners, faces, uv, size=24, device="cpu")
    >>> np.allclose(wrapped.points, 2 * swatch.points.points, atol=1e-4)
    True
    """
    device = device_or_error(device)
    sides = checked_pair("size", size)
    if not isinstance(repeat, tuple | list) or len(repeat) != 2:
        raise InputError(f"repeat must be two whole numbers, not {repeat!r}")
    turns = [checked_count("repeat", r, 1, 1000) for r in repeat]
    checked_points("points", points)
    axis = axis_number(axis)
    corners = checked_vectors("vertices", vertices)
    triangles = checked_faces("faces", faces, len(corners))
    if not len(triangles):
        raise InputError("faces must be an (F, 3) array of at least one triangle")
    at_corners = _per_corner(uv, triangles, len(corners))
    flat = at_corners[:, 1:] - at_corners[:, :1]
    area = np.abs(flat[:, 0, 0] * flat[:, 1, 1] - flat[:, 0, 1] * flat[:, 1, 0]) / 2
    edges = corners[triangles[:, 1:]] - corners[triangles[:, :1]]
    solid = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    if not area.sum() > 0 or not solid.sum() > 0:
        raise InputError(
            "uv has no area" if solid.sum() > 0 else "the mesh has no area: vertices and faces make no triangle with one"
        )
    laid = sides * turns
    # Lengths on the mesh for a length of the texture, triangle by triangle.
    scale = np.sqrt(solid / np.maximum(area * laid[0] * laid[1], 1e-300))[area > 0]
    mean = float(np.sqrt(solid.sum() / (area.sum() * laid[0] * laid[1])))
    height = mean if thickness is None else checked_positive("thickness", thickness)
    order = [*plane_axes(axis), axis]
    local, facing = points.points[:, order], points.normals[:, order]
    middle = (local[:, 2].min() + local[:, 2].max()) / 2 if len(local) else 0.0
    level = middle if base is None else checked_number("base", base, -np.inf)
    unit = _smooth_normals(corners, triangles) if normals is None else checked_vectors("normals", normals)
    if unit.shape != corners.shape:
        raise InputError(f"normals must have the shape {corners.shape} of the vertices, not {unit.shape}")
    if np.linalg.norm(unit, axis=1).min() == 0:
        raise InputError("the mesh has normals of length 0")
    center = corners.mean(axis=0)
    parts = []
    shell = Shell(at_corners, corners[triangles] - center, unit[triangles], device)
    # In units of u and v a normal's components along the plane grow as lengths shrink.
    for i in range(turns[0]):
        for j in range(turns[1]):
            at = np.stack(
                [(local[:, 0] + i * sides[0]) / laid[0], (local[:, 1] + j * sides[1]) / laid[1], local[:, 2] - level], axis=1
            )
            place, turned, face = shell.carry(at, facing * (laid[0], laid[1], 1.0), height)
            there = face >= 0
            part = points.part(there)
            parts.append(replace(part, points=place[there] + center, normals=turned[there]))
    low, high = np.quantile(scale, [0.01, 0.99])
    note = f"a length of 1 in the texture is {mean:.4g} on the mesh on average, from {low:.4g} to {high:.4g}"
    whole = _join_parts(parts)
    if not len(whole):
        raise InputError(
            "no point lies over a triangle: uv, the texture coordinates, lie outside of 0 to 1, or size is out of proportion"
        )
    return replace(whole, notes=(*points.notes, note))


def read_uv_mesh(path: PathLike) -> tuple[Array, Array, Array]:
    """Return vertices (N, 3), faces (F, 3) and texture coordinates (N, 2) of a mesh file that has them.

    Raises
    ------
    FileError
        If the file can't be read.
    InputError
        If it holds no mesh with texture coordinates; `intaglio.parameterize` makes some.
    """
    raw = read_mesh_file(path)
    if not len(raw.faces):
        raise InputError(f"{path}: holds no triangles")
    try:
        vertex, faces, uv = raw.split_at_seams()
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    if not np.isfinite(raw.vertices[vertex]).all():
        raise InputError(f"{path}: has vertices that are not finite: mend it (intaglio.mend_surface)")
    return raw.vertices[vertex], faces, uv


def _per_corner(uv: Array, faces: Array, count: int) -> Array:
    coordinates = checked_finite("uv", uv)
    if coordinates.shape == (count, 2):
        coordinates = coordinates[faces]
    if coordinates.shape != (len(faces), 3, 2):
        raise InputError(f"uv must be ({count}, 2) or ({len(faces)}, 3, 2), not {np.shape(uv)}")
    return coordinates


def _smooth_normals(vertices: Array, faces: Array) -> Array:
    """Return vertex normals; seams of the texture coordinates, where vertices are doubled, leave no crease."""
    _, inverse = np.unique(vertices, axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    first = np.zeros(inverse.max() + 1, np.int64)
    first[inverse] = np.arange(len(vertices))
    return vertex_normals(vertices[first], inverse[faces])[inverse]


def _join_parts(parts: list[PointSet]) -> PointSet:
    def all_of(name: str) -> Array | None:
        values = [getattr(part, name) for part in parts]
        return None if values[0] is None else np.concatenate(values)

    points, normals = all_of("points"), all_of("normals")
    assert points is not None
    assert normals is not None
    return PointSet(points, normals, color=all_of("color"), source=all_of("source"), moved=all_of("moved"), patch=all_of("patch"))
