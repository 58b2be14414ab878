"""Light directions from pictures of a mirror sphere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments, checked_numeric
from intaglio.errors import FitError, InputError


@dataclass(frozen=True)
class SphereLights:
    """Directions of lights, computed from pictures of a mirror sphere.

    Attributes
    ----------
    lights : (K, 3) float64 array
        Unit vectors towards the lights; x right, y up, z to the camera.
    circle : (float, float, float)
        Centre x, y and radius of the sphere's outline in pixels; x from the left, y from the top, and (0, 0) the centre of
        the first pixel.
    highlights : (K, 2) float64 array
        Position x, y of the light's reflection in each picture, in pixels likewise.

    See Also
    --------
    intaglio.lights_from_sphere : Computes it.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> picture = np.full((64, 64), 0.1)
    >>> picture[31:33, 41:43] = 1.0
    >>> found = intaglio.lights_from_sphere([picture], circle=(31.5, 31.5, 28))
    >>> found.highlights
    array([[41.5, 31.5]])
    """

    lights: Array
    circle: tuple[float, float, float]
    highlights: Array

    def __post_init__(self) -> None:
        check_fields(self, nan=True)


@checked_arguments
def lights_from_sphere(
    images: Sequence[Array], circle: tuple[float, float, float] | None = None, *, outline: Array | None = None
) -> SphereLights:
    """Compute the direction of the light in each of several pictures of a mirror sphere, seen orthographically.

    At the highlight's centre (u, v), in units of the sphere's radius from its centre, the normal is n = (u, v, √(1−u²−v²));
    the light lies where the line of sight is mirrored to: l = 2 (n·z) n − z.

    Parameters
    ----------
    images : sequence of (H, W) or (H, W, C) arrays
        Pictures from one place, each with one light; of colours the mean counts.
    circle : (float, float, float), optional
        Centre x, y and radius of the sphere's outline in pixels; x from the left, y from the top, and (0, 0) the centre of
        the first pixel. Default None: found by `fit_circle`.
    outline : (H, W) or (H, W, C) array, optional
        Picture in which to find the outline. Default None: the mean of ``images``, in which the background is most even.

    Returns
    -------
    SphereLights
        The unit vectors towards the lights, the outline, and the positions of the highlights.

    Raises
    ------
    InputError
        If there are no pictures, they differ in size, the circle is not inside them, or a highlight can't be found.
    FitError
        If no circle is found.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> picture = np.full((64, 64), 0.1)
    >>> picture[31:33, 41:43] = 1.0
    >>> found = intaglio.lights_from_sphere([picture], circle=(31.5, 31.5, 28))
    >>> tilt, slant = intaglio.tilt_and_slant(found.lights)
    >>> print(tilt.round(1), slant.round(1))
    [0.] [41.8]
    """
    gray = [_gray(f"images[{i}]", image) for i, image in enumerate(images)]
    if not gray or any(g.shape != gray[0].shape for g in gray):
        raise InputError("images must be at least one picture of the sphere, and all of one size")
    if circle is None:
        circle = fit_circle(np.mean(gray, axis=0) if outline is None else _gray("outline", outline))
    try:
        cx, cy, radius = (float(v) for v in circle)
    except (TypeError, ValueError) as error:
        raise InputError(f"circle {circle!r} is not (x, y, radius)") from error
    height, width = gray[0].shape
    if not (radius >= 2 and 0 <= cx < width and 0 <= cy < height):
        raise InputError(f"circle ({cx:g}, {cy:g}, {radius:g}) is not x, y, radius inside pictures of {width} x {height} pixels")
    circle = cx, cy, radius
    rows, columns = np.mgrid[: gray[0].shape[0], : gray[0].shape[1]]
    inside = np.hypot(columns - cx, rows - cy) < 0.97 * radius
    highlights = np.array([_highlight(g, inside, radius, k) for k, g in enumerate(gray)])
    u = (highlights[:, 0] - cx) / radius
    v = -(highlights[:, 1] - cy) / radius
    w = np.sqrt(np.maximum(1 - u * u - v * v, 0))
    normals = np.stack([u, v, w], axis=1)
    lights = 2 * w[:, None] * normals - np.array([0.0, 0.0, 1.0])
    return SphereLights(lights / np.linalg.norm(lights, axis=1, keepdims=True), circle, highlights)


@checked_arguments
def fit_circle(image: Array) -> tuple[float, float, float]:
    """Find the outline of a sphere that fills a good part of a picture: the circle with edges along most of it.

    Circles through random triples of edge pixels (Canny) are tried, always from the same seed (RANSAC); the best of them is
    then fitted by least squares to all edge pixels near it.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        Picture of at least 16 pixels a side; of colours the mean counts. Pictures of more than 400 pixels a side are reduced
        first.

    Returns
    -------
    x : float
        The centre in pixels from the left; 0 is the centre of the first pixel.
    y : float
        The centre in pixels from the top, likewise.
    radius : float
        The radius in pixels, from 0.15 of the shorter side to 0.75 of the longer one.

    Raises
    ------
    FitError
        If the picture is too small, or no circle has edges along a quarter of it.

    References
    ----------
    Fischler & Bolles, "Random Sample Consensus", Communications of the ACM 24(6), 1981.

    Kåsa, "A Circle Fitting Procedure and Its Error Analysis", IEEE Trans. Instrumentation and Measurement 25(1), 1976.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:64, :64]
    >>> disc = (np.hypot(x - 30, y - 34) < 20).astype(float)
    >>> found = intaglio.fit_circle(disc)
    >>> np.allclose(found, (30, 34, 20), atol=0.5)
    True
    """
    from skimage.feature import canny

    gray = _gray("image", image)
    if min(gray.shape) < 16:
        raise FitError(
            f"the image of {gray.shape[1]} x {gray.shape[0]} pixels is too small to find a sphere's outline in; 16 x 16 is least"
        )
    step = max(1, round(max(gray.shape) / 400))
    small = ndimage.uniform_filter(gray, step)[::step, ::step]
    # The rim of a dark sphere is fainter than the reflections in it, so levels are replaced by their ranks first.
    ranks = np.argsort(np.argsort(small, axis=None, kind="stable"), kind="stable").reshape(small.shape) / small.size
    points = np.argwhere(canny(ranks, sigma=2.0))[:, ::-1].astype(np.float64)
    best, support = None, 0.0
    if len(points) >= 3:
        generator = np.random.default_rng(0)
        for _ in range(4000):
            x, y, r = _circle_of(points[generator.choice(len(points), 3, replace=False)])
            if not 0.15 * min(small.shape) < r < 0.75 * max(small.shape):
                continue
            if not (0 <= x < small.shape[1] and 0 <= y < small.shape[0]):
                continue
            near = np.abs(np.hypot(points[:, 0] - x, points[:, 1] - y) - r) < 1.5
            angle = np.arctan2(points[near, 1] - y, points[near, 0] - x)
            covered = len(np.unique(np.floor(angle / (2 * np.pi) * 180))) / 180
            if covered > support:
                best, support = near, covered
    if best is None or support < 0.25:
        raise FitError("no circle was found in the sphere's image or outline; give its centre and radius in pixels")
    for _ in range(3):
        x, y, r = _circle_of(points[best])
        best = np.abs(np.hypot(points[:, 0] - x, points[:, 1] - y) - r) < 1.5
    # The mean over an even number of pixels lies between two of them.
    shift = 0.0 if step % 2 else -0.5
    return x * step + shift, y * step + shift, r * step


def _circle_of(points: Array) -> tuple[float, float, float]:
    """Return the least-squares circle through ``points`` (Kåsa's linear fit); a radius of 0 where they lie on a line."""
    a = np.column_stack([2 * points, np.ones(len(points))])
    solution, _, rank, _ = np.linalg.lstsq(a, (points**2).sum(axis=1), rcond=None)
    if rank < 3:
        return 0.0, 0.0, 0.0
    x, y, c = solution
    return float(x), float(y), float(np.sqrt(max(c + x * x + y * y, 0.0)))


def _highlight(gray: Array, inside: Array, radius: float, k: int) -> Array:
    """Return x, y of the middle of the largest spot near the brightest value inside the sphere."""
    smooth = np.where(inside, ndimage.gaussian_filter(gray, max(0.5, radius / 100)), 0.0)
    peak = smooth.max()
    if not peak > 0 or peak < 2 * np.median(smooth[inside]):
        raise InputError(f"images[{k}] of the sphere shows no highlight inside the circle brighter than the rest")
    labels, count = ndimage.label(smooth > 0.95 * peak)
    sizes = ndimage.sum_labels(smooth, labels, np.arange(1, count + 1))
    row, column = ndimage.center_of_mass(smooth, labels, 1 + int(np.argmax(sizes)))
    return np.array([column, row])


def _gray(name: str, image: Array) -> Array:
    values = checked_numeric(name, image, np.float64)
    if values.ndim not in (2, 3) or values.size == 0 or not np.isfinite(values).all():
        raise InputError(f"{name} must be a picture of finite values, (H, W) or (H, W, C), not {values.shape}")
    return values if values.ndim == 2 else values[:, :, :3].mean(axis=2)
