"""What relief completion costs, beside what this machine can do. Run with ``make bench``; nothing here is asserted.

``python -m tests.benchmarks.relief --sizes 1000,4000`` shortens the growth table, ``--skip-surface`` leaves the papers'
metric out, ``--skip-scenes`` golf ball, tower, bumps and bark.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import warp as wp

wp.config.log_level = wp.LOG_WARNING

import intaglio  # noqa: E402
from intaglio import Cylinder  # noqa: E402
from intaglio.kernels.launch import choose_device, single_threaded_blas, threads  # noqa: E402
from intaglio.kernels.location import polar_grid  # noqa: E402
from intaglio.kernels.neighborhoods import NeighborhoodMatcher  # noqa: E402
from intaglio.scenes.patterns import bumps, cylinder_base, grid_faces, on_cylinder, on_plane, plane_base, plane_wave, wave  # noqa: E402
from tests.reliefs import complete_with  # noqa: E402


def main() -> None:
    """Print every table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default=None)
    parser.add_argument("--sizes", default="1000,4000,16000,64000,250000")
    parser.add_argument("--skip-surface", action="store_true")
    parser.add_argument("--skip-scenes", action="store_true")
    parser.add_argument("--one-size", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    device = choose_device(args.device)
    if args.one_size:
        one_size(args.one_size, device)
        return
    machine(device)
    warm_up(device)
    papers_patterns(device)
    bark_size(device, args.skip_surface)
    matching(device)
    recall(device)
    growth(device, [int(s) for s in args.sizes.split(",")])
    if not args.skip_scenes:
        scenes(device)


def machine(device: str) -> None:
    """Matrix product and memory copy of this machine, the measure of everything below."""
    a = np.random.default_rng(0).normal(size=(3000, 3000)).astype(np.float32)
    sgemm = best(lambda: a @ a)
    with single_threaded_blas():
        single = best(lambda: a @ a)
    big = np.ones(64 << 20, np.float32)
    target = np.empty_like(big)
    copy = best(lambda: np.copyto(target, big))
    print(f"device {device}, {threads()} CPU threads")
    print(f"sgemm {2 * 3000**3 / sgemm / 1e9:.0f} GFLOP/s (one thread {2 * 3000**3 / single / 1e9:.0f}), ", end="")
    print(f"copy {2 * big.nbytes / copy / 1e9:.1f} GB/s read and written\n")


def best(work, repeats: int = 3) -> float:
    """Return the least wall time of ``repeats`` runs."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def warm_up(device: str) -> None:
    """Fill Warp's kernel cache, so that times below are warm."""
    scan, _ = on_cylinder(wave)
    for metric in ("displacement", "surface"):
        complete_with(scan, cylinder_base(), 2, 0.1, rotations=1, metric=metric, device=device)


def papers_patterns(device: str) -> None:
    """Paper 001, table 1 and section 3.1: mean over five seeds, with and without noise."""
    print("pattern, w = 2, e = 0.1 (five seeds)      samples targets   % MSI   mean |%|  seconds   paper %  paper s")
    cases = [
        ("cylinder bumps", on_cylinder(bumps)[0], cylinder_base(), None, "0.71", "23.15"),
        ("cylinder wave", on_cylinder(wave)[0], cylinder_base(), None, "1.80", "23.15"),
        ("plane wave", on_plane(plane_wave)[0], plane_base(), (0.0, 74.0, 0.0, 40.0), "0.35", "217.9"),
    ]
    for noise in (0.0, 0.02):
        for name, scan, base, extent, paper, paper_seconds in cases:
            percents, times = [], []
            for seed in range(1, 6):
                noisy = with_noise(scan, base, noise, seed)
                start = time.perf_counter()
                whole = complete_with(noisy, base, 2, 0.1, rotations=1, extent=extent, seed=seed, device=device)
                times.append(time.perf_counter() - start)
                relief = whole.relief
                measured = relief[whole.measured].mean()
                percents.append(100 * (relief[~whole.measured].mean() - measured) / abs(measured))
            label = f"{name}, noise {noise:g}"
            print(
                f"{label:40s} {whole.measured.sum():8d} {(~whole.measured).sum():7d} {np.mean(percents):+8.3f} "
                f"{np.mean(np.abs(percents)):9.3f} {np.median(times):8.3f} {paper:>9s} {paper_seconds:>8s}"
            )
    print()


def with_noise(scan: intaglio.Surface, base: intaglio.Base, noise: float, seed: int) -> intaglio.Surface:
    """Return ``scan`` with Gaussian noise along the base normal."""
    normal = base.foot(scan.vertices)[1]
    jitter = np.random.default_rng(seed).normal(0, noise, len(scan.vertices))
    return intaglio.Surface(vertices=scan.vertices + jitter[:, None] * normal, faces=scan.faces)


def rough_tube(rows: int, columns: int, around: int) -> intaglio.Surface:
    """Return a stochastic relief on part of a tube: rows x columns samples of ``around`` columns."""
    rng = np.random.default_rng(0)
    angle, z = np.meshgrid(np.arange(columns) * 2 * np.pi / around, np.arange(rows, dtype=float), indexing="ij")
    height = np.zeros_like(angle)
    for _ in range(60):
        height += 0.15 * np.sin(rng.integers(8, around // 5) * angle + rng.normal(0, 0.5) * z + rng.uniform(0, 2 * np.pi))
    radius = around / (2 * np.pi) + height
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
    return intaglio.Surface(vertices=points.reshape(-1, 3), faces=grid_faces(columns, rows, False))


def bark_size(device: str, skip_surface: bool) -> None:
    """The size of Breckon & Fisher's figure 9 (3DIM 2005): 12,852 samples, 7,200 targets, w = 3, R = 2; 13 hours there."""
    scan = rough_tube(102, 126, 126 + 71)
    print("12,852 samples, 7,200 targets, w = 3, R = 2, from reading to writing (paper: about 13 hours)")
    with tempfile.TemporaryDirectory() as folder:
        source, result = Path(folder) / "scan.ply", Path(folder) / "whole.ply"
        scan.write(source)
        for metric in ("displacement",) if skip_surface else ("displacement", "surface"):
            start = time.perf_counter()
            whole = complete_with(
                intaglio.read_surface(source), "cylinder", 3, rotations=2, metric=metric, oversample=False, device=device
            )
            whole.write(result)
            seconds = time.perf_counter() - start
            report = intaglio.assess_relief(whole)
            print(
                f"  {metric:13s} {seconds:8.2f} s, {(~whole.measured).sum()} targets; displacement EMD "
                f"{report.displacement_emd:.3f}, std ratio {report.std_filled / report.std_measured:.3f}"
            )
    print()


def matching(device: str) -> None:
    """Matching alone, both engines, as a share of the matrix product."""
    _, ring, permutation = polar_grid(3, 2)
    grid, samples, targets = len(ring), 12852, 1000
    rng = np.random.default_rng(0)
    sample = rng.normal(size=(samples, grid)).astype(np.float32)
    value = rng.normal(size=(targets, grid)).astype(np.float32)
    weight = np.full((targets, grid), 1 / grid, np.float32)
    print(f"matching alone: {targets} targets, {2 * samples} candidates, {grid} grid points")
    for engine, operations in (("blas", 4), ("warp", 3)):
        if engine == "blas" and device != "cpu":
            continue
        matcher = NeighborhoodMatcher(sample, np.ones_like(sample), permutation, device=device, engine=engine)
        matcher.match(value[:8], weight[:8])
        seconds = best(lambda m=matcher: m.match(value, weight))
        rate = operations * targets * 2 * samples * grid / seconds / 1e9
        form = "expansion" if engine == "blas" else "direct form"
        print(f"  {engine}: {seconds:.3f} s, {rate:.1f} GFLOP/s ({form}, {operations} operations per point)")
    print()


def growth(device: str, sizes: list[int]) -> None:
    """Time and peak memory over the number of vertices, half of them targets, each in a process of its own."""
    print("growth: vertices, half of them targets, w = 7, R = 1, 3 refinement passes")
    print("  vertices  samples  targets  seconds  peak GiB  microseconds per target  the same / log2(vertices)")
    for size in sizes:
        command = [sys.executable, "-m", "tests.benchmarks.relief", "--one-size", str(size), "--device", device]
        print(subprocess.run(command, capture_output=True, text=True, check=True).stdout, end="", flush=True)
    print()


def one_size(size: int, device: str) -> None:
    """Print one row of the growth table."""
    warm_up(device)
    around = round(np.sqrt(2 * size))
    rows = round(size / around)
    scan = rough_tube(rows, around // 2, around)
    start = time.perf_counter()
    whole = complete_with(scan, "cylinder", 7, rotations=1, refine=3, oversample=False, device=device)
    seconds = time.perf_counter() - start
    measured, filled = int(whole.measured.sum()), int((~whole.measured).sum())
    peak = peak_memory()
    share = 1e6 * seconds / filled
    print(
        f"  {measured + filled:8d} {measured:8d} {filled:8d} {seconds:8.2f} {peak:9.2f} {share:9.1f} "
        f"{share / np.log2(measured + filled):9.1f}"
    )


def recall(device: str) -> None:
    """What the approximate search finds of what the exhaustive one finds, and at what cost, on scenes."""
    print("approximate search against exhaustive: every eighth target of a grown surface, whole neighbourhoods")
    from intaglio.relief.ground.prepare import GroundOptions, prepare_ground
    from intaglio.relief.growth.displacement_metric import DisplacementMetric
    from intaglio.relief.growth.propagation import grow_relief
    from intaglio.relief.growth.samples import sample_set
    from intaglio.relief.growth.settings import Selection
    from intaglio.scenes import bark
    from intaglio.scenes.ball import ball
    from intaglio.scenes.common import has_data
    from intaglio.scenes.golf_ball import one_view

    cases = [
        ("golf ball", prepare_ground(one_view(ball(4, 7)), "sphere", GroundOptions(spacing=0.62)), 24, 9, True),
        ("stochastic tube", prepare_ground(rough_tube(102, 126, 126 + 71), "cylinder"), 8, 7, False),
    ]
    if has_data("materials/ambientcg_Bark014/albedo.jpg"):
        cases.append(("bark", prepare_ground(bark.seen(bark.trunk()), "cylinder"), 4, 9, False))
    best_match = Selection("near-best", tolerance=0.0)
    for name, ground, rotations, window, oversample in cases:
        samples = sample_set(ground, oversample)
        error = 0.5 * float(ground.height[ground.measured].var())
        metrics = [DisplacementMetric(ground, samples, window, rotations, device, approximate=a, seed=1) for a in (False, True)]
        state = grow_relief(ground, metrics[1], window=window, error=error, selection=Selection(), seed=1).state
        targets = np.flatnonzero(~ground.measured)[::8]
        errors, times = [], []
        for metric in metrics:
            start = time.perf_counter()
            picks = metric.pick(targets, np.full(len(targets), window), state, best_match, np.zeros(len(targets)))
            times.append(time.perf_counter() - start)
            errors.append(picks.error)
        ratio = errors[1] / np.maximum(errors[0], 1e-30)
        print(
            f"  {name:16s} {len(samples.vertex) * rotations} candidates, {len(targets)} targets: {times[0]:.2f} s exhaustive, "
            f"{times[1]:.2f} s approximate; same cost {np.mean(ratio < 1.0001):.0%}, within 10 % {np.mean(ratio < 1.1):.0%}, "
            f"mean cost {errors[1].mean() / errors[0].mean():.3f} times"
        )
    print()


def peak_memory() -> float:
    """Peak resident memory of this process in GiB (VmHWM: ru_maxrss would hold the parent's before exec)."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
        return int(line.split()[1]) / 2**20
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def scenes(device: str) -> None:
    """The golf ball, tower, bumps and bark of the scenes over several seeds, growth alone and refined."""
    from intaglio.scenes import bark, golf_ball, golf_ball_hole, occluded_bumps, tower
    from intaglio.scenes.ball import ball
    from intaglio.scenes.common import has_data

    walls, axis = tower.tower()
    bumpy = occluded_bumps.one_side(occluded_bumps.bumpy())
    cases = [
        ("one view", golf_ball.one_view(ball(4, 7)), golf_ball.SETTINGS, 5, "-1.99"),
        ("hole", golf_ball_hole.with_hole(ball(4, 5)), golf_ball_hole.SETTINGS, 5, "-8.07"),
        ("tower, hole", tower.with_hole(walls), {**tower.SETTINGS, "base": axis}, 5, "-15.09"),
        ("occluded bumps", bumpy, {**occluded_bumps.SETTINGS, "base": occluded_bumps.BASE}, 5, "+20.55"),
    ]
    if has_data("materials/ambientcg_Bark014/albedo.jpg"):
        trunk = Cylinder(point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), radius=bark.RADIUS)
        cases.append(("bark", bark.seen(bark.trunk()), {**bark.SETTINGS, "base": trunk}, 2, "14.87, 6.65"))
    print(
        "scenes: % MSI least and most, the mean difference in standard deviations, EMD and seam least and most, seconds, paper %"
    )
    for name, scan, settings, seeds, paper in cases:
        for refine in (0, settings["refine"]):
            reports, times = [], []
            for seed in range(1, seeds + 1):
                start = time.perf_counter()
                whole = intaglio.complete_relief(scan, seed=seed, device=device, **{**settings, "refine": refine})
                times.append(time.perf_counter() - start)
                reports.append(intaglio.assess_relief(whole))
            msi, sigma, emd, seam = (
                np.array([getattr(r, field) for r in reports])
                for field in ("msi_percent", "msi_deviations", "displacement_emd", "seam")
            )
            label = f"{name}, " + (f"{refine} refinement passes" if refine else "growth alone")
            print(
                f"  {label:36s} {msi.min():+7.2f} {msi.max():+7.2f}  {sigma.mean():+.3f}  {emd.min():.3f} {emd.max():.3f} "
                f" {seam.min():.2f} {seam.max():.2f}  {np.median(times):7.2f}  {paper}",
                flush=True,
            )


if __name__ == "__main__":
    main()
