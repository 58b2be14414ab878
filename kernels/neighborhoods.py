"""Matching of neighbourhoods: which samples look like the known part of a target's surroundings.

Every target is compared with every candidate, a sample at one of R rotations, by the masked weighted mean square

    ssd = sum_k w_k (x_k - y_perm(k))^2,    sum_k w_k = 1,

over the grid points k that the target knows; a candidate that lacks one of them is not viable. Costs are found either by
the blocked Warp kernel below or, on a CPU, by two matrix products (BLAS) from

    ssd = sum w x^2 - 2 sum (w x) y + sum w y^2.

The expansion cancels where costs are small, so both engines give only a short list, which is compared again in the direct
form in double precision: the choice near the best does not depend on the engine. (A choice among the best percents goes by the
engine's own costs.)
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.lanes import LANES, squared_terms, vec16
from intaglio.kernels.launch import launch, load, run_parallel, single_threaded_blas, upload
from intaglio.kernels.selection import SHORTLIST, block_minimum_kernel, pick_by_rank, select_near_best

wp.set_module_options({"enable_backward": False})

# The height that stands in for a missing grid point, where heights have unit variance: far above any real difference, and with a
# square that is far below overflow.
MISSING = 1.0e9


@wp.kernel
def ssd_kernel(
    start: int,
    value: wp.array2d[wp.float32],
    weight: wp.array2d[wp.float32],
    permutation: wp.array2d[wp.int32],
    blocks: wp.array2d[vec16],
    # output
    cost: wp.array3d[vec16],
):
    """Write Σ_k w_k (x_k - y_perm(q, k))² of target t, rotation q and the 16 samples of block b at once."""
    i, q, b = wp.tid()
    t = start + i
    total = vec16()
    for k in range(value.shape[1]):
        w = weight[t, k]
        if w > 0.0:
            total += w * squared_terms(blocks[b, permutation[q, k]], value[t, k])
    cost[t, q, b] = total


@wp.kernel
def recheck_kernel(
    start: int,
    value: wp.array2d[wp.float32],
    weight: wp.array2d[wp.float32],
    permutation: wp.array2d[wp.int32],
    sample: wp.array2d[wp.float32],
    shortlist: wp.array2d[wp.int32],
    count: wp.array[wp.int32],
    # output
    cost: wp.array2d[wp.float64],
):
    """Write Σ_k w_k (x_k - y_perm(q, k))² of every listed candidate, in double precision; 1e30 beyond the list's end."""
    i, j = wp.tid()
    t = start + i
    total = wp.float64(1.0e30)
    if j < count[t]:
        c = shortlist[t, j]
        s = c % sample.shape[0]
        q = c / sample.shape[0]
        total = wp.float64(0.0)
        for k in range(value.shape[1]):
            w = weight[t, k]
            if w > 0.0:
                d = wp.float64(value[t, k]) - wp.float64(sample[s, permutation[q, k]])
                total += wp.float64(w) * d * d
    cost[t, j] = total


@dataclass(frozen=True)
class Matches:
    """Candidates listed for T targets.

    Attributes
    ----------
    candidate : (T, L) int32 array
        ``rotation * S + sample``; entries from ``count`` on mean nothing.
    cost : (T, L) float64 array
        Weighted mean square difference; 1e30 from ``count`` on.
    count : (T,) int32 array
        How many are listed; 0 where no candidate is viable.
    spare : (T,) int32 array or None
        Place in the list of an entry that is there only for being the least and must not be drawn, -1 for none; None: nowhere.
    """

    candidate: np.ndarray
    cost: np.ndarray
    count: np.ndarray
    spare: np.ndarray | None = None


