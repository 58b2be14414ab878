"""The papers' method, option by option: partners, phase, over- and subsampling, colour on the surface, bootstrapping, Nyquist."""

from __future__ import annotations

import numpy as np
import pytest
from reliefs import complete_with

import intaglio
from intaglio import Surface
from intaglio.kernels.transfer import encode_srgb
from intaglio.mesh.topology import Topology, border_edges, unique_edges
from intaglio.relief.ground.prepare import GroundOptions, prepare_ground
from intaglio.relief.growth.comparison import compare_by
from intaglio.relief.growth.displacement_metric import DisplacementMetric
from intaglio.relief.growth.interpolation import ReliefBetween
from intaglio.relief.growth.oversampling import subdivide_measured
from intaglio.relief.growth.samples import sample_set
from intaglio.relief.growth.settings import Selection
from intaglio.relief.growth.state import State
from intaglio.relief.growth.surface_metric import SurfaceMetric
from intaglio.scenes.patterns import grid_faces, plane_base

PLANE = plane_base()
PERIOD, AMPLITUDE = 6.0, 0.25
# What is missing lies between the columns LEFT and RIGHT.
COLUMNS, ROWS, LEFT, RIGHT = 45, 18, 14, 30
WHOLE = (0.0, COLUMNS - 1.0, 0.0, ROWS - 1.0)


def wave(x, y):
    return AMPLITUDE * np.sin(2 * np.pi * x / PERIOD) + 0 * y


def strip(height=wave, color=None):
    """A sheet of unit steps without its middle third."""
    x, y = np.meshgrid(np.arange(float(COLUMNS)), np.arange(float(ROWS)), indexing="ij")
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    shown = None if color is None else color(x, y).reshape(-1, 3).astype(np.float32)
    sheet = Surface(vertices=vertices, faces=grid_faces(COLUMNS, ROWS, False), color=shown)
    return sheet.part((vertices[:, 0] <= LEFT) | (vertices[:, 0] >= RIGHT))


def off_the_wave(whole):
    """Root mean square difference of the filled part from the wave, in standard deviations of the wave."""
    filled = ~whole.measured
    difference = (whole.relief - wave(whole.base[:, 0], whole.base[:, 1]))[filled]
    return float(np.sqrt((difference**2).mean()) / (AMPLITUDE / np.sqrt(2)))


def state_of(ground, samples, filled=()):
    """What growth starts from, some targets filled with the height 0."""
    count = len(ground.measured)
    textured = ground.measured.copy()
    textured[list(filled)] = True
    color = None if ground.color is None else ground.color.copy()
    source = np.where(ground.measured, np.arange(count), 0).astype(np.int32)
    zeros = np.zeros(count, np.float32)
    return State(ground.height, textured, source, zeros.copy(), zeros.copy(), color, samples.numbers(count))


@pytest.mark.parametrize("metric", ["displacement", "surface"])
@pytest.mark.parametrize("spacing", [0.8, 1.07])
def test_a_wave_out_of_phase_is_continued_between_the_samples(metric, spacing):
    settings = {"spacing": spacing, "extent": WHOLE, "window": 4, "rotations": 1, "metric": metric, "seed": 1}
    copied = complete_with(strip(), PLANE, **settings)
    between = complete_with(strip(), PLANE, interpolate=True, **settings)
    assert off_the_wave(copied) > 0.05
    assert off_the_wave(between) < 0.01
    assert between.vertices[between.measured].tobytes() == copied.vertices[copied.measured].tobytes()
    filled = np.flatnonzero(~between.measured)
    assert between.measured[between.source[filled]].all()


