"""Differences of exposure and white balance between photographs of one object."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.photographs.binding import Binding

# Linear values outside of this range are noise or clipped.
_DARKEST, _BRIGHTEST = 0.01, 0.95

# Vertices that two photographs must share.
_LEAST_SHARED = 20


def exposure_gains(binding: Binding) -> Array:
    """Return the factor of each photograph's channels, (P, 3), by which they agree where they overlap.

    The median of the logarithmic ratio of each pair of photographs, over the vertices they share, is fitted by one factor per
    photograph in the least squares sense. Factors are 1 on average, weighted by what each photograph sees.
    """
    count = len(binding.names)
    usable = binding.valid & (binding.color > _DARKEST).all(axis=2) & (binding.color < _BRIGHTEST).all(axis=2)
    logs = np.log(np.maximum(binding.color, 1e-6))
    rows, ratios, weights = [], [], []
    for i in range(count):
        for j in range(i + 1, count):
            shared = usable[i] & usable[j]
            if shared.sum() < _LEAST_SHARED:
                continue
            row = np.zeros(count)
            row[i], row[j] = 1, -1
            rows.append(row)
            ratios.append(np.median(logs[j, shared] - logs[i, shared], axis=0))
            weights.append(np.sqrt(shared.sum()))
    if not rows:
        return np.ones((count, 3))
    weight = np.array(weights)[:, None]
    # A weak preference for 1 determines the factors that no overlap does.
    system = np.concatenate([np.array(rows) * weight, 1e-3 * np.eye(count)])
    right = np.concatenate([np.array(ratios) * weight, np.zeros((count, 3))])
    found = np.linalg.lstsq(system, right, rcond=None)[0]
    seen = binding.valid.sum(axis=1).astype(float)
    found -= (seen[:, None] * found).sum(axis=0) / seen.sum()
    return np.asarray(np.exp(found))
