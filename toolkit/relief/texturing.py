"""The texture of what was filled: texels from where its relief is from, on charts of its own; the scan's texture stays as it is.

Every filled vertex carries the relief of a measured place, turned by an angle. What is to lie beside the vertex lies beside that
place in the scan: a texel's offset from the vertex, turned and laid off there, leads to a point of the scan, and that to a texel
of the scan's own picture. The three corners of a triangle lead to three points; where they are of one piece these are the same,
and where pieces meet, the nearest corner's goes over into the others' within a few texels. Tones are levelled: pieces agree where
they meet, and at the rim with the scan.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.errors import InputError, IntaglioError
from intaglio.files import check_memory, write_samples
from intaglio.kernels.geodesics import nearest_on_mesh
from intaglio.kernels.pull_push import continue_image
from intaglio.kernels.texels import rasterize
from intaglio.kernels.transfer import decode_srgb, encode_srgb
from intaglio.mesh import Surface, directed_edges, edge_keys, samples_of, unique_edges
from intaglio.parameterization import atlas_at_density
from intaglio.sparse import solve_symmetric

# How sharply the nearest corner's colours prevail: weights are this power of the barycentric ones.
_SHARPNESS = 4
# Weights below this share are left out: they are no step of eight bits.
_FAINT = 1e-3
# Texels around charts that go on as their triangles do; beyond them the picture only has to be smooth.
_MARGIN = 3
# Points on an edge of the rim at which the tones of both sides are compared, and how often the differences are averaged along it.
_POINTS, _AVERAGED = 8, 2
# Points of a triangle at which the tones that its corners' places give are compared, as barycentric weights.
_SAMPLES = np.array([(a, b, 6 - a - b) for a in range(1, 5) for b in range(1, 6 - a)]) / 6.0
# Over so many edges a piece's own tone comes back.
_REACH = 10.0
# The filling's picture has no more rows or columns than the scan's own, or than this; a texel takes so many bytes on the way.
_LEAST_SIDE, _BYTES = 2048, 60
# So many texels are computed at once.
_CHUNK = 1 << 20


def texture_filling(scan: Surface, whole: Surface, kept: Array, u: Array, v: Array, *, device: str = "cpu") -> Surface:
    """Return a completed scan with the scan's texture as it was, and a texture of its own on what was filled.

    Parameters
    ----------
    scan : Surface
        As it was given.
    whole : Surface
        Completed: the kept vertices and faces of the scan come first, in their order; ``source`` and ``rotation`` say which
        relief was taken.
    kept : (V,) bool array
        Which of the scan's vertices are in it.
    u, v : (N, 3) arrays
        The tangent frames over its base that ``rotation`` refers to.
    device : str

    Returns
    -------
    Surface
        With ``measured_face``, and for a scan with a texture ``uv``, ``face_picture`` and one picture more; the notes say how
        large it is, or why there is none.
    """
    own = kept[scan.faces].all(axis=1)
    count, filled = int(own.sum()), len(whole.faces) - int(own.sum())
    whole = replace(whole, measured_face=np.arange(count + filled) < count)
    if scan.uv is None:
        return whole
    uv = np.concatenate([scan.uv[own], np.full((filled, 3, 2), np.nan)])
    shown = None
    if scan.pictures:
        numbers = np.zeros(count, np.int32) if scan.face_picture is None else scan.face_picture[own]
        shown = np.concatenate([np.where(np.isfinite(scan.uv[own]).all(axis=(1, 2)), numbers, -1), np.full(filled, -1)])
    whole = replace(whole, uv=uv, picture=scan.picture, more_pictures=scan.more_pictures, face_picture=shown)
    if shown is None or filled == 0 or not (shown >= 0).any():
        return whole
    try:
        images = [samples_of(picture) for picture in scan.pictures]
        return _Filling(whole, _Textured(whole, shown, images), _owners(whole, u, v), device).textured()
    except IntaglioError as error:
        return replace(whole, notes=(*whole.notes, f"the filling has no texture: {error}"))


@dataclass(frozen=True)
class _Owners:
    """The filled vertex whose place in the exemplar a vertex of the filling goes by, and where that is.

    Attributes
    ----------
    origin, u, v : (N, 3) arrays
        That vertex on its base, and the tangent vectors there.
    source_at, source_u, source_v : (N, 3) arrays
        The same at its source, mirrored and turned as that is.
    """

    origin: Array
    u: Array
    v: Array
    source_at: Array
    source_u: Array
    source_v: Array

    def laid_off(self, corner: Array, at: Array) -> Array:
        """Return where points (K, 3) of the base lie at the sources of vertices (K,)."""
        offset = at - self.origin[corner]
        x = np.einsum("ij,ij->i", offset, self.u[corner])
        y = np.einsum("ij,ij->i", offset, self.v[corner])
        return np.asarray(self.source_at[corner] + x[:, None] * self.source_u[corner] + y[:, None] * self.source_v[corner])


def _owners(whole: Surface, u: Array, v: Array) -> _Owners:
    """Return whose place each vertex goes by: filled ones by their own, those of the rim by a filled neighbour's.

    Where triangles alone closed a gap there is none: a vertex of the rim then goes by its own place, turned by half a circle, so
    that the scan is continued by its mirror image.
    """
    count = len(whole.vertices)
    faces = whole.faces[~_scans(whole)]
    owner = np.where(whole.measured | (whole.source < 0), -1, np.arange(count))
    edges = unique_edges(faces)
    edges = np.concatenate([edges, edges[:, ::-1]])
    length = np.linalg.norm(whole.base[edges[:, 0]] - whole.base[edges[:, 1]], axis=1)
    edges = edges[np.argsort(length, kind="stable")]
    while True:
        ready = edges[(owner[edges[:, 0]] < 0) & (owner[edges[:, 1]] >= 0)]
        if len(ready) == 0:
            break
        # Of several neighbours the nearest, which the last of the reversed writes is.
        owner[ready[::-1, 0]] = owner[ready[::-1, 1]]
    alone = owner < 0
    owner[alone] = np.flatnonzero(alone)
    source = np.where(alone, owner, whole.source[owner])
    turn = np.zeros(count) if whole.rotation is None else whole.rotation[owner].astype(np.float64)
    turn[alone] = np.pi
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    # An offset (x, y) is (cos x - sin y, sin x + cos y) at the source; mirrored ones have -y for y.
    source_u = cos * u[source] + sin * v[source]
    source_v = cos * v[source] - sin * u[source]
    if whole.mirrored is not None:
        source_v[whole.mirrored[owner]] *= -1
    return _Owners(whole.base[owner], u[owner], v[owner], whole.base[source], source_u, source_v)


def _scans(whole: Surface) -> Array:
    """Return which faces (F,) are the scan's own."""
    assert whole.measured_face is not None
    return whole.measured_face


