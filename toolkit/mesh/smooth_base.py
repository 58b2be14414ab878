"""A base of any shape: the scan's own smoothed surface, continued over its holes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments, checked_faces, checked_positive, checked_rows, checked_vectors
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.geodesics import nearest_on_mesh
from intaglio.mesh.base import Base, unit


@dataclass(frozen=True, kw_only=True)
class SmoothBase(Base):
    """Smooth triangulated surface as a base, for scans that no plane, cylinder or sphere carries.

    `complete_relief` with base "smooth" makes one from the scan.

    Parameters
    ----------
    inward : bool, optional
        Turn the normals round. Default False.
    fit : BaseFit or None, optional
        How well the base fits points. Default None: a smoothed surface is not fitted.
    vertices : (N, 3) float64 array
        Vertices in the input's unit of length.
    faces : (F, 3) int32 array
        Triangles.
    normals : (N, 3) float64 array
        Unit normals at the vertices; they are interpolated over the triangles.
    relief_scale : float
        Wavelength that divides relief from shape, in the input's unit: longer waves belong to the base.
    device : str or None, optional
        Where nearest points are searched: "cpu" or "cuda:0". Default None: CUDA if there is a GPU, else the CPU.

    Raises
    ------
    InputError
        If the arrays are no mesh with normals, the scale is not above 0, or the device does not exist.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[0.0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]])
    >>> up = np.tile([0.0, 0.0, 1.0], (4, 1))
    >>> faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    >>> ground = intaglio.SmoothBase(vertices=corners, faces=faces, normals=up, relief_scale=1.0, device="cpu")
    >>> ground.distance([[1.0, 2.0, 0.5], [3.0, 1.0, -0.25]])
    array([ 0.5 , -0.25])
    """

    kind: ClassVar[str] = "smooth"
    vertices: Array
    faces: Array
    normals: Array
    relief_scale: float
    device: str | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        check_fields(self)
        for name, value in (
            ("vertices", vertices := checked_rows("vertices", self.vertices, np.float64)),
            ("faces", checked_faces("faces", self.faces, len(vertices))),
            ("normals", checked_rows("normals", self.normals, np.float64, len(vertices))),
            ("relief_scale", checked_positive("relief_scale", self.relief_scale)),
        ):
            object.__setattr__(self, name, value)
        if len(self.faces) == 0:
            raise InputError("faces are missing; a smooth base needs at least one triangle")
        if self.device is not None:
            device_or_error(self.device)

    @checked_arguments
    def foot(self, points: Array) -> tuple[Array, Array]:
        """Return the nearest points on the surface and the interpolated unit normals there.

        Parameters
        ----------
        points : (N, 3) array
            Positions in the surface's unit of length.

        Returns
        -------
        foot : (N, 3) float64 array
            The nearest points on the triangles.
        normal : (N, 3) float64 array
            Unit normals, interpolated between those of the vertices and turned round if the base is ``inward``.

        Raises
        ------
        ValueError
            If the base's device does not exist.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
        >>> up = np.tile([0.0, 0.0, 1.0], (3, 1))
        >>> faces = np.array([[0, 1, 2]], np.int32)
        >>> ground = intaglio.SmoothBase(vertices=corners, faces=faces, normals=up, relief_scale=1.0, device="cpu")
        >>> foot, normal = ground.foot([[1.0, 1.0, 3.0]])
        >>> print(foot, normal)
        [[1. 1. 0.]] [[0. 0. 1.]]
        """
        face, weight = nearest_on_mesh(checked_vectors("points", points), self.vertices, self.faces, device_or_error(self.device))
        corner = self.faces[face]
        foot = np.einsum("ik,ikc->ic", weight, self.vertices[corner])
        return foot, unit(np.einsum("ik,ikc->ic", weight, self.normals[corner])) * self.orientation

    @property
    def kernel_parameters(self) -> tuple[int, Array, Array, float]:
        """Parameters in the form that the kernels take, of which only the kind has a meaning here.

        Returns
        -------
        kind : int
            3, a smoothed surface.
        origin : (3,) float64 array
            Zeros.
        axis : (3,) float64 array
            (0, 0, 1).
        radius : float
            0.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
        >>> up = np.tile([0.0, 0.0, 1.0], (3, 1))
        >>> faces = np.array([[0, 1, 2]], np.int32)
        >>> ground = intaglio.SmoothBase(vertices=corners, faces=faces, normals=up, relief_scale=1.0)
        >>> ground.kernel_parameters
        (3, array([0., 0., 0.]), array([0., 0., 1.]), 0.0)
        """
        return 3, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0

    @property
    def parameters(self) -> dict[str, object]:
        """Parameters of the base by name.

        Returns
        -------
        dict of str to object
            The float ``relief scale`` and, as text, the number of ``vertices``.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
        >>> up = np.tile([0.0, 0.0, 1.0], (3, 1))
        >>> faces = np.array([[0, 1, 2]], np.int32)
        >>> ground = intaglio.SmoothBase(vertices=corners, faces=faces, normals=up, relief_scale=1.0)
        >>> ground.parameters
        {'relief scale': 1.0, 'vertices': '3'}
        """
        return {"relief scale": self.relief_scale, "vertices": str(len(self.vertices))}
