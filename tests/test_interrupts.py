"""Every command, ended at random times by every signal: one line, no leftovers. INTAGLIO_INTERRUPTS says how often."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from reliefs import dimpled_ball
from skimage import data

import intaglio
from intaglio.kernels.launch import threads
from intaglio.mesh import grid_faces

OFTEN = int(os.environ.get("INTAGLIO_INTERRUPTS", "24"))
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
START = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from intaglio.cli import main; main()"


@pytest.fixture(scope="module")
def commands(tmp_path_factory):
    """Return the commands, each with what it reads, as functions of the folder that they write to."""
    given = tmp_path_factory.mktemp("given")
    scan = dimpled_ball()
    scan.write(given / "scan.ply")
    intaglio.complete_relief(scan, refine=0, rotations=1).write(given / "whole.ply")
    sample = data.brick()[:160, :160].astype(np.float32) / 255
    intaglio.write_image(sample, given / "sample.png")
    hole = np.zeros((160, 160), np.float32)
    hole[60:100, 60:100] = 1
    intaglio.write_image(hole, given / "hole.png")
    y, x = np.mgrid[:50, :50] * 0.1
    swatch = np.stack([x, y, 0.3 * np.sin(6 * x) * np.sin(5 * y)], axis=-1).reshape(-1, 3)
    intaglio.Surface(vertices=swatch, faces=grid_faces(50, 50)).write(given / "swatch.ply")
    lights = [(np.cos(t) * 0.6, np.sin(t) * 0.6, 0.8) for t in np.linspace(0, 6, 12)]
    for k in range(len(lights)):
        intaglio.write_image(sample * (0.5 + 0.04 * k), given / f"{k}.png", bits=16)
    (given / "capture.lp").write_text("".join(f"{k}.png {x} {y} {z}\n" for k, (x, y, z) in enumerate(lights)))
    return {
        "complete": lambda out: ["complete", given / "scan.ply", "-o", out / "o.ply", "--report", out / "r.html"],
        "list": lambda out: ["complete", given / "scan.ply", "--holes", "list"],
        "info": lambda out: ["info", given / "whole.ply", given / "capture.lp", given / "sample.png"],
        "render": lambda out: ["render", given / "whole.ply", "-o", out / "o.png", "--samples", 256],
        "represent": lambda out: ["represent", given / "capture.lp", "-o", out / "o.exr", "--maps", out / "maps"],
        "synthesize": lambda out: ["synthesize", given / "sample.png", "-o", out / "o.png", "--size", "512x512"],
        "restore": lambda out: [
            "restore",
            given / "sample.png",
            given / "hole.png",
            "-o",
            out / "o.png",
            "--report",
            out / "r.html",
        ],
        "extend": lambda out: ["extend", given / "swatch.ply", "--size", "9,9", "-o", out / "o.ply", "--mesh", out / "m.glb"],
        "assess": lambda out: ["assess", "relief", given / "whole.ply"],
        "compare": lambda out: ["compare", given / "sample.png", given / "hole.png", "-o", out / "o.png"],
    }


@pytest.mark.slow
@pytest.mark.parametrize("turn", range(OFTEN))
def test_nothing_is_left(commands, tmp_path, turn):
    draw = random.Random(turn)
    name, number = sorted(commands)[turn % len(commands)], draw.choice(ENDING)
    words = [sys.executable, "-c", START, *map(str, commands[name](tmp_path))]
    working = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    time.sleep(draw.uniform(0.1, 12.0 / threads()))
    working.send_signal(number)
    _, errors = working.communicate(timeout=120)
    assert "Traceback" not in errors
    assert "defect" not in errors
    assert working.returncode in (0, 128 + number)
    assert (working.returncode == 0) == ("interrupted" not in errors)
    assert not list(tmp_path.rglob(".part-*"))
    assert not [p for p in tmp_path.rglob("*") if p.is_dir() and not any(p.iterdir())]
