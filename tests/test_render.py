"""Rendering: variant guard, views, simulated scans, comparison."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
import trimesh

import intaglio
from intaglio.render import Light, Viewpoint, compare, frame, range_scan, variant, view
from intaglio.render.variants import llvm_version, usable_llvm


def sphere(subdivisions=4, radius=1.0):
    ball = trimesh.creation.icosphere(subdivisions, radius)
    return np.asarray(ball.vertices), np.asarray(ball.faces)


def test_a_variant_is_chosen_and_says_why():
    chosen = variant()
    assert chosen.name in ("cuda_ad_rgb", "llvm_ad_rgb", "scalar_rgb")
    assert chosen.reason
    assert chosen.vectorized == (chosen.name != "scalar_rgb")


def test_unusable_llvm_libraries_are_not_handed_on(monkeypatch, tmp_path):
    fake = tmp_path / "libLLVM-14.so"
    fake.write_bytes(b"not a library")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(fake))
    usable_llvm.cache_clear()
    path, why = usable_llvm()
    usable_llvm.cache_clear()
    assert path is None
    assert "not an LLVM 17" in why
    assert llvm_version(str(fake)) is None


def test_the_scalar_variant_renders_in_a_process_of_its_own(tmp_path):
    code = (
        "import numpy as np\nfrom intaglio.render import Viewpoint, range_scan, view, variant\n"
        "v = np.array([[-1.,-1,0],[1,-1,0],[0,1,0]])\nf = np.array([[0,1,2]])\nc = Viewpoint((0.,0,5),(0.,0,0))\n"
        "assert variant().name == 'scalar_rgb'\n"
        "assert view(v, f, camera=c, size=(16, 16), samples=2).shape == (16, 16, 3)\n"
        "d = range_scan(v, f, camera=c, size=(9, 9)).depth\nassert abs(d[4, 4] - 5) < 1e-5, d\n"
    )
    script = tmp_path / "render.py"
    script.write_text(code)
    env = {**os.environ, "INTAGLIO_VARIANT": "scalar_rgb"}
    done = subprocess.run([sys.executable, str(script)], env=env, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_an_impossible_variant_is_refused(monkeypatch):
    monkeypatch.setenv("INTAGLIO_VARIANT", "cuda_mono_polarized")
    variant.cache_clear()
    with pytest.raises(ValueError, match="INTAGLIO_VARIANT"):
        variant()
    variant.cache_clear()


def test_a_matte_plane_facing_the_light_has_the_lambertian_radiance():
    v = np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]])
    f = np.array([[0, 1, 2], [0, 2, 3]])
    camera = Viewpoint((0, 0, 10), (0, 0, 0), fov=20)
    for slant in (0.0, 60.0):
        image = view(v, f, camera=camera, light=Light(slant=slant, strength=2.0, fill=0.0), albedo=(0.5, 0.4, 0.3), size=(16, 16))
        expected = 2.0 / np.pi * np.cos(np.radians(slant)) * np.array([0.5, 0.4, 0.3])
        np.testing.assert_allclose(image[4:12, 4:12].mean(axis=(0, 1)), expected, rtol=1e-3)


def test_orientation_of_picture_light_and_colours():
    """A picture without symmetry: red at the upper left, light from the upper left leaves the lower right dark."""
    v, f = sphere()
    colors = np.where((v[:, :1] < 0) & (v[:, 1:2] > 0), (1.0, 0, 0), (0.2, 0.2, 0.2))
    image = view(v, f, camera=frame(v, (0, 0, 1)), colors=colors, size=(64, 64), light=Light(slant=0))
    assert image[20, 20, 0] > 3 * image[20, 20, 1]
    for y, x in ((20, 44), (44, 20), (44, 44)):
        assert image[y, x, 0] == pytest.approx(image[y, x, 1], rel=1e-3)
    lit = view(v, f, camera=frame(v, (0, 0, 1)), size=(64, 64), light=Light(tilt=135, slant=60, fill=0))
    assert lit[20, 20].mean() > 10 * lit[44, 44].mean()


def test_the_headlight_leaves_nothing_in_shadow():
    """A screen before a wall: seen from the eye, the wall is lit up to the screen's edge."""
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    v = np.concatenate([9 * square, square + (1.5, 0, 4)])
    f = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    camera = Viewpoint((0, 0, 10), (0, 0, 0), fov=50)
    image = view(v, f, camera=camera, light=Light(strength=0.0, fill=np.pi), albedo=(0.5, 0.5, 0.5), size=(64, 64))
    assert image.min() > 0.2
    np.testing.assert_allclose(image[32, 30:34].mean(), 0.5, rtol=0.02)


