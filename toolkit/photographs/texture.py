"""Texture: an image over a surface, and where each texel comes from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields
from intaglio.errors import InputError
from intaglio.mesh import Surface
from intaglio.parameterization import Parameterization


@dataclass(frozen=True)
class Texture:
    """Image over a surface, with the photographs from which each texel comes.

    Attributes
    ----------
    image : (H, W, 3) float32 array
        Linear Rec.709; row 0 is at v = 1. Texels outside the charts continue their borders.
    known : (H, W) bool array
        True where photographs show the surface; False where the colour was interpolated or restored, and outside the charts.
    chart : (H, W) int32 array
        Number of the chart that a texel lies in, from 1; 0 outside.
    photograph : (H, W, k) int16 array
        Numbers of the photographs from which a known texel is made, the strongest first; -1 for none.
    weight : (H, W, k) float16 array
        Shares of these photographs; they add up to 1, of the k strongest.
    names : tuple of str
        Names of the photographs.
    gains : (P, 3) float64 array
        Factors by which the photographs' exposures were made to agree, per channel.
    notes : tuple of str
        What was done on the way, as sentences for the user.

    See Also
    --------
    intaglio.combine_photographs : Makes it from photographs.
    intaglio.restore_texture : Fills the texels that no photograph shows.
    intaglio.write_textured : Writes it with its surface.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    >>> camera = intaglio.Camera(K=[[16, 0, 15.5], [0, 16, 15.5], [0, 0, 1]], R=np.diag([1.0, -1, -1]), t=[0, 0, 2])
    >>> picture = np.zeros((32, 32, 3)) + [0.5, 0.3, 0.2]
    >>> front = intaglio.Photograph(camera=camera, picture=picture, name="front")
    >>> flat = intaglio.parameterize(square, device="cpu")
    >>> texture = intaglio.combine_photographs(square, flat, [front], 16, background=None, device="cpu")
    >>> texture.image[8, 8].round(3), bool(texture.known[8, 8])
    (array([0.5, 0.3, 0.2], dtype=float32), True)
    """

    image: Array
    known: Array
    chart: Array
    photograph: Array
    weight: Array
    names: tuple[str, ...]
    gains: Array
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def inside(self) -> Array:
        """Which texels lie on the surface.

        Returns
        -------
        (H, W) bool array
            False outside the charts.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
        >>> camera = intaglio.Camera(K=[[16, 0, 15.5], [0, 16, 15.5], [0, 0, 1]], R=np.diag([1.0, -1, -1]), t=[0, 0, 2])
        >>> picture = np.zeros((32, 32, 3)) + [0.5, 0.3, 0.2]
        >>> front = intaglio.Photograph(camera=camera, picture=picture, name="front")
        >>> flat = intaglio.parameterize(square, device="cpu")
        >>> texture = intaglio.combine_photographs(square, flat, [front], 16, background=None, device="cpu")
        >>> int(texture.inside.sum())
        256
        """
        return np.asarray(self.chart > 0)

    @property
    def coverage(self) -> dict[str, float]:
        """Share of the surface's texels that each photograph contributes.

        Returns
        -------
        dict of str to float
            Shares from 0 to 1 by the name of the photograph.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
        >>> camera = intaglio.Camera(K=[[16, 0, 15.5], [0, 16, 15.5], [0, 0, 1]], R=np.diag([1.0, -1, -1]), t=[0, 0, 2])
        >>> picture = np.zeros((32, 32, 3)) + [0.5, 0.3, 0.2]
        >>> front = intaglio.Photograph(camera=camera, picture=picture, name="front")
        >>> flat = intaglio.parameterize(square, device="cpu")
        >>> intaglio.combine_photographs(square, flat, [front], 16, background=None, device="cpu").coverage
        {'front': 1.0}
        """
        texels = max(int(self.inside.sum()), 1)
        found = {}
        for number, name in enumerate(self.names):
            found[name] = float(np.where(self.photograph == number, self.weight, 0).sum(dtype=np.float64)) / texels
        return found


def checked_texture(name: str, value: Texture) -> Texture:
    """Return ``value``, or raise `InputError` if it is no Texture whose arrays are of one size."""
    if not isinstance(value, Texture):
        raise InputError(f"{name} must be a Texture (combine_photographs gives one), not {type(value).__name__}")
    shape = np.shape(value.image)
    if len(shape) != 3 or shape[2] != 3 or min(shape) < 1 or not np.issubdtype(np.asarray(value.image).dtype, np.floating):
        raise InputError(f"{name}: its image must be (H, W, 3) floats, not {shape}")
    if not np.isfinite(value.image).all():
        raise InputError(f"{name}: its image has values that are not finite")
    for part, dimensions, kinds in (("known", 2, "b"), ("chart", 2, "iu"), ("photograph", 3, "iu"), ("weight", 3, "f")):
        array = np.asarray(getattr(value, part))
        if array.shape[:2] != shape[:2] or array.ndim != dimensions or array.size == 0 or array.dtype.kind not in kinds:
            raise InputError(
                f"{name}: its {part} does not fit its image of {shape[0]} x {shape[1]} texels: {array.dtype} {array.shape}"
            )
    return value


def checked_layout(surface: Surface, uv: Parameterization) -> None:
    """Raise `InputError` if ``surface`` is no Surface, or ``uv`` no Parameterization of it."""
    if not isinstance(surface, Surface):
        raise InputError(f"surface must be a Surface (read_surface gives one), not {type(surface).__name__}")
    if not isinstance(uv, Parameterization):
        raise InputError(f"uv must come from parameterize, it is a {type(uv).__name__}")
    if len(uv.faces) != len(surface.faces) or len(uv.vertex) == 0 or int(uv.vertex.max()) >= len(surface.vertices):
        raise InputError("uv belongs to another surface: its faces or vertices are not those of this one")
