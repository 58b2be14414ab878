"""Choosing a block by trial: the statistic, and what is chosen by it."""

from __future__ import annotations

import numpy as np
import pytest

import intaglio
from intaglio.synthesis.trial import best_block, patch_distance


def bricks(size=96, course=16, brick=32, seed=0):
    """Courses of bricks of random tones with joints, (1, size, size): elements of 16 x 32 pixels."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:size, :size]
    row = y // course
    across = x + (row % 2) * brick // 2
    tone = rng.uniform(0.4, 0.9, (size // course + 1, size // brick + 2))[row, across // brick]
    joint = (y % course < 2) | (across % brick < 2)
    return (np.where(joint, 0.1, tone) + 0.02 * rng.standard_normal((size, size)))[None]


def test_a_texture_is_nearer_to_itself_than_to_its_shuffled_pixels():
    sample = bricks()
    usable = np.ones(sample.shape[1:], bool)
    shuffled = np.random.default_rng(1).permutation(sample.reshape(-1)).reshape(sample.shape)
    same, other = (patch_distance(image, sample, usable, 0) for image in (bricks(seed=5), shuffled))
    # The same patches are drawn from the same image.
    assert patch_distance(sample, sample, usable, 0) == 0
    assert same < 0.5 * other
    # Both are measured by the sample's contrast.
    assert patch_distance(10 * bricks(seed=5), 10 * sample, usable, 0) == pytest.approx(same, rel=1e-4)


def test_what_is_not_usable_does_not_count():
    sample = bricks()
    spoilt, usable = sample.copy(), np.ones(sample.shape[1:], bool)
    spoilt[:, :30, :40], usable[:30, :40] = 50.0, False
    result = bricks(seed=5)
    assert patch_distance(result, spoilt, usable, 0) < 2 * patch_distance(result, sample, np.ones_like(usable), 0)
    assert patch_distance(result, spoilt, np.ones_like(usable), 0) > 0.25


def test_the_block_of_the_nearest_result_is_chosen():
    sample, usable = bricks(), np.ones((96, 96), bool)
    rng = np.random.default_rng(2)
    noisy = {side: sample + rng.normal(0, abs(side - 27) / 40, sample.shape) for side in range(8, 40)}
    side, said = best_block(14, sample, usable, (2, 40), lambda side, size: noisy[side], 0)
    assert side == 27
    assert "27 (0.000)" in said
    # What is hardly better changes nothing; neither does what is too large to be used.
    assert best_block(14, sample, usable, (2, 40), lambda side, size: sample, 0)[0] == 14
    assert best_block(14, sample, usable, (2, 14), lambda side, size: noisy[side], 0)[0] <= 14
    assert best_block(14, sample, usable, (30, 40), lambda side, size: noisy[side], 0)[0] >= 30
    assert best_block(14, sample, usable, (2, 5), lambda side, size: noisy[side], 0) == (14, "")
    # Of a block that no small result can hold nothing is told.
    assert best_block(80, sample, usable, (2, 96), lambda side, size: noisy[side], 0) == (80, "")


def test_quilting_tries_blocks():
    sample = bricks()
    made = intaglio.quilt(sample[0], 128, seed=3, refine=0, device="cpu")
    assert "by trial of" in made.notes[0]
    side = int(made.notes[0].split()[1])
    usable = np.ones(sample.shape[1:], bool)
    again = intaglio.quilt(sample[0], 128, side, seed=3, refine=0, device="cpu")
    np.testing.assert_array_equal(made.source, again.source)
    worst = max(
        patch_distance(intaglio.quilt(sample[0], 128, b, seed=3, refine=0, device="cpu").maps[None, :, :, 0], sample, usable, 0)
        for b in (8, 12)
    )
    assert patch_distance(made.maps[None, :, :, 0], sample, usable, 0) < worst
    # A small result can't hold all blocks, and an overlap that is given must fit.
    assert intaglio.quilt(sample[0], 10, seed=1, device="cpu").maps.shape[:2] == (10, 10)
    assert "overlapping by 20" in intaglio.quilt(sample[0], 64, overlap=20, seed=1, device="cpu").notes[1]