def test_survey_coordinates_render_like_those_at_the_origin():
    v, f = sphere()
    shift = np.array([5e5, 4e6, 120.0])
    near = view(v, f, camera=frame(v, (1, 0.2, 0.3)), size=(48, 48))
    far = view(v + shift, f, camera=frame(v + shift, (1, 0.2, 0.3)), size=(48, 48))
    np.testing.assert_allclose(near, far, atol=2e-3)


def test_a_scan_of_a_sphere_lies_on_the_sphere():
    v, f = sphere(6, 10.0)
    camera = Viewpoint((0, 0, 100), (0, 0, 0), fov=14)
    seen = range_scan(v, f, camera=camera, size=(61, 61), steepest=70)
    radius = np.linalg.norm(seen.points, axis=2)
    assert seen.depth[30, 30] == pytest.approx(90, abs=2e-3)
    # The mesh's facets lie up to 1.5e-3 below the sphere.
    assert np.nanmax(np.abs(radius - 10)) < 3e-3
    assert np.isnan(seen.depth[0, 0])
    assert seen.points[12, 30, 1] > 0 > seen.points[48, 30, 1]
    incidence = np.degrees(np.arccos(np.nanmin(seen.points[..., 2] / radius)))
    assert incidence < 71


def test_scan_noise_runs_along_the_ray_and_follows_the_seed():
    v, f = sphere(5, 10.0)
    camera = Viewpoint((0, 0, 100), (0, 0, 0), fov=14)
    clean = range_scan(v, f, camera=camera, size=(61, 61))
    a, b, c = (range_scan(v, f, camera=camera, size=(61, 61), noise=0.05, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(a.depth, b.depth)
    assert np.nanmax(np.abs(a.depth - c.depth)) > 0
    noise = (a.depth - clean.depth)[np.isfinite(clean.depth)]
    assert noise.std() == pytest.approx(0.05, rel=0.05)
    assert np.array_equal(np.isnan(a.depth), np.isnan(clean.depth))


def test_a_step_in_depth_is_not_bridged():
    low, high = trimesh.creation.box((4, 4, 1)), trimesh.creation.box((1.5, 1.5, 3))
    mesh = trimesh.util.concatenate([low, high])
    seen = range_scan(mesh.vertices, mesh.faces, camera=Viewpoint((0, 0, 30), (0, 0, 0), fov=8), size=(50, 50))
    scan = intaglio.surface_from_range_image(seen.points, view=seen.view)
    assert np.ptp(scan.vertices[scan.faces][:, :, 2], axis=1).max() < 0.1


def test_comparison_of_equal_and_different_images():
    rng = np.random.default_rng(0)
    image = rng.uniform(size=(40, 50, 3)).astype(np.float32)
    same = compare(image, image)
    assert (same.rmse, same.psnr, same.ssim, same.flip) == (0, float("inf"), pytest.approx(1), pytest.approx(0, abs=1e-6))
    gray = np.full((40, 50), 0.25, np.float32)
    off = compare(gray + 0.1, gray)
    assert off.rmse == pytest.approx(0.1, rel=1e-5)
    worse = compare(gray + 0.3, gray)
    assert worse.flip > off.flip > 0
    assert worse.psnr < off.psnr
    assert off.difference.shape == (40, 50, 3)


def test_images_that_cannot_be_compared():
    with pytest.raises(ValueError, match="shape"):
        compare(np.zeros((20, 20, 3)), np.zeros((20, 21, 3)))
    with pytest.raises(ValueError, match="finite"):
        compare(np.full((20, 20), np.nan), np.zeros((20, 20)))
    with pytest.raises(ValueError, match="11"):
        compare(np.zeros((5, 5)), np.zeros((5, 5)))
