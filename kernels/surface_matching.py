"""The papers' own measure: neighbours laid on the surface at a sample, squared distance to the nearest triangle there."""

from __future__ import annotations

import warp as wp

wp.set_module_options({"enable_backward": False})

NOT_VIABLE = 1.0e30
_NOT_VIABLE = wp.constant(NOT_VIABLE)
_MOST_STEPS = wp.constant(64)


@wp.func
def squared_distance_to_triangle(p: wp.vec3, a: wp.vec3, b: wp.vec3, c: wp.vec3) -> float:
    """Least squared distance from ``p`` to triangle (a, b, c) (Ericson, Real-Time Collision Detection, 5.1.5)."""
    ab = b - a
    ac = c - a
    ap = p - a
    d1 = wp.dot(ab, ap)
    d2 = wp.dot(ac, ap)
    bp = p - b
    d3 = wp.dot(ab, bp)
    d4 = wp.dot(ac, bp)
    cp = p - c
    d5 = wp.dot(ab, cp)
    d6 = wp.dot(ac, cp)
    va = d3 * d6 - d5 * d4
    vb = d5 * d2 - d1 * d6
    vc = d1 * d4 - d3 * d2
    q = a
    if d1 <= 0.0 and d2 <= 0.0:
        q = a
    elif d3 >= 0.0 and d4 <= d3:
        q = b
    elif d6 >= 0.0 and d5 <= d6:
        q = c
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        q = a + (d1 / (d1 - d3)) * ab
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        q = a + (d2 / (d2 - d6)) * ac
    elif va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        q = b + ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (c - b)
    else:
        total = va + vb + vc
        if total > 0.0:
            q = a + (vb / total) * ab + (vc / total) * ac
    return wp.length_sq(p - q)


@wp.func
def nearest_vertex(
    p: wp.vec3,
    first: int,
    foot: wp.array(dtype=wp.vec3),
    offsets: wp.array(dtype=wp.int32),
    neighbours: wp.array(dtype=wp.int32),
) -> int:
    """Vertex whose base point is nearest to ``p``, by descent over the triangulation's edges from ``first``.

    Exact on a Delaunay triangulation; a scan's own triangles may stop it one vertex short.
    """
    here = first
    best = wp.length_sq(foot[here] - p)
    step = int(0)
    while step < _MOST_STEPS:
        better = here
        for e in range(offsets[here], offsets[here + 1]):
            d = wp.length_sq(foot[neighbours[e]] - p)
            if d < best:
                best = d
                better = neighbours[e]
        if better == here:
            step = _MOST_STEPS
        here = better
        step = step + 1
    return here


@wp.kernel
def surface_ssd_kernel(
    start: int,
    target: wp.array(dtype=wp.int32),
    list_offsets: wp.array(dtype=wp.int32),
    listed: wp.array(dtype=wp.int32),
    list_weight: wp.array(dtype=float),
    position: wp.array(dtype=wp.vec3),
    foot: wp.array(dtype=wp.vec3),
    u: wp.array(dtype=wp.vec3),
    v: wp.array(dtype=wp.vec3),
    offsets: wp.array(dtype=wp.int32),
    neighbours: wp.array(dtype=wp.int32),
    face_offsets: wp.array(dtype=wp.int32),
    incident: wp.array(dtype=wp.int32),
    faces: wp.array2d(dtype=wp.int32),
    is_sample: wp.array(dtype=wp.uint8),
    sample_foot: wp.array(dtype=wp.vec3),
    sample_u: wp.array(dtype=wp.vec3),
    sample_v: wp.array(dtype=wp.vec3),
    sample_vertex: wp.array(dtype=wp.int32),
    rotation: wp.array(dtype=wp.vec2),
    stride: int,
    factor: float,
    # output
    cost: wp.array2d(dtype=float),
):
    """Weighted squared distances of a target's textured neighbours to the surface at every ``stride``-th candidate.

    Eq. 2 of paper 001, with paper 000's rule of viability: the partner vertex nearest on the base, and the corners of the
    triangle nearest in space, must all be samples. A candidate is dropped once its sum exceeds ``factor`` times the best
    that this thread has seen; what is within ``factor`` of the best of all is never dropped.
    """
    i, first = wp.tid()
    row = start + i
    t = target[row]
    ut = u[t]
    vt = v[t]
    nt = wp.cross(ut, vt)
    samples = sample_foot.shape[0]
    best = float(_NOT_VIABLE)
    c = first
    while c < cost.shape[1]:
        s = c % samples
        turn = rotation[c / samples]
        us = sample_u[s]
        vs = sample_v[s]
        ns = wp.cross(us, vs)
        total = float(0.0)
        partner = sample_vertex[s]
        e = list_offsets[row]
        while e < list_offsets[row + 1]:
            n = listed[e]
            r = foot[n] - foot[t]
            x = wp.dot(r, ut)
            y = wp.dot(r, vt)
            p = sample_foot[s] + (turn[0] * x - turn[1] * y) * us + (turn[1] * x + turn[0] * y) * vs + wp.dot(r, nt) * ns
            partner = nearest_vertex(p, partner, foot, offsets, neighbours)
            r = position[n] - foot[t]
            x = wp.dot(r, ut)
            y = wp.dot(r, vt)
            p = sample_foot[s] + (turn[0] * x - turn[1] * y) * us + (turn[1] * x + turn[0] * y) * vs + wp.dot(r, nt) * ns
            nearest = float(_NOT_VIABLE)
            viable = int(0)
            if is_sample[partner] != wp.uint8(0):
                for k in range(face_offsets[partner], face_offsets[partner + 1]):
                    f = incident[k]
                    i0 = faces[f, 0]
                    i1 = faces[f, 1]
                    i2 = faces[f, 2]
                    d = squared_distance_to_triangle(p, position[i0], position[i1], position[i2])
                    if d < nearest:
                        nearest = d
                        viable = int(0)
                        if is_sample[i0] != wp.uint8(0) and is_sample[i1] != wp.uint8(0) and is_sample[i2] != wp.uint8(0):
                            viable = int(1)
            total = total + list_weight[e] * nearest
            if viable == 0 or total > factor * best:
                total = float(_NOT_VIABLE)
                e = list_offsets[row + 1]
            e = e + 1
        cost[row, c] = total
        best = wp.min(best, total)
        c = c + stride
