"""What completing one hole costs in scans of growing size: CPU seconds and memory. Run with ``make bench``; nothing is asserted.

``python -m tests.benchmarks.holes --vertices 1e6,1e7`` goes on to ten million vertices; default one million and four. Every row
is a process of its own, so that its peak of memory is its own.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

STEPS = ("read", "prepare", "complete", "write")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vertices", default="1000000,4000000", help="Vertices of the scans.")
    parser.add_argument("--hole", type=int, default=500, help="Vertices that are missing in each.")
    parser.add_argument("--base", default="auto", help="Base of the completion.")
    parser.add_argument("--scan", type=Path, help="Complete this one and print its figures.")
    args = parser.parse_args()
    if args.scan is not None:
        print(json.dumps(complete(args.scan, args.base)))
        return
    print(f"\ncopy {copy_rate() / 1e9:.1f} GB/s; CPU seconds of all threads; peaks of memory beyond the start, bytes a vertex")
    columns = ["vertices", "hole", "file, MB", *STEPS, "peak reading", "peak, all"]
    print(f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    with tempfile.TemporaryDirectory() as folder:
        for count in (int(float(n)) for n in args.vertices.split(",")):
            path = Path(folder, "scan.ply")
            left, missing = write_torus(path, count, args.hole)
            size = path.stat().st_size
            command = [sys.executable, "-m", "tests.benchmarks.holes", "--scan", str(path), "--base", args.base]
            row = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
            seconds = " | ".join(f"{row['seconds'][step]:.1f}" for step in STEPS)
            peaks = [row["peak"]["read"], max(row["peak"].values())]
            print(
                f"| {left:,} | {missing} | {size / 1e6:.0f} | {seconds} | " + " | ".join(f"{p / left:.0f}" for p in peaks) + " |",
                flush=True,
            )


def write_torus(path: Path, count: int, hole: int) -> tuple[int, int]:
    """Write a torus with a relief of waves as binary PLY, single precision; return the vertices that it has and that it lacks.

    No plane, cylinder or sphere fits it, and it has no border but the hole's.
    """
    rows, columns = round((count / 2.5) ** 0.5), round((count * 2.5) ** 0.5)
    row, column = np.divmod(np.arange(rows * columns), columns)
    outside = np.hypot(row - rows // 2, column - columns // 2) > (hole / np.pi) ** 0.5
    step = 2 * np.pi / rows
    minor, major = 2 * np.pi * row / rows, 2 * np.pi * column / columns
    radius = 1 + step * (np.sin(row / 3.0) * np.cos(column / 4.0) + 0.5 * np.sin(row / 7.0 + column / 5.0))
    around = 2.5 + radius * np.cos(minor)
    at = np.stack([around * np.cos(major), around * np.sin(major), radius * np.sin(minor)], axis=1).astype("<f4")
    a = np.arange(rows * columns).reshape(rows, columns)
    b, c = np.roll(a, -1, axis=0), np.roll(a, -1, axis=1)
    d = np.roll(b, -1, axis=1)
    faces = np.concatenate([np.stack([a, d, b], axis=-1).reshape(-1, 3), np.stack([a, c, d], axis=-1).reshape(-1, 3)])
    faces = faces[np.argsort(faces.min(axis=1), kind="stable")]
    faces = (np.cumsum(outside) - 1)[faces[outside[faces].all(axis=1)]]
    table = np.zeros(len(faces), [("count", "u1"), ("index", "<i4", (3,))])
    table["count"], table["index"] = 3, faces
    left = int(outside.sum())
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {left}", *(f"property float {c}" for c in "xyz")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(header).encode())
        file.write(at[outside].tobytes())
        file.write(table.tobytes())
    return left, rows * columns - left


def complete(path: Path, base: str) -> dict[str, dict[str, float]]:
    """Return CPU seconds and peak bytes of each step from a file to the completed file."""
    import intaglio

    # What every process pays once, at the first kernel, is not the scan's.
    x, y = np.meshgrid(np.arange(40.0), np.arange(40.0))
    points = np.stack([x, y, 0.4 * np.sin(x) * np.cos(y)], axis=-1)
    points[18:22, 18:22] = np.nan
    intaglio.complete_relief(intaglio.surface_from_range_image(points, view=(20, 20, 100)), "smooth")
    before = peak()
    seconds, peaks = {}, {}
    made = {}

    def step(name, work):
        start = time.process_time()
        made[name] = work()
        seconds[name] = time.process_time() - start
        peaks[name] = peak() - before

    step("read", lambda: intaglio.read_surface(path))
    step("prepare", lambda: intaglio.prepare_relief(made["read"], base, device="cpu"))
    step("complete", lambda: made["prepare"].complete(seed=1))
    step("write", lambda: made["complete"].write(path.with_name("whole.ply")))
    return {"seconds": seconds, "peak": peaks}


def peak() -> int:
    """Return the most bytes that this process has held."""
    status = Path("/proc/self/status")
    if status.exists():
        # What the system counts for a process otherwise begins with what its parent held.
        return int(status.read_text().split("VmHWM:")[1].split()[0]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def copy_rate() -> float:
    """Return how many bytes a second this machine copies."""
    block = np.zeros(1 << 26)
    start = time.perf_counter()
    for _ in range(4):
        block.copy()
    return 4 * 2 * block.nbytes / (time.perf_counter() - start)


if __name__ == "__main__":
    main()
