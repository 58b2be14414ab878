"""Adaptive clustering of points: few where a surface is flat, many where it bends."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array


def cluster(points: Array, group: Array, *, largest: Array, smallest: Array, flatness: float) -> Array:
    """Return one point of every cluster, by hierarchical clustering of the points of each group.

    A cluster is split by the plane through its centroid across its longest axis while it holds more than ``largest`` points,
    or bends more than ``flatness`` and holds more than ``smallest``. All clusters of all groups are split at once.

    Parameters
    ----------
    points : (N, 3) array
    group : (N,) int array
        Sets that are clustered apart, numbered from 0.
    largest, smallest : (B,) arrays
        Points of a cluster, for each group.
    flatness : float
        Surface variation up to which a cluster is left whole, 0 (a plane) to 1/3.

    Returns
    -------
    (C,) int array
        Index of the point nearest to each cluster's centroid, sorted by group and place in the hierarchy.

    References
    ----------
    Pauly, Gross & Kobbelt, *Efficient simplification of point-sampled surfaces* (2002), section 3.1.
    """
    count = len(points)
    if not count:
        return np.zeros(0, np.int64)
    points = np.asarray(points, np.float64)
    label = np.unique(group, return_inverse=True)[1].reshape(-1)
    of_group = np.unique(group)
    # Points of clusters that may still be split; label numbers the clusters in order of group and hierarchy.
    open_ = np.ones(label.max() + 1, bool)
    while open_.any():
        sizes, centroid, covariance = _moments(points, label, len(open_))
        values, vectors = np.linalg.eigh(covariance)
        total = values.sum(axis=1)
        variation = np.divide(np.maximum(values[:, 0], 0), total, out=np.zeros(len(total)), where=total > 0)
        big = sizes > largest[of_group]
        bent = (variation > flatness) & (sizes > smallest[of_group])
        split = open_ & (big | bent) & (sizes > 1) & (total > 0)
        if not split.any():
            break
        above = np.zeros(count, bool)
        within = split[label]
        along = ((points[within] - centroid[label[within]]) * vectors[label[within], :, 2]).sum(axis=1)
        above[within] = along > 0
        # Points that rounding puts on one side of their centroid are not split.
        parts = np.bincount(label[above], minlength=len(split))
        split &= (parts > 0) & (parts < sizes)
        above &= split[label]
        begin = np.concatenate([[0], np.cumsum(1 + split)])
        label = begin[label] + above
        of_group = np.repeat(of_group, 1 + split)
        open_ = np.repeat(split, 1 + split)
    _, centroid, _ = _moments(points, label, len(open_))
    away = ((points - centroid[label]) ** 2).sum(axis=1)
    order = np.lexsort((away, label))
    first = np.concatenate([[True], np.diff(label[order]) > 0])
    return order[first]


def _moments(points: Array, label: Array, count: int) -> tuple[Array, Array, Array]:
    """Return size, centroid and covariance of each cluster."""
    sizes = np.bincount(label, minlength=count)
    centroid = np.stack([np.bincount(label, points[:, i], count) for i in range(3)], axis=1) / sizes[:, None]
    away = points - centroid[label]
    covariance = np.empty((count, 3, 3))
    for i in range(3):
        for j in range(i + 1):
            covariance[:, i, j] = covariance[:, j, i] = np.bincount(label, away[:, i] * away[:, j], count) / sizes
    return sizes, centroid, covariance
