"""Fast inpainting by isotropic diffusion (Oliveira et al. 2001), brought to its limit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array
from intaglio.sparse import DIRECT, solve_symmetric

# The diffusion kernel of Oliveira et al. (2001), figure 1: its middle is zero.
_DIAGONAL, _DIRECT_NEIGHBOUR = 0.073235, 0.176765
_STEPS = [(dy, dx, _DIAGONAL if dy and dx else _DIRECT_NEIGHBOUR) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if (dy, dx) != (0, 0)]


def inpaint(image: Array, missing: Array, *, chart: Array, barriers: Array | None = None) -> Array:
    """Return an image (H, W, C) float32 whose missing pixels are the limit of diffusion from the known ones.

    The limit of Oliveira's repeated convolution is the image that the convolution leaves unchanged, which is the solution of
    a sparse system; if many pixels are missing, an image of half the size is solved first. Pixels that are not connected to
    a known one take the mean of all known pixels.

    Parameters
    ----------
    image : (H, W, C) array
        Values where ``missing`` may be anything.
    missing : (H, W) bool array
    chart : (H, W) int array
        Number of the chart that a pixel belongs to; nothing diffuses from one to another. Pixels outside of all, 0, stay zero.
    barriers : (H, W) bool array, optional
        Pixels across which nothing diffuses: they take colour, but give none.

    References
    ----------
    Oliveira et al., Fast digital image inpainting (2001), section 3.
    """
    usable = chart > 0
    values = np.where((missing | ~usable)[:, :, None], 0, image).astype(np.float32)
    missing, known = missing & usable, usable & ~missing
    if not missing.any() or not known.any():
        return values
    walls = np.zeros_like(missing) if barriers is None else barriers
    gives = (known | missing) & ~walls
    return _diffuse(values, missing, known, gives, chart)


def _diffuse(values: Array, missing: Array, known: Array, gives: Array, chart: Array) -> Array:
    """Solve for the missing pixels outside of barriers, then let barriers take the colour of their neighbours."""
    mean = values[known].mean(axis=0)
    # Islands of missing pixels without a known neighbour have no solution: they take the mean.
    unknown = _find_reachable(missing, gives, chart)
    result = values.copy()
    result[missing] = mean
    if unknown.any():
        start = values
        if unknown.sum() > DIRECT:
            start = _solve_coarse(values, missing, known, gives, chart)
        result[unknown] = _solve_limit(values, unknown, (gives & ~missing) | unknown, chart, start)
    done = known | unknown
    walls = missing & ~gives
    while (walls & ~done).any():
        grown = walls & ~done & ndimage.binary_dilation(done, np.ones((3, 3)))
        if not grown.any():
            break
        result[grown] = _means(result, done, grown, chart)
        done |= grown
    return result


def _find_reachable(missing: Array, gives: Array, chart: Array) -> Array:
    """Return the missing pixels outside of barriers that are connected to a known pixel of their own chart."""
    unknown = missing & gives
    count = int(unknown.sum())
    number = np.full(gives.shape, -1)
    number[unknown] = np.arange(count)
    beside_known = np.zeros(count, bool)
    rows, columns = [], []
    for pixel, y, x, _ in _neighbors(unknown, gives, chart):
        known = ~missing[y, x]
        beside_known[pixel[known]] = True
        rows.append(pixel[~known])
        columns.append(number[y[~known], x[~known]])
    edges = (np.concatenate(rows), np.concatenate(columns))
    graph = coo_array((np.ones(len(edges[0]), bool), edges), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    reached = unknown.copy()
    reached[unknown] = np.isin(label, np.unique(label[beside_known]))
    return reached


def _solve_limit(values: Array, unknown: Array, conducts: Array, chart: Array, start: Array) -> Array:
    """Return the unknown pixels' values (M, C): each the weighted mean of its neighbours that conduct."""
    count = int(unknown.sum())
    number = np.full(unknown.shape, -1)
    number[unknown] = np.arange(count)
    total, right = np.zeros(count), np.zeros((count, values.shape[2]))
    rows, columns, weights = [], [], []
    for pixel, y, x, weight in _neighbors(unknown, conducts, chart):
        total[pixel] += weight
        known = ~unknown[y, x]
        right[pixel[known]] += weight * values[y[known], x[known]]
        rows.append(pixel[~known])
        columns.append(number[y[~known], x[~known]])
        weights.append(np.full(len(columns[-1]), -weight))
    table = coo_array((np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count))
    return solve_symmetric(csr_array(table + diags_array(total)), right, start[unknown].astype(np.float64))


def _means(values: Array, done: Array, pixels: Array, chart: Array) -> Array:
    """Return the weighted means (M, C) of the finished neighbours of ``pixels``."""
    count = int(pixels.sum())
    total, summed = np.zeros(count), np.zeros((count, values.shape[2]))
    for pixel, y, x, weight in _neighbors(pixels, done, chart):
        total[pixel] += weight
        summed[pixel] += weight * values[y, x]
    return np.asarray(summed / np.maximum(total, 1e-12)[:, None])


def _neighbors(pixels: Array, conducts: Array, chart: Array) -> Iterator[tuple[Array, Array, Array, float]]:
    """Yield, for each step of the kernel, the ``pixels`` (by number) with a conducting neighbour, its place, and the weight."""
    y, x = np.nonzero(pixels)
    for dy, dx, weight in _STEPS:
        ny, nx = y + dy, x + dx
        there = (ny >= 0) & (ny < pixels.shape[0]) & (nx >= 0) & (nx < pixels.shape[1])
        there[there] = conducts[ny[there], nx[there]] & (chart[ny[there], nx[there]] == chart[y[there], x[there]])
        yield np.flatnonzero(there), ny[there], nx[there], weight


def _solve_coarse(values: Array, missing: Array, known: Array, gives: Array, chart: Array) -> Array:
    """Return initial values (H, W, C) from the same problem on means of 2 x 2 pixels."""
    seen = known & gives
    weight = _blocks(seen)
    planes = [_blocks(np.where(seen, values[:, :, c], 0)) for c in range(values.shape[2])]
    mean = (np.stack(planes, axis=2) / np.maximum(weight, 1)[:, :, None]).astype(np.float32)
    open_now = (weight == 0) & (_blocks(missing & gives) > 0)
    padded = np.pad(chart, ((0, chart.shape[0] % 2), (0, chart.shape[1] % 2)))
    coarse = np.max([padded[::2, ::2], padded[1::2, ::2], padded[::2, 1::2], padded[1::2, 1::2]], axis=0)
    below = _diffuse(mean, open_now, weight > 0, open_now | (weight > 0), coarse)
    return np.repeat(np.repeat(below, 2, axis=0), 2, axis=1)[: missing.shape[0], : missing.shape[1]]


def _blocks(plane: Array) -> Array:
    """Return sums over blocks of 2 x 2."""
    even = np.pad(plane.astype(np.float32), ((0, plane.shape[0] % 2), (0, plane.shape[1] % 2)))
    total: Array = even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]
    return total
