"""Making a texture agree on both sides of its seams, by a smooth correction over the surface."""

from __future__ import annotations

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array, csr_array, diags_array

from intaglio.arrays import Array
from intaglio.mesh import Surface, directed_edges, following, opposite_edges, unique_edges
from intaglio.sparse import solve_symmetric

# Weights, relative to smoothness along an edge, of agreement across a seam and of leaving vertices as they are.
_AGREE, _STAY = 100.0, 0.01


def level_seams(
    image: Array,
    change: Array,
    inside: Array,
    surface: Surface,
    uv: Array,
    corners: Array,
    face: Array,
    weight: Array,
    shown: Array | None,
) -> Array:
    """Return a texture (H, W, 3) whose colours on the two sides of each seam agree.

    A correction at every texture vertex makes up the difference where seams meet, and is smooth and small everywhere else
    (as in Lempitsky & Ivanov, Seamless mosaicing of image-based texture maps, 2007, section 4). The difference is that of what
    blending changed, and of the photographs themselves at one place, so that a texture's own detail, which texels on the two
    sides sample at different places, does not count.

    Parameters
    ----------
    image, change : (H, W, 3) arrays
        The texture, and what blending added to the photographs' colours.
    inside : (H, W) bool array
    surface : Surface
    uv, corners : (M, 2), (F, 3) arrays
        Texture positions, and the faces' corners among them.
    face, weight : arrays
        From `rasterize`.
    shown : (F, 3, 3) array, optional
        Colour of the photograph chosen for each face at its corners; None where both sides of a seam show the same.
    """
    left, right, at_left, at_right = seam_vertices(surface, corners)
    if len(left) == 0:
        return image
    count = len(uv)
    color = _at_vertices(change, inside, uv)
    step = color[right] - color[left]
    if shown is not None:
        flat = shown.reshape(-1, 3)
        step += flat[at_right] - flat[at_left]
    edges = unique_edges(corners)
    rows, columns = np.concatenate([edges[:, 0], left]), np.concatenate([edges[:, 1], right])
    strength = np.concatenate([np.ones(len(edges)), np.full(len(left), _AGREE)])
    graph = coo_array((np.tile(strength, 2), (np.r_[rows, columns], np.r_[columns, rows])), shape=(count, count)).tocsr()
    system = diags_array(np.asarray(graph.sum(axis=1)).reshape(-1) + _STAY) - graph
    wanted = np.zeros((count, 3))
    np.add.at(wanted, left, _AGREE * step)
    np.add.at(wanted, right, -_AGREE * step)
    correction = solve_symmetric(csr_array(system), wanted, np.zeros_like(wanted)).astype(np.float32)
    at = np.flatnonzero(face >= 0)
    corner = corners[face.reshape(-1)[at]]
    w = weight.reshape(-1, 2)[at]
    levelled = image.copy()
    levelled.reshape(-1, 3)[at] += (
        w[:, :1] * correction[corner[:, 0]]
        + w[:, 1:] * correction[corner[:, 1]]
        + (1 - w.sum(axis=1))[:, None] * correction[corner[:, 2]]
    )
    return np.maximum(levelled, 0)


def seam_vertices(surface: Surface, corners: Array) -> tuple[Array, Array, Array, Array]:
    """Return pairs (S,) of texture vertices that are one on the mesh, at both ends of every edge that a seam parts.

    Also the corners (face times 3 plus place) at which each of a pair was met.
    """
    edges, texture = directed_edges(surface.faces), directed_edges(corners)
    opposite = opposite_edges(surface.faces, len(surface.vertices))
    paired = np.flatnonzero((opposite >= 0) & (edges[:, 0] < edges[:, 1]))
    there = opposite[paired]
    left = np.concatenate([texture[paired, 0], texture[paired, 1]])
    right = np.concatenate([texture[there, 1], texture[there, 0]])
    at_left, at_right = np.concatenate([paired, following(paired)]), np.concatenate([following(there), there])
    parted = np.flatnonzero(left != right)
    _, first = np.unique(np.stack([left, right], axis=1)[parted], axis=0, return_index=True)
    which = parted[first]
    return left[which], right[which], at_left[which], at_right[which]


def _at_vertices(image: Array, inside: Array, uv: Array) -> Array:
    """Return the texture's colour at its vertices, (M, 3): means over the 5 x 5 texels about each that are on the surface."""
    height, width = inside.shape
    row = np.clip(((1 - uv[:, 1]) * height).astype(int), 0, height - 1)
    column = np.clip((uv[:, 0] * width).astype(int), 0, width - 1)
    share = ndimage.uniform_filter(inside.astype(np.float32), 5, mode="constant")
    color = np.empty((len(uv), 3))
    for c in range(3):
        summed = ndimage.uniform_filter(np.where(inside, image[:, :, c], 0), 5, mode="constant")
        color[:, c] = summed[row, column] / np.maximum(share[row, column], 1e-6)
    return color
