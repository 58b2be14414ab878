"""Kinds of relightable textures: exact facts, the slow reference, leave-one-out by brute force, and the published figures."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from stacks import dome, lambertian, noisy, relief, scattered, write_capture

import intaglio
from intaglio import (
    InputError,
    IntaglioWarning,
    PhotometricStack,
    assess_representation,
    light_direction,
    read_stack,
    represent,
    surface_maps,
)
from intaglio.images import write_exr
from intaglio.kernels.launch import set_threads
from intaglio.kernels.lighting import products, robust_normals, weighted_sums
from intaglio.photometric.bases import HemisphericalBasis, PolynomialBasis, coefficients
from intaglio.photometric.interpolation import grid_of, interpolate, smooth
from intaglio.photometric.linear_fits import LINEAR_KINDS, Moments, information
from intaglio.photometric.relightable import KINDS
from intaglio.photometric.represent import stack_moments

HELD_OUT = np.array([light_direction(t, s) for t, s in ((10, 20), (100, 45), (200, 33), (333, 62))])


def truth(lights, height=11, width=17):
    normal, albedo = relief(height, width)
    return np.einsum("kd,hwd->khw", lights, normal)[..., None] * albedo


# ---- exact facts ----


@pytest.mark.parametrize("kind", ["3i", "gradient", "rbf"])
def test_lamberts_law_is_relit_exactly(kind):
    texture = represent(lambertian(dome()), kind)
    np.testing.assert_allclose(texture.relight(HELD_OUT, clip=False), truth(HELD_OUT), atol=3e-6)


@pytest.mark.parametrize("kind", ["eigen3", "eigen6"])
def test_lamberts_law_is_exact_between_triangles_of_lights(kind):
    texture = represent(lambertian(dome()), kind, interpolation="triangles")
    np.testing.assert_allclose(texture.relight(HELD_OUT, clip=False), truth(HELD_OUT), atol=3e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_a_flat_albedo_relights_to_albedo_times_cosine(kind):
    """At the lights of the stack; the quadratic polynomial takes the parabola nearest to cos σ instead."""
    lights = dome(8, (15, 35, 55))
    albedo = np.linspace(0.1, 0.9, 30).reshape(5, 6)
    stack = PhotometricStack((lights[:, 2, None, None] * albedo).astype(np.float32), lights)
    relit = represent(stack, kind, **({"smoothing": 0.0} if kind == "rbf" else {})).relight(lights)[..., 0]
    cosine = lights[:, 2]
    if kind == "ptm":
        terms = coefficients(PolynomialBasis(), lights)
        cosine = terms @ np.linalg.lstsq(terms, cosine, rcond=None)[0]
        assert np.abs(cosine - lights[:, 2]).max() < 0.02
    np.testing.assert_allclose(relit, cosine[:, None, None] * albedo, atol=1e-5)


def test_three_images_are_the_thesis_lights_and_its_formula():
    lights = np.concatenate([dome(4, (45,)), dome(4, (20, 70))])
    stack = noisy(lights)
    texture = represent(stack, "3i")
    np.testing.assert_array_equal(texture.maps, stack.images[[0, 1, 2]])
    tilt, slant = np.radians(30), np.radians(50)
    s, c = np.sin(np.radians(45)), np.cos(np.radians(45))
    x, y, z = np.cos(tilt) * np.sin(slant), np.sin(tilt) * np.sin(slant), np.cos(slant)
    # Eq. (*): c of the thesis for tilts 0°, 90°, 180° at 45°.
    expected = [x / (2 * s) - y / (2 * s) + z / (2 * c), y / s, z / (2 * c) - x / (2 * s) - y / (2 * s)]
    np.testing.assert_allclose(texture.coefficients(light_direction(30, 50)), expected, atol=1e-12)


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("kind", ["gradient", "ptm", "hsh"])
def test_least_squares_against_numpy(kind, channels):
    stack = noisy(scattered(40), channels=channels)
    texture = represent(stack, kind)
    x, y = stack.lights[:, 0], stack.lights[:, 1]
    matrix = {
        "gradient": stack.lights,
        "ptm": np.stack([x * x, y * y, x * y, x, y, np.ones_like(x)], axis=1),
        "hsh": coefficients(HemisphericalBasis(3), stack.lights),
    }[kind]
    expected = np.linalg.lstsq(matrix, stack.images.reshape(len(matrix), -1).astype(np.float64), rcond=None)[0]
    # Sums run in double precision; the maps are rounded to float32.
    np.testing.assert_allclose(texture.maps.reshape(len(texture.maps), -1), expected, atol=2e-6)


def test_hemispherical_harmonics_are_orthonormal():
    z = (np.arange(400) + 0.5) / 400
    angle = 2 * np.pi * np.arange(64) / 64
    height, turn = (a.ravel() for a in np.meshgrid(z, angle))
    across = np.sqrt(1 - height**2)
    lights = np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)
    values = coefficients(HemisphericalBasis(3), lights)
    np.testing.assert_allclose(values.T @ values * 2 * np.pi / len(lights), np.eye(9), atol=2e-3)


def test_eigen_images_are_the_best_of_their_number():
    stack = noisy(dome())
    planes = stack.images.reshape(len(stack.lights), -1).astype(np.float64)
    u, w, vt = np.linalg.svd(planes.T, full_matrices=False)
    texture = represent(stack, "eigen6")
    best = (u[:, :6] * w[:6]) @ vt[:6]
    np.testing.assert_allclose(texture.relight(stack.lights, clip=False).reshape(len(planes), -1), best.T, atol=1e-5)
    np.testing.assert_allclose(np.abs(texture.maps.reshape(6, -1)), np.abs(u[:, :6] * w[:6]).T, atol=1e-4)
    np.testing.assert_allclose(information(stack_moments(stack)), np.sqrt(np.cumsum(w**2) / (w**2).sum()), atol=1e-9)


def test_bilinear_interpolation_on_the_grid():
    """Eq. 4.4.16 at a node, halfway between two, and in the middle of four; the tilt goes round."""
    lights = dome(8, (20, 40, 60))
    table = np.random.default_rng(0).normal(size=(24, 2))
    basis = interpolate(lights, table)
    grid = table.reshape(3, 8, 2)
    np.testing.assert_allclose(coefficients(basis, lights), table, atol=1e-9)

    def at(tilt, slant):
        return coefficients(basis, light_direction(tilt, slant)[None])[0]

    np.testing.assert_allclose(at(22.5, 40), (grid[1, 0] + grid[1, 1]) / 2, atol=1e-9)
    np.testing.assert_allclose(at(337.5, 20), (grid[0, 7] + grid[0, 0]) / 2, atol=1e-9)
    np.testing.assert_allclose(
        at(90 + 9, 25), 0.8 * (0.75 * grid[0, 2] + 0.25 * grid[1, 2]) + 0.2 * (0.75 * grid[0, 3] + 0.25 * grid[1, 3]), atol=1e-9
    )
    np.testing.assert_allclose(at(45, 5), grid[0, 1], atol=1e-9)
    np.testing.assert_allclose(at(45, 85), grid[2, 1] * np.cos(np.radians(85)) / np.cos(np.radians(60)), atol=1e-9)


def test_grids_are_told_from_scattered_lights():
    tilts, slants, numbers = grid_of(dome(8, (20, 40, 60), turn=359.9))
    assert numbers.shape == (8, 3)
    assert sorted(numbers.ravel()) == list(range(24))
    np.testing.assert_allclose(slants, [20, 40, 60], atol=1e-6)
    zenith = np.concatenate([dome(6, (30, 60)), [[0, 0, 1]]])
    tilts, slants, numbers = grid_of(zenith)
    assert slants[0] == 0
    assert (numbers[:, 0] == 12).all()
    assert len(tilts) == 6
    assert grid_of(scattered(24)) is None
    assert grid_of(dome(8, (20, 40, 60))[:-1]) is None
    with pytest.raises(InputError, match="no full grid"):
        interpolate(scattered(24), np.eye(24), "grid")


def test_outside_the_hull_coefficients_fall_with_the_cosine():
    lights = np.concatenate([dome(12, (10, 20, 30, 40)), [[0, 0, 1]]])
    inside, below = scattered(200, lowest=38), scattered(400, lowest=89.9)
    ones = interpolate(lights, np.ones((len(lights), 1)), "triangles")
    # A constant: 2 % is 1/cos of the largest triangle's radius of 11 degrees.
    constant = coefficients(ones, inside)
    assert constant.min() > 1 - 1e-9
    assert constant.max() < 1.03
    fallen = coefficients(ones, below)[:, 0]
    np.testing.assert_allclose(fallen, np.minimum(below[:, 2] / np.cos(np.radians(40)), 1), atol=0.04)
    table = (np.arange(len(lights)) % 12 == 3).astype(float)[:, None]
    low = coefficients(interpolate(lights, table, "triangles"), np.array([light_direction(t, 70.0) for t in range(0, 360, 30)]))
    # What holds for one tilt at the border goes on at that tilt, and nowhere else.
    assert low[3, 0] > 0.9 * np.cos(np.radians(70)) / np.cos(np.radians(40))
    np.testing.assert_allclose(np.delete(low[:, 0], 3), 0, atol=0.06)


@pytest.mark.parametrize("chart", ["stereographic", "azimuthal", "chord"])
@pytest.mark.parametrize("kernel", ["thin-plate", "cubic"])
@pytest.mark.parametrize("trend", ["lambert", "chart"])
def test_smooth_interpolation_passes_through_its_nodes(chart, kernel, trend):
    lights = scattered(25)
    table = np.random.default_rng(1).normal(size=(25, 3))
    basis = smooth(lights, table, chart, kernel, trend, 0.0)
    np.testing.assert_allclose(coefficients(basis, lights), table, atol=1e-8)
    assert np.isfinite(coefficients(basis, np.array([[0.0, 0.0, 1.0]]))).all()
    loose = smooth(lights, table, chart, kernel, trend, 10.0)
    assert np.abs(coefficients(loose, lights) - table).max() > 0.1


def test_normals_and_albedo_of_lamberts_law():
    normal, albedo = relief()
    for kind in ("gradient", "3i", "rbf"):
        maps = surface_maps(represent(lambertian(dome()), kind))
        np.testing.assert_allclose(maps.normal, normal, atol=1e-5)
        np.testing.assert_allclose(maps.albedo, albedo, atol=1e-5)
        np.testing.assert_allclose(maps.p, -normal[..., 0] / normal[..., 2], atol=1e-5)
        assert maps.valid.all()


def test_luminance_and_chromaticity():
    lights = dome()
    stack = lambertian(lights)
    texture = represent(stack, "gradient", color="luminance")
    assert texture.maps.shape[3] == 1
    assert texture.shape == (11, 17, 3)
    # One colour per pixel: nothing is lost on Lambert's law.
    np.testing.assert_allclose(texture.relight(HELD_OUT, clip=False), truth(HELD_OUT), atol=1e-5)


def test_mask_leaves_zeros_and_decides_the_fit():
    lights = dome()
    stack = noisy(lights)
    mask = np.zeros(stack.shape[1:3], bool)
    mask[2:6, 3:8] = True
    spoilt = stack.images.copy()
    spoilt[:, ~mask] = np.nan
    whole = represent(PhotometricStack(stack.images, lights, mask), "eigen6")
    masked = represent(PhotometricStack(spoilt, lights, mask), "eigen6")
    np.testing.assert_array_equal(masked.maps, whole.maps)
    assert (masked.maps[:, ~mask] == 0).all()
    cut = represent(PhotometricStack(stack.images[:, 2:6, 3:8], lights), "eigen6")
    np.testing.assert_allclose(masked.maps[:, 2:6, 3:8], cut.maps, atol=1e-5)
    for kind in KINDS:
        texture = represent(PhotometricStack(spoilt, lights, mask), kind)
        assert np.isfinite(texture.maps).all()
        report = assess_representation(PhotometricStack(spoilt, lights, mask), kind)
        assert report.normalised_rms == pytest.approx(
            assess_representation(PhotometricStack(stack.images, lights, mask), kind).normalised_rms, rel=1e-6
        )


def test_the_order_of_images_does_not_matter():
    stack = noisy(scattered(30))
    turned = stack.subset(np.random.default_rng(0).permutation(30))
    for kind in KINDS:
        a, b = represent(stack, kind).relight(HELD_OUT), represent(turned, kind).relight(HELD_OUT)
        np.testing.assert_allclose(a, b, atol=2e-5)


# ---- kernels ----


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
    kernel, kind = (lighting._weighted_sums_double, wp.float64) if double else (lighting._weighted_sums, wp.float32)
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


# ---- assessment ----


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
    assert report.normalised_rms == pytest.approx(eta, rel=1e-4)
    assert report.relative == pytest.approx(relative, rel=1e-4)
    np.testing.assert_allclose(report.per_image, per_image, rtol=1e-3)
    assert (report.kind, report.leave_one_out) == (kind, left_out)


def test_leaving_one_out_of_hardly_enough_lights():
    """A ring and two lights near the zenith: without one of them the rest hardly tells anything, and no number is made up."""
    ring = np.concatenate([dome(8, (50,)), [light_direction(0, 3)], [light_direction(180, 4)]])
    assert np.isfinite(assess_representation(noisy(ring), "rbf", True).normalised_rms)
    arc = [light_direction(0, s) for s in (5, 15, 25, 35, 45, 55)]
    for others in ([light_direction(90, 30)], [light_direction(90, 30), light_direction(270, 30)]):
        with pytest.raises(InputError, match=r"leaving out image 6|too close together"):
            assess_representation(noisy(np.array(arc + others)), "rbf", True)


def test_prediction_is_harder_than_reconstruction():
    stack = noisy(scattered(24))
    for kind in LINEAR_KINDS:
        assert assess_representation(stack, kind, True).normalised_rms > assess_representation(stack, kind).normalised_rms


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
    assert np.isfinite(report.normalised_rms)


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
    stack = read_stack(real(f"photometric/{item}"), "linear", grey=True)
    for kind, expected in (("gradient", gradient), ("ptm", ptm)):
        for left_out in (False, True):
            assert assess_representation(stack, kind, left_out).normalised_rms == pytest.approx(expected[left_out], abs=0.005)
    assert assess_representation(stack, "eigen6").normalised_rms == pytest.approx(eigen6, abs=0.006)
    assert assess_representation(stack, "rbf", True).normalised_rms < best


def test_real_normals(real):
    """DiLiGenT's ball: the authors' truth."""
    stack = read_stack(real("photometric/diligent_ball"), grey=True)
    known = np.load(real("photometric/diligent_ball/normals.npy")).astype(np.float64)

    def errors(robust):
        normal = surface_maps(represent(stack, "gradient", robust=robust)).normal
        return np.degrees(np.arccos(np.clip((normal * known).sum(axis=-1), -1, 1)))[stack.mask]

    plain = errors(False)
    assert plain.mean() == pytest.approx(4.29, abs=0.05)
    assert np.median(plain) == pytest.approx(2.37, abs=0.05)
    assert errors(True).mean() < 2.3


# ---- stacks on disk ----


@pytest.mark.parametrize("kind", KINDS)
def test_stacks_on_disk_give_the_same_texture(kind, tmp_path):
    stack = noisy(scattered(20), channels=3, height=31, width=29)
    path = write_capture(tmp_path, stack)
    near, far = (
        represent(read_stack(path, memory=m), kind, **({"components": 5} if kind == "rbf" else {})) for m in (1 << 30, 0)
    )
    # Principal images of a stack on disk come from subspace iteration, and "rbf" chooses its smoothing by a sample.
    tolerance = {"eigen3": 3e-3, "eigen6": 1e-2, "rbf": 5e-2}.get(kind, 1e-5)
    np.testing.assert_allclose(far.relight(HELD_OUT), near.relight(HELD_OUT), atol=tolerance)


@pytest.mark.parametrize("kind", ["ptm", "hsh", "eigen6", "rbf"])
def test_nan_outside_the_mask_of_a_stack_on_disk(kind, tmp_path):
    stack = noisy(scattered(20), channels=3)
    images = stack.images.copy()
    mask = np.ones(stack.shape[1:3], bool)
    mask[:3] = False
    images[:, ~mask] = np.nan
    path = write_capture(tmp_path, stack)
    for k in range(20):
        write_exr({c: images[k, :, :, i] for i, c in enumerate("RGB")}, tmp_path / f"image_{k}.exr")
    options = {"components": 5} if kind == "rbf" else {}
    for color in ("channels", "luminance"):
        near, far = (represent(read_stack(path, mask=mask, memory=m), kind, color=color, **options) for m in (1 << 30, 0))
        assert np.isfinite(far.maps).all()
        # The sample that "rbf" chooses its smoothing by is a few pixels here.
        np.testing.assert_allclose(far.relight(HELD_OUT), near.relight(HELD_OUT), atol=5e-2 if kind == "rbf" else 2e-2)
        if near.chroma is not None:
            assert np.ptp(near.chroma[mask], axis=1).max() > 0.1


@pytest.fixture(scope="module")
def large_capture(tmp_path_factory):
    """24 images of 4.3 MB as float32, of noise."""
    folder = tmp_path_factory.mktemp("large")
    base = np.random.default_rng(0).integers(40, 250, (500, 720, 3), np.uint8)
    rows = []
    for k, light in enumerate(scattered(24)):
        Image.fromarray((base * light[2]).astype(np.uint8)).save(folder / f"{k}.bmp")
        rows.append(f"{k}.bmp " + " ".join(map(str, light)))
    (folder / "c.lp").write_text("\n".join(rows))
    return folder / "c.lp"


@pytest.mark.parametrize(
    ("kind", "options", "most"),
    [
        ("ptm", {}, 3.3),
        ("eigen6", {}, 3.3),
        ("rbf", {"components": 5}, 3.3),
        ("ptm", {"color": "luminance"}, 3.3),
        ("gradient", {"robust": True}, 4.3),
    ],
)
@pytest.mark.parametrize("masked", [False, True])
def test_memory_of_stacks_on_disk(kind, options, most, masked, large_capture, monkeypatch):
    """The maps and three images, whatever the number of images (four for robust fits)."""
    import tracemalloc

    mask = np.ones((500, 720), bool)
    mask[:, :100] = False
    stack = read_stack(large_capture, memory=0, mask=mask if masked else None)
    monkeypatch.setattr("intaglio.photometric.stack.STRIP_BYTES", 4 << 20)
    tracemalloc.start()
    try:
        texture = represent(stack, kind, **options)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    extra = 0 if texture.chroma is None else texture.chroma.nbytes
    assert (peak - texture.maps.nbytes - extra) / (4 * 3 * 500 * 720) < most


def test_robust_fits_of_stacks_on_disk(tmp_path):
    stack = noisy(scattered(20), channels=3)
    path = write_capture(tmp_path, stack)
    far = represent(read_stack(path, memory=0), "gradient", robust=True)
    near = represent(stack, "gradient", robust=True)
    np.testing.assert_array_equal(far.maps, near.maps)
    np.testing.assert_array_equal(far.confidence, near.confidence)


def test_luminance_of_a_stack_on_disk(tmp_path):
    path = write_capture(tmp_path, noisy(scattered(20), channels=3))
    near, far = (represent(read_stack(path, memory=m), "ptm", color="luminance") for m in (1 << 30, 0))
    np.testing.assert_allclose(far.relight(HELD_OUT), near.relight(HELD_OUT), atol=1e-5)


# ---- bad input ----


def test_unknown_kinds_list_the_known():
    with pytest.raises(InputError, match=r"'hdr' is not known; known: 3i, gradient, ptm, hsh, eigen3, eigen6, rbf, height"):
        represent(noisy(dome()), "hdr")
    with pytest.raises(InputError, match="known: 3i"):
        assess_representation(noisy(dome()), "hdr")


@pytest.mark.parametrize(
    ("kind", "count"), [("3i", 2), ("gradient", 2), ("ptm", 5), ("hsh", 8), ("eigen3", 2), ("eigen6", 5), ("rbf", 5)]
)
def test_fewer_images_than_unknowns(kind, count):
    with pytest.raises(InputError, match=rf"the stack has (only )?{count}"):
        represent(noisy(scattered(count)), kind)


def test_lights_in_one_plane():
    flat = np.array([light_direction(t, s) for t in (0, 180) for s in (10, 25, 40, 55)])
    for kind in ("gradient", "height"):
        with pytest.raises(InputError, match=r"only 2 of the 3.*one plane"):
            represent(noisy(flat), kind)
    with pytest.raises(InputError, match=r"lie in one plane; use .gradient."):
        represent(noisy(flat), "3i")
    with pytest.raises(InputError, match="one line"):
        represent(noisy(flat), "eigen3")
    with pytest.raises(InputError, match=r"only 5 of the 6 coefficients of 'ptm'"):
        represent(noisy(dome(12, (45,))), "ptm")


def test_all_lights_in_one_direction():
    for kind in KINDS:
        with pytest.raises(InputError):
            represent(noisy(np.tile([0.1, 0.2, 1.0], (9, 1))), kind)


def test_leaving_one_out_needs_more_images():
    with pytest.raises(InputError, match="leaving out image"):
        assess_representation(noisy(scattered(6)), "ptm", True)


def test_saturated_and_black_stacks():
    lights = dome()
    images = np.clip(noisy(lights).images * 2.5, 0, 1)
    share = np.mean(images >= 1)
    assert share > 0.05
    with pytest.warns(IntaglioWarning, match=f"{share:.0%} of the stack's values are overexposed"):
        represent(PhotometricStack(images, lights), "ptm")
    with pytest.warns(IntaglioWarning, match="black"):
        represent(PhotometricStack(np.maximum(images - 0.75, 0) * 0.9, lights), "ptm")
    with pytest.raises(InputError, match="black: no value is over 0"):
        represent(PhotometricStack(np.zeros((32, 4, 4)), lights), "ptm")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "ptm", "robust": True}, "robust fitting is there for"),
        ({"kind": "ptm", "color": "rgb"}, "color 'rgb'"),
        ({"kind": "hsh", "order": 4}, "order 4"),
        ({"kind": "eigen3", "interpolation": "spline"}, "interpolation 'spline'"),
        ({"kind": "rbf", "components": 0}, "components must be"),
        ({"kind": "rbf", "components": 33}, "components must be"),
        ({"kind": "rbf", "smoothing": -1}, "smoothing must be"),
        ({"kind": "height", "integration": "haar"}, "integration 'haar'"),
        ({"kind": "height", "differentiation": "haar"}, "differentiation 'haar'"),
        ({"kind": "ptm", "device": "cuda:9"}, "not available"),
    ],
)
def test_bad_options(options, message):
    with pytest.raises(InputError, match=message):
        represent(noisy(dome()), **options)


@pytest.mark.parametrize("light", [(0, 0, 0), (1, 0, -0.2), (np.nan, 0, 1), (1, 2), "up"])
def test_bad_lights_to_relight_by(light):
    texture = represent(noisy(dome()), "ptm")
    with pytest.raises(InputError, match="light"):
        texture.relight(light)


def test_relit_values_are_not_negative_unless_asked():
    texture = represent(lambertian(dome()), "gradient")
    light = np.array([0.99, 0, 0.02])
    assert texture.relight(light).min() == 0
    assert texture.relight(light, clip=False).min() < 0
    many = texture.relight(np.array([light, [0, 0, 1]]))
    np.testing.assert_array_equal(many[0], texture.relight(light))
    assert intaglio.Relightable is type(texture)
