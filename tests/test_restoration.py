"""Restoration: exact facts, references, figures against baselines, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from intaglio import InputError, assess_restoration, restore
from intaglio.restoration.fill import ORIENTATIONS, synthesize_hole
from intaglio.restoration.frequency import DEVIATION, choose_kappa, deviations, low_band
from intaglio.restoration.inpaint import inpaint
from intaglio.restoration.pipeline import METHODS, match_contrast
from intaglio.restoration.plate import fill_with_plate, thin_part
from intaglio.restoration.poisson import fit_to_surroundings


def texture(height=96, width=128, seed=0):
    """Return stripes with noise, (H, W, 3) float32 in [0, 1]."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width]
    stripes = 0.5 + 0.25 * np.sin(2 * np.pi * (x + 0.4 * y) / 11) + 0.05 * rng.standard_normal((height, width))
    return np.clip(np.stack([stripes, 0.8 * stripes, 0.6 * stripes], axis=2), 0, 1).astype(np.float32)


def blob(height=96, width=128):
    y, x = np.mgrid[:height, :width]
    concave = ((y - 50) ** 2 + (x - 60) ** 2 < 400) & ~((y - 42) ** 2 + (x - 60) ** 2 < 80)
    return concave | ((np.abs(y - x * 0.5 - 8) < 2) & (x < 110))


@pytest.mark.parametrize("method", METHODS)
def test_known_pixels_keep_their_bits_and_the_rest_is_finite(method):
    image, missing = texture(), blob()
    damaged = np.where(missing[:, :, None], np.nan, image).astype(np.float32)
    found = restore(damaged, missing, method)
    assert np.isfinite(found.image).all()
    np.testing.assert_array_equal(found.image[~missing].view(np.uint32), image[~missing].view(np.uint32))
    places = np.moveaxis(np.indices(missing.shape), 0, 2)
    np.testing.assert_array_equal(found.source[~missing], places[~missing])
    if method != "inpaint":
        copied = missing & ~thin_part(missing) if method == "auto" else missing
        assert copied.any()
        assert not missing[tuple(found.source[copied].T)].any()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float64])
def test_a_constant_stays_that_constant(method, dtype):
    value = 0.25 if dtype is np.float64 else 77
    image = np.full((40, 50), value, dtype)
    missing = np.zeros((40, 50), bool)
    missing[10:25, 20:35] = True
    found = restore(np.where(missing, dtype(0), image), missing, method).image
    assert found.dtype == dtype
    np.testing.assert_array_equal(found, image)


def test_a_ramp_is_inpainted_exactly():
    y, x = np.mgrid[:30, :40]
    ramp = (0.01 * x + 0.02 * y).astype(np.float32)
    missing = np.zeros((30, 40), bool)
    missing[8:20, 10:30] = True
    np.testing.assert_allclose(restore(ramp, missing, "inpaint").image, ramp, atol=1e-5)


def test_inpainting_is_the_limit_of_the_papers_convolution():
    rng = np.random.default_rng(2)
    image = rng.random((20, 24, 2)).astype(np.float32)
    missing = np.zeros((20, 24), bool)
    missing[5:14, 6:19] = True
    found = inpaint(image, missing, chart=np.ones((20, 24), int))
    kernel = np.array([[0.073235, 0.176765, 0.073235], [0.176765, 0, 0.176765], [0.073235, 0.176765, 0.073235]])
    slow = np.where(missing[:, :, None], 0.5, image).astype(np.float64)
    for _ in range(600):
        for c in range(2):
            slow[:, :, c] = np.where(missing, ndimage.correlate(slow[:, :, c], kernel), slow[:, :, c])
    np.testing.assert_allclose(found, slow, atol=1e-4)


def test_large_holes_are_solved_to_the_same_limit(monkeypatch):
    rng = np.random.default_rng(3)
    image = ndimage.gaussian_filter(rng.random((90, 110, 1)), (4, 4, 0)).astype(np.float32)
    missing = np.zeros((90, 110), bool)
    missing[20:70, 20:90] = True
    one = np.ones(missing.shape, int)
    direct = inpaint(image, missing, chart=one)
    monkeypatch.setattr("intaglio.restoration.inpaint.DIRECT", 50)
    monkeypatch.setattr("intaglio.sparse.DIRECT", 50)
    np.testing.assert_allclose(inpaint(image, missing, chart=one), direct, atol=3e-4)  # what the residual leaves


