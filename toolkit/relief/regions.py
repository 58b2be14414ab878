"""Completion hole by hole: from its like on the scan, or by pieces of its surroundings, at its own scale and levels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array, Progress
from intaglio.errors import InputError
from intaglio.mesh import SmoothBase, Sphere, Surface
from intaglio.relief.assembly import Filled
from intaglio.relief.coherent import CoherentFilling, Guidance, Weights, fill_coherently
from intaglio.relief.exemplar import Sources
from intaglio.relief.ground import Ground
from intaglio.relief.growth import ReliefSettings, Resources, choose_parameters
from intaglio.relief.lines import Curve, Features, find_ends, find_features, guide_curves, joined, steered, without_guided
from intaglio.relief.symmetry import LikeFilling, Likes, given_poses
from intaglio.relief.transfer import Exemplars, beside, lay_exemplars

# In words: a filling whose pieces are fewer neighbours than this is said to be so.
_COHERENT = 0.85
# Over a plane, cylinder or sphere: what the sources' own heights count in joining, against differences along edges; and what it
# costs to stand on one's head where frames lie one way.
_PULL, _UPRIGHT = 0.1, 0.3


def fill_regions(
    scan: Surface,
    ground: Ground,
    sources: Sources,
    guides: str | list[Array],
    settings: ReliefSettings,
    resources: Resources,
    progress: Progress | None,
) -> Filled:
    """Fill all targets: a hole from its like where the scan has one, else by coherent pieces; those of other bases together.

    Over a smooth base each hole is filled by itself.

    Parameters
    ----------
    scan : Surface
    ground : Ground
    sources : Sources
        Where relief may be taken from.
    guides : {"auto", "none"} or list of (K, 3) arrays
        Lines across holes: those that are found, or none, or these and what is found beside them.
    settings : ReliefSettings
    resources : Resources
    progress : callable, optional
        Called with (steps done, steps to do).
    """
    smooth = isinstance(ground.base, SmoothBase)
    turning, weights, notes = _manner(ground, settings)
    out = _Whole(scan, ground)
    holes = _holes(ground)
    if not holes:
        # Rims so narrow that triangles alone close them.
        return out.filled(())
    exemplars = lay_exemplars(list(sources.others), ground) if sources.others else None
    likes = _likes(scan, ground.taken, sources, settings, resources)
    copied: list[LikeFilling] = []
    found: list[CoherentFilling] = []
    crossed = 0

    def fill(region: _Region, number: int) -> None:
        """Fill by pieces; ``number`` holes are done."""
        nonlocal crossed

        def report(done: int, total: int) -> None:
            if progress is not None:
                progress(number * total + done, len(holes) * total)

        ground, guidance = region.steered()
        filling = fill_coherently(
            ground,
            region.allowed,
            turning=turning,
            mirrored=settings.mirror,
            seed=resources.seed + len(found),
            device=resources.device,
            weights=weights,
            guidance=guidance,
            progress=report,
        )
        out.take(filling, region.keep, exemplars)
        found.append(filling)
        crossed += len(region.curves)

    together: list[Array] = []
    for number, targets in enumerate(holes):
        region = _region(ground, targets, sources, exemplars, guides)
        like = None
        # Where the user has drawn a line it is known how the hole goes on.
        if likes is not None and not region.guided:
            # What is far from the hole has no part in this, also where all of the scan may be a source.
            part, keep = (region.ground, region.keep) if sources.near else ground.around(targets)
            like = likes.fill(part, np.flatnonzero(ground.kept)[np.flatnonzero(keep & ground.measured)])
        if like is not None:
            out.take_copy(like, keep)
            copied.append(like)
            if progress is not None:
                progress(number + 1, len(holes))
        elif smooth:
            fill(region, number)
        else:
            together.append(targets)
    if together:
        # Their extents are of one size: what is left is filled together.
        fill(_region(ground, np.sort(np.concatenate(together)), sources, exemplars, guides), len(holes) - 1)
    if exemplars is not None:
        notes += exemplars.notes
    notes += _said_of_copies(copied, ground.spacing)
    if likes is not None and not isinstance(settings.symmetry, str) and len(copied) < len(holes):
        notes += (
            f"symmetry: {len(holes) - len(copied)} of {len(holes)} holes lead to no measured surface, and are filled by pieces",
        )
    if crossed:
        notes += (f"{crossed} {'line' if crossed == 1 else 'lines'} carried on across the holes",)
    elif not isinstance(guides, str):
        notes += ("guides: none of them runs across a hole that was filled",)
    if found:
        notes += _said_of_pieces(found, smooth, turning, settings, resources)
    return out.filled(notes)


def _manner(ground: Ground, settings: ReliefSettings) -> tuple[bool, Weights, tuple[str, ...]]:
    """Return whether pieces may be turned, what counts how much in a match, and notes of how that was chosen."""
    turning = settings.rotations is None or settings.rotations > 1
    if isinstance(ground.base, SmoothBase):
        # Its frames lie by chance: there a direction says nothing.
        return turning, Weights(), ()
    notes: tuple[str, ...] = ()
    if settings.rotations is None:
        parameters = choose_parameters(ground, 7, 1.0, None, 1.0)
        turning, notes = parameters.rotations > 1, parameters.notes
    # The base is known where nothing was measured, so heights count as such.
    weights = Weights(afloat=0.0, pull=_PULL, upright=0.0 if isinstance(ground.base, Sphere) else _UPRIGHT)
    return turning, weights, notes


@dataclass(frozen=True)
class _Region:
    """The ground of a hole: with other scans beside it where there are any.

    Attributes
    ----------
    ground : Ground
    keep : (N,) bool array
        Which vertices of the whole ground are in it; they come first.
    allowed : (M,) bool array or None
        The vertices whose relief may be taken; None for all measured ones.
    features : Features or None
        Of the ground, where lines matter.
    curves : list of Curve
        Lines that cross the hole.
    guided : bool
        Whether the user has drawn some of them.
    """

    ground: Ground
    keep: Array
    allowed: Array | None
    features: Features | None
    curves: list[Curve]
    guided: bool

    def steered(self) -> tuple[Ground, Guidance | None]:
        """Return the ground drawn onto the lines that cross the hole, and what guides the search."""
        if self.features is None or not self.curves:
            return self.ground, None
        return steered(self.ground, self.curves, self.features)


def _region(whole: Ground, targets: Array, sources: Sources, exemplars: Exemplars | None, guides: str | list[Array]) -> _Region:
    """Return the ground of a hole, what may be taken there, and which lines cross it."""
    ground, keep = whole, np.ones(len(whole.measured), bool)
    if len(targets) < int((~whole.measured).sum()):
        ground, keep = whole.around(targets, near=sources.near)
    allowed = None
    if sources.allowed is not None:
        scanned = sources.allowed[whole.kept]
        allowed = np.concatenate([scanned, np.zeros(len(keep) - len(scanned), bool)])[keep]
    if exemplars is not None:
        allowed = np.concatenate([ground.measured if allowed is None else allowed, np.ones(len(exemplars.foot), bool)])
        ground = beside(ground, exemplars)
    smooth = isinstance(ground.base, SmoothBase)
    if guides == "none" or (guides == "auto" and not smooth):
        return _Region(ground, keep, allowed, None, [], False)
    features = find_features(ground)
    given = [] if isinstance(guides, str) else guide_curves(guides, ground, features)
    found = joined(find_ends(ground, features), ground.spacing) if smooth else []
    return _Region(ground, keep, allowed, features, given + without_guided(found, given, ground.spacing), bool(given))


def _likes(scan: Surface, taken: Array, sources: Sources, settings: ReliefSettings, resources: Resources) -> Likes | None:
    """Return where likes of holes are looked for, if they are."""
    # Who says where relief may come from has chosen.
    anywhere = not sources.others and (sources.allowed is None or bool(sources.allowed.all()))
    if isinstance(settings.symmetry, str):
        wanted = settings.symmetry == "auto" and anywhere
        return Likes(scan, taken, None, resources.rank, resources.device) if wanted else None
    if not anywhere:
        raise InputError("symmetry and exemplar both say where relief comes from: leave one of them out")
    return Likes(scan, taken, given_poses(np.asarray(settings.symmetry)), resources.rank, resources.device)


def _said_of_copies(copied: list[LikeFilling], spacing: float) -> tuple[str, ...]:
    return tuple(
        f"{int((like.source >= 0).sum())} vertices filled from a place that is alike, {like.pose.describe()}: relief around it "
        f"correlates by {max(0.0, 1 - like.unlikeness**2 / 2):.2f}, and fits within {np.sqrt(like.error.max()) / spacing:.2g} "
        "spacings"
        for like in copied
    )


def _said_of_pieces(
    found: list[CoherentFilling], smooth: bool, turning: bool, settings: ReliefSettings, resources: Resources
) -> tuple[str, ...]:
    share = float(np.average([f.coherence for f in found], weights=[int((~f.ground.measured).sum()) for f in found]))
    notes: tuple[str, ...] = (
        f"filled by pieces at {max(f.levels for f in found)} levels, {'turned' if turning else 'not turned'}"
        f"{' or mirrored' if settings.mirror else ''}; {share:.0%} of edges join sources that are neighbours; "
        f"seed {resources.seed}, device {resources.device}",
    )
    if share < _COHERENT:
        notes += ("the pieces are small: the scan holds little that goes on as the surroundings do",)
    if smooth:
        scales = [f.scale for f in found]
        notes += (f"base laid at wave lengths of {min(scales):.6g} to {max(scales):.6g}, by the size of each hole",)
    return notes


def _holes(ground: Ground) -> list[Array]:
    """Return the targets of each hole."""
    targets = np.flatnonzero(~ground.measured)
    if len(targets) == 0:
        return []
    graph = csr_array(ground.topology.graph[targets][:, targets])
    number, label = connected_components(graph, directed=False)
    return [targets[label == k] for k in range(number)]


class _Whole:
    """Collects the fillings of all holes over one ground."""

    def __init__(self, scan: Surface, ground: Ground) -> None:
        count = len(ground.measured)
        self._scan, self._ground = scan, ground
        self._vertices = ground.vertices.copy()
        self._foot, self._normal, self._u = ground.foot.copy(), ground.normal.copy(), ground.u.copy()
        self._source = np.where(ground.measured, np.arange(count), -1).astype(np.int32)
        self._rotation, self._error = np.zeros(count, np.float32), np.zeros(count, np.float32)
        self._confidence = np.ones(count, np.float32)
        self._copied, self._mirrored = np.full(count, -1, np.int32), np.zeros(count, bool)
        self._exemplar, self._exemplar_source = np.zeros(count, np.int32), np.full(count, -1, np.int32)
        self._color = None if ground.color is None else ground.color.copy()

    def take_copy(self, like: LikeFilling, keep: Array) -> None:
        """Take a hole's filling from its like."""
        at, target = self._take(like.ground, like.height, like.rotation, like.error, like.confidence, keep)
        self._copied[at[target]] = like.source[target]
        self._mirrored[at[target]] = like.pose.mirrors
        if self._color is not None and self._scan.color is not None:
            self._color[at[target]] = self._scan.color[like.source[target]]

    def take(self, filling: CoherentFilling, keep: Array, exemplars: Exemplars | None) -> None:
        """Take a hole's filling; ``keep`` (N,) says which vertices its part of the ground holds, before those of other scans."""
        at, target = self._take(filling.ground, filling.height, filling.rotation, filling.error, filling.confidence, keep)
        count, filled = len(at), at[target]
        source = filling.source[:count][target]
        own = source < count
        self._source[filled[own]] = at[source[own]]
        self._mirrored[filled] = filling.mirrored[:count][target]
        if self._color is not None:
            self._color[filled[own]] = self._color[at[source[own]]]
        if exemplars is not None:
            there, other = filled[~own], source[~own] - count
            self._exemplar[there], self._exemplar_source[there] = exemplars.scan[other], exemplars.number[other]
            if self._color is not None and exemplars.color is not None:
                self._color[there] = exemplars.color[other]

    def _take(
        self, part: Ground, height: Array, rotation: Array, error: Array, confidence: Array, keep: Array
    ) -> tuple[Array, Array]:
        """Take what fillings of both kinds have; return the numbers of the part's vertices, and which of them are targets."""
        at = np.flatnonzero(keep)
        count = len(at)
        self._foot[at], self._normal[at], self._u[at] = part.foot[:count], part.normal[:count], part.u[:count]
        target = ~part.measured[:count]
        raised = part.foot[:count] + height[:count, None] * part.normal[:count]
        self._vertices[at[target]] = raised[target]
        for whole, own in ((self._rotation, rotation), (self._error, error), (self._confidence, confidence)):
            whole[at[target]] = own[:count][target]
        return at, target

    def filled(self, notes: tuple[str, ...]) -> Filled:
        """Return all of it."""
        ground = self._ground
        base = ground.base
        if isinstance(base, SmoothBase):
            base = replace(base, vertices=self._foot, normals=self._normal)
        ground = replace(ground, base=base, foot=self._foot, normal=self._normal, u=self._u, v=np.cross(self._normal, self._u))
        others = bool((self._exemplar > 0).any())
        return Filled(
            ground,
            self._vertices,
            self._source,
            self._rotation,
            self._error,
            self._confidence,
            self._color,
            notes,
            copied=self._copied,
            mirrored=self._mirrored if self._mirrored.any() else None,
            exemplar=self._exemplar if others else None,
            exemplar_source=self._exemplar_source if others else None,
        )
