"""Colour in the measure, scales, approximate search, chosen parameters, memory."""

from __future__ import annotations

import numpy as np
import pytest
from reliefs import complete_with

import intaglio
from intaglio import Surface
from intaglio.kernels.approximate_search import ApproximateSearch, Patchwork
from intaglio.kernels.location import polar_grid
from intaglio.kernels.neighborhoods import NeighborhoodMatcher
from intaglio.kernels.transfer import encode_srgb
from intaglio.relief.ground.prepare import GroundOptions, prepare_ground
from intaglio.relief.growth import displacement_metric
from intaglio.relief.growth.comparison import compare_by
from intaglio.relief.growth.displacement_metric import DisplacementMetric
from intaglio.relief.growth.levels import band, frames_along
from intaglio.relief.growth.parameters import choose_parameters, direction_share, noise_variance
from intaglio.relief.growth.plan import plan_search
from intaglio.relief.growth.samples import sample_set
from intaglio.relief.growth.settings import Selection
from intaglio.relief.growth.state import State
from intaglio.scenes.patterns import grid_faces, plane_base

PLANE = plane_base()


def sheet(height, columns=48, rows=40, color=None):
    """Return a grid of unit steps with ``height(x, y)``."""
    x, y = np.meshgrid(np.arange(columns, dtype=float), np.arange(rows, dtype=float), indexing="ij")
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    return Surface(
        vertices=vertices, faces=grid_faces(columns, rows, False), color=None if color is None else color(x, y).reshape(-1, 3)
    )


def rings(period):
    """Return bumps in a square lattice."""
    return lambda x, y: np.cos(2 * np.pi * x / period) * np.cos(2 * np.pi * y / period)


def rough(seed=0, waves=40, fastest=1.2):
    """Return stochastic relief without a direction."""
    rng = np.random.default_rng(seed)
    k = rng.normal(size=(waves, 2))
    k *= (rng.uniform(0.3, fastest, waves) / np.linalg.norm(k, axis=1))[:, None]
    phase = rng.uniform(0, 2 * np.pi, waves)
    return lambda x, y: np.sin(k[:, 0] * x[..., None] + k[:, 1] * y[..., None] + phase).sum(axis=-1) / np.sqrt(waves / 2)


def stripes(x, y):
    """Colours that the relief knows nothing of."""
    band_of = (np.floor(x / 4) % 2)[..., None]
    return (band_of * (0.8, 0.1, 0.1) + (1 - band_of) * (0.1, 0.2, 0.7)).astype(np.float32)


def gap(surface, low, high):
    """Return the surface without the columns from ``low`` to ``high``."""
    x = surface.vertices[:, 0]
    return surface.part((x < low) | (x > high))


def test_combined_cost_is_the_papers_sum():
    scan = gap(sheet(rough(), color=stripes), 20, 27)
    ground = prepare_ground(scan, PLANE, GroundOptions(extent="rectangle"))
    comparison = compare_by(ground, 0.3)
    metric = DisplacementMetric(ground, sample_set(ground, False), 3, 1, "cpu", comparison=comparison)
    count = len(ground.measured)
    state = State(
        ground.height, ground.measured.copy(), np.arange(count), np.zeros(count, np.float32), np.zeros(count),
        ground.color, metric.samples.numbers(count),
    )  # fmt: skip
    graph = ground.topology.graph
    targets = np.flatnonzero(~ground.measured & (graph @ ground.measured.astype(float) > 0))[:6]
    picks = metric.pick(targets, np.full(len(targets), 3), state, Selection("near-best", tolerance=0.0), np.zeros(len(targets)))
    span = np.ptp(ground.height[ground.measured])
    shown = encode_srgb(ground.color)
    offsets, ring, _ = polar_grid(3, 1)
    weights = metric._ring_weight
    for target, sample, error in zip(targets, picks.sample, picks.error, strict=True):
        # Grid points that fall on vertices of the unit lattice are enough to compare by hand: rings along the axes.
        value, weight, _ = metric.neighborhoods(np.array([target]), np.array([3]), state)
        points = len(ring)
        own = metric._value[sample].reshape(4, points)
        difference = (value[0].reshape(4, points) - own) ** 2 * weight[0].reshape(4, points)
        factors = np.array([0.7, *3 * [0.1 * span**2]])
        scale = np.array([metric._scale**2 * f / g**2 for f, (g, _) in zip(factors, metric._factors, strict=True)])
        assert error == pytest.approx(float((difference.sum(axis=1) * scale).sum()), rel=1e-3, abs=1e-9)
    assert weights.shape == (len(offsets),)
    # Values are what the vertices hold, in the stated units.
    at = metric.samples.vertex[100]
    held = metric._value[100].reshape(4, -1)[:, 0]
    np.testing.assert_allclose(
        held * metric._scale / [g for g, _ in metric._factors] + metric._levels, [ground.height[at], *shown[at]], atol=1e-4
    )


