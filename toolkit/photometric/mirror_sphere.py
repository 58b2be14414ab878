"""Light directions from pictures of a mirror sphere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array
from intaglio.errors import FitError, InputError


@dataclass(frozen=True)
class SphereLights:
    """Lights read off a mirror sphere.

    Attributes
    ----------
    lights : (K, 3) float64 array
        Unit vectors towards the lights; x right, y up, z to the camera.
    circle : (x, y, radius)
        The sphere's outline in pixels, x from the left, y from the top, to pixel centres.
    highlights : (K, 2) float64 array
        x and y of the light's reflection in each picture.
    """

    lights: Array
    circle: tuple[float, float, float]
    highlights: Array


def lights_from_sphere(
    images: Sequence[Array], circle: tuple[float, float, float] | None = None, *, outline: Array | None = None
) -> SphereLights:
    """Compute the direction of the light in each of several pictures of a mirror sphere, seen orthographically.

    At the highlight's centre (u, v), in units of the sphere's radius from its centre, the normal is n = (u, v, √(1−u²−v²));
    the light lies where the line of sight is mirrored to: l = 2 (n·z) n − z.

    Parameters
    ----------
    images : sequence of (H, W) or (H, W, C) arrays
        Pictures from one place, one light each.
    circle : (x, y, radius), optional
        The sphere's outline in pixels; default: found by `fit_circle`.
    outline : (H, W) or (H, W, C) array, optional
        Picture to find the outline in; default: the mean of ``images``.

    Raises
    ------
    InputError
        If pictures differ in size or a highlight can't be found.
    FitError
        If no circle is found.
    """
    grey = [_grey(image) for image in images]
    if not grey or any(g.shape != grey[0].shape for g in grey):
        raise InputError("pictures of the sphere must all be of one size, and there must be some")
    if circle is None:
        circle = fit_circle(np.mean(grey, axis=0) if outline is None else _grey(outline))
    try:
        cx, cy, radius = (float(v) for v in circle)
    except (TypeError, ValueError) as error:
        raise InputError(f"circle {circle!r} is not (x, y, radius)") from error
    height, width = grey[0].shape
    if not (radius >= 2 and 0 <= cx < width and 0 <= cy < height):
        raise InputError(f"circle ({cx:g}, {cy:g}, {radius:g}) is not x, y, radius inside pictures of {width} x {height} pixels")
    circle = cx, cy, radius
    rows, columns = np.mgrid[: grey[0].shape[0], : grey[0].shape[1]]
    inside = np.hypot(columns - cx, rows - cy) < 0.97 * radius
    highlights = np.array([_highlight(g, inside, radius, k) for k, g in enumerate(grey)])
    u = (highlights[:, 0] - cx) / radius
    v = -(highlights[:, 1] - cy) / radius
    w = np.sqrt(np.maximum(1 - u * u - v * v, 0))
    normals = np.stack([u, v, w], axis=1)
    lights = 2 * w[:, None] * normals - np.array([0.0, 0.0, 1.0])
    return SphereLights(lights / np.linalg.norm(lights, axis=1, keepdims=True), circle, highlights)


def fit_circle(image: Array) -> tuple[float, float, float]:
    """Find the outline of a sphere that fills a good part of a picture: the circle that most edge pixels agree on.

    Edges (Canny) vote by random triples (RANSAC, always from the same seed); the circle is then fitted to all that lie near it.

    Returns
    -------
    (x, y, radius)
        In pixels.

    Raises
    ------
    FitError
        If no circle is supported by edges along a quarter of its outline.
    """
    from skimage.feature import canny

    grey = _grey(image)
    if min(grey.shape) < 16:
        raise FitError(f"a picture of {grey.shape[1]} x {grey.shape[0]} pixels is too small to find a sphere in")
    step = max(1, round(max(grey.shape) / 400))
    small = ndimage.uniform_filter(grey, step)[::step, ::step]
    # Where the sphere is a dark disc, its rim is fainter than the reflections in it: levels are evened out first.
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
        raise FitError("no circle was found in the sphere's picture; give its centre and radius in pixels")
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


def _highlight(grey: Array, inside: Array, radius: float, k: int) -> Array:
    """Return x, y of the middle of the largest spot near the brightest value inside the sphere."""
    smooth = np.where(inside, ndimage.gaussian_filter(grey, max(0.5, radius / 100)), 0.0)
    peak = smooth.max()
    if not peak > 0 or peak < 2 * np.median(smooth[inside]):
        raise InputError(f"picture {k} of the sphere shows no highlight brighter than the rest")
    labels, count = ndimage.label(smooth > 0.95 * peak)
    sizes = ndimage.sum_labels(smooth, labels, np.arange(1, count + 1))
    row, column = ndimage.center_of_mass(smooth, labels, 1 + int(np.argmax(sizes)))
    return np.array([column, row])


def _grey(image: Array) -> Array:
    values = np.asarray(image, np.float64)
    return values if values.ndim == 2 else values[:, :, :3].mean(axis=2)