def test_the_source_is_the_measured_vertex_nearest_to_where_relief_was_taken():
    scan = strip(color=lambda x, y: np.stack([x / 60, y / 30, 0 * x + 0.5], -1))
    ground = prepare_ground(scan, PLANE, GroundOptions(spacing=1.07))
    samples = sample_set(ground, 0)
    between = ReliefBetween(ground, samples)
    state = state_of(ground, samples)
    graph = ground.topology.graph
    targets = np.flatnonzero(~ground.measured & (graph @ ground.measured.astype(float) > 2))[:8]
    metric = DisplacementMetric(ground, between.inside(samples), 4, 1, "cpu")
    window = np.full(len(targets), 4)
    picks = metric.pick(targets, window, state, Selection(tolerance=0.0), np.zeros(len(targets)))
    found, height, source, color = between.take(targets, picks, window, state, metric.samples)
    assert found.all()
    # On the wave: where relief was taken follows from the height's own slope, within the nearest vertex's cell.
    sample = metric.samples.foot[picks.sample]
    assert (np.linalg.norm(ground.foot[source] - sample, axis=1) < 1.6).all()
    np.testing.assert_allclose(height, wave(ground.foot[targets, 0], 0), atol=0.01)
    assert (np.abs(height - ground.height[source]) < AMPLITUDE * 2 * np.pi / PERIOD * 0.75).all()
    assert (np.abs(color - ground.color[source]).max(axis=1) < 1 / 30).all()


def test_splines_between_vertices_agree_with_the_relief_and_its_slope():
    ground = prepare_ground(strip(), PLANE, GroundOptions(extent=WHOLE))
    between = ReliefBetween(ground, sample_set(ground, 0))
    place = np.random.default_rng(0).uniform((3, 3, 0), (11, 14, 0), (500, 3))
    unit = (place - between._center) / ground.spacing
    nearest, known = between._nearest(unit)
    assert known.all()
    value, slope = between._read(unit, nearest)
    np.testing.assert_allclose(value, wave(place[:, 0], 0), atol=0.004 * AMPLITUDE)
    k = 2 * np.pi / PERIOD
    np.testing.assert_allclose(slope[:, 0], AMPLITUDE * k * np.cos(k * place[:, 0]), atol=0.02 * AMPLITUDE)
    np.testing.assert_allclose(slope[:, 1:], 0, atol=0.01 * AMPLITUDE)


@pytest.mark.parametrize("metric", ["displacement", "surface"])
def test_filled_partners_count_only_if_they_are_asked_for(metric):
    ground = prepare_ground(strip(), PLANE, GroundOptions(extent=WHOLE))
    samples = sample_set(ground, 0)
    # All targets but one column are filled; that column's targets know all around them.
    column = np.flatnonzero(~ground.measured & (np.abs(ground.foot[:, 0] - 22) < 0.2))
    filled = np.flatnonzero(~ground.measured & (np.abs(ground.foot[:, 0] - 22) > 0.2))
    state = state_of(ground, samples, filled)
    rim = np.flatnonzero(np.abs(samples.foot[:, 0] - LEFT) < 0.1)
    chosen = {}
    for partners in ("measured", "textured"):
        if metric == "surface":
            compared = SurfaceMetric(ground, samples.part(rim), 3, 1, "cpu", None, partners)
            picks = compared.pick(column, np.full(len(column), 3), state, Selection(), np.zeros(len(column)))
        else:
            compared = DisplacementMetric(ground, samples, 3, 1, "cpu", partners=partners)
            picks = compared.pick(column, np.full(len(column), 3), state, Selection(), np.zeros(len(column)))
            known = compared._known[rim].all(axis=1)
            assert known[5:-5].any() == known[5:-5].all() == (partners == "textured")
        chosen[partners] = picks.sample
    if metric == "surface":
        # Samples at the scan's border alone: half of every neighbourhood falls on what was filled.
        assert (chosen["measured"] < 0).all()
        assert (chosen["textured"][5:-5] >= 0).all()


@pytest.mark.parametrize("metric", ["displacement", "surface"])
def test_textured_partners_complete_everything_from_measured_sources(metric):
    whole = complete_with(
        strip(), PLANE, extent=WHOLE, window=3, rotations=1, metric=metric, partners="textured", seed=1, error=0.01
    )
    assert whole.measured[whole.source].all()
    assert off_the_wave(whole) < 0.1


