"""Connectivity of large triangle meshes on the CPU: opposite edges, fans about vertices, pieces, and faces to be looked at twice.

A directed edge is numbered by the corner that it starts from: edge e of face e // 3 goes to the corner after. ``starts`` and
``corners`` are the corners at every vertex, ascending: ``corners[starts[v]:starts[v + 1]]``.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload

wp.set_module_options({"enable_backward": False})

# Of edges both of whose ends have more corners than this the opposite is not looked for: see `opposites`.
CROWDED = 256
# What `opposites` says of these.
NOT_SOUGHT = -2


@wp.func
def next_corner(c: wp.int32) -> wp.int32:
    """Return the corner after ``c`` in its face."""
    result = c + 1
    if result % 3 == 0:
        result = c - 2
    return result


@wp.func
def previous_corner(c: wp.int32) -> wp.int32:
    """Return the corner before ``c`` in its face."""
    result = c - 1
    if c % 3 == 0:
        result = c + 2
    return result


@wp.kernel
def _opposites(
    start: int,
    faces: wp.array[wp.int32],
    starts: wp.array[wp.int32],
    corners: wp.array[wp.int32],
    # output
    opposite: wp.array[wp.int32],
):
    """opposite[e] = the first edge from the end of e to its start, or -1."""
    e = start + wp.tid()
    a = faces[e]
    b = faces[next_corner(e)]
    found = int(-1)
    # Such an edge starts at b and ends at a: it is looked for where fewer corners are.
    if starts[b + 1] - starts[b] <= starts[a + 1] - starts[a]:
        if starts[b + 1] - starts[b] > CROWDED:
            found = NOT_SOUGHT
        else:
            at = starts[b]
            while at < starts[b + 1] and found < 0:
                if faces[next_corner(corners[at])] == a:
                    found = corners[at]
                at += 1
    else:
        if starts[a + 1] - starts[a] > CROWDED:
            found = NOT_SOUGHT
        else:
            # A face that names a vertex twice may bring edges out of order, so that all have to be looked at.
            for at in range(starts[a], starts[a + 1]):
                before = previous_corner(corners[at])
                if faces[before] == b and (found < 0 or before < found):
                    found = before
    opposite[e] = found


@wp.kernel
def _whole_fans(
    start: int,
    starts: wp.array[wp.int32],
    corners: wp.array[wp.int32],
    opposite: wp.array[wp.int32],
    # output
    whole: wp.array[wp.uint8],
):
    """whole[v] = 1 where the faces at v hang together by their edges in one fan; every edge must be its opposite's opposite."""
    v = start + wp.tid()
    count = starts[v + 1] - starts[v]
    seen = int(0)
    if count > 0:
        first = corners[starts[v]]
        at = first
        seen = int(1)
        turning = int(1)
        while turning == 1:
            at = opposite[previous_corner(at)]
            if at < 0 or at == first or seen > count:
                turning = 0
            else:
                seen += 1
        if at < 0:
            at = opposite[first]
            while at >= 0 and seen <= count:
                seen += 1
                at = opposite[next_corner(at)]
    whole[v] = wp.uint8(wp.where(seen == count, 1, 0))


@wp.kernel
def _roots(start: int, first: wp.array[wp.int32], second: wp.array[wp.int32], root: wp.array[wp.int32]):
    """Join the sets of first[k] and second[k], one pair after the other: a set's root is its least member.

    All of it is one index, since every step goes on from those before.
    """
    for k in range(first.shape[0]):
        a = first[k]
        b = second[k]
        if b >= 0:
            while root[a] != a:
                root[a] = root[root[a]]
                a = root[a]
            while root[b] != b:
                root[b] = root[root[b]]
                b = root[b]
            if a < b:
                root[b] = a
            else:
                root[a] = b


@wp.kernel
def _flat_or_folded(
    start: int,
    points: wp.array2d[wp.float64],
    faces: wp.array[wp.int32],
    opposite: wp.array[wp.int32],
    flat: wp.float64,
    # output
    suspect: wp.array[wp.uint8],
):
    """suspect[f] = 1 for a face that is nearly a line, names a vertex twice, or shares two edges with one other."""
    f = start + wp.tid()
    i = faces[3 * f]
    j = faces[3 * f + 1]
    k = faces[3 * f + 2]
    p = wp.vec3d(points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2])
    q = wp.vec3d(points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2])
    r = q - p
    longest = wp.max(wp.dot(p, p), wp.max(wp.dot(q, q), wp.dot(r, r)))
    result = int(0)
    # False for what is not finite, too.
    if not (wp.length(wp.cross(p, q)) > flat * longest and longest > wp.float64(1.0e-200)):
        result = 1
    if i == j or j == k or k == i:
        result = 1
    first = opposite[3 * f]
    second = opposite[3 * f + 1]
    if first >= 0 and second >= 0 and first / 3 == second / 3:
        result = 1
    suspect[f] = wp.uint8(result)


@wp.kernel
def _edge_lengths(start: int, points: wp.array2d[wp.float64], faces: wp.array[wp.int32], length: wp.array[wp.float64]):
    """length[e] = how long edge e is."""
    e = start + wp.tid()
    a = faces[e]
    b = faces[next_corner(e)]
    x = points[a, 0] - points[b, 0]
    y = points[a, 1] - points[b, 1]
    z = points[a, 2] - points[b, 2]
    # Rounded after every step, as NumPy does.
    x = x * x
    y = y * y
    z = z * z
    length[e] = wp.sqrt((x + y) + z)


