"""What reading and mending meshes costs, in CPU seconds. Run with ``make bench``; nothing here is asserted.

``python -m tests.benchmarks.reading --rows 350`` reads meshes of a quarter of a million faces only; default also two millions.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from broken_meshes import DEFECTS, all_at_once, cut_apart, write_plain, write_quads, write_strips

import intaglio
from intaglio.mesh import grid_faces, read_mesh_file
from intaglio.mesh.mending import mend_faces


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", default="350,1000", help="Rows of the grids that are read.")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for rows in (int(r) for r in args.rows.split(",")):
            vertices, faces = sheet(rows)
            print(f"\n{len(faces)} faces; sorting their edges by one number each: {used(lambda f=faces: sort_edges(f)):.2f} s")
            formats(Path(folder), vertices, faces)
            defects(Path(folder), vertices, faces)


def sheet(rows):
    """A wavy grid."""
    y, x = np.mgrid[:rows, : rows + 10].astype(float)
    return np.stack([x, y, np.sin(x) * np.cos(y)], axis=-1).reshape(-1, 3), grid_faces(rows, rows + 10).astype(np.int64)


def sort_edges(faces):
    """What no mending can do without: every edge once in order."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    return np.sort(edges[:, 0] * (faces.max() + 1) + edges[:, 1], kind="stable")


def used(work):
    """Return the CPU seconds of all threads that some work takes."""
    start = time.process_time()
    work()
    return time.process_time() - start


def formats(folder, vertices, faces):
    """Reading alone, and with mending, by type."""
    print("| file | MB | read | read and mended |\n|---|---|---|---|")
    doubled, seamed = cut_apart(vertices, faces, None)
    uv = np.random.default_rng(0).random((len(doubled), 2))
    for name, write in {
        "grid.ply": lambda p: write_plain(p, vertices, faces),
        "strips.ply": lambda p: write_strips(p, vertices, faces),
        "grid.stl": lambda p: write_plain(p, vertices, faces),
        "seam.obj": lambda p: write_plain(p, doubled, seamed, uv),
        "quads.off": lambda p: write_quads(p, vertices, faces),
        "seam.glb": lambda p: write_plain(p, doubled, seamed, uv),
    }.items():
        path = folder / name
        write(path)
        alone, whole = used(lambda p=path: read_mesh_file(p)), used(lambda p=path: intaglio.read_surface(p))
        print(f"| {name} | {path.stat().st_size / 1e6:.0f} | {alone:.2f} | {whole:.2f} |", flush=True)
        path.unlink()


def defects(folder, vertices, faces):
    """Mending of every defect."""
    print("| defect | faces | mended | read and mended |\n|---|---|---|---|")
    for name, make in {**DEFECTS, "all_at_once": all_at_once}.items():
        broken = make(vertices, faces.copy(), np.random.default_rng(0))
        path = folder / "broken.ply"
        write_plain(path, *broken)
        alone = used(lambda b=broken: mend_faces(b[0], np.asarray(b[1])))
        whole = used(lambda p=path: intaglio.read_surface(p))
        print(f"| {name} | {len(broken[1])} | {alone:.2f} | {whole:.2f} |", flush=True)


if __name__ == "__main__":
    main()
