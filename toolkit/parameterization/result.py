"""The result of a parameterization, and its figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_faces, checked_shape
from intaglio.errors import InputError
from intaglio.mesh import Surface, pieces
from intaglio.parameterization.charts import doubled_areas, doubled_texture_areas, flat_edges, invert_matrices, squared_stretches


@dataclass(frozen=True)
class Parameterization:
    """Texture positions of a surface's vertices, in one chart or several.

    Attributes
    ----------
    uv : (N', 2) float64 array
        Texture positions in [0, 1]^2, u to the right, v up. If nothing was cut, those of the vertices in their order.
    faces : (F, 3) int32 array
        The surface's faces, as indices into ``uv``.
    vertex : (N',) int32 array
        The surface's vertex that each position belongs to.
    chart : (F,) int32 array
        Number of the chart that each face lies in, from 0.
    l2_stretch, linf_stretch : float
        Root mean square and largest stretch, times the root of texture area over surface area: 1 is the optimum.
    flips : int
        Number of triangles that are turned over against the rest of their chart.
    shape_ratio : (F,) float64 array
        Height over longest side of each triangle in the texture.
    face_stretch : (F,) float64 array
        L2 stretch of each triangle, normalised likewise.
    notes : tuple of str
        What was done on the way, as sentences for the user.

    Raises
    ------
    InputError
        If an array is of another type or shape, or holds what is no number of a vertex or chart.

    See Also
    --------
    intaglio.parameterize : Computes it.

    References
    ----------
    Sander, Snyder, Gortler & Hoppe, "Texture Mapping Progressive Meshes", SIGGRAPH 2001: stretch.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    >>> flat = intaglio.parameterize(square, device="cpu")
    >>> flat.uv.shape, flat.flips, round(flat.l2_stretch, 3)
    ((4, 2), 0, 1.0)
    """

    uv: Array
    faces: Array
    vertex: Array
    chart: Array
    l2_stretch: float
    linf_stretch: float
    flips: int
    shape_ratio: Array
    face_stretch: Array
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self)
        uv = checked_shape("uv", self.uv, np.float64, (None, 2), finite=True)
        faces = checked_faces("faces", self.faces, len(uv))
        for name, value in (
            ("uv", uv),
            ("faces", faces),
            ("vertex", checked_shape("vertex", self.vertex, np.int32, (len(uv),))),
            ("chart", checked_shape("chart", self.chart, np.int32, (len(faces),))),
            ("shape_ratio", checked_shape("shape_ratio", self.shape_ratio, np.float64, (len(faces),))),
            ("face_stretch", checked_shape("face_stretch", self.face_stretch, np.float64, (len(faces),))),
        ):
            object.__setattr__(self, name, value)
        for name, numbers in (("vertex", self.vertex), ("chart", self.chart)):
            if numbers.min(initial=0) < 0:
                raise InputError(f"{name} must hold numbers from 0, not {numbers.min()}")

    @property
    def charts(self) -> int:
        """Number of charts.

        Returns
        -------
        int
            At least 1.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
        >>> intaglio.parameterize(square, device="cpu").charts
        1
        """
        return int(self.chart.max()) + 1

    @property
    def cut(self) -> bool:
        """Whether some vertices have several positions in the texture.

        Returns
        -------
        bool
            True if the surface was cut.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
        >>> intaglio.parameterize(square, device="cpu").cut
        False
        """
        return len(np.unique(self.vertex)) < len(self.vertex)


def measure_parameterization(
    surface: Surface, uv: Array, faces: Array, vertex: Array, notes: tuple[str, ...]
) -> Parameterization:
    """Return the parameterization with the measures of its distortion."""
    _, piece = pieces(faces, len(uv))
    _, chart = np.unique(piece[faces[:, 0]], return_inverse=True)
    chart = chart.reshape(-1)
    area = doubled_areas(surface.vertices, surface.faces)
    signed = doubled_texture_areas(uv, faces)
    charts = int(chart.max()) + 1
    # Atlases mirror whole charts; a flip is a triangle turned against its own chart.
    handed = np.where(np.bincount(chart, np.sign(signed), charts) < 0, -1.0, 1.0)
    flips = int((signed * handed[chart] <= 0).sum())
    rest = invert_matrices(flat_edges(surface.vertices, surface.faces))
    squared = squared_stretches(uv, faces, rest)
    scale = float(np.abs(signed).sum() / area.sum())
    a, b, c = (uv[faces[:, k]] for k in range(3))
    jacobian = np.stack([b - a, c - a], axis=2) @ rest
    norm = np.sum(jacobian**2, axis=(1, 2))
    det = np.abs(signed) / area
    least = np.sqrt(np.maximum((norm - np.sqrt(np.maximum(norm**2 - 4 * det**2, 0))) / 2, 0))
    thinnest = float(least.min())
    longest = np.max([np.sum((p - q) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return Parameterization(
        uv=uv,
        faces=faces,
        vertex=vertex,
        chart=chart.astype(np.int32),
        l2_stretch=float(np.sqrt((area * squared).sum() / area.sum() * scale)),
        linf_stretch=float(np.sqrt(scale)) / thinnest if thinnest > 0 else np.inf,
        flips=flips,
        shape_ratio=np.abs(signed) / np.maximum(longest, 1e-300),
        face_stretch=np.sqrt(squared * scale),
        notes=notes,
    )
