"""The commands represent, relight, assess and info on stacks, as a user types them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image
from stacks import dome, noisy, scattered, write_capture

from intaglio import light_direction, read_image, read_relightable, read_stack, represent


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    return write_capture(tmp_path_factory.mktemp("capture"), noisy(scattered(20), channels=3))


def test_from_capture_to_lit_picture(run, capture, tmp_path):
    status, said, _ = run("represent", capture, "-o", tmp_path / "t.exr", "--kind", "ptm", "--maps", tmp_path / "maps")
    assert status == 0
    assert "ptm, 6 maps of 10 x 9 pixels, colour, from 20 images" in said
    texture = read_relightable(tmp_path / "t.exr")
    np.testing.assert_array_equal(texture.maps, represent(read_stack(capture), "ptm").maps)
    assert {p.name for p in (tmp_path / "maps").iterdir()} == {"normal.png", "albedo.png", "height.png", "maps.exr"}
    status, said, _ = run("relight", tmp_path / "t.exr", "-o", tmp_path / "lit.exr", "--tilt", 60, "--slant", 30)
    assert status == 0
    assert "10 x 9 pixels" in said
    np.testing.assert_array_equal(read_image(tmp_path / "lit.exr"), texture.relight(light_direction(60, 30)))
    # The other formats, and a light as a vector.
    for name in ("t.ptm", "t.glb", "info.json"):
        assert run("represent", capture, "-o", tmp_path / name, "--kind", "gradient", "--robust")[0] == 0
        assert (tmp_path / name).exists()
    assert json.loads((tmp_path / "info.json").read_text())["type"] == "rbf"
    assert run("relight", tmp_path / "t.ptm", "-o", tmp_path / "p.png", "--light", "1,0,1", "--bits", "16")[0] == 0


def test_relight_on_a_mesh(run, capture, tmp_path):
    run("represent", capture, "-o", tmp_path / "t.exr", "--kind", "rbf")
    (tmp_path / "square.obj").write_text(
        "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    )
    words = ("relight", tmp_path / "t.exr", "-o", tmp_path / "m.png", "--mesh", tmp_path / "square.obj")
    status, said, errors = run(*words, "--direction", "0,0,1", "--size", "64x48", "--samples", 4, "--repeat", 2)
    assert (status, errors) == (0, ""), errors
    assert "64 x 48 pixels" in said
    image = read_image(tmp_path / "m.png")
    assert image[24, 32].max() < 0.95
    assert image[0, 0].min() > 0.99
    (tmp_path / "bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    status, _, errors = run(*words[:-1], tmp_path / "bare.obj")
    assert status == 2
    assert "no faces with texture coordinates" in errors


def test_assess(run, capture, tmp_path):
    status, said, _ = run("assess", "capture", capture, "--kinds", "gradient,ptm,rbf", "-o", tmp_path / "r.html")
    assert status == 0
    assert [line.split()[0] for line in said.splitlines()[:4]] == ["kind", "gradient", "ptm", "rbf"]
    page = (tmp_path / "r.html").read_text()
    assert page.count("<svg") == 3
    assert "http" not in page.replace("http-equiv", "")
    status, said, _ = run("assess", "capture", capture, "--kinds", "eigen3", "--no-leave-one-out", "--gray")
    assert status == 0
    assert said.splitlines()[1].split()[2] == "-"


def test_a_kind_that_can_not_be_had_is_left_out(run, tmp_path):
    path = write_capture(tmp_path, noisy(dome(5, (45,))))
    status, said, _ = run("assess", "capture", path, "--kinds", "gradient,ptm")
    assert status == 0
    assert said.splitlines()[2].split() == ["ptm", "-", "-", "-", "-"]
    status, _, errors = run("assess", "capture", path, "--kinds", "ptm")
    assert status == 2
    assert "only 5 images" in errors


def test_info_shows_the_stack(run, capture, tmp_path):
    status, said, _ = run("info", capture)
    assert status == 0
    assert "stack of 20 images, 10 x 9 pixels, 3 channels" in said
    assert "overexposed" in said
    assert sum(line.count("o") for line in said.splitlines() if set(line) <= set(" .o+")) >= 18
    (tmp_path / "bare.lp").write_text("0 0 1\n1 0 1\n")
    status, said, _ = run("info", tmp_path / "bare.lp")
    assert status == 0
    assert "2 lights" in said
    assert run("info", capture.parent)[0] == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("represent", "{capture}", "-o", "t.tiff"), "known: .exr, .ptm, .json, .glb"),
        (("represent", "{capture}", "-o", "t.exr", "--kind", "hdr"), "known: 3i, gradient, ptm"),
        (("represent", "{capture}", "-o", "t.exr", "--response", "log"), "give linear, srgb or a gamma"),
        (("represent", "{capture}", "-o", "t.exr", "--mask", "none.png"), "none.png: no such file"),
        (("represent", "{capture}", "-o", "t.exr", "--kind", "ptm", "--robust"), "robust fitting is there for"),
        (("relight", "t.exr", "-o", "p.jpg", "--bits", "16"), "has no 16 bits"),
        (("represent", "{capture}", "-o", "t.exr", "--tiles"), "--tiles is for web planes"),
        (("represent", "{capture}", "-o", "no/where/t.exr"), "does not exist"),
        (("represent", "nowhere.lp", "-o", "t.exr"), "nowhere.lp: no such file"),
        (("represent", "{capture}", "-o", "{capture}"), "unknown texture type"),
        (("relight", "{capture}", "-o", "p.png"), "unknown type of texture '.lp'"),
        (("relight", "t.exr", "-o", "p.gif"), "unknown image type"),
        (("relight", "t.exr", "-o", "p.png", "--slant", "nan"), "finite"),
        (("relight", "t.exr", "-o", "p.png", "--exposure", "0"), "--exposure"),
        (("assess", "capture", "{capture}", "--kinds", "hdr"), "'hdr' is not known"),
        (("assess", "capture", "{capture}", "--kinds", ","), "--kinds is empty"),
        (("assess", "capture", "{capture}", "-o", "r.pdf"), "unknown report type"),
        (("info", "README"), "no such file"),
    ],
)
def test_errors_are_one_line(run, capture, tmp_path, words, message):
    status, _, errors = run(*(w.format(capture=capture) for w in words), cwd=tmp_path)
    assert status == 2
    assert message in errors
    assert errors.count("\n") == 1
    assert "Traceback" not in errors
    assert not list(tmp_path.iterdir())


def test_a_light_from_below_is_refused(run, capture, tmp_path):
    run("represent", capture, "-o", tmp_path / "t.exr", "--kind", "gradient")
    status, _, errors = run("relight", tmp_path / "t.exr", "-o", tmp_path / "p.png", "--slant", 95)
    assert status == 2
    assert "below the surface" in errors
    assert not (tmp_path / "p.png").exists()


def test_a_sphere_gives_the_lights(run, tmp_path):
    from test_stack import mirror

    lights = dome(5, (20, 45))
    stack = noisy(lights)
    write_capture(tmp_path / "object", stack).unlink()
    (tmp_path / "sphere").mkdir()
    for k, picture in enumerate(mirror(lights)):
        Image.fromarray(np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)).save(tmp_path / "sphere" / f"{k}.png")
    words = (
        "represent",
        tmp_path / "object",
        "--sphere",
        tmp_path / "sphere",
        "--circle",
        "103,97,80",
        "-o",
        tmp_path / "t.exr",
        "--kind",
        "gradient",
    )
    status, _, errors = run(*words)
    assert status == 0, errors
    truth = represent(stack, "gradient")
    light = light_direction(70, 30)
    np.testing.assert_allclose(read_relightable(tmp_path / "t.exr").relight(light), truth.relight(light), atol=0.03)


@pytest.mark.parametrize(
    ("names", "output", "more"),
    [
        (("normal.png", "b.png", "c.png"), "t.exr", ("--maps", ".")),
        (("plane_0.png", "b.png", "c.png"), "info.json", ()),
        (("a.exr", "b.exr", "c.exr"), "a.exr", ()),
    ],
)
def test_inputs_are_never_overwritten(run, names, output, more, tmp_path):
    from intaglio import write_image

    stack = noisy(dome(3, (40,)))
    rows = []
    for k, name in enumerate(names):
        write_image(stack.image(k)[:, :, 0], tmp_path / name)
        rows.append(f"{name} " + " ".join(map(str, stack.lights[k])))
    (tmp_path / "c.lp").write_text("\n".join(rows))
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    status, _, errors = run("represent", "c.lp", "-o", output, "--kind", "gradient", *more, cwd=tmp_path)
    assert status == 2
    assert "is an input" in errors or "is one of the inputs" in errors
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_meshes_that_can_not_be_rendered(run, capture, tmp_path):
    run("represent", capture, "-o", tmp_path / "t.exr", "--kind", "gradient")
    square = "v -1 -1 0\nv 1 -1 0\nv {} 1 0\nvt 0 0\nvt {} 0\nvt 1 1\nf 1/1 2/2 3/3\n"
    for text, message in (
        (square.format("nan", 1), "not finite"),
        (square.format("1e300", 1), "not finite, or larger"),
        (square.format("1", "1e30"), "texture coordinates"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nvt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n", "no area"),
    ):
        (tmp_path / "m.obj").write_text(text)
        status, _, errors = run("relight", tmp_path / "t.exr", "-o", tmp_path / "r.png", "--mesh", tmp_path / "m.obj")
        assert (status, message in errors) == (2, True), errors
    assert not (tmp_path / "r.png").exists()


def test_info_of_a_texture(run, capture, tmp_path):
    run("represent", capture, "-o", tmp_path / "t.exr", "--kind", "rbf", "--color", "luminance")
    status, said, _ = run("info", tmp_path / "t.exr")
    assert status == 0
    assert "relightable texture, kind rbf" in said
    assert "luminance and chromaticity" in said
    (tmp_path / "below.lp").write_text("a.png 0 0 -1\n")
    status, _, errors = run("info", tmp_path / "below.lp")
    assert status == 2
    assert "below the surface" in errors


def test_warnings_are_one_line(run, tmp_path):
    stack = noisy(dome(6, (20, 50)))
    from intaglio import PhotometricStack

    bright = PhotometricStack(np.clip(stack.images * 2.5, 0, 1), stack.lights)
    path = write_capture(tmp_path, bright, ".png")
    status, _, errors = run("represent", path, "-o", tmp_path / "t.exr", "--kind", "gradient")
    assert status == 0
    assert errors.startswith("warning: ")
    assert "overexposed" in errors
    assert errors.count("\n") == 1
