"""The command line: what it writes, what it says, how it fails."""

from __future__ import annotations

import subprocess
import sys
import warnings

import click
import numpy as np
import pytest

import intaglio
from intaglio import cli
from intaglio.cli.options import grouped, was_given


def run(monkeypatch, capsys, *arguments):
    """Run the command in this process; return (status, stdout, stderr)."""
    monkeypatch.setattr(sys, "argv", ["intaglio", *map(str, arguments)])
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        status = cli.run()
    out = capsys.readouterr()
    return status, out.out, out.err


@pytest.fixture
def scan_file(wave_sheet, tmp_path):
    scan, _ = wave_sheet
    holed = scan.part(np.linalg.norm(scan.vertices[:, :2] - 20, axis=1) > 5)
    holed.write(tmp_path / "scan.ply")
    return tmp_path / "scan.ply"


@pytest.mark.parametrize("command", [(), ("complete",), ("render",), ("compare",), ("info",)])
def test_help_has_an_example_seed_and_device(monkeypatch, capsys, command):
    status, out, _ = run(monkeypatch, capsys, *command, "--help")
    assert status == 0
    if command:
        for text in ("Example: intaglio", "--seed", "--device"):
            assert text in out


@pytest.mark.usefixtures("quick_pictures")
def test_complete_writes_mesh_and_report(monkeypatch, capsys, scan_file, tmp_path):
    output, page = tmp_path / "whole.ply", tmp_path / "whole.html"
    status, out, err = run(
        monkeypatch, capsys, "complete", scan_file, "-o", output, "--base", "plane", "--window", 3, "--report", page, "--seed", 4
    )
    assert status == 0, err
    whole, scan = intaglio.read_surface(output), intaglio.read_surface(scan_file)
    assert whole.vertices[: len(scan.vertices)].tobytes() == scan.vertices.tobytes()
    assert (~whole.measured).sum() > 50
    assert f"wrote {output}" in out
    assert f"wrote {page}" in out
    assert "mean surface integral" in out
    assert "spacing" in err
    same = intaglio.complete_relief(scan, "plane", window=3, seed=4)
    assert same.vertices.tobytes() == whole.vertices.tobytes()


def test_render_compare_info(monkeypatch, capsys, scan_file, tmp_path):
    picture, other, difference = (tmp_path / n for n in ("a.png", "b.png", "d.png"))
    for output, slant in ((picture, 30), (other, 60)):
        status, out, err = run(monkeypatch, capsys, "render", scan_file, "-o", output, "--size", "40x30", "--slant", slant)
        assert status == 0, err
        assert "40 x 30" in out
    assert intaglio.read_image(picture).shape == (30, 40, 3)
    status, out, err = run(monkeypatch, capsys, "compare", picture, other, "-o", difference)
    assert status == 0, err
    assert "FLIP" in out
    assert difference.exists()
    status, out, err = run(monkeypatch, capsys, "info", scan_file, picture)
    assert status == 0, err
    assert "2 border loops" in out
    assert "40 x 30 pixels, 3 channels" in out
    status, out, _ = run(monkeypatch, capsys, "info")
    assert "renderer:" in out
    assert "in use" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("complete", "none.ply", "-o", "out.ply"), "no such file"),
        (("complete", "SCAN", "-o", "SCAN"), "never overwritten"),
        (("complete", "SCAN", "-o", "nowhere/out.ply"), "does not exist"),
        (("complete", "SCAN", "-o", "out.xyz"), "unknown mesh type"),
        (("complete", "SCAN", "-o", "out.ply", "--report", "r.pdf"), "unknown report type"),
        (("complete", "SCAN", "-o", "out.ply", "--window", "0"), "window must be"),
        (("complete", "SCAN", "-o", "out.ply", "--extent", "lots"), "list of numbers"),
        (("complete", "SCAN"), "Missing option"),
        (("complete", "SCAN", "-o", "out.ply", "--device", "cuda:9"), "not available"),
        (("render", "SCAN", "-o", "a.png", "--size", "big"), "WIDTHxHEIGHT"),
        (("render", "SCAN", "-o", "a.png", "--direction", "0,0,0"), "not be all zero"),
        (("render", "SCAN", "-o", "a.bmp"), "unknown image type"),
        (("compare", "SCAN", "SCAN"), "is a PLY mesh, no image"),
        (("info", "Makefile.txt"), "no such file"),
        (("polish", "SCAN"), "No such command"),
        (("render", "SCAN", "-o", "a.png", "--slant", "nan"), "finite"),
        (("render", "SCAN", "-o", "a.png", "--direction", "nan,0,0"), "not finite"),
        (("info", "--device", "tpu"), "not available"),
        (("info", "x" * 300 + ".ply"), "no usable file name"),
        (("complete", "SCAN", "-o", "out.ply", "--base", "sphere", "--extent", "rectangle"), "scan.ply: "),
    ],
)
def test_errors_are_one_message_and_status_two(monkeypatch, capsys, scan_file, tmp_path, arguments, message):
    monkeypatch.chdir(tmp_path)
    before = sorted(p.name for p in tmp_path.iterdir())
    status, _, err = run(monkeypatch, capsys, *[str(scan_file) if a == "SCAN" else a for a in arguments])
    assert status == 2
    assert message in err
    assert "Traceback" not in err
    assert sorted(p.name for p in tmp_path.iterdir()) == before


