"""From photographs or textures to larger ones that can be relit, and the other orders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from stacks import HELD_OUT, lambertian, scattered

from intaglio import (
    GrowOptions,
    InputError,
    Match,
    PhotometricStack,
    QuiltOptions,
    WeaveOptions,
    assess_synthesis,
    grow,
    light_direction,
    quilt,
    represent,
    surface_maps,
    synthesize,
    synthesize_each_light,
)
from intaglio.synthesis.sample import prepare_sample

KINDS = ("3i", "gradient", "ptm", "eigen3", "eigen6", "hsh", "rbf")


@pytest.fixture(scope="module")
def stack():
    return lambertian(scattered(24), height=40, width=44)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("color", ["channels", "luminance"])
def test_relighting_and_copying_commute(stack, kind, color):
    colours = PhotometricStack(stack.images * np.array([1.0, 0.7, 0.4], np.float32), stack.lights)
    sample = represent(colours, kind, color=color)
    result = synthesize(colours, (50, 61), QuiltOptions(block=14), kind=kind, color=color, seed=3)
    assert result.texture.kind == kind
    assert result.texture.shape == (50, 61, 3)
    for light in HELD_OUT[:3]:
        # A matrix product of another size may add in another order: a few units in the last place.
        wanted = result.copy_of(sample.relight(light))
        np.testing.assert_allclose(result.texture.relight(light), wanted, rtol=3e-7, atol=1e-7)


def test_a_texture_and_its_photographs_give_the_same(stack):
    a = synthesize(stack, 40, QuiltOptions(block=12), kind="ptm", seed=1)
    b = synthesize(represent(stack, "ptm"), 40, QuiltOptions(block=12), seed=1)
    np.testing.assert_array_equal(a.texture.maps, b.texture.maps)


def test_masked_pixels_of_a_texture_are_never_copied(stack):
    mask = np.ones((40, 44), bool)
    mask[10:15, 20:30] = False
    sample = represent(PhotometricStack(stack.images, stack.lights, mask), "gradient")
    for options in (QuiltOptions(block=8), GrowOptions()):
        result = synthesize(sample, 40, options)
        assert mask[result.source[..., 0], result.source[..., 1]].all()
        assert result.texture.mask is None


def test_a_height_map_is_synthesised_and_lit_by_its_own_slopes(stack):
    sample = represent(stack, "height")
    result = synthesize(stack, 64, QuiltOptions(block=16), kind="height", tileable=True, seed=1)
    assert result.texture.kind == "height"
    np.testing.assert_array_equal(result.texture.height, result.maps[..., 0])
    z = result.texture.height
    p, q = (np.roll(z, -1, 1) - np.roll(z, 1, 1)) / 2, (np.roll(z, 1, 0) - np.roll(z, -1, 0)) / 2
    normal = result.texture.maps[..., 0] / np.linalg.norm(result.texture.maps[..., 0], axis=0)
    slope = -normal[:2] / normal[2]
    # What is left is the sample's mean slope.
    left = slope - np.stack([p, q])
    np.testing.assert_allclose(left, left.mean(axis=(1, 2), keepdims=True) * np.ones_like(left), atol=1e-4)
    whole = synthesize(sample, (40, 44), QuiltOptions(block=40, overlap=4, refine=0))
    light = light_direction(45, 45)
    # The first block, but for where the next cuts in.
    inside = np.s_[2:-2, 2:34]
    y, x = whole.source[0, 0]
    expected = sample.relight(light)[y : y + 40, x : x + 40]
    np.testing.assert_allclose(whole.texture.relight(light)[:40, :40][inside], expected[inside], atol=0.05)


def test_heights_are_joined_and_their_central_slopes_light_as_the_sample_does(stack):
    sample = represent(stack, "height")
    made = synthesize(sample, 80, seed=1)
    laid = made.copy_of(sample.height)
    assert made.moved.shape == made.maps.shape == (80, 80, 1 + sample.maps.shape[3])
    np.testing.assert_allclose(made.maps[..., 0] - made.moved[..., 0] - laid, _plane(made, sample), atol=1e-3)
    # Pieces of a slope would leave cliffs.
    steps = [
        max(np.abs(np.diff(z, axis=a)).max() for a in (0, 1)) for z in (made.maps[..., 0], made.maps[..., 0] - made.moved[..., 0])
    ]
    assert steps[0] < 0.6 * steps[1]


def _plane(made, sample):
    """Return what is left of a plane: the sample's plane of best fit where each pixel comes from, with a minus."""
    y, x = np.mgrid[: sample.height.shape[0], : sample.height.shape[1]]
    columns = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], axis=1)
    fitted = np.linalg.lstsq(columns, sample.height.ravel().astype(float), rcond=None)[0]
    return -made.copy_of((columns @ fitted).reshape(sample.height.shape))


