"""Which photograph is best for each face, in regions rather than a mosaic."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array

from intaglio.arrays import Array
from intaglio.mesh import adjacency
from intaglio.photographs.binding import Binding

# Rounds in which scores are averaged with those of neighbours, so that regions are large and their borders short.
_ROUNDS = 15


def shrink_regions(common: Array, faces: Array, count: int) -> Array:
    """Return faces (P, F) that are in a photograph's region with all faces around them: without its outmost ring.

    References
    ----------
    Yamauchi et al., Textures revisited (2005), section 4.2.
    """
    inner = np.empty_like(common)
    for i, region in enumerate(common):
        rim = np.zeros(count, bool)
        rim[faces[~region]] = True
        inner[i] = region & ~rim[faces].any(axis=1)
    return inner


def choose_photographs(binding: Binding, faces: Array, allowed: Array) -> Array:
    """Return the photograph, (F,), that shows each face with most pixels for its size; -1 where none is ``allowed`` (P, F).

    Scores are averaged over neighbourhoods first.
    """
    count = binding.valid.shape[1]
    corner = binding.pixel[:, faces]
    p, q = corner[:, :, 1] - corner[:, :, 0], corner[:, :, 2] - corner[:, :, 0]
    pixels = np.where(allowed, np.abs(p[:, :, 0] * q[:, :, 1] - p[:, :, 1] * q[:, :, 0]), 0)
    # Relative to the best photograph, since faces differ in size.
    score = (pixels / np.maximum(pixels.max(axis=0), 1e-12)).T
    number = len(faces)
    ones = np.ones(3 * number)
    gather = csr_array(coo_array((ones, (faces.reshape(-1), np.repeat(np.arange(number), 3))), shape=(count, number)))
    degree = np.maximum(np.asarray(gather.sum(axis=1)).reshape(-1), 1)
    at_vertex = (gather @ score) / degree[:, None]
    graph = adjacency(faces, count).astype(np.float64) + diags_array(np.ones(count))
    around = np.asarray(graph.sum(axis=1)).reshape(-1)
    for _ in range(_ROUNDS):
        at_vertex = (graph @ at_vertex) / around[:, None]
    smooth = at_vertex[faces].mean(axis=1).T
    smooth[~allowed] = -1
    return np.where(allowed.any(axis=0), smooth.argmax(axis=0), -1)
