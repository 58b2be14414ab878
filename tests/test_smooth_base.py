"""Holes of any shape: rims, patches, the smooth base, geodesic grids, relief over it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
import warp as wp
from reliefs import complete_with

import intaglio
from intaglio import Surface
from intaglio.kernels.geodesics import nearest_on_mesh, trace
from intaglio.kernels.location import polar_grid
from intaglio.kernels.polygons import least_area_triangles
from intaglio.mesh.topology import Topology, border_edges, directed_edges, edge_keys, unique_edges
from intaglio.relief.ground import thin_plate
from intaglio.relief.ground.holes import choose_holes, find_holes
from intaglio.relief.ground.patches import refine_patch, triangulate_rim
from intaglio.relief.ground.prepare import GroundOptions, prepare_ground
from intaglio.relief.ground.thin_plate import smooth_over_surface
from intaglio.relief.growth.displacement_metric import DisplacementMetric
from intaglio.relief.growth.refinement import _references
from intaglio.relief.growth.samples import sample_set
from intaglio.relief.growth.state import State


def ball(subdivisions=4, rough=0.0, seed=0):
    """Return a sphere of radius 10 with fine relief: bumps of a few edges."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=10.0)
    v = np.asarray(mesh.vertices)
    k = np.random.default_rng(seed).normal(size=(12, 3))
    k *= 3.0 / np.linalg.norm(k, axis=1, keepdims=True)
    height = rough * np.sin(v @ k.T + np.arange(12)).mean(axis=1)
    return v * (1 + height / 10)[:, None], np.asarray(mesh.faces)


def punched(vertices, faces, *holes):
    """Return the mesh without what lies within (center, radius) of each hole."""
    keep = np.ones(len(vertices), bool)
    for center, radius in holes:
        keep &= np.linalg.norm(vertices - center, axis=1) > radius
    return Surface(vertices=vertices, faces=faces).part(keep)


