"""Connectivity of triangle meshes: edges, borders, pieces and neighbours, from the indices of faces (F, 3) alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array
from intaglio.kernels import connectivity

# Tables of more faces than this are made by kernels, whose start costs more than NumPy takes for fewer. Both give the same.
LARGE = 200_000
# Numbers of more directed edges than this don't fit into 32 bits.
_MOST_EDGES = 2**31 - 1
# So many are gone through at once, where a table of them all would be many times as large as the mesh.
_AT_ONCE = 1 << 18


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
    """Return the number (3F,) of the opposite edge of every directed edge in the order of `directed_edges`, or -1.

    Where several are opposite, it is the first.
    """
    if LARGE < len(faces) <= _MOST_EDGES // 3:
        faces = np.ascontiguousarray(faces, np.int32)
        opposite = connectivity.opposites(faces, *corner_table(faces, count))
        left = np.flatnonzero(opposite == connectivity.NOT_SOUGHT)
        if len(left):
            found = _first_opposite(faces.reshape(-1)[left], faces.reshape(-1)[following(left)], count)
            opposite[left] = np.where(found >= 0, left[found], -1)
        return opposite
    return _first_opposite(faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1), count)


def _first_opposite(start: Array, end: Array, count: int) -> Array:
    """Return the number (E,) of the first edge that goes from the end of each edge to its start, or -1."""
    keys, back = start.astype(np.int64) * count + end, end.astype(np.int64) * count + start
    sorter = np.argsort(keys, kind="stable")
    at = np.searchsorted(keys, back, sorter=sorter)
    if len(keys) == 0:
        return at
    hit = sorter[np.minimum(at, len(keys) - 1)]
    return np.where(keys[hit] == back, hit, -1)


def corner_table(faces: Array, count: int) -> tuple[Array, Array]:
    """Return the corners at every vertex, ascending, int32: those of vertex i are ``corners[starts[i]:starts[i + 1]]``."""
    ends = np.arange(0, faces.size + 1, 3, dtype=np.int32)
    # A column of this table is a vertex, and what stands in it are its corners: turning it into columns is one pass.
    numbers = np.arange(faces.size, dtype=np.int32)
    table = csr_array((numbers, faces.reshape(-1).astype(np.int32, copy=False), ends), shape=(len(faces), count)).tocsc()
    return table.indptr.astype(np.int32, copy=False), table.data


def edges_pair_up(faces: Array, opposite: Array, count: int) -> bool:
    """Tell whether no directed edge belongs to two faces.

    Then every edge is the opposite of its opposite, and no two border edges are the same.

    Parameters
    ----------
    faces : (F, 3) int array
    opposite : (3F,) int array
        Their `opposite_edges`.
    count : int
        How many vertices there are.
    """
    for at in range(0, len(opposite), _AT_ONCE):
        there = opposite[at : at + _AT_ONCE]
        if not ((opposite[there] == np.arange(at, at + len(there))) | (there == -1)).all():
            return False
    keys = np.sort(edge_keys(border_edges(faces, opposite), count))
    return bool((keys[1:] != keys[:-1]).all())


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


def border_edges(faces: Array, opposite: Array | None = None) -> Array:
    """Return directed edges (B, 2) that have a face on their left and none on their right.

    ``opposite`` are the `opposite_edges`, if they are known.
    """
    if opposite is None:
        opposite = opposite_edges(faces, int(faces.max()) + 1 if len(faces) else 0)
    border = np.flatnonzero(opposite < 0)
    corners = faces.reshape(-1)
    return np.stack([corners[border], corners[following(border)]], axis=1)


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
    if len(faces) > LARGE and count <= _MOST_EDGES:
        a, b, c = (np.ascontiguousarray(faces[:, k], np.int32) for k in range(3))
        return numbered_sets(count, [(a, b), (b, c)])
    e = directed_edges(faces)
    graph = coo_array((np.ones(len(e), bool), (e[:, 0], e[:, 1])), shape=(count, count))
    number, label = connected_components(graph, directed=False)
    return int(number), label


def numbered_sets(count: int, pairs: list[tuple[Array, Array]]) -> tuple[int, Array]:
    """Return how many sets ``count`` things are in whose pairs (two int32 arrays) are joined, and the set (count,) of each.

    Sets are numbered by their first members, as SciPy numbers connected components. A pair whose second is negative is none.
    """
    root = connectivity.least_members(count, pairs)
    number = np.cumsum(root == np.arange(count, dtype=np.int32), dtype=np.int32)
    return int(number[-1]) if count else 0, (number - 1)[root]


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


def face_areas(points: Array, faces: Array) -> Array:
    """Return the areas (F,) float64 of triangles (F, 3) over points (N, 3)."""
    if len(faces) > LARGE:
        return connectivity.face_areas(points, faces)
    corners = points[faces]
    return np.asarray(0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1))


def edge_lengths(points: Array, faces: Array) -> Array:
    """Return the lengths (3F,) float64 of all `directed_edges` of triangles (F, 3) over points (N, 3)."""
    if len(faces) > LARGE:
        return connectivity.edge_lengths(points, faces)
    corners = points[faces]
    return np.asarray(np.linalg.norm((corners - np.roll(corners, -1, axis=1)).reshape(-1, 3), axis=1))


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
