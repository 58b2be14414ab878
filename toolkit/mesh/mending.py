"""Mending meshes whose faces do not join as they should: cutting apart, joining, and turning, without moving a vertex.

Joints decide everything: two faces are joined where a pair of their edges is. A vertex of the mended mesh is a fan of faces
that hang together by joints, so that where sheets only touch, in an edge or in a point, each gets a vertex of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from intaglio.arrays import Array
from intaglio.checks import checked_arguments
from intaglio.errors import InputError
from intaglio.kernels.connectivity import opposites, suspect_faces, whole_fans
from intaglio.mesh.surface import PER_FACE, PER_VERTEX, Surface
from intaglio.mesh.topology import LARGE, corner_table, directed_edges, edges_pair_up, following, opposite_edges

# Of more faces than this at one edge no two are taken for a continuation of each other.
_MOST_AT_EDGE = 16
# A triangle of less area, twice, beside the square of its longest side lies in a line.
_FLAT = 1e-10
# Corners of more faces than this have numbers beyond 32 bits.
_MOST_FACES = (2**31 - 1) // 3


@dataclass(frozen=True)
class Mending:
    """What a mesh was mended to.

    Attributes
    ----------
    vertex : (N,) int array
        The given vertex that every mended one is. Vertices keep their order; those that were doubled come last.
    corner : (F, 3) int array
        The given corner, 3 times the face plus 0, 1 or 2, that every corner of the mended faces is.
    faces : (F, 3) int32 array
        Triangles over the mended vertices.
    notes : tuple of str
        What was done; empty if nothing was.
    """

    vertex: Array
    corner: Array
    faces: Array
    notes: tuple[str, ...]


@checked_arguments
def mend_surface(surface: Surface, *, strict: bool = False) -> Surface:
    """Return a surface whose faces join as those of a manifold; no vertex moves.

    Faces with two corners in one place and repeated faces are left out, and so are vertices that are not finite. Edges that
    lie exactly on one another are joined, two by two: of more than two those that belong to the same piece, else those that
    continue each other best. What else meets there, and sheets that touch in a vertex, are cut apart: each gets a vertex of its
    own in the same place. Faces are turned to the winding of most of their piece; a one-sided piece is cut open. A flat triangle
    whose corners lie in one line is taken up by its neighbour.

    Parameters
    ----------
    surface : Surface
        As read: with any faces.
    strict : bool, optional
        Refuse a surface with something to mend. Default False.

    Returns
    -------
    Surface
        The given one if there is nothing to mend, else one with what was done in ``notes`` and in ``file_vertex`` the given
        surface's vertex that each of its vertices is. Vertices keep their order, those that were doubled come last.

    Raises
    ------
    InputError
        If ``surface`` is none, nothing of it is left, or with ``strict`` there is something to mend.

    See Also
    --------
    intaglio.read_surface : Mends what it reads.

    References
    ----------
    Guéziec, Taubin, Lazarus & Horn, "Cutting and Stitching: Converting Sets of Polygons to Manifold Surfaces", IEEE TVCG 7(2),
    2001: local cutting and stitching along borders.

    Examples
    --------
    Three triangles at one edge: the two that lie in a plane are joined, the third gets vertices of its own.

    >>> import numpy as np
    >>> import intaglio
    >>> corners = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1]])
    >>> fin = intaglio.Surface(vertices=corners, faces=np.array([[1, 0, 2], [0, 1, 3], [0, 1, 4]]))
    >>> mended = intaglio.mend_surface(fin)
    >>> mended.faces
    array([[1, 0, 2],
           [0, 1, 3],
           [5, 6, 4]], dtype=int32)
    >>> mended.file_vertex
    array([0, 1, 2, 3, 4, 0, 1], dtype=int32)
    >>> mended.notes
    ('mended: 1 edge of more than two faces cut apart', 'mended: 2 vertices doubled where faces touch without joining')
    """
    if not isinstance(surface, Surface):
        raise InputError(f"surface must be an intaglio.Surface, not {type(surface).__name__}; read_surface(path) gives one")
    mending = mend_faces(surface.vertices, surface.faces)
    if not mending.notes:
        return surface
    if strict:
        raise InputError(f"its faces don't join as a surface; to be {'; '.join(mending.notes)} (without strict, --strict it is)")
    return apply_mending(surface, mending)


def apply_mending(surface: Surface, mending: Mending) -> Surface:
    """Return the surface that a mending of its faces makes."""
    vertex = mending.vertex
    fields = {name: value[vertex] for name in PER_VERTEX if (value := getattr(surface, name)) is not None}
    face = mending.corner[:, 0] // 3
    fields |= {name: value[face] for name in PER_FACE if name != "uv" and (value := getattr(surface, name)) is not None}
    came_from = np.arange(len(surface.vertices)) if surface.file_vertex is None else surface.file_vertex
    mended = np.full(len(surface.vertices), -1)
    # Of several copies of a vertex the first is the one that others take relief from.
    mended[vertex[::-1]] = np.arange(len(vertex))[::-1]
    source = surface.source[vertex]
    own = source == vertex
    return replace(
        surface,
        **fields,
        faces=mending.faces,
        source=np.where(own, np.arange(len(vertex)), np.where(source >= 0, mended[source], -1)),
        uv=None if surface.uv is None else surface.uv.reshape(-1, 2)[mending.corner],
        file_vertex=came_from[vertex],
        notes=surface.notes + tuple(f"mended: {note}" for note in mending.notes),
    )


def mend_faces(vertices: Array, faces: Array) -> Mending:
    """Return what the faces of a mesh have to be mended to; see `mend_surface`.

    Parameters
    ----------
    vertices : (N, 3) float64 array
        Positions, of which some may be not finite.
    faces : (F, 3) int array
        Triangles.
    """
    notes: list[str] = []
    if len(faces) > LARGE and _nothing_to_mend(vertices, faces):
        corners = np.arange(3 * len(faces), dtype=np.int32 if len(faces) <= _MOST_FACES else np.int64)
        return Mending(np.arange(len(vertices)), corners.reshape(-1, 3), np.ascontiguousarray(faces, np.int32), ())
    place = equal_places(vertices)
    face = _sound_faces(vertices, faces, place, notes)
    faces = np.asarray(faces[face], np.int64)
    joints = _join(vertices, faces, place, notes)
    turned, joints = _turn(faces, place, joints, notes)
    number, fan = _fans(faces, place, joints)
    vertex, numbers = _number_fans(number, fan, faces, np.isfinite(vertices).all(axis=1), notes)
    corner = 3 * face[:, None] + np.arange(3)
    corner[turned], numbers[turned] = corner[turned][:, ::-1], numbers[turned][:, ::-1]
    corner, numbers = _take_up_flat(vertices[vertex], corner, numbers, notes)
    if len(numbers) < len(face):
        # Where a face was left out others may touch in a single vertex.
        again = mend_faces(vertices[vertex], numbers)
        vertex, corner, numbers = vertex[again.vertex], corner.reshape(-1)[again.corner], again.faces
        notes += again.notes
    return Mending(vertex, corner, numbers.astype(np.int32), tuple(notes))


def _nothing_to_mend(vertices: Array, faces: Array) -> bool:
    """Tell, in a few passes without sorting edges, whether a mesh is a manifold as it is; where it says no, it may be one.

    It is one if all vertices are finite and in places of their own, if every edge is the opposite of its opposite and no two
    border edges are the same, if the faces at a vertex are one fan, and if no face is flat or lies on another.
    """
    if len(faces) > _MOST_FACES or not np.isfinite(vertices).all() or _share_places(vertices):
        return False
    faces = np.ascontiguousarray(faces, np.int32)
    starts, corners = corner_table(faces, len(vertices))
    opposite = opposites(faces, starts, corners)
    if not edges_pair_up(faces, opposite, len(vertices)) or not whole_fans(starts, corners, opposite).all():
        return False
    # Twice what counts as flat, so that rounding decides nothing.
    suspects = suspect_faces(vertices, faces, opposite, 2 * _FLAT)
    return not suspects.any()


def _share_places(vertices: Array) -> bool:
    """Tell whether some vertices lie exactly in one place."""
    mixed = _mixed_bits(vertices)
    ordered = np.sort(mixed)
    again = np.unique(ordered[1:][ordered[1:] == ordered[:-1]])
    if len(again) == 0:
        return False
    # Two places in some millions of millions have the same number by chance.
    suspects = vertices[again[np.minimum(np.searchsorted(again, mixed), len(again) - 1)] == mixed]
    return bool((equal_places(suspects) != np.arange(len(suspects))).any())


def _mixed_bits(vertices: Array) -> Array:
    """Return one number per vertex (N,) uint64 that is the same for those in one place, and hardly ever for others."""
    mixed = np.zeros(len(vertices), np.uint64)
    for axis in range(3):
        # Zero is added to make one of the two zeros.
        mixed ^= (vertices[:, axis] + 0.0).view(np.uint64)
        mixed *= np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return mixed


def equal_places(vertices: Array) -> Array:
    """Return for every vertex (N,) the first one that lies exactly in its place."""
    if len(vertices) == 0:
        return np.zeros(0, np.int64)
    # Zero is added to make one of the two zeros; one sort of a mixture of the bits instead of three of the coordinates.
    bits = np.ascontiguousarray(vertices + 0.0, np.float64).view(np.uint64)
    mixed = _mixed_bits(np.asarray(vertices, np.float64))
    order = np.argsort(mixed, kind="stable")
    ordered = bits[order]
    same = mixed[order[1:]] == mixed[order[:-1]]
    if (same & (ordered[1:] != ordered[:-1]).any(axis=1)).any():
        # Different places with the same mixture, which nobody will see, are told apart by sorting the coordinates.
        order = np.lexsort(bits.T)
        ordered = bits[order]
        same = (ordered[1:] == ordered[:-1]).all(axis=1)
    first = order[np.concatenate([[True], ~same])]
    out = np.empty(len(bits), np.int64)
    out[order] = first[np.cumsum(np.concatenate([[0], ~same]))]
    return out


def _plural(count: int, one: str, many: str | None = None) -> str:
    """Return a number with its noun."""
    return f"{count} {one if count == 1 else many or one + 's'}"


def _sound_faces(vertices: Array, faces: Array, place: Array, notes: list[str]) -> Array:
    """Return the numbers of the faces that have three places of their own and are no other's copy."""
    face = np.arange(len(faces))
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        face = face[finite[faces].all(axis=1)]
        left = len(faces) - len(face)
        notes.append(
            f"{_plural(int((~finite).sum()), 'vertex that is', 'vertices that are')} not finite left out"
            + (f" with {_plural(left, 'face')}" if left else "")
        )
    corners = place[faces[face]]
    degenerate = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    if degenerate.any():
        face, corners = face[~degenerate], corners[~degenerate]
        notes.append(f"{_plural(int(degenerate.sum()), 'degenerate face')} left out")
    ordered = np.sort(corners, axis=1)
    # The three numbers in one: copies agree in it, and of those that agree by chance all three are compared.
    key = ordered[:, 0] * len(vertices) + ordered[:, 1]
    key = key.view(np.uint64) * np.uint64(0x9E3779B97F4A7C15) + ordered[:, 2].view(np.uint64)
    order = np.argsort(key, kind="stable")
    alike = key[order[1:]] == key[order[:-1]]
    if alike.any():
        suspects = order[np.unique(np.flatnonzero(alike)[:, None] + [0, 1])]
        suspects.sort()
        _, first = np.unique(ordered[suspects], axis=0, return_index=True)
        copies = np.setdiff1d(suspects, suspects[first])
        if len(copies):
            face = np.delete(face, copies)
            notes.append(f"{_plural(len(copies), 'repeated face')} left out")
    return face


