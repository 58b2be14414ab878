"""From a stack of photographs to a relightable texture (Dong, section 4.4)."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_arguments
from intaglio.devices import device_or_error
from intaglio.errors import InputError, IntaglioWarning
from intaglio.kernels.lighting import products, robust_normals, weighted_sums
from intaglio.photometric.bases import Basis, LambertBasis
from intaglio.photometric.heights import gradients_from_height, height_from_gradients
from intaglio.photometric.interpolation import RadialBasis, interpolate, smooth
from intaglio.photometric.linear_fits import LEAST_SQUARES, LinearFit, Moments, Settings, fit_linear
from intaglio.photometric.normals import surface_maps
from intaglio.photometric.relightable import KINDS, Relightable
from intaglio.photometric.stack import LUMINANCE, Exposure, PhotometricStack

# More than these shares of values at an end of the range are worth a warning; cast shadows alone make some black.
MUCH_OVEREXPOSED = 0.05
MUCH_BLACK = 0.25

# Robust fits leave out these shares of a pixel's values: the darkest (shadows) and the brightest (highlights).
DARK_SHARE = 0.25
BRIGHT_SHARE = 0.4

# Most steps of subspace iteration; from a sample of the pixels one or two do.
STEPS = 6


@checked_arguments
def represent(
    stack: PhotometricStack,
    kind: str = "rbf",
    *,
    color: str = "channels",
    robust: bool = False,
    order: int = 3,
    interpolation: str = "auto",
    components: int | None = None,
    smoothing: float | None = None,
    integration: str = "fourier",
    differentiation: str = "fourier",
    device: str | None = None,
    progress: Progress | None = None,
) -> Relightable:
    """Fit a texture that can be relit to photographs of it under known lights.

    Parameters
    ----------
    stack : PhotometricStack
        Photographs and their lights; linear values.
    kind : str, optional
        What the maps are and how they depend on the light:

        * ``"3i"``: three of the photographs, those whose lights are nearest to slant 45° and tilts 0°, 90°, 180° (3 maps);
        * ``"gradient"``: scaled normals, Lambert's law (3 maps, from 3 images);
        * ``"ptm"``: polynomial texture maps (6 maps, from 6 images);
        * ``"eigen3"``, ``"eigen6"``: principal images, their coefficients linear between the lights (3 or 6 maps);
        * ``"height"``: the gradient's normals made integrable, with their height map (3 maps);
        * ``"hsh"``, beyond the thesis: hemispherical harmonics (4 or 9 maps, from as many images);
        * ``"rbf"``, beyond the thesis: principal images, their coefficients smooth over the hemisphere, with smoothing and
          number of maps chosen by cross-validation (up to 18 maps, from 6 images).

        Default "rbf", which predicts held-out photographs best on every real stack tried.
    color : {"channels", "luminance"}, optional
        Fit every channel, the default, which keeps the colour of highlights; or Rec.709 luminance, with one chromaticity per
        pixel, which takes a third of the maps.
    robust : bool, optional
        For "gradient" and "height": leave out the darkest quarter and the brightest two fifths of a pixel's values and
        reweight the rest, so that shadows and highlights don't bend the normals. Needs 8 images. Default False, which is
        faster and uses all values.
    order : {2, 3}, optional
        For "hsh": 4 or 9 harmonics. Default 3.
    interpolation : {"auto", "grid", "triangles"}, optional
        For the eigen kinds: bilinear in tilt and slant (eq. 4.4.16), which needs lights on a full grid; linear over triangles
        of lights; or, the default, the grid if there is one. Outside the lights' hull the coefficients are those of its
        nearest point, falling with the cosine of the slant to 0 at the horizon.
    components : int, optional
        For "rbf": number of maps, from 1 to the number of images. Default None: the fewest, up to 18, that predict within
        0.5 % of the best number.
    smoothing : float, optional
        For "rbf": at least 0, which passes through all photographs. Default None: chosen by cross-validation.
    integration : {"fourier", "cosine"}, optional
        For "height": see ``method`` of `height_from_gradients`. Default "fourier", as in the thesis.
    differentiation : {"fourier", "central", "forward"}, optional
        For "height": see ``method`` of `gradients_from_height`. Default "fourier", as in the thesis.
    device : str, optional
        Where fits run, such as "cpu" or "cuda:0". Default None: CUDA if there is a GPU, else the CPU.
    progress : callable, optional
        Called as ``progress(done, total)`` while work goes on. Default None.

    Returns
    -------
    Relightable
        The fitted texture. Pixels outside the stack's mask are 0.

    Raises
    ------
    InputError
        For an unknown kind or setting, too few images, lights that don't determine the maps, a black stack, or a device
        that does not exist.
    FileError
        If an image of a stack on disk is missing or damaged.

    Warns
    -----
    IntaglioWarning
        If more than 5 % of the values are overexposed, or more than 25 % black.

    See Also
    --------
    intaglio.assess_representation : Which kind suits a stack.

    Notes
    -----
    Fits run in double precision; for stacks on disk the maps are summed image by image and rounded to single precision each
    time. Stacks on disk are read one image at a time; memory then holds the maps and three images (four for robust fits;
    "height" needs ten more for its gradients and transforms). For eigen kinds and "rbf" the images are read four to fourteen
    times (subspace iteration); robust fits read them once for every strip of a quarter GiB.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 4.4.

    Gautron, Křivánek, Pattanaik & Bouatouch, "A Novel Hemispherical Basis for Accurate and Efficient Rendering",
    Eurographics Symposium on Rendering 2004.

    Examples
    --------
    A level, matte sample of albedo 0.5, under seven lights:

    >>> import numpy as np
    >>> import intaglio
    >>> tilts, slants = (0, 0, 60, 120, 180, 240, 300), (0, 45, 45, 45, 45, 45, 45)
    >>> lights = np.array([intaglio.light_direction(*angles) for angles in zip(tilts, slants)])
    >>> images = 0.5 * np.ones((7, 2, 2, 1)) * lights[:, 2, None, None, None]
    >>> stack = intaglio.PhotometricStack(images, lights)
    >>> texture = intaglio.represent(stack, "gradient", device="cpu")
    >>> np.abs(texture.maps[:, 0, 0, 0]).round(3)
    array([0. , 0. , 0.5], dtype=float32)
    >>> texture.relight(intaglio.light_direction(tilt=10, slant=60))[0, 0].round(3)
    array([0.25], dtype=float32)
    """
    if kind not in KINDS:
        raise InputError(f"kind {kind!r} is not known; known: {', '.join(KINDS)}")
    if color not in ("channels", "luminance"):
        raise InputError(f"color {color!r} is not known; 'channels' or 'luminance'")
    if robust and kind not in ("gradient", "height"):
        raise InputError(f"robust fitting is there for 'gradient' and 'height', not for {kind!r}")
    device = device_or_error(device)
    report = progress or (lambda done, total: None)
    settings = Settings(order, interpolation, components, smoothing).checked()
    # Lights are checked before the long work.
    first = "gradient" if kind == "height" else kind
    if first == "3i" or first in LEAST_SQUARES:
        fit_linear(first, stack.lights, None, settings)
    seen = Exposure()
    if stack.in_memory:
        for k in range(stack.shape[0]):
            seen.add(stack, k, stack.image(k))
        _warn_of_exposure(seen)
    still_to_count = None if stack.in_memory else seen
    chroma = None
    if color == "luminance" and stack.shape[3] == 3:
        chroma = _chromaticity(stack, still_to_count)
        stack, still_to_count = stack.luminance(), None
    confidence = None
    notes: tuple[str, ...] = ()
    basis: Basis = LambertBasis()
    if robust:
        maps, confidence = _robust_maps(stack, device, report, still_to_count)
    else:
        fit = linear_fit(first, stack, settings, device, report)
        notes, basis = fit.notes, fit.basis
        maps = combine(stack, fit.weights, device, report, still_to_count)
    if not stack.in_memory:
        _warn_of_exposure(seen)
    if stack.mask is not None:
        maps[:, ~stack.mask] = 0
    texture = Relightable(first, maps, basis, chroma, stack.mask, None, confidence, notes)
    return integrable(texture, integration, differentiation) if kind == "height" else texture


def integrable(texture: Relightable, integration: str = "fourier", differentiation: str = "fourier") -> Relightable:
    """Return kind ``"height"`` of kind ``"gradient"``: the normals of its integrated height map, with its albedo.

    Heights are those of `height_from_gradients` and normals those of `gradients_from_height` (Dong, section 4.5.3).
    """
    maps = surface_maps(texture)
    p, q = maps.gradients()
    height = height_from_gradients(p, q, method=integration)
    p, q = gradients_from_height(height, method=differentiation, slope=(float(p.mean()), float(q.mean())))
    normal = np.stack([-p, -q, np.ones_like(p)]) / np.sqrt(p * p + q * q + 1)
    scaled = (normal[..., None] * maps.albedo[None]).astype(np.float32)
    return replace(texture, kind="height", maps=scaled, chroma=None, height=height.astype(np.float32))


def linear_fit(
    kind: str, stack: PhotometricStack, settings: Settings, device: str = "cpu", progress: Progress | None = None
) -> LinearFit:
    """Return the fit of a linear kind to ``stack``: the weights of its images and the basis."""
    if kind not in ("eigen3", "eigen6", "rbf"):
        return fit_linear(kind, stack.lights, None, settings)
    report = progress or (lambda done, total: None)
    fit = fit_linear(kind, stack.lights, stack_moments(stack), settings)
    if stack.in_memory:
        return fit
    # The products came from a sample of the pixels. A step of subspace iteration takes V to Iᵀ(I V) of all of them, and
    # reduces the error by the square of the ratio of the first singular value left out to the last one kept.
    vectors = fit.weights
    for _ in range(STEPS):
        images = combine(stack, vectors, device, report)
        turned = np.stack([_inner(stack, k, images) for k in range(stack.shape[0])])
        del images  # before the next ones are made: memory holds the maps once
        _, rotation = np.linalg.eigh(vectors.T @ turned)
        found, _ = np.linalg.qr(turned @ rotation[:, ::-1])
        # Weighted by the images' content, so that directions of mere noise need not converge.
        outside = np.linalg.norm(turned - vectors @ (vectors.T @ turned))
        vectors = found * np.where(found.sum(axis=0) < 0, -1, 1)
        if outside <= 1e-4 * np.linalg.norm(turned):
            break
    if isinstance(fit.basis, RadialBasis):
        old = fit.basis
        basis: Basis = smooth(stack.lights, vectors, old.chart, old.kernel, old.trend, old.smoothing)
    else:
        basis = interpolate(stack.lights, vectors, settings.interpolation)
    return replace(fit, weights=vectors, basis=basis)


def stack_moments(stack: PhotometricStack) -> Moments:
    """Return the stack's sums inside its mask: exact in memory, from every K-th row and column of a stack on disk."""
    count = stack.shape[0]
    if stack.in_memory:
        gram, sums, number = np.zeros((count, count)), np.zeros(count), 0
        for rows, strip in stack.strips():
            values = _values(strip, stack.mask, rows)
            gram += products(values)
            sums += values.sum(axis=1, dtype=np.float64)
            number += values.shape[1]
        return Moments(gram, sums, number)
    step = max(1, int(np.ceil(np.sqrt(count))))
    chosen = np.zeros(stack.shape[1:3], bool)
    chosen[::step, ::step] = True
    if stack.mask is not None:
        # All pixels of a small mask are taken, so that enough are left.
        chosen = stack.mask if stack.mask.sum() <= chosen.sum() else chosen & stack.mask
        chosen = chosen if chosen.any() else stack.mask
    values = np.stack([stack.image(k)[chosen].ravel() for k in range(count)])
    return Moments(products(values), values.sum(axis=1, dtype=np.float64), values.shape[1])


