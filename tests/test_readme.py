"""The examples of the README run as they stand, on small files of the names that they use."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import trimesh
from shapes import grid
from stacks import lambertian, scattered, write_capture
from test_photographs import seen_by

from intaglio import PointSet, Surface, write_image, write_surface
from intaglio.scenes.photographs import camera_towards
from intaglio.scenes.swatches import weave

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text("utf-8")


def blocks(language):
    """The code blocks of one language after the heading "Use it"."""
    return re.findall(rf"^```{language}\n(.*?)^```", README.split("## Use it")[1], re.MULTILINE | re.DOTALL)


def bumpy(surface, amount):
    """A surface with bumps along its normals and some colour."""
    heights = amount * np.prod(np.sin(4.0 * surface.vertices / np.ptp(surface.vertices, axis=0).max() * np.pi + 1), axis=1)
    color = np.repeat(0.4 + 0.4 * heights[:, None] / np.abs(heights).max(), 3, axis=1)
    return Surface(vertices=surface.vertices + heights[:, None] * surface.normal, faces=surface.faces, color=color)


def tube():
    """Three quarters of a bumpy tube."""
    turn, along = np.meshgrid(np.linspace(0, 1.5 * np.pi, 36), np.linspace(0, 3, 24))
    radius = 1 + 0.04 * np.sin(6 * turn) * np.sin(6 * along)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), along], axis=-1).reshape(-1, 3)
    number = np.arange(points.shape[0]).reshape(turn.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    faces = np.concatenate([np.stack([a, b, d], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    return Surface(vertices=points, faces=faces, color=np.clip(radius.reshape(-1, 1) - 0.5, 0, 1) * np.ones(3))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with every file that the examples read."""
    monkeypatch.chdir(tmp_path)
    egg = trimesh.creation.icosphere(subdivisions=3)
    statue = bumpy(Surface(vertices=egg.vertices * (1.0, 0.6, 1.3), faces=egg.faces), 0.03)
    statue.part(np.linalg.norm(statue.vertices - (1, 0, 0), axis=1) > 0.3).write("statue.ply")
    ball = bumpy(Surface(vertices=21 * egg.vertices, faces=egg.faces), 0.3)
    ball.part(ball.vertices[:, 2] > -10).write("golfball.ply")
    bumpy(Surface(vertices=egg.vertices, faces=egg.faces), 0.03).write("sherd.ply")
    Path("lines.obj").write_text("v 1 0 -0.4\nv 1.02 0 0\nv 1 0 0.4\nl 1 2 3\n")
    tube().write("bark.ply")
    tube().write("vase.obj")
    wall = bumpy(grid(24, 24), 0.02)
    wall.part(np.linalg.norm(wall.vertices[:, :2] - 0.5, axis=1) > 0.15).write("wall.ply")

    write_capture(Path(), lambertian(scattered(12), 20, 24), ".png")
    row, column = np.mgrid[:28, :28]
    rng = np.random.default_rng(1)
    sample = np.clip(0.4 + 0.2 * np.sin(row / 3) * np.sin(column / 3) + 0.05 * rng.normal(size=(28, 28)), 0, 1)
    write_image(np.repeat(sample[:, :, None], 3, axis=2).astype(np.float32), "sample.png")
    write_image(np.repeat(sample[:, :, None], 3, axis=2).astype(np.float32), "photograph.png")
    write_image((np.abs(row - column) < 3).astype(np.float32), "scratches.png")

    square = grid(12, 12)
    write_surface(square, "mesh.ply")
    views = []
    for number, toward in enumerate(((0, 0, 1.0), (0.3, 0, 1), (-0.2, 0.3, 1))):
        camera = camera_towards(np.array([0.5, 0.5, 0]), np.array(toward), np.array([0, 1.0, 0]), 4.0, focal=200, size=(64, 64))
        write_image(seen_by(square, camera).image, f"view{number}.png")
        view = {"image": f"view{number}.png", "K": camera.K.tolist(), "R": camera.R.tolist(), "t": camera.t.tolist()}
        views.append({**view, "width": 64, "height": 64})
    Path("cameras.json").write_text(json.dumps(views))

    points, normals, _ = weave(7, 0.18)
    PointSet(points, normals).write("weave.ply")
    return tmp_path


@pytest.mark.usefixtures("quick_pictures")
def test_commands_run(folder, run):
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    assert len(lines) > 10
    for line in lines:
        words = shlex.split(line)
        assert words[0] == "intaglio"
        status, _, errors = run(*words[1:])
        assert status == 0, f"{line}\n{errors}"
        for option in ("-o", "--report", "--mesh", "--maps"):
            if option in words:
                assert (folder / words[words.index(option) + 1]).exists(), line


@pytest.mark.usefixtures("folder")
@pytest.mark.filterwarnings("ignore::intaglio.IntaglioWarning")
def test_python_examples_run(capsys):
    examples = blocks("python")
    assert len(examples) == 4
    names: dict[str, object] = {}
    for example in examples:
        exec(compile(example, "README.md", "exec"), names)
    assert "mean surface integral" in capsys.readouterr().out
    for name in ("golfball-whole.ply", "textured.glb", "larger.glb"):
        assert Path(name).exists()


def test_links_lead_somewhere():
    for link in re.findall(r"\]\(([^)#]+)", README):
        assert link.startswith("https://") or (ROOT / link).exists(), link
