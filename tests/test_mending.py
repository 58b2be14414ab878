"""Meshes as they come: mended to manifolds without moving a vertex, or refused with `strict`."""

from __future__ import annotations

import numpy as np
import pytest
from broken_meshes import DEFECTS, all_at_once, write_plain
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import intaglio
from intaglio import InputError, Surface, mend_surface
from intaglio.mesh import directed_edges, grid_faces
from intaglio.mesh.mending import equal_places, mend_faces
from intaglio.mesh.polygons import polygon_triangles, strip_triangles


def sheet(rows=12, columns=15):
    y, x = np.mgrid[:rows, :columns].astype(float)
    return np.stack([x, y, np.sin(x) * np.cos(y)], axis=-1).reshape(-1, 3), grid_faces(rows, columns)


def box(shift=(0, 0, 0)):
    import trimesh

    solid = trimesh.creation.box()
    return np.asarray(solid.vertices) + shift, np.asarray(solid.faces)


def joined(*parts):
    """Several meshes as one whose equal vertices are one, as a program writes it that merges them."""
    vertices = np.concatenate([v for v, _ in parts])
    starts = np.cumsum([0, *(len(v) for v, _ in parts)])
    faces = np.concatenate([f + s for (_, f), s in zip(parts, starts, strict=False)])
    places, number = np.unique(vertices, axis=0, return_inverse=True)
    return places, number.reshape(-1)[faces]


def is_manifold(faces):
    """No directed edge belongs to two faces, and about every vertex the faces hang together by edges."""
    edges = directed_edges(np.asarray(faces, np.int64))
    count = int(faces.max()) + 1 if len(faces) else 0
    key, back = edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0]
    if len(np.unique(key)) < len(key):
        return False
    order = np.argsort(key)
    at = np.minimum(np.searchsorted(key[order], back), len(key) - 1)
    opposite = np.where(key[order[at]] == back, order[at], -1)
    ahead = np.arange(len(edges)) // 3 * 3 + (np.arange(len(edges)) + 1) % 3
    a = np.flatnonzero(opposite >= 0)
    graph = coo_array((np.ones(len(a), bool), (a, ahead[opposite[a]])), shape=(len(edges), len(edges)))
    return connected_components(graph, directed=False)[0] == len(np.unique(faces))


def mended(vertices, faces):
    vertices, faces = np.asarray(vertices, float), np.asarray(faces)
    found = mend_faces(vertices, faces)
    assert is_manifold(found.faces)
    # Every corner lies where it lay, bit for bit.
    at = vertices[faces.reshape(-1)][found.corner]
    assert at.tobytes() == (vertices[found.vertex] + 0.0)[found.faces].tobytes() or np.array_equal(
        at, vertices[found.vertex][found.faces]
    )
    return found


def borders(faces):
    return len(intaglio.mesh.border_edges(faces))


def test_a_sound_mesh_stays_as_it_is():
    vertices, faces = sheet()
    surface = Surface(vertices=vertices, faces=faces)
    assert mend_surface(surface) is surface
    assert mend_surface(surface, strict=True) is surface


def test_triangles_that_share_no_vertex_are_joined():
    vertices, faces = sheet()
    found = mended(vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3))
    assert len(found.vertex) == len(vertices)
    assert borders(found.faces) == borders(faces)


def test_faces_wound_at_random_get_one_winding_a_piece():
    vertices, faces = sheet()
    turned = np.random.default_rng(0).random(len(faces)) < 0.3
    wound = np.where(turned[:, None], faces[:, ::-1], faces)
    found = mended(np.concatenate([vertices, vertices + 100]), np.concatenate([wound, faces + len(vertices)]))
    np.testing.assert_array_equal(found.faces, np.concatenate([faces, faces + len(vertices)]))
    assert found.notes == (f"{turned.sum()} faces turned to the winding of most of their piece",)


def test_a_fin_is_cut_off_and_the_sheet_stays_whole():
    vertices, faces = sheet()
    a, b = faces[40][:2]
    found = mended(np.concatenate([vertices, [vertices[[a, b]].mean(axis=0) + (0, 0, 1)]]), [*faces, [a, b, len(vertices)]])
    np.testing.assert_array_equal(found.faces[:-1], faces)
    assert borders(found.faces) == borders(faces) + 3
    assert list(found.vertex[-2:]) == [a, b]