def combine(
    stack: PhotometricStack,
    weights: Array,
    device: str,
    progress: Progress | None = None,
    exposure: Exposure | None = None,
) -> Array:
    """Return maps (n, H, W, C), sums of the images with ``weights`` (K, n), and count their ``exposure`` on the way."""
    count, height, width, channels = stack.shape
    report = progress or (lambda done, total: None)
    if stack.in_memory and exposure is None:
        planes = np.asarray(stack.images).reshape(count, -1)
        return weighted_sums(planes, weights.T, double=True, device=device).reshape(-1, height, width, channels)
    maps = np.zeros((weights.shape[1], height * width * channels), np.float32)
    for k in range(count):
        image = stack.image(k)
        if exposure is not None:
            exposure.add(stack, k, image)
        if stack.mask is not None:
            image = np.where(stack.mask[:, :, None], image, 0)
        weighted_sums(image.reshape(1, -1), weights[k : k + 1].T, out=maps, add=True, double=True, device=device)
        del image  # before the next one is read
        report(k + 1, count)
    return maps.reshape(-1, height, width, channels)


def _inner(stack: PhotometricStack, k: int, maps: Array) -> Array:
    """Return the inner products (n,) of image ``k`` with ``maps`` (n, H, W, C), inside the mask."""
    image = stack.image(k)
    if stack.mask is not None:
        image = np.where(stack.mask[:, :, None], image, 0)
    flat, planes = image.reshape(-1), maps.reshape(len(maps), -1)
    total = np.zeros(len(maps))
    for start in range(0, flat.size, 1 << 16):
        part = slice(start, start + (1 << 16))
        total += planes[:, part].astype(np.float64) @ flat[part].astype(np.float64)
    return total


