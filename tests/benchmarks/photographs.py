"""Speed and memory of parameterization, textures from photographs and restoration, beside what this machine can do.

``make bench`` runs it. libigl, xatlas and OpenCV are measured beside ours where they are installed.
"""

from __future__ import annotations

import argparse
import resource
import time
from dataclasses import replace

import numpy as np
from scipy import ndimage

from intaglio import Photograph, Surface, bind_photographs, combine_photographs, parameterize, restore
from intaglio.parameterization.atlas import atlas
from intaglio.parameterization.charts import doubled_areas, doubled_texture_areas, flat_edges, invert_matrices, squared_stretches
from intaglio.scenes.photographs import camera_towards
from intaglio.scenes.restoration import damage
from tests.benchmarks.timing import best
from tests.shapes import half_sphere


def l2_stretch(surface, uv, faces):
    """Normalised L2 stretch and flips, as for ours."""
    area = doubled_areas(surface.vertices, surface.faces)
    signed = doubled_texture_areas(uv, faces)
    squared = squared_stretches(uv, faces, invert_matrices(flat_edges(surface.vertices, surface.faces)))
    flips = min(int((signed <= 0).sum()), int((signed >= 0).sum()))
    return float(np.sqrt((area * squared).sum() / area.sum() * np.abs(signed).sum() / area.sum())), flips


def peers(surface):
    """Yield (name, uv, seconds) of libigl's methods, where it is installed."""
    try:
        import igl
    except ImportError:
        return
    v, f = surface.vertices, surface.faces.astype(np.int64)
    rim = igl.boundary_loop(f)
    start = time.perf_counter()
    first = igl.harmonic(v, f, rim, igl.map_vertices_to_circle(v, rim), 1)
    yield "libigl harmonic", first, time.perf_counter() - start
    start = time.perf_counter()
    found = igl.lscm(v, f, rim[[0, len(rim) // 2]], np.array([[0.0, 0], [1, 0]]))
    yield "libigl LSCM", found[0] if isinstance(found, tuple) else found, time.perf_counter() - start
    start = time.perf_counter()
    data = igl.ARAPData()
    data.max_iter = 100
    # ARAP's precomputation refuses some meshes.
    try:
        igl.arap_precomputation(v, f, 2, np.zeros(0, int), data)
        yield "libigl ARAP", igl.arap_solve(np.zeros((0, 2)), data, first), time.perf_counter() - start
    except RuntimeError as problem:
        print(f"libigl ARAP: {problem}")
    start = time.perf_counter()
    area = np.sqrt(doubled_areas(v, f).sum() / np.abs(doubled_texture_areas(first, f)).sum())
    kind = igl.MappingEnergyType.SYMMETRIC_DIRICHLET
    data = igl.slim_precompute(v, f, first * area, kind, np.zeros(0, int), np.zeros((0, 2)), 0.0)
    yield "libigl SLIM", np.asarray(igl.slim_solve(data, 50)), time.perf_counter() - start


def parameterizations():
    for height, waves in ((0.2, 14), (0.3, 14)):
        surface = half_sphere(20_000, height, waves)
        found = parameterize(surface)
        seconds = best(lambda s=surface: parameterize(s), 2)
        print(f"bumpy half sphere, height {height}, {waves} waves, {len(surface.faces)} triangles")
        print(f"  ours: L2 {found.l2_stretch:.4f}, flips {found.flips}, {seconds:.2f} s")
        for name, uv, used in peers(surface):
            value, flips = l2_stretch(surface, uv, surface.faces)
            print(f"  {name}: L2 {value:.4f}, flips {flips}, {used:.2f} s")
        start = time.perf_counter()
        uv, faces, _ = atlas(surface.vertices, surface.faces)
        print(f"  xatlas: L2 {l2_stretch(surface, uv, faces)[0]:.4f} in several charts, {time.perf_counter() - start:.2f} s")


def combination(texels, megapixels, triangles):
    surface = half_sphere(triangles, 0.05, 9)
    surface = Surface(vertices=surface.vertices, faces=surface.faces)
    side = int(np.sqrt(megapixels * 1e6))
    rng = np.random.default_rng(0)
    image = ndimage.zoom(rng.random((side // 8 + 1, side // 8 + 1, 3)).astype(np.float32), (8, 8, 1), order=1)[:side, :side]
    taken = []
    for number, direction in enumerate(((0, 0, 1), (1, 0, 0.6), (-1, 0, 0.6), (0, 1, 0.6), (0, -1, 0.6))):
        camera = camera_towards(
            np.array([0, 0, 0.4]), np.array(direction, float), np.array([0.1, 0.2, 1.0]), 5.0, focal=1.9 * side, size=(side, side)
        )
        taken.append(Photograph(camera=camera, picture=image * (1 + 0.1 * number) / 1.5, name=str(number)))
    uv = surface.vertices[:, :2]
    uv = 0.5 + 0.49 * uv / np.abs(uv).max()
    combine_photographs(surface, uv, [replace(t) for t in taken[:1]], 64, background=None)
    start = time.perf_counter()
    binding = bind_photographs(surface, taken, background=None)
    bound = time.perf_counter() - start
    found = combine_photographs(surface, uv, taken, texels, binding=binding)
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"{len(taken)} photographs of {side * side / 1e6:.0f} megapixels, {len(surface.faces)} triangles, {texels}^2 texels:")
    print(f"  {seconds:.1f} s, of these {bound:.1f} s binding; peak {peak:.2f} GiB; {100 * found.known.mean():.0f} % known")


def restorations():
    rng = np.random.default_rng(1)
    grain = ndimage.gaussian_filter(rng.standard_normal((450, 600, 3)), (1.5, 1.5, 0))
    image = np.clip(0.5 + 0.8 * grain, 0, 1).astype(np.float32)
    missing = damage()
    for method in ("split", "synthesize", "inpaint"):
        seconds = best(lambda m=method: restore(image, missing, m), 3)
        print(f"600 x 450, {100 * missing.mean():.1f} % missing, {method}: {seconds:.2f} s")
    try:
        import cv2
    except ImportError:
        return
    levels = np.round(image * 255).astype(np.uint8)
    seconds = best(lambda: cv2.inpaint(levels, missing.astype(np.uint8), 5, cv2.INPAINT_TELEA), 3)
    print(f"  OpenCV Telea: {seconds:.2f} s")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--texels", type=int, default=4096)
    parser.add_argument("--megapixels", type=float, default=12.0)
    parser.add_argument("--triangles", type=int, default=100_000)
    args = parser.parse_args()
    a = np.random.default_rng(0).random((3000, 3000)).astype(np.float32)
    seconds = best(lambda: a @ a, 2)
    block = np.ones(2**26, np.float32)
    copied = best(block.copy, 2)
    print(f"machine: sgemm {2 * 3000**3 / seconds / 1e9:.0f} GFLOP/s, copy {2 * block.nbytes / copied / 1e9:.1f} GB/s")
    combination(args.texels, args.megapixels, args.triangles)
    parameterizations()
    restorations()


if __name__ == "__main__":
    main()