def test_an_output_that_cannot_be_written_is_found_before_the_work(monkeypatch, capsys, scan_file, tmp_path):
    monkeypatch.setattr("intaglio.read_surface", lambda *a, **k: pytest.fail("read before the output was checked"))
    status, _, err = run(monkeypatch, capsys, "complete", scan_file, "-o", tmp_path / "none" / "x.ply")
    assert status == 2
    assert "does not exist" in err


def test_interrupted_work_leaves_no_file(cap, tmp_path):
    work = tmp_path / "work"
    work.mkdir()
    cap.write(work / "cap.ply")
    script = tmp_path / "interrupt.py"
    # The real command, with Ctrl-C pressed once growth is under way.
    script.write_text(
        "import os, signal, sys\n"
        "from intaglio import cli, progress\n"
        # A process that a background job starts ignores the signal unless it says otherwise.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "shown = progress.ProgressBar.update\n"
        "def update(self, done, total):\n"
        "    shown(self, done, total)\n"
        "    if 0 < done < total:\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "progress.ProgressBar.update = update\n"
        "sys.argv = ['intaglio', 'complete', 'cap.ply', '-o', 'out.ply', '--base', 'sphere', '--window', '3']\n"
        "cli.main()\n"
    )
    done = subprocess.run([sys.executable, str(script)], cwd=work, capture_output=True, text=True, timeout=120)
    assert done.returncode == 130, done.stderr
    assert "interrupted" in done.stderr
    assert [p.name for p in work.iterdir()] == ["cap.ply"]


def test_info_of_a_stack(monkeypatch, capsys, tmp_path):
    intaglio.write_image(np.full((4, 6, 3), 0.5), tmp_path / "a.png")
    (tmp_path / "capture.lp").write_text("2\na.png 0 0 2\nb b.png 1 0 1\n")
    status, out, err = run(monkeypatch, capsys, "info", tmp_path / "capture.lp")
    assert status == 0, err
    assert "2 lights" in out
    assert "light slant 0.0 to 45.0" in out
    assert "only 1 of 2 photographs can be used: b b.png: missing" in out
    intaglio.write_image(np.full((4, 6, 3), 0.5), tmp_path / "b b.png")
    status, out, err = run(monkeypatch, capsys, "info", tmp_path / "capture.lp")
    assert status == 0, err
    assert "stack of 2 images, 6 x 4 pixels, 3 channels" in out
    (tmp_path / "bad.lp").write_text("3\na.png 0 0 1\n")
    status, out, err = run(monkeypatch, capsys, "info", tmp_path / "bad.lp")
    # A wrong number in the first line is taken with a word.
    assert status == 0, err
    assert "its first line declares 3 images, 1 follow and were taken" in out


def test_grouped_options_reach_the_command_as_one_argument():
    seen = {}

    @click.command()
    @click.option("--first", default=1)
    @grouped("fit", dict, click.option("--weight", default=0.5, help="Heavy."), click.option("--no-seam", is_flag=True))
    @click.option("--last", default=2)
    def command(first, fit, last):
        seen.update(first=first, fit=fit, last=last, given=was_given("weight"))

    assert [param.name for param in command.params] == ["first", "weight", "no_seam", "last"]
    command.main(["--weight", "3", "--last", "4"], standalone_mode=False)
    assert seen == {"first": 1, "fit": {"weight": 3.0, "no_seam": False}, "last": 4, "given": True}