@pytest.mark.parametrize("shift", [(1, 1, 0), (1, 1, 1)])
def test_solids_that_touch_in_an_edge_or_a_vertex_are_two(shift):
    found = mended(*joined(box(), box(shift)))
    assert borders(found.faces) == 0
    assert intaglio.mesh.pieces(found.faces, len(found.vertex))[0] == 2
    assert len(found.vertex) == 16


def test_what_another_program_cut_apart_is_not_merged_back():
    vertices, faces = joined(box(), box((1, 1, 0)))
    once = mended(vertices, faces)
    again = mended(vertices[once.vertex], once.faces)
    np.testing.assert_array_equal(again.faces, once.faces)
    assert again.notes == ()


def test_a_one_sided_band_is_cut_open():
    n = 40
    t = np.arange(n) * 2 * np.pi / n
    rim = [
        np.stack([(3 + s * np.cos(t / 2)) * np.cos(t), (3 + s * np.cos(t / 2)) * np.sin(t), s * np.sin(t / 2)], 1)
        for s in (-1, 1)
    ]
    a, b = np.arange(n), n + np.arange(n)
    c, d = np.append(a[1:], b[0]), np.append(b[1:], a[0])
    faces = np.concatenate([np.stack([a, c, d], 1), np.stack([a, d, b], 1)])
    found = mended(np.concatenate(rim), faces)
    assert "one-sided surface cut open along 1 edge" in found.notes
    assert len(found.faces) == len(faces)
    assert borders(found.faces) == borders(found.faces[:0]) + 2 * n + 2


def test_faces_without_area_and_repeated_ones_are_left_out():
    vertices, faces = sheet()
    bad = np.concatenate([faces, faces[[3, 3, 7]][:, [1, 2, 0]], [[5, 5, 6]], [[5, 6, 5]]])
    found = mended(vertices, bad)
    np.testing.assert_array_equal(found.faces, faces)
    assert found.notes == ("2 degenerate faces left out", "3 repeated faces left out")


def test_a_flat_triangle_is_taken_up_by_its_neighbour():
    points = [[0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 1, 0], [1, -1, 0]]
    found = mended(points, [[0, 1, 2], [1, 0, 4], [0, 2, 3], [2, 1, 3]])
    corners = np.array(points, float)[found.vertex][found.faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    np.testing.assert_array_equal(areas, [0.5, 0.5, 0.5, 0.5])
    assert borders(found.faces) == 4


def test_vertices_that_are_not_finite_are_left_out_with_their_faces():
    vertices, faces = sheet()
    vertices[50] = np.nan
    found = mended(vertices, faces)
    assert len(found.vertex) == len(vertices) - 1
    assert "1 vertex that is not finite left out with 6 faces" in found.notes


def test_any_triangles_become_a_manifold():
    random = np.random.default_rng(1)
    for _ in range(500):
        count = random.integers(3, 9)
        mended(random.integers(0, 3, (count, 3)).astype(float), random.integers(0, count, (random.integers(1, 30), 3)))


def test_equal_places_are_those_of_a_comparison():
    random = np.random.default_rng(2)
    vertices = random.integers(-2, 3, (400, 3)) * 0.5
    vertices[vertices == 0] *= random.choice([-1.0, 1.0], int((vertices == 0).sum()))
    first = [next(j for j in range(i + 1) if (vertices[j] == vertices[i]).all()) for i in range(len(vertices))]
    np.testing.assert_array_equal(equal_places(vertices), first)


def test_all_that_belongs_to_vertices_and_corners_goes_along():
    vertices, faces = joined(box(), box((1, 1, 1)))
    uv = np.random.default_rng(0).random((len(faces), 3, 2))
    color = np.random.default_rng(1).random((len(vertices), 3))
    surface = Surface(vertices=vertices, faces=faces, color=color, uv=uv)
    whole = mend_surface(surface)
    np.testing.assert_array_equal(whole.color, surface.color[whole.file_vertex])
    np.testing.assert_array_equal(whole.vertices, vertices[whole.file_vertex])
    np.testing.assert_array_equal(whole.uv, uv)
    np.testing.assert_array_equal(whole.source, np.arange(len(whole.vertices)))
    with pytest.raises(InputError, match="1 vertex doubled"):
        mend_surface(surface, strict=True)
    with pytest.raises(InputError, match="surface must be a Surface"):
        mend_surface((vertices, faces))


@pytest.mark.parametrize(
    "polygon",
    [
        [[0, 0], [2, 0], [2, 2], [0, 2]],
        [[0, 0], [1, 0.2], [2, 0], [1, 2]],
        [[0, 0], [2, 0], [0.5, 0.5], [0, 2]],
        [[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]],
    ],
)
def test_polygons_are_cut_inside(polygon):
    flat = np.array(polygon, float)
    x, y = flat.T
    area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    for plane in ([0, 1, 2], [1, 2, 0], [2, 0, 1]):
        points = np.pad(flat, ((0, 0), (0, 1)))[:, plane]
        corners = polygon_triangles(np.array([len(flat)]), np.arange(len(flat)), points)
        triangles = points[corners]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])[:, plane.index(2)] / 2
        assert (normals > 0).all()
        assert normals.sum() == pytest.approx(area)


