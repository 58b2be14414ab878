"""Speed and memory of texture synthesis, beside what this machine can do in the same run.

``make bench`` runs it; ``python -m tests.benchmarks.synthesis --quick`` leaves out the plain NumPy quilting (over a minute).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time

import numpy as np
from scipy import ndimage

from intaglio import grow, quilt
from intaglio.synthesis.sample import prepare_sample
from tests.benchmarks.timing import best


def pebbles(side, maps, seed=0):
    """A texture with structure: smooth noise, its sign's distance to the border, and noise; maps that vary together in part."""
    rng = np.random.default_rng(seed)
    base = ndimage.gaussian_filter(rng.standard_normal((side, side)), 3, mode="wrap")
    sharp = np.tanh(4 * base / base.std())
    planes = [
        np.roll(sharp, 2 * i, i % 2) + 0.4 * ndimage.gaussian_filter(rng.standard_normal((side, side)), 0.8) for i in range(maps)
    ]
    return np.stack(planes, axis=2).astype(np.float32)


def plain_quilt(sample, size, block, overlap, tolerance=0.1):
    """Quilting as it is usually written in NumPy: every candidate's overlap at once, one block after the other."""
    rng = np.random.default_rng(0)
    step = block - overlap
    count = -(-(size - overlap) // step)
    result = np.zeros((count * step + overlap, count * step + overlap, sample.shape[2]), np.float32)
    windows = np.lib.stride_tricks.sliding_window_view(sample, (block, block), axis=(0, 1))
    windows = np.moveaxis(windows, 2, -1)
    for i in range(count):
        for j in range(count):
            y, x = i * step, j * step
            mask = np.zeros((block, block), bool)
            mask[:, :overlap] |= j > 0
            mask[:overlap] |= i > 0
            target = result[y : y + block, x : x + block]
            cost = np.abs(windows[:, :, mask] - target[mask]).sum(axis=(2, 3))
            near = np.argwhere(cost <= cost.min() * (1 + tolerance))
            new = windows[tuple(near[rng.integers(len(near))])]
            error = np.abs(new - target).sum(axis=2)
            keep = np.ones((block, block), bool)
            if j > 0:
                keep &= np.arange(block)[None, :] >= plain_cut(error[:, :overlap])[:, None]
            if i > 0:
                keep &= np.arange(block)[:, None] >= plain_cut(error[:overlap].T)[None, :]
            target[keep] = new[keep]
    return result[:size, :size]


def plain_cut(error):
    total = error.copy()
    for row in range(1, len(total)):
        wide = np.pad(total[row - 1], 1, constant_values=np.inf)
        total[row] += np.minimum(np.minimum(wide[:-2], wide[1:-1]), wide[2:])
    path = [int(np.argmin(total[-1]))]
    for row in range(len(total) - 2, -1, -1):
        low = max(path[-1] - 1, 0)
        path.append(low + int(np.argmin(total[row, low : path[-1] + 2])))
    return np.array(path[::-1])


def machine():
    a = np.random.default_rng(1).random((3000, 3000), dtype=np.float32)
    gemm = 2 * 3000**3 / best(lambda: a @ a)
    copy = 2 * a.nbytes / best(a.copy)
    print(f"machine: sgemm {gemm / 1e9:.0f} GFLOP/s, copy {copy / 1e9:.0f} GB/s")


def small():
    gray = pebbles(65, 1)
    blocks = best(lambda: quilt(gray, 129, 26, 6))
    pixels = best(lambda: grow(gray, 129))
    print(f"65² to 129², grey: quilt, block 26, {blocks:.3f} s; grow {pixels:.2f} s")


def colour(plain):
    sample = pebbles(128, 3)
    terms = sum(441 * [97 * 97 * (2 * 32 * 8 - 64) * 3])
    for continuation in ("shortcut", "search", "avoid"):
        seconds = best(lambda c=continuation: quilt(sample, 512, 32, 8, continuation=c))
        print(
            f"128² RGB to 512², block 32, overlap 8, {continuation}: {seconds:.2f} s "
            f"(all {terms / 1e9:.1f} G differences would be {terms / seconds / 1e9:.0f} G/s)"
        )
    print(f"the same, refined (2 passes): {best(lambda: quilt(sample, 512, 32, 8, refine=2), 1):.1f} s")
    print(f"the same with graph cuts: {best(lambda: quilt(sample, 512, 32, 8, cut='graph'), 1):.2f} s")
    for share in (1.0, 0.5):
        print(f"grow, exhaustive {share:g}: {best(lambda s=share: grow(sample, 512, exhaustive=s), 1):.1f} s")
    if plain:
        features = np.moveaxis(prepare_sample(sample).features, 0, 2)
        start = time.perf_counter()
        plain_quilt(features, 512, 32, 8)
        slow = time.perf_counter() - start
        fast = best(lambda: quilt(sample, 512, 32, 8, continuation="search"))
        print(f"plain NumPy quilting: {slow:.0f} s, {slow / fast:.0f} times as long as quilt with every block searched")


def cost():
    print("cost of quilt, block 32, overlap 8, every block searched, none continued:")
    for maps in (1, 3, 6, 12):
        sample = pebbles(128, maps)
        cells = []
        for size in (256, 512, 1024):
            seconds = best(lambda s=sample, n=size: quilt(s, n, 32, 8, continuation="avoid"), 2)
            cells.append(f"{size}²: {seconds:.2f} s ({seconds / size**2 / maps * 1e6:.2f} µs per pixel and map)")
        print(f"  {maps} maps  " + "  ".join(cells))


def large():
    """Six maps, 256² to 2048²: in a process of its own, for its peak memory."""
    code = (
        "import resource, sys, time; from tests.benchmarks.synthesis import pebbles; from intaglio import quilt;"
        "s = pebbles(256, 6); quilt(s, 300, 48, 12, continuation=sys.argv[1]); t = time.perf_counter();"
        "quilt(s, 2048, 48, 12, continuation=sys.argv[1]); d = time.perf_counter() - t;"
        "print(f'{d:.1f} s, peak {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB')"
    )
    for continuation in ("shortcut", "avoid"):
        done = subprocess.run([sys.executable, "-c", code, continuation], capture_output=True, text=True, check=True)
        print(f"6 maps, 256² to 2048², block 48, overlap 12, {continuation}: {done.stdout.strip().splitlines()[-1]}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="leave out the plain NumPy quilting")
    args = parser.parse_args()
    machine()
    small()
    colour(plain=not args.quick)
    cost()
    large()


if __name__ == "__main__":
    main()