def test_barriers_keep_two_sides_apart():
    image = np.zeros((21, 21), np.float32)
    image[:, 11:] = 1
    missing = np.zeros((21, 21), bool)
    missing[5:16, 3:18] = True
    walls = np.zeros((21, 21), bool)
    walls[:, 10:12] = True
    found = restore(image, missing, "inpaint", barriers=walls).image
    assert found[8, 6] == pytest.approx(0, abs=1e-5)
    assert found[8, 15] == pytest.approx(1, abs=1e-5)
    assert 0.2 < restore(image, missing, "inpaint").image[8, 9] < 0.8


def test_nothing_leaves_its_chart():
    rng = np.random.default_rng(4)
    chart = np.zeros((60, 80), int)
    chart[4:56, 4:40], chart[4:56, 40:76] = 1, 2
    image = np.where(chart == 1, 0.2, 0.8) + 0.02 * rng.standard_normal((60, 80))
    missing = np.zeros((60, 80), bool)
    missing[20:40, 28:40] = True
    missing[10:20, 40:50] = True
    for method in METHODS:
        found = restore(np.where(chart > 0, image, 9.0), missing, method, inside=chart).image
        assert np.abs(found[20:40, 28:40] - 0.2).max() < 0.12
        assert np.abs(found[10:20, 40:50] - 0.8).max() < 0.12
        np.testing.assert_array_equal(found[chart == 0], 9.0)


def test_bands_add_up_and_subbands_are_the_transforms_first():
    image = texture()
    low = low_band(image, 5)
    assert np.abs(low_band(low, 5) - low).max() < 1e-5
    assert np.abs(low_band(image - low, 5)).max() < 1e-5
    assert not low_band(image, 0).any()


def test_kappa_is_the_lowest_that_leaves_a_homogeneous_band():
    image = texture()
    # A texture so strong and regular that no number of subbands meets the threshold: only its mean is taken.
    assert deviations(image).min() > DEVIATION
    assert choose_kappa(image) <= 2
    y, x = np.mgrid[:96, :128]
    shaded = 0.1 * image + (np.cos(x / 12) * np.cos(y / 15))[:, :, None]
    kappa = choose_kappa(shaded)
    found = deviations(shaded)
    assert kappa > 2
    assert found[kappa] < DEVIATION <= found[kappa - 1]


def test_the_eight_orientations_are_all_there_are():
    assert len({tuple(o.reshape(-1)) for o in ORIENTATIONS}) == 8
    for turn in ORIENTATIONS:
        assert abs(round(np.linalg.det(turn))) == 1


def test_a_periodic_texture_is_continued():
    y, x = np.mgrid[:64, :64]
    image = np.sin(2 * np.pi * x / 8) * np.cos(2 * np.pi * y / 8)
    missing = np.zeros((64, 64), bool)
    missing[24:40, 22:44] = True
    found = restore(image.astype(np.float32), missing, "synthesize", refine=0, seams=False, levels=1, coherence=0).image
    # Fine contrast is estimated from the surroundings, to a few percent.
    assert np.abs(found - image).max() < 0.05


def test_concave_holes_and_holes_at_the_border_finish():
    image = texture(64, 64)[:, :, :1]
    y, x = np.mgrid[:64, :64]
    ring = (np.hypot(y - 32, x - 32) < 24) & ~(np.hypot(y - 32, x - 32) < 10)
    for missing in (ring, (y < 20) & (x < 20), (y > 30), x + y < 70):
        source, _ = synthesize_hole(
            np.where(missing[:, :, None], 0, image), missing, np.ones((64, 64), int), levels=3, coherence=5, orientations=1
        )
        assert (source >= 0).all()
        assert not missing[source[..., 0], source[..., 1]].any()


