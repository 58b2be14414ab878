"""Holes of real scans filled with relief over their own smoothed surface, beside what a smooth filling gives."""

from __future__ import annotations

import argparse
import resource
from typing import Any

import numpy as np

from intaglio.mesh import Surface, adjacency, read_surface
from intaglio.relief import choose_viewpoints, clay_pictures, fixed_cameras, largest_filling, mark_pictured, without_relief
from intaglio.scenes.common import SMOOTH, Result, main, picture_size, real_data, run_scene

Array = np.ndarray

# Openings as wide as what is around them have no surroundings to take pieces from: there propagation is smoother.
WIDE = {"refine": 3}
# Mesh, heading and settings.
SCANS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "statue_face": ("face000_rangemap/face000.ply", "Statue's face", WIDE),
    "lion_statue": ("odedstein_lionstatue/lionstatue.obj", "Lion statue, its open underside", WIDE),
    "bunny_base": ("bunny_range_scans/bun_zipper.ply", "Bunny, merged scans", {}),
    "stone_lion": (
        "lion_takanawa_points/lion_mesh_colour_300k.ply",
        "Stone lion in colour",
        {"hole_size": (0.0, 1.6)},
    ),
}


def smooth_pictures(whole: Surface) -> dict[str, list[Array]]:
    """Render the smooth filling from where the completion is seen, in clay."""
    cameras = fixed_cameras(whole, choose_viewpoints(whole))
    smooth, size = without_relief(whole).part(mark_pictured(whole, whole)), picture_size()
    return {SMOOTH: clay_pictures(smooth, cameras, size=(size, size), color=False)}


def relief_energy(surface: Surface) -> float:
    """Return how rough the filling of the largest hole is against its surroundings: its finest waves.

    What a vertex stands off the mean of its neighbours, along the base's normal, squared, in the median over the filling and over
    the measured vertices around it; the same measure for any filling, whatever its base.
    """
    graph = adjacency(surface.faces, len(surface.vertices))
    degree = np.maximum(np.diff(graph.indptr), 1)[:, None]
    off = np.einsum("ij,ij->i", surface.vertices - (graph @ surface.vertices) / degree, surface.normal) ** 2
    inside = largest_filling(surface)
    center = surface.vertices[inside].mean(axis=0)
    reach = 1.8 * np.linalg.norm(surface.vertices[inside] - center, axis=1).max()
    around = surface.measured & (np.linalg.norm(surface.vertices - center, axis=1) < reach)
    return float(np.median(off[inside]) / np.median(off[around]))


def run(args: argparse.Namespace) -> list[Result]:
    """Run the scene."""
    results = []
    for name, (path, title, settings) in SCANS.items():
        scan = read_surface(real_data(f"meshes/{path}"))
        result = run_scene(name, title, scan, args, base="smooth", more=smooth_pictures, **settings)
        own, smooth = (relief_energy(s) for s in (result.whole, without_relief(result.whole)))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(f"  roughness of the largest filling / of what surrounds it: {own:.2f}; filled smoothly only: {smooth:.2f}")
        print(f"  peak memory of the process so far: {peak:.2f} GiB")
        results.append(result)
    return results


if __name__ == "__main__":
    main(run, __doc__)
