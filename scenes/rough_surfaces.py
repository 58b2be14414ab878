"""Rough surfaces with known truth, photographed by the renderer: input of the relighting scenes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.photometric import PhotometricStack, light_direction
from intaglio.randomness import uniform
from intaglio.render import Gloss, height_normals, photometric_capture

Array = np.ndarray

# The thesis' capture: twelve tilts at each of three slants.
TRAINING = np.array([light_direction(30 * t, s) for s in (30, 45, 60) for t in range(12)])
HELD_OUT = np.array([light_direction(t, s) for t, s in ((15, 37), (75, 52), (140, 37), (195, 45), (255, 57), (312, 33))])


@dataclass(frozen=True)
class RoughSurface:
    """A height field with its colour.

    Attributes
    ----------
    title : str
    height : (h, w) array
        At the vertices, in pixels.
    albedo : (h − 1, w − 1, 3) array
    gloss : Gloss, optional
    shadows : bool
    """

    title: str
    height: Array
    albedo: Array
    gloss: Gloss | None = None
    shadows: bool = True

    def photograph(self, lights: Array, *, samples: int, seed: int) -> Array:
        """Return images (K, H, W, 3)."""
        return photometric_capture(
            self.height, self.albedo, lights, gloss=self.gloss, shadows=self.shadows, samples=samples, seed=seed
        )

    def stack(self, *, samples: int = 64, seed: int = 0) -> PhotometricStack:
        """Return the stack under the training lights."""
        return PhotometricStack(self.photograph(TRAINING, samples=samples, seed=seed), TRAINING, ceiling=np.inf)

    @property
    def normal(self) -> Array:
        """True normals (H, W, 3) at the pixels' middles."""
        return height_normals(self.height)


def periodic_noise(
    size: int, *, seed: int, stream: int, slope: float = 2.0, coarsest: float = 1.0, finest: float = 0.25
) -> Array:
    """Return (size, size) noise that repeats, of mean 0 and standard deviation 1, amplitude falling as frequency^−slope.

    ``coarsest`` is the least frequency in cycles per image, ``finest`` the largest in cycles per pixel.
    """
    phase = 2 * np.pi * uniform(seed, stream, np.arange(size * size).reshape(size, size), 0)
    f = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.fftfreq(size)[None, :])
    band = (f >= coarsest / size) & (f <= finest)
    amplitude = np.where(band, np.maximum(f, 1 / size) ** -slope, 0)
    noise = np.fft.ifft2(amplitude * np.exp(1j * phase)).real
    return np.asarray((noise - noise.mean()) / noise.std())


def steepest(image: Array) -> float:
    """Return the largest slope of a height map that repeats."""
    p, q = (np.roll(image, -1, axis=a) - image for a in (1, 0))
    return float(np.hypot(p, q).max())


def wrapped(image: Array) -> Array:
    """Return an image that repeats with its first row and column once more: heights at the corners of its pixels."""
    return np.pad(image, ((0, 1), (0, 1)), mode="wrap")


def thesis_surfaces(size: int = 160, seed: int = 1) -> list[RoughSurface]:
    """Return a flat, a rough (without and with shadows) and a glossy surface, as in the thesis' figures 4.5.3 to 4.5.8."""
    grain = periodic_noise(size, seed=seed, stream=1, slope=1.0)
    patches = periodic_noise(size, seed=seed, stream=2, slope=2.5)
    color = np.array([0.62, 0.5, 0.38]) + 0.06 * grain[..., None] * np.array([1.0, 0.9, 0.8]) + 0.08 * patches[..., None]
    albedo = np.clip(color, 0.05, 0.95)
    gentle = periodic_noise(size, seed=seed, stream=5, slope=2.0, coarsest=4, finest=0.08)
    rough = periodic_noise(size, seed=seed, stream=3, slope=1.6, coarsest=5)
    bumps = periodic_noise(size, seed=seed, stream=4, slope=2.2, coarsest=4, finest=0.12)
    return [
        RoughSurface("flat, Lambertian", np.zeros((size + 1, size + 1)), albedo),
        # Slopes under 30 degrees: no light of slant 60 or less leaves a point in its own shadow.
        RoughSurface("rough, Lambertian, without shadows", wrapped(gentle) * (0.55 / steepest(gentle)), albedo, shadows=False),
        RoughSurface("rough, Lambertian, with shadows", 2.2 * wrapped(rough), albedo),
        RoughSurface("glossy, with shadows", 1.6 * wrapped(bumps), 0.6 * albedo, gloss=Gloss(alpha=0.25)),
    ]
