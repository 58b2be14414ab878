"""Several charts, from xatlas, for surfaces that can't be laid flat as one."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.parameterization.charts import doubled_areas


def atlas(vertices: Array, faces: Array, *, texels: int = 1024, padding: int = 4) -> tuple[Array, Array, Array]:
    """Return texture positions (N', 2) in [0, 1]^2, faces (F, 3) on them, and the vertex that each position belongs to (N',).

    Parameters
    ----------
    vertices, faces : (N, 3), (F, 3) arrays
    texels : int
        Side of the texture for which charts are packed.
    padding : int
        Texels between charts at that size.

    Raises
    ------
    InputError
        If xatlas gives positions that are not finite.
    """
    uv, corners, vertex, (height, width) = _generated(vertices, faces, texels=texels, padding=padding)
    # xatlas scales rows and columns separately; the texture is square.
    return uv * np.array([width, height]) / max(width, height), corners, vertex


def atlas_at_density(
    vertices: Array, faces: Array, density: float, *, padding: int = 4, most: int = 8192
) -> tuple[Array, Array, Array, tuple[int, int]]:
    """Return charts as `atlas` does, but u and v each in [0, 1], with the texture's rows and columns.

    Parameters
    ----------
    vertices, faces : (N, 3), (F, 3) arrays
    density : float
        Texels per unit of length.
    padding : int
        Texels between charts.
    most : int
        Most rows and columns; the density is lowered where it would need more.

    Raises
    ------
    InputError
        If xatlas gives positions that are not finite.
    """
    area = doubled_areas(vertices, faces).sum() / 2
    # A third of the texture may be left empty between charts.
    density = min(density, most / np.sqrt(1.5 * max(area, 1e-300)))
    while True:
        made = _generated(vertices, faces, density=density, padding=padding)
        size = max(made[3])
        if size <= most:
            return made
        density *= 0.95 * most / size


def _generated(
    vertices: Array, faces: Array, *, texels: int = 0, density: float | None = None, padding: int
) -> tuple[Array, Array, Array, tuple[int, int]]:
    """Return positions (N', 2) in [0, 1]^2, faces on them, their vertices, and the rows and columns that xatlas chose."""
    import xatlas

    center = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    edges = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
    # xatlas treats triangles below a fixed size as degenerate, so the typical edge is scaled to 1.
    unit = float(np.median(np.linalg.norm(edges, axis=2)))
    made = xatlas.Atlas()
    made.add_mesh(np.ascontiguousarray((vertices - center) / unit, np.float32), np.ascontiguousarray(faces, np.uint32))
    options = xatlas.PackOptions()
    options.resolution, options.padding, options.bilinear = texels, padding, True
    if density is not None:
        options.texels_per_unit = density * unit
    made.generate(pack_options=options)
    vertex, corners, uv = made[0]
    uv = np.asarray(uv, np.float64)
    if not np.isfinite(uv).all():
        raise InputError("xatlas found no charts for this mesh; check it for needles and for faces of very different size")
    size = (int(made.height), int(made.width))
    return uv, np.asarray(corners).astype(np.int32), np.asarray(vertex).astype(np.int32), size
