"""Weighted sums and robust fits: the kernels against slow references."""

from __future__ import annotations

import numpy as np
import pytest
from stacks import lambertian, noisy, relief, scattered

from intaglio import (
    PhotometricStack,
    represent,
    surface_maps,
)
from intaglio.kernels.launch import set_threads
from intaglio.kernels.lighting import products, robust_normals, weighted_sums


def test_weighted_sums_against_numpy(device):
    rng = np.random.default_rng(0)
    planes, weights = rng.normal(size=(13, 40_000)).astype(np.float32), rng.normal(size=(5, 13))
    expected = weights @ planes.astype(np.float64)
    for double, tolerance in ((False, 1e-5), (True, 1e-6)):
        np.testing.assert_allclose(weighted_sums(planes, weights, double=double, device=device), expected, atol=tolerance)
        floored = weighted_sums(planes, weights, floor=0.0, double=double, device=device)
        np.testing.assert_allclose(floored, np.maximum(expected, 0), atol=tolerance)
        out = np.ones((5, 40_000), np.float32)
        weighted_sums(planes, weights, out=out, add=True, double=double, device=device)
        np.testing.assert_allclose(out, expected + 1, atol=tolerance)


@pytest.mark.parametrize("double", [False, True])
def test_the_kernel_and_the_matrix_product_agree(double):
    """What CUDA runs, on the CPU."""
    import warp as wp

    from intaglio.kernels import lighting
    from intaglio.kernels.launch import launch

    rng = np.random.default_rng(1)
    planes, weights = rng.normal(size=(7, 999)).astype(np.float32), rng.normal(size=(3, 7))
    sums = wp.empty((3, 999), dtype=wp.float32, device="cpu")
    kernel, kind = (lighting.weighted_sums_double_kernel, wp.float64) if double else (lighting.weighted_sums_kernel, wp.float32)
    launch(
        kernel,
        999,
        inputs=[wp.array(planes, dtype=wp.float32, device="cpu"), wp.array(weights, dtype=kind, device="cpu"), 0.0],
        outputs=[sums],
        device="cpu",
    )
    np.testing.assert_allclose(sums.numpy(), weighted_sums(planes, weights, floor=0.0, double=double), atol=1e-6)


def test_threads_do_not_change_the_bits():
    rng = np.random.default_rng(2)
    planes, weights = rng.normal(size=(20, 100_001)).astype(np.float32), rng.normal(size=(6, 20))
    results = []
    for count in (1, 2, 5):
        set_threads(count)
        try:
            results.append((weighted_sums(planes, weights, double=True).tobytes(), products(planes).tobytes()))
        finally:
            set_threads(None)
    assert results[0] == results[1] == results[2]
    np.testing.assert_allclose(products(planes), planes.astype(np.float64) @ planes.T.astype(np.float64), rtol=1e-9, atol=1e-6)


