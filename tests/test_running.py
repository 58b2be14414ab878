"""The command as a process: signals, closed streams, inputs that may not be replaced, long work that says so."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import intaglio
from intaglio.files import check_writable, guard_inputs, whole_file, whole_folder
from intaglio.progress import ProgressBar, Stage, be_quiet

COMMAND = [sys.executable, "-c", "from intaglio.cli import main; main()"]
ENDING = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


def start(*words, code="from intaglio.cli import main; main()", **options):
    # A process that a background job starts ignores Ctrl-C unless it says otherwise.
    words = [
        sys.executable,
        "-c",
        "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); " + code,
        *map(str, words),
    ]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


BUSY = """
import sys, time
from pathlib import Path
import intaglio.cli.running as running
def run(told):
    from intaglio.files import tell_unfinished, whole_file, whole_folder
    tell_unfinished(told)
    with whole_folder(Path(sys.argv[1]) / "maps" / "of it") as inside, whole_file(Path(sys.argv[1]) / "out.ply") as beside:
        (inside / "one").write_text("half"), beside.write_text("half")
        print("ready", flush=True)
        {work}
    return 0
running.run = run
running.main()
"""


@pytest.mark.parametrize("number", ENDING)
@pytest.mark.parametrize(
    "work",
    [
        "time.sleep(60)",
        # Compiled code that neither returns nor lets go of Python's lock.
        "import re; re.match('(a+)+b', 'a' * 60)",
        # Code in between that makes something else of what the signal raises.
        "exec('try:\\n    time.sleep(60)\\nexcept BaseException:\\n    raise RuntimeError(1)')",
    ],
)
def test_a_signal_leaves_one_line_and_no_file(tmp_path, number, work):
    working = start(tmp_path, code=BUSY.format(work=work))
    assert working.stdout.readline() == "ready\n"
    assert len(list(tmp_path.rglob(".part-*"))) == 2
    begun = time.perf_counter()
    working.send_signal(number)
    _, errors = working.communicate(timeout=30)
    assert working.returncode == 128 + number
    assert errors == "interrupted; no file was left half written\n"
    assert list(tmp_path.iterdir()) == []
    # Far longer than it takes, far less than the work.
    assert time.perf_counter() - begun < 20


@pytest.mark.parametrize("seed", range(3))
def test_a_signal_at_any_moment_of_a_command(tmp_path, seed):
    intaglio.write_image(np.random.default_rng(0).random((64, 64)), tmp_path / "in.png")
    working = start("synthesize", tmp_path / "in.png", "-o", tmp_path / "out.png", "--size", "512x512")
    time.sleep(random.Random(seed).uniform(0.1, 3.0))
    working.send_signal(ENDING[seed])
    _, errors = working.communicate(timeout=60)
    assert "Traceback" not in errors
    assert {p.name for p in tmp_path.iterdir()} <= {"in.png", "out.png"}
    assert working.returncode in (0, 128 + ENDING[seed])
    assert (working.returncode == 0) == (tmp_path / "out.png").exists()


def test_a_process_that_is_killed_is_cleaned_up_after(tmp_path):
    working = start(tmp_path, code=BUSY.format(work="import os, signal; os.kill(os.getpid(), signal.SIGKILL)"))
    _, errors = working.communicate(timeout=30)
    assert working.returncode == 128 + signal.SIGKILL
    assert errors == "intaglio: was ended by SIGKILL, as where memory runs out\n"
    assert not list(tmp_path.rglob(".part-*"))


def test_a_reader_that_goes_away_ends_nothing(tmp_path):
    intaglio.write_image(np.zeros((32, 32)), tmp_path / "a.png")
    reader, writer = os.pipe()
    os.close(reader)
    words = [*COMMAND, "compare", str(tmp_path / "a.png"), str(tmp_path / "a.png"), "-o", str(tmp_path / "d.png")]
    done = subprocess.run(words, stdout=writer, stderr=subprocess.PIPE, timeout=60)
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, b"")
    assert (tmp_path / "d.png").exists()


def test_closed_streams_are_no_files(tmp_path):
    intaglio.write_image(np.zeros((32, 32)), tmp_path / "a.png")
    words = f"{sys.executable} -c 'from intaglio.cli import main; main()' compare a.png a.png -o d.png <&- >&- 2>&-"
    done = subprocess.run(words, shell=True, cwd=tmp_path, timeout=60, executable="/bin/sh")
    assert done.returncode == 0
    assert intaglio.read_image(tmp_path / "d.png").shape[:2] == (32, 32)


def test_no_home_and_no_cache_end_in_one_line_or_none(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("no folder")
    words = [*COMMAND, "info"]
    changed = {"HOME": str(blocked / "home"), "XDG_CACHE_HOME": str(blocked / "cache"), "WARP_CACHE_PATH": str(blocked / "warp")}
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, env=os.environ | changed)
    assert done.returncode in (0, 2)
    assert len(done.stderr.splitlines()) <= 1, done.stderr


def test_an_unexpected_error_is_one_line(tmp_path):
    code = BUSY.format(work="raise KeyError('odd\\nthing')").replace(
        "running.run = run", "import intaglio.cli.entry as entry\nentry.run_command = lambda: run(None)"
    )
    working = start(tmp_path, code=code)
    _, errors = working.communicate(timeout=30)
    assert working.returncode == 1
    assert errors.count("\n") == 1
    assert "defect: KeyError" in errors


@pytest.fixture
def guarded():
    guard_inputs()
    yield
    guard_inputs(False)


@pytest.mark.usefixtures("guarded")
def test_what_was_opened_is_not_replaced(tmp_path):
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text(name)
    with open(tmp_path / "a.txt") as file:
        file.read()
    (tmp_path / "link.txt").symlink_to(tmp_path / "a.txt")
    os.link(tmp_path / "a.txt", tmp_path / "hard.txt")
    for name in ("a.txt", "link.txt", "hard.txt"):
        with pytest.raises(intaglio.FileError, match="never overwritten"):
            check_writable(tmp_path / name)
    with whole_file(tmp_path / "b.txt") as beside:
        beside.write_text("new")
        assert beside.read_text() == "new"
    assert (tmp_path / "b.txt").read_text() == "new"
    # Inputs that are opened only after the output was checked, and in a folder that is replaced.
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "in.txt").write_text("in")
    (tmp_path / "c.txt").write_text("c")
    with pytest.raises(intaglio.FileError, match="never overwritten"), whole_file(tmp_path / "c.txt") as beside:
        (tmp_path / "c.txt").read_text()
    with pytest.raises(intaglio.FileError, match="another output"), whole_file(tmp_path / "b.txt") as beside:
        beside.write_text("once more")

    def write_maps():
        with whole_folder(tmp_path) as inside:
            (inside / "maps").mkdir()
            (tmp_path / "maps" / "in.txt").read_text()

    with pytest.raises(intaglio.FileError, match="never overwritten"):
        write_maps()
    assert (tmp_path / "maps" / "in.txt").read_text() == "in"
    assert not list(tmp_path.glob(".part-*"))


def test_links_stay_and_pipes_are_left_alone(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "file").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real" / "file")
    with whole_file(tmp_path / "link") as beside:
        beside.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "file").read_text() == "new"
    os.mkfifo(tmp_path / "pipe")
    for call in (check_writable, intaglio.read_image):
        with pytest.raises(intaglio.FileError, match="device or pipe"):
            call(tmp_path / "pipe")


def test_a_folder_that_failed_leaves_none(tmp_path):
    def write_maps():
        with whole_folder(tmp_path / "a" / "b") as inside:
            (inside / "one").write_text("1")
            raise OSError(28, "No space left on device")

    with pytest.raises(intaglio.FileError, match="No space left"):
        write_maps()
    assert list(tmp_path.iterdir()) == []


def test_inputs_of_inputs_are_inputs(tmp_path, run):
    """The pictures of a mirror sphere, the picture of a mesh's material: whatever a command opened."""
    from PIL import Image

    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "my wall.png")
    (tmp_path / "m.mtl").write_text("newmtl a\nmap_Kd my wall.png\n")
    (tmp_path / "m.obj").write_text("mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n")
    before = (tmp_path / "my wall.png").read_bytes()
    status, _, errors = run("render", tmp_path / "m.obj", "-o", tmp_path / "my wall.png", "--samples", 1, "--size", "8x8")
    assert status == 2
    assert "never overwritten" in errors
    assert (tmp_path / "my wall.png").read_bytes() == before