def test_orientations_find_what_only_turned_neighbourhoods_show():
    # A zigzag across whose turn stripes lead downwards: known ones above and beside the hole lead upwards.
    y, x = np.mgrid[:64, :64]
    upwards = np.sin(2 * np.pi * (x + y) / 8)
    stripes = np.where(x < 32, upwards, np.sin(2 * np.pi * (x - y) / 8)).astype(np.float32)
    missing = (x >= 36) & (y >= 4)
    plain = {"refine": 0, "levels": 1, "coherence": 0}
    error = [
        np.abs(restore(stripes, missing, "synthesize", orientations=n, **plain).image - stripes)[missing].mean() for n in (1, 8)
    ]
    assert error[1] < 0.5 * error[0]


def test_seam_correction_makes_up_a_step():
    rng = np.random.default_rng(5)
    band = rng.random((28, 28, 1))
    missing = np.zeros((28, 28), bool)
    missing[14:22, 14:22] = True
    source = np.moveaxis(np.indices((28, 28)), 0, 2).copy()
    # Copied from a place that is the same but for a constant.
    shifted = band.copy()
    shifted[0:10, 0:10] = band[13:23, 13:23] + 0.3
    source[missing] -= 13
    filled = shifted[source[..., 0], source[..., 1]]
    found = fit_to_surroundings(filled, shifted, source, np.zeros((28, 28), int), missing, np.ones((28, 28), int))
    np.testing.assert_allclose(found, np.where(missing[:, :, None], band, shifted), atol=1e-3)


def test_contrast_holds_deep_inside_a_hole():
    rng = np.random.default_rng(6)
    detail = rng.standard_normal((420, 420, 1)).astype(np.float32)
    hole = np.zeros((420, 420), bool)
    hole[20:400, 20:400] = True
    found = match_contrast(detail, hole, ~hole)
    assert found[200:220, 200:220].std() == pytest.approx(detail[200:220, 200:220].std(), rel=0.1)


def test_split_beats_both_single_methods_on_texture_with_a_gradient():
    image = texture(128, 160, seed=7)
    x = np.linspace(0.4, 1.2, 160)[None, :, None]
    truth = (image * x).astype(np.float32)
    missing = blob(128, 160)
    found = {m: restore(np.where(missing[:, :, None], 0, truth), missing, m).image for m in METHODS}
    reports = {m: assess_restoration(found[m], missing, truth) for m in METHODS}
    off = {m: abs(r.energy / r.truth_energy - 1) for m, r in reports.items()}
    assert off["split"] < 0.15
    assert off["split"] < 0.3 * off["inpaint"]
    # What is broad: diffusion has it, synthesis alone has not.
    broad = {m: np.sqrt(np.mean(ndimage.gaussian_filter(found[m] - truth, (6, 6, 0))[missing] ** 2)) for m in METHODS}
    assert broad["split"] < broad["synthesize"]
    assert reports["split"].seam < 1.15 * reports["split"].truth_seam


def test_equal_bits_every_time():
    image, missing = texture(), blob()
    np.testing.assert_array_equal(restore(image, missing).image, restore(image, missing).image)


def test_nothing_missing_is_the_image():
    image = texture()
    found = restore(image, np.zeros(image.shape[:2], bool))
    np.testing.assert_array_equal(found.image, image)
    assert "nothing is missing" in found.notes


def test_strips():
    image = np.random.default_rng(8).random((12, 3000)).astype(np.float32)
    missing = np.zeros(image.shape, bool)
    missing[3:8, 1000:1010] = True
    assert np.isfinite(restore(image, missing).image).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"missing": np.ones((96, 128), bool)}, "covers everything"),
        ({"missing": np.zeros((5, 5), bool)}, "missing"),
        ({"image": np.full((96, 128), np.nan)}, "not finite"),
        ({"image": np.zeros((96, 128, 40))}, "at most 16"),
        ({"image": "picture"}, "array of numbers"),
        ({"method": "magic"}, "method"),
        ({"levels": 0}, "levels"),
        ({"orientations": 4}, "orientations must be 1"),
        ({"orientations": True}, "orientations must be"),
        ({"coherence": -1}, "coherence"),
        ({"kappa": -1}, "kappa"),
        ({"inside": np.zeros((3, 3), int)}, "inside"),
        ({"barriers": np.zeros((3, 3), bool)}, "barriers"),
    ],
)
def test_bad_input_is_named(change, message):
    arguments = {"image": texture(), "missing": blob(), **change}
    with pytest.raises(InputError, match=message):
        restore(**arguments)


