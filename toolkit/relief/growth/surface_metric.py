"""The papers' metric: neighbours laid on the sampled surface, squared distance to its triangles. The reference."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from intaglio.arrays import Array
from intaglio.kernels.selection import SHORTLIST, pick_by_rank, select_near_best
from intaglio.kernels.surface_matching import SurfaceMatcher, SurfaceMesh
from intaglio.kernels.transfer import encode_srgb
from intaglio.mesh import Topology
from intaglio.relief.ground import Ground
from intaglio.relief.growth.comparison import Comparison
from intaglio.relief.growth.oversampling import FineGround, subdivide_measured
from intaglio.relief.growth.propagation import choose_near_best
from intaglio.relief.growth.samples import Samples, with_filled
from intaglio.relief.growth.settings import Selection
from intaglio.relief.growth.state import Picks, State


class SurfaceMetric:
    """Neighbours within w edges, matched by projected position on the base (TPAMI 2008, figure 6 and eq. 2).

    Where the sample set is oversampled, so is the surface: neighbours are counted along its halved edges and laid on its
    subdivided triangles. With colours in the comparison a neighbour's is compared with that of the vertex that it falls nearest
    to (3DIM 2005, section 6; its formula is printed unreadably: the mean over the channels is taken, which keeps it in [0, 1]).

    Parameters
    ----------
    ground : Ground
    samples : Samples
    window : int
        w, in edges.
    rotations : int
        R, at least 1.
    device : str
    comparison : Comparison, optional
        What is compared beside relief; default nothing.
    partners : {"measured", "textured"}
        Where neighbours may fall: see `ReliefSettings`.
    """

    def __init__(
        self,
        ground: Ground,
        samples: Samples,
        window: int,
        rotations: int,
        device: str,
        comparison: Comparison | None = None,
        partners: str = "measured",
    ) -> None:
        self.samples = self._measured_samples = samples
        self.device = device
        self._ground = ground
        self._comparison = Comparison() if comparison is None else comparison
        self._partners = partners
        self._center = ground.foot.mean(axis=0)
        self._rotations = rotations
        angle = 2 * np.pi * np.arange(rotations) / rotations
        # Distances are squared in single precision: at unit relief scale they keep their digits.
        relief = ground.height[ground.measured]
        self._scale = max(float(relief.std()), 1e-6 * ground.spacing)
        if self._comparison.color_weight > 0:
            # Colours count in units of the relief's span: they must not drown in what stands for no match.
            self._scale = max(self._scale, 0.01 * self._comparison.span)
        fine = subdivide_measured(ground, samples.halvings)
        self._fine = fine
        self._fine_normal = np.cross(fine.u, fine.v)
        self._fine_normal[: len(ground.normal)] = ground.normal
        topology = ground.topology if samples.halvings == 0 else Topology.of(fine.faces, len(fine.vertex))
        mesh = SurfaceMesh(
            foot=self._unit(fine.foot),
            u=fine.u,
            v=fine.v,
            offsets=topology.offsets,
            neighbors=topology.neighbors,
            face_offsets=topology.face_offsets,
            incident=topology.incident,
            faces=fine.faces,
        )
        self._matcher = SurfaceMatcher(mesh, np.stack([np.cos(angle), np.sin(angle)], axis=1), device)
        self._rings = ring_neighborhoods(fine, topology.graph, window, ground.spacing)
        self._take(samples, ground.measured)

    def pick(self, targets: Array, window: Array, state: State, selection: Selection, draw: Array) -> Picks:
        """See `Metric.pick`."""
        near_best = selection.rule == "near-best"
        sample_count = len(self.samples.vertex)
        candidates = sample_count * self._rotations
        chosen = np.full(len(targets), -1)
        error = np.full(len(targets), np.inf)
        at_once = int(np.clip(32_000_000 // candidates, 1, 4096))
        height = self._on_fine(state.height, self._fine.height)
        position = self._unit(self._fine.foot + height[:, None] * self._fine_normal)
        textured = self._on_fine(state.textured, self._fine.measured)
        color = self._colors(state)
        if self._partners == "textured":
            self._matcher.take_partners(textured)
        for first in range(0, len(targets), at_once):
            rows = slice(first, first + at_once)
            part = targets[rows]
            offsets, listed, weight = self._textured_lists(part, window[rows], textured)
            cost = self._matcher.costs(
                part, position, offsets, listed, weight, 1 + selection.tolerance if near_best else 1e30,
                color=color, shape_weight=1 - self._comparison.color_weight,
            )  # fmt: skip
            if near_best:
                shortlist = np.zeros((len(part), SHORTLIST), np.int32)
                count = np.zeros(len(part), np.int32)
                spare = select_near_best(
                    cost, np.zeros(len(part), np.float32), 1 + selection.tolerance, shortlist, count,
                    stride=sample_count, samples=sample_count, draw=draw[rows],
                )  # fmt: skip
                found = np.take_along_axis(cost.numpy(), shortlist, axis=1).astype(np.float64)
                chosen[rows], error[rows] = choose_near_best(shortlist, found, count, selection.tolerance, draw[rows], spare)
            else:
                best, count = pick_by_rank(cost.numpy(), selection.eta / 100, draw[rows])
                chosen[rows] = np.where(count > 0, best[:, 0], -1)
                error[rows] = np.where(count > 0, np.take_along_axis(cost.numpy(), best, axis=1)[:, 0], np.inf)
            chosen[rows][np.diff(offsets) == 0] = -1
        return Picks(
            np.where(chosen >= 0, chosen % sample_count, -1),
            np.where(chosen >= 0, 2 * np.pi / self._rotations * (chosen // sample_count), 0).astype(np.float32),
            np.where(chosen >= 0, error * self._scale**2, np.inf),
        )

    def absorb(self, state: State) -> None:
        """See `Metric.absorb`."""
        samples = with_filled(
            self._measured_samples, self._ground, state.textured, state.height, state.source, state.rotation, state.color
        )
        self._take(samples, state.textured)

    def _take(self, samples: Samples, is_sample: Array) -> None:
        ground = self._ground
        # The descent to the partner starts at a corner of the sample's triangle; its source may lie elsewhere.
        start = ground.faces[samples.first_face]
        apart = np.linalg.norm(ground.foot[start] - samples.foot[:, None], axis=2)
        start = start[np.arange(len(start)), np.argmin(apart, axis=1)]
        self.samples = samples
        partners = self._on_fine(is_sample, self._fine.measured)
        self._matcher.take_samples(self._unit(samples.foot), samples.u, samples.v, start, partners)

    def _on_fine(self, values: Array, fine: Array) -> Array:
        """Return ``values`` (N,) of the ground's vertices, followed by those that midpoints have in ``fine`` (M,)."""
        return np.concatenate([values, fine[len(values) :]])

    def _colors(self, state: State) -> Array | None:
        """Colours (M, 3) as displayed, scaled so that squared differences add to those of relief; None if they don't count."""
        weight = self._comparison.color_weight
        if weight == 0 or state.color is None or self._fine.color is None:
            return None
        shown = encode_srgb(self._on_fine(state.color, self._fine.color))
        return np.asarray(shown * (np.sqrt(weight / 3) * self._comparison.span / self._scale))

    def _textured_lists(self, targets: Array, window: Array, textured: Array) -> tuple[Array, Array, Array]:
        """Return offsets (T + 1,), textured neighbours and weights that sum to 1 for each target."""
        offsets, neighbor, ring, weight = self._rings
        counts = np.diff(offsets)[targets]
        row = np.repeat(np.arange(len(targets)), counts)
        at = np.repeat(offsets[targets] - np.cumsum(counts) + counts, counts) + np.arange(counts.sum())
        use = textured[neighbor[at]] & (ring[at] <= window[row])
        row, at = row[use], at[use]
        total = np.bincount(row, weight[at], len(targets))
        out = np.zeros(len(targets) + 1, np.int32)
        np.cumsum(np.bincount(row, minlength=len(targets)), out=out[1:])
        return out, neighbor[at], (weight[at] / total[row]).astype(np.float32)

    def _unit(self, points: Array) -> Array:
        return (points - self._center) / self._scale