def test_colour_decides_where_relief_says_nothing():
    scan = gap(sheet(lambda x, y: 0.001 * rough()(x, y), color=stripes), 18.5, 29.5)
    settings = {"extent": "rectangle", "window": 5, "rotations": 1, "seed": 1}
    blind = complete_with(scan, PLANE, **settings)
    seeing = complete_with(scan, PLANE, color_weight=0.8, **settings)
    truth = stripes(np.round(seeing.base[:, 0]), seeing.base[:, 1])
    wrong = [np.abs(w.color - truth)[~w.measured].mean() for w in (blind, seeing)]
    assert wrong[1] < 0.02 < wrong[0]
    filled = ~seeing.measured
    np.testing.assert_array_equal(seeing.color[filled], seeing.color[seeing.source[filled]])
    refined = complete_with(scan, PLANE, color_weight=0.8, refine=2, **settings)
    np.testing.assert_array_equal(refined.color[filled], refined.color[refined.source[filled]])
    assert np.abs(refined.color - truth)[filled].mean() < 0.05
    report = intaglio.assess_relief(refined)
    assert (report.color_emd < 0.5).all()
    assert any("distance of colours" in line for line in report.lines())


@pytest.mark.parametrize("weight", [-0.1, 1.1, float("nan"), "much"])
def test_colour_weights_outside_their_range(weight):
    with pytest.raises(intaglio.InputError, match="color_weight"):
        complete_with(gap(sheet(rough(), color=stripes), 20, 24), PLANE, color_weight=weight, window=2)


def test_colour_weight_without_colours():
    with pytest.raises(intaglio.InputError, match="scan with colours"):
        complete_with(gap(sheet(rough()), 20, 24), PLANE, color_weight=0.5, window=2)


def test_approximate_search_finds_most_of_what_exhaustive_finds(monkeypatch):
    # Few landmarks, so that the descent has to find what they miss.
    monkeypatch.setattr(displacement_metric, "_LANDMARKS", 9_000)
    scan = gap(sheet(rough(fastest=0.6), columns=90, rows=70), 40, 49)
    ground = prepare_ground(scan, PLANE, GroundOptions(extent="rectangle"))
    samples = sample_set(ground, False)
    exact, near = (DisplacementMetric(ground, samples, 4, 6, "cpu", approximate=a, seed=2) for a in (False, True))
    count = len(ground.measured)
    graph = ground.topology.graph
    targets = np.flatnonzero(~ground.measured & (graph @ ground.measured.astype(float) > 0))
    rule = Selection("near-best", tolerance=0.0)
    picks = []
    for metric in (exact, near):
        state = State(
            ground.height, ground.measured.copy(), np.arange(count), np.zeros(count, np.float32), np.zeros(count), None,
            samples.numbers(count),
        )  # fmt: skip
        picks.append(metric.pick(targets, np.full(len(targets), 4), state, rule, np.zeros(len(targets))))
    assert (picks[1].error >= picks[0].error * (1 - 1e-5)).all()
    assert (picks[1].error <= 1.1 * picks[0].error).mean() > 0.5
    # The descent closes more than a third of the gap between the best landmark and the best of all.
    value, weight, _ = near.neighborhoods(targets, np.full(len(targets), 4), state)
    landmarks = near._matcher.match(value, weight, 1.0)
    alone = landmarks.cost[:, 0] * near._scale**2
    assert len(near._landmarks) < 0.3 * len(samples.vertex)
    assert (picks[1].error <= alone * (1 + 1e-5)).all()
    assert (picks[1].error - picks[0].error).mean() < 0.65 * (alone - picks[0].error).mean()


