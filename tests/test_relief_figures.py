"""Figures that no completion optimises: roughness by band and ring, sources, distances from the truth, confidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import intaglio
from intaglio.mesh import grid_faces, unique_edges
from intaglio.relief import choose_viewpoints, fixed_cameras, without_relief
from intaglio.relief import roughness as roughness_module
from intaglio.relief.fillings import list_fillings
from intaglio.relief.pictures import confidence_pictures
from intaglio.relief.roughness import surface_bands

SIDE = 91
MIDDLE = SIDE // 2


def sheet(height, *, holes=((MIDDLE, MIDDLE, 18),), **fields):
    """A level sheet of heights (SIDE, SIDE), one apart, filled inside circles (x, y, radius)."""
    x, y = np.meshgrid(np.arange(float(SIDE)), np.arange(float(SIDE)))
    base = np.column_stack([x.ravel(), y.ravel(), np.zeros(SIDE**2)])
    filled = np.zeros(SIDE**2, bool)
    for u, v, radius in holes:
        filled |= np.hypot(base[:, 0] - u, base[:, 1] - v) < radius
    # The faces of the grid turn downwards where x runs along the columns.
    faces = grid_faces(SIDE, SIDE)[:, ::-1]
    normal = np.tile([0.0, 0.0, 1.0], (SIDE**2, 1))
    vertices = base + normal * height.reshape(-1, 1)
    return intaglio.Surface(vertices=vertices, faces=faces, base=base, normal=normal, measured=~filled, **fields)


def rough(seed=0):
    """Heights with waves of every band, the same strength all over."""
    x, y = np.meshgrid(np.arange(float(SIDE)), np.arange(float(SIDE)))
    rng = np.random.default_rng(seed)
    height = np.zeros((SIDE, SIDE))
    for length in (4, 7, 14):
        for turn in rng.uniform(0, 2 * np.pi, 24):
            phase = rng.uniform(0, 2 * np.pi)
            height += 0.02 * np.sin(2 * np.pi / length * (np.cos(turn) * x + np.sin(turn) * y) + phase)
    return height


def figures(surface, truth=None):
    return intaglio.assess_relief(surface, truth, device="cpu")


def test_bands_of_a_plane_are_zero_and_bands_add_up():
    level = sheet(np.zeros((SIDE, SIDE)))
    tilted = level.vertices @ np.array([[0.8, 0, 0.6], [0, 1, 0], [-0.6, 0, 0.8]])
    assert np.abs(surface_bands(tilted, level.faces, 1.0)).max() < 1e-8
    # A wave of 10 spacings is damped to 16 in 17 over 5, to a half over 10, to 1 in 17 over 20: what lies between is a band's.
    x = level.base[:, 0]
    wave = sheet((0.01 * np.sin(2 * np.pi * x / 10)).reshape(SIDE, SIDE))
    band = surface_bands(wave.vertices, wave.faces, 1.0)
    inner = (np.abs(level.base[:, :2] - MIDDLE) < 20).all(axis=1)
    share = np.sqrt((band[inner] ** 2).mean(axis=0)) / np.sqrt(0.5) / 0.01
    np.testing.assert_allclose(share, [1 / 17, 16 / 17 - 1 / 2, 1 / 2 - 1 / 17], atol=0.02)


def test_a_filling_that_is_the_truth_is_as_rough_as_what_surrounds_it():
    ratios = np.mean([figures(sheet(rough(seed))).roughness for seed in range(6)], axis=0)
    # Whole waves of 20 spacings don't fit into the middle: six sheets together have enough of all others.
    assert (np.abs(ratios[:2] - 1) < 0.2).all()
    assert (np.abs(ratios[2, :2] - 1) < 0.25).all()


@pytest.mark.parametrize(("factor", "word"), [(0.0, "smoother"), (2.0, "rougher")])
def test_flattened_and_doubled_relief_is_seen_and_said(factor, word):
    whole = sheet(rough())
    own = figures(whole)
    filled = ~whole.measured
    changed = replace(whole, vertices=np.where(filled[:, None], whole.base + factor * whole.displacement, whole.vertices))
    report = figures(changed)
    # In the middle nothing of the surroundings is felt.
    np.testing.assert_allclose(report.roughness[:, 2], factor * own.roughness[:, 2], rtol=0.1, atol=0.08)
    said = [r for r in report.remarks if "5 to 10 spacings in the middle" in r]
    assert len(said) == 1
    assert said[0].endswith(f"{word} than what surrounds it")
    assert f"{report.roughness[1, 2]:.2f} times" in said[0]
    assert f"note: {said[0]}" in report.lines()


def test_rings_run_from_the_rim_to_the_middle():
    whole = sheet(rough())
    away = np.hypot(*(whole.base[:, :2] - MIDDLE).T)
    # Flat in the middle: that alone is smooth.
    changed = replace(whole, vertices=np.where((away < 8)[:, None], whole.base, whole.vertices))
    report = figures(changed)
    assert (report.roughness[0] > [0.7, 0.7, 0.0]).all()
    assert report.roughness[0, 2] < 0.5


def test_every_filling_has_its_own_figures_and_tiny_ones_none():
    holes = ((25, 25, 12), (65, 60, 14), (70, 15, 1.5))
    whole = sheet(rough(), holes=holes)
    flat = (np.hypot(*(whole.base[:, :2] - (65, 60)).T) < 14)[:, None]
    report = figures(replace(whole, vertices=np.where(flat, whole.base, whole.vertices)))
    assert report.filling_count.tolist() == sorted(report.filling_count, reverse=True)
    np.testing.assert_allclose(report.filling_center[:, :2], [[65, 60], [25, 25], [70, 15]], atol=1e-9)
    assert report.filling_roughness[0, 1, 2] < 0.1 < 0.5 < report.filling_roughness[1, 1, 2]
    assert np.isnan(report.filling_roughness[2]).all()
    assert np.isnan(report.surroundings[2]).all()
    # All together: between the two.
    assert report.filling_roughness[0, 1, 2] < report.roughness[1, 2] < report.filling_roughness[1, 1, 2]
    lines = report.lines()
    assert any(line.startswith("filling 1 at (65, 60, 0)") for line in lines)
    assert any(line.startswith("filling 3") and "not measured" in line for line in lines)


@pytest.mark.parametrize("radius", [0.5, 1.2, 1.5])
def test_a_filling_of_a_few_vertices_is_too_small_to_measure(radius):
    report = figures(sheet(rough(), holes=((MIDDLE, MIDDLE, radius),)))
    assert report.filled_count < 10
    assert np.isnan(report.roughness).all()
    assert not any("waves" in remark for remark in report.remarks)
    assert any("too small to measure" in line for line in report.lines())


def test_flat_scans_have_no_roughness_and_a_rough_filling_in_one_is_seen():
    level = sheet(np.zeros((SIDE, SIDE)))
    report = figures(level)
    assert np.isnan(report.roughness).all()
    assert any("none, neither filled nor around" in line for line in report.lines())
    scab = replace(level, vertices=np.where(level.measured[:, None], level.vertices, sheet(rough()).vertices))
    report = figures(scab)
    assert np.isfinite(report.roughness).all()
    assert (report.roughness[:, 2] > 5).all()


def test_the_size_and_place_of_the_scan_do_not_count():
    whole = sheet(rough())
    moved = replace(whole, vertices=whole.vertices * 1e-3 + 5e4, base=whole.base * 1e-3 + 5e4)
    np.testing.assert_allclose(figures(moved).roughness, figures(whole).roughness, rtol=1e-3)


def test_of_a_large_mesh_places_stand_for_the_whole(monkeypatch):
    whole = sheet(rough(), holes=((MIDDLE, MIDDLE, 38),))
    exact = figures(whole).roughness
    monkeypatch.setattr(roughness_module, "_AT_ONCE", 1000)
    monkeypatch.setattr(roughness_module, "_SAMPLED", 3000)
    np.testing.assert_allclose(figures(whole).roughness[:2], exact[:2], rtol=0.25)


def test_more_fillings_than_there_is_time_for_are_counted(monkeypatch):
    monkeypatch.setattr(roughness_module, "_IN_ALL", 0)
    report = figures(sheet(rough(), holes=((20, 20, 10), (65, 60, 12))))
    assert np.isfinite(report.filling_roughness[0]).all()
    assert np.isnan(report.filling_roughness[1]).all()
    assert any("1 were left out" in remark or "1 was left out" in remark for remark in report.remarks)


def test_a_piece_made_up_as_a_whole_has_no_rim():
    whole = sheet(rough())
    x = whole.base[:, 0]
    apart = whole.part((x < 30) | (x > 32))
    apart = replace(apart, measured=apart.base[:, 0] < 30, source=np.full(len(apart.vertices), -1))
    report = figures(apart)
    assert np.isnan(report.roughness).all()
    assert any("has no rim" in line for line in report.lines())


def carried(dx):
    """The hole filled from a piece beside it, dx to the right."""
    whole = sheet(rough(), holes=((30, MIDDLE, 10),))
    source = np.arange(SIDE**2)
    source[~whole.measured] += dx
    return replace(whole, source=source)


@pytest.mark.parametrize("dx", [19, 40])
def test_one_piece_is_coherent_used_once_and_near_or_not(dx):
    whole = carried(dx)
    report = figures(whole)
    (filling,) = list_fillings(whole)
    away = np.hypot(*(whole.base[filling.vertices, :2] + (dx, 0) - filling.center[:2]).T)
    local = (away <= 2 * filling.radius).mean()
    assert 0.5 < local < 0.8 if dx == 19 else local == 0
    assert report.coherence == 1
    assert report.largest_use == pytest.approx(1)
    assert report.local_share == pytest.approx(local)
    assert not any("pieces" in remark or "repetitions" in remark for remark in report.remarks)
    assert any(f"sources: {report.local_share:.0%} within" in line for line in report.lines())


def test_scattered_sources_and_one_source_for_all_are_said():
    whole = carried(19)
    filled = np.flatnonzero(~whole.measured)
    source = whole.source.copy()
    source[filled] = np.random.default_rng(0).choice(np.flatnonzero(whole.measured), len(filled))
    scattered = figures(replace(whole, source=source))
    assert scattered.coherence < 0.05
    assert any("don't belong together" in remark for remark in scattered.remarks)
    source[filled] = 5 * SIDE + 70
    same = figures(replace(whole, source=source))
    # All of the filling's area on a vertex and its six neighbours.
    assert same.largest_use == pytest.approx(len(filled) / 7)
    assert any("look for repetitions" in remark for remark in same.remarks)
    source[filled] = -1
    unknown = figures(replace(whole, source=source))
    assert np.isnan([unknown.coherence, unknown.largest_use, unknown.local_share]).all()
    assert not any("sources" in line for line in unknown.lines())


def test_even_use_where_more_was_filled_than_measured():
    whole = sheet(rough())
    x = whole.base[:, 0].astype(int)
    filled = x > 30
    source = np.arange(SIDE**2) - np.where(filled, 30 * ((x - 1) // 30), 0)
    report = figures(replace(whole, measured=~filled, source=source))
    # Columns 1 to 30 were carried over twice, column 0 never.
    assert 1 < report.largest_use < 1.1


def test_the_truth_and_a_smooth_filling_are_told_apart():
    whole = sheet(rough())
    truth = intaglio.Surface(vertices=whole.vertices, faces=whole.faces)
    right = figures(whole, truth)
    assert right.truth.distance_rms == pytest.approx(0, abs=1e-6)
    smooth = figures(without_relief(whole), truth)
    assert smooth.truth.smooth_rms == pytest.approx(right.truth.smooth_rms)
    assert smooth.truth.distance_rms == pytest.approx(smooth.truth.smooth_rms)
    # Relief of two tenths and slopes of a half: the nearest point is nearer than what lies below.
    assert 0.05 < smooth.truth.smooth_rms < smooth.truth.rms
    np.testing.assert_allclose(right.truth.roughness, right.roughness, rtol=1e-6)
    np.testing.assert_allclose(smooth.truth.roughness, right.roughness, rtol=0.02)
    said = [r for r in smooth.remarks if "5 to 10 spacings in the middle" in r]
    assert len(said) == 1
    assert said[0].endswith(f"smoother than what surrounds it; the truth has {smooth.truth.roughness[1, 2]:.2f}")
    lines = smooth.lines()
    assert lines[1].startswith("against the truth of the filled part: mean surface integral")
    assert any(line.startswith("against the measured part") for line in lines[2:])
    assert any(line.endswith("from a smooth filling (1.00 times)") for line in lines)
    assert any(line.startswith("the truth's own roughness") for line in lines)


def test_distances_count_what_lies_over_the_filling_alone():
    whole = sheet(rough())
    beyond = sheet(rough(3)).vertices[whole.base[:, 0] < 20] - (25, 0, 0)
    # Another piece of the object beside the scan, and its back behind it, facing away.
    vertices = np.concatenate([whole.vertices, beyond, whole.vertices - (0, 0, 3)])
    back = whole.faces[:, ::-1] + len(whole.vertices) + len(beyond)
    truth = intaglio.Surface(vertices=vertices, faces=np.concatenate([whole.faces, back]))
    assert figures(whole, truth).truth.distance_rms == pytest.approx(0, abs=1e-6)


def test_a_smooth_filling_keeps_planes_and_what_was_measured():
    slope = np.add.outer(0.3 * np.arange(SIDE), 0.1 * np.arange(SIDE))
    tilted = sheet(slope)
    inside = ~tilted.measured
    dented = replace(tilted, vertices=tilted.vertices - np.where(inside, 3.0, 0.0)[:, None] * (0, 0, 1))
    smooth = without_relief(dented)
    np.testing.assert_allclose(smooth.vertices, tilted.vertices, atol=1e-5)
    assert np.array_equal(smooth.vertices[tilted.measured], tilted.vertices[tilted.measured])


def test_a_smooth_filling_is_curved_as_the_scan_is_on_every_base():
    x, y = np.meshgrid(np.arange(SIDE) - MIDDLE, np.arange(SIDE) - MIDDLE)
    # x^3 y and x^2 - y^2 are biharmonic: nothing is smoother.
    saddle = sheet(1e-3 * (x**2 - y**2) + 1e-6 * x**3 * y)
    flat = replace(saddle, vertices=np.where(saddle.measured[:, None], saddle.vertices, saddle.base))
    np.testing.assert_allclose(without_relief(flat).vertices, saddle.vertices, atol=2e-3)


def test_where_a_filling_ends_freely_its_smooth_surface_ends_too():
    whole = sheet(rough())
    open_ended = replace(whole, measured=whole.base[:, 0] < 60)
    smooth = without_relief(open_ended)
    assert np.isfinite(smooth.vertices).all()
    assert np.array_equal(smooth.vertices[open_ended.measured], whole.vertices[open_ended.measured])


def test_figures_survive_the_file(tmp_path):
    whole = carried(19)
    whole.write(tmp_path / "whole.ply")
    back = intaglio.read_surface(tmp_path / "whole.ply")
    assert back.model is None
    a, b = figures(whole, whole), figures(back, whole)
    np.testing.assert_array_equal(a.filling_roughness, b.filling_roughness)
    assert a.lines() == b.lines()


def test_the_report_shows_roughness_and_confidence(tmp_path):
    whole = carried(19)
    intaglio.write_relief_report(whole, tmp_path / "plain.html", size=16, device="cpu")
    plain = (tmp_path / "plain.html").read_text()
    assert 'aria-label="roughness against the surroundings"' in plain
    assert "Confidence" not in plain
    sure = replace(whole, confidence=np.where(whole.measured, 1, 0.25).astype(np.float32))
    report = intaglio.write_relief_report(sure, tmp_path / "sure.html", size=16, device="cpu")
    assert report.confidence == pytest.approx(0.25)
    assert "confidence of what was filled (0 to 1): 0.25 in the mean" in report.lines()
    page = (tmp_path / "sure.html").read_text()
    assert "Confidence of what was filled" in page
    assert page.count("data:image/png;base64,") == plain.count("data:image/png;base64,") + 3


def test_confidence_is_shown_from_red_to_green():
    whole = sheet(np.zeros((SIDE, SIDE)))
    cameras = fixed_cameras(whole, choose_viewpoints(whole))[:1]
    colors = []
    for sure in (0.0, 0.5, 1.0):
        (image,) = confidence_pictures(whole, np.full(SIDE**2, sure), cameras, size=(33, 33))
        colors.append(image[16, 16])
    red, yellow, green = colors
    assert red[0] > 4 * red[1]
    assert green[1] > 4 * green[0]
    assert yellow[0] > yellow[1] > 4 * yellow[2]


def test_fillings_without_extent_are_survived():
    whole = sheet(rough())
    level = sheet(np.zeros((SIDE, SIDE)))
    point = np.tile([float(MIDDLE), float(MIDDLE), 0.0], (SIDE**2, 1))
    inside = ~whole.measured[:, None]
    fallen = replace(whole, vertices=np.where(inside, point, whole.vertices), base=np.where(inside, point, whole.base))
    assert figures(fallen, level).filled_count == whole.measured.size - whole.measured.sum()
    nothing = replace(whole, vertices=point, base=point)
    with pytest.raises(intaglio.InputError, match="no length"):
        figures(nothing)
    assert np.array_equal(without_relief(nothing).vertices, point)
    assert np.array_equal(without_relief(replace(whole, measured=np.ones(SIDE**2, bool))).vertices, whole.vertices)


def test_fillings_are_found_with_rim_and_radius():
    whole = sheet(rough(), holes=((25, 25, 3.5), (60, 60, 10)))
    large, small = list_fillings(whole)
    assert len(large.vertices) > len(small.vertices)
    np.testing.assert_allclose(large.center[:2], 60, atol=1e-9)
    assert 10 <= large.radius <= 11.5
    edges = unique_edges(whole.faces)
    crossing = edges[whole.measured[edges[:, 0]] != whole.measured[edges[:, 1]]]
    rims = np.concatenate([large.rim, small.rim])
    assert set(rims) == {int(v) for v in crossing.ravel() if whole.measured[v]}
    # Edges of a grid: one along each axis, and the square root of two across.
    assert 1.1 < small.spacing < 1.2