def robust_reference(values, lights, dark, bright, tuning=2.0, iterations=8):
    """The same fit for one pixel, in double precision and with sorting."""
    lit = values > 0
    order = np.sort(values[lit])
    first, last = int(dark * len(order)) + 1, len(order) - int(bright * len(order))
    while last - first + 1 < min(len(order), 6):
        first, last = max(first - 1, 1), min(last + 1, len(order))
    kept = lit & (values >= order[first - 1]) & (values <= order[last - 1])
    i, towards = values[kept].astype(np.float64), lights[kept]
    weights = np.ones(len(i))
    for _ in range(iterations + 1):
        normal = np.linalg.solve((towards * weights[:, None]).T @ towards, (towards * weights[:, None]).T @ i)
        used = weights
        away = i - towards @ normal
        s = tuning * 1.4826 * np.sort(np.abs(away))[(len(i) + 1) // 2 - 1] + 1e-6 * order[last - 1]
        weights = 1 / (1 + (away / s) ** 2) ** 2
    return normal, used.sum() / len(values)


@pytest.mark.parametrize("spoil", ["nothing", "shadows", "fireflies"])
def test_robust_fit_against_the_reference(device, spoil):
    stack = noisy(scattered(40), seed=5)
    planes = stack.images.reshape(40, -1).copy()
    rng = np.random.default_rng(0)
    if spoil == "shadows":
        planes[rng.random(planes.shape) < 0.4] = 0
    if spoil == "fireflies":
        planes[rng.integers(40, size=planes.shape[1]), np.arange(planes.shape[1])] = 1e6
    found, confidence = robust_normals(planes, stack.lights, dark=0.25, bright=0.4, device=device)
    pairs = [robust_reference(planes[:, i], stack.lights, 0.25, 0.4) for i in range(planes.shape[1])]
    # Reweighting around a few values magnifies single precision, at a pixel or two.
    away = np.abs(found - [n for n, _ in pairs]).max(axis=1)
    assert np.median(away) < 1e-5
    assert np.quantile(away, 0.95) < 2e-3
    assert np.quantile(np.abs(confidence - [c for _, c in pairs]), 0.95) < 1e-2


@pytest.mark.filterwarnings("ignore:.*values are black")
@pytest.mark.parametrize("count", [12, 20, 40])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.7])
def test_robust_normals_in_deep_shadow(count, share):
    """Lambert's law with a share of the values in cast shadow: those lit are enough, as long as there are some."""
    lights = scattered(count, lowest=65)
    normal, _ = relief()
    images = lambertian(lights).images.mean(axis=3)
    images[np.random.default_rng(4).random(images.shape) < share] = 0
    lit = (images > 0).sum(axis=0)
    texture = represent(PhotometricStack(images, lights, ceiling=np.inf), "gradient", robust=True)
    angle = np.degrees(np.arccos(np.clip((surface_maps(texture).normal * normal).sum(axis=-1), -1, 1)))
    # Six values whose lights lie near one plane leave a degree or two of single precision, at a pixel of all.
    assert np.quantile(angle[lit >= 6], 0.97) < 0.2
    assert angle[lit >= 6].max() < 3
    assert (texture.confidence[lit < 6] == 0).all()
    assert (texture.confidence[lit >= 6] > 0).all()


def test_shadows_and_highlights_do_not_bend_robust_normals():
    lights = scattered(60, lowest=65)
    normal, _ = relief()
    images = lambertian(lights).images.copy()
    rng = np.random.default_rng(4)
    hidden = rng.random(images.shape[:3]) < 0.12
    images[hidden] = 0
    half = lights + (0, 0, 1)
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    images += 3 * np.einsum("kd,hwd->khw", half, normal)[..., None] ** 200
    stack = PhotometricStack(np.maximum(images, 0).astype(np.float32), lights, ceiling=np.inf)
    errors = []
    for robust in (False, True):
        maps = surface_maps(represent(stack, "gradient", robust=robust))
        errors.append(np.degrees(np.arccos(np.clip((maps.normal * normal).sum(axis=-1), -1, 1))).mean())
    assert errors[1] < 0.5
    assert errors[1] < 0.1 * errors[0]


def test_a_robust_fit_of_clean_data_is_exact_and_confident():
    normal, _ = relief()
    texture = represent(lambertian(scattered(40, lowest=60)), "gradient", robust=True)
    np.testing.assert_allclose(surface_maps(texture).normal, normal, atol=1e-3)
    assert texture.confidence.shape == (11, 17)
    # Of 40 lights 24 values may be outliers that were none: the others agree.
    assert texture.confidence.min() > 0.25
    assert texture.confidence.max() <= 1


def test_constant_and_black_pixels_stay_finite(device):
    planes = np.zeros((20, 3), np.float32)
    planes[:, 1] = 0.5
    planes[3, 2] = 1
    found, confidence = robust_normals(planes, scattered(20), dark=0.25, bright=0.4, device=device)
    assert np.isfinite(found).all()
    assert np.isfinite(confidence).all()
    np.testing.assert_array_equal(found[0], 0)
