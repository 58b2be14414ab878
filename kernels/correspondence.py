"""Correspondence fields on a triangulated surface: for every target a measured place, an angle, and whether it is mirrored.

A place is a vertex and an offset in its tangent frame, at most about half an edge long. A map A = R(angle) M turns tangent
vectors of the target's frame into the source's frame; M mirrors the second axis or is the identity. Vertices are joined by steps:
for every directed edge the neighbour's position in the vertex's own frame and the angle of the neighbour's frame there. All
walking is done on these tables, so that carrying a place over an edge costs a few look-ups.

After Barnes et al. 2009 (PatchMatch), on a surface.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import upload
from intaglio.kernels.meshes import Triangles, face_barycentric

wp.set_module_options({"enable_backward": False})

ROTATIONS = 24
# Grid points per ring, in units of the step: ring j lies j steps from the centre.
_RING_POINTS = (12, 12, 24, 24)
_TURNS = wp.constant(ROTATIONS)
_MOST_STEPS = wp.constant(96)
# A walk that ends further than this from a vertex, in units of the step over its last edge, ran into a border.
_STRAY = wp.constant(1.0)
_UNFIT = wp.constant(1.0e6)
_MOST_NEIGHBORS = wp.constant(12)
# Carried places this close, in spacings, are one.
_SAME = wp.constant(1.05)
# Share of the target's weight that the source must know, and weight that makes a comparison half reliable.
_KNOWN_SHARE = wp.constant(0.5)
_RELIABLE = wp.constant(0.05)

_NeighborPlaces = wp.types.vector(length=12, dtype=wp.int32)


def patch_grid() -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (G,) of a patch's grid points, which sum to 1, and their rotated numbers (2 R, G).

    Point 0 is the centre, then ring by ring. ``turns[q, k]`` is the source's grid point that the target's point k falls on when
    the patch is turned by ``2 pi q / R``, and ``turns[R + q, k]`` the one where it is mirrored first. Rings of fewer than R
    points are turned by whole points.
    """
    ring = np.repeat(np.arange(len(_RING_POINTS) + 1), [1, *_RING_POINTS])
    area = np.concatenate([[np.pi / 4], *(np.full(n, 2 * np.pi * j / n) for j, n in enumerate(_RING_POINTS, 1))])
    weight = area * np.exp(-0.5 * (ring / 2.5) ** 2)
    turns = np.zeros((2 * ROTATIONS, len(ring)), np.int32)
    for j, count in enumerate(_RING_POINTS, 1):
        first, k = int(np.argmax(ring == j)), np.arange(count)
        for q in range(ROTATIONS):
            shift = int(np.floor(q * count / ROTATIONS + 0.5))
            turns[q, first + k] = first + (k + shift) % count
            turns[ROTATIONS + q, first + k] = first + (shift - k) % count
    return (weight / weight.sum()).astype(np.float32), turns


def patch_rays() -> tuple[np.ndarray, np.ndarray]:
    """Return the directions (R, 2) of a patch's rays, and the grid point (R, 4) that each ring has on them, or -1."""
    angle = 2 * np.pi * np.arange(ROTATIONS) / ROTATIONS
    point = np.full((ROTATIONS, len(_RING_POINTS)), -1, np.int32)
    first = 1
    for j, count in enumerate(_RING_POINTS):
        point[:: ROTATIONS // count, j] = first + np.arange(count)
        first += count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1).astype(np.float32), point


@wp.struct
class Steps:
    """The surface as walks see it: neighbours of vertex i are entries offsets[i] to offsets[i + 1] of the other tables.

    ``step``: the neighbour in the vertex's frame, in spacings; ``turn``: the angle of the neighbour's frame in it.
    """

    offsets: wp.array[wp.int32]
    neighbors: wp.array[wp.int32]
    step: wp.array[wp.vec2]
    turn: wp.array[wp.float32]
    foot: wp.array[wp.vec3]
    u: wp.array[wp.vec3]
    v: wp.array[wp.vec3]
    face_offsets: wp.array[wp.int32]
    incident: wp.array[wp.int32]


