"""Repairing meshes whose faces do not join as they should."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh.surface import Surface
from intaglio.mesh.topology import directed_edges, edge_keys


def repair_surface(surface: Surface) -> Surface:
    """Return ``surface`` with joined vertices, no degenerate or surplus faces, and one winding; see `read_surface`."""
    notes = []
    vertices, faces = surface.vertices, surface.faces
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    inverse = inverse.reshape(-1)
    # Of equal vertices the first is kept, so that indices change as little as possible.
    keep = np.zeros(len(vertices), bool)
    keep[first] = True
    merged = int((~keep).sum())
    faces = first[inverse][faces].astype(np.int64)
    flat = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    faces = faces[~flat]
    _, unique = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    repeated = len(faces) - len(unique)
    faces = faces[np.sort(unique)]
    faces, surplus = _thin_edges(faces, len(vertices))
    faces, turned = _one_winding(faces, len(vertices))
    faces, one_sided = _cut_one_sided(faces, len(vertices))
    for number, text in (
        (merged, "vertices merged with an equal one"),
        (int(flat.sum()), "degenerate faces dropped"),
        (repeated, "repeated faces dropped"),
        (surplus, "faces dropped at edges of more than two faces"),
        (turned, "faces turned to their neighbours' winding"),
        (one_sided, "faces dropped where the surface is one-sided"),
    ):
        if number:
            notes.append(f"repair: {number} {text}")
    renumber = (np.cumsum(keep) - 1).astype(np.int32)
    fields = {
        name: value[keep]
        for name in ("vertices", "base", "normal", "color", "measured", "rotation", "error")
        if (value := getattr(surface, name)) is not None
    }
    source = surface.source[keep]
    return replace(
        surface,
        **fields,
        faces=renumber[faces],
        source=np.where(source >= 0, renumber[first[inverse][source]], -1),
        notes=surface.notes + tuple(notes or ["repair: nothing to do"]),
    )


def _thin_edges(faces: Array, count: int) -> tuple[Array, int]:
    """Drop later faces at undirected edges that more than two share."""
    dropped = 0
    while True:
        edges = np.sort(directed_edges(faces), axis=1)
        keys = edge_keys(edges, count)
        order = np.argsort(keys, kind="stable")
        ordered = keys[order]
        rank = np.arange(len(keys)) - np.searchsorted(ordered, ordered)
        surplus = np.unique(order[rank >= 2] // 3)
        if len(surplus) == 0:
            return faces, dropped
        # Later faces of all crowded edges are dropped at once, then edges are counted again: one at a time would be slow.
        faces = np.delete(faces, surplus, axis=0)
        dropped += len(surplus)


def _one_winding(faces: Array, count: int) -> tuple[Array, int]:
    """Turn faces so that neighbours traverse their shared edge in opposite directions; the majority of a piece stays."""
    edges = directed_edges(faces)
    keys = edge_keys(np.sort(edges, axis=1), count)
    order = np.argsort(keys, kind="stable")
    pair = np.flatnonzero(keys[order][:-1] == keys[order][1:])
    a, b = order[pair], order[pair + 1]
    agree = edges[a, 0] == edges[b, 1]
    neighbors: list[list[tuple[int, bool]]] = [[] for _ in range(len(faces))]
    for i, j, same in zip(a // 3, b // 3, agree, strict=True):
        neighbors[i].append((int(j), bool(same)))
        neighbors[j].append((int(i), bool(same)))
    flip = np.zeros(len(faces), bool)
    seen = np.zeros(len(faces), bool)
    for start in range(len(faces)):
        if seen[start]:
            continue
        seen[start] = True
        stack, piece = [start], []
        while stack:
            face = stack.pop()
            piece.append(face)
            for other, same in neighbors[face]:
                if not seen[other]:
                    seen[other] = True
                    flip[other] = flip[face] if same else not flip[face]
                    stack.append(other)
        if flip[piece].sum() * 2 > len(piece):
            flip[piece] = ~flip[piece]
    out = faces.copy()
    out[flip] = out[flip][:, ::-1]
    return out, int(flip.sum())


def _cut_one_sided(faces: Array, count: int) -> tuple[Array, int]:
    """Drop later faces at edges that are still traversed twice in one direction, as on a Möbius band."""
    before = len(faces)
    while True:
        keys = edge_keys(directed_edges(faces), count)
        _, first = np.unique(keys, return_index=True)
        repeated = np.ones(len(keys), bool)
        repeated[first] = False
        if not repeated.any():
            return faces, before - len(faces)
        faces = np.delete(faces, np.unique(np.flatnonzero(repeated) // 3), axis=0)