class _Textured:
    """The scan's faces that have a place in one of its pictures, and the pictures' colours.

    Parameters
    ----------
    whole : Surface
    shown : (F,) int array
        The number of each face's picture, -1 for none.
    images : list of (H, W, C) arrays
        The pictures' samples.
    """

    def __init__(self, whole: Surface, shown: Array, images: list[Array]) -> None:
        assert whole.uv is not None
        face = np.flatnonzero(shown >= 0)
        self.faces, self.uv, self.shown = whole.faces[face], whole.uv[face], shown[face]
        self.images = images
        self.base = whole.base
        self.near = np.arange(len(face))

    def density(self) -> float:
        """Return the median of the faces' texels per length on the base."""
        size = np.array([image.shape[1::-1] for image in self.images], np.float64)[self.shown]
        a, b = (self.uv[:, k] * size - self.uv[:, 0] * size for k in (1, 2))
        area = self._areas()
        texels = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        sound = (area > 0) & (texels > 0)
        if not sound.any():
            raise InputError("the scan's faces have no area in its picture")
        return float(np.sqrt(np.median(texels[sound] / area[sound])))

    def _areas(self) -> Array:
        """Return twice the faces' areas on the base."""
        p, q = (self.base[self.faces[:, k]] - self.base[self.faces[:, 0]] for k in (1, 2))
        return np.asarray(np.linalg.norm(np.cross(p, q), axis=1))

    def look_only_around(self, places: Array, reach: float) -> None:
        """Take nearest points only of faces with a corner within ``reach`` of one of the places (M, 3)."""
        vertex, corner = np.unique(self.faces, return_inverse=True)
        far, _ = cKDTree(places).query(self.base[vertex], distance_upper_bound=reach)
        near = np.isfinite(far)[corner.reshape(-1, 3)].any(axis=1)
        # Of a triangle that the base made a line no place can be told.
        self.near = np.flatnonzero(near & (self._areas() > 0))
        if len(self.near) == 0:
            raise InputError("what was filled is from parts of the scan that have no place in its picture")

    def nearest(self, at: Array, device: str) -> Array:
        """Return the linear colours (K, 3) of the points of the scan that are nearest to points (K, 3) over its base."""
        vertex, faces = np.unique(self.faces[self.near], return_inverse=True)
        face, weight = nearest_on_mesh(at, self.base[vertex], faces.reshape(-1, 3), device)
        face = self.near[face]
        return self.colors(self.shown[face], np.einsum("kc,kcd->kd", weight, self.uv[face]))

    def colors(self, number: Array, uv: Array) -> Array:
        """Return the linear colours (K, 3) at places (K, 2) of the pictures of these numbers."""
        out = np.zeros((len(uv), 3), np.float32)
        for k, image in enumerate(self.images):
            own = number == k
            out[own] = _bilinear(image, uv[own])
        return out


