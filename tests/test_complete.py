"""Completion end to end: guarantees, exact facts, quality against the truth."""

from __future__ import annotations

import numpy as np
import pytest
from reliefs import complete_with

import intaglio
from intaglio.kernels.launch import set_threads
from intaglio.mesh.topology import border_edges, border_loops, directed_edges, edge_keys, pieces, unique_edges
from intaglio.relief.ground import GroundOptions
from intaglio.relief.ground.prepare import prepare_ground
from intaglio.relief.growth.displacement_metric import DisplacementMetric
from intaglio.relief.growth.samples import sample_set
from intaglio.relief.growth.settings import Selection
from intaglio.relief.growth.state import State
from intaglio.scenes.patterns import cylinder_base, plane_base


def assert_manifold(surface):
    keys = edge_keys(directed_edges(surface.faces), len(surface.vertices))
    assert len(np.unique(keys)) == len(keys)
    undirected = np.unique(np.sort(directed_edges(surface.faces), axis=1), axis=0, return_counts=True)[1]
    assert undirected.max() <= 2


def euler(surface):
    return len(np.unique(surface.faces)) - len(unique_edges(surface.faces)) + len(surface.faces)


@pytest.fixture(scope="module")
def whole_cap(cap):
    return complete_with(cap, "sphere", window=4, rotations=2, seed=3)


def test_measured_vertices_keep_their_bits_and_faces(cap, whole_cap):
    n = len(cap.vertices)
    assert whole_cap.vertices[:n].tobytes() == cap.vertices.tobytes()
    np.testing.assert_array_equal(whole_cap.faces[: len(cap.faces)], cap.faces)
    assert whole_cap.measured[:n].all()
    assert not whole_cap.measured[n:].any()


def test_sphere_is_closed_and_manifold(whole_cap):
    assert len(border_edges(whole_cap.faces)) == 0
    assert_manifold(whole_cap)
    assert euler(whole_cap) == 2
    assert pieces(whole_cap.faces, len(whole_cap.vertices))[0] == 1


def test_triangles_are_well_shaped_and_face_outwards(cap, whole_cap):
    corners = whole_cap.base[whole_cap.faces[len(cap.faces) :]]
    edges = np.roll(corners, -1, axis=1) - corners
    length = np.linalg.norm(edges, axis=2)
    area = np.cross(edges[:, 0], -edges[:, 2])
    assert (np.einsum("ij,ij->i", area, corners.mean(axis=1) - whole_cap.model.center) > 0).all()
    # Height over longest side: 0.87 for an equilateral triangle.
    shape = np.linalg.norm(area, axis=1) / length.max(axis=1) ** 2
    assert np.median(shape) > 0.7
    assert shape.min() > 0.1


def test_provenance_names_a_measured_vertex_and_its_relief(cap):
    whole = complete_with(cap, "sphere", window=3, oversample=False)
    filled = ~whole.measured
    assert (whole.source[filled] >= 0).all()
    assert whole.measured[whole.source].all()
    np.testing.assert_array_equal(whole.source[~filled], np.arange((~filled).sum()))
    # Survey coordinates of 4e6 leave 1e-9 of a float64.
    np.testing.assert_allclose(whole.relief[filled], whole.relief[whole.source[filled]], atol=1e-8)
    assert (whole.error[filled] >= 0).all()
    assert (whole.error[~filled] == 0).all()


@pytest.mark.parametrize("settings", [{}, {"metric": "surface"}, {"refine": 2}, {"order": "sequential"}])
def test_same_seed_same_bits_for_any_number_of_threads(cap, settings):
    if settings.get("order") == "sequential" or "metric" in settings:
        cap = cap.part(np.linalg.norm(cap.vertices - cap.vertices.mean(axis=0), axis=1) < 5)
        settings = {**settings, "spacing": 1.2, "extent": (45.0,), "oversample": False}
    else:
        settings = {**settings, "extent": (90.0,)}
    results = []
    try:
        for count in (1, 2, 3):
            set_threads(count)
            results.append(complete_with(cap, "sphere", window=3, rotations=2, seed=5, device="cpu", **settings))
    finally:
        set_threads(None)
    for other in results[1:]:
        for name in ("vertices", "source", "rotation", "error"):
            assert getattr(other, name).tobytes() == getattr(results[0], name).tobytes()


def test_another_seed_gives_another_completion(cap):
    a, b = (complete_with(cap, "sphere", window=3, seed=s, tolerance=0.5) for s in (1, 2))
    assert (a.source != b.source).any()