class NeighborhoodMatcher:
    """Compares targets with all samples at all rotations.

    Parameters
    ----------
    value, known : (S, G) arrays
        Samples' heights on the grid, and which of them exist (1) or not (0).
    permutation : (R, G) int32 array
        The grid's rotations, from `polar_grid`.
    device : str
        From `choose_device`.
    engine : {"auto", "blas", "warp"}
        How costs are found. "auto": BLAS on a CPU, where it was measured 4 times as fast, the Warp kernel on CUDA.
    """

    def __init__(
        self, value: np.ndarray, known: np.ndarray, permutation: np.ndarray, *, device: str, engine: str = "auto"
    ) -> None:
        if engine not in ("auto", "blas", "warp"):
            raise ValueError(f"engine must be 'auto', 'blas' or 'warp', not {engine!r}")
        on_cpu = device.startswith("cpu")
        if engine == "blas" and not on_cpu:
            raise ValueError("engine='blas' runs on the CPU only; use device='cpu' or engine='warp'")
        self.engine = ("blas" if on_cpu else "warp") if engine == "auto" else engine
        self.device = device
        self.samples, self.grid = value.shape
        self.rotations = len(permutation)
        self._permutation_host = np.ascontiguousarray(permutation, np.int32)
        self._permutation = upload(permutation, wp.int32, device)
        exists = known > 0
        filled = np.where(exists, value, np.float32(MISSING)).astype(np.float32)
        self._sample = upload(filled, wp.float32, device)
        if self.engine == "blas":
            # y^2 and y stand side by side, so that one product does for both.
            self._products = np.empty((self.samples, 2 * self.grid), np.float32)
            self._products[:, : self.grid] = np.where(exists, value * value, np.float32(MISSING) ** 2)
            self._products[:, self.grid :] = np.where(exists, value, 0)
        else:
            padded = -self.samples % LANES
            rows = np.concatenate([filled, np.full((padded, self.grid), MISSING, np.float32)])
            blocked = rows.reshape(-1, LANES, self.grid).transpose(0, 2, 1)
            self._blocks = upload(blocked, vec16, device)
        # A table of costs has this many columns for each rotation: one per sample, which the Warp engine pads to whole blocks.
        self._stride = self.samples if self.engine == "blas" else len(blocked) * LANES
        # The largest height, which the rounding errors of the expansion grow with.
        self._largest = float(np.abs(value[exists]).max()) if exists.any() else 1.0
        self._buffers = threading.local()

    @property
    def targets_at_once(self) -> int:
        """Targets whose costs are held at a time; fixed by the problem, so results do not depend on threads."""
        row = self.rotations * self.samples
        if not self.device.startswith("cpu"):
            return int(np.clip(256_000_000 // row, 1, 4096))
        # The table of costs stays in the processor's caches.
        return int(np.clip(4_000_000 // row, 1, max(1, 192 // self.rotations)))

    def match(self, value: np.ndarray, weight: np.ndarray, factor: float = 1.1, draw: np.ndarray | None = None) -> Matches:
        """List the candidates within ``factor`` of the best for every target.

        Parameters
        ----------
        value : (T, G) array
            The targets' heights on the grid, anything where ``weight`` is 0.
        weight : (T, G) array
            Weights summing to 1 over each target's known points, 0 elsewhere.
        factor : float
            A candidate is listed if its cost is at most this times the least.
        draw : (T,) array, optional
            Numbers in [0, 1) by which candidates are thinned where more qualify than a list holds, each with the same chance;
            without them the least alone are listed there.
        """
        count = len(value)
        value = np.ascontiguousarray(value, np.float32)
        weight = np.ascontiguousarray(weight, np.float32)
        shortlist = np.zeros((count, SHORTLIST), np.int32)
        listed = np.zeros(count, np.int32)
        spare = np.full(count, -1, np.int32)
        at_once = self.targets_at_once

        def work(index: int) -> None:
            rows = slice(index * at_once, min((index + 1) * at_once, count))
            cost = self._costs(value[rows], weight[rows])
            slack = self._slack(value[rows], weight[rows])
            spare[rows] = select_near_best(
                cost, slack, factor, shortlist[rows], listed[rows],
                stride=self._stride, samples=self.samples, draw=None if draw is None else draw[rows],
            )  # fmt: skip

        chunks = range(-(-count // at_once))
        if self.engine == "blas":
            load(block_minimum_kernel, self.device)
            with single_threaded_blas():
                run_parallel(work, chunks)
        else:
            for chunk in chunks:
                work(chunk)
        longest = max(1, int(listed.max(initial=0)))
        shortlist = np.ascontiguousarray(shortlist[:, :longest])
        return Matches(shortlist, self.direct_cost(value, weight, shortlist, listed), listed, spare)

    def pick_ranked(self, value: np.ndarray, weight: np.ndarray, share: float, pick: np.ndarray) -> Matches:
        """Pick one of the best ``share`` of all viable candidates per target: number ``pick`` (in [0, 1)) of them.

        The rank is by the engine's own cost, whose rounding is far below the spread of the best percents; the cost
        that is returned is the direct one.
        """
        count = len(value)
        value = np.ascontiguousarray(value, np.float32)
        weight = np.ascontiguousarray(weight, np.float32)
        chosen = np.zeros((count, 1), np.int32)
        listed = np.zeros(count, np.int32)
        at_once = self.targets_at_once
        with single_threaded_blas():
            for first in range(0, count, at_once):
                rows = slice(first, min(first + at_once, count))
                cost = self._costs(value[rows], weight[rows]).numpy()
                column, listed[rows] = pick_by_rank(cost, share, pick[rows])
                chosen[rows] = column // self._stride * self.samples + column % self._stride
        return Matches(chosen, self.direct_cost(value, weight, chosen, listed), listed)

    def direct_cost(self, value: np.ndarray, weight: np.ndarray, candidate: np.ndarray, count: np.ndarray) -> np.ndarray:
        """Return the direct double precision cost (T, L) of listed candidates."""
        cost = wp.empty(candidate.shape, dtype=wp.float64, device=self.device)
        launch(
            recheck_kernel,
            candidate.shape,
            inputs=[
                upload(value, wp.float32, self.device, copy=False),
                upload(weight, wp.float32, self.device, copy=False),
                self._permutation,
                self._sample,
                upload(candidate, wp.int32, self.device, copy=False),
                upload(count, wp.int32, self.device, copy=False),
            ],
            outputs=[cost],
            device=self.device,
            grain=4,
        )
        return cost.numpy()

    def _slack(self, value: np.ndarray, weight: np.ndarray) -> np.ndarray:
        scale = (weight * value**2).sum(axis=1) + self._largest**2
        return (4e-6 * scale).astype(np.float32)

    def _costs(self, value: np.ndarray, weight: np.ndarray) -> wp.array:
        """Return costs (T, R * S) of a chunk of targets."""
        count = len(value)
        if self.engine == "warp":
            blocks = self._blocks.shape[0]
            cost = wp.empty((count, self.rotations, blocks), dtype=vec16, device=self.device)
            launch(
                ssd_kernel,
                (count, self.rotations, blocks),
                inputs=[
                    upload(value, wp.float32, self.device, copy=False),
                    upload(weight, wp.float32, self.device, copy=False),
                    self._permutation,
                    self._blocks,
                ],
                outputs=[cost],
                device=self.device,
                grain=1,
            )
            # Padded candidates cost as much as those that lack a point: they are never viable, and are left in.
            return cost.view(wp.float32).reshape((count, -1))
        rows = count * self.rotations
        left = np.zeros((count, self.rotations, 2 * self.grid), np.float32)
        for q, turned in enumerate(self._permutation_host):
            left[:, q, turned] = weight
            left[:, q, self.grid + turned] = -2 * weight * value
        out = self._buffer(rows * self.samples).reshape(rows, self.samples)
        np.matmul(left.reshape(rows, -1), self._products.T, out=out)
        out = out.reshape(count, -1)
        out += (weight * value**2).sum(axis=1, dtype=np.float32)[:, None]
        return wp.array(out, dtype=wp.float32, device=self.device, copy=False)

    def _buffer(self, size: int) -> np.ndarray:
        held = getattr(self._buffers, "cost", None)
        if held is None or len(held) < size:
            held = self._buffers.cost = np.empty(size, np.float32)
        return held[:size]
