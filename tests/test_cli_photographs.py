"""The commands texture and restore."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from shapes import grid
from test_photographs import seen_by

from intaglio import Camera, read_image, write_image, write_surface
from intaglio.files.images import read_samples, write_samples
from intaglio.scenes.photographs import camera_towards


@pytest.fixture
def scene(tmp_path):
    """A flat square, three photographs of it, and their cameras, in a folder."""
    surface = grid(12, 12)
    write_surface(surface, tmp_path / "mesh.ply")
    views = []
    for number, direction in enumerate(((0, 0, 1.0), (0.3, 0, 1), (-0.2, 0.3, 1))):
        camera = camera_towards(
            np.array([0.5, 0.5, 0]), np.array(direction), np.array([0, 1.0, 0]), 4.0, focal=200, size=(64, 64)
        )
        write_image(seen_by(surface, camera).image, tmp_path / f"view{number}.png")
        view = {"image": f"view{number}.png", "K": camera.K.tolist(), "R": camera.R.tolist(), "t": camera.t.tolist()}
        views.append({**view, "width": 64, "height": 64})
    (tmp_path / "cameras.json").write_text(json.dumps(views))
    return tmp_path


@pytest.mark.usefixtures("quick_pictures")
def test_texture_writes_a_textured_mesh_and_a_report(scene, run):
    out = scene / "textured.glb"
    arguments = ["--size", "64", "--report", str(scene / "report.html"), "--leave-out", "view2.png"]
    code, text, _ = run("texture", str(scene / "mesh.ply"), str(scene / "cameras.json"), "-o", str(out), *arguments)
    assert code == 0
    assert "0 flips" in text
    assert "left out view2.png: PSNR" in text
    loaded = next(iter(trimesh.load(out).geometry.values()))
    assert len(loaded.faces) == 242
    assert loaded.visual.material.baseColorTexture.size == (64, 64)
    assert (scene / "textured.coverage.png").exists()
    page = (scene / "report.html").read_text("utf-8")
    assert page.count("<img") == 15
    assert "view1.png" in page


@pytest.fixture
def project(tmp_path):
    """A flat square and COLMAP's project of three photographs of it through a lens, of half the calibrated size."""
    surface = grid(12, 12)
    write_surface(surface, tmp_path / "mesh.ply")
    (tmp_path / "sparse" / "0").mkdir(parents=True)
    (tmp_path / "images").mkdir()
    lens = [-0.8, 2.0, 0.01, -0.02]
    (tmp_path / "sparse" / "0" / "cameras.txt").write_text(f"1 OPENCV 160 160 600 600 80 80 {' '.join(map(str, lens))}\n")
    lines = []
    for number, direction in enumerate(((0, 0, 1.0), (0.3, 0, 1), (-0.2, 0.3, 1), (0.2, -0.3, 1))):
        plain = camera_towards(np.array([0.5, 0.5, 0]), np.array(direction), np.array([0, 1.0, 0]), 4.0, focal=300, size=(80, 80))
        camera = Camera(K=[[300, 0, 39.5], [0, 300, 39.5], [0, 0, 1]], R=plain.R, t=plain.t, size=(80, 80), distortion=lens)
        if number < 3:
            write_image(seen_by(surface, camera, alpha=False).image, tmp_path / "images" / f"view{number}.png")
        x, y, z, w = Rotation.from_matrix(camera.R).as_quat()
        lines.append(f"{number} {w} {x} {y} {z} {' '.join(map(str, camera.t))} 1 view{number}.JPG\n\n")
    (tmp_path / "sparse" / "0" / "images.txt").write_text("".join(lines))
    return tmp_path


def test_a_project_is_textured_as_it_lies_on_disk(project, run):
    command = ["texture", str(project / "mesh.ply"), str(project), "--size", "64", "--background", "none"]
    code, text, errors = run(*command, "-o", str(project / "textured.glb"), "--leave-out", "view2.JPG")
    assert code == 0, errors
    assert "'view3.JPG' is missing and left out" in errors
    assert "calibrations are scaled" in errors
    found = float(text.split("left out view2.JPG: PSNR ")[1].split()[0])
    assert found > 30
    code, _, errors = run(*command, "-o", str(project / "strict.glb"), "--strict")
    assert code == 2
    assert "'view3.JPG' is in none of" in errors
    assert not (project / "strict.glb").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "mesh.ply"], "is one of the inputs"),
        (["-o", "out.stl"], "unknown textured mesh type"),
        (["-o", "view0.coverage.glb", "--leave-out", "nobody"], "no such view"),
        (["-o", "out.glb", "--importance", "1.2"], "--view"),
        (["-o", "out.glb", "--background-threshold", "nan"], "background-threshold"),
        (["-o", "view0.obj"], "is one of the inputs"),
        (["-o", "none/out.glb"], "does not exist"),
        (["-o", "out.glb", "--leave-out", "view0.png", "--leave-out", "view1.png", "--leave-out", "view2.png"], "no photograph"),
    ],
)
def test_texture_names_what_is_wrong(scene, run, monkeypatch, arguments, message):
    monkeypatch.chdir(scene)
    before = {p: p.read_bytes() for p in scene.iterdir()}
    code, _, errors = run("texture", "mesh.ply", "cameras.json", "--size", "32", *arguments)
    assert code == 2
    assert message in errors
    assert {p: p.read_bytes() for p in scene.iterdir()} == before