@wp.struct
class Field:
    """A correspondence field: per vertex the source's vertex (-1 for none), the offset there, the angle, and 1 where mirrored."""

    place: wp.array[wp.int32]
    offset: wp.array[wp.vec2]
    angle: wp.array[wp.float32]
    mirror: wp.array[wp.int32]
    cost: wp.array[wp.float32]


def empty_field(count: int, device: str) -> Field:
    """Return a field of ``count`` vertices without a source."""
    field = Field()
    field.place = upload(np.full(count, -1), wp.int32, device)
    field.offset = wp.zeros(count, dtype=wp.vec2, device=device)
    field.angle, field.cost = (wp.zeros(count, dtype=wp.float32, device=device) for _ in range(2))
    field.mirror = wp.zeros(count, dtype=wp.int32, device=device)
    return field


@wp.struct
class Terms:
    """What counts how much in a match's cost.

    ``w_height`` and ``w_slope`` scale the squared differences, ``afloat`` is 1 where a match's mean difference in height doesn't
    count and 0 where it does; ``upright`` is what a source costs that stands on its head; ``missing`` is what a grid point costs
    that the source doesn't know; ``coherence`` what it costs if no neighbour implies the same place; ``locality`` what a distance
    of ``reach`` (spacings) or more costs; ``likeness`` and ``direction`` scale squared differences of descriptors, ``use`` how
    often a source is taken already.
    """

    w_height: float
    w_slope: float
    afloat: float
    upright: float
    missing: float
    coherence: float
    locality: float
    reach: float
    likeness: float
    use: float
    direction: float


@wp.struct
class Patches:
    """What targets and sources look like: the patches of both, and what is said of their surroundings.

    Row ``row[i]`` of ``values`` is the patch of vertex i, or of one nearby, in whose frame that of i stands at ``row_turn[i]``.
    ``weight`` and ``turns`` are those of `patch_grid`; ``likeness``, ``direction`` and ``used`` are descriptors of all vertices.
    """

    values: wp.array2d[wp.vec4]
    row: wp.array[wp.int32]
    row_turn: wp.array[wp.float32]
    turns: wp.array2d[wp.int32]
    weight: wp.array[wp.float32]
    likeness: wp.array[wp.vec4]
    direction: wp.array[wp.vec2]
    used: wp.array[wp.float32]


@wp.struct
class Reach:
    """Where a sweep looks: angles and mirror images or not, how far at random and at other targets, or at neighbours alone."""

    turning: float
    mirrored: int
    span: float
    stride: float
    halvings: int
    explore: int


@wp.func
def rotated(angle: float, w: wp.vec2) -> wp.vec2:
    """Return ``w`` turned by ``angle``."""
    c = wp.cos(angle)
    s = wp.sin(angle)
    return wp.vec2(c * w[0] - s * w[1], s * w[0] + c * w[1])


@wp.func
def mapped(angle: float, mirror: int, w: wp.vec2) -> wp.vec2:
    """Return A w: mirrored, then turned."""
    y = w[1]
    if mirror != 0:
        y = -y
    return rotated(angle, wp.vec2(w[0], y))


@wp.func
def walk(steps: Steps, first: int, way: wp.vec2):
    """Walk from vertex ``first`` by ``way`` in its frame: the nearest vertex, the rest in its frame, its frame's angle."""
    at = int(first)
    rest = way
    turn = float(0.0)
    count = int(0)
    while count < _MOST_STEPS:
        best = int(-1)
        least = wp.length_sq(rest) * 0.9999
        for e in range(steps.offsets[at], steps.offsets[at + 1]):
            left = wp.length_sq(rest - steps.step[e])
            if left < least:
                least = left
                best = e
        if best < 0:
            count = _MOST_STEPS
        else:
            rest = rotated(-steps.turn[best], rest - steps.step[best])
            turn = turn + steps.turn[best]
            at = steps.neighbors[best]
            count = count + 1
    return at, rest, turn


