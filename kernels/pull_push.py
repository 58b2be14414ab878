"""Continuing an image smoothly to where it has no values, by its Gaussian pyramid (pull and push)."""

from __future__ import annotations

import numpy as np

from intaglio.kernels.pyramids import expand_level, normalize_level, reduce_level, upload_image


def continue_image(color: np.ndarray, defined: np.ndarray, device: str) -> np.ndarray:
    """Return an image (H, W, C) that is as it was where ``defined``, and elsewhere continues smoothly from there."""
    if defined.all() or not defined.any():
        return color
    inside = defined.astype(np.float32)[:, :, None]
    parts = [_continued(color[:, :, k : k + 3] * inside, inside, device) for k in range(0, color.shape[2], 3)]
    return np.where(defined[:, :, None], color, np.concatenate(parts, axis=2)).astype(np.float32)


def _continued(color: np.ndarray, inside: np.ndarray, device: str) -> np.ndarray:
    """Continue up to three channels."""
    channels = color.shape[2]
    padded = np.concatenate([color, np.zeros((*color.shape[:2], 3 - channels), np.float32), inside], axis=2)
    levels = [upload_image(padded, device)]
    while max(levels[-1].shape) > 1:
        levels.append(reduce_level(levels[-1], device))
    image = normalize_level(levels[-1], device)
    for level in levels[-2::-1]:
        here = normalize_level(level, device).numpy()
        below = expand_level(image, level.shape, device).numpy()
        image = upload_image(np.where(here[:, :, 3:] > 0, here, below), device)
    return image.numpy()[:, :, :channels].copy()
