"""Pixel synthesis: exact facts, the exhaustive reference, filling, provenance, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from skimage import data
from synthesis_reference import best_neighbourhood

from intaglio import InputError, Match, grow
from intaglio.kernels.launch import set_threads
from intaglio.synthesis.pyramid import halve_planes, level_shape


@pytest.fixture
def searches(monkeypatch):
    """Keep what every level was given and gave, coarsest first."""
    import sys

    module = sys.modules["intaglio.synthesis.growing"]
    kept = []

    class Kept(module.WindowSearch):
        def __init__(self, level, coarse, candidates, rows, usable, **options):
            super().__init__(level, coarse, candidates, rows, usable, **options)
            self.given = (level, coarse, candidates)
            kept.append(self)

        def synthesise(self, targets, waves, exhaustive, uniform, done=None):
            self.targets, self.waves, self.exhaustive = targets, waves, exhaustive
            super().synthesise(targets, waves, exhaustive, uniform, done)

    monkeypatch.setattr(module, "WindowSearch", Kept)
    return kept


def assert_best(search, window, squared, wrap=False):
    """Check that every pixel holds one of the sample's best by the exhaustive reference, given what was there."""
    level, coarse, candidates = search.given
    canvas, width = search.canvas, level.planes.shape[2]
    shape, reach = canvas.shape, window // 2
    flat = level.planes.reshape(len(level.planes), -1)
    order = np.full(shape, -1)
    order[tuple(search.targets.T)] = np.repeat(np.arange(len(search.waves) - 1), np.diff(search.waves))
    checked = 0
    for y, x in search.targets[:: max(1, len(search.targets) // 150)]:
        known, above = [], []
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                a, b = ((y + dy) % shape[0], (x + dx) % shape[1]) if wrap else (y + dy, x + dx)
                if 0 <= a < shape[0] and 0 <= b < shape[1] and order[a, b] < order[y, x]:
                    known.append(((dy, dx), flat[:, canvas[a, b]]))
        if coarse is not None:
            rows, columns = coarse.canvas.shape
            for dy in (-1, 0, 1):
                for dx in (-1, 0, 1):
                    a, b = y // 2 + dy, x // 2 + dx
                    if wrap:
                        a, b = a % rows, b % columns
                    if 0 <= a < rows and 0 <= b < columns:
                        above.append(((dy, dx), coarse.planes.reshape(len(flat), -1)[:, coarse.canvas[a, b]]))
        if not known and not above:
            continue
        planes_above = None if coarse is None else coarse.planes
        _, best = best_neighbourhood(level.planes, planes_above, candidates, known, above, squared)
        assert divmod(int(canvas[y, x]), width) in best
        checked += 1
    assert checked > 20


@pytest.mark.parametrize("metric", ["absolute", "squared"])
@pytest.mark.parametrize("maps", [1, 3, 6])
@pytest.mark.parametrize("tileable", [False, True])
def test_the_search_finds_what_comparing_all_finds(metric, maps, tileable, searches, device):
    rng = np.random.default_rng(maps)
    base = data.gravel()[:48, :60].astype(float)
    sample = np.stack([np.roll(base, 5 * i, 0) * (-1) ** i + 20 * rng.random(base.shape) for i in range(maps)], axis=2)
    grow(sample, (37, 41), match=Match(metric=metric), tileable=tileable, seed=2, levels=2, device=device)
    assert len(searches) == 2
    for search in searches:
        assert_best(search, 5, metric == "squared", tileable)


def test_filling_finds_what_comparing_all_finds(searches):
    image = data.brick()[:70, :80] / 255.0
    missing = np.zeros(image.shape, bool)
    missing[20:45, 30:60] = True
    grow(image, missing=missing, levels=2, window=3)
    for search in searches:
        assert_best(search, 7, False)


def test_rings_are_filled_from_outside(searches):
    missing = np.zeros((60, 60), bool)
    missing[20:40, 15:45] = True
    grow(data.gravel()[:60, :60] / 255.0, missing=missing, levels=1)
    found = searches[0]
    ring = np.minimum.reduce(
        [found.targets[:, 0] - 19, 40 - found.targets[:, 0], found.targets[:, 1] - 14, 45 - found.targets[:, 1]]
    )
    assert (np.diff(ring) >= 0).all()
    assert ring.max() == 10


def test_pixels_not_searched_continue_their_left_neighbour(searches):
    sample = data.gravel()[:64, :64] / 255.0
    result = grow(sample, 80, exhaustive=0.4, seed=1)
    last = searches[-1]
    assert last.exhaustive.mean() == pytest.approx(0.4, abs=0.03)
    searched = np.zeros((80, 80), bool)
    searched[tuple(last.targets.T)] = last.exhaustive
    windowless = 0
    for y, x in np.argwhere(~searched[:, 1:]) + np.array([0, 1]):
        # Wherever the sample goes on (the thesis, figure 5.3.3), also where its window no longer fits into it.
        row, column = result.source[y, x - 1] + (0, 1)
        if column < 64:
            assert tuple(result.source[y, x]) == (row, column)
            windowless += column >= 62
    assert windowless > 5


def test_masked_pixels_are_no_continuation():
    sample = data.gravel()[:64, :64] / 255.0
    mask = np.ones(sample.shape, bool)
    mask[:, 30:33] = False
    result = grow(sample, 80, exhaustive=0.2, mask=mask, seed=1)
    assert mask[tuple(np.moveaxis(result.source, 2, 0))].all()


def test_every_pixel_holds_what_its_source_holds():
    sample = np.random.default_rng(0).integers(0, 255, (30, 34, 4)).astype(np.uint8)
    for options in ({}, {"exhaustive": 0.3}, {"tileable": True}, {"window": 1, "levels": 1}):
        result = grow(sample, (25, 41), seed=1, **options)
        assert result.maps.dtype == np.uint8
        np.testing.assert_array_equal(result.maps, sample[result.source[..., 0], result.source[..., 1]])


def test_known_pixels_stay_as_they_are():
    image = data.brick()[:90, :90].astype(np.float32) / 255
    missing = np.zeros(image.shape, bool)
    missing[30:60, 40:70] = True
    missing[:4, :9] = True
    given = np.where(missing, np.nan, image)
    unused = np.zeros(image.shape, bool)
    unused[70:, 70:] = True
    result = grow(given, missing=missing, mask=~unused)
    np.testing.assert_array_equal(result.maps[~missing][:, 0], image[~missing])
    from_where = result.source[missing]
    assert not missing[from_where[:, 0], from_where[:, 1]].any()
    assert not unused[from_where[:, 0], from_where[:, 1]].any()


def test_filling_beats_a_flat_fill():
    y, x = np.mgrid[:80, :80]
    image = np.sin(2 * np.pi * x / 9) + np.sin(2 * np.pi * y / 13)
    missing = (np.hypot(y - 40, x - 38) < 15) | (np.hypot(y - 70, x - 12) < 6)
    result = grow(image, missing=missing)
    error = np.abs(result.maps[..., 0] - image)[missing].mean()
    assert error < 0.15 * np.abs(image - image.mean())[missing].mean()


def test_a_constant_gives_that_constant():
    assert (grow(np.full((20, 20, 2), 3.5), 31).maps == 3.5).all()


def test_a_pattern_goes_on():
    y, x = np.mgrid[:48, :48]
    sample = ((x // 4 + y // 4) % 2).astype(float)
    result = grow(sample, 64, seed=1).maps[..., 0]
    # A checkerboard is the negative of itself four pixels on.
    assert (result[:, 4:] == 1 - result[:, :-4]).mean() > 0.97
    assert (result[4:] == 1 - result[:-4]).mean() > 0.97


def test_seeds_and_threads():
    sample = data.gravel()[:40, :40] / 255.0
    results = []
    for count in (1, 2, 5):
        set_threads(count)
        try:
            results.append(grow(sample, 50, seed=9, exhaustive=0.6).source)
        finally:
            set_threads(None)
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])
    assert (grow(sample, 50, seed=10, exhaustive=0.6).source != results[0]).any()


def test_a_level_is_half_as_large_and_holds_the_means_of_what_is_known():
    planes = np.full((2, 21, 30), 4.0, np.float32)
    planes[:, 5:12, 10:20] = np.nan
    known = np.isfinite(planes[0])
    half, there = halve_planes(planes, known)
    assert half.shape[1:] == there.shape == level_shape((21, 30), 1) == (11, 15)
    np.testing.assert_allclose(half[:, there], 4.0, rtol=1e-6)
    assert not there[4, 7]


def test_nothing_missing_changes_nothing():
    image = np.random.default_rng(0).random((20, 20))
    result = grow(image, missing=np.zeros((20, 20), bool))
    np.testing.assert_array_equal(result.maps[..., 0], image)
    assert result.notes == ("nothing is missing",)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "either size"),
        ({"size": 5, "missing": np.ones((20, 20), bool)}, "either size"),
        ({"missing": np.ones((20, 20), bool)}, "covers everything"),
        ({"missing": np.ones((20, 21), bool)}, "missing must be"),
        ({"missing": np.zeros((20, 20))}, "not float64"),
        ({"missing": np.eye(20, dtype=bool), "tileable": True}, "new textures"),
        ({"missing": np.eye(20, dtype=bool), "exhaustive": 0.5}, "new textures"),
        ({"size": 30, "window": 0}, "window must be"),
        ({"size": 30, "window": 2.0}, "window must be"),
        ({"size": 30, "window": 99}, "window must be"),
        ({"size": 30, "levels": 0}, "levels must be"),
        ({"size": 30, "levels": 6}, "no 5 x 5 window"),
        ({"size": 30, "exhaustive": 1.5}, "exhaustive"),
        ({"size": 30, "mask": np.indices((20, 20)).sum(0) % 3 > 0}, "no 5 x 5 window"),
        ({"size": -3}, "size must be"),
    ],
)
def test_bad_input_is_named(options, message):
    with pytest.raises(InputError, match=message):
        grow(np.random.default_rng(0).random((20, 20)), **options)