def test_strips_alternate_their_winding():
    strip = np.array([0, 1, 2, 3, -1, 4, 5, 6, -1, 7, 8, -1, 9, 10, 11, 11, 12])
    expected = [[0, 1, 2], [2, 1, 3], [4, 5, 6], [9, 10, 11]]
    np.testing.assert_array_equal(strip_triangles(strip), expected)


@pytest.fixture(scope="module")
def open_ball():
    """A sound mesh of one piece with one border and a hole."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=4)
    center = ball.triangles_center
    keep = (center[:, 2] < 0.9) & (np.linalg.norm(center - (1, 0, 0), axis=1) > 0.2)
    part = ball.submesh([np.flatnonzero(keep)], append=True)
    return np.asarray(part.vertices), np.asarray(part.faces)


@pytest.mark.parametrize("defect", [*DEFECTS, "all_at_once"])
def test_every_defect_is_mended_for_every_system(open_ball, defect, tmp_path, run):
    make = DEFECTS.get(defect, all_at_once)
    vertices, faces = make(*open_ball, np.random.default_rng(0))
    write_plain(tmp_path / "a.ply", vertices, faces)
    surface = intaglio.read_surface(tmp_path / "a.ply")
    assert is_manifold(surface.faces)
    assert intaglio.list_holes(surface)
    flat = intaglio.parameterize(surface, "mean-value", device="cpu")
    assert len(flat.faces) == len(surface.faces)
    status, out, errors = run("complete", tmp_path / "a.ply", "--holes", "list")
    assert (status, "outer border 1" in out or "hole 1" in out) == (0, True), errors
    untouched = defect in ("in_pieces", "with_unused_vertices")
    status, _, errors = run("complete", tmp_path / "a.ply", "--holes", "list", "--strict")
    assert status == (0 if untouched else 2)
    assert untouched or errors.count("\n") == 1


def test_a_mended_scan_is_completed(open_ball, tmp_path):
    write_plain(tmp_path / "a.ply", *DEFECTS["with_walls"](*open_ball, np.random.default_rng(0)))
    scan = intaglio.read_surface(tmp_path / "a.ply")
    hole = next(h for h in intaglio.list_holes(scan) if not h.outer)
    whole = intaglio.complete_relief(scan, "smooth", holes=hole.number, window=2, rotations=1, refine=0)
    assert (~whole.measured).any()
    measured = whole.measured
    np.testing.assert_array_equal(whole.vertices[measured], scan.vertices[np.isin(np.arange(len(scan.vertices)), used(scan))])
    assert (whole.file_vertex[~measured] == -1).all()
    raw = intaglio.mesh.read_mesh_file(tmp_path / "a.ply")
    np.testing.assert_array_equal(raw.vertices[whole.file_vertex[measured]], whole.vertices[measured])


def used(scan):
    """The vertices of pieces of at least 50, which completion keeps."""
    number, label = intaglio.mesh.pieces(scan.faces, len(scan.vertices))
    return np.flatnonzero(np.bincount(label, minlength=number)[label] >= 50)
