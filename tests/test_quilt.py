"""Block synthesis: exact facts, the raster-order reference, provenance, seams, tiling, bad input."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from skimage import data
from synthesis_reference import cut_distance, exact_sample, quilt_reference

from intaglio import InputError, Match, quilt
from intaglio.kernels.blocks import BlockLayer, Sample, known_pixels
from intaglio.kernels.launch import set_threads
from intaglio.synthesis.block_size import automatic_block, element_size
from intaglio.synthesis.graph_cut import graph_cut_seams
from intaglio.synthesis.layout import plan_blocks
from intaglio.synthesis.sample import prepare_sample, window_starts

# Quilting as published, which the reference does.
plain = functools.partial(quilt, refine=0)


def copies(sample, result):
    sample = sample[:, :, None] if sample.ndim == 2 else sample
    return sample[result.source[..., 0], result.source[..., 1]]


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("metric", ["absolute", "squared"])
@pytest.mark.parametrize("continuation", ["search", "shortcut"])
def test_waves_give_exactly_what_raster_order_gives(tileable, metric, continuation, device):
    sample = exact_sample((37, 41), 3)
    # A mask bars the continuation of many blocks, so that most are searched.
    mask = np.ones((37, 41), bool)
    mask[18:20, 15:25] = False
    options = {"tileable": tileable, "seed": 3, "mask": mask}
    expected = quilt_reference(
        sample, (61, 70), 11, 4, 0.5, squared=metric == "squared", shortcut=continuation == "shortcut", **options
    )
    found = plain(sample, (61, 70), 11, 4, 0.5, match=Match(metric=metric), continuation=continuation, device=device, **options)
    np.testing.assert_array_equal(found.source, expected)


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize(("block", "overlap"), [(5, 1), (9, 3), (12, 7), (20, 17)])
def test_any_overlap_agrees_with_the_reference(block, overlap, tileable, device):
    sample = exact_sample((30, 26), 2, seed=block)
    expected = quilt_reference(sample, (45, 33), block, overlap, 0.25, seed=1, tileable=tileable)
    options = {"continuation": "search", "seed": 1, "tileable": tileable, "device": device}
    found = plain(sample, (45, 33), block, overlap, 0.25, **options)
    np.testing.assert_array_equal(found.source, expected)


def ramps(shape, maps):
    """Return maps whose differences are nearly equal everywhere: sums of them round worst, and bounds are tightest."""
    y, x = np.indices(shape)
    return np.stack([x + y + 1e-3 * np.random.default_rng(i).random(shape) for i in range(maps)], axis=2)


@pytest.mark.parametrize("texture", ["noise", "ramps"])
@pytest.mark.parametrize("squared", [False, True])
@pytest.mark.parametrize("radius", [-1, 6])
def test_bounds_leave_out_nothing_that_could_be_chosen(texture, squared, radius, device):
    shape = (80, 90)
    sample = prepare_sample(np.random.default_rng(2).random((*shape, 4)) if texture == "noise" else ramps(shape, 24))
    blocks = plan_blocks((150, 170), 24, 10, tileable=False, continued=radius >= 0)
    layers = [
        BlockLayer(
            Sample(sample.features, window_starts(sample.usable, 24)), blocks, squared=squared, tolerance=0.02, shortcut=False,
            radius=radius, uniform=np.random.default_rng(1).random(len(blocks.origin)), device=device, prune=prune,
        )
        for prune in (True, False)
    ]  # fmt: skip
    for layer in layers:
        layer.lay()
    np.testing.assert_array_equal(layers[0].choice, layers[1].choice)
    np.testing.assert_array_equal(layers[0].canvas, layers[1].canvas)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint8])
def test_every_pixel_holds_what_its_source_holds(dtype):
    rng = np.random.default_rng(0)
    sample = (rng.random((40, 50, 7)) * 255).astype(dtype)
    before = sample.copy()
    for options in ({}, {"tileable": True}, {"cut": "graph"}, {"refine": 1}, {"continuation": "avoid"}):
        result = quilt(sample, (90, 70), 14, 5, seed=4, **options)
        assert result.maps.dtype == dtype
        np.testing.assert_array_equal(result.maps, copies(sample, result))
    np.testing.assert_array_equal(sample, before)


def test_a_constant_gives_that_constant():
    for value in (0.0, 7.25, -3e30):
        result = quilt(np.full((20, 20, 2), value), 50, 8, 3)
        assert (result.maps == value).all()


def test_range_and_offset_of_a_map_do_not_matter():
    sample = exact_sample((30, 30), 3)
    scaled = sample.astype(np.float64) * (1, 4096, 0.25) + (0, -512, 8)
    a, b = (quilt(s, 64, 10, 4, seed=2) for s in (sample, scaled))
    np.testing.assert_array_equal(a.source, b.source)


def test_a_map_of_no_weight_does_not_matter():
    sample = exact_sample((30, 30), 2)
    other = np.concatenate([sample, np.random.default_rng(0).random((30, 30, 1), dtype=np.float32)], axis=2)
    a = plain(sample, 64, 10, 4, seed=2)
    b = plain(other, 64, 10, 4, seed=2, match=Match(weights=(1, 1, 0)))
    np.testing.assert_array_equal(a.source, b.source)
    c = plain(other, 64, 10, 4, seed=2, match=sample)
    np.testing.assert_array_equal(a.source, c.source)


def test_seeds_and_threads():
    sample = data.gravel()[:64, :64] / 255.0
    results = []
    for count in (1, 2, 5):
        set_threads(count)
        try:
            results.append(quilt(sample, 150, 16, seed=9, refine=1).source)
        finally:
            set_threads(None)
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])
    assert (quilt(sample, 150, 16, seed=10, refine=1).source != results[0]).any()


def test_the_shortcut_continues_the_sample():
    sample = data.gravel()[:128, :128] / 255.0
    result = quilt(sample, 100, 20, 5, seed=1)
    offset = result.source - np.stack(np.meshgrid(np.arange(100), np.arange(100), indexing="ij"), axis=2)
    first = (offset == offset[0, 0]).all(axis=2)
    # As many blocks as the sample has room for; later neighbours cut into the overlap alone.
    down, right = 15 * ((np.minimum(128 - result.source[0, 0], 100) - 20) // 15 + 1)
    assert first[:down, :right].all()


def test_avoiding_continuation_copies_no_more_than_a_block_and_its_overlaps():
    sample = data.gravel()[:128, :128] / 255.0
    offset = plain(sample, 200, 24, 8, seed=1, continuation="avoid").source
    offset = offset - np.stack(np.meshgrid(np.arange(200), np.arange(200), indexing="ij"), axis=2)
    # Along a row, no piece of one offset is longer than a block.
    changes = (np.diff(offset, axis=1) != 0).any(axis=2)
    for row in changes[::7]:
        runs = np.diff(np.concatenate([[-1], np.flatnonzero(row), [199]]))
        assert runs.max() <= 24


def test_a_masked_pixel_is_never_copied():
    sample = np.random.default_rng(0).random((50, 50, 2))
    mask = np.ones((50, 50), bool)
    mask[20:24, 10:40] = False
    sample[~mask] = np.nan
    for options in ({}, {"refine": 2}, {"tileable": True}):
        result = quilt(sample, 80, 9, 3, mask=mask, seed=1, **options)
        assert mask[result.source[..., 0], result.source[..., 1]].all()
        assert np.isfinite(result.maps).all()


def test_smaller_than_a_block_is_a_piece_of_the_sample():
    sample = np.random.default_rng(0).random((30, 30))
    result = quilt(sample, (5, 8), 12, 4, seed=3)
    y, x = result.source[0, 0]
    np.testing.assert_array_equal(result.maps[..., 0], sample[y : y + 5, x : x + 8])


def test_cuts_run_where_the_error_is_least():
    """The last block's cut, against all paths of a small overlap."""
    error = np.random.default_rng(3).random((6, 4))
    edge = error + np.concatenate([error[:, :1], error[:, :-1]], axis=1)

    def cost(path):
        steps = sum(
            error[a - 1, min(path[a - 1], path[a])] + error[a, min(path[a - 1], path[a])]
            for a in range(1, 6)
            if path[a] != path[a - 1]
        )
        return edge[np.arange(6), path].sum() + steps

    paths = [p for p in itertools.product(range(4), repeat=6) if all(abs(a - b) <= 1 for a, b in itertools.pairwise(p))]
    assert cost(cut_distance(error)) == pytest.approx(min(map(cost, paths)), rel=1e-12)