@wp.func
def patch_difference(patches: Patches, i: int, p: int, angle: float, mirror: int, terms: Terms) -> float:
    """Weighted mean of w_h (T - S - mean)^2 + w_s |grad T - grad S|^2 over the grid points that target i knows, for source p."""
    target_row = patches.row[i]
    source_row = patches.row[p]
    q = int(wp.round((angle + patches.row_turn[p]) * float(_TURNS) / 6.283185307179586)) % _TURNS
    if q < 0:
        q = q + _TURNS
    flip = float(1.0)
    if mirror != 0:
        q = q + _TURNS
        flip = float(-1.0)
    both = float(0.0)
    lost = float(0.0)
    first = float(0.0)
    second = float(0.0)
    slopes = float(0.0)
    for k in range(patches.weight.shape[0]):
        a = patches.values[target_row, k]
        g = patches.weight[k] * a[3]
        if g > 0.0:
            b = patches.values[source_row, patches.turns[q, k]]
            if b[3] > 0.0:
                d = a[0] - b[0]
                both = both + g
                first = first + g * d
                second = second + g * d * d
                r = a[1] - b[1]
                t = a[2] - flip * b[2]
                slopes = slopes + g * (r * r + t * t)
            else:
                lost = lost + g
    total = both + lost
    result = float(0.0)
    if total > 0.0:
        if both < _KNOWN_SHARE * total:
            result = _UNFIT
        else:
            difference = terms.w_height * (second - terms.afloat * first * first / both) + terms.w_slope * slopes
            result = (difference + terms.missing * lost) / total
            # Little that is known says little.
            result = result * total / (total + _RELIABLE)
    return result


@wp.func
def match_cost(patches: Patches, foot: wp.array[wp.vec3], i: int, p: int, angle: float, mirror: int, terms: Terms) -> float:
    """Return the cost of giving target i the source p, without coherence: patches, likeness, direction, distance, use."""
    cost = patch_difference(patches, i, p, angle, mirror, terms)
    cost = cost + terms.likeness * wp.length_sq(patches.likeness[i] - patches.likeness[p])
    # Directions are double angles; a mirror turns them round.
    d = mapped(2.0 * angle, mirror, patches.direction[i]) - patches.direction[p]
    cost = cost + terms.direction * wp.length_sq(d)
    cost = cost + 0.5 * terms.upright * (1.0 - wp.cos(angle))
    cost = cost + terms.locality * wp.min(wp.length(foot[i] - foot[p]) / terms.reach, 1.0)
    return cost + terms.use * patches.used[p]


