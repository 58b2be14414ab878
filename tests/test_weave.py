"""Synthesis by coherent pieces: the kernels against NumPy, exact facts, and quality beside plain blocks."""

import numpy as np
import pytest
from skimage import data

import intaglio
from intaglio import InputError, WeaveOptions, quilt, weave
from intaglio.kernels.launch import set_threads
from intaglio.kernels.patch_field import PatchField, patch_grid
from intaglio.kernels.patch_match import SIDE, STRIDE
from intaglio.synthesis.coherent.joining import join_pieces
from intaglio.synthesis.coherent.levels import broken_patches, covered_pixels, refine_source
from intaglio.synthesis.result import pixel_positions
from intaglio.synthesis.sample import window_starts
from intaglio.synthesis.trial import patch_distance

BRICK = data.brick()[:256, :256].astype(np.float32) / 255


def two_pieces(shape, sample_shape, rng):
    """Provenance whose left and right halves come from two places."""
    height, width = shape
    source = pixel_positions(shape)
    for half in (slice(0, width // 2), slice(width // 2, None)):
        corner = [rng.integers(0, n - m + 1) for n, m in zip(sample_shape, (height, width), strict=True)]
        source[:, half] += np.array(corner, np.int32)
    return source


def field_of(sample, canvas, source, *, wrap=False, usable=None, device="cpu"):
    usable = np.ones(sample.shape[1:], bool) if usable is None else usable
    active = broken_patches(source, wrap)
    covered = covered_pixels(active, source.shape[:2], wrap)
    starts = window_starts(usable, SIDE)
    made = PatchField(sample, usable, starts, canvas, source, covered, np.flatnonzero(active), wrap, device, len(sample))
    return made, active, covered


def costs_by_numpy(sample, canvas, field, wrap):
    """Squared differences of every patch of the canvas and its match."""
    padded = np.pad(canvas, ((0, 0), (0, SIDE), (0, SIDE)), mode="wrap") if wrap else canvas
    rows, columns = patch_grid(canvas.shape[1:], wrap)
    found = []
    for k, (y, x) in enumerate(field):
        top, left = STRIDE * (k // columns), STRIDE * (k % columns)
        here = padded[:, top : top + SIDE, left : left + SIDE].astype(np.float64)
        found.append(((here - sample[:, y : y + SIDE, x : x + SIDE]) ** 2).sum())
    return np.array(found).reshape(rows * columns)


def vote_by_numpy(sample, field, weight, shape, wrap):
    falloff = np.hanning(SIDE + 2)[1:-1]
    rows, columns = patch_grid(shape, wrap)
    total, weights = np.zeros((len(sample), *shape)), np.zeros(shape)
    for k, (y, x) in enumerate(field):
        for dy in range(SIDE):
            for dx in range(SIDE):
                v, u = (STRIDE * (k // columns) + dy) % shape[0], (STRIDE * (k % columns) + dx) % shape[1]
                w = weight[k] * falloff[dy] * falloff[dx]
                total[:, v, u] += w * sample[:, y + dy, x + dx]
                weights[v, u] += w
    assert rows * columns == len(field)
    return total / np.maximum(weights, 1e-30)


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("maps", [1, 3])
def test_a_sweep_never_costs_more_and_says_what_it_costs(device, wrap, maps):
    rng = np.random.default_rng(3)
    sample = rng.random((maps, 40, 44)).astype(np.float32)
    source = two_pieces((24, 26), (40, 44), rng)
    canvas = sample[:, source[..., 0], source[..., 1]]
    field, active, _ = field_of(sample, canvas, source, wrap=wrap, device=device)
    before = costs_by_numpy(sample, canvas, field.field, wrap)
    for turn in range(3):
        field.sweep(jump=1, chances=4, radius=20, evenness=0.0, seed=turn)
        after = costs_by_numpy(sample, canvas, field.field, wrap)
        np.testing.assert_allclose(field.cost[active.ravel()], after[active.ravel()], rtol=1e-5, atol=1e-5)
        assert (after <= before + 1e-5).all()
        before = after


def test_sweeps_find_the_nearest_patches(device):
    """Of a smooth sample nearly all patches find their best match; noise has no neighbours to learn from."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:48, :48]
    sample = np.stack([np.sin(y / 5) + np.cos(x / 7), np.sin((x + 2 * y) / 9)]).astype(np.float32)
    source = two_pieces((24, 24), (48, 48), rng)
    canvas = sample[:, source[..., 0], source[..., 1]] + 0.05 * rng.random((2, 24, 24)).astype(np.float32)
    field, active, _ = field_of(sample, canvas, source, device=device)
    for turn in range(8):
        field.sweep(jump=1 + turn % 2, chances=6, radius=24, evenness=0.0, seed=turn)
    windows = np.lib.stride_tricks.sliding_window_view(sample, (SIDE, SIDE), axis=(1, 2))
    columns = patch_grid((24, 24), False)[1]
    searched = np.flatnonzero(active.ravel())
    least = []
    for k in searched:
        top, left = STRIDE * (k // columns), STRIDE * (k % columns)
        here = canvas[:, top : top + SIDE, left : left + SIDE]
        least.append(((windows - here[:, None, None]) ** 2).sum(axis=(0, 3, 4)).min())
    assert field.cost[searched].mean() <= 1.2 * np.mean(least)
    assert np.median(field.cost[searched] / least) < 1.02


@pytest.mark.parametrize("wrap", [False, True])
def test_the_vote_is_the_weighted_mean(device, wrap):
    rng = np.random.default_rng(8)
    sample = rng.random((2, 30, 30)).astype(np.float32)
    source = two_pieces((18, 20), (30, 30), rng)
    canvas = sample[:, source[..., 0], source[..., 1]]
    field, _, covered = field_of(sample, canvas, source, wrap=wrap, device=device)
    field.sweep(jump=1, chances=4, radius=10, evenness=0.0, seed=0)
    weight = rng.random(len(field.field)).astype(np.float32) + 0.1
    field.vote(weight)
    expected = vote_by_numpy(sample, field.field, weight, (18, 20), wrap)
    np.testing.assert_allclose(field.canvas[:, covered], expected[:, covered], atol=2e-6)
    np.testing.assert_array_equal(field.canvas[:, ~covered], canvas[:, ~covered])


def border_total(sample, source):
    """Kwatra's cost over all borders, where both places lie inside the sample."""
    total = 0.0
    for axis in (0, 1):
        step = np.array([1, 0]) if axis == 0 else np.array([0, 1])
        p = source[:-1] if axis == 0 else source[:, :-1]
        q = source[1:] if axis == 0 else source[:, 1:]
        broken = ((q - p) != step).any(axis=2)
        p, q = p[broken], q[broken]
        a = np.clip(q - step, 0, np.array(sample.shape[1:]) - 1)
        b = np.clip(p + step, 0, np.array(sample.shape[1:]) - 1)

        def at(place):
            return sample[:, place[:, 0], place[:, 1]]

        total += float(((at(p) - at(a)) ** 2 + (at(b) - at(q)) ** 2).sum())
    return total


def test_borders_move_to_where_they_cost_less(device):
    sample = BRICK[None, :96, :96]
    source = two_pieces((64, 64), (96, 96), np.random.default_rng(2))
    canvas = sample[:, source[..., 0], source[..., 1]]
    field, _, covered = field_of(sample, canvas, source, device=device)
    field.copy(6, 0.0, 1e-4)
    assert border_total(sample, field.source) < 0.8 * border_total(sample, source)
    np.testing.assert_array_equal(field.source[~covered], source[~covered])


def test_active_patches_are_those_over_borders():
    source = pixel_positions((20, 22))
    assert not broken_patches(source, False).any()
    source[:, 11:] += 3
    active = broken_patches(source, False)
    left = STRIDE * np.arange(active.shape[1])
    np.testing.assert_array_equal(active, np.broadcast_to((left <= 10) & (left + SIDE > 11), active.shape))
    covered = covered_pixels(active, (20, 22), False)
    np.testing.assert_array_equal(covered[0], (np.arange(22) >= 4) & (np.arange(22) < 18))


def test_a_finer_level_keeps_to_usable_pixels():
    usable = np.ones((9, 9), bool)
    usable[:4, :4] = False
    fine = refine_source(pixel_positions((5, 5)), (9, 10), usable)
    assert fine.shape == (9, 10, 2)
    assert usable[fine[..., 0], fine[..., 1]].all()
    np.testing.assert_array_equal(fine[5:9, 5:9], pixel_positions((9, 9))[5:, 5:])


@pytest.mark.parametrize("wrap", [False, True])
def test_pieces_of_a_slope_are_joined_without_a_step(wrap):
    """A ramp copied in two pieces of different height: what is left over their border is the ramp's own step."""
    plane = np.tile(np.arange(80.0), (60, 1))
    source = pixel_positions((40, 40))
    source[:, 20:, 1] += 17
    copied = plane[source[..., 0], source[..., 1]]
    joined = copied + next(join_pieces([plane], np.ones(plane.shape, bool), source, reach=1e4, smooth=0.0, wrap=wrap))
    if not wrap:
        np.testing.assert_allclose(np.diff(joined, axis=1), 1, atol=1e-3)
    assert np.abs(np.diff(copied, axis=1)).max() == 18
    assert np.abs(np.diff(joined, axis=1)).max() < 2.5
    (still,) = join_pieces([plane], np.ones(plane.shape, bool), pixel_positions(plane.shape), reach=8, smooth=2.0, wrap=False)
    assert not still.any()


def test_a_constant_stays_constant_and_copies_are_exact():
    made = weave(np.full((70, 60), 0.25), (90, 100), device="cpu")
    assert (made.maps == 0.25).all()
    sample = (BRICK[:120, :120] * 255).astype(np.uint8)
    exact = weave(sample, (150, 130), exact=True, seed=3)
    assert exact.moved is None
    assert exact.maps.dtype == np.uint8
    np.testing.assert_array_equal(exact.maps[..., 0], exact.copy_of(sample))
    joined = weave(sample, (150, 130), seed=3)
    np.testing.assert_array_equal(joined.source, exact.source)
    np.testing.assert_array_equal(joined.maps.astype(int), exact.maps + joined.moved.astype(int))
    assert 0 < np.abs(joined.moved).mean() < 4


def test_the_same_seed_gives_the_same_bits_whatever_the_threads():
    sample = BRICK[:140, :140]
    first = weave(sample, 200, seed=5)
    set_threads(1)
    try:
        again = weave(sample, 200, seed=5)
    finally:
        set_threads(None)
    np.testing.assert_array_equal(first.maps, again.maps)
    np.testing.assert_array_equal(first.source, again.source)
    assert (weave(sample, 200, seed=6).source != first.source).any()


def test_a_tile_closes():
    sample = data.grass()[:200, :200].astype(np.float32) / 255
    # One line of a texture differs from the next by chance: on average, the line where it wraps is like any.
    wraps = []
    for seed in range(5):
        made = weave(sample, (180, 220), tileable=True, seed=seed)
        assert made.tileable
        wraps.append(intaglio.assess_synthesis(sample, made).wrap)
    assert np.mean(wraps) < 1.1
    with pytest.raises(InputError, match="smaller than block"):
        weave(sample, (40, 220), 60, tileable=True)


def test_only_usable_pixels_are_copied():
    sample = data.grass()[:200, :200].astype(np.float32) / 255
    y, x = np.mgrid[:200, :200]
    mask = np.hypot(y - 100, x - 100) < 90
    sample[~mask] = np.nan
    made = weave(sample, 240, mask=mask, seed=1)
    assert mask[made.source[..., 0], made.source[..., 1]].all()
    assert np.isfinite(made.maps).all()
    lines = np.zeros((200, 200), bool)
    lines[::3] = True
    with pytest.raises(InputError, match="mask leaves no block"):
        weave(sample, 240, mask=mask & lines, seed=1)


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (7, 7), (33, 65)])
def test_results_of_any_size(shape):
    made = weave(BRICK[:60, :70], shape, seed=1)
    assert made.maps.shape == (*shape, 1)


def test_small_samples():
    rng = np.random.default_rng(0)
    assert weave(rng.random((2, 2)), 20).maps.shape == (20, 20, 1)
    assert weave(rng.random((5, 90)), 40).maps.shape == (40, 40, 1)
    with pytest.raises(InputError, match="too small for blocks"):
        weave(rng.random((1, 50)), 20)
    with pytest.raises(InputError, match="larger than the sample"):
        weave(rng.random((20, 50)), 20, 30)


def test_heights_have_no_cliffs():
    """Pieces of a hilly surface: their heights are joined by differences, so that no step exceeds the sample's."""
    y, x = np.mgrid[:160, :160] / 160
    rng = np.random.default_rng(4)
    height = (2 * y + np.sin(9 * x + 4 * y) + 0.05 * rng.random((160, 160))).astype(np.float32)
    height = (height - height.min()) / np.ptp(height)
    material = intaglio.Material({"displacement": height}, {"displacement": "hill_disp.png"}, {"displacement": 16})
    made = intaglio.synthesize(material, 320, seed=2)
    steps = [np.abs(np.diff(plane, axis=axis)).max() for plane in (made.maps[..., 0], made.copy_of(height)) for axis in (0, 1)]
    own = max(np.abs(np.diff(height, axis=axis)).max() for axis in (0, 1))
    assert max(steps[2:]) > 2 * own
    assert max(steps[:2]) < 1.1 * own


def test_normals_stay_unit():
    rng = np.random.default_rng(1)
    normal = rng.normal(size=(100, 100, 3)) + (0, 0, 3)
    normal = (normal / np.linalg.norm(normal, axis=2, keepdims=True) + 1) / 2
    material = intaglio.Material({"normal": normal.astype(np.float32)}, {"normal": "n_normal.png"}, {"normal": 8})
    made = intaglio.synthesize(material, 150, seed=2)
    np.testing.assert_allclose(np.linalg.norm(2 * made.maps - 1, axis=2), 1, atol=1e-5)


def test_it_is_more_alike_and_more_even_than_blocks():
    """By distributions of patches and by use, on a wall that plain blocks don't continue."""
    sample = BRICK[None]
    everywhere = np.ones(BRICK.shape, bool)
    woven = weave(BRICK, 512, seed=1)
    laid = quilt(BRICK, 512, seed=1)

    def off(made):
        return patch_distance(np.moveaxis(made.maps, 2, 0), sample, everywhere, 7)

    assert off(woven) < 0.8 * off(laid)
    assert intaglio.assess_synthesis(BRICK, woven).repetition < intaglio.assess_synthesis(BRICK, laid).repetition


def test_it_is_the_default_of_synthesize():
    sample = BRICK[:90, :90]
    first = intaglio.synthesize(sample, 120, seed=1)
    np.testing.assert_array_equal(first.maps, weave(sample, 120, seed=1).maps)
    assert intaglio.synthesize(sample, 120, WeaveOptions(exact=True), seed=1).moved is None


def test_progress_goes_up_to_its_total():
    steps = []
    weave(BRICK[:120, :120], 160, progress=lambda done, total: steps.append((done, total)))
    assert steps == sorted(steps)
    assert steps[-1][0] == steps[-1][1]
