"""The group `assess`: every system's results measured from files."""

from __future__ import annotations

import numpy as np
import pytest

import intaglio


def test_relief(cap, tmp_path, run):
    cap.write(tmp_path / "cap.ply")
    cap.part(np.linalg.norm(cap.vertices[:, :2] - (5e5, 4e6), axis=1) > 1.5).write(tmp_path / "holed.ply")
    words = ("--base", "sphere", "--window", "3", "--extent", "holes", "--refine", "1")
    assert run("complete", tmp_path / "holed.ply", "-o", tmp_path / "whole.ply", *words)[0] == 0
    status, said, errors = run("assess", "relief", tmp_path / "whole.ply", "--truth", tmp_path / "cap.ply")
    assert status == 0, errors
    whole = intaglio.read_surface(tmp_path / "whole.ply")
    for line in intaglio.assess_relief(whole, intaglio.read_surface(tmp_path / "cap.ply")).lines():
        assert line in said


def test_synthesis(tmp_path, run):
    sample = (np.random.default_rng(0).uniform(size=(40, 40, 3)) > 0.5).astype(np.float32)
    intaglio.write_image(sample, tmp_path / "sample.png")
    assert run("synthesize", tmp_path / "sample.png", "-o", tmp_path / "big.png", "--size", "60x50")[0] == 0
    status, said, errors = run("assess", "synthesis", tmp_path / "sample.png", tmp_path / "big.png")
    assert status == 0, errors
    assert "seam" in said
    intaglio.write_image(sample, tmp_path / "small.png")
    (tmp_path / "big.source.exr").rename(tmp_path / "small.source.exr")
    status, _, errors = run("assess", "synthesis", tmp_path / "sample.png", tmp_path / "small.png")
    assert status == 2
    assert "40 x 40" in errors
    assert "60 x 50" in errors


def test_restoration(tmp_path, run):
    rng = np.random.default_rng(1)
    truth = rng.uniform(0.2, 0.8, (48, 48, 3)).astype(np.float32)
    hole = np.zeros((48, 48), np.float32)
    hole[20:28, 18:30] = 1
    for name, image in (("truth", truth), ("hole", hole), ("damaged", truth * (1 - hole[:, :, None]))):
        intaglio.write_image(image, tmp_path / f"{name}.png")
    arguments = [tmp_path / "damaged.png", tmp_path / "hole.png"]
    assert run("restore", *arguments, "-o", tmp_path / "restored.png")[0] == 0
    status, said, errors = run(
        "assess", "restoration", tmp_path / "restored.png", tmp_path / "hole.png", "--truth", tmp_path / "truth.png"
    )
    assert status == 0, errors
    assert "PSNR" in said


def test_geometry(tmp_path, run):
    x, y = np.meshgrid(np.arange(30.0), np.arange(30.0))
    texture = intaglio.geometry_from_height(np.sin(x / 2) * np.cos(y / 2))
    intaglio.write_points(texture.points, tmp_path / "swatch.ply")
    intaglio.write_points(texture.points, tmp_path / "made.ply")
    status, said, errors = run("assess", "geometry", tmp_path / "made.ply", tmp_path / "swatch.ply")
    assert status == 0, errors
    assert "nearest" in said


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("relief", "nothing.ply"), "nothing.ply"),
        (("synthesis", "a.png", "b.png"), "a.png"),
        (("texture", "a.glb", "cameras.json"), "a.glb"),
        (("geometry", "a.ply", "b.ply"), "a.ply"),
    ],
)
def test_missing_files_are_named(tmp_path, run, words, message):
    status, said, errors = run("assess", *words, cwd=tmp_path)
    assert status == 2
    assert message in errors
    assert said == ""