@wp.kernel
def sweep_kernel(
    start: int,
    targets: wp.array[wp.int32],
    active: wp.array[wp.uint8],
    allowed: wp.array[wp.uint8],
    sources: wp.array[wp.int32],
    steps: Steps,
    patches: Patches,
    terms: Terms,
    reach: Reach,
    seed: int,
    before: Field,
    # output
    fresh: Field,
):
    """One sweep of PatchMatch: some targets look at what their neighbours' places imply for them, at far targets', and at random.

    Reads the field of the last sweep alone, so that results don't depend on the order of work. Where ``reach.explore`` is 0,
    neighbours alone are asked.
    """
    index = start + wp.tid()
    i = targets[index]
    place = before.place[i]
    offset = before.offset[i]
    angle = before.angle[i]
    mirror = before.mirror[i]
    state = wp.rand_init(seed, index)
    if wp.randf(state) < 0.6 or place < 0:
        # What neighbours imply, for candidates and for coherence.
        implied = _NeighborPlaces()
        number = int(0)
        for e in range(steps.offsets[i], steps.offsets[i + 1]):
            j = steps.neighbors[e]
            if active[j] != 0 and before.place[j] >= 0 and number < _MOST_NEIGHBORS:
                back = -rotated(-steps.turn[e], steps.step[e])
                p, rest, turned = walk(steps, before.place[j], before.offset[j] + mapped(before.angle[j], before.mirror[j], back))
                implied[number] = int(-1)
                if allowed[p] != 0 and wp.length(rest) < _STRAY:
                    implied[number] = p
                number = number + 1
        best = float(3.0e6)
        best_place = int(-1)
        best_offset = offset
        best_angle = angle
        best_mirror = mirror
        candidates = number + 1
        if reach.explore != 0:
            candidates = number + 4 + reach.halvings
        last_e = steps.offsets[i]
        for c in range(candidates):
            p = int(-1)
            rest = wp.vec2(0.0, 0.0)
            way = float(0.0)
            flip = int(0)
            if c == 0:
                p = place
                rest = offset
                way = angle
                flip = mirror
            elif c <= number:
                # The next neighbour that takes part.
                found = int(0)
                while found == 0:
                    j = steps.neighbors[last_e]
                    if active[j] != 0 and before.place[j] >= 0:
                        found = int(1)
                    else:
                        last_e = last_e + 1
                j = steps.neighbors[last_e]
                turn = steps.turn[last_e]
                back = -rotated(-turn, steps.step[last_e])
                last_e = last_e + 1
                if implied[c - 1] >= 0:
                    flip = before.mirror[j]
                    q, over, turned = walk(steps, before.place[j], before.offset[j] + mapped(before.angle[j], flip, back))
                    p = q
                    rest = over
                    # The frame of i stands at -turn in the frame of j.
                    way = before.angle[j] - turn - turned
                    if flip != 0:
                        way = before.angle[j] + turn - turned
            elif c <= number + 2:
                # A target some way off: its map, carried back to here.
                out = rotated(6.2831853 * wp.randf(state), wp.vec2(reach.stride * (1.0 + float(c - number)), 0.0))
                j, over, turn = walk(steps, i, out)
                if active[j] != 0 and before.place[j] >= 0:
                    flip = before.mirror[j]
                    back = -(rotated(-turn, out) - over)
                    q, left, turned = walk(steps, before.place[j], before.offset[j] + mapped(before.angle[j], flip, back))
                    if wp.length(left) < _STRAY:
                        p = q
                        rest = left
                        way = before.angle[j] - turn - turned
                        if flip != 0:
                            way = before.angle[j] + turn - turned
            elif c == number + 3:
                p = sources[int(wp.randf(state) * float(sources.shape[0])) % sources.shape[0]]
                way = reach.turning * 6.2831853 * wp.randf(state)
                if terms.upright > 0.0 and wp.randf(state) < 0.5:
                    way = float(0.0)
                if reach.mirrored != 0 and wp.randf(state) < 0.5:
                    flip = int(1)
            elif best_place >= 0:
                far = reach.span * wp.pow(0.5, float(c - number - 4))
                out = rotated(6.2831853 * wp.randf(state), wp.vec2(far * wp.sqrt(wp.randf(state)), 0.0))
                q, over, turned = walk(steps, best_place, best_offset + out)
                flip = best_mirror
                if wp.length(over) < _STRAY:
                    p = q
                    rest = over
                    way = best_angle - turned + reach.turning * 0.5 * (wp.randf(state) - 0.5)
            if p >= 0:
                if allowed[p] != 0:
                    agree = float(0.0)
                    for k in range(number):
                        if implied[k] >= 0:
                            if wp.length(steps.foot[implied[k]] - steps.foot[p]) < _SAME:
                                agree = agree + 1.0
                    cost = match_cost(patches, steps.foot, i, p, way, flip, terms)
                    if number > 0:
                        cost = cost + terms.coherence * (1.0 - agree / float(number))
                    if cost < best:
                        best = cost
                        best_place = p
                        best_offset = rest
                        best_angle = way
                        best_mirror = flip
        place = best_place
        offset = best_offset
        angle = best_angle
        mirror = best_mirror
        fresh.cost[i] = best
    else:
        fresh.cost[i] = before.cost[i]
    fresh.place[i] = place
    fresh.offset[i] = offset
    fresh.angle[i] = angle
    fresh.mirror[i] = mirror