@pytest.mark.parametrize("kind", [Stage, ProgressBar])
def test_long_work_says_so_where_there_is_no_terminal(monkeypatch, capfd, kind):
    monkeypatch.setattr("intaglio.progress._LINE_AFTER", 0.05)
    monkeypatch.setattr("intaglio.progress._LINE_EVERY", 0.05)
    with kind("counting") as stage:
        stage.update(3, 7)
        time.sleep(0.3)
    lines = capfd.readouterr().err.splitlines()
    assert lines[0] == "  counting …"
    assert lines[1] == "  counting … 3 of 7"
    assert lines[-1].startswith("  counting: 0.")
    with kind("short"):
        pass
    be_quiet()
    try:
        with kind("quiet"):
            time.sleep(0.2)
    finally:
        be_quiet(False)
    assert capfd.readouterr().err == ""


def picture(path, color=(255, 0, 0)):
    from PIL import Image

    Image.new("RGB", (16, 16), color).save(path)


def sphere_pictures(folder):
    """Photographs, and pictures of a mirror sphere that lies on them."""
    for name in ("sp", "im"):
        (folder / name).mkdir()
    y, x = np.mgrid[:40, :40] - 19.5
    for k in range(4):
        image = np.where(x**2 + y**2 < 14**2, 0.3, 0.0)
        image[16 + 2 * k : 19 + 2 * k, 20 - 2 * k : 23 - 2 * k] = 1.0
        intaglio.write_image(image, folder / "sp" / f"s{k}.png")
        intaglio.write_image(np.full((8, 8), 0.1 + 0.1 * k), folder / "im" / f"p{k}.png")
    return ["represent", folder / "im", "--sphere", folder / "sp", "--circle", "19.5,19.5,14", "-o", folder / "sp" / "s0.exr"]


