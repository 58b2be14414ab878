"""Relightable textures rendered by Mitsuba, and simulated captures."""

from __future__ import annotations

import numpy as np
import pytest
from stacks import dome, lambertian, noisy, scattered

from intaglio import PhotometricStack, light_direction, represent, surface_maps
from intaglio.photometric.relightable import KINDS
from intaglio.photometric.rendering import bsdf_of
from intaglio.render import Gloss, Viewpoint, matte_bsdf, photometric_capture, relightable_bsdf, relit, relit_plane, variant
from intaglio.render.captures import height_mesh, height_normals
from intaglio.render.variants import mitsuba

LIGHT = light_direction(38, 41)
LOW = light_direction(205, 78)


@pytest.mark.parametrize("color", ["channels", "luminance"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_plane_equals_relight_pixel_for_pixel(kind, color):
    """Single precision: sums of up to 18 products of numbers near 1."""
    texture = represent(noisy(scattered(24), channels=3, height=7, width=12), kind, color=color)
    bsdf = bsdf_of(texture, smooth=False)
    for light in (LIGHT, LOW):
        shown = relit_plane(bsdf, (7, 12), light)
        np.testing.assert_allclose(shown, texture.relight(light), atol=3e-6)


@pytest.mark.parametrize("kind", ["eigen3", "eigen6"])
def test_the_plane_equals_relight_on_a_grid_of_lights(kind):
    texture = represent(noisy(dome(8, (0.0001, 30, 60))[7:], height=5, width=6), kind)
    assert texture.basis.parameters()["basis"] == "grid"
    for light in (LIGHT, LOW, light_direction(359.9, 29), light_direction(0, 0)):
        wanted = np.repeat(texture.relight(light), 3, axis=2)
        np.testing.assert_allclose(relit_plane(bsdf_of(texture, smooth=False), (5, 6), light), wanted, atol=3e-6)


def test_orientation_by_a_texture_without_symmetry():
    """One bright texel in the upper left corner, leaning right: it must stay there, and answer to light from the right."""
    maps = np.zeros((3, 4, 6, 1), np.float32)
    maps[:, 0, 1, 0] = (1, 0, 1)
    maps[:, 2, 5, 0] = (0, 1, 1)
    bsdf = relightable_bsdf(maps, lambda x, y, z, maths: [x, y, z], smooth=False)
    right = relit_plane(bsdf, (4, 6), np.array([1.0, 0, 1]))[..., 0]
    up = relit_plane(bsdf, (4, 6), np.array([0, 1.0, 1]))[..., 0]
    s = np.sqrt(0.5)
    assert right[0, 1] == pytest.approx(2 * s, abs=1e-6)
    assert right[2, 5] == pytest.approx(s, abs=1e-6)
    assert up[0, 1] == pytest.approx(s, abs=1e-6)
    assert up[2, 5] == pytest.approx(2 * s, abs=1e-6)
    assert np.count_nonzero(right) == 2


def test_front_side_only_and_nothing_below_the_horizon():
    maps = np.ones((1, 3, 3, 1), np.float32)
    bsdf = relightable_bsdf(maps, lambda x, y, z, maths: [0 * x + 1])
    assert (relit_plane(bsdf, (3, 3), np.array([0.3, 0, 1.0])) > 0.99).all()
    assert (relit_plane(bsdf, (3, 3), np.array([0.3, 0, 1.0]), facing=False) == 0).all()
    both = relightable_bsdf(maps, lambda x, y, z, maths: [0 * x + 1], back=True)
    assert (relit_plane(both, (3, 3), np.array([0.3, 0, 1.0]), facing=False) > 0.99).all()
    # A value that does not fall with the cosine is cut off sharply at the horizon.
    assert (relit_plane(bsdf, (3, 3), np.array([1.0, 0, -0.01])) == 0).all()


def test_negative_values_give_no_energy():
    maps = np.full((1, 2, 2, 3), -0.5, np.float32)
    bsdf = relightable_bsdf(maps, lambda x, y, z, maths: [0 * x + 1])
    np.testing.assert_array_equal(relit_plane(bsdf, (2, 2), LIGHT), 0)


def test_mirrored_texture_coordinates_keep_the_frame():
    """Where u runs to the left the texture is mirrored, and so is how it answers to light."""
    maps = np.zeros((2, 2, 4, 1), np.float32)
    maps[0, :, 0], maps[1, :, 3] = 1, 1
    bsdf = relightable_bsdf(maps, lambda x, y, z, maths: [x, y], smooth=False)
    vertices = np.array([[-2.0, -1, 0], [2, -1, 0], [2, 1, 0], [-2, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    camera = Viewpoint((0, 0, 50.0), (0, 0, 0), (0, 1.0, 0), fov=float(2 * np.degrees(np.arctan(1 / 50))))
    light = np.array([-0.6, 0.4, 1.0])
    x, y = light[:2] / np.linalg.norm(light)
    for uv, expected in (
        ([[0, 0], [1, 0], [1, 1], [0, 1]], [max(x, 0), y]),
        ([[1, 0], [0, 0], [0, 1], [1, 1]], [y, -x]),
    ):
        image = relit(vertices, faces, np.array(uv, float), bsdf, camera=camera, light=light, size=(20, 40), samples=4)
        np.testing.assert_allclose([image[10, 4, 0], image[10, 35, 0]], expected, atol=1e-4)


def test_gradient_equals_mitsubas_normal_map():
    texture = represent(lambertian(dome(), 9, 14), "gradient")
    maps = surface_maps(texture)
    bsdf = matte_bsdf(maps.normal, maps.albedo)
    for light in (LIGHT, light_direction(300, 60)):
        np.testing.assert_allclose(relit_plane(bsdf, (9, 14), light), texture.relight(light), atol=1e-5)


def test_repeats():
    texture = represent(noisy(scattered(20), height=4, width=6), "gradient")
    tiled = relit_plane(bsdf_of(texture, repeat=(2, 3), smooth=False), (12, 12), LIGHT)
    np.testing.assert_allclose(tiled[..., 0], np.tile(texture.relight(LIGHT)[..., 0], (3, 2)), atol=1e-5)


def test_texels_are_interpolated_between_their_middles():
    """With a path through every pixel's middle, bilinear interpolation gives the texels themselves, at the border too."""
    texture = represent(noisy(scattered(20), height=5, width=7), "gradient")
    wanted = np.repeat(texture.relight(LIGHT), 3, axis=2)
    for tiled in (True, False):
        np.testing.assert_allclose(relit_plane(bsdf_of(texture, smooth=True, tiled=tiled), (5, 7), LIGHT), wanted, atol=3e-6)
    # Twice the pixels: halfway between the first texel and what lies beyond the border.
    maps = np.zeros((1, 2, 4, 1), np.float32)
    maps[0, :, 3] = 1
    for tiled, beyond in ((True, 0.25), (False, 0.0)):
        bsdf = relightable_bsdf(maps, lambda x, y, z, maths: [0 * x + 1], tiled=tiled)
        vertices, faces = np.array([[-4.0, -2, 0], [4, -2, 0], [4, 2, 0], [-4, 2, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
        camera = Viewpoint((0, 0, 4000.0), (0, 0, 0), (0, 1.0, 0), fov=float(2 * np.degrees(np.arctan(2 / 4000))))
        uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
        image = relit(vertices, faces, uv, bsdf, camera=camera, light=np.array([0, 0, 1.0]), size=(4, 8), samples=4096)
        assert image[1, 0, 0] == pytest.approx(beyond, abs=0.06)


@pytest.mark.skipif(not variant().vectorized, reason="the chi-square test needs a JIT variant (an LLVM library)")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("back", [False, True])
def test_chi_square(kind, back):
    """Sampled directions follow the density; on a texture that is nowhere black, since a black sample counts as none."""
    import drjit as dr

    mi = mitsuba()
    lights = scattered(30)
    images = (0.3 + 0.6 * lights[:, 2])[:, None, None, None] * np.full((4, 4, 1), 0.7)
    texture = represent(PhotometricStack(images.astype(np.float32), lights), kind)
    name = f"relightable_{kind}_{back}"
    mi.register_bsdf(name, lambda properties: bsdf_of(texture, back=back))
    for wi in ((0.7, -0.4, 0.5), (0.3, 0.2, -0.9)) if back else ((0, 0, 1), (0.7, -0.4, 0.5)):
        sample, density = mi.chi2.BSDFAdapter(name, "", wi=dr.normalize(mi.ScalarVector3f(*wi)))
        test = mi.chi2.ChiSquareTest(
            domain=mi.chi2.SphericalDomain(), sample_func=sample, pdf_func=density, sample_dim=3, sample_count=200_000
        )
        assert test.run(), test.messages


def test_white_furnace():
    """Under light from everywhere a white matte texture shows the light's own value: eval, sample and pdf fit together."""
    mi = mitsuba()
    bsdf = relightable_bsdf(np.ones((1, 2, 2, 1), np.float32), lambda x, y, z, maths: [z])
    from intaglio.render.relightable import orthographic_sensor, textured_mesh

    corners = np.array([[-4.0, -4, 0], [4, -4, 0], [4, 4, 0], [-4, 4, 0]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    mesh = textured_mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), uv, bsdf, flat=True)
    for sampling in ({"emitter_samples": 0, "bsdf_samples": 1}, {"emitter_samples": 1, "bsdf_samples": 1}):
        scene = mi.load_dict(
            {
                "type": "scene",
                "integrator": {"type": "direct", **sampling},
                "mesh": mesh,
                "sky": {"type": "constant", "radiance": {"type": "rgb", "value": 0.5}},
            }
        )
        image = np.array(mi.render(scene, sensor=mi.load_dict(orthographic_sensor((4, 4), 1.0, 5.0)), spp=256, seed=0))
        # Sampled by the cosine the estimate is exact; by both ways it has the noise of 256 paths.
        np.testing.assert_allclose(image[..., :3], 0.5, atol=1e-4 if sampling["emitter_samples"] == 0 else 0.03)


# ---- captures ----


def hill(n=33):
    row, column = np.mgrid[:n, :n].astype(float)
    return 3 * np.exp(-((column - 12) ** 2 + (row - 18) ** 2) / 40) + 0.02 * column


def test_capture_follows_lamberts_law():
    height = hill()
    albedo = np.linspace(0.2, 0.9, 32 * 32 * 3).reshape(32, 32, 3)
    lights = np.array([LIGHT, light_direction(250, 30)])
    images = photometric_capture(height, albedo, lights, shadows=False, samples=64)
    expected = np.maximum(np.einsum("kd,hwd->khw", lights, height_normals(height)), 0)[..., None] * albedo
    # Normals and albedo vary within a pixel, and paths fall where they fall.
    assert np.median(np.abs(images - expected)) < 3e-3
    assert np.corrcoef(images.ravel(), expected.ravel())[0, 1] > 0.9995


def test_capture_is_seeded():
    args = hill(9), np.full((2, 2), 0.5), [LIGHT]
    first, second, other = (photometric_capture(*args, samples=2, seed=s) for s in (3, 3, 4))
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)


def test_shadows_interreflections_and_gloss():
    height = 6 * (np.mgrid[:33, :33][1] > 16).astype(float)
    low = [light_direction(0, 60)]
    args = height, np.full((2, 2), 0.8), low
    lit, dark = (photometric_capture(*args, shadows=s, samples=8)[0, 16, 8, 0] for s in (False, True))
    assert lit == pytest.approx(0.8 * 0.5, abs=1e-3)
    assert dark == 0
    # Lit from the other side the wall lights the floor before it.
    facing = height, np.full((2, 2), 0.8), [light_direction(180, 60)]
    single, many = (photometric_capture(*facing, bounces=b, samples=64)[0, 8:24, 12:15, 0].mean() for b in (0, 2))
    assert many > 1.1 * single
    flat = np.zeros((9, 9))
    mirrored = photometric_capture(flat, np.full((2, 2), 0.5), [[0, 0, 1]], gloss=Gloss(alpha=0.1), samples=4)
    assert mirrored.mean() > 0.6


def test_capture_of_another_size_and_orientation():
    height = np.zeros((9, 17))
    albedo = np.zeros((8, 16, 3))
    albedo[0, 1] = (1, 0, 0)
    image = photometric_capture(height, albedo, [[0, 0, 1]], size=(32, 64), samples=4)[0]
    assert image.shape == (32, 64, 3)
    peak = np.unravel_index(np.argmax(image[..., 0]), (32, 64))
    assert 0 <= peak[0] < 4
    assert 4 <= peak[1] < 8
    assert image[..., 1:].max() == 0


def test_height_mesh_faces_up():
    vertices, faces, uv = height_mesh(hill(5))
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    np.testing.assert_array_equal(uv[0], [0, 1])
    assert vertices[0, 1] > vertices[-1, 1]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"height": np.zeros((1, 5))}, "at least 2 x 2"),
        ({"height": np.full((5, 5), np.nan)}, "not finite"),
        ({"albedo": np.full((5, 5), 1.5)}, r"in \[0, 1\]"),
        ({"albedo": np.zeros((5, 5, 2))}, "albedo must be"),
        ({"lights": [[0, 0, -1]]}, "from above"),
        ({"size": (3, 4)}, "not square"),
        ({"bounces": -1}, "bounces"),
        ({"bounces": 1, "shadows": False}, "need shadows"),
    ],
)
def test_bad_captures(changes, message):
    args = {"height": np.zeros((5, 5)), "albedo": np.full((5, 5), 0.5), "lights": [[0, 0, 1]]}
    with pytest.raises(ValueError, match=message):
        photometric_capture(**(args | changes))


def test_a_relightable_bsdf_needs_maps():
    with pytest.raises(ValueError, match="texture coordinates must be"):
        relit(
            np.zeros((3, 3)), np.array([[0, 1, 2]]), np.zeros((2, 2)), None, camera=Viewpoint((0, 0, 1), (0, 0, 0)), light=LIGHT
        )