def _bilinear(image: Array, uv: Array) -> Array:
    """Return bilinear samples (K, 3), in linear light, of a picture that repeats where places (K, 2) lie beyond it."""
    height, width = image.shape[:2]
    uv = np.where((uv < 0) | (uv > 1), uv - np.floor(uv), uv)
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    across, down = (x - column).astype(np.float32)[:, None], (y - row).astype(np.float32)[:, None]
    left, right = (np.clip(column + k, 0, width - 1) for k in (0, 1))
    above, below = (np.clip(row + k, 0, height - 1) for k in (0, 1))
    upper = (1 - across) * _linear(image[above, left]) + across * _linear(image[above, right])
    lower = (1 - across) * _linear(image[below, left]) + across * _linear(image[below, right])
    return np.asarray((1 - down) * upper + down * lower)


def _linear(texel: Array) -> Array:
    """Return stored texels (K, C) as linear colours (K, 3)."""
    texel = np.repeat(texel[:, :1], 3, axis=1) if texel.shape[1] < 3 else texel[:, :3]
    if texel.dtype.kind == "f":
        return np.asarray(texel, np.float32)
    return decode_srgb(texel.astype(np.float32) / np.float32(np.iinfo(texel.dtype).max))


class _Filling:
    """What was filled, and the colours of its points."""

    def __init__(self, whole: Surface, scan: _Textured, owners: _Owners, device: str) -> None:
        self.whole, self.scan, self.owners, self.device = whole, scan, owners, device
        self.face = np.flatnonzero(~_scans(whole))
        self.faces = whole.faces[self.face]
        self.rim = np.zeros(len(whole.vertices), bool)
        self.rim[np.intersect1d(self.faces, scan.faces)] = True
        self.beyond, self.beyond_corner = self._across_the_rim()
        spans = whole.base[self.faces][:, :, None] - owners.origin[self.faces][:, None]
        reach = float(np.linalg.norm(spans, axis=3).max())
        scan.look_only_around(np.unique(owners.source_at[self.faces.reshape(-1)], axis=0), 2 * reach)
        self.level = np.zeros((len(whole.vertices), 3))
        self.level = self._levels()
        self.at_vertex = self._differences_at_vertices()

    def textured(self) -> Surface:
        """Return the whole with charts for what was filled and their picture."""
        wanted = self.scan.density()
        points = self.whole.base
        most = max(_LEAST_SIDE, *(max(image.shape[:2]) for image in self.scan.images))
        uv, corners, _, (height, width) = atlas_at_density(points, self.faces, wanted, most=most)
        check_memory("its picture", _BYTES * height * width, "its texels")
        levels, reached = self._picture(uv, corners, height, width)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "filling.png")
            write_samples(levels, path)
            content = path.read_bytes()
        whole = self.whole
        assert whole.uv is not None
        assert whole.face_picture is not None
        places, shown = whole.uv.copy(), whole.face_picture.copy()
        places[self.face] = uv[corners]
        shown[self.face] = len(whole.pictures)
        note = f"the filling's texture: {width} x {height}, {reached:.4g} texels per unit of length"
        note += " as the scan's" if reached > 0.99 * wanted else f" where the scan has {wanted:.4g}"
        return replace(
            whole, uv=places, face_picture=shown, more_pictures=(*whole.more_pictures, content), notes=(*whole.notes, note)
        )

    def _picture(self, uv: Array, corners: Array, height: int, width: int) -> tuple[Array, float]:
        """Return the picture (H, W, 3) of 8 bits, and its texels per length."""
        face, _ = rasterize(uv, corners, height, width, "cpu")
        far, (row, column) = distance_transform_edt(face < 0, return_indices=True)
        texel = np.flatnonzero(far <= _MARGIN)
        own = face[row.reshape(-1)[texel], column.reshape(-1)[texel]]
        place = np.stack([(texel % width + 0.5) / width, 1 - (texel // width + 0.5) / height], axis=1)
        corner = uv[corners]
        # In the margin weights may be negative: the triangle goes on.
        weight = _barycentric(place, corner[own])
        color = np.zeros((height * width, 3), np.float32)
        for first in range(0, len(texel), _CHUNK):
            part = slice(first, first + _CHUNK)
            color[texel[part]] = self.shown_colors(own[part], weight[part])
        inside = np.zeros(height * width, bool)
        inside[texel] = True
        color = continue_image(color.reshape(height, width, 3), inside.reshape(height, width), "cpu")
        size = np.array([width, height])
        a, b = ((corner[:, k] - corner[:, 0]) * size for k in (1, 2))
        p, q = (self.whole.base[self.faces[:, k]] - self.whole.base[self.faces[:, 0]] for k in (1, 2))
        texels = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
        area = np.linalg.norm(np.cross(p, q), axis=1).sum()
        return np.round(color * 255).astype(np.uint8), float(np.sqrt(texels / max(area, 1e-300)))

    def shown_colors(self, own: Array, weight: Array) -> Array:
        """Return the colours (K, 3), as shown from 0 to 1, of points of filled faces (K,) with barycentric weights (K, 3)."""
        shown = self.taken(own, weight)
        on_rim = np.maximum(weight, 0) * self.rim[self.faces[own]]
        share = on_rim.sum(axis=1) / np.maximum(weight, 0).sum(axis=1)
        near = np.flatnonzero(share > 0.5)
        part = on_rim[near] / on_rim[near].sum(axis=1, keepdims=True)
        # Towards the rim what is left of the difference is taken up as well, so that both sides meet exactly.
        fade = (share[near] - 0.5) * 2
        fade = fade * fade * (3 - 2 * fade)
        shown[near] += fade[:, None] * self._difference(own[near], part)
        return np.asarray(np.clip(shown, 0, 1))

    def taken(self, own: Array, weight: Array) -> Array:
        """Return the shown colours (K, 3) that points take from the scan as their corners' places lead there, levelled."""
        sharp = np.maximum(weight, 0) ** _SHARPNESS
        sharp /= sharp.sum(axis=1, keepdims=True)
        sharp[sharp < _FAINT] = 0
        sharp /= sharp.sum(axis=1, keepdims=True)
        point, k = np.nonzero(sharp)
        color = self._of_corner(own[point], k, weight[point]) + self.level[self.faces[own[point], k]]
        color = decode_srgb(np.clip(color, 0, 1)) * sharp[point, k][:, None]
        mixed = [np.bincount(point, color[:, channel], len(own)) for channel in range(3)]
        return encode_srgb(np.stack(mixed, axis=1))

    def _of_corner(self, own: Array, k: Array, weight: Array) -> Array:
        """Return the shown colours (K, 3) where the places of the faces' corners ``k`` lead points with weights (K, 3)."""
        at = np.einsum("kc,kcd->kd", weight, self.whole.base[self.faces[own]])
        return encode_srgb(self.scan.nearest(self.owners.laid_off(self.faces[own, k], at), self.device))

    def _across_the_rim(self) -> tuple[Array, Array]:
        """Return for edges k -> k + 1 of the filled faces (M, 3) the textured face across, -1 for none, and its edge there."""
        count = len(self.whole.vertices)
        theirs = edge_keys(directed_edges(self.scan.faces), count)
        mine = edge_keys(directed_edges(self.faces)[:, ::-1], count)
        order = np.argsort(theirs, kind="stable")
        edge = order[np.minimum(np.searchsorted(theirs, mine, sorter=order), len(theirs) - 1)]
        face = np.where(theirs[edge] == mine, edge // 3, -1)
        return face.reshape(-1, 3), (edge % 3).reshape(-1, 3)

    def _beyond(self, face: Array, k: Array, share: Array) -> Array:
        """Return the scan's shown colours (K, 3) on edges ``k`` of filled faces, at ``share`` of the way along."""
        other, edge = self.beyond[face, k], self.beyond_corner[face, k]
        # The scan's face runs along the edge the other way.
        first, last = self.scan.uv[other, (edge + 1) % 3], self.scan.uv[other, edge]
        return encode_srgb(self.scan.colors(self.scan.shown[other], first + share[:, None] * (last - first)))

    def _differences_at_vertices(self) -> Array:
        """Return by how much the scan's shown colours (N, 3) differ from those taken at the rim's vertices; 0 at others."""
        out = np.zeros((len(self.whole.vertices), 3), np.float32)
        if not self.rim.any():
            return out
        own, k = np.nonzero(self.rim[self.faces])
        vertex, first = np.unique(self.faces[own, k], return_index=True)
        own, k = own[first], k[first]
        scan_face, scan_k = np.nonzero(self.rim[self.scan.faces])
        place = np.zeros((len(out), 2))
        number = np.full(len(out), -1)
        corner = self.scan.faces[scan_face, scan_k]
        place[corner[::-1]], number[corner[::-1]] = self.scan.uv[scan_face, scan_k][::-1], self.scan.shown[scan_face][::-1]
        measured = encode_srgb(self.scan.colors(number[vertex], place[vertex]))
        out[vertex] = measured - self.taken(own, np.eye(3)[k])
        return out

    def _difference(self, own: Array, weight: Array) -> Array:
        """Return the differences (K, 3) at the rim's points: exact on its edges, interpolated between its vertices elsewhere."""
        out = np.einsum("kc,kcd->kd", weight, self.at_vertex[self.faces[own]])
        for k in range(3):
            on = np.flatnonzero((self.beyond[own, k] >= 0) & (weight[:, (k + 2) % 3] == 0) & (weight[:, k] < 1))
            on = on[weight[on, (k + 1) % 3] < 1]
            share = weight[on, (k + 1) % 3]
            out[on] = self._beyond(own[on], np.full(len(on), k), share) - self.taken(own[on], weight[on])
        return np.asarray(out)

    def _levels(self) -> Array:
        """Return by how much the tone of each vertex's place is shifted (N, 3): at the rim by the mean difference about it."""
        count = len(self.whole.vertices)
        face, k = np.nonzero(self.beyond >= 0)
        total, weight = np.zeros((count, 3)), np.zeros(count)
        if len(face) == 0:
            return total
        share = (np.arange(_POINTS) + 0.5) / _POINTS
        own, edge, along = np.repeat(face, _POINTS), np.repeat(k, _POINTS), np.tile(share, len(face))
        at = np.zeros((len(own), 3))
        row = np.arange(len(own))
        at[row, edge], at[row, (edge + 1) % 3] = 1 - along, along
        found = self._beyond(own, edge, along) - self.taken(own, at)
        ends = np.stack([self.faces[face, k], self.faces[face, (k + 1) % 3]], axis=1)
        for end, part in ((0, 1 - along), (1, along)):
            vertex = np.repeat(ends[:, end], _POINTS)
            weight += np.bincount(vertex, part, count)
            for channel in range(3):
                total[:, channel] += np.bincount(vertex, part * found[:, channel], count)
        level = total / np.maximum(weight, 1e-300)[:, None]
        known = weight > 0
        graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
        graph = csr_array(graph + graph.T)
        degree = np.asarray(graph.sum(axis=1)).reshape(-1)
        for _ in range(_AVERAGED):
            level = np.where(known[:, None], (level + graph @ level) / (1 + degree)[:, None], level)
        return self._joined(level, known)

    def _joined(self, level: Array, known: Array) -> Array:
        """Return the tones' shifts (N, 3): as they are where known, elsewhere such that neighbours' pieces agree in tone.

        The shifts minimise the sum over edges of (shift_i - shift_j + difference_ij)^2, where the difference is that of the
        colours which the two vertices' places give to what lies about their edge: 0 within a piece. Weakly, over some edges, the
        shifts are held to the harmonic ones, so that a piece of another colour is not changed as a whole.
        """
        inner = np.setdiff1d(np.unique(self.faces), np.flatnonzero(known))
        if len(inner) == 0:
            return level
        count = len(level)
        edges = unique_edges(self.faces)
        graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(count, count))
        graph = csr_array(graph + graph.T)
        degree = np.asarray(graph.sum(axis=1)).reshape(-1)[inner]
        within = graph[inner][:, inner]
        held = graph[inner] @ np.where(known[:, None], level, 0)
        start = np.zeros((len(inner), 3))
        # A part that nothing known borders on stays as it is.
        harmonic = solve_symmetric(csr_array(diags_array(degree + 1e-9) - within), held, start)
        # On a triangular lattice the graph's Laplacian is 3/2 of the continuous one.
        weak = 1.5 / _REACH**2
        right = held - self._disagreement(edges)[inner] + weak * harmonic
        level = level.copy()
        level[inner] = solve_symmetric(csr_array(diags_array(degree + weak) - within), right, harmonic)
        return level

    def _disagreement(self, edges: Array) -> Array:
        """Return for vertices (N, 3) the sum over edges of the mean differences of tone: their own place's from the other's."""
        count = len(self.whole.vertices)
        total, amount = np.zeros((len(edges), 3)), np.zeros(len(edges))
        keys = edge_keys(edges, count)
        points = len(_SAMPLES)
        step = max(_CHUNK // (3 * points), 1)
        for first in range(0, len(self.faces), step):
            own = np.repeat(np.arange(first, min(first + step, len(self.faces))), points)
            weight = np.tile(_SAMPLES, (len(own) // points, 1))
            colors = [self._of_corner(own, np.full(len(own), k), weight) for k in range(3)]
            for k in range(3):
                after = (k + 1) % 3
                pair = self.faces[own][:, [k, after]]
                edge = np.searchsorted(keys, edge_keys(np.sort(pair, axis=1), count))
                share = weight[:, k] * weight[:, after]
                away = (colors[k] - colors[after]) * np.where(pair[:, 0] < pair[:, 1], share, -share)[:, None]
                amount += np.bincount(edge, share, len(edges))
                for channel in range(3):
                    total[:, channel] += np.bincount(edge, away[:, channel], len(edges))
        mean = total / amount[:, None]
        out = np.zeros((count, 3))
        for channel in range(3):
            out[:, channel] = np.bincount(edges[:, 0], mean[:, channel], count) - np.bincount(
                edges[:, 1], mean[:, channel], count
            )
        return out


def _barycentric(place: Array, corner: Array) -> Array:
    """Return barycentric weights (K, 3) of places (K, 2) in triangles (K, 3, 2); a third each where these have no area."""
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    p = place - corner[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    safe = np.where(area == 0, 1, area)
    second = (p[:, 0] * b[:, 1] - p[:, 1] * b[:, 0]) / safe
    third = (a[:, 0] * p[:, 1] - a[:, 1] * p[:, 0]) / safe
    weight = np.stack([1 - second - third, second, third], axis=1)
    return np.asarray(np.where((area == 0)[:, None], 1 / 3, weight))
