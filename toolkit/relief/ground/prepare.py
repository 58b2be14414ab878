"""Stage one: from a scan to base, targets, one triangulation and local frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import checked_positive
from intaglio.errors import InputError
from intaglio.mesh import Base, SmoothBase, Surface, Topology, face_the_scan, pieces
from intaglio.relief.ground.extent import Extent, region_to_complete, sampling_distance
from intaglio.relief.ground.filling import fill_smoothly
from intaglio.relief.ground.frames import local_frames
from intaglio.relief.ground.holes import Borders, Hole, Holes, choose_holes
from intaglio.relief.ground.scan import check_joined, check_scan, choose_base, pieces_on_base
from intaglio.relief.ground.triangulation import fill_base

# Default of the relief scale, in spacings.
_RELIEF_SCALE = 12
# The surroundings of a hole reach so many of its radii, and so many spacings, from its middle; where that is more vertices than
# _MOST_NEAR only as far as the nearest of them, but at least _NEAREST radii.
_NEAR, _MARGIN = 3.0, 12.0
_MOST_NEAR, _NEAREST = 40_000, 1.7


@dataclass(frozen=True)
class GroundOptions:
    """Where targets are laid, and how their frames lie; None leaves a choice to the scan.

    Attributes
    ----------
    spacing : float, optional
        Distance between targets, a length in the input's unit; default from the scan's edge lengths.
    extent : str or sequence of float, optional
        What to complete of a plane, cylinder or sphere; see `region_to_complete`.
    holes, hole_size : optional
        What to fill over a smooth base; see `choose_holes`. They ask for a smooth base.
    relief_scale : float, optional
        With a smooth base: the wave length, in the input's unit, below which the surface counts as relief; default 12 spacings.
    frames : str, optional
        "algebraic", "sweep" or "reference"; see `local_frames`.
    reference : (3,) array, optional
        The vector for "reference".
    near : bool
        With a smooth base: work on the surroundings of the holes alone, some three of their radii wide, not on the whole scan.
    """

    spacing: float | None = None
    extent: Extent = None
    holes: Holes = None
    hole_size: Sequence[float] | None = None
    relief_scale: float | None = None
    frames: str | None = None
    reference: Array | None = None
    near: bool = True

    def asks_for_holes(self) -> str:
        """Return the name of an option that goes with a smooth base alone, or nothing."""
        for name in ("holes", "hole_size", "relief_scale"):
            if getattr(self, name) is not None:
                return name
        return ""


@dataclass(frozen=True)
class Ground:
    """What the propagation of relief works on.

    Attributes
    ----------
    base : Base
        The smooth base, with its fit if it was fitted.
    vertices : (N, 3) float64 array
        Measured vertices as given, then targets on the base.
    foot, normal : (N, 3) float64 arrays
        Base point and base normal of every vertex.
    faces : (F, 3) int32 array
        The scan's triangles as given, then those of the completed part.
    measured : (N,) bool array
        The papers' label "textured" at the start.
    color : (N, 3) float32 array or None
        Measured colours; targets are zero.
    u, v : (N, 3) float64 arrays
        Local frames.
    spacing : float
        Distance between targets, in the input's unit.
    regular : bool
        Targets continue the scan's own lattice.
    topology : Topology
        Neighbour tables of the triangulation.
    notes : tuple of str
        What was chosen, for the user.
    kept : (V,) bool array
        Which of the scan's V vertices are in it; they come first, in their order.
    taken : (V,) bool array
        Which of them belong to what is completed: those in ``kept``, and those too far from a hole to matter.
    filling : int
        How many of the faces, the last ones, were laid.
    """

    base: Base
    vertices: Array
    foot: Array
    normal: Array
    faces: Array
    measured: Array
    color: Array | None
    u: Array
    v: Array
    spacing: float
    regular: bool
    topology: Topology
    notes: tuple[str, ...]
    kept: Array
    taken: Array
    filling: int

    @property
    def height(self) -> Array:
        """Signed displacement (N,) along the base normal; 0 at targets."""
        return np.einsum("ij,ij->i", self.vertices - self.foot, self.normal)

    def around(self, targets: Array, *, near: bool = True) -> tuple[Ground, Array]:
        """Return the part of the ground around some targets, and which vertices (N,) it holds.

        Other targets are left out.

        Parameters
        ----------
        targets : (T,) int array
            All targets of a hole, or of several.
        near : bool
            Leave out what was measured far from them, too.
        """
        own = np.zeros(len(self.measured), bool)
        own[targets] = True
        keep = self.measured | own
        if near:
            keep &= _surroundings(self.vertices, self.faces, [self.vertices[targets]], self.spacing) | own
        number = np.cumsum(keep) - 1
        faces = self.faces[_whole(self.faces, keep)]
        # What hangs on the rest by a vertex alone would be a piece of its own.
        label = pieces(number[faces], int(keep.sum()))[1]
        joined = np.isin(label, label[number[targets]])
        keep[np.flatnonzero(keep)[~joined]] = False
        number = np.cumsum(keep) - 1
        faces = number[self.faces[_whole(self.faces, keep)]].astype(np.int32)
        base = self.base
        if isinstance(base, SmoothBase):
            base = replace(base, vertices=self.foot[keep], faces=faces, normals=self.normal[keep])
        fields = {name: getattr(self, name)[keep] for name in ("vertices", "foot", "normal", "measured", "u", "v")}
        color = None if self.color is None else self.color[keep]
        topology = Topology.of(faces, int(keep.sum()))
        return replace(self, **fields, base=base, faces=faces, color=color, topology=topology), keep


def prepare_ground(
    surface: Surface, base: Base | str = "auto", options: GroundOptions | None = None, *, device: str = "cpu"
) -> Ground:
    """Fit the base, lay out targets, triangulate scan and targets together, and set local frames.

    Parameters
    ----------
    surface : Surface
        The scan; all its vertices count as measured.
    base : Base or {"auto", "plane", "cylinder", "sphere", "smooth"}
        The base, or the kind to fit; "auto" takes the plane, cylinder or sphere that fits, else the smoothed scan.
    options : GroundOptions
    device : str

    Raises
    ------
    InputError
        For a surface that can't be completed; the message names what is wrong and where.
    FitError
        If no base fits, or "auto" finds two kinds that fit equally well and the scan encloses no hole.
    """
    options = GroundOptions() if options is None else options
    vertices, faces = surface.vertices, surface.faces
    borders = check_scan(surface)
    if options.relief_scale is not None:
        options = replace(options, relief_scale=checked_positive("relief_scale", options.relief_scale))
    notes: list[str] = []
    asked = options.asks_for_holes()
    if asked and not (isinstance(base, str) and base in ("auto", "smooth")):
        raise InputError(f"{asked} goes with base='smooth' or 'auto', not with a {getattr(base, 'kind', base)}; leave it None")
    chosen = "smooth" if asked else choose_base(borders, base, notes)
    if isinstance(chosen, str):
        if options.extent not in (None, "holes"):
            raise InputError(
                f"extent={options.extent!r} goes with a plane, cylinder or sphere; a smooth base fills holes: see holes="
            )
        laid = _over_scan(borders, options, device, notes)
    else:
        try:
            laid = _over_base(chosen, vertices, faces, options.spacing, options.extent, notes)
        except InputError as problem:
            if base != "auto" or options.extent not in (None, "holes") or all(h.outer for h in borders.holes):
                raise
            notes = [f"base: the smoothed scan, since on a {chosen.kind} {problem}"]
            laid = _over_scan(borders, options, device, notes)
    scanned = int(laid.kept.sum())
    count = len(laid.foot)
    check_joined(laid.faces, count, scanned)
    measured = np.arange(count) < scanned
    points = np.concatenate([vertices[laid.kept], laid.foot[scanned:]])
    center = points[:scanned].mean(axis=0)
    seed_vertex = int(np.argmin(((points[:scanned] - center) ** 2).sum(axis=1)))
    u, v = local_frames(laid.normal, laid.faces, laid.base, options.frames, options.reference, seed_vertex)
    notes.append(f"{count - scanned} targets in {laid.holes} {'region' if laid.holes == 1 else 'regions'}")
    color = surface.color
    if color is not None:
        color = np.concatenate([color[laid.kept], np.zeros((count - scanned, 3), color.dtype)])
    return Ground(
        laid.base,
        points,
        laid.foot,
        laid.normal,
        laid.faces,
        measured,
        color,
        u,
        v,
        float(laid.spacing),
        laid.regular,
        Topology.of(laid.faces, count),
        tuple(notes),
        laid.kept,
        laid.taken,
        laid.filling,
    )


@dataclass(frozen=True)
class _Laid:
    """Scan and targets over their base: ``kept`` (of the scan's vertices), foot, normal and faces of both together.

    ``taken`` and ``filling`` are those of `Ground`.
    """

    base: Base
    kept: Array
    taken: Array
    filling: int
    foot: Array
    normal: Array
    faces: Array
    holes: int
    spacing: float
    regular: bool


def _over_base(base: Base, vertices: Array, faces: Array, spacing: float | None, extent: Extent, notes: list[str]) -> _Laid:
    """Lay targets over what the scan leaves open of a plane, cylinder or sphere."""
    kept, faces, note = pieces_on_base(np.abs(base.distance(vertices)), vertices, faces)
    if note:
        notes.append(note)
    vertices = vertices[kept]
    base = face_the_scan(base, vertices, faces)
    foot, normal = base.foot(vertices)
    own_spacing = spacing is None
    spacing, note = _spacing(spacing, foot, faces)
    notes.append(note)
    region = region_to_complete(base, foot, faces, spacing, extent, own_spacing)
    notes.append(region.note)
    filling = fill_base(
        base,
        vertices,
        faces,
        region.candidates,
        spacing,
        inside=region.inside,
        only_holes=region.only_holes,
        regular=region.regular,
    )
    target_foot, target_normal = base.foot(filling.points)
    return _Laid(
        base,
        kept,
        kept,
        len(filling.faces),
        np.concatenate([foot, target_foot]),
        np.concatenate([normal, target_normal]),
        np.concatenate([faces, filling.faces]).astype(np.int32),
        filling.holes,
        spacing,
        region.regular,
    )


def _over_scan(borders: Borders, options: GroundOptions, device: str, notes: list[str]) -> _Laid:
    """Fill holes of the scan smoothly, and smooth the scan itself."""
    vertices = borders.vertices
    taken, faces, note = pieces_on_base(None, vertices, borders.faces)
    if note:
        notes.append(note)
    kept = taken
    if not taken.all():
        vertices = vertices[taken]
        borders = Borders(vertices, faces)
    spacing, note = _spacing(options.spacing, vertices, faces, middle=True)
    notes.append(note)
    every = borders.holes
    chosen = choose_holes(every, options.holes, options.hole_size)
    open_left = len(every) - len(chosen)
    notes.append(
        f"{len(chosen)} holes to fill, rims {chosen[-1].length:.6g} to {chosen[0].length:.6g} long"
        + (f"; {open_left} borders left open ({sum(h.outer for h in every)} of all are where the scan ends)" if open_left else "")
    )
    relief_scale = options.relief_scale
    if relief_scale is None:
        relief_scale = _RELIEF_SCALE * spacing
        notes.append(f"relief scale {relief_scale:.6g}: {_RELIEF_SCALE} spacings; shorter waves are relief, longer ones shape")
    else:
        size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
        if not spacing <= relief_scale <= size:
            raise InputError(
                f"relief_scale {relief_scale:.3g} must lie between the spacing, {spacing:.3g}, and the scan's size, {size:.3g}"
            )
        notes.append(f"relief scale {relief_scale:.6g}: as given")
    if options.near:
        near = _surroundings(vertices, faces, [vertices[hole.loop] for hole in chosen], spacing)
        if near.sum() < len(near):
            notes.append(f"{near.sum()} of {len(near)} vertices lie near a hole: relief comes from these")
            kept = taken.copy()
            kept[taken] = near
            chosen, every = ([_renumbered(hole, near) for hole in holes if near[hole.loop].all()] for holes in (chosen, every))
            faces = (np.cumsum(near, dtype=np.int32) - 1)[faces[_whole(faces, near)]]
            vertices = vertices[near]
    filling = fill_smoothly(vertices, faces, chosen, every, spacing, relief_scale, device)
    notes += filling.notes
    return _Laid(
        filling.base,
        kept,
        taken,
        len(filling.faces),
        filling.foot,
        filling.normal,
        np.concatenate([faces, filling.faces]).astype(np.int32),
        filling.holes,
        spacing,
        False,
    )


def _spacing(spacing: float | None, foot: Array, faces: Array, middle: bool = False) -> tuple[float, str]:
    """Return the distance between targets, found or as given, and the note that says so."""
    if spacing is None:
        return sampling_distance(foot, faces, middle)
    spacing = checked_positive("spacing", spacing)
    size = float(np.linalg.norm(np.ptp(foot, axis=0)))
    if not 1e-6 * size <= spacing <= size:
        wanted = "smaller" if spacing > size else "larger"
        raise InputError(f"spacing {spacing:.3g} does not go with a scan {size:.3g} across; give a {wanted} spacing")
    return spacing, f"spacing {spacing:.6g}: as given"


def _surroundings(vertices: Array, faces: Array, rims: list[Array], spacing: float) -> Array:
    """Return which vertices (N,) lie around holes whose rims or targets are at ``rims``, (K, 3) each."""
    balls = []
    around = np.zeros(len(vertices), bool)
    for rim in rims:
        center = 0.5 * (rim.min(axis=0) + rim.max(axis=0))
        radius = float(np.linalg.norm(rim - center, axis=1).max())
        reach = _NEAR * radius + _MARGIN * spacing
        # Few lie in the slab along the first axis, and the distances of these alone are looked at.
        slab = np.flatnonzero(np.abs(vertices[:, 0] - center[0]) <= reach)
        away = np.linalg.norm(vertices[slab] - center, axis=1)
        if (away <= reach).sum() > _MOST_NEAR:
            reach = max(float(np.partition(away, _MOST_NEAR)[_MOST_NEAR]), _NEAREST * radius + _MARGIN * spacing)
        near = slab[away <= reach]
        balls.append(near)
        around[near] = True
    own = faces[_whole(faces, around)]
    used = np.zeros(len(vertices), bool)
    if len(balls) == 1:
        used[own] = True
        return used
    near = np.zeros(len(vertices), bool)
    for ball in balls:
        near[ball] = True
        # Vertices that no face of the part uses would belong to nothing.
        used[own[_whole(own, near)]] = True
        near[ball] = False
    return used


def _whole(faces: Array, kept: Array) -> Array:
    """Return which faces (F,) have all their corners among those that are kept (N,)."""
    return np.asarray(kept[faces[:, 0]] & kept[faces[:, 1]] & kept[faces[:, 2]])


def _renumbered(hole: Hole, near: Array) -> Hole:
    return replace(hole, loop=(np.cumsum(near) - 1)[hole.loop].astype(np.int32))
