"""Statistics and assessment: facts that must hold exactly, then what they are for."""

from __future__ import annotations

import re

import numpy as np
import pytest
from reliefs import complete_with

import intaglio
from intaglio.relief.seam import seam_measure
from intaglio.scenes.patterns import cylinder_base, grid_faces
from intaglio.statistics import (
    autocovariance,
    earth_movers_distance,
    histogram_overlap,
    mean_surface_integral,
    roughness_spectrum,
)

RNG = np.random.default_rng(2)


def grid(n=60, step=1.0):
    x, y = np.meshgrid(np.arange(n) * step, np.arange(n) * step, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)


def test_mean_surface_integral():
    assert mean_surface_integral(np.array([1.0, 2.0, 6.0])) == 3.0
    assert np.isnan(mean_surface_integral(np.zeros(0)))


def test_earth_movers_distance_of_a_shift_is_the_shift():
    x = RNG.normal(0, 2, 5000)
    assert earth_movers_distance(x + 0.5, x) == pytest.approx(0.5 / x.std())
    assert earth_movers_distance(x, x) == 0
    assert earth_movers_distance(np.ones(5), np.ones(5)) == 0
    assert earth_movers_distance(np.ones(5), np.zeros(5)) == float("inf")


def test_autocovariance_of_white_noise_is_its_variance_then_zero():
    points, values = grid(), RNG.normal(0, 3, 3600)
    distance, covariance = autocovariance(points, values, 0.5, 8)
    assert covariance[0] == pytest.approx(9, rel=0.05)
    far = np.isfinite(covariance) & (distance > 0.6)
    assert np.abs(covariance[far]).max() < 0.3


@pytest.mark.parametrize("wavelength", [5.0, 9.0])
def test_the_spectrum_peaks_at_the_relief_s_wavelength(wavelength):
    points = grid()
    values = np.sin(2 * np.pi * points[:, 0] / wavelength)
    waves, power = roughness_spectrum(points, values, 1.0)
    assert waves[np.argmax(power)] == pytest.approx(wavelength, rel=0.15)


def test_seam_measure_is_one_without_a_seam_and_grows_with_a_step():
    points, faces = grid(), grid_faces(60, 60, False)
    inside = points[:, 0] < 30
    rough = np.random.default_rng(0).normal(size=3600)
    assert seam_measure(points, rough, faces, inside) == pytest.approx(1, abs=0.15)
    # Over whole periods of a wave that runs across the seam the mean is one as well: a fixed phase is not.
    shifted = [seam_measure(points, np.sin(2 * np.pi * (points[:, 0] + s) / 9), faces, inside) for s in range(9)]
    assert np.mean(shifted) == pytest.approx(1, abs=0.1)
    assert seam_measure(points, rough + np.where(inside, 0, 5.0), faces, inside) > 3
    assert np.isnan(seam_measure(points, rough, faces, np.ones(3600, bool)))
    assert seam_measure(points, np.zeros(3600), faces, inside) == 1


def test_histogram_overlap():
    x = RNG.uniform(size=5000)
    assert histogram_overlap(x, x) == pytest.approx(1)
    assert histogram_overlap(np.zeros(5), np.ones(5)) == 0


@pytest.fixture(scope="module")
def assessed(wave_tube):
    scan, truth = wave_tube
    whole = complete_with(scan, cylinder_base(), 2, 0.1)
    return scan, truth, whole, intaglio.assess_relief(whole, truth)


def test_a_perfect_completion_has_perfect_figures(assessed):
    _, _, whole, report = assessed
    assert report.measured_count == 720
    assert report.filled_count == 576
    assert report.msi_measured == pytest.approx(whole.relief[whole.measured].mean())
    assert report.msi_measured == pytest.approx(0.25)
    assert abs(report.msi_percent) < 0.01
    assert report.displacement_emd < 1e-3
    assert report.seam < 2.1
    assert report.truth.rms < 1e-5
    assert report.truth.coverage > 0.95


def test_a_smooth_filling_is_told_from_relief(assessed):
    _, truth, whole, good = assessed
    vertices = np.where(whole.measured[:, None], whole.vertices, whole.base)
    fields = {n: getattr(whole, n) for n in ("faces", "base", "normal", "measured", "source")}
    smooth = intaglio.assess_relief(intaglio.Surface(vertices=vertices, **fields), truth)
    assert smooth.msi_percent == pytest.approx(-100, abs=1)
    assert smooth.displacement_emd > 0.8
    assert smooth.spectrum_filled.max() < 1e-3 * smooth.spectrum_measured.max()
    assert smooth.truth.rms > 100 * good.truth.rms


def test_assessment_survives_the_file(assessed, tmp_path):
    _, truth, whole, report = assessed
    whole.write(tmp_path / "w.ply")
    again = intaglio.assess_relief(intaglio.read_surface(tmp_path / "w.ply"), truth)
    assert again.msi_filled == report.msi_filled
    assert again.truth.rms == report.truth.rms


def test_what_cannot_be_assessed(wave_tube):
    scan, truth = wave_tube
    with pytest.raises(intaglio.InputError, match="nothing to assess"):
        intaglio.assess_relief(scan)
    whole = complete_with(scan, cylinder_base(), 2)
    away = intaglio.Surface(vertices=truth.vertices + 1e4, faces=truth.faces)
    with pytest.raises(intaglio.InputError, match="same coordinates"):
        intaglio.assess_relief(whole, away)


def test_the_report_is_one_file_that_works_offline(assessed, tmp_path):
    scan, truth, whole, report = assessed
    intaglio.write_relief_report(whole, tmp_path / "r.html", report=report, truth=truth, scan=scan, title="A <wave>", size=48)
    page = (tmp_path / "r.html").read_text()
    assert page.count("data:image/png;base64,") == 15
    assert "A &lt;wave&gt;" in page
    assert not re.search(r'(src|href)="(?!data:)', page)
    assert f"{report.msi_measured:.6g}" in page
    assert "<svg" in page
    assert [p.name for p in tmp_path.iterdir()] == ["r.html"]