@wp.kernel
def patch_kernel(
    start: int,
    vertices: wp.array[wp.int32],
    steps: Steps,
    face: wp.array2d[wp.int32],
    weight: wp.array2d[wp.vec2],
    mesh: Triangles,
    height: wp.array[wp.float32],
    confidence: wp.array[wp.float32],
    # output
    value: wp.array2d[wp.vec4],
):
    """Write (h, dh/dr, dh/(r d angle), confidence) at a vertex's grid points; confidence is the corners' least."""
    i = start + wp.tid()
    center = steps.foot[vertices[i]]
    for k in range(face.shape[1]):
        f = face[i, k]
        out = wp.vec4(0.0, 0.0, 0.0, 0.0)
        if f >= 0:
            ia = mesh.faces[f, 0]
            ib = mesh.faces[f, 1]
            ic = mesh.faces[f, 2]
            c = wp.min(confidence[ia], wp.min(confidence[ib], confidence[ic]))
            if c > 0.0:
                a = mesh.points[ia]
                b = mesh.points[ib]
                d = mesh.points[ic]
                w = weight[i, k]
                w2 = 1.0 - w[0] - w[1]
                h = w[0] * height[ia] + w[1] * height[ib] + w2 * height[ic]
                n = wp.cross(b - a, d - a)
                area = wp.dot(n, n)
                radial = float(0.0)
                around = float(0.0)
                if area > 0.0 and k > 0:
                    slope = (
                        height[ia] * wp.cross(n, d - b) + height[ib] * wp.cross(n, a - d) + height[ic] * wp.cross(n, b - a)
                    ) / area
                    n = wp.normalize(n)
                    out_way = w[0] * a + w[1] * b + w2 * d - center
                    out_way = wp.normalize(out_way - wp.dot(out_way, n) * n)
                    radial = wp.dot(slope, out_way)
                    around = wp.dot(slope, wp.cross(n, out_way))
                out = wp.vec4(h, radial, around, c)
        value[i, k] = out


@wp.func
def height_at(steps: Steps, mesh: Triangles, height: wp.array[wp.float32], known: wp.array[wp.uint8], p: int, offset: wp.vec2):
    """Return the height at a place and whether all corners there are measured."""
    at = steps.foot[p] + offset[0] * steps.u[p] + offset[1] * steps.v[p]
    best = float(-1.0e9)
    h = height[p]
    sure = int(known[p])
    for e in range(steps.face_offsets[p], steps.face_offsets[p + 1]):
        f = steps.incident[e]
        b = face_barycentric(mesh, f, at)
        low = wp.min(b)
        if low > best:
            best = low
            b = wp.vec3(wp.max(b[0], 0.0), wp.max(b[1], 0.0), wp.max(b[2], 0.0))
            b = b / (b[0] + b[1] + b[2])
            ia = mesh.faces[f, 0]
            ib = mesh.faces[f, 1]
            ic = mesh.faces[f, 2]
            h = b[0] * height[ia] + b[1] * height[ib] + b[2] * height[ic]
            sure = int(known[ia]) * int(known[ib]) * int(known[ic])
    return h, sure


@wp.kernel
def wish_kernel(
    start: int,
    vertex: wp.array[wp.int32],
    entry: wp.array[wp.int32],
    steps: Steps,
    mesh: Triangles,
    height: wp.array[wp.float32],
    known: wp.array[wp.uint8],
    field: Field,
    # output
    wish: wp.array[wp.float32],
    sure: wp.array[wp.float32],
    own: wp.array[wp.float32],
    reached: wp.array[wp.int32],
):
    """For an edge i -> j: what the source of i says about h_j - h_i, whether it knows, h_i there, the vertex it has for j."""
    index = start + wp.tid()
    i = vertex[index]
    e = entry[index]
    p = field.place[i]
    wish[index] = 0.0
    sure[index] = 0.0
    own[index] = 0.0
    reached[index] = -1
    if p >= 0:
        here, known_here = height_at(steps, mesh, height, known, p, field.offset[i])
        own[index] = here
        q, rest, _ = walk(steps, p, field.offset[i] + mapped(field.angle[i], field.mirror[i], steps.step[e]))
        there, known_there = height_at(steps, mesh, height, known, q, rest)
        if wp.length(rest) < _STRAY:
            reached[index] = q
            if known_here * known_there != 0:
                wish[index] = there - here
                sure[index] = 1.0