def flat(side=24):
    """Return a grid of unit steps."""
    x, y = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float), indexing="ij")
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = (q.ravel() for q in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    vertices = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def is_closed_and_manifold(faces):
    edges = np.sort(directed_edges(faces), axis=1)
    return (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def least_area(points):
    """Brute-force reference: least total area over all triangulations of a closed polygon."""
    n = len(points)
    best = {(i, i + 1): 0.0 for i in range(n - 1)}
    for length in range(2, n):
        for i in range(n - length):
            k = i + length
            best[i, k] = min(
                best[i, m] + best[m, k] + 0.5 * np.linalg.norm(np.cross(points[m] - points[i], points[k] - points[i]))
                for m in range(i + 1, k)
            )
    return best[0, n - 1]


@pytest.mark.parametrize("count", [3, 4, 9, 23])
def test_polygons_get_the_triangulation_of_least_area(count, device):
    rng = np.random.default_rng(count)
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    points = np.stack([np.cos(angle), np.sin(angle), 0.4 * rng.normal(size=count)], axis=1) * rng.uniform(0.7, 1.3, (count, 1))
    triangles = least_area_triangles(points, np.arange(count), np.zeros((count, count), bool), device)
    assert triangles.shape == (count - 2, 3)
    corners = points[triangles]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    assert area == pytest.approx(least_area(points), rel=1e-5)


def test_a_polygon_whose_chords_are_barred_has_no_triangulation(device):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    assert least_area_triangles(points, np.arange(4), np.ones((4, 4), bool), device) is None


def test_geodesics_on_a_folded_plane_are_straight_when_unfolded(device):
    vertices, faces = flat(20)
    # Folded along x = 9 by 50 degrees: lengths and angles on the sheet stay.
    turn = np.radians(50)
    beyond = np.maximum(vertices[:, 0] - 9, 0)
    folded = vertices.copy()
    folded[:, 0] = np.minimum(vertices[:, 0], 9) + beyond * np.cos(turn)
    folded[:, 2] = beyond * np.sin(turn)
    start = 7 * 20 + 9
    topology = Topology.of(faces.astype(np.int32), len(vertices))
    offsets = polar_grid(6, 4)[0]
    face, weight = trace(
        folded[[start]], np.array([[1.0, 0, 0]]), np.array([[0, 1.0, 0]]), topology.incident[topology.face_offsets[[start]]],
        offsets, wp.array(folded.astype(np.float32), dtype=wp.vec3, device=device),
        wp.array(faces.astype(np.int32), dtype=wp.int32, ndim=2, device=device),
        wp.array(topology.across, dtype=wp.int32, ndim=2, device=device), device,
    )  # fmt: skip
    f, b = face.numpy()[0], weight.numpy()[0]
    assert (f >= 0).all()
    weights = np.column_stack([b, 1 - b.sum(axis=1)])
    # The same barycentric place on the flat sheet is the straight line's end.
    np.testing.assert_allclose(
        np.einsum("ik,ikc->ic", weights, vertices[faces[f]])[:, :2], vertices[start, :2] + offsets, atol=2e-4
    )


def test_geodesics_on_a_sphere_follow_great_circles_and_stop_at_borders(device):
    vertices, faces = ball(4)
    topology = Topology.of(faces.astype(np.int32), len(vertices))
    rows = np.arange(0, 2000, 100)
    normal = vertices[rows] / 10
    u = np.cross(normal, [0.3, 0.5, 0.8])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normal, u)
    offsets = polar_grid(5, 6)[0]
    put = [
        wp.array(vertices.astype(np.float32), dtype=wp.vec3, device=device),
        wp.array(faces.astype(np.int32), dtype=wp.int32, ndim=2, device=device),
        wp.array(topology.across, dtype=wp.int32, ndim=2, device=device),
    ]
    face, weight = trace(vertices[rows], u, v, topology.incident[topology.face_offsets[rows]], offsets, *put, device)
    b = np.concatenate([weight.numpy(), 1 - weight.numpy().sum(axis=2, keepdims=True)], axis=2)
    found = np.einsum("igk,igkc->igc", b, vertices[faces[face.numpy()]])
    length = np.linalg.norm(offsets, axis=1)
    along = (offsets[None, :, :1] * u[:, None] + offsets[None, :, 1:] * v[:, None]) / np.maximum(length, 1e-9)[None, :, None]
    circle = 10 * (np.cos(length / 10)[None, :, None] * normal[:, None] + np.sin(length / 10)[None, :, None] * along)
    assert np.abs(found - circle).max() < 0.06
    half = faces[(vertices[faces][:, :, 2] > 0).all(axis=1)]
    cut = Topology.of(half.astype(np.int32), len(vertices))
    low = np.argmin(np.where((np.diff(cut.face_offsets) > 0) & (vertices[:, 2] > 0), vertices[:, 2], 99))
    n = vertices[low] / 10
    down = np.array([0, 0, -1.0]) + n[2] * n
    down /= np.linalg.norm(down)
    put[1:] = [wp.array(a.astype(np.int32), dtype=wp.int32, ndim=2, device=device) for a in (half, cut.across)]
    face, _ = trace(
        vertices[[low]], down[None], np.cross(n, down)[None], cut.incident[cut.face_offsets[[low]]],
        np.array([[3.0, 0.0], [-3.0, 0.0]]), *put, device,
    )  # fmt: skip
    assert (face.numpy()[0] >= 0).tolist() == [False, True]


def test_nearest_points_agree_with_trimesh_far_from_the_origin(device):
    vertices, faces = ball(3)
    at = np.random.default_rng(0).normal(size=(50, 3)) * 12
    face, weight = nearest_on_mesh(at + 1e5, vertices + 1e5, faces, device)
    nearest = np.einsum("ik,ikc->ic", weight, vertices[faces[face]])
    closest = trimesh.proximity.closest_point_naive(trimesh.Trimesh(vertices, faces, process=False), at)[1]
    np.testing.assert_allclose(np.linalg.norm(nearest - at, axis=1), closest, atol=1e-4)


def test_smoothing_damps_a_wave_by_the_stated_factor():
    vertices, faces = flat(80)
    for wave in (10.0, 20.0, 40.0):
        height = np.sin(2 * np.pi * vertices[:, 0] / wave)
        out = smooth_over_surface(height[:, None], vertices, faces, 20.0)[:, 0]
        inner = (np.abs(vertices[:, :2] - 39.5) < 20).all(axis=1)
        gain = (out @ (height * inner)) / (height @ (height * inner))
        assert gain == pytest.approx(1 / (1 + (20.0 / wave) ** 4), abs=0.03)


def test_conjugate_gradients_agree_with_the_direct_solution(monkeypatch):
    vertices, faces = flat(60)
    rng = np.random.default_rng(0)
    values = np.stack([5 * np.sin(vertices[:, 0] / 9) + rng.normal(0, 0.3, len(vertices)), vertices[:, 1]], axis=1)
    hole = (np.abs(vertices[:, :2] - 30) < 9).all(axis=1)
    for length, weight in ((6.0, None), (60.0, None), (15.0, 1.0 - hole)):
        direct = smooth_over_surface(values, vertices, faces, length, weight=weight)
        monkeypatch.setattr(thin_plate, "DIRECT", 10)
        iterated = smooth_over_surface(values, vertices, faces, length, weight=weight)
        monkeypatch.undo()
        np.testing.assert_allclose(iterated, direct, atol=2e-4)


def test_a_made_up_part_is_biharmonic_and_keeps_planes():
    vertices, faces = flat(30)
    inside = (np.abs(vertices[:, :2] - 14.5) < 6).all(axis=1)
    plane = vertices[:, :1] * 0.3 - vertices[:, 1:2]
    out = smooth_over_surface(
        np.where(inside[:, None], 0.0, plane), vertices, faces, 5.0, weight=np.zeros(len(vertices)), free=inside
    )
    np.testing.assert_allclose(out, plane, atol=1e-8)
    held = smooth_over_surface(plane, vertices, faces, 5.0, free=np.zeros(len(vertices), bool))
    assert held.tobytes() == plane.tobytes()


def test_holes_are_found_ordered_and_told_from_the_outer_border():
    vertices, faces = flat(30)
    scan = punched(vertices, faces, ((8.5, 8.5, 0), 3.0), ((20.5, 20.5, 0), 5.0))
    holes = find_holes(scan.vertices, scan.faces)
    assert [h.outer for h in holes] == [True, False, False]
    assert [h.number for h in holes] == [1, 2, 3]
    np.testing.assert_allclose(holes[1].center, (20.5, 20.5, 0), atol=0.1)
    assert holes[1].length > holes[2].length
    assert [h.number for h in choose_holes(holes, "all")] == [2, 3]
    assert [h.number for h in choose_holes(holes, "largest")] == [2]
    assert [h.number for h in choose_holes(holes, (3,))] == [3]
    assert [h.number for h in choose_holes(holes, "every")] == [1, 2, 3]
    assert [h.number for h in choose_holes(holes, "all", (0, holes[2].length))] == [3]
    assert [h.number for h in intaglio.list_holes(scan)] == [1, 2, 3]
    for wanted, message in (("some", "numbers"), ((4,), "no hole 4"), ((), "numbers"), ((0,), "no hole 0"), ((1.5,), "numbers")):
        with pytest.raises(intaglio.InputError, match=message):
            choose_holes(holes, wanted)
    for size in ((3, 1), (-1, 2), "ab", (1,), (np.nan, 2)):
        with pytest.raises(intaglio.InputError, match="hole_size"):
            choose_holes(holes, "all", size)
    with pytest.raises(intaglio.InputError, match="no hole is left"):
        choose_holes(holes, "all", (1e6, 1e7))
    with pytest.raises(intaglio.InputError, match="encloses no hole"):
        choose_holes(holes[:1], "all")


def test_a_rim_that_touches_itself_is_followed_along_its_fans():
    vertices, faces = flat(12)
    # Two square holes that share the corner (6, 6).
    middle = vertices[faces].mean(axis=1)
    low, high = (((middle > a) & (middle < a + 2)) for a in (4, 6))
    scan = Surface(vertices=vertices, faces=faces[~(low[:, :2].all(axis=1) | high[:, :2].all(axis=1))])
    holes = [h for h in find_holes(scan.vertices, scan.faces) if not h.outer]
    assert sum(len(h.loop) for h in holes) == 16
    whole = complete_with(scan, "smooth", rotations=1, window=3, holes="all")
    edges = np.sort(directed_edges(whole.faces), axis=1)
    assert np.unique(edges, axis=0, return_counts=True)[1].max() == 2
    assert len(border_edges(whole.faces)) == 44


def test_long_rims_and_patches_are_refined_to_the_spacing():
    angle = np.linspace(0, 2 * np.pi, 1500, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle), 0.1 * np.sin(3 * angle)], axis=1) * 100
    triangles = triangulate_rim(rim, np.zeros(0, np.int64), [np.arange(1500)[::-1]], "cpu")
    assert triangles.shape == (1498, 3)
    assert len(np.unique(triangles)) == 1500
    short = rim[::30]
    triangles = triangulate_rim(short, np.zeros(0, np.int64), [np.arange(50)[::-1]], "cpu")
    points, faces = refine_patch(short, triangles, 12.0, np.zeros(0, np.int64))
    np.testing.assert_array_equal(points[:50], short)
    edges = unique_edges(faces)
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    assert np.median(length) == pytest.approx(12.0, rel=0.25)
    assert length.max() < 2 * 12.0
    assert len(border_edges(faces)) == 50
    assert len(points) - len(edges) + len(faces) == 1


