"""Connectivity of triangle meshes: edges, borders, pieces and neighbours, from the indices of faces (F, 3) alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array


def directed_edges(faces: Array) -> Array:
    """Return the 3F directed edges (3F, 2) of the faces, corner by corner."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)


def grid_faces(rows: int, columns: int) -> Array:
    """Return the triangles (F, 3) of a grid of vertices numbered row by row: (r, c), (r + 1, c), (r + 1, c + 1) and so on."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).reshape(-1, 3)


def edge_keys(edges: Array, count: int) -> Array:
    """Return one int64 per directed edge (E, 2) of a mesh with ``count`` vertices."""
    return edges[:, 0].astype(np.int64) * count + edges[:, 1]


def opposite_edges(faces: Array, count: int) -> Array:
    """Return the number (3F,) of the opposite edge of every directed edge in the order of `directed_edges`, or -1."""
    edges = directed_edges(faces)
    keys, back = edge_keys(edges, count), edge_keys(edges[:, ::-1], count)
    sorter = np.argsort(keys, kind="stable")
    at = np.searchsorted(keys, back, sorter=sorter)
    if len(keys) == 0:
        return at
    hit = sorter[np.minimum(at, len(keys) - 1)]
    return np.where(keys[hit] == back, hit, -1)


def following(edges: Array) -> Array:
    """Return the number of the edge that follows each directed edge around its face; the same holds for corners."""
    return np.asarray(edges // 3 * 3 + (edges + 1) % 3)


def unique_edges(faces: Array) -> Array:
    """Return each undirected edge once, (E, 2), the smaller index first, in ascending order."""
    if len(faces) == 0:
        return np.zeros((0, 2), np.int32)
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    count = int(faces.max()) + 1
    # Sorting numbers is several times faster than sorting pairs, and than finding unique ones by hashing.
    keys = np.sort(np.minimum(start, end).astype(np.int64) * count + np.maximum(start, end))
    keys = keys[np.concatenate([[True], keys[1:] != keys[:-1]])]
    return np.stack(np.divmod(keys, count), axis=1).astype(faces.dtype)


def border_edges(faces: Array) -> Array:
    """Return directed edges (B, 2) that have a face on their left and none on their right."""
    edges = directed_edges(faces)
    count = int(faces.max()) + 1 if len(faces) else 0
    keys, opposite = edge_keys(edges, count), edge_keys(edges[:, ::-1], count)
    return edges[~np.isin(keys, opposite)]


def border_loops(faces: Array) -> list[Array]:
    """Return the closed border loops as arrays of vertex indices, those of most vertices first.

    Every border edge belongs to exactly one loop. Where the border touches itself in a vertex, the loop goes on along the
    last border edge from there that has not been used.
    """
    following: dict[int, list[int]] = {}
    for a, b in border_edges(faces):
        following.setdefault(int(a), []).append(int(b))
    loops = []
    while following:
        start = next(iter(following))
        loop, here = [], start
        while here in following:
            loop.append(here)
            ahead = following[here]
            nxt = ahead.pop()
            if not ahead:
                del following[here]
            here = nxt
        loops.append(np.array(loop, np.int32))
    return sorted(loops, key=len, reverse=True)


def pieces(faces: Array, count: int) -> tuple[int, Array]:
    """Return the number of connected pieces and the piece (count,) of every vertex; an unused vertex is a piece by itself."""
    e = directed_edges(faces)
    graph = coo_array((np.ones(len(e), bool), (e[:, 0], e[:, 1])), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    return int(number), label


@dataclass(frozen=True)
class Topology:
    """Neighbour tables of a triangle mesh, in the compressed form that kernels read.

    Attributes
    ----------
    offsets, neighbors : (N + 1,), (E,) int32 arrays
        Vertices joined to vertex i by an edge: ``neighbors[offsets[i]:offsets[i + 1]]``, ascending.
    face_offsets, incident : (N + 1,), (3F,) int32 arrays
        Faces at vertex i, likewise.
    across : (F, 3) int32 array
        The face on the other side of the edge from corner k to corner k + 1, or -1.
    """

    offsets: Array
    neighbors: Array
    face_offsets: Array
    incident: Array
    across: Array

    @property
    def graph(self) -> csr_array:
        """The symmetric vertex adjacency as a sparse matrix of ones."""
        count = len(self.offsets) - 1
        ones = np.ones(len(self.neighbors), np.float32)
        return csr_array((ones, self.neighbors, self.offsets), shape=(count, count))

    @classmethod
    def of(cls, faces: Array, count: int) -> Topology:
        """Build the tables for ``faces`` (F, 3) over ``count`` vertices."""
        graph = adjacency(faces, count)
        corner_vertex = faces.reshape(-1)
        order = np.argsort(corner_vertex, kind="stable")
        face_offsets = np.zeros(count + 1, np.int32)
        np.cumsum(np.bincount(corner_vertex, minlength=count), out=face_offsets[1:])
        opposite = opposite_edges(faces, count)
        across = np.where(opposite >= 0, opposite // 3, -1)
        return cls(
            graph.indptr.astype(np.int32),
            graph.indices.astype(np.int32),
            face_offsets,
            (order // 3).astype(np.int32),
            across.reshape(-1, 3).astype(np.int32),
        )


def largest_faces(faces: Array, points: Array) -> Array:
    """Return the number (N,) of the largest face at every vertex; 0 for a vertex without faces.

    Parameters
    ----------
    faces : (F, 3) int array
    points : (N, 3) array
    """
    corners = points[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    order = np.argsort(area, kind="stable")
    largest = np.zeros(len(points), np.int32)
    # Of several values for one vertex the last is kept, which is the largest face.
    largest[faces[order].reshape(-1)] = np.repeat(order, 3)
    return largest


def adjacency(faces: Array, count: int) -> csr_array:
    """Return the symmetric vertex adjacency as a sparse matrix of ones with sorted indices."""
    e = unique_edges(faces)
    both = np.concatenate([e, e[:, ::-1]])
    graph = csr_array((np.ones(len(both), np.float32), (both[:, 0], both[:, 1])), shape=(count, count))
    graph.sort_indices()
    return graph


def used_vertices(faces: Array, count: int) -> Array:
    """Return which of ``count`` vertices some face uses, (count,) bool."""
    used = np.zeros(count, bool)
    used[faces.reshape(-1)] = True
    return used
