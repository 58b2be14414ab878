"""A base of any shape: the scan's own smoothed surface, carried on over its holes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from intaglio.arrays import Array
from intaglio.kernels.geodesics import nearest_on_mesh
from intaglio.kernels.launch import choose_device
from intaglio.mesh.base import Base, unit


@dataclass(frozen=True, kw_only=True)
class SmoothBase(Base):
    """A smooth triangulated surface.

    Attributes
    ----------
    vertices : (N, 3) float64 array
    faces : (F, 3) int32 array
    normals : (N, 3) float64 array
        Unit vertex normals; between vertices they are interpolated.
    relief_scale : float
        Wave length that parts relief from shape, in the input's unit.
    device : str, optional
        Where nearest points are looked for; default CUDA if there is one.
    """

    kind: ClassVar[str] = "smooth"
    vertices: Array
    faces: Array
    normals: Array
    relief_scale: float
    device: str | None = field(default=None, compare=False)

    def foot(self, points: Array) -> tuple[Array, Array]:
        """See `Base.foot`."""
        face, weight = nearest_on_mesh(np.asarray(points, np.float64), self.vertices, self.faces, choose_device(self.device))
        corner = self.faces[face]
        foot = np.einsum("ik,ikc->ic", weight, self.vertices[corner])
        return foot, unit(np.einsum("ik,ikc->ic", weight, self.normals[corner])) * self.orientation

    @property
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """See `Base.kernel_parameters`."""
        return 3, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0

    @property
    def parameters(self) -> dict[str, object]:
        """See `Base.parameters`."""
        return {"relief scale": self.relief_scale, "vertices": str(len(self.vertices))}
