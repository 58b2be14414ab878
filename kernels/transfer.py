"""Transfer functions between linear light and what files and displays hold; NumPy alone, so that everything may import it."""

from __future__ import annotations

import numpy as np


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    """Return display values (IEC 61966-2-1) of linear ones, clipped to [0, 1], float32."""
    x = np.clip(np.asarray(linear, np.float32), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.power(np.maximum(x, 1e-8), 1 / 2.4) - 0.055).astype(np.float32)


def decode_srgb(shown: np.ndarray) -> np.ndarray:
    """Return linear values of display values in [0, 1], float32."""
    x = np.asarray(shown, np.float32)
    return np.where(x <= 0.04045, x / 12.92, np.power((np.maximum(x, 0) + 0.055) / 1.055, 2.4)).astype(np.float32)
