"""Tables of large meshes are those of small ones: kernels against NumPy, and what needs no mending against mending."""

import numpy as np
import pytest
from broken_meshes import DEFECTS

import intaglio
from intaglio.kernels import connectivity
from intaglio.mesh import (
    border_edges,
    edge_lengths,
    edges_pair_up,
    face_areas,
    grid_faces,
    opposite_edges,
    pieces,
    vertex_normals,
)
from intaglio.mesh import mending as mending_module
from intaglio.mesh import surface as surface_module
from intaglio.mesh import topology as topology_module
from intaglio.mesh.mending import mend_faces
from intaglio.relief.ground import holes as holes_module
from intaglio.relief.ground.extent import _order_statistics

SEED = 7
LIMITS = (topology_module, surface_module, mending_module, holes_module)


def both(monkeypatch, work):
    """What some work gives with NumPy, and with kernels."""
    found = []
    for limit in (10**9, -1):
        for module in LIMITS:
            monkeypatch.setattr(module, "LARGE", limit)
        found.append(work())
    return found


def sheet(rows=40):
    y, x = np.mgrid[:rows, : rows + 10].astype(float)
    return np.stack([x, y, np.sin(x) * np.cos(y)], axis=-1).reshape(-1, 3), grid_faces(rows, rows + 10)


def soup():
    """Triangles at random, some of which name a vertex twice."""
    return np.random.default_rng(SEED).integers(0, 60, (900, 3))


def star():
    """Many faces at one edge, so that both of its ends are crowded, and one of which the edge goes the other way."""
    around = np.arange(2, 2 + 2 * connectivity.CROWDED)
    faces = np.stack([np.zeros_like(around), np.ones_like(around), around], axis=1)
    faces[7, :2] = 1, 0
    faces[9, :2] = 1, 0
    return faces


@pytest.mark.parametrize("faces", [sheet()[1], soup(), star(), np.zeros((0, 3), int)], ids=["sheet", "soup", "star", "none"])
def test_tables_of_kernels_are_those_of_numpy(monkeypatch, faces):
    count = int(faces.max(initial=0)) + 3
    points = np.random.default_rng(SEED + 1).normal(size=(count, 3)) * 1e3 + np.pi

    def tables():
        number, label = pieces(faces, count)
        opposite = opposite_edges(faces, count)
        measures = face_areas(points, faces), edge_lengths(points, faces), vertex_normals(points, faces)
        return opposite, border_edges(faces), label, number, *measures

    for plain, fast in zip(*both(monkeypatch, tables), strict=True):
        np.testing.assert_array_equal(fast, plain)
    # The first of several, by looking at all of them.
    edges = topology_module.directed_edges(faces)
    slow = [next((k for k, other in enumerate(edges) if (other == edge[::-1]).all()), -1) for edge in edges[:200]]
    np.testing.assert_array_equal(opposite_edges(faces, count)[:200], slow)


def test_edges_pair_up_only_where_none_is_there_twice():
    vertices, faces = sheet(6)
    count = len(vertices)
    assert edges_pair_up(faces, opposite_edges(faces, count), count)
    for twice in (np.concatenate([faces, faces[:1]]), np.concatenate([faces, [[faces[0, 0], faces[0, 1], count - 1]]])):
        assert not edges_pair_up(twice, opposite_edges(twice, count), count)
    # A border edge that two faces have, and none on the other side.
    fin = np.array([[0, 1, 2], [0, 1, 3]])
    assert not edges_pair_up(fin, opposite_edges(fin, 4), 4)


@pytest.mark.parametrize("name", [None, *DEFECTS])
def test_what_needs_no_mending_is_found_out_and_only_that(monkeypatch, name):
    vertices, faces = sheet(20)
    if name is not None:
        vertices, faces = DEFECTS[name](vertices, faces.astype(np.int64), np.random.default_rng(0))[:2]
    faces = np.asarray(faces)
    plain, fast = both(monkeypatch, lambda: mend_faces(vertices, faces))
    for field in ("vertex", "corner", "faces"):
        np.testing.assert_array_equal(getattr(fast, field), getattr(plain, field))
    assert fast.notes == plain.notes
    assert mending_module._nothing_to_mend(vertices, faces) == (plain.notes == ())


def test_places_with_the_same_number_are_told_apart(monkeypatch):
    vertices = sheet()[0]
    assert not mending_module._share_places(vertices)
    monkeypatch.setattr(mending_module, "_mixed_bits", lambda at: (at[:, 0] * 7).astype(np.uint64))
    assert not mending_module._share_places(vertices)
    assert mending_module._share_places(np.concatenate([vertices, vertices[77:78]]))


def bow_tie():
    return np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]), np.array([[0, 1, 2], [0, 3, 4]])


def pillow():
    return np.eye(3), np.array([[0, 1, 2], [0, 2, 1]])


def strip_of_moebius():
    angle = np.linspace(0, 2 * np.pi, 13)[:-1]
    half = 0.3 * np.stack([np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle), np.sin(angle / 2)], axis=1)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(12)], axis=1)
    number = np.arange(24).reshape(2, 12)
    a, b = number
    c, d = np.append(a[1:], b[0]), np.append(b[1:], a[0])
    return np.concatenate([ring + half, ring - half]), np.concatenate([np.stack([a, b, c], 1), np.stack([c, b, d], 1)])


@pytest.mark.parametrize("make", [bow_tie, pillow, strip_of_moebius])
def test_meshes_that_are_no_manifolds_are_not_taken_for_sound(monkeypatch, make):
    vertices, faces = make()
    plain, fast = both(monkeypatch, lambda: mend_faces(vertices, faces))
    assert plain.notes == fast.notes != ()
    np.testing.assert_array_equal(fast.faces, plain.faces)


def test_holes_of_a_large_scan_are_those_of_a_small_one(monkeypatch):
    vertices, faces = sheet()
    gone = np.zeros(len(vertices), bool)
    gone[[815, 816, 1230]] = True
    scan = intaglio.Surface(vertices=vertices, faces=faces).part(~gone)
    plain, fast = both(monkeypatch, lambda: intaglio.list_holes(scan))
    assert len(plain) == len(fast) == 3
    for one, other in zip(plain, fast, strict=True):
        assert one.describe() == other.describe()
        assert one.piece == other.piece
        np.testing.assert_array_equal(one.loop, other.loop)


@pytest.mark.parametrize("count", [1, 2, 3, 20, 21, 22, 1000])
def test_order_statistics_are_numpys(count):
    values = np.random.default_rng(count).random(count)
    expected = float(np.quantile(values, 0.05)), float(np.median(values)), float(values.min())
    assert _order_statistics(values.copy()) == expected