@wp.kernel
def _face_areas(start: int, points: wp.array2d[wp.float64], faces: wp.array[wp.int32], area: wp.array[wp.float64]):
    """area[f] = half the length of the cross product of two sides of face f."""
    f = start + wp.tid()
    i = faces[3 * f]
    j = faces[3 * f + 1]
    k = faces[3 * f + 2]
    px = points[j, 0] - points[i, 0]
    py = points[j, 1] - points[i, 1]
    pz = points[j, 2] - points[i, 2]
    qx = points[k, 0] - points[i, 0]
    qy = points[k, 1] - points[i, 1]
    qz = points[k, 2] - points[i, 2]
    x = py * qz - pz * qy
    y = pz * qx - px * qz
    z = px * qy - py * qx
    area[f] = wp.float64(0.5) * wp.sqrt((x * x + y * y) + z * z)


@wp.kernel
def _area_vectors(start: int, points: wp.array2d[wp.float64], faces: wp.array2d[wp.int32], total: wp.array2d[wp.float64]):
    """total[v] = the sum over the faces at v of the cross product of two sides.

    All of it is one index, so that every vertex adds its faces in their order.
    """
    for f in range(faces.shape[0]):
        i = faces[f, 0]
        j = faces[f, 1]
        k = faces[f, 2]
        px = points[j, 0] - points[i, 0]
        py = points[j, 1] - points[i, 1]
        pz = points[j, 2] - points[i, 2]
        qx = points[k, 0] - points[i, 0]
        qy = points[k, 1] - points[i, 1]
        qz = points[k, 2] - points[i, 2]
        x = py * qz - pz * qy
        y = pz * qx - px * qz
        z = px * qy - py * qx
        for c in range(3):
            v = faces[f, c]
            total[v, 0] = total[v, 0] + x
            total[v, 1] = total[v, 1] + y
            total[v, 2] = total[v, 2] + z


def opposites(faces: np.ndarray, starts: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the first opposite edge (3F,) int32 of every directed edge, -1 where there is none.

    An edge both of whose ends have more than ``CROWDED`` corners has `NOT_SOUGHT`: looking through them would take the square of
    their number.

    Parameters
    ----------
    faces : (F, 3) int32 array
    starts, corners : (N + 1,), (3F,) int32 arrays
        The corners at every vertex.
    """
    opposite = np.empty(faces.size, np.int32)
    tables = [_shared(a) for a in (faces.reshape(-1), starts, corners)]
    launch(_opposites, faces.size, tables, [_shared(opposite)], device="cpu", work=20)
    return opposite


def whole_fans(starts: np.ndarray, corners: np.ndarray, opposite: np.ndarray) -> np.ndarray:
    """Return which vertices (N,) bool have one fan of faces, or none; the opposite of every edge's opposite must be itself."""
    whole = np.empty(len(starts) - 1, np.uint8)
    launch(_whole_fans, len(whole), [_shared(a) for a in (starts, corners, opposite)], [_shared(whole)], device="cpu", work=40)
    return whole.view(bool)


def suspect_faces(points: np.ndarray, faces: np.ndarray, opposite: np.ndarray, flat: float) -> np.ndarray:
    """Return which faces (F,) bool have less than ``flat`` of twice their area beside the square of their longest side.

    And those that name a vertex twice, or share two edges with one other face.

    Parameters
    ----------
    points : (N, 3) float64 array
    faces : (F, 3) int32 array
    opposite : (3F,) int32 array
    flat : float
    """
    suspect = np.empty(len(faces), np.uint8)
    inputs = [
        upload(points, wp.float64, "cpu", copy=False),
        *(_shared(a) for a in (faces.reshape(-1), opposite)),
        wp.float64(flat),
    ]
    launch(_flat_or_folded, len(faces), inputs, [_shared(suspect)], device="cpu", work=30)
    return suspect.view(bool)


def edge_lengths(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the lengths (3F,) float64 of the directed edges of faces (F, 3) int32 over points (N, 3) float64."""
    length = np.empty(faces.size)
    at = upload(points, wp.float64, "cpu", copy=False)
    out = upload(length, wp.float64, "cpu", copy=False)
    launch(_edge_lengths, faces.size, [at, _shared(faces.reshape(-1))], [out], device="cpu", work=10)
    return length


def face_areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the areas (F,) float64 of faces (F, 3) int32 over points (N, 3) float64."""
    area = np.empty(len(faces))
    at = upload(points, wp.float64, "cpu", copy=False)
    out = upload(area, wp.float64, "cpu", copy=False)
    launch(_face_areas, len(faces), [at, _shared(faces.reshape(-1))], [out], device="cpu", work=20)
    return area


def area_vectors(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the sum (N, 3) float64 of the area vectors, twice the areas long, of the faces (F, 3) int32 at every point."""
    total = np.zeros((len(points), 3))
    at, out = (upload(a, wp.float64, "cpu", copy=False) for a in (points, total))
    launch(_area_vectors, 1, [at, _shared(np.ascontiguousarray(faces))], [out], device="cpu")
    return total


def least_members(count: int, pairs: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Return the least member (count,) int32 of the set that everything belongs to, where pairs of int32 arrays are joined.

    Pairs whose second is negative are none.
    """
    root = np.arange(count, dtype=np.int32)
    for first, second in pairs:
        launch(_roots, 1, [_shared(first), _shared(second)], [_shared(root)], device="cpu")
    # A root is no larger than its members, so that looking up by doubled steps ends soon.
    while True:
        above = root[root]
        if np.array_equal(above, root):
            return root
        root = above


def _shared(array: np.ndarray) -> wp.array:
    return upload(array, wp.uint8 if array.dtype == np.uint8 else wp.int32, "cpu", copy=False)