def test_a_hole_in_a_ball_is_filled_round_and_closed():
    vertices, faces = ball(4)
    scan = punched(vertices, faces, ((0, 0, 10), 4.0))
    ground = prepare_ground(scan, "smooth")
    assert is_closed_and_manifold(ground.faces)
    target = ~ground.measured
    assert target.sum() > 100
    assert np.abs(np.linalg.norm(ground.foot[target], axis=1) - 10).max() < 0.25
    outward = ground.foot / np.linalg.norm(ground.foot, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", outward, ground.normal).min() > 0.97
    # The displacement lies along the normal, and the base is smooth where nothing is rough.
    np.testing.assert_allclose(np.cross(ground.vertices - ground.foot, ground.normal), 0, atol=1e-9)
    assert np.abs(ground.height).max() < 0.05
    np.testing.assert_allclose(np.linalg.norm(ground.u, axis=1), 1, atol=1e-9)


def test_relief_continues_over_any_shape_and_measured_bits_stay():
    vertices, faces = ball(4, rough=0.35)
    vertices = vertices * (1.0, 1.3, 0.8) + (500000.0, 0, 0)
    scan = punched(vertices, faces, ((500000.0, 0, 8), 4.0), ((500010.0, 0, 0), 2.5))
    seen = []
    whole = complete_with(scan, "auto", refine=2, seed=3, progress=lambda done, total: seen.append((done, total)))
    assert whole.model.kind == "smooth"
    assert whole.vertices[: len(scan.vertices)].tobytes() == scan.vertices.tobytes()
    assert is_closed_and_manifold(whole.faces)
    assert whole.measured[whole.source].all()
    assert seen[-1][0] == seen[-1][1]
    filled = ~whole.measured
    report = intaglio.assess_relief(whole)
    assert 0.6 < report.std_filled / report.std_measured < 1.4
    assert report.seam < 1.3
    assert np.isfinite(whole.vertices).all()
    again = complete_with(scan, "smooth", refine=2, seed=3)
    assert again.vertices.tobytes() == whole.vertices.tobytes()
    one = complete_with(scan, holes="largest", refine=0, rotations=1, window=5)
    assert 0 < (~one.measured).sum() < filled.sum()
    assert len(find_holes(one.vertices, one.faces)) == 1


def test_an_island_in_a_hole_is_joined():
    vertices, faces = ball(4)
    ring = np.linalg.norm(vertices - (0, 0, 10), axis=1)
    scan = Surface(vertices=vertices, faces=faces).part((ring > 6.0) | (ring < 3.0))
    assert len(find_holes(scan.vertices, scan.faces)) == 2
    ground = prepare_ground(scan, "smooth")
    assert is_closed_and_manifold(ground.faces)
    assert any("around 1 piece" in note for note in ground.notes)
    assert np.abs(np.linalg.norm(ground.foot, axis=1) - 10).max() < 0.4


@pytest.mark.parametrize("edges", [3, 4, 6])
def test_tiny_holes_are_closed(edges):
    vertices, faces = ball(3)
    topology = Topology.of(faces.astype(np.int32), len(vertices))
    if edges == 3:
        out = np.array([0])
    elif edges == 4:
        out = np.array([0, topology.across[0, 0]])
    else:
        degree = np.diff(topology.face_offsets)
        vertex = np.flatnonzero(degree == 6)[0]
        out = topology.incident[topology.face_offsets[vertex] : topology.face_offsets[vertex + 1]]
    scan = Surface(vertices=vertices, faces=np.delete(faces, out, axis=0))
    assert is_closed_and_manifold(prepare_ground(scan, "smooth").faces)


def test_a_scan_without_relief_says_so():
    vertices, faces = flat(24)
    scan = punched(vertices, faces, ((11.5, 11.5, 0), 4.0))
    whole = complete_with(scan, "smooth", rotations=1)
    assert any("no relief" in note for note in whole.notes)
    np.testing.assert_allclose(whole.vertices[:, 2], 0, atol=1e-6)


def test_smooth_surfaces_are_read_back_and_assessed(tmp_path):
    vertices, faces = ball(4, rough=0.3)
    whole = complete_with(punched(vertices, faces, ((0, 0, 10), 3.5)), "smooth", rotations=1, window=4)
    whole.write(tmp_path / "whole.ply")
    back = intaglio.read_surface(tmp_path / "whole.ply")
    assert back.model.kind == "smooth"
    assert back.model.relief_scale == whole.model.relief_scale
    foot, normal = back.model.foot(back.vertices[:50])
    np.testing.assert_allclose(foot, back.base[:50], atol=0.05)
    assert np.einsum("ij,ij->i", normal, back.normal[:50]).min() > 0.98
    assert intaglio.assess_relief(back).seam == pytest.approx(intaglio.assess_relief(whole).seam, rel=1e-4)
    assert "smooth" in back.model.describe()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"base": "sphere", "holes": "all"}, "holes goes with"),
        ({"base": "smooth", "extent": "whole"}, "fills holes"),
        ({"relief_scale": 0.0}, "relief_scale"),
        ({"relief_scale": float("nan")}, "relief_scale"),
        ({"holes": "bogus"}, "holes must be"),
        ({"hole_size": (5, 1)}, "hole_size"),
    ],
)
def test_bad_settings_of_a_smooth_base(settings, message):
    vertices, faces = ball(3)
    scan = punched(vertices, faces, ((0, 0, 10), 4.0))
    with pytest.raises(intaglio.InputError, match=message):
        complete_with(scan, **settings)


