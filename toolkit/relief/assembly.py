"""Putting scan and filling together: the whole surface, with provenance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh import Surface
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
    """

    ground: Ground
    vertices: Array
    source: Array
    rotation: Array
    error: Array
    confidence: Array | None
    color: Array | None
    notes: tuple[str, ...]


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
    number = np.cumsum(taken) - 1
    # Where each of the ground's vertices comes to lie.
    at = np.concatenate([number[ground.kept], kept + np.arange(targets)])
    count = kept + targets

    def spread(rest: Array, values: Array) -> Array:
        out = np.concatenate([rest, np.zeros((targets, *rest.shape[1:]), rest.dtype)])
        out[at] = values
        return out

    vertices = spread(scan.vertices[taken], filled.vertices)
    scan_faces = taken[scan.faces].all(axis=1)
    faces = np.concatenate([number[scan.faces[scan_faces]], at[ground.faces[len(ground.faces) - ground.filling :]]])
    source = np.arange(count)
    source[at] = np.where(filled.source >= 0, at[filled.source], -1)
    zeros = np.zeros(kept, np.float32)
    file_vertex = None
    if scan.file_vertex is not None or not taken.all():
        numbers = np.arange(len(taken)) if scan.file_vertex is None else scan.file_vertex
        file_vertex = np.concatenate([numbers[taken], np.full(targets, -1)])
    whole = Surface(
        vertices=vertices,
        faces=faces,
        base=spread(scan.vertices[taken], own.foot),
        normal=spread(scan.normal[taken], own.normal),
        color=None if scan.color is None or filled.color is None else spread(scan.color[taken], filled.color),
        measured=np.arange(count) < kept,
        source=source.astype(np.int32),
        rotation=spread(zeros, filled.rotation),
        error=spread(zeros, filled.error),
        confidence=None if filled.confidence is None else spread(np.ones(kept, np.float32), filled.confidence),
        measured_face=np.arange(len(faces)) < int(scan_faces.sum()),
        model=own.base,
        notes=scan.notes + ground.notes + notes,
        file_vertex=file_vertex,
    )
    u, v = (spread(np.zeros((kept, 3)), axis) for axis in (own.u, own.v))
    return texture_filling(scan, whole, taken, u, v, device=device)
