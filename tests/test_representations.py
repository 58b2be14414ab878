"""Kinds of relightable textures: exact facts, the slow reference, leave-one-out by brute force, and the published figures."""

from __future__ import annotations

import numpy as np
import pytest
from stacks import HELD_OUT, dome, lambertian, noisy, relief, scattered, truth

import intaglio
from intaglio import (
    InputError,
    IntaglioWarning,
    PhotometricStack,
    assess_representation,
    light_direction,
    represent,
    surface_maps,
)
from intaglio.photometric.bases import HemisphericalBasis, PolynomialBasis, coefficients
from intaglio.photometric.interpolation import grid_of, interpolate, smooth
from intaglio.photometric.linear_fits import individual_information, information
from intaglio.photometric.relightable import KINDS
from intaglio.photometric.representation import stack_moments

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
    alone = individual_information(stack_moments(stack))
    np.testing.assert_allclose(alone, w / np.sqrt((w**2).sum()), atol=1e-6)
    assert f"one by one {alone[0]:.2%}" in texture.notes[0]


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
        assert report.normalized_rms == pytest.approx(
            assess_representation(PhotometricStack(stack.images, lights, mask), kind).normalized_rms, rel=1e-6
        )


def test_the_order_of_images_does_not_matter():
    stack = noisy(scattered(30))
    turned = stack.subset(np.random.default_rng(0).permutation(30))
    for kind in KINDS:
        a, b = represent(stack, kind).relight(HELD_OUT), represent(turned, kind).relight(HELD_OUT)
        np.testing.assert_allclose(a, b, atol=2e-5)


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
    with pytest.raises(InputError, match="without image"):
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
    # A matrix product of more columns may add in another order: one unit in the last place.
    np.testing.assert_allclose(many[0], texture.relight(light), rtol=0, atol=1.2e-7)
    assert intaglio.Relightable is type(texture)
