"""Holes cut into real scans whose truth is kept: Intaglio, a smooth filling and the truth under one light, and the figures.

The holes are drawn by fixed seeds, where the surface is rough. Every second one (``held out``) was not looked at while the method
was made.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from intaglio.files import write_image
from intaglio.mesh import Surface, adjacency, border_edges, pieces, read_surface, unique_edges
from intaglio.randomness import uniform
from intaglio.relief import ReliefReport, assess_relief, complete_relief, list_holes, without_relief
from intaglio.render import frame, view
from intaglio.scenes.common import largest_piece, main, real_data

Array = np.ndarray

# Streams of random numbers are named where Intaglio draws; a scene's own stands apart from all of them.
_STREAM = 1000
# No border of the scan lies within so many radii of a hole's middle.
_WIDE = 2.2


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

NAMES = tuple(case.name for case in CASES)


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
    far = np.full(count, np.inf)
    if border.any():
        far = dijkstra(graph, indices=np.flatnonzero(border), min_only=True)
    order = np.argsort(uniform(seed, _STREAM, np.arange(count)), kind="stable")
    for vertex in order[(rough & (far > _WIDE * radius * length))[order]]:
        edge = float(length[vertex])
        distance = dijkstra(graph, indices=int(vertex), limit=_WIDE * radius * edge)
        near = distance <= radius * edge
        edge = float(length[near].mean())
        near = distance <= radius * edge
        wide = np.isfinite(distance)
        # A disc with surface around it: taking it away leaves the rest in one piece.
        if near.sum() < 1.2 * radius**2:
            continue
        left = truth.part(~near & wide)
        if pieces(left.faces, len(left.vertices))[0] == 1 and len(truth.part(near).faces) > 0:
            return CutHole(truth, near, edge, truth.vertices[vertex])
    raise ValueError("no place for such a hole")


def cut_case(case: Case) -> CutHole:
    """Read a case's mesh and cut its hole."""
    return cut_hole(read_surface(real_data(f"meshes/{case.path}")), case.radius, case.seed)


@dataclass(frozen=True)
class CutResult:
    """A cut hole that was filled: the case, the hole, the completion, its figures, and CPU seconds."""

    case: Case
    hole: CutHole
    whole: Surface
    report: ReliefReport
    seconds: float


def fill_case(case: Case, seed: int = 1) -> CutResult:
    """Cut a case's hole, fill it with the default options, and measure."""
    hole = cut_case(case)
    scan = hole.scan
    number = min(list_holes(scan), key=lambda h: float(np.linalg.norm(h.center - hole.center))).number
    start = time.process_time()
    whole = complete_relief(scan, "smooth", holes=number, seed=seed)
    seconds = time.process_time() - start
    return CutResult(case, hole, whole, assess_relief(whole, hole.truth), seconds)


def pictures(result: CutResult, size: int) -> list[Array]:
    """Return the hole, the smooth filling, Intaglio's and the truth under one raking light, each (size, size, 3)."""
    hole, whole = result.hole, result.whole
    taken = hole.truth.vertices[hole.removed]
    reach = 1.8 * float(np.linalg.norm(taken - hole.center, axis=1).max())
    toward = hole.truth.normal[hole.removed].mean(axis=0)
    up = np.eye(3)[1] if abs(toward[1]) < 0.8 * np.linalg.norm(toward) else np.eye(3)[2]
    near = np.linalg.norm(hole.truth.vertices - hole.center, axis=1) < reach
    camera = frame(hole.truth.vertices[near], toward, up=up)
    images = []
    for surface in (hole.scan, without_relief(whole), whole, hole.truth):
        part = largest_piece(surface.part(np.linalg.norm(surface.vertices - hole.center, axis=1) < 1.1 * reach))
        images.append(view(part.vertices, part.faces, camera=camera, size=(size, size)))
    return images


def row(result: CutResult) -> str:
    """Return a case's figures as a row of a table."""
    report, edge = result.report, result.hole.edge
    truth = report.truth
    assert truth is not None
    ratios = " · ".join(" ".join(f"{v:.2f}" for v in report.roughness[band]) for band in range(3))
    real = " · ".join(" ".join(f"{v:.2f}" for v in truth.roughness[band]) for band in range(3))
    return (
        f"| {result.case.name}{' (held out)' if result.case.held_out else ''} | {report.filled_count} | {ratios} | {real} | "
        f"{truth.distance_rms / edge:.2f} | {truth.smooth_rms / edge:.2f} | {report.coherence:.0%} | {report.local_share:.0%} | "
        f"{result.seconds:.1f} |"
    )


def run(args: argparse.Namespace, names: tuple[str, ...], size: int = 480) -> list[CutResult]:
    """Run the scene: a row of four pictures and a row of figures for every case; which of the last two is the truth is drawn."""
    results, sheet, answers = [], [], []
    print("| case | filled | roughness by band, rim to middle | the truth's | rms / edge | smooth | coherence | local | CPU s |")
    print("|---|---|---|---|---|---|---|---|---|")
    for number, case in enumerate(CASES):
        if case.name not in names:
            continue
        result = fill_case(case, args.seed)
        results.append(result)
        print(row(result), flush=True)
        scan, smooth, own, truth = pictures(result, size)
        own_first = bool(uniform(args.seed, _STREAM, number, 7) < 0.5)
        answers.append(f"{case.name}: {'third' if own_first else 'fourth'}")
        sheet.append(np.concatenate([scan, smooth, *((own, truth) if own_first else (truth, own))], axis=1))
    write_image(np.concatenate(sheet, axis=0), args.output / "cut_holes.png")
    (args.output / "cut_holes.txt").write_text("\n".join(answers) + "\n", encoding="utf-8")
    print(f"wrote {args.output / 'cut_holes.png'}; cut_holes.txt says which picture is the completion")
    return results


if __name__ == "__main__":
    main(run, __doc__, NAMES)