def test_slivers_are_inpainted():
    missing = np.ones((40, 40), bool)
    missing[:, ::4] = False
    image = np.zeros((40, 40), np.float32) + np.arange(40, dtype=np.float32)
    for method, said in (("split", "inpainted"), ("auto", "thin damage")):
        found = restore(image, missing, method)
        # A plate bends a little towards the image's free border.
        inner = slice(5, -5), slice(5, 35 if method == "split" else 24)
        np.testing.assert_allclose(found.image[inner], image[inner], atol=1e-2)
        assert said in found.notes[0]


def test_values_of_any_range_keep_their_detail():
    base = np.random.default_rng(9).random((40, 44))
    missing = np.zeros((40, 44), bool)
    missing[15:25, 15:25] = True
    small = restore(base, missing).image
    for scale, offset in ((1e9, 0), (1, 1e6), (1e-12, 0), (1e300, 0)):
        found = restore(base * scale + offset, missing).image
        np.testing.assert_allclose((found - offset) / scale, small, atol=2e-4)
    for dtype in (np.int32, np.uint32, np.int64):
        whole = np.full((40, 44), min(np.iinfo(dtype).max, 2**50), dtype)
        np.testing.assert_array_equal(restore(whole, missing).image, whole)
    assert np.isfinite(restore(((base * 2 - 1) * 6e4).astype(np.float16), missing).image).all()
    with pytest.raises(InputError, match="2\\^53"):
        restore(np.full((40, 44), 2**60), missing)


def test_large_chart_numbers_are_charts():
    image = texture()[:, :, 0]
    inside = np.full(image.shape, 2**40)
    np.testing.assert_array_equal(restore(image, blob(), inside=inside).image, restore(image, blob()).image)


def test_assessment_of_the_truth_is_the_truths():
    image, missing = texture(), blob()
    found = assess_restoration(image, missing, image)
    assert found.energy == found.truth_energy
    assert found.psnr >= 120
    assert len(found.lines()) == 3
    with pytest.raises(InputError, match="part of the image"):
        assess_restoration(image, np.zeros(image.shape[:2], bool))


def scratched(height=120, width=150):
    """Lines of several widths across an image, and a hole."""
    y, x = np.mgrid[:height, :width]
    lines = np.zeros((height, width), bool)
    for k, wide in enumerate((1, 2, 4, 7)):
        lines |= np.abs(y - 25 * (k + 1) + 0.3 * x - 20) < wide / 2
    return lines, (y - 60) ** 2 + (x - 110) ** 2 < 18**2


def test_thin_damage_is_told_from_holes():
    lines, hole = scratched()
    thin = thin_part(lines | hole)
    beside = ndimage.binary_dilation(hole, iterations=14)
    # A line that runs out of the image aslant is wide there, as far as one can see.
    inner = np.zeros_like(lines)
    inner[:100] = True
    assert thin[lines & inner & ~beside].all()
    assert not thin[hole].any()
    assert not thin_part(np.ones((30, 30), bool)).any()
    assert not thin_part(np.zeros((30, 30), bool)).any()
    # At the image's border nothing says that a hole ends there.
    corner = np.zeros((40, 40), bool)
    corner[:14, :14] = True
    assert not thin_part(corner)[:12, :12].any()


