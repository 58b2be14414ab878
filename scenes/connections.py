"""What holds in a woven or linked texture, counted: threads that end inside, rings that are not closed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from intaglio.geometry import PointSet, label_pieces

Array = np.ndarray

# In distances of samples: neighbours that are joined; what reaches less far in from the border is a sliver of a cut thread.
_JOINED, _SLIVER = 1.7, 4.0


def broken_threads(points: PointSet, spacing: float) -> tuple[int, int]:
    """Return how many threads enter a piece of cloth, and how many of them (or of loose pieces) end inside."""
    label = label_pieces(points, _JOINED * spacing)
    count = int(label.max()) + 1
    low, high = points.points.min(axis=0), points.points.max(axis=0)
    least, most = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(least, label, points.points[:, :2])
    np.maximum.at(most, label, points.points[:, :2])
    touching = np.concatenate([least <= low[:2] + 2 * spacing, most >= high[:2] - 2 * spacing], axis=1)
    inward = np.minimum(most - low[:2], high[:2] - least).min(axis=1)
    whole = inward > _SLIVER * spacing
    return int((whole & touching.any(axis=1)).sum()), int((whole & (touching.sum(axis=1) < 2)).sum())


def closed_rings(points: PointSet, spacing: float, radius: float) -> tuple[int, int]:
    """Return how many rings of mail lie wholly inside a piece, and how many of them are closed and apart from others.

    A ring that hangs together with another counts as two that are not closed, loose pieces of more than a hundredth of a
    ring as one.
    """
    label = label_pieces(points, _JOINED * spacing)
    low, high = points.points.min(axis=0), points.points.max(axis=0)
    order = np.argsort(label, kind="stable")
    edges = np.searchsorted(label[order], np.arange(label.max() + 2))
    sizes = np.diff(edges)
    usual = float(np.median(sizes[sizes > sizes.max() / 10]))
    rings = closed = 0
    for begin, end in pairwise(edges):
        ring = points.points[order[begin:end]]
        cut = (ring[:, :2].min(axis=0) < low[:2] + 2 * spacing).any() or (ring[:, :2].max(axis=0) > high[:2] - 2 * spacing).any()
        if cut or len(ring) < usual / 100:
            continue
        rings += max(1, round(len(ring) / usual))
        away = ring - ring.mean(axis=0)
        flat = away @ np.linalg.svd(away, full_matrices=False)[2][:2].T if len(ring) > 3 else np.zeros((len(ring), 2))
        angle = np.sort(np.arctan2(flat[:, 1], flat[:, 0]))
        gap = max(np.diff(angle).max(initial=0), angle[0] + 2 * np.pi - angle[-1])
        far = np.linalg.norm(flat, axis=1)
        closed += bool(gap < np.radians(15) and far.min() > 0.5 * radius and far.max() < 1.6 * radius)
    return rings, closed