def _groups(keys: Array) -> tuple[Array, Array, Array]:
    """Return the order that sorts keys, and where each run of equal ones starts and how long it is."""
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    start = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]])) if len(keys) else np.zeros(0, np.int64)
    return order, start, np.diff(np.append(start, len(keys)))


def _undirected(edges: Array, count: int) -> Array:
    """Return one number per edge (E, 2) that doesn't depend on its direction."""
    low, high = np.minimum(edges[:, 0], edges[:, 1]), np.maximum(edges[:, 0], edges[:, 1])
    return np.asarray(low * count + high)


def _join(vertices: Array, faces: Array, place: Array, notes: list[str]) -> Array:
    """Return the joints (J, 2): pairs of directed edges, numbered as by `directed_edges`, across which faces are joined."""
    edges = directed_edges(faces)
    order, start, size = _groups(_undirected(edges, len(vertices)))
    two = start[size == 2]
    joints = np.stack([order[two], order[two + 1]], axis=1)
    free = order[np.repeat(size != 2, size)]
    if len(free) == 0:
        return joints
    # What the file does not join by numbers is joined by places.
    free.sort()
    order, start, size = _groups(_undirected(place[edges[free]], len(vertices)))
    order = free[order]
    two = start[size == 2]
    stitches = np.stack([order[two], order[two + 1]], axis=1)
    if len(stitches):
        notes.append(f"{_plural(len(stitches), 'pair')} of border edges that lie on one another joined")
    joints = np.concatenate([joints, stitches])
    if (size > 2).any():
        several = size > 2
        notes.append(f"{_plural(int(several.sum()), 'edge')} of more than two faces cut apart")
        joints = np.concatenate([joints, _pair_crowded(vertices, faces, place, joints, order, start[several], size[several])])
    return joints


