"""One texture from several photographs (Yamauchi et al. 2005, section 4)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_arguments, checked_choice, checked_size
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.pictures import Picture
from intaglio.kernels.pull_push import continue_image
from intaglio.kernels.surface_views import SurfaceViews
from intaglio.kernels.texels import rasterize
from intaglio.mesh import Surface, pieces, vertex_normals
from intaglio.parameterization import Parameterization
from intaglio.photographs.binding import BACKGROUND_THRESHOLD, GRAZING, Binding, bind_photographs, checked_photographs
from intaglio.photographs.blend import ChartBlend
from intaglio.photographs.camera import Photograph
from intaglio.photographs.exposure import exposure_gains
from intaglio.photographs.seam_levelling import level_seams
from intaglio.photographs.selection import choose_photographs, shrink_regions
from intaglio.photographs.texture import Texture
from intaglio.photographs.vertex_colors import mean_vertex_colors, spread_colors

_MOST_TEXELS = 16384

# The most photographs that the coverage of a texel names.
_NAMED = 4


@checked_arguments
def combine_photographs(
    surface: Surface,
    uv: Parameterization | Array,
    photographs: Sequence[Photograph],
    size: int | tuple[int, int],
    *,
    select: str = "best",
    blend: str = "spline",
    exposure: bool = True,
    binding: Binding | None = None,
    background: str | ArrayLike | None = "auto",
    background_threshold: float = BACKGROUND_THRESHOLD,
    grazing: float = GRAZING,
    device: str | None = None,
    progress: Progress | None = None,
) -> Texture:
    """Make one texture of a surface from registered photographs.

    Each texel of a face whose corners have a photograph in common (class one) takes its colour from photographs, sampled over
    the texel's own footprint. Faces whose corners have photographs but none in common (class two) and those with unseen
    corners (class three) take colours interpolated between vertices, and are not ``known``.

    Parameters
    ----------
    surface : Surface
        The surface that the photographs show.
    uv : Parameterization, (N, 2) or (F, 3, 2) array
        Texture positions of the vertices or of the corners of the faces, in [0, 1]^2.
    photographs : sequence of Photograph
        At least one, each with its own name.
    size : int or (int, int)
        Rows and columns of the texture in texels, 16 to 16384; one number makes a square.
    select : {"best", "average"}, optional
        "best" takes the detail of each face from the photograph that shows it with most pixels, mixed only near the borders
        between photographs; with the spline, structures broader than some eight texels come from all. "average" mixes all
        photographs that see a face, weighted by <N, V>, as published; it blurs what is not registered to the pixel.
    blend : {"spline", "none"}, optional
        The multiresolution spline over masks that are shrunk by one ring of faces, which leaves no visible borders; or plain
        borders.
    exposure : bool, optional
        Factor out differences of exposure and white balance first.
    binding : Binding, optional
        From `bind_photographs`. Default None: made here, with the next three options, which can't be given with a binding.
    background : "auto", (3,) array or None, optional
        Linear colour behind the object; see `bind_photographs`.
    background_threshold : float, optional
        Distance of display values within which a vertex is on the background; see `bind_photographs`.
    grazing : float, optional
        Degrees between normal and line of sight from which a vertex is not seen well enough; see `bind_photographs`.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the photographs done and all; each counts once for binding, unless one is given, and once for sampling.

    Returns
    -------
    Texture
        ``.known`` marks the texels that were photographed, ``.photograph`` and ``.weight`` say from which photographs.

    Raises
    ------
    InputError
        For positions outside [0, 1]^2, a size out of range, photographs that don't fit their calibration, a binding of other
        photographs or another surface, or if no texel is seen.

    See Also
    --------
    intaglio.parameterize : Gives ``uv``.
    intaglio.restore_texture : Fills the texels that no photograph shows.

    References
    ----------
    Yamauchi et al., "Textures Revisited", The Visual Computer 21, 2005, section 4. Burt & Adelson, "A Multiresolution Spline
    with Application to Image Mosaics", ACM TOG 2(4), 1983. Heckbert, "Fundamentals of Texture Mapping and Image Warping",
    Master's thesis, UC Berkeley 1989: footprints.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:9, :9] / 8.0
    >>> vertices = np.stack([x, y, 0 * x], axis=2).reshape(-1, 3)
    >>> corner = (np.arange(8)[:, None] * 9 + np.arange(8)).reshape(-1, 1)
    >>> faces = np.concatenate([corner + [0, 1, 10], corner + [0, 10, 9]])
    >>> square = intaglio.Surface(vertices=vertices, faces=faces)
    >>> turn = np.diag([1.0, -1.0, -1.0])
    >>> camera = intaglio.Camera(K=[[60, 0, 40], [0, 60, 40], [0, 0, 1]], R=turn, t=-turn @ [0.5, 0.5, 1.2])
    >>> picture = np.zeros((80, 80, 3), np.float32) + np.float32([0.2, 0.5, 0.3])
    >>> photograph = intaglio.Photograph(camera=camera, picture=picture)
    >>> made = intaglio.combine_photographs(square, vertices[:, :2], [photograph], 32, background=None, device="cpu")
    >>> bool(np.allclose(made.image[made.known], [0.2, 0.5, 0.3], atol=1e-4))
    True
    """
    photographs = checked_photographs("photographs", photographs)
    checked_choice("select", select, ("best", "average"))
    checked_choice("blend", blend, ("spline", "none"))
    if not isinstance(surface, Surface):
        raise InputError(f"surface must be a Surface (read_surface gives one), not {type(surface).__name__}")
    if binding is not None and not isinstance(binding, Binding):
        raise InputError(f"binding must come from bind_photographs, it is a {type(binding).__name__}")
    chosen = device_or_error(device)
    height, width = checked_size("size", size)
    if not (16 <= height <= _MOST_TEXELS and 16 <= width <= _MOST_TEXELS):
        raise InputError(f"size must be from 16 to {_MOST_TEXELS} texels a side, not {height} x {width}")
    positions, corners = texture_corners(surface, uv)
    total = len(photographs) * (1 if binding is not None else 2)
    if binding is None:
        binding = bind_photographs(
            surface,
            photographs,
            background=background,
            background_threshold=background_threshold,
            grazing=grazing,
            device=chosen,
            progress=None if progress is None else lambda done, _: progress(done, total),
        )
    elif not isinstance(background, str) or (background, background_threshold, grazing) != (
        "auto",
        BACKGROUND_THRESHOLD,
        GRAZING,
    ):
        raise InputError(
            "background, background_threshold and grazing are options of a new binding; leave them out with a binding"
        )
    if binding.valid.shape != (len(photographs), len(surface.vertices)):
        raise InputError(
            f"the binding is for {binding.valid.shape[0]} photographs and {binding.valid.shape[1]} vertices, "
            f"not {len(photographs)} and {len(surface.vertices)}"
        )
    common = binding.common(surface.faces)
    if not common.any():
        raise InputError("no face is seen whole by any photograph: every texel would be made up")
    gains = exposure_gains(binding) if exposure else np.ones((len(photographs), 3))
    face, weight = rasterize(positions, corners, height, width, chosen)
    inside = face >= 0
    if not inside.any():
        raise InputError(f"no texel's centre lies on the surface at {height} x {width}; give a larger size")
    views = SurfaceViews(surface.vertices, vertex_normals(surface.vertices, surface.faces), surface.faces, chosen)
    sampler = views.texels(face, weight, positions, corners, surface.vertices, surface.faces)

    # Faces that lose all photographs by shrinking keep those that see them.
    inner = shrink_regions(common, surface.faces, len(surface.vertices))
    used = np.where(inner.any(axis=0), inner, common) if blend == "spline" else common
    if select == "best":
        label = choose_photographs(binding, surface.faces, used)
    chart = np.where(inside, _charts(corners, len(positions))[face] + 1, 0).astype(np.int32)
    spline = ChartBlend(chart, chosen) if blend == "spline" else None
    coverage = _Coverage((height, width), min(_NAMED, len(photographs)))
    image, weights = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32)
    for i, photograph in enumerate(photographs):
        if common[i].any():
            picture = Picture.of(photograph.read()[0], chosen)
            camera = photograph.camera
            pinhole = views.pinhole(camera.K, camera.R, camera.t, camera.lens, camera.reach)
            sampled = sampler.sample(pinhole, picture, common[i], gains[i])
            facing = np.ascontiguousarray(sampled[:, :, 3])
            defined = facing > 0
            mask = (label == i)[face] & defined if select == "best" else facing * used[i][face]
            mask = (mask * inside).astype(np.float32)
            weights += mask
            coverage.add(i, mask)
            image += sampled[:, :, :3] * mask[:, :, None]
            if spline is not None:
                # Detail comes from one photograph and broader structures from all, which evens out their different light.
                spline.add(sampled[:, :, :3], defined, mask, facing * used[i][face] if select == "best" else None)
        if progress is not None:
            progress(total - len(photographs) + i + 1, total)
    known = weights > 0
    image /= np.maximum(weights, 1e-12)[:, :, None]
    at_vertices = spread_colors(*mean_vertex_colors(binding, gains), surface.faces).astype(np.float32)
    _interpolate(image, inside & ~known, face, weight, at_vertices, surface.faces)
    if spline is not None:
        # One more mask (section 4.2): the complement of all others, with the interpolated colours.
        spline.add(image, inside & ~known, (inside & ~known).astype(np.float32))
        blended = spline.result()
        shown = _face_colors(label, binding, gains, at_vertices, surface.faces) if select == "best" else None
        image = level_seams(blended, blended - image, inside, surface, positions, corners, face, weight, shown)
    notes = [*binding.notes]
    classes = np.bincount(binding.triangle_class(surface.faces), minlength=4)
    notes.append(f"faces: {classes[1]} seen whole by a photograph, {classes[2]} in parts, {classes[3]} with unseen corners")
    return Texture(
        image=continue_image(image, inside, chosen),
        known=known,
        chart=chart,
        photograph=coverage.photograph,
        weight=coverage.shares(),
        names=binding.names,
        gains=gains,
        notes=tuple(notes),
    )


class _Coverage:
    """The strongest photographs of each texel, updated for one photograph after the other."""

    def __init__(self, shape: tuple[int, int], most: int) -> None:
        self.photograph = np.full((*shape, most), -1, np.int16)
        self.weight = np.zeros((*shape, most), np.float16)

    def add(self, number: int, weight: Array) -> None:
        """Count ``weight`` (H, W) for a photograph."""
        weight = weight.astype(np.float16)
        which = np.where(weight > 0, np.int16(number), np.int16(-1))
        for slot in range(self.photograph.shape[2]):
            held, name = self.weight[:, :, slot], self.photograph[:, :, slot]
            stronger = weight > held
            weight[stronger], held[stronger] = held[stronger], weight[stronger]
            which[stronger], name[stronger] = name[stronger], which[stronger]

    def shares(self) -> Array:
        """Return weights that add up to 1, where there are any."""
        total = self.weight.sum(axis=2, keepdims=True, dtype=np.float32)
        return np.where(total > 0, self.weight / np.maximum(total, 1e-12), 0).astype(np.float16)


def texture_corners(surface: Surface, uv: Parameterization | Array) -> tuple[Array, Array]:
    """Return texture positions (M, 2) and the faces' corners among them (F, 3), of any form that ``uv`` may have.

    Raises
    ------
    InputError
        If they don't belong to the surface, or are outside [0, 1]^2.
    """
    if isinstance(uv, Parameterization):
        positions, corners = uv.uv, uv.faces
    else:
        try:
            positions = np.asarray(uv, np.float64)
        except (TypeError, ValueError) as problem:
            raise InputError(f"uv is not an array of numbers ({problem})") from problem
        corners = surface.faces
        if positions.shape == (len(surface.faces), 3, 2):
            positions, corners = positions.reshape(-1, 2), np.arange(3 * len(surface.faces)).reshape(-1, 3)
        elif positions.shape != (len(surface.vertices), 2):
            raise InputError(
                f"uv must be (N, 2) for the {len(surface.vertices)} vertices or (F, 3, 2) for the {len(surface.faces)} faces, "
                f"not {positions.shape}"
            )
    if len(corners) != len(surface.faces):
        raise InputError(f"the parameterization has {len(corners)} faces, the surface {len(surface.faces)}")
    used = positions[np.unique(corners)]
    if not np.isfinite(used).all() or used.min() < -1e-6 or used.max() > 1 + 1e-6:
        raise InputError(f"uv must be finite and in [0, 1]; it reaches from {used.min():.4g} to {used.max():.4g}")
    return positions, corners


def _face_colors(label: Array, binding: Binding, gains: Array, at_vertices: Array, faces: Array) -> Array:
    """Return the colour (F, 3, 3) that each face's photograph shows at its corners; the interpolated one where it has none."""
    color = at_vertices[faces].astype(np.float64)
    for number in range(len(binding.names)):
        own = label == number
        color[own] = binding.color[number][faces[own]] * gains[number]
    return color


def _charts(corners: Array, count: int) -> Array:
    """Return the number of each face's chart, (F,): its connected piece of the texture."""
    _, piece = pieces(corners, count)
    return np.asarray(np.unique(piece[corners[:, 0]], return_inverse=True)[1].reshape(-1))


def _interpolate(image: Array, where: Array, face: Array, weight: Array, colors: Array, faces: Array) -> None:
    """Write to texels the colours of their face's corners, interpolated."""
    at = np.flatnonzero(where)
    corner = faces[face.reshape(-1)[at]]
    w = weight.reshape(-1, 2)[at]
    third = 1 - w.sum(axis=1)
    image.reshape(-1, 3)[at] = (
        w[:, :1] * colors[corner[:, 0]] + w[:, 1:] * colors[corner[:, 1]] + third[:, None] * colors[corner[:, 2]]
    )
