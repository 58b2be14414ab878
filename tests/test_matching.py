"""Both metrics against brute force; the two engines against each other."""

from __future__ import annotations

import numpy as np
import pytest
from reference import displacement_costs, surface_costs

from intaglio.kernels.location import polar_grid
from intaglio.kernels.neighborhoods import NeighborhoodMatcher
from intaglio.relief.ground.prepare import prepare_ground
from intaglio.relief.growth.propagation import choose_near_best
from intaglio.relief.growth.samples import sample_set
from intaglio.relief.growth.settings import Selection
from intaglio.relief.growth.state import State
from intaglio.relief.growth.surface_metric import SurfaceMetric
from intaglio.scenes.patterns import cylinder_base


def case(seed=0, samples=90, targets=12, window=3, rotations=4):
    rng = np.random.default_rng(seed)
    _, ring, permutation = polar_grid(window, rotations)
    grid = len(ring)
    sample = rng.normal(size=(samples, grid)).astype(np.float32)
    exists = (rng.uniform(size=(samples, grid)) > 0.004).astype(np.float32)
    # Targets are noisy copies of samples, so that matches are close and the expansion cancels.
    value = sample[rng.integers(0, samples, targets)] + rng.normal(0, 0.02, (targets, grid)).astype(np.float32)
    weight = rng.uniform(0.1, 1, (targets, grid)) * (rng.uniform(size=(targets, grid)) > 0.4)
    weight = (weight / weight.sum(axis=1, keepdims=True)).astype(np.float32)
    return value.astype(np.float32), weight, sample, exists, permutation


@pytest.mark.parametrize("engine", ["blas", "warp"])
def test_costs_agree_with_brute_force(engine, device):
    if engine == "blas" and device != "cpu":
        pytest.skip("BLAS runs on the CPU")
    value, weight, sample, exists, permutation = case()
    matcher = NeighborhoodMatcher(sample, exists, permutation, device=device, engine=engine)
    matches = matcher.match(value, weight, factor=3.0)
    for t in range(len(value)):
        expected = displacement_costs(value[t], weight[t], sample, exists > 0, permutation)
        within = np.flatnonzero(expected <= 3.0 * expected.min())
        n = matches.count[t]
        listed = matches.candidate[t, :n]
        assert set(within) <= set(listed.tolist())
        # The direct form sums float32 inputs in double precision: only the order of summation differs.
        np.testing.assert_allclose(matches.cost[t, :n], expected[listed], rtol=1e-12)


def test_engines_choose_the_same(device):
    value, weight, sample, exists, permutation = case(seed=3, samples=333, targets=40, rotations=6)
    draw = np.random.default_rng(1).uniform(size=len(value))
    chosen = []
    for engine in ["blas", "warp"] if device == "cpu" else ["warp"]:
        m = NeighborhoodMatcher(sample, exists, permutation, device=device, engine=engine).match(value, weight, 1.3)
        chosen.append(choose_near_best(m.candidate, m.cost, m.count, 0.3, draw))
    for other in chosen[1:]:
        np.testing.assert_array_equal(chosen[0][0], other[0])
        np.testing.assert_array_equal(chosen[0][1], other[1])
    assert (chosen[0][0] >= 0).all()