def test_listed_candidates_are_sorted_unique_and_rightly_priced(device):
    rng = np.random.default_rng(0)
    offsets, _, permutation = polar_grid(2, 3)
    count, grid = 400, len(offsets)
    value = rng.normal(size=(count, grid)).astype(np.float32)
    known = np.ones_like(value)
    foot = np.column_stack([np.arange(count), np.zeros((count, 2))]).astype(float)
    u, v = np.tile([1.0, 0, 0], (count, 1)), np.tile([0, 1.0, 0], (count, 1))
    beside = (np.arange(count)[:, None] + np.array([-2, -1, 1, 2])) % count
    search = ApproximateSearch(value, known, permutation, beside, foot, u, v, device)
    target = value[[5, 90]] + 0.01 * rng.normal(size=(2, grid)).astype(np.float32)
    weight = np.full((2, grid), 1 / grid, np.float32)
    offsets_of = np.zeros(count + 1, np.int32)
    around = Patchwork(foot, u, v, offsets_of, np.zeros(0, np.int32), np.full(count, -1), np.zeros(count))
    matches = search.match(np.array([5, 90]), target, weight, around, np.array([[7, -1], [-1, -1]]), 5.0, 1)
    assert matches.candidate[0, 0] == 5
    exact = NeighborhoodMatcher(value, known, permutation, device=device)
    for t in range(2):
        listed = matches.candidate[t, : matches.count[t]]
        assert len(set(listed)) == len(listed)
        price = exact.direct_cost(target[[t]], weight[[t]], listed[None], np.array([len(listed)], np.int32))[0]
        np.testing.assert_allclose(matches.cost[t, : len(listed)], price, rtol=1e-4)
        assert (np.diff(price) >= -1e-6).all()


def test_approximate_results_have_the_same_bits_on_any_number_of_threads():
    from intaglio.kernels.launch import set_threads

    scan = gap(sheet(rough(), columns=60, rows=40), 30, 39)
    results = []
    try:
        for count in (1, 2):
            set_threads(count)
            results.append(
                complete_with(
                    scan, PLANE, extent="rectangle", search="approximate", window=3, rotations=4, refine=2, seed=5, levels=2
                )
            )
    finally:
        set_threads(None)
    assert results[0].vertices.tobytes() == results[1].vertices.tobytes()
    assert any("search: approximate" in note for note in results[0].notes)


def test_bands_keep_long_waves_and_levels_reach_further():
    def two(x, y):
        return np.sin(2 * np.pi * x / 24) + 0.3 * rough(fastest=1.5)(x, y)

    scan = gap(sheet(two, columns=120, rows=40), 48.5, 71.5)
    ground = prepare_ground(scan, PLANE, GroundOptions(extent="rectangle"))
    coarse = band(ground, 10.0)[ground.measured]
    long = np.sin(2 * np.pi * ground.foot[ground.measured, 0] / 24)
    assert np.corrcoef(coarse, long)[0, 1] > 0.95
    settings = {"extent": "rectangle", "window": 4, "rotations": 1, "refine": 2, "seed": 1}
    one, more = (complete_with(scan, PLANE, levels=n, **settings) for n in (1, 3))
    assert more.measured[more.source].all()
    assert more.vertices[: len(scan.vertices)].tobytes() == scan.vertices.tobytes()
    truth = np.sin(2 * np.pi * one.base[:, 0] / 24)
    middle = ~one.measured & (np.abs(one.base[:, 0] - 60) < 6)
    off = [np.sqrt(((w.relief - truth)[middle] ** 2).mean()) for w in (one, more)]
    assert off[1] < 0.75
    assert off[1] < off[0]


@pytest.mark.parametrize("base", ["smooth", PLANE])
def test_too_many_levels_are_named(base):
    scan = sheet(rough(), columns=26, rows=26)
    inside = np.linalg.norm(scan.vertices[:, :2] - 12.5, axis=1) < 4
    with pytest.raises(intaglio.InputError, match="levels=6 are too many"):
        complete_with(scan.part(~inside), base, extent=None if base == "smooth" else "holes", levels=6, window=3)


def test_frames_along_the_coarse_relief_point_up_its_slope():
    ground = prepare_ground(gap(sheet(lambda x, y: x + 0 * y), 20, 26), PLANE, GroundOptions(extent="rectangle"))
    u, v = frames_along(ground, 0.2 * ground.foot[:, 0] + 0.1 * ground.foot[:, 1])
    slope = np.array([2.0, 1.0, 0]) / np.sqrt(5)
    np.testing.assert_allclose(u, np.tile(slope, (len(u), 1)), atol=0.05)
    np.testing.assert_allclose(np.einsum("ij,ij->i", u, v), 0, atol=1e-9)
    whole = complete_with(
        gap(sheet(rough(), columns=60), 30, 38), PLANE, extent="rectangle", levels=2, along_relief=True, window=3, rotations=1
    )
    assert whole.measured[whole.source].all()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"along_relief": True}, "levels=2"),
        ({"levels": 2, "metric": "surface"}, "levels works with"),
        ({"search": "approximate", "metric": "surface"}, "approximate"),
        ({"search": "approximate", "bootstrap": True}, "bootstrap compares"),
        ({"search": "approximate", "rule": "best-percent"}, "best-percent"),
        ({"memory": -1.0}, "memory"),
        ({"memory": "lots"}, "memory"),
        ({"levels": 0}, "levels"),
    ],
)
def test_what_does_not_go_together_is_refused(settings, message):
    with pytest.raises(intaglio.InputError, match=message):
        complete_with(gap(sheet(rough()), 20, 24), PLANE, window=2, rotations=1, extent="rectangle", **settings)


