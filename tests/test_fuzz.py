"""Spoiled files for every reader, in short; and that the fuzzing itself finds what it is for."""

from __future__ import annotations

import collections
import json
import os
import subprocess
import sys
import tempfile
import warnings

import fuzzing
import numpy as np
import pytest

from intaglio import FileError, InputError, IntaglioWarning

SEED = 11
INPUTS = 400


@pytest.fixture(scope="module")
def cases():
    pytest.importorskip("laspy")
    pytest.importorskip("pye57")
    pytest.importorskip("rawpy")
    return fuzzing.Cases(SEED)


def test_spoiled_files_are_read_or_refused_in_a_line(tmp_path):
    tally = fuzzing.fuzz(SEED, tmp_path, count=INPUTS)
    assert not tally.faulty_seeds
    assert not tally.defects, "\n".join(f"{t}: {k}: {found[0]['text']}" for (t, k), found in tally.defects.items())
    outcomes = collections.Counter()
    for (_, outcome), count in tally.counts.items():
        outcomes[outcome] += count
    # Neither is everything refused, nor nothing spoiled.
    assert outcomes["read"] > INPUTS / 8
    assert outcomes["refused"] > INPUTS / 3


def test_every_reader_has_seeds(cases):
    assert all(cases.by_target.values())


def test_every_suffix_has_a_seed(cases):
    """A reader that is added to one of these tables needs files to be tried with."""
    from intaglio.files import images
    from intaglio.files.image_kinds import image_kind
    from intaglio.mesh import point_files, reading
    from intaglio.photographs import camera_files
    from intaglio.photometric import STACK_SUFFIXES, writing

    def suffixes(target):
        return {f".{name.rsplit('.', 1)[-1]}" for s in cases.by_target[target] for name in s.files if "." in name}

    assert suffixes("read_surface") >= set(reading._readers)
    assert suffixes("read_point_file") >= set(point_files._readers)
    assert suffixes("read_photographs") >= {*camera_files._readers, ".bin", ".xmp", ".ini"}
    assert suffixes("read_stack") >= set(STACK_SUFFIXES)
    assert suffixes("read_relightable") >= set(writing._readers)
    with tempfile.TemporaryDirectory() as place:
        found = set()
        for seed in cases.by_target["read_image"]:
            path = fuzzing.Path(place, seed.entry)
            path.write_bytes(seed.files[seed.entry])
            found.add(image_kind(path))
    assert found == set(images._readers)


def test_the_same_seed_gives_the_same_inputs(cases):
    again = fuzzing.Cases(SEED)
    # Writers of these give them a date or a name of their own.
    dated = ("las", "laz", "e57")
    for number in range(200):
        first, second = cases.make(number), again.make(number)
        if not first[3].startswith(dated):
            assert first[0] == second[0]
            assert first[2:] == second[2:]


def leave_a_file(path):
    tempfile.mkstemp()


def warn(path):
    warnings.warn("odd", RuntimeWarning, stacklevel=1)


def warn_at_length(path):
    warnings.warn("odd\nand more", IntaglioWarning, stacklevel=1)


def refuse_namelessly(path):
    raise InputError("is no mesh")


@pytest.mark.parametrize(
    ("call", "kind"),
    [
        (lambda path: {}["x"], "KeyError at test_fuzz.py"),
        (lambda path: {"a": [np.array([1, np.nan])]}, "not finite: result.a.#"),
        (lambda path: os.write(2, b"hello"), "output: hello"),
        (lambda path: subprocess.run([sys.executable, "-c", "print('from below')"], check=True), "output: from below"),
        (lambda path: path.write_text("other"), "input changed"),
        (lambda path: path.with_name("more").write_text("other"), "input changed"),
        (leave_a_file, "files left"),
        (warn, "warning at test_fuzz.py"),
        (warn_at_length, "long warning"),
        (refuse_namelessly, "message without the file"),
    ],
)
def test_defects_are_found(tmp_path, monkeypatch, call, kind):
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "tmp"))
    fuzzing.write_files({"a.ply": b"ply"}, tmp_path / "case")
    verdict = fuzzing.judge(call, tmp_path / "case", "a.ply")
    assert verdict.outcome == "defect"
    assert verdict.kind.startswith(kind)


def test_what_is_no_defect(tmp_path):
    def refuse(path):
        raise FileError(f"{path}: is cut off")

    fuzzing.write_files({"a.ply": b"ply"}, tmp_path / "case")
    assert fuzzing.judge(refuse, tmp_path / "case", "a.ply") == fuzzing.Verdict(
        "refused", text=f"{tmp_path}/case/a.ply: is cut off"
    )
    assert fuzzing.judge(lambda path: np.ones(3), tmp_path / "case", "a.ply") == fuzzing.Verdict("read")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("statement", "kind"),
    [
        ("import ctypes; ctypes.string_at(0)", "crash -11"),
        ("bytearray(3 << 30)", "MemoryError"),
        ("while True: pass", "hangs"),
    ],
)
def test_crashes_hangs_and_memory_are_found_and_can_be_repeated(tmp_path, monkeypatch, capsys, statement, kind):
    script = tmp_path / "broken.py"
    script.write_text(
        f"""
import sys
sys.path.insert(0, {str(fuzzing.Path(fuzzing.__file__).parent)!r})
import fuzzing

started = False

def broken(path):
    if started:
        {statement}

def make(self, number):
    global started
    started = True
    return "read_ranks", {{"ranks.csv": b"x"}}, "ranks.csv", "ranks"

names = list(fuzzing.targets())
fuzzing.targets = lambda: dict.fromkeys(names, broken)
fuzzing.Cases.make = make
sys.exit(fuzzing.main())
"""
    )
    monkeypatch.setattr(fuzzing, "__file__", str(script))
    monkeypatch.setattr(fuzzing, "HANGS", 3)
    tally = fuzzing.fuzz(SEED, tmp_path / "out", count=1)
    ((target, found),) = tally.defects
    assert target == "read_ranks"
    assert found.startswith(kind)
    (kept,) = (tmp_path / "out").iterdir()
    assert kept.name == "0001-read_ranks"
    assert json.loads((kept / "case.json").read_text())["target"] == "read_ranks"
    assert fuzzing.repeat(kept) == 0  # the real reader refuses it
    assert "read_ranks of ranks" in capsys.readouterr().out
