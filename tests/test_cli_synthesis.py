"""The commands synthesize and rank, as a user types them."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from PIL import Image
from skimage import data
from stacks import noisy, scattered, write_capture

from intaglio import read_exr, read_image, read_relightable, read_stack, represent, write_exr, write_image, write_relightable


@pytest.fixture
def sample(tmp_path):
    colours = np.stack([np.roll(data.gravel()[:60, :70], 3 * i, 1) for i in range(3)], axis=2)
    Image.fromarray(colours).save(tmp_path / "sample.png")
    return tmp_path / "sample.png"


def stored(path):
    return np.asarray(Image.open(path))


@pytest.mark.parametrize("method", ["quilt", "grow"])
def test_a_photograph(run, sample, tmp_path, method):
    before = sample.read_bytes()
    status, said, _ = run("synthesize", sample, "-o", tmp_path / "big.png", "--size", "90x80", "--method", method, "--seed", 3)
    assert status == 0
    assert "90 x 80 pixels" in said
    channels, _ = read_exr(tmp_path / "big.source.exr")
    row, column = (channels[f"source.{n}"].astype(int) for n in ("row", "column"))
    # Stored values, copied to the bit.
    np.testing.assert_array_equal(stored(tmp_path / "big.png"), stored(sample)[row, column])
    assert sample.read_bytes() == before


def test_maps_of_a_material_stay_together(run, sample, tmp_path):
    height = (data.gravel()[:60, :70].astype(np.uint16) << 8) + 7
    Image.fromarray(height).save(tmp_path / "height.png")
    Image.fromarray(data.gravel()[:60, :70]).save(tmp_path / "rough.jpg", quality=90)
    out = tmp_path / "material"
    words = [
        sample,
        tmp_path / "height.png",
        tmp_path / "rough.jpg",
        "-o",
        out,
        "--size",
        "100x64",
        "--block",
        "20",
        "--tileable",
        "--exact",
    ]
    status, _, errors = run("synthesize", *words, "--report", tmp_path / "page.html")
    assert status == 0, errors
    assert {p.name for p in out.iterdir()} == {"sample.png", "height.png", "rough.png", "source.exr"}
    channels, _ = read_exr(out / "source.exr")
    row, column = (channels[f"source.{n}"].astype(int) for n in ("row", "column"))
    np.testing.assert_array_equal(stored(out / "sample.png"), stored(sample)[row, column])
    np.testing.assert_array_equal(read_image(out / "height.png"), read_image(tmp_path / "height.png")[row, column])
    np.testing.assert_array_equal(stored(out / "rough.png"), stored(tmp_path / "rough.jpg")[row, column])
    assert "Tiled two by two" in (tmp_path / "page.html").read_text()


def test_transparent_and_masked_pixels_are_not_copied(run, sample, tmp_path):
    values = np.dstack([stored(sample), np.full((60, 70), 255, np.uint8)])
    values[20:25, :30, 3] = 0
    Image.fromarray(values).save(tmp_path / "cut.png")
    mask = np.full((60, 70), 255, np.uint8)
    mask[40:, 60:] = 0
    Image.fromarray(mask).save(tmp_path / "mask.png")
    words = ["-o", tmp_path / "o.png", "--size", "80x80", "--block", "12", "--mask", tmp_path / "mask.png"]
    status, _, errors = run("synthesize", tmp_path / "cut.png", *words)
    assert status == 0, errors
    channels, _ = read_exr(tmp_path / "o.source.exr")
    row, column = (channels[f"source.{n}"].astype(int) for n in ("row", "column"))
    assert ((values[..., 3] > 0) & (mask > 0))[row, column].all()
    assert read_image(tmp_path / "o.png").shape == (80, 80, 3)


@pytest.mark.parametrize("kind", ["eigen3", "height"])
def test_photographs_under_lights(run, tmp_path, kind):
    capture = write_capture(tmp_path / "capture", noisy(scattered(20), channels=3, height=30, width=34))
    words = ["-o", tmp_path / "big.exr", "--size", "60x50", "--kind", kind, "--block", "10", "--maps", tmp_path / "maps"]
    status, said, errors = run("synthesize", capture, *words, "--report", tmp_path / "page.html", "--no-source")
    assert status == 0, errors
    texture = read_relightable(tmp_path / "big.exr")
    assert texture.kind == kind
    assert texture.shape == (50, 60, 3)
    assert {p.name for p in (tmp_path / "maps").iterdir()} == {"normal.png", "albedo.png", "height.png", "maps.exr"}
    assert "under tilt 60°, slant 60°" in said
    assert not (tmp_path / "big.source.exr").exists()
    status, said, _ = run("synthesize", tmp_path / "big.exr", "-o", tmp_path / "more.exr", "--size", "70x70", "--method", "grow")
    assert status == 0
    assert read_relightable(tmp_path / "more.exr").shape == (70, 70, 3)


def test_bad_calls_end_in_one_line(run, sample, tmp_path):
    capture = write_capture(tmp_path / "capture", noisy(scattered(9)))
    other = tmp_path / "other.png"
    write_image(np.zeros((5, 6)), other)
    (tmp_path / "text.png").write_text("no image")
    write_image(np.zeros((60, 70)), tmp_path / "black.png")
    tifffile.imwrite(tmp_path / "wide.tif", np.zeros((60, 70), np.uint32))
    write_exr({"Y": np.full((60, 70), np.nan)}, tmp_path / "nan.exr")
    texture = tmp_path / "texture.exr"
    write_relightable(represent(read_stack(capture), "ptm"), texture)
    out = ["-o", tmp_path / "o.png", "--size", "50x50"]
    for words, message in [
        ([sample, "-o", sample, "--size", "50x50"], "is one of the inputs"),
        ([sample, "-o", tmp_path / "o.xyz", "--size", "50x50"], "unknown image type"),
        ([sample, "-o", tmp_path / "o.png", "--size", "50"], "WIDTHxHEIGHT"),
        ([tmp_path / "none.png", *out], "no such file"),
        ([tmp_path / "text.png", *out], "is no image of a known type"),
        ([sample, other, "-o", tmp_path / "d", "--size", "50x50"], "must have one size"),
        ([sample, sample, "-o", tmp_path / "d", "--size", "50x50"], "written as one file"),
        ([sample, other, *out], "give a folder"),
        ([sample, other, "-o", tmp_path, "--size", "50x50"], "is one of the inputs"),
        ([sample, capture, "-o", tmp_path / "d", "--size", "50x50"], "given alone"),
        ([capture, *out], "unknown texture type"),
        ([sample, *out, "--block", "900"], "larger than the sample"),
        ([sample, *out, "--block", "big"], "neither a number"),
        ([sample, *out, "--block", "²"], "neither a number"),
        ([sample, *out, "--kind", "ptm"], "--kind is for photographs"),
        ([sample, *out, "--mask", tmp_path / "black.png"], "black.png: leaves no pixel"),
        ([tmp_path / "wide.tif", *out], "wide.tif: holds uint32"),
        ([tmp_path / "nan.exr", *out], "nan.exr: has values that are not finite"),
        ([sample, *out, "--method", "quilt", "--block", "10", "--overlap", "10"], "overlap must be"),
        ([sample, *out, "--method", "grow", "--block", "10"], "--block is for --method weave"),
        ([sample, *out, "--window", "5"], "--window is for --method grow"),
        ([texture, "-o", tmp_path / "u.exr", "--size", "50x50", "--gray"], "--gray is for photographs"),
        ([texture, "-o", tmp_path / "u.exr", "--size", "50x50", "--mask", other], "--mask is for photographs"),
        ([sample, *out, "--maps", tmp_path / "m"], "--maps is for"),
        ([sample, *out, "--mask", other], "the sample is 70 x 60"),
        ([sample, *out, "--report", tmp_path / "p.txt"], "unknown report type"),
        ([sample, *out, "--device", "cuda:9"], "not available"),
        ([capture, "-o", tmp_path / "o.exr", "--size", "50x50", "--kind", "x"], "kind 'x' is not known"),
    ]:
        status, _, errors = run("synthesize", *words)
        assert status == 2, (words, errors)
        assert message in errors
        assert "Traceback" not in errors
    assert not (tmp_path / "o.png").exists()


def test_no_input_is_overwritten(run, sample, tmp_path):
    """Masks and photographs are inputs as well, and provenance is an output."""
    mask = np.ones((60, 70))
    folder = tmp_path / "maps"
    folder.mkdir()
    stack = write_capture(tmp_path / "capture", noisy(scattered(9), height=20, width=20))
    first = sorted((tmp_path / "capture").glob("*.exr"))[0]
    other = tmp_path / "other.png"
    write_image(mask, other)
    for given, words in [
        (tmp_path / "m.png", [sample, "-o", tmp_path / "m.png", "--mask", tmp_path / "m.png"]),
        (tmp_path / "big.source.exr", [sample, "-o", tmp_path / "big.png", "--mask", tmp_path / "big.source.exr"]),
        (folder / "other.png", [sample, other, "-o", folder, "--mask", folder / "other.png"]),
        (folder / "source.exr", [sample, other, "-o", folder, "--mask", folder / "source.exr"]),
        (first, [stack, "-o", first]),
    ]:
        if not given.exists():
            write_image(mask, given)
        before = given.read_bytes()
        status, _, errors = run("synthesize", *words, "--size", "80x80")
        assert status == 2
        assert "inputs are never overwritten" in errors
        assert given.read_bytes() == before
        if given != first:
            given.unlink()
    text = stack.read_text().replace(first.name, "a.source.exr")
    stack.write_text(text)
    photograph = first.rename(first.with_name("a.source.exr"))
    before = photograph.read_bytes()
    status, _, errors = run("synthesize", stack, "-o", photograph.with_name("a.exr"), "--size", "40x40")
    assert status == 2
    assert "is one of the inputs" in errors
    assert photograph.read_bytes() == before


def test_ranks(run, tmp_path):
    rows = "\n".join("3,1,2" if i % 7 else "1,2,3" for i in range(40))
    (tmp_path / "ranks.csv").write_text(f"quilt,grow,refined\n{rows}\n")
    status, said, _ = run("rank", tmp_path / "ranks.csv", "--alpha", "0.05")
    assert status == 0
    lines = said.splitlines()
    assert lines[0] == "40 rankings of 3 methods"
    assert lines[2].startswith("  grow: mean rank 1.15, better than refined, quilt")
    # The interval plot: three that don't overlap, best first, and the axis.
    plot = lines[-4:-1]
    assert [line.split()[0] for line in plot] == ["grow", "refined", "quilt"]
    spans = [(line.index("-"), line.rindex("-")) for line in plot]
    assert spans[0][1] < spans[1][0]
    assert spans[1][1] < spans[2][0]
    for words, message in [
        ([tmp_path / "none.csv"], "no such file"),
        ([tmp_path / "ranks.csv", "--methods", "a"], "has no column a"),
        ([tmp_path / "ranks.csv", "-o", tmp_path / "p.html"], "of a study's folder"),
        ([tmp_path / "ranks.csv", "--alpha", "2"], "alpha"),
        ([tmp_path], "give the page to write"),
        ([tmp_path, "-o", tmp_path / "p.html"], "holds no folders"),
    ]:
        status, _, errors = run("rank", *words)
        assert status == 2
        assert message in errors


def test_a_study_becomes_a_page(run, tmp_path):
    for texture in ("bark", "sand"):
        (tmp_path / "study" / texture).mkdir(parents=True)
        for name in ("sample", "quilt", "grow", "other"):
            write_image(np.random.default_rng(0).random((6, 7, 3)), tmp_path / "study" / texture / f"{name}.png")
    status, said, _ = run("rank", tmp_path / "study", "-o", tmp_path / "page.html")
    assert status == 0
    assert "2 textures, 3 methods" in said
    assert (tmp_path / "page.html").read_text().count("data:image/png") == 8
    (tmp_path / "study" / "sand" / "sample.png").unlink()
    status, _, errors = run("rank", tmp_path / "study", "-o", tmp_path / "page.html")
    assert status == 2
    assert "no picture called sample" in errors