def _values(strip: Array, mask: Array | None, rows: slice) -> Array:
    """Return the values (K, P) of a strip (K, h, W, C) inside the mask."""
    inside = strip if mask is None else strip[:, mask[rows]]
    return np.ascontiguousarray(inside.reshape(len(strip), -1))


def _chromaticity(stack: PhotometricStack, exposure: Exposure | None) -> Array:
    """Return colour over luminance (H, W, 3) of the sum of all images, grey where it is black, and count the exposure."""
    total = np.zeros(stack.shape[1:], np.float32)
    for k in range(stack.shape[0]):
        image = stack.image(k)
        if exposure is not None:
            exposure.add(stack, k, image)
        total += image
        del image  # before the next one is read
    if stack.mask is not None:
        total[~stack.mask] = 0
    luminance = total @ np.asarray(LUMINANCE, np.float32)
    lit = luminance > 1e-6 * max(float(luminance.max()), 1e-30)
    luminance[~lit] = 1
    total /= luminance[..., None]
    total[~lit] = 1
    return total


def _robust_maps(stack: PhotometricStack, device: str, report: Progress, exposure: Exposure | None) -> tuple[Array, Array]:
    """Return scaled normals (3, H, W, C) and confidence (H, W) of a robust fit, channel by channel."""
    count, height, width, channels = stack.shape
    if count < 8:
        raise InputError(f"a robust fit needs at least 8 images, the stack has {count}; use robust=False")
    maps = np.empty((3, height, width, channels), np.float32)
    confidence = np.empty((height, width), np.float32)
    for rows, strip in stack.strips():
        values = strip.reshape(count, -1)
        if exposure is not None:
            exposure.add_strip(stack, rows, strip)
        if stack.mask is not None:
            values = np.where(np.repeat(stack.mask[rows].ravel(), channels), values, 0)
        scaled, share = robust_normals(values, stack.lights, dark=DARK_SHARE, bright=BRIGHT_SHARE, device=device)
        maps[:, rows] = scaled.T.reshape(3, -1, width, channels)
        confidence[rows] = share.reshape(-1, width, channels).mean(axis=2)
        report(rows.stop, height)
        del strip, values  # before the next ones are read
    if stack.mask is not None:
        confidence[~stack.mask] = 0
    return maps, confidence


def _warn_of_exposure(seen: Exposure) -> None:
    over, under = seen.shares
    if under >= 1:
        raise InputError("the stack is black: no value is over 0")
    limits = (over, MUCH_OVEREXPOSED, "overexposed"), (under, MUCH_BLACK, "black (at or under 0)")
    for share, limit, what in limits:
        if share > limit:
            warnings.warn(f"{share:.0%} of the stack's values are {what}; fits there are not to be trusted", IntaglioWarning, 3)