def test_a_plate_carries_slopes_and_bends_across():
    """Across a scratch a plate continues what diffusion flattens: a ramp exactly, a wave better."""
    y, x = np.mgrid[:60, :70].astype(float)
    missing = np.abs(y - 30) < 3
    chart = np.ones(missing.shape, int)
    for image, bound in ((0.01 * x + 0.005 * y, 1e-4), (0.5 + 0.3 * np.cos(2 * np.pi * y / 20), 0.08)):
        given = np.where(missing, 0.5, image)[:, :, None]
        plate = fill_with_plate(given, missing, chart=chart)[:, :, 0]
        assert np.abs(plate - image)[missing & (np.abs(x - 34.5) < 25)].max() < bound
        assert np.array_equal(plate[~missing], given[~missing][:, 0].astype(np.float32))
    membrane = inpaint(given, missing, chart=chart)[:, :, 0]
    assert np.abs(plate - image)[missing].max() < 0.65 * np.abs(membrane - image)[missing].max()


def test_a_plate_is_the_minimum_of_its_energy():
    """Against a dense solution: every energy written out, all unknowns at once."""
    rng = np.random.default_rng(3)
    image, missing = rng.random((9, 10, 2)), np.zeros((9, 10), bool)
    missing[3:6, 4:7] = missing[8, 0] = True
    chart = np.ones(missing.shape, int)
    chart[:, 8:] = 2
    rows = []
    number = np.arange(90).reshape(9, 10)
    same = lambda p, q: chart[p] == chart[q]  # noqa: E731
    reach = ndimage.binary_dilation(missing)
    for y in range(9):
        for x in range(10):
            around = [(y + a, x + b) for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0)) if 0 <= y + a < 9 and 0 <= x + b < 10]
            around = [p for p in around if same(p, (y, x))]
            if len(around) == 4 and reach[y, x]:
                row = np.zeros(90)
                row[number[y, x]] = 4
                row[[number[p] for p in around]] = -1
                rows.append(row)
            for p in around:
                if p > (y, x):
                    row = np.zeros(90)
                    row[number[y, x]], row[number[p]] = np.sqrt(0.8), -np.sqrt(0.8)
                    rows.append(row)
    system, free = np.array(rows), missing.reshape(-1)
    values = image.reshape(90, 2)
    found = np.linalg.lstsq(system[:, free], -system[:, ~free] @ values[~free], rcond=None)[0]
    made = fill_with_plate(image, missing, chart=chart).reshape(90, 2)
    np.testing.assert_allclose(made[free], found, atol=1e-5)


def test_nothing_crosses_charts_and_barriers():
    y, x = np.mgrid[:30, :40]
    image = np.where(x < 20, 0.2, 0.9)[:, :, None]
    missing = np.abs(y - 15) < 2
    for options in ({"chart": np.where(x < 20, 1, 2)}, {"chart": np.ones(missing.shape, int), "barriers": np.abs(x - 19.5) < 1}):
        made = fill_with_plate(np.where(missing[:, :, None], 0.5, image), missing, **options)
        inner = missing & (np.abs(x - 19.5) > 1)
        np.testing.assert_allclose(made[inner], image[inner], atol=1e-5)
    # What nothing known leads to stays as it was.
    alone = fill_with_plate(image, np.ones(missing.shape, bool), chart=np.ones(missing.shape, int))
    np.testing.assert_array_equal(alone, image.astype(np.float32))


def test_thin_damage_is_filled_as_suits_the_image():
    """A photograph's soft shading asks for the plate, a regular pattern of stripes for copies: by trial on known pixels."""
    soft = ndimage.gaussian_filter(np.random.default_rng(5).random((120, 150)), 4)
    soft = ((soft - soft.min()) / np.ptp(soft))[:, :, None].astype(np.float32)
    lines, hole = scratched()
    missing = lines & ~ndimage.binary_dilation(hole, iterations=8)
    for image, said, like in ((soft, "filled by a plate", "inpaint"), (texture(120, 150), "by trial", "weave")):
        off = {method: np.sqrt(((restore(image, missing, method).image - image)[missing] ** 2).mean()) for method in METHODS}
        assert off["auto"] < 1.02 * min(off["weave"], off["inpaint"])
        assert off["auto"] < 1.001 * off[like]
        assert said in restore(image, missing).notes[0]
    both = restore(soft, lines | hole)
    assert "thin damage" in both.notes[0]
    assert np.isfinite(both.image).all()
