"""Seams of any shape through an overlap: minimum cuts of a graph (Kwatra et al. 2003, section 3)."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from intaglio.arrays import Array
from intaglio.kernels.blocks import known_pixels

# Errors are whole numbers in a maximum flow; the largest edge is this long.
_LEVELS = 100_000


def graph_cut_seams(error: Array, overlap: Array) -> Array:
    """Return which pixels K blocks keep: (K, B, B) bool.

    Parameters
    ----------
    error : (K, B, B) array
        Differences between each block and what it would cover.
    overlap : (K, 4) array
        How far what lies there reaches in from the left, top, right and bottom.
    """
    known = known_pixels(overlap, error.shape[1])
    return np.stack([_cut_overlap(e, k, o) for e, k, o in zip(error, known, overlap, strict=True)])


def _cut_overlap(error: Array, known: Array, overlap: Array) -> Array:
    """Cut one overlap: an edge between two pixels costs the sum of both errors."""
    if not known.any():
        return np.ones(known.shape, bool)
    block = len(known)
    at = np.arange(block)
    # The existing pixels keep the outer border of the block; the block keeps what is next to pixels that it alone has.
    left, top, right, bottom = overlap > 0
    old = ((at[None, :] == 0) & left) | ((at[:, None] == 0) & top)
    old = old | ((at[None, :] == block - 1) & right) | ((at[:, None] == block - 1) & bottom)
    new = ndimage.binary_dilation(~known) & known & ~old
    if known.all():
        # Overlaps from opposite sides meet: the block keeps its middle.
        margin = block // 4
        inner = [(at >= margin * low) & (at < block - margin * high) for low, high in ((top, bottom), (left, right))]
        new = inner[0][:, None] & inner[1][None, :] & ~old
    index = np.where(known, np.cumsum(known.ravel()).reshape(known.shape) - 1, -1)
    count = int(known.sum())
    source, sink = count, count + 1
    largest = float(error.max()) or 1.0
    ends, costs = [], []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :])):
        both = known[a] & known[b]
        pair = np.stack([index[a][both], index[b][both]])
        # At least 1, so that of equal cuts the shortest is found.
        cost = np.maximum(1, np.round(_LEVELS * (error[a][both] + error[b][both]) / (2 * largest)))
        ends += [pair, pair[::-1]]
        costs += [cost, cost]
    # Costs more than all edges of a pixel together, so it is never cut.
    for inside, terminal in ((index[old], source), (index[new], sink)):
        link = np.stack([np.full(len(inside), terminal), inside])
        ends.append(link if terminal == source else link[::-1])
        costs.append(np.full(len(inside), 10 * _LEVELS))
    rows, columns = np.concatenate(ends, axis=1)
    graph = coo_array((np.concatenate(costs).astype(np.int32), (rows, columns)), shape=(count + 2, count + 2)).tocsr()
    graph.sum_duplicates()
    left_over = graph - maximum_flow(graph, source, sink).flow
    left_over.data = np.maximum(left_over.data, 0)
    left_over.eliminate_zeros()
    reached = np.zeros(count + 2, bool)
    reached[breadth_first_order(left_over, source, return_predecessors=False)] = True
    kept = ~known
    kept[known] = ~reached[:count]
    return kept