def test_midpoints_of_every_level_lie_on_their_edges_and_close_the_surface():
    ground = prepare_ground(strip(), PLANE, GroundOptions(extent=WHOLE))
    count = len(ground.measured)
    measured_faces = ground.faces[ground.measured[ground.faces].all(axis=1)]
    coarse = subdivide_measured(ground, 0)
    assert coarse.faces is ground.faces
    edges = unique_edges(measured_faces)
    once, twice = subdivide_measured(ground, 1), subdivide_measured(ground, 2)
    assert len(once.vertex) == count + len(edges)
    inside = once.faces[once.measured[once.faces].all(axis=1)]
    # Euler: every triangle gives four, every edge two and each triangle three more.
    assert len(inside) == 4 * len(measured_faces)
    assert len(twice.vertex) == len(once.vertex) + 2 * len(edges) + 3 * len(measured_faces)

    def area(fine):
        corners = fine.foot[fine.faces]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (cross[:, 2] > 0).all()
        return cross[:, 2].sum() / 2

    for fine in (once, twice):
        assert area(fine) == pytest.approx(area(coarse), rel=1e-9)
        # No crack beside what was cut: the border is the sheet's own, and every edge has at most two triangles.
        border = border_edges(fine.faces)
        ends = fine.foot[np.unique(border)]
        sides = np.abs(ends[:, [0, 0, 1, 1]] - [0, COLUMNS - 1, 0, ROWS - 1])
        assert (sides.min(axis=1) < 1e-6).all()
        used = np.concatenate([fine.faces[:, [0, 1]], fine.faces[:, [1, 2]], fine.faces[:, [2, 0]]])
        assert len(np.unique(used, axis=0)) == len(used)
        corner = fine.foot[fine.faces].mean(axis=1)
        own = ground.foot[ground.faces[fine.face]]
        low, high = own.min(axis=1), own.max(axis=1)
        assert ((corner >= low - 1e-9) & (corner <= high + 1e-9)).all()
    quarter = twice.foot[len(once.vertex) :, :2] * 4
    np.testing.assert_allclose(quarter, np.round(quarter), atol=1e-6)
    assert ground.measured[twice.vertex[count:]].all()
    assert len(sample_set(ground, 2).vertex) == int(ground.measured.sum()) + len(twice.vertex) - count


def test_oversampling_halves_the_window_s_edges_and_the_partners_triangles_of_the_surface_metric():
    ground = prepare_ground(strip(), PLANE, GroundOptions(extent=WHOLE))
    target = np.flatnonzero(
        ~ground.measured & (np.abs(ground.foot[:, 0] - LEFT - 1) < 0.1) & (np.abs(ground.foot[:, 1] - 9) < 0.1)
    )
    reach, around = [], []
    for halvings in range(3):
        metric = SurfaceMetric(ground, sample_set(ground, halvings), 4, 1, "cpu")
        offsets, neighbor, _, _ = metric._rings
        near = neighbor[offsets[target[0]] : offsets[target[0] + 1]]
        known = near[metric._fine.measured[near]]
        reach.append(float(LEFT + 1 - metric._fine.foot[known, 0].min()))
        topology = Topology.of(metric._fine.faces, len(metric._fine.vertex))
        at = topology.incident[topology.face_offsets[100] : topology.face_offsets[101]]
        around.append(float(np.ptp(metric._fine.foot[metric._fine.faces[at]].reshape(-1, 3)[:, 0])))
    # The first edge leads to the scan; of the other three a level halves each.
    np.testing.assert_allclose(reach, [4, 1 + 3 / 2, 1 + 3 / 4], atol=1e-6)
    np.testing.assert_allclose(around, [2, 1, 0.5], atol=1e-6)


@pytest.mark.parametrize("metric", ["displacement", "surface"])
def test_more_oversampling_comes_nearer_to_a_wave_out_of_phase(metric):
    settings = {"spacing": 1.07, "extent": WHOLE, "window": 4, "rotations": 1, "metric": metric, "seed": 1, "tolerance": 0.0}
    plain, once = (complete_with(strip(), PLANE, oversample=n, **settings) for n in (False, True))
    assert off_the_wave(once) < off_the_wave(plain)
    if metric == "displacement":
        twice = complete_with(strip(), PLANE, oversample=2, **settings)
        assert any("oversampled" in note for note in twice.notes)
        assert twice.error[~twice.measured].mean() < 0.8 * once.error[~once.measured].mean()


