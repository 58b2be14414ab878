"""Completion by pieces, hole by hole: each with its own surroundings, scale and levels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array, Progress
from intaglio.mesh import SmoothBase, Sphere
from intaglio.relief.assembly import Filled
from intaglio.relief.coherent import CoherentFilling, Weights, fill_coherently
from intaglio.relief.ground import Ground
from intaglio.relief.growth import ReliefSettings, Resources, choose_parameters

# In words: a filling whose pieces are fewer neighbours than this is said to be so.
_COHERENT = 0.85
# Over a plane, cylinder or sphere: what the sources' own heights count in joining, against differences along edges; and what it
# costs to stand on one's head where frames lie one way.
_PULL, _UPRIGHT = 0.1, 0.3


def fill_regions(
    ground: Ground, allowed: Array | None, settings: ReliefSettings, resources: Resources, progress: Progress | None
) -> Filled:
    """Fill all targets by coherent pieces: over a smooth base hole by hole, else together.

    Parameters
    ----------
    ground : Ground
    allowed : (M,) bool array or None
        Which of the measured vertices relief may be taken from; None for those around each hole.
    settings : ReliefSettings
    resources : Resources
    progress : callable, optional
        Called with (steps done, steps to do).
    """
    count = len(ground.measured)
    may = None if allowed is None else np.concatenate([allowed, np.zeros(count - len(allowed), bool)])
    # Over a smooth base the frames lie by chance: there a direction says nothing.
    turning, weights = True, Weights()
    notes: tuple[str, ...] = ()
    if settings.rotations is not None:
        turning = settings.rotations > 1
    elif not isinstance(ground.base, SmoothBase):
        parameters = choose_parameters(ground, 7, 1.0, None, 1.0)
        turning, notes = parameters.rotations > 1, parameters.notes
    if not isinstance(ground.base, SmoothBase):
        # The base is known where nothing was measured, so heights count as such.
        weights = replace(weights, afloat=0.0, pull=_PULL)
        if not isinstance(ground.base, Sphere):
            weights = replace(weights, upright=_UPRIGHT)
    holes = _holes(ground)
    out = _Whole(ground)
    if not holes:
        # Rims so narrow that triangles alone close them.
        return out.filled(())
    found: list[CoherentFilling] = []
    for number, targets in enumerate(holes):
        whole = len(holes) == 1
        region, keep = (ground, np.ones(count, bool)) if whole else ground.around(targets, near=may is None)

        def report(done: int, total: int, number: int = number) -> None:
            if progress is not None:
                progress(number * total + done, len(holes) * total)

        filling = fill_coherently(
            region,
            None if may is None else may[keep],
            turning=turning,
            mirrored=settings.mirror,
            seed=resources.seed + number,
            device=resources.device,
            weights=weights,
            progress=report,
        )
        out.take(filling, keep)
        found.append(filling)
    share = float(np.average([f.coherence for f in found], weights=[len(t) for t in holes]))
    notes += (
        f"filled by pieces at {max(f.levels for f in found)} levels, {'turned' if turning else 'not turned'}"
        f"{' or mirrored' if settings.mirror else ''}; {share:.0%} of edges join sources that are neighbours; "
        f"seed {resources.seed}, device {resources.device}",
    )
    if share < _COHERENT:
        notes += ("the pieces are small: the scan holds little that goes on as the surroundings do",)
    if isinstance(ground.base, SmoothBase):
        scales = [f.scale for f in found]
        notes += (f"base laid at wave lengths of {min(scales):.6g} to {max(scales):.6g}, by the size of each hole",)
    return out.filled(notes)


def _holes(ground: Ground) -> list[Array]:
    """Return the targets of each hole; of a plane, cylinder or sphere all together, as their extents are of one size."""
    targets = np.flatnonzero(~ground.measured)
    if len(targets) == 0:
        return []
    if not isinstance(ground.base, SmoothBase):
        return [targets]
    graph = csr_array(ground.topology.graph[targets][:, targets])
    number, label = connected_components(graph, directed=False)
    return [targets[label == k] for k in range(number)]


class _Whole:
    """Collects the fillings of all holes over one ground."""

    def __init__(self, ground: Ground) -> None:
        count = len(ground.measured)
        self._ground = ground
        self._vertices = ground.vertices.copy()
        self._foot, self._normal, self._u = ground.foot.copy(), ground.normal.copy(), ground.u.copy()
        self._source = np.where(ground.measured, np.arange(count), -1).astype(np.int32)
        self._rotation, self._error = np.zeros(count, np.float32), np.zeros(count, np.float32)
        self._confidence = np.ones(count, np.float32)

    def take(self, filling: CoherentFilling, keep: Array) -> None:
        """Take a hole's filling; ``keep`` (N,) says which vertices its part of the ground holds."""
        part = filling.ground
        at = np.flatnonzero(keep)
        self._foot[at], self._normal[at], self._u[at] = part.foot, part.normal, part.u
        target = ~part.measured
        raised = part.foot + filling.height[:, None] * part.normal
        self._vertices[at[target]] = raised[target]
        self._source[at[target]] = at[filling.source[target]]
        self._rotation[at[target]] = filling.rotation[target]
        self._error[at[target]] = filling.error[target]
        self._confidence[at[target]] = filling.confidence[target]

    def filled(self, notes: tuple[str, ...]) -> Filled:
        """Return all of it."""
        ground = self._ground
        base = ground.base
        if isinstance(base, SmoothBase):
            base = replace(base, vertices=self._foot, normals=self._normal)
        ground = replace(ground, base=base, foot=self._foot, normal=self._normal, u=self._u, v=np.cross(self._normal, self._u))
        color = ground.color
        if color is not None:
            color = color[np.where(self._source >= 0, self._source, 0)]
        return Filled(ground, self._vertices, self._source, self._rotation, self._error, self._confidence, color, notes)