@pytest.fixture
def picture(tmp_path):
    rng = np.random.default_rng(1)
    levels = (128 + 40 * np.sin(np.arange(48) / 2)[None, :, None] + rng.integers(-9, 9, (40, 48, 3))).astype(np.uint8)
    mask = np.zeros((40, 48), np.uint8)
    mask[12:24, 15:30] = 255
    write_samples(levels, tmp_path / "image.png")
    write_samples(mask, tmp_path / "mask.png")
    return tmp_path, levels, mask > 0


@pytest.mark.parametrize("method", ["split", "inpaint", "synthesize"])
def test_restore_keeps_known_pixels(picture, run, method):
    folder, levels, missing = picture
    out, page = folder / "out.png", folder / "out.html"
    arguments = ["-o", str(out), "--method", method, "--report", str(page)]
    code, text, _ = run("restore", str(folder / "image.png"), str(folder / "mask.png"), *arguments)
    assert code == 0
    assert "180 pixels" in text
    assert "detail energy" in text
    found = read_samples(out)
    np.testing.assert_array_equal(found[~missing], levels[~missing])
    assert (found[missing] != levels[missing]).any()
    assert "<img" in page.read_text("utf-8")


def test_restore_of_deep_and_float_images(picture, run):
    folder, levels, missing = picture
    deep = levels.astype(np.uint16) * 257 // 3
    write_samples(deep, folder / "deep.png")
    write_image(levels.astype(np.float32) / 100, folder / "bright.exr")
    for name in ("deep.png", "bright.exr"):
        code, _, _ = run("restore", str(folder / name), str(folder / "mask.png"), "-o", str(folder / f"out-{name}"))
        assert code == 0
        given, found = read_samples(folder / name), read_samples(folder / f"out-{name}")
        np.testing.assert_array_equal(found[~missing], given[~missing])
        assert 0.8 < found[missing].mean() / given[~missing].mean() < 1.25


def test_restore_into_exr_keeps_colours(picture, run):
    folder, _, missing = picture
    assert run("restore", str(folder / "image.png"), str(folder / "mask.png"), "-o", str(folder / "out.exr"))[0] == 0
    given, found = read_image(folder / "image.png"), read_image(folder / "out.exr")
    np.testing.assert_allclose(found[~missing], given[~missing], atol=1e-6)


def test_restore_of_images_with_alpha(picture, run):
    folder, levels, missing = picture
    alpha = np.full((40, 48), 255, np.uint8)
    alpha[:, :6] = 0
    alpha[missing] = 0
    write_samples(np.dstack([levels, alpha]), folder / "alpha.png")
    assert run("restore", str(folder / "alpha.png"), str(folder / "mask.png"), "-o", str(folder / "out.png"))[0] == 0
    found = read_samples(folder / "out.png")
    np.testing.assert_array_equal(found[~missing], np.dstack([levels, alpha])[~missing])
    assert (found[missing][:, 3] == 255).all()


def test_masks_of_all_kinds(picture, run):
    folder, _, missing = picture
    level = missing.astype(np.uint8)
    kinds = {
        "colour": np.dstack([level * 255] * 3),
        "ones": level,
        "alpha": np.dstack([np.zeros((40, 48, 3), np.uint8), level * 255]),
        "opaque": np.dstack([np.repeat(level[:, :, None] * 255, 3, axis=2), np.full((40, 48), 255, np.uint8)]),
    }
    for name, mask in kinds.items():
        write_samples(mask, folder / f"{name}.png")
        _, text, _ = run("restore", str(folder / "image.png"), str(folder / f"{name}.png"), "-o", str(folder / "out.png"))
        assert "180 pixels" in text
    write_samples(255 * (1 - level), folder / "dark.png")
    assert (
        "180 pixels"
        in run("restore", str(folder / "image.png"), str(folder / "dark.png"), "--invert", "-o", str(folder / "o.png"))[1]
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["image.png", "small.png", "-o", "out.png"], "the mask has 5 x 5"),
        (["image.png", "mask.png", "-o", "image.png"], "is one of the inputs"),
        (["image.png", "mask.png", "-o", "out.gif"], "unknown image type"),
        (["image.png", "full.png", "-o", "out.png"], "covers everything"),
        (["image.png", "mask.png", "-o", "out.png", "--method", "inpaint", "--kappa", "3"], "--kappa"),
        (["image.png", "mask.png", "-o", "out.png", "--method", "synthesize", "--kappa", "3"], "--kappa"),
        (["image.png", "mask.png", "-o", "out.png", "--orientations", "4"], "orientations must be 1"),
        (["image.png", "mask.png", "-o", "out.png", "--method", "inpaint", "--orientations", "8"], "--orientations is for"),
        (["image.png", "nothing.png", "-o", "out.png"], "no such file"),
    ],
)
def test_restore_names_what_is_wrong(picture, run, monkeypatch, arguments, message):
    folder = picture[0]
    write_samples(np.zeros((5, 5), np.uint8), folder / "small.png")
    write_samples(np.full((40, 48), 255, np.uint8), folder / "full.png")
    monkeypatch.chdir(folder)
    before = {p: p.read_bytes() for p in folder.iterdir()}
    code, _, errors = run("restore", *arguments)
    assert code == 2
    assert message in errors
    assert {p: p.read_bytes() for p in folder.iterdir()} == before
