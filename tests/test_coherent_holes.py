"""Holes filled by coherent pieces: frames, starts, exact facts, figures, odd input."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage
from skimage import data

from intaglio import restore
from intaglio.kernels.patch_match import SIDE
from intaglio.restoration.coherent.frames import group_holes, lay_frames
from intaglio.restoration.coherent.order import Windows, fill_in_order
from intaglio.restoration.coherent.pieces import whole_patches


def psnr(image, truth, hole):
    return 10 * np.log10(1 / np.mean((image - truth)[hole].astype(float) ** 2))


def blobs(shape, share, seed):
    """Return smooth holes over a share of an image."""
    noise = ndimage.gaussian_filter(np.random.default_rng(seed).standard_normal(shape), 18)
    return noise > np.quantile(noise, 1 - share)


def test_frames_hold_their_holes_on_all_levels():
    hole = blobs((181, 240), 0.2, 1)
    hole[5:8, 5:8] = True
    chart = np.ones(hole.shape, int)
    chart[:, 120:] = 2
    label, frames = group_holes(hole, chart)
    np.testing.assert_array_equal(label > 0, hole)
    assert len(frames) > 1
    groups = [f.group for found in frames.values() for f in found]
    assert sorted(groups) == list(range(1, label.max() + 1))
    for depth, found in frames.items():
        coarsest = lay_frames(found, depth, depth)
        for number, f in enumerate(found, 1):
            own = label == f.group
            assert (chart[own] == f.chart).all()
            assert ndimage.distance_transform_edt(np.pad(own, 1)).max() <= 14 * 2**depth
            y, x = np.nonzero(own)
            margin = SIDE << depth
            assert f.top <= y.min() - margin
            assert f.top + f.height >= y.max() + margin
            assert f.left <= x.min() - margin
            assert f.left + f.width >= x.max() + margin
            for level in range(depth + 1):
                canvas = lay_frames(found, depth, level)
                place = canvas.place[canvas.frame == number]
                assert len(place) == (f.height >> level) * (f.width >> level)
                np.testing.assert_array_equal(place.min(axis=0), (f.top >> level, f.left >> level))
                # What a pixel becomes on the next level lies where the pixel does.
                at = np.argwhere(canvas.frame == number)
                offset = at - place
                assert (offset == offset[0]).all()
                assert (offset[0] << level == (np.array(coarsest.corners[number - 1]) << depth) - (f.top, f.left)).all()


def test_holes_whose_patches_could_meet_are_one_group():
    hole = np.zeros((120, 120), bool)
    hole[40:60, 30:50] = hole[40:60, 56:76] = True
    assert group_holes(hole, np.ones(hole.shape, int))[0].max() == 1
    hole = np.zeros((120, 120), bool)
    hole[40:60, 20:40] = hole[40:60, 80:100] = True
    assert group_holes(hole, np.ones(hole.shape, int))[0].max() == 2


def test_the_nearest_window_is_that_of_all_comparisons():
    rng = np.random.default_rng(2)
    planes = rng.random((3, 30, 34)).astype(np.float32)
    starts = np.argwhere(np.ones((23, 27), bool))
    patch, known = rng.random((3, SIDE, SIDE)).astype(np.float32), rng.random((SIDE, SIDE)) < 0.4
    cost = [(((planes[:, y : y + SIDE, x : x + SIDE] - patch) ** 2) * known).sum() for y, x in starts]
    np.testing.assert_array_equal(Windows(planes, starts).nearest(patch, known), starts[int(np.argmin(cost))])


def test_order_continues_a_line_first():
    planes = np.zeros((1, 40, 60), np.float32)
    planes[0, 18:21] = 1
    hole = np.zeros((40, 60), bool)
    hole[8:32, 22:38] = True
    damaged = np.where(hole, 0.5, planes)
    starts = np.argwhere(whole_patches(~hole, np.ones(hole.shape, int)))
    filled, source = fill_in_order(damaged, ~hole, hole, Windows(damaged, starts), damaged)
    np.testing.assert_allclose(filled, planes, atol=1e-6)
    np.testing.assert_allclose(planes[0][tuple(source[hole].T)], planes[0][hole])
    assert (source[~hole] == -1).all()
    # What no known pixel is beside stays as it is.
    same, none = fill_in_order(damaged, np.zeros_like(hole), hole, Windows(damaged, starts), damaged)
    np.testing.assert_array_equal(same, damaged)
    assert (none == -1).all()


def test_a_regular_pattern_is_continued():
    y, x = np.mgrid[:150, :170]
    image = (0.5 + 0.2 * np.sin(2 * np.pi * x / 17) + 0.2 * np.sin(2 * np.pi * y / 13)).astype(np.float32)
    hole = (y - 70) ** 2 + (x - 90) ** 2 < 30**2
    found = restore(np.where(hole, np.nan, image).astype(np.float32), hole, "weave", seed=3)
    assert psnr(found.image, image, hole) > 30
    assert psnr(restore(image, hole, "inpaint").image, image, hole) < 15


def test_only_what_is_known_is_copied_and_the_same_seed_gives_the_same_bits():
    image = data.coffee()[100:261, 150:361].astype(np.float32) / 255
    hole = blobs(image.shape[:2], 0.2, 4)
    damaged = np.where(hole[..., None], 0, image)
    made = [restore(damaged, hole, "weave", seed=s, seams=False) for s in (1, 1, 2)]
    assert not hole[tuple(made[0].source[hole].T)].any()
    np.testing.assert_array_equal(made[0].image, image[tuple(np.moveaxis(made[0].source, 2, 0))])
    np.testing.assert_array_equal(made[0].source, made[1].source)
    assert (made[0].source != made[2].source).any()
    # Fitted to the rim, values leave those copied, and the known ones keep their bits.
    fitted = restore(damaged, hole, "weave", seed=1)
    np.testing.assert_array_equal(fitted.source, made[0].source)
    np.testing.assert_array_equal(fitted.image[~hole], image[~hole])
    assert np.abs(fitted.image - made[0].image).max() > 0.01


@pytest.mark.parametrize(("name", "share", "least"), [("brick", 0.15, 3.0), ("coffee", 0.1, 0.5), ("chelsea", 0.2, 0.5)])
def test_holes_are_nearer_than_by_bands(name, share, least):
    image = getattr(data, name)()[:300, :340].astype(np.float32) / 255
    hole = blobs(image.shape[:2], share, 7)
    damaged = np.where(hole if image.ndim == 2 else hole[..., None], 0, image)
    ours = psnr(restore(damaged, hole).image, image, hole)
    assert ours > psnr(restore(damaged, hole, "split").image, image, hole) + least


def test_pieces_are_large_and_coherent():
    image = data.brick()[:256, :256].astype(np.float32) / 255
    hole = np.zeros(image.shape, bool)
    hole[90:170, 80:190] = True
    source = restore(np.where(hole, 0, image), hole, "weave").source
    offset = source - np.moveaxis(np.indices(hole.shape), 0, 2)
    broken = (np.diff(offset, axis=1) != 0).any(axis=2)[90:170, 80:189]
    # Pieces of 30 x 30 pixels would break 3 % of the steps, single pixels all.
    assert broken.mean() < 0.15


def test_the_second_start_is_taken_where_it_fits_better():
    y, x = np.mgrid[:160, :160]
    lines = ((x % 23 < 3) | (y % 17 < 2)).astype(np.float32)
    hole = np.zeros(lines.shape, bool)
    hole[50:110, 50:110] = True
    found = restore(np.where(hole, 0, lines), hole, "weave")
    assert "order of structure" in found.notes[0]
    # Lines run through; some lie a pixel off.
    assert np.abs(found.image - lines)[hole].mean() < 0.08


def test_odd_sizes_corners_and_far_charts():
    rng = np.random.default_rng(5)
    image = ndimage.gaussian_filter(rng.random((61, 83, 2)), (2, 2, 0)).astype(np.float32)
    hole = np.zeros((61, 83), bool)
    hole[40:, 50:] = True
    hole[:20, :30] = True
    found = restore(np.where(hole[..., None], np.nan, image), hole, "weave")
    assert np.isfinite(found.image).all()
    assert not hole[tuple(found.source[hole].T)].any()
    # A chart of which nothing is known takes from the others; between charts nothing is compared.
    chart = np.ones((61, 83), int)
    chart[:, 50:] = 2
    hole = np.zeros((61, 83), bool)
    hole[:, 50:] = True
    found = restore(image, hole, "weave", inside=chart)
    assert (found.source[hole][:, 1] < 50).all()


def test_options_of_bands_ask_for_bands():
    image = data.coffee()[:90, :120].astype(np.float32) / 255
    hole = np.zeros((90, 120), bool)
    hole[30:60, 40:80] = True
    assert "pieces" in " ".join(restore(image, hole).notes)
    for options in ({"kappa": 3}, {"orientations": 8}, {"levels": 2}, {"coherence": 4.0}, {"refine": 0}):
        found = restore(image, hole, **options)
        assert "low band" in " ".join(found.notes)
        np.testing.assert_array_equal(found.image, restore(image, hole, "split", **options).image)


def test_without_a_whole_patch_holes_are_inpainted():
    image = np.full((20, 20), 0.5, np.float32)
    hole = np.zeros((20, 20), bool)
    hole[3::7, :] = hole[:, 3::7] = True
    found = restore(np.where(hole, 0, image), hole, "weave")
    assert "inpainted" in found.notes[0]
    np.testing.assert_allclose(found.image, 0.5, atol=1e-5)