def test_a_hole_larger_than_the_scan_is_left_open_unless_asked():
    vertices, faces = ball(4)
    cap = Surface(vertices=vertices, faces=faces).part(vertices[:, 2] > 6)
    with pytest.raises(intaglio.InputError, match="holes='every'"):
        complete_with(cap, "smooth")
    whole = complete_with(cap, "smooth", holes="every", rotations=1, window=4)
    assert is_closed_and_manifold(whole.faces)


def test_samples_grids_are_centred_on_the_samples():
    vertices, faces = ball(4, rough=0.3)
    ground = prepare_ground(punched(vertices, faces, ((0, 0, 10), 4.0)), "smooth")
    for oversample in (False, True):
        samples = sample_set(ground, oversample)
        metric = DisplacementMetric(ground, samples, 3, 1, "cpu")
        held = metric._value[:, 0] * metric._scale + metric._levels[0]
        np.testing.assert_allclose(held, samples.height, atol=2e-3 * ground.height.std() + 1e-4)


def test_a_slit_one_vertex_wide_is_one_hole():
    vertices, faces = flat(24)
    rough = vertices + np.random.default_rng(0).normal(0, 0.1, (len(vertices), 1)) * (0, 0, 1.0)
    inside = (np.abs(vertices[:, 1] - 12) < 0.9) & (np.abs(vertices[:, 0] - 12) < 7)
    ground = prepare_ground(Surface(vertices=rough, faces=faces).part(~inside), "smooth")
    count = len(ground.measured)
    state = State(
        ground.height, np.ones(count, bool), np.zeros(count, int), np.zeros(count), np.zeros(count), None, np.zeros(count)
    )
    assert len(_references(ground, state, np.flatnonzero(~ground.measured))) == 1


