"""Stage one: from a scan to base, targets, one triangulation and local frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.errors import FitError, InputError
from intaglio.relief.base import Base, Cylinder, Plane, Sphere, face_the_scan
from intaglio.relief.extent import Extent, region_to_complete, sampling_distance
from intaglio.relief.fit import KINDS, fit_base
from intaglio.relief.frames import local_frames
from intaglio.relief.triangulation import fill_base
from intaglio.surface import Surface
from intaglio.topology import Topology, border_edges, directed_edges, edge_keys, pieces, used_vertices

Array = np.ndarray

# A piece of the scan lies on the base where its median distance is within this many robust deviations of the whole.
_ON_BASE = 4.0


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

    @property
    def height(self) -> Array:
        """Signed displacement (N,) along the base normal; 0 at targets."""
        return np.einsum("ij,ij->i", self.vertices - self.foot, self.normal)


def prepare_ground(
    surface: Surface,
    base: Base | str = "auto",
    *,
    spacing: float | None = None,
    extent: Extent = None,
    frames: str | None = None,
    reference: Array | None = None,
) -> Ground:
    """Fit the base, lay out targets, triangulate scan and targets together, and set local frames.

    Parameters
    ----------
    surface : Surface
        The scan; all its vertices count as measured.
    base : Base or {"auto", "plane", "cylinder", "sphere"}
        The base, or the kind to fit; "auto" takes the kind that fits best.
    spacing : float, optional
        Distance between targets, a length in the input's unit; default from the scan's edge lengths.
    extent : see `region_to_complete`
    frames, reference : see `local_frames`

    Raises
    ------
    InputError
        For a surface that can't be completed; the message names what is wrong and where.
    FitError
        If no base fits, or "auto" finds two kinds that fit equally well.
    """
    vertices, faces = surface.vertices, surface.faces
    check_scan(vertices, faces)
    notes: list[str] = []
    chosen = _base_of(vertices[used_vertices(faces, len(vertices))], base, notes)
    keep, faces, note = _pieces_on_base(chosen, vertices, faces)
    if note:
        notes.append(note)
    vertices = vertices[keep]
    color = None if surface.color is None else surface.color[keep]
    chosen = face_the_scan(chosen, vertices, faces)
    foot, normal = chosen.foot(vertices)
    own_spacing = spacing is None
    spacing, note = _spacing(spacing, foot, faces)
    notes.append(note)
    region = region_to_complete(chosen, foot, faces, spacing, extent, own_spacing)
    notes.append(region.note)
    filling = fill_base(
        chosen,
        vertices,
        faces,
        region.candidates,
        spacing,
        inside=region.inside,
        only_holes=region.only_holes,
        regular=region.regular,
    )
    target_foot, target_normal = chosen.foot(filling.points)
    count = len(vertices) + len(filling.points)
    all_faces = np.concatenate([faces, filling.faces]).astype(np.int32)
    all_normal = np.concatenate([normal, target_normal])
    all_foot = np.concatenate([foot, target_foot])
    _check_joined(all_faces, count, len(vertices))
    measured = np.arange(count) < len(vertices)
    center = vertices.mean(axis=0)
    seed_vertex = int(np.argmin(((vertices - center) ** 2).sum(axis=1)))
    u, v = local_frames(all_normal, all_faces, chosen, frames, reference, seed_vertex)
    regions = "region" if filling.holes == 1 else "regions"
    notes.append(f"{len(filling.points)} targets in {filling.holes} {regions}")
    if color is not None:
        color = np.concatenate([color, np.zeros((len(filling.points), 3), color.dtype)])
    return Ground(
        chosen,
        np.concatenate([vertices, target_foot]),
        all_foot,
        all_normal,
        all_faces,
        measured,
        color,
        u,
        v,
        float(spacing),
        region.regular,
        Topology.of(all_faces, count),
        tuple(notes),
    )


def _spacing(spacing: float | None, foot: Array, faces: Array) -> tuple[float, str]:
    """Return the distance between targets, found or as given, and the note that says so."""
    if spacing is None:
        return sampling_distance(foot, faces)
    spacing = number(spacing, "spacing")
    if spacing <= 0:
        raise InputError(f"spacing must be a positive length in the input's unit, not {spacing!r}")
    size = float(np.linalg.norm(np.ptp(foot, axis=0)))
    if not 1e-6 * size <= spacing <= size:
        wanted = "smaller" if spacing > size else "larger"
        raise InputError(f"spacing {spacing:.3g} does not go with a scan {size:.3g} across; give a {wanted} spacing")
    return spacing, f"spacing {spacing:.6g}: as given"


def check_scan(vertices: Array, faces: Array) -> None:
    """Raise `InputError` for a mesh that relief can't be completed on, naming what is wrong and what would be right."""
    if len(vertices) == 0 or len(faces) == 0:
        raise InputError(f"the surface is empty: {len(vertices)} vertices, {len(faces)} faces")
    corners = vertices[faces]
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    if repeated.any():
        raise InputError(
            f"{repeated.sum()} faces name one vertex twice, the first is face {np.flatnonzero(repeated)[0]}; "
            "repair it (read_surface(path, repair=True), --repair) to drop them"
        )
    keys = edge_keys(directed_edges(faces), len(vertices))
    unique, counts = np.unique(keys, return_counts=True)
    if (counts > 1).any():
        a, b = divmod(int(unique[counts > 1][0]), len(vertices))
        raise InputError(
            f"{(counts > 1).sum()} edges are run through twice in the same direction, the first from vertex {a} to {b}: "
            "neighbouring faces wind in opposite directions, or more than two share an edge; "
            "repair it (read_surface(path, repair=True), --repair) to turn and thin them"
        )
    used = np.flatnonzero(used_vertices(faces, len(vertices)))
    order = np.lexsort(vertices[used].T)
    same = (np.diff(vertices[used][order], axis=0) == 0).all(axis=1)
    if same.any():
        first = int(np.flatnonzero(same)[0])
        raise InputError(
            f"{same.sum()} vertices lie exactly on another one, the first are {used[order[first]]} and "
            f"{used[order[first + 1]]}: faces that should join do not; repair it to merge them "
            "(read_surface(path, repair=True), --repair)"
        )
    if not (np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) > 0).any():
        raise InputError("all faces have area zero: the surface is a line or a point")
    if len(border_edges(faces)) == 0:
        raise InputError("the surface has no border and no holes: nothing is missing, nothing to complete")


