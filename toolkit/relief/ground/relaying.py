"""Laying a smooth base anew, through a scan and what fills it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh import SmoothBase, unit, vertex_normals
from intaglio.relief.ground.prepare import Ground
from intaglio.relief.ground.thin_plate import ThinPlate


def relaid(ground: Ground, vertices: Array, plate: ThinPlate, scale: float) -> Ground:
    """Return a ground whose smooth base goes through measured and filled vertices.

    Parameters
    ----------
    ground : Ground
        Over a smooth base.
    vertices : (N, 3) array
        All vertices, filled ones where they are now.
    plate : ThinPlate
        Over the ground's mesh.
    scale : float
        Wave length that the plate damps to a half, in the input's unit.
    """
    assert isinstance(ground.base, SmoothBase)
    smooth = plate.smooth(vertices)
    normal = vertex_normals(smooth, ground.faces)
    height = np.einsum("ij,ij->i", vertices - smooth, normal)
    foot = vertices - height[:, None] * normal
    u = unit(ground.u - np.einsum("ij,ij->i", ground.u, normal)[:, None] * normal)
    base = replace(ground.base, vertices=foot, normals=normal, relief_scale=scale)
    return replace(ground, vertices=vertices, base=base, foot=foot, normal=normal, u=u, v=np.cross(normal, u))
