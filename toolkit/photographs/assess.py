"""How good a texture from photographs is: steps at the borders between photographs, and views that were not used for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments, checked_count, checked_finite, checked_mask
from intaglio.errors import InputError
from intaglio.kernels.transfer import encode_srgb
from intaglio.mesh import Surface
from intaglio.parameterization import Parameterization
from intaglio.photographs.binding import checked_photographs
from intaglio.photographs.camera import Camera, Photograph
from intaglio.photographs.texture import Texture, checked_layout, checked_texture
from intaglio.render import Comparison, compare, through_camera

# The width of the band along a border, in texels, whose own steps the step across is compared with.
_BESIDE = 6

# Pixels left out along the outline of the object, where a photograph also shows the background.
_OUTLINE = 3


@dataclass(frozen=True)
class ViewComparison:
    """Differences between a photograph and the textured surface seen through its camera.

    Attributes
    ----------
    name : str
        Name of the photograph.
    comparison : Comparison
        Figures of the whole pictures, in which all pixels that do not show known texels are black.
    psnr : float
        Peak signal-to-noise ratio in decibels of the display values of the compared pixels alone.
    rendered, photograph : (H, W, 3) float32 arrays
        Linear values; the photograph's exposure is brought to the rendering's by one factor per channel.
    shown : (H, W) bool array
        The pixels that are compared.

    See Also
    --------
    intaglio.compare_with_photograph : Computes it.

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
    >>> found = intaglio.compare_with_photograph(square, flat, texture.image, texture.known, front, samples=4)
    >>> found.name, found.psnr > 40, found.shown.shape
    ('front', True, (32, 32))
    """

    name: str
    comparison: Comparison
    psnr: float
    rendered: Array
    photograph: Array
    shown: Array

    def __post_init__(self) -> None:
        check_fields(self, nan=True)


@checked_arguments
def border_step(texture: Texture) -> float:
    """Measure how visible the borders between photographs are in a texture.

    The mean step between neighbouring texels that come mainly from different photographs is divided by that between texels
    near them that come from the same one, in display values.

    Parameters
    ----------
    texture : Texture
        From `combine_photographs`.

    Returns
    -------
    float
        About 1 if borders can't be told from the texture, larger if they can be seen; NaN if there are no borders.

    Raises
    ------
    InputError
        If ``texture`` is no Texture, or its arrays are not of one size.

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
    >>> intaglio.border_step(texture)  # a single photograph has no borders
    nan
    """
    checked_texture("texture", texture)
    shown = encode_srgb(texture.image)
    strongest = np.where(texture.known, texture.photograph[:, :, 0], -1)
    across, along = [], []
    borders = np.zeros(strongest.shape, bool)
    pairs = []
    for axis in (0, 1):
        first = np.take(strongest, range(strongest.shape[axis] - 1), axis)
        second = np.take(strongest, range(1, strongest.shape[axis]), axis)
        both = (first >= 0) & (second >= 0)
        differ = both & (first != second)
        step = np.abs(np.diff(shown, axis=axis)).mean(axis=2)
        pairs.append((axis, both & ~differ, step))
        across.append(step[differ])
        low = [slice(None)] * 2
        low[axis] = slice(0, -1)
        borders[tuple(low)] |= differ
    near = ndimage.binary_dilation(borders, iterations=_BESIDE)
    for axis, same, step in pairs:
        along.append(step[same & np.take(near, range(near.shape[axis] - 1), axis)])
    if not sum(map(len, across)) or not sum(map(len, along)):
        return float("nan")
    return float(np.concatenate(across).mean() / max(float(np.concatenate(along).mean()), 1e-12))


@checked_arguments
def compare_with_photograph(
    surface: Surface,
    uv: Parameterization,
    image: Array,
    known: Array,
    photograph: Photograph,
    *,
    reduce: int = 1,
    samples: int = 16,
    seed: int = 0,
) -> ViewComparison:
    """Render a textured surface through the camera of a photograph, and compare the two.

    Only the pixels that show known texels count. The exposure of the photograph is brought to that of the rendering by one
    factor per channel.

    Parameters
    ----------
    surface : Surface
        The surface that was textured.
    uv : Parameterization
        From `parameterize`, of this surface.
    image : (H, W, 3) array
        Texture, linear Rec.709.
    known : (H, W) bool array
        Texels that count.
    photograph : Photograph
        Preferably one that the texture was not made from. What its lens distorts is undone first.
    reduce : int, optional
        Compare at a resolution that is lower by this factor, 1 to 4096.
    samples : int, optional
        Paths per pixel, 1 to 4096.
    seed : int, optional
        The same seed gives the same bits.

    Returns
    -------
    ViewComparison
        Both images, the pixels that were compared, and the differences.

    Raises
    ------
    InputError
        If an argument is of another type, shapes don't agree, or the camera sees next to nothing of the known texels.

    See Also
    --------
    intaglio.combine_photographs : Makes the texture.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> square = intaglio.Surface(vertices=corners, faces=np.array([[0, 1, 2], [0, 2, 3]]))
    >>> uv = intaglio.parameterize(square, device="cpu")
    >>> turn = np.diag([1.0, -1.0, -1.0])
    >>> camera = intaglio.Camera(K=[[24, 0, 12], [0, 24, 12], [0, 0, 1]], R=turn, t=-turn @ [0.5, 0.5, 1.0])
    >>> grey = np.full((24, 24, 3), 0.5, np.float32)
    >>> photograph = intaglio.Photograph(camera=camera, picture=grey)
    >>> found = intaglio.compare_with_photograph(square, uv, grey, np.ones((24, 24), bool), photograph, samples=4)
    >>> found.psnr > 60
    True
    """
    checked_layout(surface, uv)
    # The renderer takes an array's memory as it is.
    image = np.ascontiguousarray(checked_finite("image", image), np.float32)
    if image.ndim != 3 or image.shape[2] != 3 or min(image.shape) < 1:
        raise InputError(f"image must be (H, W, 3), not {image.shape}")
    known = checked_mask("known", known, image.shape[:2])
    (photograph,) = checked_photographs("photograph", photograph)
    reduce, samples = checked_count("reduce", reduce, 1, 4096), checked_count("samples", samples, 1, 4096)
    seed = checked_count("seed", seed, 0, 2**32 - 1)
    camera = photograph.camera
    truth, mask = photograph.read()
    if camera.distorts:
        truth, mask = _undistorted(camera, truth, mask)
    if reduce > 1:
        height, width = (n // reduce * reduce for n in truth.shape[:2])
        truth = truth[:height, :width].reshape(height // reduce, reduce, width // reduce, reduce, 3).mean(axis=(1, 3))
        mask = None if mask is None else mask[:height:reduce, :width:reduce]
    matrix = camera.K.copy()
    matrix[:2] /= reduce
    matrix[:2, 2] += 0.5 / reduce - 0.5
    size = truth.shape[:2]
    if min(size) < 1:
        raise InputError(f"reduce must be at most the photograph's smaller side, not {reduce}")
    vertices = surface.vertices[uv.vertex]
    views = {"matrix": matrix, "turn": camera.R, "shift": camera.t, "size": size, "samples": samples, "seed": seed}
    rendered, alpha = through_camera(vertices, uv.faces, uv.uv, image, **views)  # type: ignore[arg-type]
    counted = np.repeat(known[:, :, None].astype(np.float32), 3, axis=2)
    share, _ = through_camera(vertices, uv.faces, uv.uv, counted, **views)  # type: ignore[arg-type]
    shown = (share[:, :, 0] > 0.95) & ndimage.binary_erosion(alpha > 0.99, iterations=_OUTLINE)
    if mask is not None:
        shown &= mask
    if shown.sum() < 100:
        raise InputError(f"{photograph.name}: its camera sees hardly anything of the known texture")
    factor = np.array([_ratio(rendered[:, :, c][shown], truth[:, :, c][shown]) for c in range(3)], np.float32)
    matched = truth * factor
    first, second = (np.where(shown[:, :, None], a, 0).astype(np.float32) for a in (rendered, matched))
    difference = encode_srgb(first)[shown].astype(np.float64) - encode_srgb(second)[shown]
    psnr = float(-10 * np.log10(max(float(np.mean(difference**2)), 1e-12)))
    return ViewComparison(photograph.name, compare(first, second), psnr, rendered, matched.astype(np.float32), shown)


def _undistorted(camera: Camera, values: Array, mask: Array | None) -> tuple[Array, Array]:
    """Return what a pinhole in the camera's place would have taken, and which of its pixels the photograph shows."""
    height, width = values.shape[:2]
    y, x = np.mgrid[:height, :width]
    flat = np.linalg.solve(camera.K[:2, :2], np.stack([x.reshape(-1), y.reshape(-1)]) - camera.K[:2, 2, None]).T
    at = camera.project((np.concatenate([flat, np.ones((len(flat), 1))], axis=1) - camera.t) @ camera.R)[0]
    with np.errstate(invalid="ignore"):
        inside = (at >= 0).all(axis=1) & (at[:, 0] <= width - 1) & (at[:, 1] <= height - 1)
    place = np.where(inside[:, None], at, 0).T[::-1]
    moved = np.stack([ndimage.map_coordinates(values[:, :, c], place, order=1) for c in range(3)], axis=1)
    shown = inside if mask is None else inside & mask[tuple(np.rint(place).astype(int))]
    return moved.reshape(height, width, 3), shown.reshape(height, width)


def _ratio(wanted: Array, given: Array) -> float:
    """Return the factor between the medians of two sets of values, which highlights do not change."""
    return float(np.median(wanted) / max(float(np.median(given)), 1e-6))