def test_cuts_lessen_the_seam_and_graphs_no_less():
    sample = data.gravel()[:128, :128] / 255.0
    total = {}
    for cut in ("none", "path", "graph"):
        layer = seams_of(quilt(sample, 200, 24, 8, 0, seed=1, cut=cut, continuation="avoid"))
        total[cut] = layer
    assert total["path"] < 0.75 * total["none"]
    assert total["graph"] < 0.75 * total["none"]


def seams_of(result):
    """Mean jump across seams over mean jump inside copies."""
    place = np.stack(np.meshgrid(*[np.arange(n) for n in result.source.shape[:2]], indexing="ij"), axis=2)
    offset = result.source - place
    seam, inside = [], []
    for axis in (0, 1):
        breaks = (np.diff(offset, axis=axis) != 0).any(axis=2)
        jump = np.abs(np.diff(result.maps, axis=axis)).sum(axis=2)
        seam.append(jump[breaks])
        inside.append(jump[~breaks])
    return np.concatenate(seam).mean() / np.concatenate(inside).mean()


def test_a_graph_cut_is_no_worse_than_any_path():
    rng = np.random.default_rng(0)
    for overlap in ((7, 0, 0, 0), (0, 6, 0, 0)):
        error = rng.random((1, 20, 20))
        kept = graph_cut_seams(error, np.array([overlap]))[0]
        assert kept[~known_pixels(np.array([overlap]), 20)[0]].all()

        def energy(kept, error=error):
            return sum(
                ((error[0] + np.roll(error[0], -1, axis))[tuple(np.s_[:-1] if a == axis else np.s_[:] for a in (0, 1))])[
                    np.diff(kept.astype(int), axis=axis) != 0
                ].sum()
                for axis in (0, 1)
            )

        wide = max(overlap)
        strip = error[0][:, :wide] if overlap[0] else error[0][:wide].T
        along = np.arange(20)[None, :] >= np.maximum(cut_distance(strip), 1)[:, None]
        path = along if overlap[0] else along.T
        assert energy(kept) <= energy(path) + 1e-3


