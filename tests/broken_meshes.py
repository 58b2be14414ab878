"""Meshes with every defect that files of other programs have, made from a sound one."""

from __future__ import annotations

import struct

import numpy as np


def subdivided(vertices, faces):
    """Cut every triangle into four."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    unique, number = np.unique(edges, axis=0, return_inverse=True)
    middle = len(vertices) + number.reshape(-1, 3)
    a, b, c = faces.T
    ab, bc, ca = middle.T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([vertices, vertices[unique].mean(axis=1)]), np.concatenate([np.stack(q, axis=1) for q in quarters])


def soup(vertices, faces, random):
    return vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


def wound_at_random(vertices, faces, random):
    turned = random.random(len(faces)) < 0.3
    return vertices, np.where(turned[:, None], faces[:, ::-1], faces)


def with_fins(vertices, faces, random):
    edges = faces[random.choice(len(faces), len(faces) // 500, replace=False)][:, :2]
    tips = vertices[edges].mean(axis=1) + 0.01 * np.ptp(vertices) * random.normal(size=(len(edges), 3))
    return np.concatenate([vertices, tips]), np.concatenate([faces, np.c_[edges, len(vertices) + np.arange(len(edges))]])


def with_repeats(vertices, faces, random):
    again = faces[random.integers(0, len(faces), len(faces) // 200)]
    return vertices, np.concatenate([faces, again[: len(again) // 2, [1, 2, 0]], again[len(again) // 2 :, ::-1]])


def with_degenerate_faces(vertices, faces, random):
    bad = faces[random.integers(0, len(faces), len(faces) // 200)].copy()
    bad[:, 2] = bad[:, 0]
    return vertices, np.concatenate([faces, bad])


def with_flat_faces(vertices, faces, random):
    """Some edges get a vertex in their middle for one of their faces, and a flat triangle that bridges the two halves."""
    chosen = random.choice(len(faces), len(faces) // 500, replace=False)
    a, b, c = faces[chosen].T
    middle = len(vertices) + np.arange(len(chosen))
    halves = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1), np.stack([a, b, middle], 1)])
    return np.concatenate([vertices, (vertices[a] + vertices[b]) / 2]), np.concatenate([np.delete(faces, chosen, axis=0), halves])


def with_missing_numbers(vertices, faces, random):
    out = vertices.copy()
    out[random.choice(len(out), len(out) // 5000 + 1, replace=False)] = np.nan
    return out, faces


def with_unused_vertices(vertices, faces, random):
    stray = vertices[random.choice(len(vertices), len(vertices) // 50)] + 0.1 * np.ptp(vertices)
    return np.concatenate([stray, vertices]), faces + len(stray)


def in_pieces(vertices, faces, random):
    """Seven pieces: the mesh cut by planes."""
    axis = int(np.argmax(np.ptp(vertices, axis=0)))
    slab = np.clip((7 * (vertices[:, axis] - vertices[:, axis].min()) / np.ptp(vertices[:, axis])).astype(int), 0, 6)
    return vertices, faces[(slab[faces] == slab[faces][:, :1]).all(axis=1)]


def touching_in_vertices(vertices, faces, random):
    """A copy of the mesh that is moved along and shares single vertices with it."""
    shift = (1.5 * np.ptp(vertices[:, 0]), 0, 0)
    other = faces + len(vertices)
    for mine, theirs in zip(*random.choice(len(vertices), (2, 5), replace=False), strict=True):
        other[other == len(vertices) + theirs] = mine
    return np.concatenate([vertices, vertices + shift]), np.concatenate([faces, other])


def touching_in_edges(vertices, faces, random):
    """A flipped copy that shares edges with the mesh."""
    other = faces[:, ::-1] + len(vertices)
    for face in random.choice(len(faces), 20, replace=False):
        for vertex in faces[face][:2]:
            other[other == len(vertices) + vertex] = vertex
    return np.concatenate([vertices, vertices * (1, 1, -1) + (0, 0, 3 * np.ptp(vertices[:, 2]))]), np.concatenate([faces, other])


def cut_apart(vertices, faces, random):
    """As a program leaves it that doubles vertices along texture seams."""
    side = vertices[faces].mean(axis=1)[:, 0] > vertices[:, 0].mean()
    return np.concatenate([vertices, vertices]), np.where(side[:, None], faces + len(vertices), faces)


def with_walls(vertices, faces, random):
    """Sheets that run into the surface along chains of its edges."""
    chosen = random.choice(len(faces), len(faces) // 300, replace=False)
    a, b, _ = faces[chosen].T
    up = 0.02 * np.ptp(vertices)
    low = len(vertices) + np.arange(len(chosen))
    high = low + len(chosen)
    more = np.concatenate([vertices[a] + (0, 0, up), vertices[b] + (0, 0, up)])
    return np.concatenate([vertices, more]), np.concatenate([faces, np.stack([a, b, high], 1), np.stack([a, high, low], 1)])


def with_one_sided_band(vertices, faces, random):
    n = 60
    t = np.arange(n) * 2 * np.pi / n
    size, middle = np.ptp(vertices) / 2, vertices.mean(axis=0)
    rim = [
        np.stack([(3 + s * np.cos(t / 2)) * np.cos(t), (3 + s * np.cos(t / 2)) * np.sin(t), s * np.sin(t / 2)], 1)
        for s in (-1, 1)
    ]
    a, b = np.arange(n), n + np.arange(n)
    c, d = np.append(a[1:], b[0]), np.append(b[1:], a[0])
    band = np.concatenate([np.stack([a, c, d], 1), np.stack([a, d, b], 1)])
    return np.concatenate([vertices, middle + size * np.concatenate(rim)]), np.concatenate([faces, band + len(vertices)])


DEFECTS = {
    f.__name__: f
    for f in (
        soup,
        wound_at_random,
        with_fins,
        with_repeats,
        with_degenerate_faces,
        with_flat_faces,
        with_missing_numbers,
        with_unused_vertices,
        in_pieces,
        touching_in_vertices,
        touching_in_edges,
        cut_apart,
        with_walls,
        with_one_sided_band,
    )
}


def all_at_once(vertices, faces, random):
    for name in (
        "with_flat_faces",
        "with_fins",
        "with_walls",
        "with_one_sided_band",
        "touching_in_vertices",
        "with_repeats",
        "with_degenerate_faces",
        "with_unused_vertices",
        "with_missing_numbers",
        "wound_at_random",
        "cut_apart",
    ):
        vertices, faces = DEFECTS[name](vertices, faces, random)
    return vertices, faces


def write_strips(path, vertices, faces):
    """Write a PLY whose faces are strips of two triangles and single ones."""
    edges = {}
    for f, (a, b, c) in enumerate(faces.tolist()):
        for edge, apex in (((a, b), c), ((b, c), a), ((c, a), b)):
            edges[edge] = (f, apex)
    taken, strips = np.zeros(len(faces), bool), []
    for f, (a, b, c) in enumerate(faces.tolist()):
        if taken[f]:
            continue
        taken[f] = True
        beyond = edges.get((c, b))
        if beyond is not None and not taken[beyond[0]]:
            taken[beyond[0]] = True
            strips += [a, b, c, beyond[1], -1]
        else:
            strips += [a, b, c, -1]
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    body = vertices.astype("<f4").tobytes() + struct.pack("<i", len(strips)) + np.array(strips, "<i4").tobytes()
    path.write_bytes(head.encode() + body)


def write_quads(path, vertices, faces):
    """Write an OFF file with as many pairs of triangles as quadrangles as follow one another, in colour."""
    rows = [" ".join(f"{v:.9g}" for v in vertex) + " 200 100 50 255" for vertex in vertices.tolist()]
    lines, k, triangles = [], 0, faces.tolist()
    while k < len(triangles):
        a, b, c = triangles[k]
        if k + 1 < len(triangles) and triangles[k + 1][:2] == [a, c]:
            lines.append(f"4 {a} {b} {c} {triangles[k + 1][2]}")
            k += 2
        else:
            lines.append(f"3 {a} {b} {c}")
            k += 1
    path.write_text("\n".join(["COFF", f"{len(rows)} {len(lines)} 0", *rows, *lines]) + "\n")


def write_plain(path, vertices, faces, uv=None):
    """Write a mesh as another program would: without base and provenance."""
    import trimesh

    visual = None if uv is None else trimesh.visual.TextureVisuals(uv=uv)
    trimesh.Trimesh(vertices, faces, process=False, validate=False, visual=visual).export(path)
