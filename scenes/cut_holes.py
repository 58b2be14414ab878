"""Holes cut into real scans whose truth is kept: Intaglio, a smooth filling and the truth under one light, and the figures.

The holes are drawn by fixed seeds, where the surface is rough. Every second one (``held out``) was not looked at while the method
was made.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from intaglio.mesh import Surface, adjacency, border_edges, pieces, read_surface, unique_edges
from intaglio.randomness import uniform
from intaglio.scenes.common import real_data

Array = np.ndarray

# Streams of random numbers are named where Intaglio draws; a scene's own stands apart from all of them.
_STREAM = 1000


@dataclass(frozen=True)
class Case:
    """A hole to cut: the mesh's file, the radius in mean edges, the seed, and whether the case is for final figures alone."""

    name: str
    path: str
    radius: int
    seed: int
    held_out: bool = False


CASES = (
    Case("demosthenes_20", "odedstein_demosthenes/demosthenes-low-res.obj", 20, 1),
    Case("lion_statue_20", "odedstein_lionstatue/lionstatue.obj", 20, 1),
    Case("nefertiti_20", "nefertiti_50k/nefertiti.obj", 20, 1),
    Case("face_30", "face000_rangemap/face000.ply", 30, 1),
    Case("stone_lion_30", "lion_takanawa_points/lion_mesh_colour_300k.ply", 30, 1),
    Case("sea_vase_10", "nikolov_seaVase/seaVase_decimated.ply", 10, 1),
    Case("specimen_10", "smithsonian_usnm_1145291/usnm_1145291.glb", 10, 1),
    Case("demosthenes_10", "odedstein_demosthenes/demosthenes-low-res.obj", 10, 2, True),
    Case("lion_statue_30", "odedstein_lionstatue/lionstatue.obj", 30, 2, True),
    Case("nefertiti_30", "nefertiti_50k/nefertiti.obj", 30, 2, True),
    Case("face_20", "face000_rangemap/face000.ply", 20, 2, True),
    Case("stone_lion_20", "lion_takanawa_points/lion_mesh_colour_300k.ply", 20, 2, True),
    Case("bird_bath_10", "nikolov_birdBath/birdBath_decimated.ply", 10, 2, True),
    Case("bunny_20", "bunny_range_scans/bun_zipper.ply", 20, 2, True),
)


@dataclass(frozen=True)
class CutHole:
    """A scan with a hole cut into it.

    Attributes
    ----------
    truth : Surface
        The scan before.
    removed : (N,) bool array
        Which of its vertices the hole takes.
    edge : float
        Mean length of the edges around the hole, in the scan's unit.
    center : (3,) array
        Where the hole is.
    """

    truth: Surface
    removed: Array
    edge: float
    center: Array

    @property
    def scan(self) -> Surface:
        """What is left."""
        return self.truth.part(~self.removed)


def edge_graph(surface: Surface) -> csr_array:
    """Return the edges' lengths as a symmetric sparse matrix."""
    edges = unique_edges(surface.faces)
    length = np.linalg.norm(surface.vertices[edges[:, 0]] - surface.vertices[edges[:, 1]], axis=1)
    both = np.concatenate([edges, edges[:, ::-1]])
    count = len(surface.vertices)
    return csr_array((np.tile(np.maximum(length, 1e-300), 2), (both[:, 0], both[:, 1])), shape=(count, count))


def cut_hole(truth: Surface, radius: float, seed: int) -> CutHole:
    """Cut a round hole, ``radius`` mean edges wide, where the surface is rough and no border is near."""
    graph = edge_graph(truth)
    count = len(truth.vertices)
    ring = adjacency(truth.faces, count)
    degree = np.maximum(np.diff(ring.indptr), 1)[:, None]
    length = np.asarray(graph.sum(axis=1)).reshape(-1) / degree[:, 0]
    off = np.linalg.norm(truth.vertices - (ring @ truth.vertices) / degree, axis=1) / np.maximum(length, 1e-300)
    for _ in range(20):
        off = (ring @ off) / degree[:, 0]
    rough = off >= np.median(off)
    border = np.zeros(count, bool)
    border[border_edges(truth.faces)] = True
    order = np.argsort(uniform(seed, _STREAM, np.arange(count)), kind="stable")
    for vertex in order[rough[order]]:
        edge = float(length[vertex])
        distance = dijkstra(graph, indices=int(vertex), limit=2.2 * radius * edge)
        near = distance <= radius * edge
        edge = float(length[near].mean())
        near = distance <= radius * edge
        wide = np.isfinite(distance)
        # A disc with surface around it: taking it away leaves one border more, and the rest in one piece.
        if border[wide].any() or near.sum() < 1.2 * radius**2:
            continue
        left = truth.part(~near & wide)
        if pieces(left.faces, len(left.vertices))[0] == 1 and len(truth.part(near).faces) > 0:
            return CutHole(truth, near, edge, truth.vertices[vertex])
    raise ValueError("no place for such a hole")


def cut_case(case: Case) -> CutHole:
    """Read a case's mesh and cut its hole."""
    return cut_hole(read_surface(real_data(f"meshes/{case.path}")), case.radius, case.seed)
