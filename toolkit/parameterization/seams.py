"""Cutting a surface of genus 0 open along a short seam graph, so that one chart can hold it."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from intaglio.arrays import Array
from intaglio.mesh import directed_edges, edge_keys, following, opposite_edges, unique_edges


def cut_open(faces: Array, count: int, seam: Array) -> tuple[Array, Array]:
    """Return faces (F, 3) cut along the edges ``seam`` (S, 2), and the vertex that each new vertex was, (N',).

    Vertices keep their numbers; where a seam parts a vertex's fan of faces, the further parts are appended.
    """
    partner = opposite_edges(faces, count)
    whole = partner >= 0
    if len(seam):
        both = np.concatenate([edge_keys(seam, count), edge_keys(seam[:, ::-1], count)])
        whole &= ~np.isin(edge_keys(directed_edges(faces), count), both)
    joined = np.flatnonzero(whole)
    partner = partner[joined]
    # Edge e leaves from corner e; its partner runs back from the corner where it ends.
    pairs = (np.concatenate([joined, following(joined)]), np.concatenate([following(partner), partner]))
    graph = coo_array((np.ones(len(pairs[0]), bool), pairs), shape=(faces.size,) * 2)
    _, label = connected_components(graph, directed=False)
    vertex = faces.reshape(-1)
    fans, first = np.unique(label, return_index=True)
    owner = vertex[first]
    order = np.lexsort((first, owner))
    extra = np.concatenate([[False], owner[order][1:] == owner[order][:-1]])
    number = np.empty(len(fans), np.int64)
    number[order] = np.where(extra, count - 1 + np.cumsum(extra), owner[order])
    origin = np.concatenate([np.arange(count), owner[order][extra]])
    return number[label].reshape(-1, 3).astype(np.int32), origin.astype(np.int32)


def edge_graph(vertices: Array, faces: Array, cost: Array | None = None) -> csr_array:
    """Return the symmetric graph of edge lengths, times the mean ``cost`` (N,) of their ends."""
    edges = unique_edges(faces)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    if cost is not None:
        length = length * cost[edges].mean(axis=1)
    rows, columns = edges.T
    table = coo_array((np.tile(length, 2), (np.r_[rows, columns], np.r_[columns, rows])), shape=(len(vertices),) * 2)
    return csr_array(table)


def path_between(graph: csr_array, start: int, targets: Array) -> Array:
    """Return the edges (S, 2) of the shortest path from vertex ``start`` to the nearest of ``targets``."""
    distance, before = dijkstra(graph, indices=start, return_predecessors=True)
    here = int(targets[np.argmin(distance[targets])])
    path = []
    while here != start:
        path.append((int(before[here]), here))
        here = int(before[here])
    return np.array(path, np.int64).reshape(-1, 2)


def joining_seam(graph: csr_array, loops: list[Array]) -> Array:
    """Return edges (S, 2) that join border loops to one border, each by the shortest path to those joined already."""
    seam = [np.zeros((0, 2), np.int64)]
    joined = loops[0]
    rest = list(loops[1:])
    while rest:
        distance, before, _ = dijkstra(graph, indices=joined, return_predecessors=True, min_only=True)
        nearest = min(range(len(rest)), key=lambda k: float(distance[rest[k]].min()))
        loop = rest.pop(nearest)
        here = int(loop[np.argmin(distance[loop])])
        path = []
        while before[here] >= 0:
            path.append((int(before[here]), here))
            here = int(before[here])
        seam.append(np.array(path, np.int64).reshape(-1, 2))
        joined = np.concatenate([joined, loop, seam[-1].reshape(-1)])
    return np.concatenate(seam)


def longest_way(graph: csr_array) -> Array:
    """Return the edges (S, 2) of a path that opens a closed surface: between two of its vertices that are far apart."""
    ends = [0]
    for _ in range(3):
        distance = dijkstra(graph, indices=ends[-1])
        ends.append(int(np.argmax(distance)))
    path = path_between(graph, ends[-1], np.array(ends[-2:-1]))
    if len(path) == 1:
        # Cutting a single edge does not open the surface; a second edge beside it is cut as well.
        beside = graph.indices[graph.indptr[path[0, 1]] : graph.indptr[path[0, 1] + 1]]
        path = np.concatenate([path, [[path[0, 1], int(beside[beside != path[0, 0]][0])]]])
    return path