def _pair_crowded(vertices: Array, faces: Array, place: Array, joints: Array, order: Array, start: Array, size: Array) -> Array:
    """Return joints among edges of which more than two lie on one another: same piece first, then same winding, then flattest."""
    start, size = start[size <= _MOST_AT_EDGE], size[size <= _MOST_AT_EDGE]
    if len(start) == 0:
        return np.zeros((0, 2), np.int64)
    edges = directed_edges(faces)
    piece = _face_pieces(joints, len(faces))
    pairs = []
    for gap in range(1, int(size.max())):
        at = np.concatenate([np.arange(s, s + n - gap) for s, n in zip(start, size, strict=True) if n > gap])
        pairs.append(np.stack([order[at], order[at + gap]], axis=1))
    a, b = np.concatenate(pairs).T
    away = []
    for e in (a, b):
        origin = vertices[edges[e, 0]]
        along = vertices[edges[e, 1]] - origin
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        side = vertices[faces[e // 3, (e + 2) % 3]] - origin
        side -= np.einsum("ij,ij->i", side, along)[:, None] * along
        away.append(side / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-300))
    folded = np.einsum("ij,ij->i", *away)
    other_piece = piece[a // 3] != piece[b // 3]
    against = place[edges[a, 0]] == place[edges[b, 0]]
    taken = np.zeros(3 * len(faces), bool)
    chosen = []
    for k in np.lexsort((b, a, folded, against, other_piece)):
        if not (taken[a[k]] or taken[b[k]] or a[k] // 3 == b[k] // 3):
            taken[a[k]] = taken[b[k]] = True
            chosen.append((a[k], b[k]))
    return np.array(chosen, np.int64).reshape(-1, 2)


def _face_pieces(joints: Array, count: int) -> Array:
    """Return the piece (F,) that every face belongs to by joints."""
    graph = coo_array((np.ones(len(joints), bool), (joints[:, 0] // 3, joints[:, 1] // 3)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def _turn(faces: Array, place: Array, joints: Array, notes: list[str]) -> tuple[Array, Array]:
    """Return which faces (F,) have to be turned, and the joints that are left where a piece is one-sided."""
    count = len(faces)
    edges = directed_edges(faces)
    against = place[edges[joints[:, 0], 0]] == place[edges[joints[:, 1], 0]]
    turned = np.zeros(count, bool)
    if not against.any():
        return turned, joints
    piece = _face_pieces(joints, count)
    low, high = np.sort(joints // 3, axis=1).T
    key, first = np.unique(low * count + high, return_index=True)
    # A root above one face of every piece lets one search walk through all of them.
    _, top = np.unique(piece, return_index=True)
    rows = np.concatenate([low[first], np.full(len(top), count)])
    columns = np.concatenate([high[first], top])
    graph = csr_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(count + 1, count + 1))
    _, before = breadth_first_order(graph, count, directed=False)
    before = np.where(before < 0, count, before).astype(np.int64)
    here = np.arange(count)
    inner = np.flatnonzero(before[:count] != count)
    at = np.searchsorted(key, np.minimum(here, before[:count])[inner] * count + np.maximum(here, before[:count])[inner])
    turns = np.zeros(count + 1, bool)
    turns[inner] = against[first[at]]
    # Every face adds what is gathered above it, and looks twice as far up each time.
    while (before != count).any():
        turns ^= turns[before]
        before = before[before]
    turned = turns[:count]
    share = np.bincount(piece, turned) * 2 > np.bincount(piece)
    turned ^= share[piece]
    wrong = turned[joints[:, 0] // 3] ^ turned[joints[:, 1] // 3] ^ against
    if turned.any():
        notes.append(f"{_plural(int(turned.sum()), 'face')} turned to the winding of most of their piece")
    if wrong.any():
        notes.append(f"one-sided surface cut open along {_plural(int(wrong.sum()), 'edge')}")
    return turned, joints[~wrong]


def _fans(faces: Array, place: Array, joints: Array) -> tuple[int, Array]:
    """Return how many fans of faces hang together by joints at a vertex, and the fan (3F,) of every corner.

    Where a fan comes back to an edge, so that by fans alone faces would join that no joint joins, it is cut further.
    """
    count = 3 * len(faces)
    edges = directed_edges(faces)
    ahead = following(np.arange(count))
    while True:
        a, b = joints.T
        against = place[edges[a, 0]] == place[edges[b, 0]]
        rows = np.concatenate([a, ahead[a]])
        columns = np.concatenate([np.where(against, b, ahead[b]), np.where(against, ahead[b], b)])
        graph = coo_array((np.ones(len(rows), bool), (rows, columns)), shape=(count, count))
        number, fan = connected_components(graph, directed=False)
        fan = fan.astype(np.int64)
        order, start, size = _groups(_undirected(np.stack([fan, fan[ahead]], axis=1), number))
        joined = np.full(count, -1)
        joined[a], joined[b] = b, a
        two = start[size == 2]
        loose = order[two[joined[order[two]] != order[two + 1]] + 1].tolist()
        for at, several in zip(start[size > 2], size[size > 2], strict=True):
            group = order[at : at + several].tolist()
            loose += [e for e in group if e not in (group[0], joined[group[0]])]
        if not loose:
            return int(number), fan
        # The edge and the one before it are cut: the corner between them is then a fan by itself.
        cut = np.zeros(count, bool)
        cut[loose] = True
        cut[ahead[ahead[loose]]] = True
        joints = joints[~(cut[a] | cut[b])]


def _number_fans(number: int, fan: Array, faces: Array, finite: Array, notes: list[str]) -> tuple[Array, Array]:
    """Return the given vertex that every mended one is, and the mended vertex (F, 3) at every corner."""
    at = faces.reshape(-1)
    # Fans are numbered by their first corners, and that corner's vertex is the fan's.
    owner = np.empty(number, np.int64)
    owner[fan[::-1]] = at[::-1]
    owners, first = np.unique(owner, return_index=True)
    doubled = np.ones(number, bool)
    doubled[first] = False
    kept = finite.copy()
    kept[at] = False
    merged = int((finite & ~kept).sum()) - len(owners)
    kept[owners] = True
    numbers = (np.cumsum(kept) - 1)[owner]
    numbers[doubled] = int(kept.sum()) + np.arange(int(doubled.sum()))
    if merged:
        notes.append(f"{_plural(merged, 'vertex', 'vertices')} merged with an equal one")
    if doubled.any():
        notes.append(f"{_plural(int(doubled.sum()), 'vertex', 'vertices')} doubled where faces touch without joining")
    return np.concatenate([np.flatnonzero(kept), owner[doubled]]), numbers[fan].reshape(-1, 3)


def _take_up_flat(vertices: Array, corner: Array, faces: Array, notes: list[str]) -> tuple[Array, Array]:
    """Return corners and faces without triangles whose corners lie in one line.

    The longest edge of such a triangle is exchanged for the other diagonal of the two faces beside it; one without a neighbour
    there is left out.
    """
    taken = 0
    while True:
        flat = np.flatnonzero(_is_flat(vertices, faces))
        if len(flat) == 0:
            break
        opposite = opposite_edges(faces, len(vertices))
        existing = np.sort(_undirected(directed_edges(faces), len(vertices)))
        added: set[int] = set()
        touched: set[int] = set()
        dropped = []
        for f in flat.tolist():
            points = vertices[faces[f]]
            k = int(np.argmax(np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)))
            beyond = int(opposite[3 * f + k])
            g, j = divmod(beyond, 3)
            if f in touched or (beyond >= 0 and g in touched):
                continue
            if beyond < 0:
                dropped.append(f)
                touched.add(f)
                continue
            (p, q, m), w = np.roll(faces[f], -k), faces[g, (j + 2) % 3]
            halves = np.array([[m, p, w], [m, w, q]])
            diagonal = int(_undirected(np.array([[m, w]], np.int64), len(vertices))[0])
            at = int(np.searchsorted(existing, diagonal))
            known = diagonal in added or (at < len(existing) and existing[at] == diagonal)
            if known or _is_flat(vertices, halves).any():
                continue
            ours, theirs = np.roll(corner[f], -k), np.roll(corner[g], -j)
            corner[f], corner[g] = [ours[2], ours[0], theirs[2]], [ours[2], theirs[2], ours[1]]
            faces[f], faces[g] = halves
            added.add(diagonal)
            touched |= {f, g}
        if not touched:
            break
        taken += len(touched & set(flat.tolist()))
        corner, faces = np.delete(corner, dropped, axis=0), np.delete(faces, dropped, axis=0)
    if taken:
        notes.append(f"{_plural(taken, 'flat triangle')} taken up by a neighbour")
    return corner, faces


def _is_flat(vertices: Array, faces: Array) -> Array:
    """Tell which triangles (F,) have no area beside the square of their longest side."""
    corners = vertices[faces]
    sides = corners - np.roll(corners, 1, axis=1)
    longest = np.einsum("fij,fij->fi", sides, sides).max(axis=1, initial=0)
    # Scaled beforehand, so that no product of tiny or huge coordinates leaves the range of floats.
    sides = sides / np.sqrt(np.maximum(longest, 1e-300))[:, None, None]
    return np.asarray(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) <= _FLAT)
