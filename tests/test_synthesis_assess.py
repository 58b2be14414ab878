"""Measures of synthesised textures: values that are known, and made flaws that must show."""

from __future__ import annotations

import numpy as np
import pytest
from skimage import data

from intaglio import InputError, Synthesis, assess_synthesis, quilt
from intaglio.synthesis.ranking_page import write_ranking_page
from intaglio.synthesis.report import source_picture, synthesis_pictures, write_source, write_synthesis_report


def places(height, width, top=0, left=0):
    y, x = np.meshgrid(np.arange(height) + top, np.arange(width) + left, indexing="ij")
    return np.stack([y, x], axis=2).astype(np.int32)


def laid(sample, source, **options):
    maps = sample[:, :, None] if sample.ndim == 2 else sample
    return Synthesis(maps[source[..., 0], source[..., 1]], source, **options)


@pytest.fixture(scope="module")
def gravel():
    return data.gravel()[:128, :128] / 255.0


def test_the_sample_itself_is_perfect(gravel):
    report = assess_synthesis(gravel, laid(gravel, places(128, 128)))
    assert np.isnan(report.seam)
    assert np.isnan(report.wrap)
    assert report.seam_share == 0
    assert report.copy_side == 128
    assert report.largest_copy == report.used == report.repetition == 1
    found = report.likeness
    assert found.histogram.max() == found.joint == found.correlation == found.spectrum == 0
    assert found.coherence == pytest.approx(0, abs=1e-6)
    assert found.completeness == pytest.approx(0, abs=1e-6)
    assert "no seam" in report.lines()[0]


def test_a_repeated_quarter(gravel):
    source = np.tile(places(64, 64), (2, 2, 1))
    report = assess_synthesis(gravel, laid(gravel, source))
    assert report.used == 0.25
    assert report.repetition == 4
    assert report.copy_side == 64
    assert report.largest_copy == 0.25
    assert report.seam > 1.5
    assert report.seam_share == pytest.approx(2 * 128 / (2 * 128 * 127))
    assert report.likeness.coherence < 0.1
    assert report.likeness.completeness > 4 * report.likeness.coherence


def test_shuffled_pixels_show(gravel):
    rng = np.random.default_rng(0)
    source = rng.permutation(places(128, 128).reshape(-1, 2)).reshape(128, 128, 2)
    report = assess_synthesis(gravel, laid(gravel, source))
    good = assess_synthesis(gravel, quilt(gravel, 128, seed=1))
    assert report.likeness.histogram.max() == pytest.approx(0, abs=1e-9)
    assert report.likeness.spectrum > 4 * good.likeness.spectrum
    assert report.likeness.coherence > 3 * good.likeness.coherence
    assert report.copy_side < 2 < good.copy_side


def test_correlation_is_kept(gravel):
    sample = np.stack([gravel, 1 - gravel], axis=2)
    assert assess_synthesis(sample, quilt(sample, 200, seed=1)).likeness.correlation < 1e-3
    flat = sample.copy()
    flat[:64, :64, 1] = 0.5
    lost = laid(flat, np.tile(places(64, 64), (2, 2, 1)))
    assert np.isnan(assess_synthesis(flat, lost).likeness.correlation)


@pytest.mark.parametrize("size", [(1, 1), (3, 9), (6, 6), (12, 12)])
def test_small_results_are_measured(size):
    sample = np.random.default_rng(0).random((30, 30))
    for seed in range(5):
        report = assess_synthesis(sample, quilt(sample, size, 5, seed=seed))
        assert 0 <= report.likeness.coherence < 1


def test_windows_of_noise_are_far_apart():
    """In 384 dimensions the nearest of windows of noise is hardly nearer than any, however many are searched."""
    sample = np.random.default_rng(0).random((64, 64, 6))
    scattered = np.random.default_rng(1).permutation(places(64, 64).reshape(-1, 2)).reshape(64, 64, 2)
    assert assess_synthesis(sample, laid(sample, scattered)).likeness.coherence > 0.8
    assert assess_synthesis(sample, quilt(sample, 64, 20, seed=1)).likeness.coherence < 0.4


def test_a_mask_that_does_not_fit_is_refused(gravel):
    mask = np.ones(gravel.shape, bool)
    mask[:5] = False
    with pytest.raises(InputError, match="mask leaves out"):
        assess_synthesis(gravel, laid(gravel, places(128, 128)), mask=mask)


def test_a_wrap_with_a_line_shows(gravel):
    bad = assess_synthesis(gravel, laid(gravel, places(128, 128), tileable=True))
    good = assess_synthesis(gravel, quilt(gravel, 128, tileable=True, refine=2, seed=1))
    assert bad.wrap > 1.5
    assert good.wrap < 1.2


def test_a_constant_is_like_itself():
    report = assess_synthesis(np.full((20, 20), 3.0), quilt(np.full((20, 20), 3.0), 40, 8))
    assert report.likeness.histogram.max() == 0
    assert report.likeness.coherence == 0
    assert report.seam == 1


def test_a_result_of_another_sample_is_refused(gravel):
    with pytest.raises(InputError, match="does not have"):
        assess_synthesis(gravel[:20], laid(gravel, places(128, 128)))


def test_the_page_and_the_provenance(gravel, tmp_path):
    from intaglio import read_exr

    result = quilt(gravel, (90, 110), tileable=True, seed=1)
    write_source(result, tmp_path / "source.exr")
    channels, _ = read_exr(tmp_path / "source.exr")
    np.testing.assert_array_equal(channels["source.row"], result.source[..., 0])
    np.testing.assert_array_equal(channels["source.column"], result.source[..., 1])
    write_synthesis_report(tmp_path / "page.html", gravel, result, assess_synthesis(gravel, result), title="Gra<vel")
    page = (tmp_path / "page.html").read_text()
    assert page.count("data:image/png") == 5
    assert "Gra&lt;vel" in page
    assert "Tiled two by two" in page
    assert list(synthesis_pictures(gravel, result)["Sample and result"]) == ["sample", "result"]
    assert source_picture(result.source, (128, 128)).shape == (90, 110, 3)


def test_the_ranking_page_names_no_method(tmp_path, gravel):
    picture = gravel[:8, :8, None]
    results = {"quilt": picture, "grow": picture, "a</script>b": picture}
    write_ranking_page(tmp_path / "page.html", {"gravel": (picture, results)}, seed=4)
    page = (tmp_path / "page.html").read_text()
    assert "quilt" not in page
    assert "grow" not in page
    assert page.count("</script>") == 2
    assert 'randomFrom("4" + observer)' in page


@pytest.mark.parametrize(
    ("trials", "message"),
    [
        ({}, "no texture"),
        ({"t": ("x", {"a": 1, "b": 2})}, "at least 3"),
        ({"t": ("x", {"a": 1, "b": 2, "Observer": 3})}, "can't be called Observer"),
    ],
)
def test_bad_studies_are_named(trials, message, tmp_path):
    with pytest.raises(InputError, match=message):
        write_ranking_page(tmp_path / "page.html", trials)


def test_studies_whose_textures_differ(tmp_path):
    picture = np.zeros((4, 4, 1))
    trials = {"t": (picture, dict.fromkeys("abc", picture)), "u": (picture, dict.fromkeys("abd", picture))}
    with pytest.raises(InputError, match="u has results of a, b, d"):
        write_ranking_page(tmp_path / "page.html", trials)