def rendered(monkeypatch, capsys, mesh, path, *options):
    status, _, err = run(monkeypatch, capsys, "render", mesh, "-o", path, "--size", "60x60", "--samples", 4, *options)
    assert status == 0, err
    return intaglio.read_image(path)[:, :, :3]


def test_a_filling_is_looked_at_close_up(monkeypatch, capsys, scan_file, tmp_path):
    """Of the whole mesh the filling is a small part; close up it fills much of the picture, and is in its middle."""
    scan = intaglio.read_surface(scan_file)
    whole = intaglio.complete_relief(scan, "plane", window=3, refine=0, extent="holes")
    whole.write(tmp_path / "whole.ply")

    def blue(name, mesh, *options):
        image = rendered(monkeypatch, capsys, mesh, tmp_path / name, "--provenance", *options)
        return image[:, :, 2] > 1.05 * image[:, :, 0]

    far = blue("far.png", tmp_path / "whole.ply")
    near = blue("near.png", tmp_path / "whole.ply", "--hole", 1)
    assert 0 < far.mean() < 0.08
    assert near.mean() > 3 * far.mean()
    rows, columns = np.nonzero(near)
    assert abs(rows.mean() - 29.5) < 6
    assert abs(columns.mean() - 29.5) < 6
    at = ",".join(f"{v:.3f}" for v in whole.vertices[~whole.measured].mean(axis=0))
    same = blue("same.png", tmp_path / "whole.ply", "--look-at", at, "--zoom", 3)
    assert same.mean() > 3 * far.mean()
    rendered(
        monkeypatch, capsys, tmp_path / "whole.ply", tmp_path / "x.png", "--direction", "1e308,0,1e308", "--up", "0,1e-310,0"
    )
    (tmp_path / "x.png").unlink()
    for words, said in (
        (("--hole", 9), "no filling 9: it has 1"),
        (("--hole", 1, "--look-at", "0,0,0"), "give one of them"),
        (("--zoom", -1), "zoom"),
        (("--direction", "0,0,0"), "all zero"),
        (("--look-at", "1e300,0,0"), "far off"),
    ):
        status, _, err = run(monkeypatch, capsys, "render", tmp_path / "whole.ply", "-o", tmp_path / "x.png", *words)
        assert status == 2
        assert said in err
        assert len(err.splitlines()) == 1


def test_a_hole_of_a_scan_is_looked_at(monkeypatch, capsys, scan_file, tmp_path):
    numbers = [h.number for h in intaglio.list_holes(intaglio.read_surface(scan_file)) if not h.outer]
    far = rendered(monkeypatch, capsys, scan_file, tmp_path / "far.png")
    near = rendered(monkeypatch, capsys, scan_file, tmp_path / "near.png", "--hole", numbers[0])
    # The background shows through the hole.
    through = [
        np.isclose(image, image[0, 0] if k == 0 else far[0, 0], atol=0.02).all(axis=2) for k, image in enumerate((far, near))
    ]
    assert through[1][25:35, 25:35].mean() > 0.9
    assert through[1].mean() > 0.1


def test_holes_are_named_by_the_scans_own_vertices(wave_sheet):
    scan, _ = wave_sheet
    holed = scan.part(np.linalg.norm(scan.vertices[:, :2] - 20, axis=1) > 5)
    stray = intaglio.Surface(
        vertices=np.concatenate([[[900, 0, 0], [901, 0, 0], [900, 1, 0]], holed.vertices]),
        faces=np.concatenate([[[0, 1, 2]], holed.faces + 3]),
    )
    for first, second in zip(intaglio.list_holes(holed), intaglio.list_holes(stray), strict=True):
        np.testing.assert_array_equal(first.loop + 3, second.loop)


def test_messages_name_the_option(monkeypatch, capsys, scan_file, tmp_path):
    status, _, err = run(monkeypatch, capsys, "complete", scan_file, "-o", tmp_path / "o.ply", "--color-weight", 3)
    assert status == 2
    assert err.startswith("intaglio: --color-weight must be")