def test_refinement_removes_seams():
    sample = data.gravel()[:128, :128] / 255.0
    cut, refined = (quilt(sample, 256, 24, 8, seed=1, refine=n) for n in (0, 2))
    assert seams_of(refined) < 1.05
    assert seams_of(refined) < 0.8 * seams_of(cut)
    assert abs(refined.maps.std() / sample.std() - 1) < 0.1


@pytest.mark.parametrize("options", [{}, {"refine": 2}, {"cut": "graph"}])
def test_a_tileable_result_has_no_line_where_it_wraps(options):
    sample = data.brick()[:160, :160] / 255.0
    result = quilt(sample, (131, 150), 32, 10, seed=2, tileable=True, **options)
    values = result.maps[..., 0]
    for axis in (0, 1):
        over = np.abs(np.take(values, 0, axis) - np.take(values, -1, axis)).mean()
        inside = np.abs(np.diff(values, axis=axis)).mean()
        assert over < 1.35 * inside


def test_block_from_the_pattern():
    y, x = np.mgrid[:128, :128]
    waves = np.sin(2 * np.pi * x / 20) * np.sin(2 * np.pi * y / 20)
    size, found = element_size(waves[None].astype(np.float32), np.ones(waves.shape, bool))
    # Crossed waves also repeat at half a period along both diagonals.
    assert size == pytest.approx(20 / np.sqrt(2), abs=1.5)
    assert "repeats" in found
    assert automatic_block(np.zeros((1, 40, 40), np.float32), np.ones((40, 40), bool))[0] == 10
    assert quilt(waves, 200).notes[0].startswith("block")


