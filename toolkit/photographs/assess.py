"""How good a texture from photographs is: steps at the borders between photographs, and views it was not made from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.kernels.transfer import encode_srgb
from intaglio.mesh import Surface
from intaglio.parameterization import Parameterization
from intaglio.photographs.camera import Photograph
from intaglio.photographs.texture import Texture
from intaglio.render import Comparison, compare, through_camera

# Texels beside a border that count as the texture there.
_BESIDE = 6

# Pixels left out along the outline of what a view shows: there a photograph shows the background, too.
_OUTLINE = 3


@dataclass(frozen=True)
class ViewComparison:
    """A photograph against the textured mesh seen through its camera.

    Attributes
    ----------
    name : str
    comparison : Comparison
        Of the pixels that show known texels only; all others are black in both.
    psnr : float
        In decibels, over those pixels alone, of display values.
    rendered, photograph : (H, W, 3) float32 arrays
        Linear; the photograph's exposure is brought to the rendering's by one factor per channel.
    shown : (H, W) bool array
        The pixels compared.
    """

    name: str
    comparison: Comparison
    psnr: float
    rendered: Array
    photograph: Array
    shown: Array


def border_step(texture: Texture) -> float:
    """Return the mean step between neighbouring texels of different photographs, over that of one photograph's beside them.

    1 where borders can't be told from the texture; NaN where there is none.
    """
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
    """Look at a textured mesh through a photograph's camera, and compare.

    Parameters
    ----------
    surface : Surface
    uv : Parameterization
    image : (H, W, 3) array
        Linear texture.
    known : (H, W) bool array
        Texels that count.
    photograph : Photograph
        Best one that the texture was not made from. Its camera must have no distortion.
    reduce : int
        Compare at so many times less resolution.
    samples : int
        Paths per pixel.
    seed : int

    Raises
    ------
    InputError
        If the camera distorts, or sees no known texel.
    """
    shape = np.shape(image)
    if len(shape) != 3 or shape[2] != 3 or np.shape(known) != shape[:2] or not np.isfinite(image).all():
        raise InputError(f"image must be finite (H, W, 3) and known (H, W), not {shape} and {np.shape(known)}")
    for name, value in (("reduce", reduce), ("samples", samples)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 1 <= value <= 4096:
            raise InputError(f"{name} must be a whole number from 1 to 4096, not {value!r}")
    camera = photograph.camera
    if camera.distortion.any():
        raise InputError(f"{photograph.name}: its camera has radial distortion, which the renderer has not; undistort it")
    truth, mask = photograph.read()
    if reduce > 1:
        height, width = (n // reduce * reduce for n in truth.shape[:2])
        truth = truth[:height, :width].reshape(height // reduce, reduce, width // reduce, reduce, 3).mean(axis=(1, 3))
        mask = None if mask is None else mask[:height:reduce, :width:reduce]
    matrix = camera.K.copy()
    matrix[:2] /= reduce
    matrix[:2, 2] += 0.5 / reduce - 0.5
    size = truth.shape[:2]
    vertices = surface.vertices[uv.vertex]
    views = {"matrix": matrix, "turn": camera.R, "shift": camera.t, "size": size, "samples": samples, "seed": seed}
    rendered, alpha = through_camera(vertices, uv.faces, uv.uv, image, **views)  # type: ignore[arg-type]
    counted = np.repeat(known[:, :, None].astype(np.float32), 3, axis=2)
    share, _ = through_camera(vertices, uv.faces, uv.uv, counted, **views)  # type: ignore[arg-type]
    shown = (share[:, :, 0] > 0.95) & ndimage.binary_erosion(alpha > 0.99, iterations=_OUTLINE)
    if mask is not None:
        shown &= mask
    if shown.sum() < 100:
        raise InputError(f"{photograph.name}: its camera sees next to nothing of the known texture")
    factor = np.array([_ratio(rendered[:, :, c][shown], truth[:, :, c][shown]) for c in range(3)], np.float32)
    matched = truth * factor
    first, second = (np.where(shown[:, :, None], a, 0).astype(np.float32) for a in (rendered, matched))
    difference = encode_srgb(first)[shown].astype(np.float64) - encode_srgb(second)[shown]
    psnr = float(-10 * np.log10(max(float(np.mean(difference**2)), 1e-12)))
    return ViewComparison(photograph.name, compare(first, second), psnr, rendered, matched.astype(np.float32), shown)


def _ratio(wanted: Array, given: Array) -> float:
    """Return the factor that brings values to others: of their medians, which highlights don't move."""
    return float(np.median(wanted) / max(float(np.median(given)), 1e-6))
