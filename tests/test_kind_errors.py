"""Errors of kinds: leave one out by brute force, and the published figures."""

from __future__ import annotations

import numpy as np
import pytest
from stacks import dome, noisy, scattered

from intaglio import (
    InputError,
    PhotometricStack,
    assess_representation,
    light_direction,
    read_stack,
    represent,
    surface_maps,
)
from intaglio.photometric.linear_fits import LINEAR_KINDS, Moments
from intaglio.photometric.relightable import KINDS
from intaglio.photometric.representation import stack_moments


def slow_report(stack, kind, left_out, **options):
    """η and the relative residual by definition: fit, relight, compare, an image at a time."""
    count = len(stack.lights)
    ratios, away, whole = [], 0.0, 0.0
    texture = represent(stack, kind, **options)
    for k in range(count):
        if left_out:
            texture = represent(stack.subset(np.delete(np.arange(count), k)), kind, **options)
        original = stack.image(k).astype(np.float64)
        relit = texture.relight(stack.lights[k]).astype(np.float64)
        ratios.append(np.sqrt(np.mean((relit - original) ** 2)) / original.std())
        away += ((relit - original) ** 2).sum()
        whole += (original**2).sum()
    return np.mean(ratios), np.sqrt(away / whole), np.array(ratios)


@pytest.mark.parametrize("left_out", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_errors_against_brute_force(kind, left_out):
    stack = noisy(scattered(16, lowest=70), channels=3)
    options = {"components": 6} if kind == "rbf" else {}
    report = assess_representation(stack, kind, left_out, **options)
    eta, relative, per_image = slow_report(stack, kind, left_out, **options)
    assert report.normalized_rms == pytest.approx(eta, rel=1e-4)
    assert report.relative == pytest.approx(relative, rel=1e-4)
    np.testing.assert_allclose(report.per_image, per_image, rtol=1e-3)
    assert (report.kind, report.leave_one_out) == (kind, left_out)


def test_leaving_one_out_of_hardly_enough_lights():
    """A ring and two lights near the zenith: without one of them the rest hardly tells anything, and no number is made up."""
    ring = np.concatenate([dome(8, (50,)), [light_direction(0, 3)], [light_direction(180, 4)]])
    assert np.isfinite(assess_representation(noisy(ring), "rbf", True).normalized_rms)
    arc = [light_direction(0, s) for s in (5, 15, 25, 35, 45, 55)]
    for others in ([light_direction(90, 30)], [light_direction(90, 30), light_direction(270, 30)]):
        with pytest.raises(InputError, match=r"without image 6|too close together"):
            assess_representation(noisy(np.array(arc + others)), "rbf", True)


def test_prediction_is_harder_than_reconstruction():
    stack = noisy(scattered(24))
    for kind in LINEAR_KINDS:
        assert assess_representation(stack, kind, True).normalized_rms > assess_representation(stack, kind).normalized_rms


def test_moments_of_strips_and_of_quadratic_forms():
    stack = noisy(dome(), channels=3)
    moments = stack_moments(stack)
    planes = stack.images.reshape(len(stack.lights), -1).astype(np.float64)
    np.testing.assert_allclose(moments.products, planes @ planes.T, rtol=1e-10)
    np.testing.assert_allclose(moments.deviation, planes.std(axis=1), rtol=1e-6)
    relit = np.random.default_rng(0).normal(size=(len(planes),) * 2) / 50
    expected = np.mean(np.sqrt(((relit.T @ planes - planes) ** 2).mean(axis=1)) / planes.std(axis=1))
    assert Moments(moments.products, moments.sums, moments.count).error(relit) == pytest.approx(expected, rel=1e-9)


def test_an_image_without_contrast_is_left_out():
    stack = noisy(dome())
    images = stack.images.copy()
    images[5] = 0.25
    report = assess_representation(PhotometricStack(images, stack.lights, ceiling=np.inf), "ptm")
    assert np.isnan(report.per_image[5])
    assert np.isfinite(report.normalized_rms)


@pytest.mark.parametrize(
    ("item", "gradient", "ptm", "eigen6", "best"),
    [
        ("realrti_item2", (0.631, 0.675), (0.755, 0.882), 0.24, 0.281),
        ("realrti_item3", (0.766, 0.801), (0.630, 0.693), 0.14, 0.185),
        ("realrti_item8", (0.489, 0.519), (0.557, 0.638), 0.22, 0.349),
    ],
)
def test_reference_figures_on_real_stacks(real, item, gradient, ptm, eigen6, best):
    """Plain least squares by NumPy on the mean of the channels; and 18 components by thin plates over a stereographic chart."""
    # The figures are of all photographs, also of the one that is too dark.
    stack = read_stack(real(f"photometric/{item}"), "linear", gray=True, keep="image31.jpg")
    for kind, expected in (("gradient", gradient), ("ptm", ptm)):
        for left_out in (False, True):
            assert assess_representation(stack, kind, left_out).normalized_rms == pytest.approx(expected[left_out], abs=0.005)
    assert assess_representation(stack, "eigen6").normalized_rms == pytest.approx(eigen6, abs=0.006)
    assert assess_representation(stack, "rbf", True).normalized_rms < best


def test_real_normals(real):
    """DiLiGenT's ball: the authors' truth."""
    stack = read_stack(real("photometric/diligent_ball"), gray=True)
    known = np.load(real("photometric/diligent_ball/normals.npy")).astype(np.float64)

    def errors(robust):
        normal = surface_maps(represent(stack, "gradient", robust=robust)).normal
        return np.degrees(np.arccos(np.clip((normal * known).sum(axis=-1), -1, 1)))[stack.mask]

    plain = errors(False)
    assert plain.mean() == pytest.approx(4.29, abs=0.05)
    assert np.median(plain) == pytest.approx(2.37, abs=0.05)
    assert errors(True).mean() < 2.3