def test_blocks_grow_with_the_texture():
    image = data.gravel()[:256, :256] / 255.0
    usable = np.ones((256, 256), bool)
    fine = automatic_block(image[None].astype(np.float32), usable)[0]
    coarse = automatic_block(np.kron(image[:128, :128], np.ones((2, 2)))[None].astype(np.float32), usable)[0]
    assert 1.5 < coarse / fine < 2.6


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((np.zeros((20, 20)), 50, 30), {}, "larger than the sample"),
        ((np.zeros((20, 20)), 50, 10, 10), {}, "overlap must be"),
        ((np.zeros((20, 20)), 50, 10, 0), {}, "overlap must be"),
        ((np.zeros((20, 20)), 0), {}, "size must be"),
        ((np.zeros((20, 20)), (5, 5, 5)), {}, "size must be"),
        ((np.zeros((20, 20)), 5.5), {}, "size must be"),
        ((np.zeros((0, 20)), 50), {}, "empty"),
        (([], 50), {}, "empty"),
        ((np.zeros((1, 30)), 50), {}, "too small"),
        ((np.full((20, 20), np.nan), 50), {}, "400 of 400 pixels"),
        ((np.array([[0, 1e308], [-1e308, 0]]).repeat(10, 0).repeat(10, 1), 50), {}, "range that is not finite"),
        (([np.zeros((20, 20)), np.zeros((20, 21))], 50), {}, "differ in size: 20 x 20, 20 x 21"),
        ((np.zeros((20, 20), complex), 50), {}, "real numbers"),
        ((np.zeros(20), 50), {}, r"\(H, W\)"),
        ((np.zeros((20, 20)), 50), {"mask": np.zeros((20, 20), bool)}, "leaves no pixel"),
        ((np.zeros((20, 20)), 50, 8), {"mask": np.indices((20, 20)).sum(0) % 5 > 0}, "leaves no block"),
        ((np.zeros((20, 20)), 50), {"mask": np.ones((20, 21), bool)}, "mask must be"),
        ((np.zeros((20, 20)), 50), {"tolerance": -1}, "tolerance"),
        ((np.zeros((20, 20)), 50), {"tolerance": "x"}, "tolerance"),
        ((np.zeros((20, 20)), 50), {"tolerance": 1e29}, "tolerance"),
        ((np.zeros((20, 20)), 50), {"cut": "x"}, "cut must be one of"),
        ((np.zeros((20, 20)), 50), {"continuation": "x"}, "continuation must be"),
        ((np.zeros((20, 20)), 50), {"match": Match(weights=(1, 2))}, "weights must be 1"),
        ((np.zeros((20, 20)), 50), {"match": Match(weights=(0,))}, "weights must be 1"),
        ((np.zeros((20, 20)), 50), {"seed": 1.5}, "seed"),
        ((np.zeros((20, 20)), 50), {"refine": -1}, "refine"),
        ((np.zeros((20, 20)), 6, 10), {"tileable": True}, "smaller than block"),
        ((np.zeros((20, 20)), 50, "big"), {}, "block must be"),
        ((np.zeros((20, 20)), 50), {"device": "cuda:77"}, "device"),
        ((np.zeros((20, 20)), 50), {"match": np.zeros((20, 22))}, "match"),
    ],
)
def test_bad_input_is_named(arguments, options, message):
    with pytest.raises(InputError, match=message):
        quilt(*arguments, **options)


def test_progress_reaches_the_end():
    seen = []
    quilt(np.random.default_rng(0).random((40, 40)), 90, 12, refine=2, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1]
    assert all(a[0] <= b[0] for a, b in itertools.pairwise(seen))


def test_huge_weights_are_only_relative():
    sample = np.random.default_rng(0).random((30, 30, 2))
    a = quilt(sample, 50, 10, match=Match(metric="squared", weights=(1e30, 1e30)), seed=1)
    b = quilt(sample, 50, 10, match=Match(metric="squared"), seed=1)
    np.testing.assert_array_equal(a.source, b.source)


def test_small_blocks_are_refined_as_far_as_they_can_be():
    seen = []
    sample = np.random.default_rng(0).random((30, 30))
    result = quilt(sample, 60, 5, refine=2, progress=lambda done, total: seen.append((done, total)))
    assert result.notes[-1] == "refined, 2 passes with windows of 8 pixels"
    assert seen[-1][0] == seen[-1][1]
    assert quilt(sample[:7, :7], 60, 3, refine=1).notes[-1] == "too small to be refined"


@pytest.mark.parametrize(("size", "block", "overlap"), [(64, 16, 8), (24, 16, 5), (20, 10, 6)])
def test_graph_cuts_close_a_torus_whose_overlaps_meet(size, block, overlap):
    sample = data.gravel()[:64, :64] / 255.0
    wraps = {}
    for name, options in {"path": {"tileable": True}, "graph": {"tileable": True, "cut": "graph"}, "open": {}}.items():
        values = quilt(sample, size, block, overlap, seed=1, **options).maps[..., 0]
        jumps = [np.abs(np.take(values, 0, axis) - np.take(values, -1, axis)).mean() for axis in (0, 1)]
        wraps[name] = np.mean(jumps) / np.abs(np.diff(values, axis=1)).mean()
    assert wraps["graph"] < 1.25 * wraps["path"]
    assert wraps["graph"] < 0.75 * wraps["open"]


@pytest.mark.parametrize(
    "options",
    [
        {"size": (37, 50), "block": 33, "overlap": 1, "continuation": "avoid", "tolerance": 0},
        {"size": (70, 64), "block": 64, "overlap": 32, "cut": "none", "tileable": True, "continuation": "avoid"},
    ],
)
def test_refinement_of_few_windows(options):
    sample = data.gravel()[:64, :64] / 255.0
    result = quilt(sample, refine=2, **options)
    np.testing.assert_array_equal(result.maps, copies(sample, result))


def test_masked_arrays_and_ragged_masks_are_refused():
    sample = np.random.default_rng(0).random((20, 20))
    with pytest.raises(InputError, match="masked array"):
        quilt(np.ma.masked_greater(sample, 0.9), 30)
    with pytest.raises(InputError, match="mask must be"):
        quilt(sample, 30, mask=[[1], [1, 2]])