def test_a_closed_scan_with_a_stray_triangle_has_nothing_to_fill():
    vertices, faces = ball(3)
    stray = np.array([[20.0, 0, 0], [21, 0, 0], [20, 1, 0]])
    scan = Surface(
        vertices=np.concatenate([vertices, stray]), faces=np.concatenate([faces, len(vertices) + np.array([[0, 1, 2]])])
    )
    with pytest.raises(intaglio.InputError, match="nothing is missing"):
        complete_with(scan, "smooth")


def test_a_flap_on_one_vertex_and_holes_that_meet_stay_manifold():
    vertices, faces = flat(40)
    middle = vertices[faces].mean(axis=1)
    hole = (np.abs(middle[:, :2] - 20) < 9).all(axis=1)
    flap = (middle[:, 0] > 11) & (middle[:, 0] < 17) & (middle[:, 1] > 11) & (middle[:, 1] < 17)
    scan = Surface(vertices=vertices, faces=faces[~hole | flap])
    pair = faces[~((np.abs(middle[:, :2] - 10) < 2).all(axis=1) | (np.abs(middle[:, :2] - 14) < 2).all(axis=1))]
    for surface in (scan, Surface(vertices=vertices, faces=pair)):
        ground = prepare_ground(surface, "smooth")
        times = np.unique(np.sort(directed_edges(ground.faces), axis=1), axis=0, return_counts=True)[1]
        assert times.max() <= 2


