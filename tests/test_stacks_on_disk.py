"""Stacks larger than memory: the same textures, and the memory that is promised."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from stacks import HELD_OUT, noisy, scattered, write_capture

from intaglio import (
    read_stack,
    represent,
)
from intaglio.files.exr import write_exr
from intaglio.photometric.relightable import KINDS


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
    stack = noisy(scattered(20), channels=3, height=31, width=29)
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
        # Principal images of a stack on disk come from subspace iteration, and "rbf" chooses its smoothing by a sample.
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
    # Robust fits take by far the longest, in proportion to the number of lights.
    (folder / "few.lp").write_text("\n".join(rows[:8]))
    return folder


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
    stack = read_stack(large_capture / ("few.lp" if options.get("robust") else "c.lp"), memory=0, mask=mask if masked else None)
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
