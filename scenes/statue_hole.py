"""A statue's hole: what is left, filled smoothly, filled by Intaglio and the truth, close by under one raking light.

``carved_hair`` is made here: locks of wavy hair as archaic statues have them. ``stone_mane`` and ``specimen`` are scans of the
data folder.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial

import numpy as np
import trimesh

from intaglio.mesh import Surface
from intaglio.relief import list_holes
from intaglio.scenes.common import Result, has_data, main, run_scene
from intaglio.scenes.cut_holes import CASES, CutHole, cut_case, edge_graph

Array = np.ndarray

# Half axes of the head, in millimetres, and the hole's radius.
HEAD = (110.0, 121.0, 93.5)
RADIUS = 17.0
# Where the hole is cut, as a direction from the head's middle.
PLACE = (1.0, 0.1, 0.3)
LOCKS, STRANDS = 46, 3


def hair(subdivisions: int = 7, seed: int = 3) -> Surface:
    """Return a head covered with wavy locks, watertight, in millimetres; 7 subdivisions give 163,842 vertices."""
    sphere = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    at = np.asarray(sphere.vertices)
    draw = np.random.default_rng(seed)
    turn, down = np.arctan2(at[:, 0], at[:, 2]), np.arccos(np.clip(at[:, 1], -1, 1))
    # Along the hair and across it; both wander, so that no lock is the copy of another.
    along = 2.4 * down + 0.3 * _wander(at, draw, 1.5)
    across = LOCKS * turn / (2 * np.pi) + 0.3 * np.sin(2 * np.pi * along) + 0.8 * _wander(at, draw, 1.8)
    lock = _ridge(np.pi * across)
    strand = _ridge(np.pi * STRANDS * across + 1.2 * _wander(at, draw, 4.0))
    wave = 0.5 + 0.5 * np.cos(2 * np.pi * along + 0.6)
    height = 0.020 * lock * (0.8 + 0.2 * wave) + 0.006 * strand * lock + 0.008 * wave
    height += 0.0025 * _wander(at, draw, 14.0) + 0.0004 * _wander(at, draw, 90.0)
    # All locks meet at the crown and below: there they run out.
    height *= np.clip(np.minimum(down, np.pi - down) / 0.5, 0, 1)
    return Surface(vertices=at * (1 + height)[:, None] * HEAD, faces=np.asarray(sphere.faces))


def _ridge(phase: Array) -> Array:
    return np.sqrt(np.cos(phase) ** 2 + 0.015)


def _wander(at: Array, draw: np.random.Generator, frequency: float, waves: int = 24) -> Array:
    """Return smooth noise of unit variance at points (N, 3): waves in all directions."""
    direction = frequency * draw.normal(0.0, 1.0, (waves, 3))
    return np.sqrt(2 / waves) * np.cos(at @ direction.T + draw.uniform(0, 2 * np.pi, waves)).sum(axis=1)


def carved_hair() -> CutHole:
    """Return the head with a hole."""
    truth = hair()
    center = truth.vertices[np.argmax(truth.vertices @ np.array(PLACE))]
    removed = np.linalg.norm(truth.vertices - center, axis=1) < RADIUS
    return CutHole(truth, removed, float(edge_graph(truth).data.mean()), center)


def cut_scan(name: str) -> CutHole | None:
    """Return a scan of the data folder with its hole; None where the folder has none."""
    (case,) = (c for c in CASES if c.name == name)
    return cut_case(case) if has_data(f"meshes/{case.path}") else None


STATUES: dict[str, tuple[str, Callable[[], CutHole | None]]] = {
    "carved_hair": ("A hole in carved hair", carved_hair),
    "stone_mane": ("A hole in a stone lion's mane", partial(cut_scan, "lion_statue_20")),
    "specimen": ("A hole in a museum specimen", partial(cut_scan, "specimen_10")),
}


def run(args: argparse.Namespace, names: tuple[str, ...] = tuple(STATUES)) -> list[Result]:
    """Run the scene."""
    results = []
    for name in names:
        title, make = STATUES[name]
        cut = make()
        if cut is None:
            continue
        scan = cut.scan
        # Other openings, such as the lion's below, stay.
        hole = min(list_holes(scan), key=lambda h: float(np.linalg.norm(scan.vertices[h.loop].mean(axis=0) - cut.center)))
        results.append(run_scene(name, title, scan, args, truth=cut.truth, base="smooth", holes=hole.number))
    return results


if __name__ == "__main__":
    main(run, __doc__, STATUES)
