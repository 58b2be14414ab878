"""Uneven light over a sample: found where it is, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
from skimage import data

from intaglio import InputError, even_light, read_image, write_image


def lit(shape, amount):
    """Return light that falls off towards a corner."""
    y, x = np.mgrid[: shape[0], : shape[1]] / max(shape)
    return np.exp(-amount * (0.8 * x + 0.5 * y + 0.4 * x * x))


@pytest.mark.parametrize("name", ["brick", "grass", "gravel"])
def test_light_is_found_where_it_is_and_nowhere_else(name):
    texture = (getattr(data, name)()[:256, :256] / 255.0) ** 2.2 * 0.8
    assert (even_light(texture).light == 1).all()
    light = lit(texture.shape, 1.2)
    even = even_light(texture * light)
    assert "taken out" in even.note
    ratio = np.log(even.light / light)
    assert ratio.std() < 0.1
    np.testing.assert_allclose(even.image * even.light, texture * light, rtol=1e-6)
    # By radius, too: what is left varies little on that scale.
    rough = np.log(even_light(texture * light, 50).light / light)
    assert rough.std() < 0.15


def test_masked_pixels_neither_count_nor_change():
    rng = np.random.default_rng(1)
    texture = (0.3 + 0.1 * rng.random((120, 150, 3))) * lit((120, 150), 1.0)[..., None]
    mask = np.ones((120, 150), bool)
    mask[40:80, 30:90] = False
    spoiled = np.where(mask[..., None], texture, np.nan)
    even = even_light(spoiled, mask=mask)
    assert np.isnan(even.image[~mask]).all()
    np.testing.assert_allclose(np.log(even.light / lit((120, 150), 1.0)).std(), 0, atol=0.01)
    whole = even_light(np.round(texture * 255).astype(np.uint8), 30)
    assert whole.image.dtype == np.uint8


def test_small_black_and_bad_input():
    assert (even_light(np.zeros((50, 50))).light == 1).all()
    assert (even_light(np.linspace(0.1, 1, 100).reshape(10, 10)).light == 1).all()
    for bad, options, said in (
        (-np.ones((40, 40)), {}, "negative"),
        (np.full((40, 40), np.nan), {}, "finite"),
        (np.ones((40, 40)), {"radius": 0.5}, "radius"),
        (np.ones((40, 40)), {"radius": "all"}, "radius"),
        (np.ones((40, 40)), {"mask": np.zeros((40, 40), bool)}, "mask leaves"),
        (np.ones(4), {}, "must be"),
    ):
        with pytest.raises(InputError, match=said):
            even_light(bad, **options)


def test_the_command_evens_a_photograph(run, tmp_path):
    photograph = (data.grass()[:160, :160] / 255.0) ** 2.2 * lit((160, 160), 1.2)
    path = tmp_path / "lit.png"
    write_image(np.repeat(photograph[..., None], 3, axis=2).astype(np.float32), path)
    spread = {}
    for how in ("auto", "none", "40"):
        out = tmp_path / f"{how}.png"
        status, _, said = run("synthesize", path, "-o", out, "--size", "240x240", "--flatten", how, "--no-source")
        assert status == 0
        assert ("taken out" in said) == (how != "none")
        tone = np.log(np.maximum(read_image(out)[..., 0], 0.01))
        spread[how] = tone.reshape(6, 40, 6, 40).mean(axis=(1, 3)).std()
    assert spread["auto"] < 0.6 * spread["none"]
    assert spread["40"] < 0.6 * spread["none"]
    status, _, said = run("synthesize", path, "-o", tmp_path / "x.png", "--size", "64x64", "--flatten", "much")
    assert status != 0
    assert "neither a number" in said
    other = tmp_path / "other.png"
    write_image(np.zeros((160, 160), np.float32), other)
    status, _, said = run("synthesize", path, other, "-o", tmp_path / "f", "--size", "64x64", "--flatten", "20")
    assert status != 0
    assert "--flatten is for one image" in said