def test_window_comes_from_the_period_or_the_correlation_length():
    for period in (10, 14):
        scan = gap(sheet(rings(period), columns=70, rows=60), 30, 34)
        chosen = choose_parameters(prepare_ground(scan, PLANE, GroundOptions(extent="rectangle")), None, 1.0, 1, 1.0)
        assert 0.6 * period <= chosen.window <= period
        assert "repeats" in chosen.notes[0]
    chosen = choose_parameters(
        prepare_ground(gap(sheet(rough()), 20, 24), PLANE, GroundOptions(extent="rectangle")), None, 1.0, 1, 1.0
    )
    assert "correlation length" in chosen.notes[0]
    assert (
        choose_parameters(
            prepare_ground(gap(sheet(rough()), 20, 24), PLANE, GroundOptions(extent="rectangle")), 3, 0.1, 2, 1.0
        ).notes
        == ()
    )


def test_noise_is_estimated_within_a_third():
    jitter = np.random.default_rng(0).normal(0, 0.05, (48, 40))
    scan = gap(sheet(lambda x, y: rings(16)(x, y) + jitter), 20, 24)
    noise = np.sqrt(noise_variance(prepare_ground(scan, PLANE, GroundOptions(extent="rectangle"))))
    assert noise == pytest.approx(0.05, rel=0.35)


def test_direction_is_seen_in_ridges_and_not_in_bumps():
    ridges = prepare_ground(gap(sheet(lambda x, y: np.sin(y) + 0 * x), 20, 24), PLANE, GroundOptions(extent="rectangle"))
    bumps = prepare_ground(gap(sheet(rings(8)), 20, 24), PLANE, GroundOptions(extent="rectangle"))
    assert direction_share(ridges) > 0.9
    assert direction_share(bumps) < 0.25
    assert choose_parameters(ridges, 3, 1.0, None, 1.0).rotations == 1
    assert choose_parameters(bumps, 3, 1.0, None, 1.0).rotations == 12


def test_a_small_memory_thins_and_chunks_but_never_fails():
    scan = gap(sheet(rough(), columns=100, rows=60), 40, 52)
    ground = prepare_ground(scan, PLANE, GroundOptions(extent="rectangle"))
    samples = sample_set(ground, True)
    plan = plan_search(ground, samples, 200, 12, "auto", 1e-3, 0)
    assert plan.approximate
    assert not plan.keep_grids
    assert len(plan.samples.vertex) == 2000
    assert any("exceeded" in note for note in plan.notes)
    roomy = plan_search(ground, samples, 200, 12, "auto", 64.0, 0)
    assert roomy.keep_grids
    assert roomy.samples is samples
    tight = complete_with(scan, PLANE, extent="rectangle", window=4, rotations=6, memory=0.01, seed=1, refine=1)
    loose = complete_with(scan, PLANE, extent="rectangle", window=4, rotations=6, seed=1, refine=1, search="approximate")
    assert tight.measured[tight.source].all()
    ratio = tight.error[~tight.measured].mean() / loose.error[~loose.measured].mean()
    assert ratio < 3


def test_grids_located_anew_give_the_same_bits():
    ground = prepare_ground(gap(sheet(rough()), 20, 28), PLANE, GroundOptions(extent="rectangle"))
    samples = sample_set(ground, False)
    targets = np.flatnonzero(~ground.measured)
    count = len(ground.measured)
    state = State(
        ground.height, np.ones(count, bool), np.arange(count), np.zeros(count, np.float32), np.zeros(count), None,
        samples.numbers(count),
    )  # fmt: skip
    held, anew = (DisplacementMetric(ground, samples, 3, 2, "cpu", keep_grids=keep) for keep in (True, False))
    for a, b in zip(
        held.neighborhoods(targets, np.full(len(targets), 3), state),
        anew.neighborhoods(targets, np.full(len(targets), 3), state),
        strict=True,
    ):
        np.testing.assert_array_equal(a, b)
