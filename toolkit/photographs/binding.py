"""Which photographs see which vertices (Rocchini et al. 1999; Yamauchi et al. 2005, section 4.1)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from intaglio.arrays import Array, Progress
from intaglio.checks import check_fields, checked_arguments, checked_faces
from intaglio.devices import device_or_error
from intaglio.errors import InputError, IntaglioWarning
from intaglio.kernels.pictures import Picture
from intaglio.kernels.surface_views import SurfaceViews
from intaglio.kernels.transfer import decode_srgb, encode_srgb
from intaglio.mesh import Surface, unique_edges, used_vertices, vertex_normals
from intaglio.photographs.camera import Camera, Photograph

# Distance from the background's colour, of display values, within which a vertex lies on it.
BACKGROUND_THRESHOLD = 0.06

# Degrees between normal and line of sight from which a vertex is not seen well enough.
GRAZING = 80.0

# Share of a photograph's border that must have one colour for that to be taken as its background.
_PLAIN_BORDER = 0.8

# Nothing nearer than this hides a vertex, in units of the typical edge, since its own faces touch it.
_CLEARANCE = 0.01


@dataclass(frozen=True)
class Binding:
    """Which of P photographs see which of N vertices, and in what colour.

    Attributes
    ----------
    valid : (P, N) bool array
        The valid photographs of each vertex (Yamauchi et al. 2005, section 4.1).
    cosine : (P, N) float32 array
        Cosines <N, V> of the angle between the vertex normal and the direction to the camera.
    pixel : (P, N, 2) float32 array
        Position x, y of the vertex in the photograph, in pixels; without meaning where the photograph is not valid.
    color : (P, N, 3) float32 array
        Linear colour of the photograph there; 0 where it is not valid.
    names : tuple of str
        Names of the photographs.
    notes : tuple of str
        What was noticed, as sentences for the user.

    See Also
    --------
    intaglio.bind_photographs : Computes it.

    References
    ----------
    Yamauchi, Lensch, Haber & Seidel, "Textures Revisited", The Visual Computer 21, 2005, section 4.1.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    >>> camera = intaglio.Camera(K=[[16, 0, 15.5], [0, 16, 15.5], [0, 0, 1]], R=np.diag([1.0, -1, -1]), t=[0, 0, 2])
    >>> picture = np.zeros((32, 32, 3)) + [0.5, 0.3, 0.2]
    >>> front = intaglio.Photograph(camera=camera, picture=picture, name="front")
    >>> binding = intaglio.bind_photographs(square, [front], background=None, device="cpu")
    >>> binding.valid
    array([[ True,  True,  True,  True]])
    """

    valid: Array
    cosine: Array
    pixel: Array
    color: Array
    names: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self)

    @checked_arguments
    def common(self, faces: Array) -> Array:
        """Return which photographs are valid for all corners of each face.

        Parameters
        ----------
        faces : (F, 3) int array
            The surface's triangles.

        Returns
        -------
        (P, F) bool array
            True if the photograph is valid for all three corners.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
        >>> camera = intaglio.Camera(K=[[16, 0, 15.5], [0, 16, 15.5], [0, 0, 1]], R=np.diag([1.0, -1, -1]), t=[0, 0, 2])
        >>> picture = np.zeros((32, 32, 3)) + [0.5, 0.3, 0.2]
        >>> front = intaglio.Photograph(camera=camera, picture=picture, name="front")
        >>> binding = intaglio.bind_photographs(square, [front], background=None, device="cpu")
        >>> binding.common(square.faces)
        array([[ True,  True]])
        """
        faces = checked_faces("faces", faces, self.valid.shape[1])
        a, b, c = (self.valid[:, faces[:, k]] for k in range(3))
        return np.asarray(a & b & c)

    @checked_arguments
    def triangle_class(self, faces: Array) -> Array:
        """Return the class of each face by the photographs of its corners.

        Parameters
        ----------
        faces : (F, 3) int array
            The surface's triangles.

        Returns
        -------
        (F,) uint8 array
            1: a photograph is valid for all three corners; 2: all corners have valid photographs, but none in common; 3: a
            corner has none.

        References
        ----------
        Yamauchi, Lensch, Haber & Seidel, "Textures Revisited", The Visual Computer 21, 2005, section 4.1.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
        >>> camera = intaglio.Camera(K=[[16, 0, 15.5], [0, 16, 15.5], [0, 0, 1]], R=np.diag([1.0, -1, -1]), t=[0, 0, 2])
        >>> picture = np.zeros((32, 32, 3)) + [0.5, 0.3, 0.2]
        >>> front = intaglio.Photograph(camera=camera, picture=picture, name="front")
        >>> binding = intaglio.bind_photographs(square, [front], background=None, device="cpu")
        >>> binding.triangle_class(square.faces)
        array([1, 1], dtype=uint8)
        """
        faces = checked_faces("faces", faces, self.valid.shape[1])
        bound = np.asarray(self.valid.any(axis=0))[faces].all(axis=1)
        return np.where(self.common(faces).any(axis=0), 1, np.where(bound, 2, 3)).astype(np.uint8)


@checked_arguments
def bind_photographs(
    surface: Surface,
    photographs: Sequence[Photograph],
    *,
    background: str | ArrayLike | None = "auto",
    background_threshold: float = BACKGROUND_THRESHOLD,
    grazing: float = GRAZING,
    device: str | None = None,
    progress: Progress | None = None,
) -> Binding:
    """Find, for every vertex, the photographs that show it.

    A photograph is valid for a vertex if the vertex lies in it, faces the camera, is not on the silhouette (all its faces are
    turned to the camera), is not hidden by the surface, and does not have the colour of the photograph's background.

    Parameters
    ----------
    surface : Surface
        The surface that the photographs show; it must have faces.
    photographs : sequence of Photograph
        At least one, each with its own name.
    background : "auto", (3,) array or None, optional
        Linear colour behind the object. ``"auto"`` takes the colour of a photograph's border if nearly all of it has one
        colour; None compares nothing. The alpha channel of a photograph takes precedence.
    background_threshold : float, optional
        Distance of display values, above 0 up to 2, within which a vertex is on the background. The colour of a vertex is the
        median of 3 x 3 pixels, smoothed by a 3 x 3 Gaussian.
    grazing : float, optional
        Degrees between normal and line of sight, above 0 up to 90, from which a vertex is not seen well enough.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the photographs done and all.

    Returns
    -------
    Binding
        ``.valid`` (P, N) says which photographs show which vertices, ``.color`` (P, N, 3) in what colour.

    Raises
    ------
    InputError
        If there are no photographs, one does not fit its calibration, or none shows any of the surface.

    Warns
    -----
    IntaglioWarning
        For photographs that show nothing of the surface; they are left without valid vertices.

    See Also
    --------
    intaglio.combine_photographs : Makes a texture of the bound photographs.

    References
    ----------
    Yamauchi et al., "Textures Revisited", The Visual Computer 21, 2005, section 4.1. Rocchini et al., "Multiple Textures
    Stitching and Blending on 3D Objects", Eurographics Workshop on Rendering 1999.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:3, :3] / 2.0
    >>> vertices = np.stack([x, y, 0 * x], axis=2).reshape(-1, 3)
    >>> corner = (np.arange(2)[:, None] * 3 + np.arange(2)).reshape(-1, 1)
    >>> square = intaglio.Surface(vertices=vertices, faces=np.concatenate([corner + [0, 1, 4], corner + [0, 4, 3]]))
    >>> turn = np.diag([1.0, -1.0, -1.0])
    >>> camera = intaglio.Camera(K=[[60, 0, 40], [0, 60, 40], [0, 0, 1]], R=turn, t=-turn @ [0.5, 0.5, 1.2])
    >>> photograph = intaglio.Photograph(camera=camera, picture=np.full((80, 80, 3), 0.5, np.float32), name="above")
    >>> binding = intaglio.bind_photographs(square, [photograph], background=None, device="cpu")
    >>> binding.names, bool(binding.valid.all())
    (('above',), True)
    """
    photographs = checked_photographs("photographs", photographs)
    for name, value, most in (("grazing", grazing, 90), ("background_threshold", background_threshold, 2)):
        if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0 < value <= most:
            raise InputError(f"{name} must be a number above 0, up to {most}, not {value!r}")
    if not isinstance(surface, Surface):
        raise InputError(f"surface must be a Surface (read_surface gives one), not {type(surface).__name__}")
    chosen = device_or_error(device)
    if len(surface.faces) == 0:
        raise InputError("the surface has no faces; photographs can't be bound to points alone")
    normal = vertex_normals(surface.vertices, surface.faces)
    views = SurfaceViews(surface.vertices, normal, surface.faces, chosen)
    used = used_vertices(surface.faces, len(surface.vertices))
    edges = unique_edges(surface.faces)
    typical = float(np.median(np.linalg.norm(surface.vertices[edges[:, 0]] - surface.vertices[edges[:, 1]], axis=1)))
    corner = surface.vertices[surface.faces]
    facet = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    count = len(surface.vertices)
    shape = (len(photographs), count)
    valid, cosine = np.zeros(shape, bool), np.zeros(shape, np.float32)
    pixel, color = np.zeros((*shape, 2), np.float32), np.zeros((*shape, 3), np.float32)
    notes = []
    for i, photograph in enumerate(photographs):
        camera = photograph.camera
        image, mask = photograph.read()
        way = camera.center - surface.vertices
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-300)
        cosine[i] = np.einsum("ij,ij->i", normal, way)
        away = np.einsum("ij,ij->i", facet, camera.center - corner[:, 0]) <= 0
        silhouette = np.zeros(count, bool)
        silhouette[surface.faces[away]] = True
        height, width = image.shape[:2]
        pinhole = views.pinhole(camera.K, camera.R, camera.t, camera.lens, camera.reach)
        at, seen = views.visible(pinhole, (width, height), _CLEARANCE * typical)
        pixel[i] = at
        found = seen & used & ~silhouette & (cosine[i] > max(np.cos(np.radians(grazing)), 1e-6))
        if mask is not None:
            spot = np.rint(at[found]).astype(int)
            found[found] = mask[np.clip(spot[:, 1], 0, height - 1), np.clip(spot[:, 0], 0, width - 1)]
        else:
            behind = _background(image, background)
            if behind is not None and found.any():
                distance = np.linalg.norm(_denoise(image, at[found]) - encode_srgb(behind), axis=1)
                on_it = distance <= background_threshold
                found[found] = ~on_it
                if on_it.any():
                    notes.append(f"{photograph.name}: {int(on_it.sum())} vertices fall on the background's colour")
        if not found.any():
            warnings.warn(
                f"{photograph.name}: shows nothing of the mesh (does its camera look away? is all background?); it is left out",
                IntaglioWarning,
                stacklevel=3,
            )
            notes.append(f"{photograph.name}: shows nothing of the mesh, left out")
        else:
            valid[i] = found
            which = np.flatnonzero(found)
            spacing = 0.5 * typical * _pixels_per_unit(camera.K, way[which], camera.center - surface.vertices[which])
            color[i, which] = views.colors(Picture.of(image, chosen), at[which], spacing)
        if progress is not None:
            progress(i + 1, len(photographs))
    if not valid.any():
        raise InputError(
            f"none of the {len(photographs)} photographs shows any of the mesh: are cameras and mesh in the same coordinates? "
            "If they are, everything seen counted as background (background=None, --background none compares nothing), or as "
            f"seen at more than grazing={grazing:g} degrees"
        )
    return Binding(valid, cosine, pixel, color, tuple(p.name for p in photographs), tuple(notes))


def checked_photographs(name: str, value: Any) -> list[Photograph]:
    """Return a list of at least one photograph, or raise `InputError`."""
    if isinstance(value, Photograph):
        value = [value]
    try:
        found = list(value)
    except TypeError:
        raise InputError(f"{name} must be a sequence of Photograph objects, not {type(value).__name__}") from None
    if not found:
        raise InputError(f"there are no {name}; give at least one")
    for one in found:
        if not isinstance(one, Photograph):
            raise InputError(f"{name} must be Photograph objects (read_photographs gives them), not {type(one).__name__}")
        if not isinstance(one.camera, Camera):
            raise InputError(f"{one.name}: its camera must be a Camera, not {type(one.camera).__name__}")
    names = [one.name for one in found]
    if len(set(names)) < len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise InputError(f"several photographs are named {twice!r}; give each its own name")
    return found


def _pixels_per_unit(matrix: Array, way: Array, to_camera: Array) -> Array:
    """Return how many pixels a length of 1 across the line of sight has at each vertex."""
    distance = np.linalg.norm(to_camera, axis=1)
    return np.asarray(np.sqrt(matrix[0, 0] * matrix[1, 1]) / np.maximum(distance, 1e-300))


def _background(image: Array, background: str | ArrayLike | None) -> Array | None:
    """Return the linear colour of what is behind the object, or None."""
    if background is None:
        return None
    if isinstance(background, str):
        if background != "auto":
            raise InputError(f"background must be 'auto', a colour or None, not {background!r}")
        border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
        shown = encode_srgb(border)
        middle = np.median(shown, axis=0)
        plain = np.linalg.norm(shown - middle, axis=1) <= BACKGROUND_THRESHOLD
        return decode_srgb(middle) if plain.mean() >= _PLAIN_BORDER else None
    try:
        color = np.asarray(background, np.float32).reshape(-1)
    except (TypeError, ValueError):
        color = np.zeros(0, np.float32)
    if color.shape != (3,) or not np.isfinite(color).all():
        raise InputError(f"background must be 'auto', three linear values or None, not {background!r}")
    return color


def _denoise(image: Array, pixel: Array) -> Array:
    """Return display colours (M, 3) at pixels: medians of 3 x 3, under a 3 x 3 Gaussian (1 2 1)."""
    height, width = image.shape[:2]
    step = np.arange(-2, 3)
    spot = np.rint(pixel).astype(int)
    rows = np.clip(spot[:, 1, None] + step, 0, height - 1)
    columns = np.clip(spot[:, 0, None] + step, 0, width - 1)
    around = encode_srgb(image[rows[:, :, None], columns[:, None, :]])
    weight = np.outer([1, 2, 1], [1, 2, 1]) / 16.0
    total = np.zeros((len(pixel), 3))
    for j in range(3):
        for i in range(3):
            window = around[:, j : j + 3, i : i + 3].reshape(len(pixel), 9, 3)
            total += weight[j, i] * np.median(window, axis=1)
    return total