def test_nan_is_named():
    sample = np.zeros((20, 20))
    sample[3, 4] = np.nan
    with pytest.raises(InputError, match="1 of 400 pixels"):
        grow(sample, 30)


@pytest.mark.parametrize("maps", [24, 48])
def test_many_equal_maps_are_synthesised(maps):
    y, x = np.indices((24, 30))
    sample = np.stack([x + y + 1e-3 * np.random.default_rng(i).random(x.shape) for i in range(maps)], axis=2)
    result = grow(sample, (30, 40), seed=1)
    assert result.source.min() >= 0
    np.testing.assert_array_equal(result.maps, sample[result.source[..., 0], result.source[..., 1]])


def test_a_texture_that_is_filled_keeps_its_mask():
    from intaglio import Relightable
    from intaglio.photometric.bases import LambertBasis

    maps = np.random.default_rng(0).random((3, 30, 30, 1), dtype=np.float32)
    mask = np.ones((30, 30), bool)
    mask[:5] = False
    hole = np.zeros((30, 30), bool)
    hole[12:18, 10:20] = True
    mask &= ~hole
    result = grow(Relightable("gradient", maps, LambertBasis(), mask=mask), missing=hole)
    np.testing.assert_array_equal(result.texture.mask, mask | hole)
    assert mask[result.source[hole][:, 0], result.source[hole][:, 1]].all()


@pytest.mark.parametrize("hole", [np.s_[50, 60], np.s_[50:53, 60:63], np.s_[40], np.s_[:, 0], np.s_[::9, ::7], np.s_[0, 0]])
def test_small_holes_are_filled(hole):
    image = data.gravel()[:96, :96] / 255.0
    missing = np.zeros(image.shape, bool)
    missing[hole] = True
    result = grow(np.where(missing, np.nan, image), missing=missing)
    np.testing.assert_array_equal(result.maps[~missing][:, 0], image[~missing])
    assert np.isfinite(result.maps).all()


def test_levels_fit_what_is_usable():
    mask = np.zeros((128, 128), bool)
    mask[50:62, 50:62] = True
    result = grow(np.random.default_rng(0).random((128, 128)), 40, mask=mask)
    assert mask[result.source[..., 0], result.source[..., 1]].all()