def test_bootstrapping_keeps_oversampled_candidates():
    scan = strip()
    once = complete_with(scan, PLANE, extent=WHOLE, window=3, rotations=1, oversample=True, seed=1)
    grown = complete_with(scan, PLANE, extent=WHOLE, window=3, rotations=1, oversample=True, bootstrap=True, seed=1)

    def samples(whole):
        note = next(n for n in whole.notes if " samples (oversampled)" in n)
        return int(note.split(" samples")[0].rsplit(" ", 1)[1])

    assert samples(grown) == samples(once) + int((~grown.measured).sum())
    assert grown.measured[grown.source].all()


def test_a_share_of_the_samples_is_compared_on_the_whole_surface():
    scan = strip(height=lambda x, y: wave(x, y) + 0.05 * np.sin(1.9 * y + x))
    whole = complete_with(scan, PLANE, extent=WHOLE, window=3, rotations=1, subsample=0.2, seed=1)
    again = complete_with(scan, PLANE, extent=WHOLE, window=3, rotations=1, subsample=0.2, seed=1)
    assert whole.vertices.tobytes() == again.vertices.tobytes()
    filled = ~whole.measured
    count = int(whole.measured.sum())
    assert any(f" {round(0.2 * count)} samples," in note for note in whole.notes)
    assert len(np.unique(whole.source[filled])) <= round(0.2 * count)
    assert np.std(whole.relief[filled]) == pytest.approx(np.std(whole.relief[whole.measured]), rel=0.3)
    for share in (0.0, 1.5, float("nan")):
        with pytest.raises(intaglio.InputError, match="subsample"):
            intaglio.ReliefSettings(subsample=share)


def test_colour_on_the_surface_is_the_papers_sum():
    def paint(x, y):
        return np.stack([0.2 + 0.6 * (np.sin(x) > 0), 0.1 + 0 * x, 0.5 + 0.4 * np.cos(y)], axis=-1)

    rough = np.random.default_rng(0).normal(0, 0.02, (COLUMNS, ROWS))
    ground = prepare_ground(strip(lambda x, y: wave(x, y) + rough, paint), PLANE, GroundOptions(extent=WHOLE))
    # A few samples, off the scan's border: none of them has a target's colours.
    every = sample_set(ground, 0)
    samples = every.part(np.flatnonzero((every.foot[:, 0] == 7) & (every.foot[:, 1] % 5 == 4) & (every.foot[:, 1] < 15)))
    weight, window = 0.3, 2
    comparison = compare_by(ground, weight)
    metric, blind = (SurfaceMetric(ground, samples, window, 1, "cpu", c) for c in (comparison, None))
    state = state_of(ground, samples)
    graph = ground.topology.graph
    targets = np.flatnonzero(~ground.measured & (graph @ ground.measured.astype(float) > 0))[5:9]
    windows, none = np.full(len(targets), window), np.zeros(len(targets))
    picks = metric.pick(targets, windows, state, Selection(tolerance=0.0), none)
    # On one lattice a neighbour falls on the vertex that lies as far from the sample as it does from the target.
    offsets, neighbor, _, gauss = metric._rings
    shown = encode_srgb(ground.color)
    span = float(np.ptp(ground.height[ground.measured]))
    for target, sample, error in zip(targets, picks.sample, picks.error, strict=True):
        part = slice(offsets[target], offsets[target + 1])
        near, g = neighbor[part], gauss[part]
        known = ground.measured[near]
        near, g = near[known], g[known] / g[known].sum()
        there = samples.foot[sample] + ground.foot[near] - ground.foot[target]
        partner = np.argmin(np.linalg.norm(ground.foot[None] - there[:, None], axis=2), axis=1)
        of_color = (g * ((shown[near] - shown[partner]) ** 2).sum(axis=1) / 3).sum()
        shape = blind.pick(np.array([target]), np.array([window]), state, Selection(tolerance=0.0), np.zeros(1))
        alone = SurfaceMetric(ground, samples.part(np.array([sample])), window, 1, "cpu")
        of_shape = alone.pick(np.array([target]), np.array([window]), state, Selection(tolerance=0.0), np.zeros(1)).error[0]
        assert of_shape >= shape.error[0] * (1 - 1e-5)
        assert of_color > 0.01
        assert error == pytest.approx((1 - weight) * of_shape + weight * span**2 * of_color, rel=1e-3)