@pytest.mark.parametrize("engine", ["blas", "warp"])
def test_engines_complete_alike(cap, engine, device):
    if engine == "blas" and device != "cpu":
        pytest.skip("BLAS runs on the CPU")
    small = cap.part(np.linalg.norm(cap.vertices - cap.vertices.mean(axis=0), axis=1) < 6)
    settings = {"window": 3, "rotations": 3, "seed": 2, "oversample": False, "spacing": 0.8}
    result = complete_with(small, "sphere", engine=engine, device=device, **settings)
    default = complete_with(small, "sphere", device="cpu", **settings)
    if device == "cpu":
        np.testing.assert_array_equal(result.source, default.source)
    else:
        # Devices agree up to the ties that rounding decides, after which growth goes its own way.
        assert result.relief[~result.measured].std() == pytest.approx(default.relief[~default.measured].std(), rel=0.2)


@pytest.mark.parametrize("metric", ["displacement", "surface"])
@pytest.mark.parametrize("order", ["wave", "sequential"])
def test_a_wave_on_a_cylinder_is_continued_exactly(wave_tube, metric, order):
    scan, truth = wave_tube
    whole = complete_with(scan, cylinder_base(), 2, 0.1, metric=metric, order=order, seed=1)
    assert (~whole.measured).sum() == 576
    report = intaglio.assess_relief(whole, truth)
    assert abs(report.msi_percent) < 2
    # Noise-free and periodic: relief from exact matches; what is left is single precision (and, in waves of the surface
    # metric, neighbours that choose apart).
    assert report.truth.rms < (1e-5 if (metric, order) != ("surface", "wave") else 0.1 * report.std_measured)


def test_a_plane_in_a_plane_out(wave_sheet):
    scan, _ = wave_sheet
    flat = intaglio.Surface(vertices=scan.vertices * (1, 1, 0) + (0, 0, 3.0), faces=scan.faces)
    holed = flat.part(np.linalg.norm(flat.vertices[:, :2] - 20, axis=1) > 6)
    filled = complete_with(holed, "plane", window=3)
    np.testing.assert_allclose(filled.vertices[:, 2], 3.0, atol=1e-9)


def test_rectangle_reaches_beyond_the_scan(wave_sheet):
    scan, truth = wave_sheet
    whole = complete_with(scan, plane_base(), 2, 0.1, extent=(0, 74, 0, 40), seed=1)
    assert (~whole.measured).sum() == 1394
    assert_manifold(whole)
    assert euler(whole) == 1
    assert intaglio.assess_relief(whole, truth).truth.rms < 1e-5


def test_holes_only_leaves_the_outer_border(cap):
    center = cap.vertices[np.argmin(np.abs(cap.vertices - cap.vertices.mean(axis=0)).sum(axis=1))]
    holed = cap.part(np.linalg.norm(cap.vertices - center, axis=1) > 2)
    whole = complete_with(holed, "sphere", window=3, extent="holes")
    loops = border_loops(whole.faces)
    assert len(loops) == 1
    assert len(loops[0]) == len(border_loops(cap.faces)[0])
    assert np.linalg.norm(whole.vertices[~whole.measured] - center, axis=1).max() < 2.5


def test_a_cap_of_a_sphere_can_be_asked_for(cap):
    whole = complete_with(cap, "sphere", window=3, extent=(75.0,))
    assert_manifold(whole)
    assert euler(whole) == 1
    axis = np.array([0.0, 0.0, 1.0])
    height = (whole.base - whole.model.center) @ axis / whole.model.radius
    assert height.min() == pytest.approx(np.cos(np.radians(75)), abs=0.06)


def test_an_island_in_a_hole_is_kept(wave_sheet):
    scan, _ = wave_sheet
    distance = np.linalg.norm(scan.vertices[:, :2] - 20, axis=1)
    ringed = scan.part((distance > 12) | (distance < 5.5))
    whole = complete_with(ringed, plane_base(), 2, extent="holes")
    assert whole.vertices[: len(ringed.vertices)].tobytes() == ringed.vertices.tobytes()
    assert pieces(whole.faces, len(whole.vertices))[0] == 1
    assert euler(whole) == 1


def test_frames_do_not_change_what_is_measured(cap):
    for frames in ("algebraic", "sweep"):
        whole = complete_with(cap, "sphere", window=3, frames=frames, rotations=2)
        assert whole.vertices[: len(cap.vertices)].tobytes() == cap.vertices.tobytes()
        assert whole.relief[~whole.measured].std() > 0.5 * whole.relief[whole.measured].std()


