"""Filling thin damage: a thin plate under tension through the pixels beside it.

Diffusion alone (a membrane) rounds what crosses a scratch, a plate alone overshoots; the plate under tension (Smith & Wessel
1990) is between them, and for damage narrower than detail is wide, better than copied detail.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array
from intaglio.sparse import factor_symmetric

# What a squared difference of neighbours counts beside a squared Laplacian: they are alike for waves of seven pixels.
_TENSION = 0.8
# Damage is thin where no disk of this radius lies in it.
_THIN = 5


def thin_part(missing: Array) -> Array:
    """Return where damage (H, W) is so thin that what crosses it can be told from its two sides: under 11 pixels wide.

    What is wide keeps a margin of its own: where a scratch runs into a hole it belongs to the hole.
    """
    y, x = np.ogrid[-_THIN : _THIN + 1, -_THIN : _THIN + 1]
    disk = x * x + y * y <= _THIN * _THIN
    # Beyond the image damage goes on as if mirrored: a hole that is cut off there may be larger.
    padded = np.pad(missing, _THIN, mode="symmetric")
    wide = ndimage.binary_opening(padded, disk)
    wide = ndimage.binary_dilation(wide, np.ones((3, 3)), iterations=2)[_THIN:-_THIN, _THIN:-_THIN]
    return np.asarray(missing & ~wide)


def fill_with_plate(image: Array, missing: Array, *, chart: Array, barriers: Array | None = None) -> Array:
    """Return an image (H, W, C) float32 whose missing pixels lie on a plate under tension through the known ones.

    Minimises the sum over pixels of the squared Laplacian and, over pairs of neighbours, of the squared difference times the
    tension. Pixels without a way to a known one keep their values.

    Parameters
    ----------
    image : (H, W, C) array
        Values of the missing pixels are the start.
    missing : (H, W) bool array
    chart : (H, W) int array
        Number of the chart that a pixel belongs to; nothing reaches from one into another. 0: none.
    barriers : (H, W) bool array, optional
        Pixels that take part in nothing.

    References
    ----------
    Smith & Wessel, "Gridding with continuous curvature splines in tension", Geophysics 55, 1990.
    """
    usable = chart > 0
    if barriers is not None:
        usable = usable & ~barriers
    hole = missing & usable
    result = np.array(image, np.float32)
    if not hole.any():
        return result
    # Laplacians of pixels beside the hole reach one pixel further.
    near = ndimage.binary_dilation(hole, iterations=2) & usable
    number = np.full(hole.shape, -1)
    number[near] = np.arange(int(near.sum()))
    pairs = []
    for one, other in (((slice(None), slice(0, -1)), (slice(None), slice(1, None))), ((slice(0, -1),), (slice(1, None),))):
        both = near[one] & near[other] & (chart[one] == chart[other])
        pairs.append(np.stack([number[one][both], number[other][both]], axis=1))
    edges = np.concatenate(pairs)
    count = int(near.sum())
    ends = (np.concatenate([edges[:, 0], edges[:, 1]]), np.concatenate([edges[:, 1], edges[:, 0]]))
    graph = csr_array(coo_array((np.ones(len(ends[0])), ends), shape=(count, count)))
    degree = np.asarray(graph.sum(axis=1)).reshape(-1)
    laplacian = csr_array(diags_array(degree) - graph)
    # At borders it would be a slope: there the plate is free.
    counts = (ndimage.binary_dilation(hole)[near] & (degree == 4)).astype(float)
    energy = csr_array(laplacian.T @ diags_array(counts) @ laplacian + _TENSION * laplacian)
    unknown = hole[near]
    _, label = connected_components(graph, directed=False)
    unknown &= np.isin(label, label[~unknown])
    if not unknown.any():
        return result
    values = result[near].astype(np.float64)
    rows = energy[np.flatnonzero(unknown)]
    right = -(rows[:, np.flatnonzero(~unknown)] @ values[~unknown])
    # Factors of thin structures are thin: a direct solution takes less than any other, however many pixels there are.
    values[unknown] = factor_symmetric(csr_array(rows[:, np.flatnonzero(unknown)])).solve(right)
    result[near] = values
    return result