def _base_of(points: Array, base: Base | str, notes: list[str]) -> Base:
    if isinstance(base, Plane | Cylinder | Sphere):
        notes.append(f"base as given: {base.describe()}")
        return base
    if not isinstance(base, str) or base not in ("auto", *KINDS):
        raise InputError(f"unknown base {base!r}; known: 'auto', {', '.join(map(repr, KINDS))}, or a Plane, Cylinder or Sphere")
    fitted = fit_base(points, KINDS if base == "auto" else (base,))
    assert fitted.fit is not None
    if fitted.fit.ambiguous:
        table = ", ".join(f"{k} rms {v[0]:.6g}" for k, v in sorted(fitted.fit.candidates.items()))
        raise FitError(f"the scan does not decide its base ({table}): say which it is, base='plane', 'cylinder' or 'sphere'")
    if fitted.fit.poor and base == "auto":
        raise FitError(
            f"no plane, cylinder or sphere carries this scan ({fitted.fit.note}): cut out the part that one does carry, or "
            f"say which to use all the same, base='{fitted.kind}'"
        )
    notes += [f"base fitted: {fitted.describe()}", fitted.fit.note]
    return fitted


def _pieces_on_base(base: Base, vertices: Array, faces: Array) -> tuple[Array, Array, str]:
    """Keep the connected pieces that lie on the base; vertices that no face uses go as well."""
    number, label = pieces(faces, len(vertices))
    used = used_vertices(faces, len(vertices))
    sizes = np.bincount(label[used], minlength=number)
    distance = np.abs(base.distance(vertices))
    largest = int(np.argmax(sizes))
    main = used & (label == largest)
    size = float(np.linalg.norm(np.ptp(vertices[main], axis=0)))
    tolerance = _ON_BASE * max(1.4826 * float(np.median(distance[main])), 1e-9 * size)
    # A piece of a few triangles has no relief to give and would only pepper the base with islands.
    enough = [int(p) for p in np.flatnonzero(sizes >= 50) if np.median(distance[used & (label == p)]) <= tolerance]
    taken = np.isin(label, np.array([largest, *enough])) & used
    real = int((sizes > 0).sum())
    note = ""
    if real > 1 or not used.all():
        left = int((used & ~taken).sum())
        note = (
            f"the scan is in {real} pieces: {len({largest, *enough})} on the base taken ({taken.sum()} vertices), the "
            f"others left out ({left} vertices), {int((~used).sum())} vertices in no face"
        )
    renumber = np.cumsum(taken) - 1
    return taken, renumber[faces[taken[faces].all(axis=1)]].astype(np.int32), note


def _check_joined(faces: Array, count: int, scanned: int) -> None:
    """Raise `InputError` where a piece of the triangulation holds no scanned vertex: no relief could grow there."""
    number_of_pieces, label = pieces(faces, count)
    reached = np.zeros(number_of_pieces, bool)
    reached[label[:scanned]] = True
    if not reached.all():
        raise InputError(
            "part of what is to be completed is not joined to the scan, so no relief can grow there: choose an extent that "
            "touches the scan, or cut spikes off the scan's border"
        )


def number(value: float, name: str) -> float:
    """Return ``value`` as a finite float, or raise `InputError` for what is none."""
    try:
        result = float(value)
    except (TypeError, ValueError):
        result = float("nan")
    if not np.isfinite(result):
        raise InputError(f"{name} must be a finite number, not {value!r}")
    return result
