"""Small photometric stacks with known truth."""

from __future__ import annotations

import numpy as np

from intaglio import PhotometricStack, light_direction, write_image

HELD_OUT = np.array([light_direction(t, s) for t, s in ((10, 20), (100, 45), (200, 33), (333, 62))])


def dome(tilts=8, slants=(15, 35, 55, 75), turn=0.0):
    """Lights on a full grid of tilt and slant."""
    return np.array([light_direction(turn + 360 * t / tilts, s) for s in slants for t in range(tilts)])


def scattered(count=30, seed=3, lowest=80.0):
    """Lights spread over the hemisphere without a grid."""
    rng = np.random.default_rng(seed)
    z = 1 - (np.arange(count) + 0.5) / count * (1 - np.cos(np.radians(lowest)))
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count) + rng.uniform(-0.1, 0.1, count)
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


def relief(height=11, width=17):
    """Gentle unit normals (H, W, 3) and a colour albedo (H, W, 3) without symmetry."""
    row, column = np.mgrid[:height, :width].astype(float)
    normal = np.stack([0.12 * np.sin(column / 3), 0.1 * np.cos(row / 2), np.ones((height, width))], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    albedo = np.stack([0.2 + 0.03 * column, 0.9 - 0.05 * row, 0.5 + 0.02 * (row - column)], axis=-1)
    return normal, albedo


def truth(lights, height=11, width=17):
    """Images (K, H, W, 3) of that relief under Lambert's law without shadows, whatever the lights: values may be negative."""
    normal, albedo = relief(height, width)
    return np.einsum("kd,hwd->khw", lights, normal)[..., None] * albedo


def lambertian(lights, height=11, width=17):
    """The stack of those images."""
    return PhotometricStack(truth(lights, height, width).astype(np.float32), lights, ceiling=np.inf)


def noisy(lights, channels=1, seed=0, height=9, width=10):
    """A stack of rough, glossy, shadowed values that no kind fits exactly; all over 0."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(0, 0.35, (height, width, 3)) + (0, 0, 1.2)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    cosine = np.maximum(np.einsum("kd,hwd->khw", lights, normal), 0)
    values = 0.1 + 0.6 * cosine + 0.4 * cosine**12 + 0.03 * rng.random((len(lights), height, width))
    color = rng.uniform(0.4, 1.0, (height, width, channels))
    return PhotometricStack((values[..., None] * color).astype(np.float32), lights, ceiling=np.inf)


def write_capture(folder, stack, suffix=".exr", *, count_line=True, bits=8):
    """Write a stack's images and an .lp file; return its path."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = [str(len(stack.lights))] if count_line else []
    for k, light in enumerate(stack.lights):
        name = f"image_{k}{suffix}"
        image = stack.image(k)
        write_image(image if image.shape[2] == 3 else image[:, :, 0], folder / name, bits=bits)
        lines.append(f"{name} {light[0]:.17g} {light[1]:.17g} {light[2]:.17g}")
    path = folder / "capture.lp"
    path.write_text("\n".join(lines) + "\n")
    return path