def test_permuting_the_candidates_changes_nothing(device):
    value, weight, sample, exists, permutation = case(seed=5)
    order = np.random.default_rng(2).permutation(len(sample))
    plain = NeighborhoodMatcher(sample, exists, permutation, device=device).match(value, weight, 1.0)
    mixed = NeighborhoodMatcher(sample[order], exists[order], permutation, device=device).match(value, weight, 1.0)
    best = [choose_near_best(m.candidate, m.cost, m.count, 0.0, np.zeros(len(value)))[0] for m in (plain, mixed)]
    count = len(sample)
    np.testing.assert_array_equal(best[0] % count, order[best[1] % count])
    np.testing.assert_array_equal(best[0] // count, best[1] // count)


def test_a_target_that_no_sample_can_answer_has_no_match(device):
    value, weight, sample, exists, permutation = case()
    matcher = NeighborhoodMatcher(sample, np.zeros_like(exists), permutation, device=device)
    matches = matcher.match(value, weight)
    assert (matches.count == 0).all()
    chosen, cost = choose_near_best(matches.candidate, matches.cost, matches.count, 0.1, np.zeros(len(value)))
    assert (chosen == -1).all()
    assert np.isinf(cost).all()


def test_best_percent_is_among_the_best_percent(device):
    value, weight, sample, exists, permutation = case(samples=200)
    matcher = NeighborhoodMatcher(sample, exists, permutation, device=device)
    draw = np.random.default_rng(0).uniform(size=len(value))
    picked = matcher.pick_ranked(value, weight, 0.10, draw)
    for t in range(len(value)):
        expected = np.sort(displacement_costs(value[t], weight[t], sample, exists > 0, permutation))
        viable = np.isfinite(expected).sum()
        rank = int(draw[t] * np.ceil(0.10 * viable))
        assert picked.cost[t, 0] == pytest.approx(expected[rank], rel=1e-5)


def test_more_equal_candidates_than_the_list_holds(device):
    _, _, permutation = polar_grid(2, 1)
    grid = permutation.shape[1]
    sample = np.zeros((5000, grid), np.float32)
    weight = np.full((1, grid), 1 / grid, np.float32)
    matcher = NeighborhoodMatcher(sample, np.ones_like(sample), permutation, device=device)
    matches = matcher.match(np.zeros((1, grid), np.float32), weight)
    assert 30 < matches.count[0] <= 256
    listed = matches.candidate[0, : matches.count[0]]
    assert len(set(listed.tolist())) == len(listed)
    # Thinned, not cut off: candidates from all over remain, the best among them.
    assert listed.min() < 500
    assert listed.max() > 4500


def test_surface_metric_agrees_with_brute_force(wave_tube, device):
    scan, _ = wave_tube
    rough = np.random.default_rng(3).normal(0, 0.05, len(scan.vertices))
    outward = scan.vertices * (1, 1, 0) / np.linalg.norm(scan.vertices[:, :2], axis=1, keepdims=True)
    scan = type(scan)(vertices=scan.vertices + rough[:, None] * outward, faces=scan.faces)
    ground = prepare_ground(scan, cylinder_base())
    samples = sample_set(ground, False)
    window, rotations = 2, 2
    metric = SurfaceMetric(ground, samples, window, rotations, device)
    count = len(ground.measured)
    state = State(
        ground.height,
        ground.measured.copy(),
        np.arange(count, dtype=np.int32),
        np.zeros(count),
        np.zeros(count),
        None,
        np.full(count, -1),
    )
    targets = np.flatnonzero(~ground.measured & (np.abs(ground.foot[:, 2] - 8) < 1.5))[:4]
    near = [t for t in targets if ground.measured[ground.faces[(ground.faces == t).any(axis=1)]].any()]
    assert near
    picks = metric.pick(
        np.array(near), np.full(len(near), window), state, Selection("near-best", tolerance=0.0), np.zeros(len(near))
    )
    sigma = (2 * window + 1) / 6.4 * ground.spacing
    candidates = [
        (samples.foot[s], samples.u[s], samples.v[s], 2 * np.pi * q / rotations)
        for q in range(rotations)
        for s in range(len(samples.vertex))
    ]
    for k, t in enumerate(near):
        costs = surface_costs(ground, ground.height, ground.measured, ground.measured, t, window, sigma, candidates)
        best = min(costs)
        # Single precision positions at unit relief scale.
        assert picks.error[k] == pytest.approx(best, rel=2e-4, abs=1e-9)
        chosen = round(picks.rotation[k] * rotations / (2 * np.pi)) * len(samples.vertex) + picks.sample[k]
        assert costs[chosen] == pytest.approx(best, rel=2e-4, abs=1e-9)


def test_more_near_best_candidates_than_the_list_holds_have_the_same_chance(device):
    _, _, permutation = polar_grid(1, 1)
    grid = permutation.shape[1]
    # One best, 999 others within a tenth of it in a thousand steps, and 1,000 beyond.
    cost = np.concatenate([[1.0], np.linspace(1.0, 1.09, 999), np.full(1000, 1.3)])
    sample = np.tile(np.sqrt(cost)[:, None], (1, grid)).astype(np.float32)
    matcher = NeighborhoodMatcher(sample, np.ones_like(sample), permutation, device=device)
    targets = 4000
    value, weight = np.zeros((targets, grid), np.float32), np.full((targets, grid), 1 / grid, np.float32)
    draw = np.random.default_rng(0).uniform(size=targets)
    matches = matcher.match(value, weight, 1.1, draw)
    chosen, error = choose_near_best(matches.candidate, matches.cost, matches.count, 0.1, draw, matches.spare)
    assert chosen.max() < 1000
    assert error.max() <= 1.1
    # Tenths of the 1,000 that qualify: 400 each are expected, with a standard deviation of 19.
    tenths = np.bincount(chosen // 100, minlength=10)
    assert tenths.min() > 320
    assert tenths.max() < 480
    # The best has the chance of any other, though it is in every list.
    assert (matches.cost.min(axis=1) < 1.0001).all()
    assert (chosen == 0).sum() < 20


@pytest.mark.parametrize("engine", ["blas", "warp"])
def test_the_best_of_too_many_is_never_thinned_away(engine, device):
    if engine == "blas" and device != "cpu":
        pytest.skip("BLAS runs on the CPU")
    _, _, permutation = polar_grid(1, 1)
    grid = permutation.shape[1]
    rng = np.random.default_rng(0)
    sample = (1 + 1e-4 * rng.normal(size=(30_000, grid))).astype(np.float32)
    weight = np.full((20, grid), 1 / grid, np.float32)
    value = rng.normal(0, 1e-4, (20, grid)).astype(np.float32)
    matcher = NeighborhoodMatcher(sample, np.ones_like(sample), permutation, device=device, engine=engine)
    matches = matcher.match(value, weight, 1.5)
    expected = np.array(
        [
            displacement_costs(v, w, sample, np.ones_like(sample) > 0, permutation).min()
            for v, w in zip(value, weight, strict=True)
        ]
    )
    # Rounding in the expansion may hide which of the near-equal is least, by no more than its slack.
    np.testing.assert_allclose(matches.cost.min(axis=1), expected, rtol=2e-5)
