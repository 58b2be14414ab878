"""Several charts, from xatlas, for surfaces that can't be laid flat as one."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError


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
    import xatlas

    center = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    edges = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
    # xatlas treats triangles below a fixed size as degenerate, so the typical edge is scaled to 1.
    unit = float(np.median(np.linalg.norm(edges, axis=2)))
    made = xatlas.Atlas()
    made.add_mesh(np.ascontiguousarray((vertices - center) / unit, np.float32), np.ascontiguousarray(faces, np.uint32))
    options = xatlas.PackOptions()
    options.resolution, options.padding, options.bilinear = texels, padding, True
    made.generate(pack_options=options)
    vertex, corners, uv = made[0]
    uv = np.asarray(uv, np.float64)
    # xatlas scales rows and columns separately; the texture is square.
    uv = uv * np.array([made.width, made.height]) / max(made.width, made.height)
    if not np.isfinite(uv).all():
        raise InputError("xatlas found no charts for this mesh; check it for needles and for faces of very different size")
    return uv, np.asarray(corners).astype(np.int32), np.asarray(vertex).astype(np.int32)
