"""Speed and memory of photometric fits and relighting, beside what this machine can do in the same run.

``make bench`` runs it; ``python -m tests.benchmarks.photometric --large`` adds 60 images of 24 megapixels on disk (8 GB of
memory, a few minutes).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from intaglio import PhotometricStack, Relightable, assess_representation, light_direction, read_stack, represent
from intaglio.kernels.lighting import robust_normals, weighted_sums
from intaglio.photometric.bases import PolynomialBasis, coefficients
from intaglio.photometric.representation import BRIGHT_SHARE, DARK_SHARE
from tests.benchmarks.timing import best


def lights(count):
    z = 1 - (np.arange(count) + 0.5) / count * 0.8
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)
    across = np.sqrt(1 - z * z)
    return np.stack([across * np.cos(angle), across * np.sin(angle), z], axis=1)


def fits():
    """PTM fit of 50 images of 1024², float32 in memory."""
    count, side = 50, 1024
    images = np.random.default_rng(0).random((count, side, side, 1), dtype=np.float32)
    where = lights(count)
    matrix = coefficients(PolynomialBasis(), where)
    inverse = np.linalg.pinv(matrix)
    planes = images.reshape(count, -1)
    copy = best(images.copy)
    product = best(lambda: weighted_sums(planes, inverse, double=True))
    lstsq = best(lambda: np.linalg.lstsq(matrix.astype(np.float32), planes, rcond=None), times=1)
    stack = PhotometricStack(images, where)
    whole = best(lambda: represent(stack, "ptm"), times=3)
    flops = 2 * 6 * count * side * side
    a = np.random.default_rng(1).random((3000, 3000), dtype=np.float32)
    gemm = 2 * 3000**3 / best(lambda: a @ a, times=3)
    print(f"machine: sgemm {gemm / 1e9:.0f} GFLOP/s; copy of the stack ({planes.nbytes / 1e6:.0f} MB) {copy:.3f} s")
    print(
        f"ptm fit, {count} x {side}²: product {product:.3f} s = {product / copy:.2f} copies, "
        f"{flops / product / 1e9:.0f} GFLOP/s, {planes.nbytes / product / 1e9:.1f} GB/s read; "
        f"represent() with checks {whole:.3f} s; numpy lstsq {lstsq:.2f} s"
    )
    for kind in ("gradient", "hsh", "eigen6", "rbf"):
        print(f"represent(…, {kind!r}), the same stack: {best(lambda k=kind: represent(stack, k), times=1):.2f} s")
    sample = np.ascontiguousarray(planes[:, : 256 * 256])
    seconds = best(lambda: robust_normals(sample, where, dark=DARK_SHARE, bright=BRIGHT_SHARE), times=1)
    print(f"robust normals, {count} images: {seconds / sample.shape[1] * 1e6:.1f} s per megapixel")


def leaving_one_out():
    """Leave-one-out errors of rbf over the number of photographs."""
    for count in (47, 72, 240):
        where = lights(count)
        stack = PhotometricStack(np.random.default_rng(0).random((count, 64, 64, 1), dtype=np.float32), where)
        seconds = best(lambda s=stack: assess_representation(s, "rbf", leave_one_out=True), times=1)
        print(f"leave-one-out of rbf, {count} lights: {seconds:.1f} s")


def relighting():
    """One light on a 3840x2160 texture of six maps."""
    maps = np.random.default_rng(0).random((6, 2160, 3840, 1), dtype=np.float32)
    texture = Relightable("ptm", maps, PolynomialBasis())
    light = light_direction(30, 40)
    read = best(lambda: maps.max())
    seconds = best(lambda: texture.relight(light))
    many = best(lambda: texture.relight(lights(8)), times=2)
    flops = 2 * maps.size
    print(
        f"relight 3840x2160, 6 maps ({maps.nbytes / 1e6:.0f} MB): {seconds * 1e3:.1f} ms = {seconds / read:.2f} x reading "
        f"them once ({read * 1e3:.1f} ms, a maximum); {flops / seconds / 1e9:.1f} GFLOP/s; 8 lights {many * 1e3:.0f} ms"
    )


def large():
    """Peak memory of fits to 60 images of 24 megapixels RGB on disk."""
    from PIL import Image

    width, height, count = 6000, 4000, 60
    where = lights(count)
    rng = np.random.default_rng(0)
    texture = rng.integers(60, 255, (height // 8, width // 8, 3), np.uint8)
    full = np.asarray(Image.fromarray(texture).resize((width, height), Image.Resampling.BICUBIC))
    with tempfile.TemporaryDirectory() as folder:
        lines = []
        for k, light in enumerate(where):
            Image.fromarray((full * np.float32(light[2])).astype(np.uint8)).save(Path(folder) / f"{k}.jpg", quality=85)
            lines.append(f"{k}.jpg {light[0]} {light[1]} {light[2]}")
        (Path(folder) / "capture.lp").write_text("\n".join(lines))
        image = 4 * 3 * width * height
        for kind in ("ptm", "eigen6"):
            done = subprocess.run(
                [sys.executable, "-m", "tests.benchmarks.photometric", "--fit", folder, kind],
                capture_output=True,
                text=True,
                check=True,
            )
            seconds, before, peak = (float(v) for v in done.stdout.split()[-3:])
            used = (peak - before) / image
            print(
                f"{kind}, {count} x 24 MP RGB on disk: {seconds:.0f} s, peak {peak / 2**30:.2f} GiB, "
                f"{used:.2f} images over the {before / 2**30:.2f} GiB of the empty program; maps are 6 images, "
                f"so maps + {used - 6:.2f}"
            )


def fit(folder, kind):
    """Fit in a process of its own and print seconds, and resident memory before and at most."""
    before = resident("VmRSS")
    start = time.perf_counter()
    represent(read_stack(folder), kind)
    print(time.perf_counter() - start, before, resident("VmHWM"))


def resident(what):
    """Return bytes of this process from /proc; getrusage's peak would be the parent's where that was larger."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(what + ":"):
            return int(line.split()[1]) * 1024
    return float("nan")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--fit", nargs=2, metavar=("FOLDER", "KIND"))
    args = parser.parse_args()
    if args.fit:
        fit(*args.fit)
        return
    fits()
    leaving_one_out()
    relighting()
    if args.large:
        large()


if __name__ == "__main__":
    main()