def named_by_gltf(folder):
    from test_mesh_files import gltf

    gltf(folder / "m.gltf")


@pytest.mark.usefixtures("guarded")
def test_materials_and_pictures_of_an_input_are_not_replaced_by_an_outputs(tmp_path):
    picture(tmp_path / "out.png")
    for name in ("bump", "second", "shine"):
        picture(tmp_path / f"{name}.png")
    lines = [
        "newmtl a",
        "map_Kd out.png",
        "map_Bump -bm 1 bump.png",
        "newmtl b",
        "map_Kd second.png",
        "map_Ks C:\\scans\\shine.png",
    ]
    (tmp_path / "out.mtl").write_text("\n".join(lines) + "\n")
    text = "mtllib out.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n"
    (tmp_path / "in.obj").write_text(text)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    surface = intaglio.read_surface(tmp_path / "in.obj")
    for name in ("out.obj", "out.ply", "bump.ply", "second.ply", "shine.obj"):
        with pytest.raises(intaglio.FileError, match="never overwritten"):
            surface.write(tmp_path / name)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


@pytest.mark.parametrize("case", ["gltf", "texture file", "relight", "synthesize", "sphere"])
def test_files_that_inputs_name_are_not_replaced(tmp_path, run, case):
    """What was found by attack: files that only a reader knows of, and an input that is an output of the same name."""
    target = tmp_path / "my wall.png"
    picture(target)
    words = ["-o", target]
    if case in ("gltf", "relight"):
        named_by_gltf(tmp_path)
        stack = intaglio.PhotometricStack(np.random.default_rng(0).random((6, 4, 4, 1)), LIGHTS)
        intaglio.write_relightable(intaglio.represent(stack, "ptm"), tmp_path / "t.exr")
        words = (
            ["render", tmp_path / "m.gltf", "--samples", 1, "--size", "8x8", *words]
            if case == "gltf"
            else ["relight", tmp_path / "t.exr", "--mesh", tmp_path / "m.gltf", "--samples", 1, "--size", "8x8", *words]
        )
    elif case == "texture file":
        head = "ply\nformat ascii 1.0\ncomment TextureFile my wall.png\nelement vertex 3\n"
        head += "".join(f"property float {c}\n" for c in ("x", "y", "z", "s", "t"))
        head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
        (tmp_path / "m.ply").write_text(head)
        words = ["render", tmp_path / "m.ply", "--samples", 1, "--size", "8x8", *words]
    elif case == "synthesize":
        words = ["synthesize", target, "--size", "32x32", *words]
    else:
        words = sphere_pictures(tmp_path)
        target = tmp_path / "sp" / "s0.exr"
        (tmp_path / "sp" / "s0.png").rename(target.with_suffix(".bin"))
        intaglio.write_exr({"Y": intaglio.read_image(tmp_path / "sp" / "s1.png")}, target)
    before = target.read_bytes()
    status, _, errors = run(*words)
    assert status == 2, errors
    assert target.read_bytes() == before
    assert [line for line in errors.splitlines() if line.startswith("intaglio: ")] == errors.splitlines()[-1:]
    assert "never overwritten" in errors


def test_two_outputs_of_one_name_are_refused(tmp_path, run):
    stack = tmp_path / "capture.lp"
    for k in range(len(LIGHTS)):
        intaglio.write_image(np.random.default_rng(k).random((8, 8)), tmp_path / f"{k}.png")
    stack.write_text("".join(f"{k}.png {x} {y} {z}\n" for k, (x, y, z) in enumerate(LIGHTS)))
    out = tmp_path / "out"
    out.mkdir()
    for words, said in (
        (["-o", out / "maps.exr", "--maps", out], "one of the maps has that name"),
        (["-o", out / "t.exr", "--maps", out / "t.exr"], "different names"),
        (["-o", out / "t.exr", "--maps", ""], "the name is empty"),
    ):
        status, _, errors = run("represent", stack, "--kind", "gradient", *words)
        assert (status, list(out.iterdir())) == (2, []), errors
        assert said in errors
        assert errors.splitlines()[-1].startswith("intaglio: ")


LIGHTS = [[0, 0, 1], [0.5, 0, 0.8], [0, 0.5, 0.8], [-0.5, 0, 0.8], [0, -0.5, 0.8], [0.4, 0.4, 0.8]]