def test_the_gradient_approach_compares_slopes_and_albedo(stack):
    """The thesis, section 6.2.2: p, q and albedo at equal range, not normals scaled by the albedo."""
    sample = represent(stack, "gradient")
    maps = surface_maps(sample)
    planes = [maps.p, maps.q, maps.albedo]
    by_kind = synthesize(sample, 72, QuiltOptions(block=16), seed=3)
    by_hand = synthesize(sample, 72, QuiltOptions(block=16), match=planes, seed=3)
    np.testing.assert_array_equal(by_kind.source, by_hand.source)
    scaled = synthesize(sample, 72, QuiltOptions(block=16), match=np.moveaxis(sample.maps[..., 0], 0, 2), seed=3)
    assert (scaled.source != by_kind.source).any()


def test_a_few_steep_pixels_do_not_shrink_the_range_of_all_slopes(stack):
    sample = represent(stack, "gradient")
    spoiled = sample.maps.copy()
    spoiled[0, 20, 20], spoiled[2, 20, 20] = 1.0, 0.01
    features = [prepare_sample(replace(sample, maps=m)).features for m in (sample.maps, spoiled)]
    assert features[1][0].std() > 0.3 * features[0][0].std()


def test_the_other_order_gives_an_image_for_each_light(stack):
    lights = HELD_OUT[:2]
    results = synthesize_each_light(stack, 40, lights, QuiltOptions(block=12), kind="gradient", seed=1)
    images = represent(stack, "gradient").relight(lights)
    assert len(results) == 2
    for result, image in zip(results, images, strict=True):
        np.testing.assert_array_equal(result.maps, image[result.source[..., 0], result.source[..., 1]])


def test_plain_maps_and_all_methods():
    maps = [np.random.default_rng(0).random((30, 30)), np.random.default_rng(1).random((30, 30, 2))]
    for options in (WeaveOptions(exact=True), QuiltOptions(), GrowOptions()):
        result = synthesize(maps, 40, options, seed=1)
        assert result.maps.shape == (40, 40, 3)
        np.testing.assert_array_equal(result.maps[..., 1:], result.copy_of(maps[1]))
        assert result.texture is None


@pytest.mark.parametrize(
    ("make", "options", "message"),
    [
        (QuiltOptions, {"tolerance": -1}, "tolerance must be"),
        (QuiltOptions, {"cut": "straight"}, "cut must be one of"),
        (QuiltOptions, {"continuation": 3}, "continuation must be one of"),
        (QuiltOptions, {"block": True}, "block must be"),
        (QuiltOptions, {"overlap": 0}, "overlap must be"),
        (QuiltOptions, {"refine": 1.5}, "refine must be"),
        (WeaveOptions, {"block": 1}, "block must be"),
        (WeaveOptions, {"passes": -1}, "passes must be"),
        (GrowOptions, {"window": 8}, "window must be a whole number from 1 to 7"),
        (GrowOptions, {"levels": 13}, "levels must be"),
        (GrowOptions, {"exhaustive": 2}, "exhaustive must be"),
        (Match, {"metric": "l2"}, "metric must be one of"),
    ],
)
def test_bad_options_are_named_when_they_are_made(make, options, message):
    with pytest.raises(InputError, match=message):
        make(**options)


def test_options_of_no_method_are_refused(stack):
    with pytest.raises(InputError, match="QuiltOptions or GrowOptions"):
        synthesize(np.zeros((30, 30)), 40, "grow")
    with pytest.raises(InputError, match="QuiltOptions or GrowOptions"):
        synthesize_each_light(stack, 40, [[0, 0, 1]], {"block": 8})


def test_options_are_those_of_the_methods():
    sample = np.random.default_rng(0).random((30, 30))
    blocks = QuiltOptions(block=9, overlap=4, tolerance=0.3, cut="graph", continuation="avoid", refine=1)
    np.testing.assert_array_equal(
        synthesize(sample, 40, blocks, seed=3).source,
        quilt(sample, 40, 9, 4, 0.3, cut="graph", continuation="avoid", refine=1, seed=3).source,
    )
    pixels = GrowOptions(window=1, levels=2, exhaustive=0.5)
    np.testing.assert_array_equal(
        synthesize(sample, 40, pixels, seed=3).source, grow(sample, 40, window=1, levels=2, exhaustive=0.5, seed=3).source
    )


def test_bad_input_of_the_other_order(stack):
    with pytest.raises(InputError, match="from below"):
        synthesize_each_light(stack, 40, [[0, 0, -1]])
    with pytest.raises(InputError, match="source must be"):
        synthesize_each_light(np.zeros((5, 5)), 40, [[0, 0, 1]])
    with pytest.raises(InputError, match="lights: sample and result"):
        assess_synthesis(np.zeros((30, 30)), synthesize(np.zeros((30, 30)), 40), lights={"x": np.array([0, 0, 1.0])})


def test_real_photographs(real):
    from intaglio import read_stack

    stack = read_stack(real("photometric/lionhead_rti_tiny"), "linear").gray()
    sample = represent(stack, "eigen3")
    result = synthesize(stack, 96, kind="eigen3", seed=1)
    report = assess_synthesis(sample, result, lights={"a": light_direction(60, 60)})
    assert report.relit["under a"].coherence < 0.2
    assert report.likeness.correlation < 0.5