def ring_neighborhoods(ground: FineGround, graph: csr_array, window: int, spacing: float) -> tuple[Array, Array, Array, Array]:
    """Return, for every target, the vertices within ``window`` edges: offsets (M + 1,), vertex, ring, Gaussian weight.

    Neighbours are ordered ring by ring and by angle, so that each lies next to the one before it.
    """
    count = len(ground.measured)
    targets = np.flatnonzero(~ground.measured)
    reached = csr_array((np.ones(len(targets), np.float32), (np.arange(len(targets)), targets)), shape=(len(targets), count))
    rows, vertices, rings = [], [], []
    frontier = reached
    for ring in range(1, window + 1):
        wider = (frontier @ graph) + reached
        wider.data[:] = 1
        fresh = wider - reached
        fresh.eliminate_zeros()
        at = fresh.tocoo()
        rows.append(at.coords[0])
        vertices.append(at.coords[1])
        rings.append(np.full(at.nnz, ring))
        reached, frontier = wider, fresh
    row, vertex, ring_of = (np.concatenate(a) for a in (rows, vertices, rings))
    t = targets[row]
    offset = ground.foot[vertex] - ground.foot[t]
    angle = np.arctan2(np.einsum("ij,ij->i", offset, ground.v[t]), np.einsum("ij,ij->i", offset, ground.u[t]))
    order = np.lexsort([angle, ring_of, t])
    t, vertex, ring_of = t[order], vertex[order], ring_of[order]
    distance = np.linalg.norm(offset[order], axis=1)
    sigma = (2 * window + 1) / 6.4 * spacing
    offsets = np.zeros(count + 1, np.int64)
    np.cumsum(np.bincount(t, minlength=count), out=offsets[1:])
    return offsets, vertex, ring_of, np.exp(-0.5 * (distance / sigma) ** 2)
