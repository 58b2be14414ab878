"""Putting scan and filling together: the whole surface, with provenance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh import Surface, tangents
from intaglio.relief.ground import Ground
from intaglio.relief.texturing import texture_filling


@dataclass(frozen=True)
class Filled:
    """A ground whose targets carry relief.

    Attributes
    ----------
    ground : Ground
        With the base that the result stands on.
    vertices : (N, 3) array
        Measured and filled.
    source, rotation, error : (N,) arrays
        As in `intaglio.Surface`; sources are numbers of the ground's vertices.
    confidence : (N,) array or None
    color : (N, 3) array or None
    notes : tuple of str
    copied : (N,) array or None
        Sources anywhere on the scan, by its own numbers; -1 where ``source`` tells.
    mirrored : (N,) bool array or None
    exemplar, exemplar_source : (N,) arrays or None
        As in `intaglio.Surface`.
    """

    ground: Ground
    vertices: Array
    source: Array
    rotation: Array
    error: Array
    confidence: Array | None
    color: Array | None
    notes: tuple[str, ...]
    copied: Array | None = None
    mirrored: Array | None = None
    exemplar: Array | None = None
    exemplar_source: Array | None = None


def assemble(scan: Surface, ground: Ground, filled: Filled, notes: tuple[str, ...], device: str) -> Surface:
    """Return the surface that the scan and its filling make together.

    The scan's vertices come first, in their order, then the filled ones; so do the faces. Where the ground holds a part of the
    scan alone, the rest has no base: theirs is the vertex itself.

    Parameters
    ----------
    scan : Surface
    ground : Ground
        As it was laid.
    filled : Filled
        Its ground may have another base.
    notes : tuple of str
    device : str
    """
    taken, own = ground.taken, filled.ground
    kept, scanned = int(taken.sum()), int(ground.measured.sum())
    targets = len(ground.measured) - scanned
    # Where all of the scan is in it, which is most often so, nothing of it is copied more than once.
    all_taken = bool(taken.all())
    number = np.cumsum(taken, dtype=np.int32) - 1
    # Where each of the ground's vertices comes to lie.
    at = np.concatenate([number[ground.kept], np.arange(kept, kept + targets, dtype=np.int32)])
    count = kept + targets

    def spread(rest: Array, values: Array) -> Array:
        out = np.zeros((count, *rest.shape[1:]), rest.dtype)
        out[:kept] = rest if len(rest) == kept else rest[taken]
        out[at] = values
        return out

    vertices = spread(scan.vertices, filled.vertices)
    # Pieces are taken whole: a face has all of its corners in one.
    scan_faces = np.ones(len(scan.faces), bool) if all_taken else taken[scan.faces[:, 0]]
    own_faces = scan.faces if all_taken else number[scan.faces[scan_faces]]
    faces = np.concatenate([own_faces, at[ground.faces[len(ground.faces) - ground.filling :]]])
    source = np.arange(count, dtype=np.int32)
    source[at] = np.where(filled.source >= 0, at[filled.source], -1)
    if filled.copied is not None:
        source[at] = np.where(filled.copied >= 0, number[filled.copied], source[at])
    zeros = np.zeros(kept, np.float32)
    file_vertex = None
    if scan.file_vertex is not None or not all_taken:
        numbers = np.arange(len(taken)) if scan.file_vertex is None else scan.file_vertex
        file_vertex = np.concatenate([numbers[taken], np.full(targets, -1)])
    whole = Surface(
        vertices=vertices,
        faces=faces,
        base=spread(scan.vertices, own.foot),
        normal=spread(scan.normal, own.normal),
        color=None if scan.color is None or filled.color is None else spread(scan.color, filled.color),
        measured=np.arange(count) < kept,
        source=source,
        rotation=spread(zeros, filled.rotation),
        mirrored=None if filled.mirrored is None else spread(np.zeros(kept, bool), filled.mirrored),
        exemplar=None if filled.exemplar is None else spread(np.zeros(kept, np.int32), filled.exemplar),
        exemplar_source=None if filled.exemplar_source is None else spread(np.full(kept, -1, np.int32), filled.exemplar_source),
        error=spread(zeros, filled.error),
        confidence=None if filled.confidence is None else spread(np.ones(kept, np.float32), filled.confidence),
        measured_face=np.arange(len(faces)) < int(scan_faces.sum()),
        model=own.base,
        notes=scan.notes + ground.notes + notes,
        file_vertex=file_vertex,
    )
    if scan.uv is None:
        return whole
    if filled.exemplar is not None:
        return replace(whole, notes=(*whole.notes, "the filling has no texture: its relief comes from other scans"))
    # Beyond the ground the normal gives the frame.
    u, v = tangents(whole.normal)
    u[at], v[at] = own.u, own.v
    return texture_filling(scan, whole, taken, u, v, device=device)
