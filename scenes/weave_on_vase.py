"""A weave that closes on itself, laid over a vase: threads that pass over each other, all around."""

from __future__ import annotations

import argparse
import time

import numpy as np

from intaglio.files import write_image
from intaglio.geometry import PointSet, extend_geometry, mesh_geometry, wrap_geometry
from intaglio.mesh import grid_faces
from intaglio.progress import ProgressBar
from intaglio.render import Light, frame, view
from intaglio.scenes.common import main
from intaglio.scenes.geometry_textures import weave_swatch

Array = np.ndarray


def vase(columns: int = 96, rows: int = 96) -> tuple[Array, Array, Array]:
    """Return vertices, faces and texture coordinates of a vase; u runs around it, v so that squares stay square."""
    height = np.linspace(0, 4.2, 2000)
    radius = 1.0 + 0.4 * np.sin(0.55 * np.pi * height + 0.3) * (1 - 0.06 * height)
    # Conformal: a step along the profile counts as the radius there.
    step = np.hypot(np.gradient(height), np.gradient(radius)) / radius
    along = np.cumsum(step) - step[0]
    at = np.linspace(0, along[-1], rows)
    z, r = np.interp(at, along, height), np.interp(at, along, radius)
    u, v = np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows)
    angle = 2 * np.pi * u
    place = np.stack([np.outer(np.cos(angle), r), np.outer(np.sin(angle), r), np.outer(np.ones(columns + 1), z)], axis=-1)
    # The last column is the first, to the bit, so that the seam leaves no crease.
    place[-1] = place[0]
    return place.reshape(-1, 3), grid_faces(columns + 1, rows), np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)


def run(args: argparse.Namespace) -> PointSet:
    """Run the scene."""
    texture = weave_swatch()
    print("Weave on a vase: extending …")
    start = time.perf_counter()
    with ProgressBar("laying patches") as bar:
        tile = extend_geometry(texture, 16.0, 3.9, tileable=True, seed=args.seed, device=args.device, progress=bar.update)
    extended = time.perf_counter() - start
    vertices, faces, uv = vase()
    start = time.perf_counter()
    covered = wrap_geometry(tile, vertices, faces, uv, size=16.0, repeat=(4, 3), device=args.device)
    carried = time.perf_counter() - start
    covered.write(args.output / "weave_on_vase.ply")
    print("meshing and rendering …")
    mesh = mesh_geometry(covered, axis=None, device=args.device)
    mesh.write(args.output / "weave_on_vase.glb")
    looks = [frame(vertices, np.array(towards), up=(0.0, 0.0, 1.0)) for towards in ((1.0, -2.0, 0.5), (-1.5, -1.2, 1.6))]
    light = Light(tilt=135.0, slant=55.0)
    pictures = [view(mesh.vertices, mesh.faces, camera=look, light=light, size=(900, 800)) for look in looks]
    write_image(np.concatenate(pictures, axis=1), args.output / "weave_on_vase.png")
    print(f"  tile of {len(tile)} points in {extended:.2f} s; {len(covered)} points carried over the vase in {carried:.2f} s")
    print(f"  {covered.notes[-1]}")
    print(f"  mesh of {len(mesh.faces)} triangles")
    print(f"wrote weave_on_vase.ply, .glb and .png to {args.output}")
    return covered


if __name__ == "__main__":
    main(run, __doc__)