@pytest.mark.parametrize("settings", [{"bootstrap": True}, {"bootstrap": True, "metric": "surface"}, {"rule": "best-percent"}])
def test_options_of_the_papers_run_and_fill_everything(wave_tube, settings):
    scan, _ = wave_tube
    whole = complete_with(scan, cylinder_base(), 2, 0.1, **settings)
    assert (whole.source >= 0).all()
    assert whole.measured[whole.source].all()


def test_colour_travels_with_relief(wave_tube):
    scan, _ = wave_tube
    color = np.random.default_rng(0).uniform(size=(len(scan.vertices), 3)).astype(np.float32)
    coloured = intaglio.Surface(vertices=scan.vertices, faces=scan.faces, color=color)
    whole = complete_with(coloured, cylinder_base(), 2, oversample=False)
    np.testing.assert_array_equal(whole.color, whole.color[whole.source])
    oversampled = complete_with(coloured, cylinder_base(), 2, oversample=True)
    assert oversampled.color.min() >= 0
    assert oversampled.color.max() <= 1


HALF = GroundOptions(extent=(90.0,))


def full_matching_error(scan, whole):
    """Mean error of every filled vertex's full neighbourhood against its best sample."""
    ground = prepare_ground(scan, "sphere", HALF)
    metric = DisplacementMetric(ground, sample_set(ground, True), 5, 4, "cpu")
    count = len(whole.vertices)
    state = State(whole.relief, np.ones(count, bool), whole.source, np.zeros(count), np.zeros(count), None, np.full(count, -1))
    targets = np.flatnonzero(~whole.measured)
    rule = Selection("near-best", tolerance=0.0)
    return metric.pick(targets, np.full(len(targets), 5), state, rule, np.zeros(len(targets))).error.mean()


def test_refinement_lowers_the_matching_error_and_keeps_sources(cap):
    grown = complete_with(cap, "sphere", window=5, rotations=4, seed=1, extent=HALF.extent)
    refined = complete_with(cap, "sphere", window=5, rotations=4, seed=1, extent=HALF.extent, refine=4)
    filled = ~grown.measured
    assert refined.measured[refined.source].all()
    assert refined.vertices[~filled].tobytes() == grown.vertices[~filled].tobytes()
    before, after = (full_matching_error(cap, w) for w in (grown, refined))
    assert after < 0.7 * before
    ratio = refined.relief[filled].std() / grown.relief[~filled].std()
    assert 0.8 < ratio < 1.2


def test_progress_counts_every_vertex(wave_tube):
    scan, _ = wave_tube
    calls = []
    complete_with(scan, cylinder_base(), 2, progress=lambda done, total: calls.append((done, total)))
    assert calls[0] == (0, 576)
    assert calls[-1] == (576, 576)
    assert [c[0] for c in calls] == sorted(c[0] for c in calls)


def test_made_up_relief_does_not_become_measured(whole_cap, cap, tmp_path):
    with pytest.raises(intaglio.InputError, match="filled, not measured"):
        complete_with(whole_cap, "sphere")
    whole_cap.write(tmp_path / "w.ply")
    again = intaglio.read_surface(tmp_path / "w.ply")
    np.testing.assert_array_equal(again.measured, whole_cap.measured)
    np.testing.assert_array_equal(again.source, whole_cap.source)
    assert again.model.kind == "sphere"
    part = again.part(again.measured)
    np.testing.assert_array_equal(part.vertices, cap.vertices)


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1e9, 1e12])
def test_the_unit_does_not_matter(wave_sheet, scale):
    scan, _ = wave_sheet
    holed = scan.part(np.linalg.norm(scan.vertices[:, :2] - 20, axis=1) > 5)
    plain = complete_with(holed, "plane", window=3, refine=2)
    scaled = complete_with(intaglio.Surface(vertices=holed.vertices * scale, faces=holed.faces), "plane", window=3, refine=2)
    assert len(scaled.vertices) == len(plain.vertices)
    np.testing.assert_allclose(scaled.relief.std() / scale, plain.relief.std(), rtol=0.05)


def test_a_spacing_that_is_given_is_used_on_a_lattice_too(wave_sheet):
    scan, _ = wave_sheet
    holed = scan.part(np.linalg.norm(scan.vertices[:, :2] - 20, axis=1) > 6)
    own, finer = (complete_with(holed, plane_base(), 2, spacing=s, extent="holes") for s in (None, 0.5))
    assert any("lattice" in note for note in own.notes)
    assert not any("lattice" in note for note in finer.notes)
    assert 3 < (~finer.measured).sum() / (~own.measured).sum() < 6
