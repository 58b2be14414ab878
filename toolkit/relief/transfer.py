"""Relief transfer: other scans of the same material laid beside a hole's ground, for pieces to come from.

After Breckon & Fisher, 3DIM 2005, section 7, where relief goes from one capture to another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.mesh import SmoothBase, Surface, Topology, pieces, vertex_normals
from intaglio.relief.ground import Ground, ThinPlate, check_faces, local_frames, sampling_distance

# All other scans together give at most so many vertices.
_MOST = 40_000
# An exemplar with edges so many times as long as the scan's has no relief of its size.
_COARSEST = 2.0
# Wave length at which an exemplar's base is laid, in spacings; over a smooth base it is laid anew, at each hole's scale.
_SCALE = 12.0


@dataclass(frozen=True)
class Exemplars:
    """Other scans over their smooth bases, one after the other.

    Attributes
    ----------
    vertices, foot, normal, u, v : (N, 3) arrays
    faces : (F, 3) array
    color : (N, 3) array or None
    scan, number : (N,) int arrays
        Which of the scans each vertex is of, from 1, and its number there.
    notes : tuple of str
    """

    vertices: Array
    foot: Array
    normal: Array
    u: Array
    v: Array
    faces: Array
    color: Array | None
    scan: Array
    number: Array
    notes: tuple[str, ...]


def lay_exemplars(scans: list[Surface], ground: Ground) -> Exemplars:
    """Return other scans over smooth bases.

    Parameters
    ----------
    scans : list of Surface
        At least one; of large ones a part is taken.
    ground : Ground
        Of the scan that is to be completed: its spacing and colour tell what goes with it.

    Raises
    ------
    InputError
        For a scan that can't serve; the message says which and why.
    """
    parts: dict[str, list[Array]] = {
        name: [] for name in ("vertices", "foot", "normal", "u", "v", "faces", "color", "scan", "number")
    }
    notes: list[str] = []
    total = 0
    for which, scan in enumerate(scans, 1):
        name = f"exemplar {which}"
        if not scan.measured.all():
            raise InputError(
                f"{name} holds {int((~scan.measured).sum())} vertices that were filled, not measured: give the scan itself"
            )
        if ground.color is not None and scan.color is None:
            raise InputError(f"{name} has no colour, and the scan has: the filling's could not be told; give both or none")
        try:
            check_faces(scan)
        except InputError as problem:
            raise InputError(f"{name}: {problem}") from problem
        keep = _middle_part(scan, _MOST // len(scans))
        part = scan.part(keep)
        spacing = sampling_distance(part.vertices, part.faces, median=True)[0]
        if spacing > _COARSEST * ground.spacing:
            raise InputError(
                f"{name} is {spacing / ground.spacing:.1f} times as coarse as the scan (edges of {spacing:.4g} against "
                f"{ground.spacing:.4g}): it holds no relief of that size; give a finer one, or spacing={spacing:.3g}"
            )
        scale = _SCALE * ground.spacing
        smooth = ThinPlate(part.vertices, part.faces, scale).smooth(part.vertices)
        normal = vertex_normals(smooth, part.faces)
        foot = part.vertices - np.einsum("ij,ij->i", part.vertices - smooth, normal)[:, None] * normal
        base = SmoothBase(vertices=foot, faces=part.faces, normals=normal, relief_scale=scale)
        u, v = local_frames(normal, part.faces, base)
        color = np.zeros((len(foot), 0)) if part.color is None else part.color
        values = (part.vertices, foot, normal, u, v, part.faces + total, color, np.full(len(foot), which), np.flatnonzero(keep))
        for own, value in zip(parts.values(), values, strict=True):
            own.append(value)
        total += len(foot)
        some = "" if keep.all() else f" of {len(keep)}"
        notes.append(f"{name}: {len(foot)}{some} vertices, edges {spacing / ground.spacing:.2f} times the scan's")
    joined = {name: np.concatenate(own) for name, own in parts.items() if name != "color"}
    return Exemplars(**joined, color=None if ground.color is None else np.concatenate(parts["color"]), notes=tuple(notes))


def beside(ground: Ground, exemplars: Exemplars) -> Ground:
    """Return a ground that holds other scans as well, after its own vertices: measured, and far from all of its own.

    Parameters
    ----------
    ground : Ground
    exemplars : Exemplars
    """
    count = len(ground.foot)
    # Beside it along x, further off than any two of its vertices are.
    size = float(np.linalg.norm(np.ptp(ground.foot, axis=0)))
    move = np.zeros(3)
    move[0] = ground.foot[:, 0].max() + 2 * size - exemplars.foot[:, 0].min()
    move[1:] = (ground.foot.mean(axis=0) - exemplars.foot.mean(axis=0))[1:]
    normal, u, v = (np.concatenate([getattr(ground, name), getattr(exemplars, name)]) for name in ("normal", "u", "v"))
    vertices, foot = (np.concatenate([getattr(ground, name), getattr(exemplars, name) + move]) for name in ("vertices", "foot"))
    faces = np.concatenate([ground.faces, exemplars.faces + count]).astype(np.int32)
    base = ground.base
    if isinstance(base, SmoothBase):
        base = replace(base, vertices=foot, faces=faces, normals=normal)
    measured = np.concatenate([ground.measured, np.ones(len(exemplars.foot), bool)])
    topology = Topology.of(faces, len(measured))
    return replace(
        ground,
        vertices=vertices,
        foot=foot,
        normal=normal,
        u=u,
        v=v,
        base=base,
        faces=faces,
        measured=measured,
        color=None,
        topology=topology,
    )


def _middle_part(scan: Surface, most: int) -> Array:
    """Return which vertices (V,) of a scan serve: those of its largest piece that lie nearest to its middle."""
    own = np.flatnonzero(_largest_piece(scan.faces, len(scan.vertices)))
    points = scan.vertices[own]
    # The middle may lie in the air: what counts is the place of the scan that is nearest to it.
    start = points[np.linalg.norm(points - points.mean(axis=0), axis=1).argmin()]
    if len(own) > most:
        own = own[np.argpartition(np.linalg.norm(points - start, axis=1), most)[:most]]
    keep = np.zeros(len(scan.vertices), bool)
    keep[own] = True
    return _largest_piece(scan.faces[keep[scan.faces].all(axis=1)], len(keep))


def _largest_piece(faces: Array, count: int) -> Array:
    """Return which of ``count`` vertices are in the largest piece of a mesh."""
    number, label = pieces(faces, count)
    used = np.zeros(count, bool)
    used[faces] = True
    return used & (label == np.bincount(label[used], minlength=number).argmax()) if used.any() else used