def test_colour_decides_on_the_surface_where_relief_says_nothing():
    def stripes(x, y):
        band = (np.floor(x / 4) % 2)[..., None] + 0 * y[..., None]
        return band * (0.8, 0.1, 0.1) + (1 - band) * (0.1, 0.2, 0.7)

    scan = strip(lambda x, y: 0 * x, stripes)
    settings = {"extent": WHOLE, "window": 5, "rotations": 1, "seed": 1, "metric": "surface", "tolerance": 0.0}
    blind, seeing = (complete_with(scan, PLANE, color_weight=w, **settings) for w in (None, 0.8))
    filled = ~seeing.measured
    truth = stripes(np.round(seeing.base[:, 0]), seeing.base[:, 1])
    wrong = [np.abs(whole.color - truth)[filled].mean() for whole in (blind, seeing)]
    assert wrong[1] < 0.02 < wrong[0]


def test_spacing_too_wide_for_the_relief_is_said():
    def said(**options):
        whole = complete_with(strip(), PLANE, extent=WHOLE, window=3, rotations=1, error=0.01, seed=1, **options)
        return [note for note in whole.notes if "Nyquist" in note]

    assert len(said(spacing=4.0)) == 1
    assert "spacing 4" in said(spacing=4.0)[0]
    assert said() == []
    assert said(spacing=1.5) == []


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"partners": "filled"}, "partners"),
        ({"partners": "textured", "refine": 2}, "refine compares with measured"),
        ({"partners": "textured", "search": "approximate"}, "partners='textured' compares every sample"),
        ({"oversample": 9}, "oversample"),
        ({"oversample": -1}, "oversample"),
    ],
)
def test_what_does_not_go_together_is_refused(settings, message):
    with pytest.raises(intaglio.InputError, match=message):
        intaglio.ReliefSettings(**settings)


def test_the_command_takes_the_papers_options(run, tmp_path):
    scan, out = tmp_path / "scan.ply", tmp_path / "whole.ply"
    options = ["--base", "plane", "--spacing", "1.07", "--extent", "holes", "--window", "4", "--rotations", "1", "--seed", "1"]
    words = ["complete", scan, "-o", out, *options, "--refine", "0"]
    chosen = ["--interpolate", "--oversample-levels", "2", "--subsample", "0.9", "--partners", "textured"]
    # A frame around the missing part, so that it is a hole.
    x, y = np.meshgrid(np.arange(float(COLUMNS)), np.arange(float(ROWS)), indexing="ij")
    vertices = np.stack([x, y, wave(x, y)], axis=-1).reshape(-1, 3)
    sheet = Surface(vertices=vertices, faces=grid_faces(COLUMNS, ROWS, False))
    intaglio.write_surface(sheet.part((np.abs(vertices[:, :2] - (22, 8.5)) > (4, 4)).any(axis=1)), scan)
    status, _, errors = run(*words, *chosen)
    assert status == 0, errors
    whole = intaglio.read_surface(out)
    settings = intaglio.ReliefSettings(
        window=4, rotations=1, refine=0, interpolate=True, oversample=2, subsample=0.9, partners="textured"
    )
    prepared = intaglio.prepare_relief(intaglio.read_surface(scan), "plane", spacing=1.07, extent="holes")
    assert whole.vertices.tobytes() == prepared.complete(settings, seed=1).vertices.tobytes()
    status, _, errors = run(*words, "--oversample-levels", "2", "--oversample")
    assert status == 2
    assert "--oversample-levels" in errors