def test_a_sharp_rim_leaves_no_gap():
    vertices, faces = ball(4)
    bowl = Surface(vertices=vertices, faces=faces).part(vertices[:, 2] < -2)
    ground = prepare_ground(bowl, "smooth", GroundOptions(holes="every"))
    scan, filling = (f for f in np.split(ground.faces, [len(bowl.faces)]))
    longest = [np.linalg.norm(ground.vertices[f] - ground.vertices[np.roll(f, 1, axis=1)], axis=2).max() for f in (scan, filling)]
    assert longest[1] < 2.5 * longest[0]


def test_edge_keys_of_patches_never_meet_the_scans():
    vertices, faces = ball(4, rough=0.3)
    scan = punched(vertices, faces, ((0, 0, 10), 3.0), ((0, 3.9, 9), 1.2), ((10, 0, 0), 2.0))
    ground = prepare_ground(scan, "smooth")
    own = edge_keys(unique_edges(scan.faces), len(ground.measured))
    patch = edge_keys(unique_edges(ground.faces[len(scan.faces) :]), len(ground.measured))
    rim = np.sort(border_edges(scan.faces), axis=1)
    shared = np.intersect1d(own, patch)
    assert set(shared) == set(edge_keys(rim, len(ground.measured)))


@pytest.mark.parametrize("oversample", [True, False])
def test_relief_grown_from_filled_vertices_names_its_own_sources(oversample):
    prepared = intaglio.prepare_relief(punched(*ball(rough=1.0), ((0, 0, 10), 3.0)), "smooth")
    whole = prepared.complete(intaglio.ReliefSettings(window=3, bootstrap=True, oversample=oversample))
    filled = ~whole.measured
    assert filled.sum() > 50
    assert whole.measured[whole.source[filled]].all()
    # Joined to the rim, the filling stays about as rough as the scan.
    assert np.abs(whole.relief[filled]).max() < 4 * np.abs(whole.relief[whole.measured]).max()
