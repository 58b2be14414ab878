"""Selection of matches from a table of costs: a short list near the best, or one by rank."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload

wp.set_module_options({"enable_backward": False})

# The most candidates that are listed for a target.
SHORTLIST = 256
# A cost of this or more belongs to a candidate that lacks a grid point: with heights of unit variance, real costs are far less.
VIABLE = 1.0e6
_VIABLE = wp.constant(VIABLE)
# The least cost of this many candidates is found first, so that most of them need not be looked at again.
_BLOCK = wp.constant(256)
_MIX_1 = wp.constant(wp.uint32(0x85EBCA6B))
_MIX_2 = wp.constant(wp.uint32(0xC2B2AE35))


@wp.kernel
def block_minimum_kernel(
    start: int,
    cost: wp.array2d[wp.float32],
    # output
    lowest: wp.array2d[wp.float32],
):
    """Write the least cost of every block of 256 candidates of a target, min_j cost[t, j]."""
    i, b = wp.tid()
    t = start + i
    m = float(3.0e38)
    for j in range(b * _BLOCK, wp.min((b + 1) * _BLOCK, cost.shape[1])):
        m = wp.min(m, cost[t, j])
    lowest[t, b] = m


@wp.func
def thinning_hash(c: int, key: wp.uint32) -> wp.uint32:
    """Return well mixed bits of a candidate's index under a key: the last step of the hash function murmur3."""
    h = wp.uint32(c) ^ key
    h = (h ^ (h >> wp.uint32(16))) * _MIX_1
    h = (h ^ (h >> wp.uint32(13))) * _MIX_2
    return h ^ (h >> wp.uint32(16))


@wp.kernel
def shortlist_kernel(
    start: int,
    cost: wp.array2d[wp.float32],
    lowest: wp.array2d[wp.float32],
    factor: float,
    slack: wp.array[wp.float32],
    key: wp.array[wp.uint32],
    keyed: int,
    stride: int,
    samples: int,
    # output
    shortlist: wp.array2d[wp.int32],
    count: wp.array[wp.int32],
    spare: wp.array[wp.int32],
):
    """List the candidates within ``factor`` of a target's least cost (plus the rounding slack), in index order.

    Column ``q * stride + s`` of ``cost`` is candidate ``q * samples + s``. Where more qualify than the list holds, they are
    thinned by a hash of their index and the target's key, so that over the keys all have the same chance; the least one is kept
    all the same, and ``spare`` is its place in the list where the hash would have dropped it, else -1. Without keys (``keyed`` 0)
    those within the slack of the least are taken alone, and thinned only if they are still too many.
    """
    t = start + wp.tid()
    m = float(3.0e38)
    for b in range(lowest.shape[1]):
        m = wp.min(m, lowest[t, b])
    limit = wp.max(m, 0.0) * factor + slack[t]
    n = int(0)
    odd = int(-1)
    if m < _VIABLE:
        keep = wp.uint32(0)
        room = shortlist.shape[1]
        again = int(1)
        tightened = int(keyed)
        while again == 1:
            n = int(0)
            odd = int(-1)
            kept_least = int(0)
            for b in range(lowest.shape[1]):
                if lowest[t, b] <= limit and n <= room:
                    for j in range(b * _BLOCK, wp.min((b + 1) * _BLOCK, cost.shape[1])):
                        if cost[t, j] <= limit:
                            c = (j / stride) * samples + j % stride
                            wanted = (thinning_hash(c, key[t]) & keep) == wp.uint32(0)
                            if cost[t, j] == m and kept_least == 0:
                                if not wanted:
                                    odd = n
                                wanted = True
                                kept_least = int(1)
                            if wanted:
                                if n < room:
                                    shortlist[t, n] = c
                                n = n + 1
            again = int(0)
            if n > room:
                again = int(1)
                if tightened == 0:
                    tightened = int(1)
                    limit = wp.max(m, 0.0) + slack[t]
                else:
                    keep = keep * wp.uint32(2) + wp.uint32(1)
    count[t] = n
    spare[t] = odd


def select_near_best(
    cost: wp.array,
    slack: np.ndarray,
    factor: float,
    shortlist: np.ndarray,
    listed: np.ndarray,
    *,
    stride: int,
    samples: int,
    draw: np.ndarray | None = None,
) -> np.ndarray:
    """Write the candidates within ``factor`` of the least of ``cost`` (T, C), plus ``slack`` (T,), to a short list.

    Returns the place (T,) in each list of an entry that stands there only for being the least, and must not be drawn; else -1.

    Parameters
    ----------
    cost : (T, C) wp.array
    slack : (T,) float32 array
        What rounding may hide.
    factor : float
    shortlist : (T, L) int32 array
        Filled in place, in index order.
    listed : (T,) int32 array
        Filled in place: how many are listed, 0 where the least cost is not viable.
    stride, samples : int
        Columns per rotation of ``cost``, and how many of them are samples; equal where nothing is padded.
    draw : (T,) array, optional
        Numbers in [0, 1). Where more qualify than a list holds, they decide which are listed, each with the same chance; without
        them only the least are.
    """
    device = str(cost.device)
    on_cpu = device.startswith("cpu")
    count, candidates = cost.shape
    lowest = wp.empty((count, -(-candidates // int(_BLOCK))), dtype=wp.float32, device=device)
    spare = np.full(count, -1, np.int32)
    key = np.zeros(count, np.uint32) if draw is None else (np.asarray(draw) * 2.0**53 % 2.0**32).astype(np.uint32)
    if on_cpu:
        out, number, odd = (wp.array(a, dtype=wp.int32, device=device, copy=False) for a in (shortlist, listed, spare))
    else:
        out, number, odd = (wp.empty(a.shape, dtype=wp.int32, device=device) for a in (shortlist, listed, spare))
    launch(block_minimum_kernel, lowest.shape, inputs=[cost], outputs=[lowest], device=device, grain=1)
    launch(
        shortlist_kernel,
        count,
        inputs=[
            cost,
            lowest,
            float(factor),
            upload(slack, wp.float32, device),
            upload(key, wp.uint32, device),
            int(draw is not None),
            stride,
            samples,
        ],
        outputs=[out, number, odd],
        device=device,
        grain=1,
    )
    if not on_cpu:
        shortlist[:] = out.numpy()
        listed[:] = number.numpy()
        spare[:] = odd.numpy()
    return spare


def pick_by_rank(cost: np.ndarray, share: float, pick: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return, per row of ``cost`` (T, C), candidate number ``pick`` (in [0, 1)) of the best ``share``; and 1, or 0 for none."""
    chosen = np.zeros((len(cost), 1), np.int32)
    listed = np.zeros(len(cost), np.int32)
    for t, row in enumerate(cost):
        viable = int((row < VIABLE).sum())
        if viable:
            rank = int(pick[t] * max(1, np.ceil(share * viable)))
            chosen[t, 0] = np.argpartition(row, rank)[rank]
            listed[t] = 1
    return chosen, listed
