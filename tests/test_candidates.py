"""Several completions to choose from: what each is, and the page that shows them together."""

from __future__ import annotations

import numpy as np
import pytest

import intaglio
from intaglio import InputError, ReliefSettings
from tests.test_cli import run
from tests.test_symmetry import cut, pair, sheet


def rough(x, y):
    rng = np.random.default_rng(4)
    k, phase = rng.uniform(-0.9, 0.9, (40, 2)), rng.uniform(0, 2 * np.pi, 40)
    return 0.25 * np.cos(x[..., None] * k[:, 0] + y[..., None] * k[:, 1] + phase).sum(axis=-1)


@pytest.fixture(scope="module")
def scan():
    return cut(sheet(rough), radius=5.0)


@pytest.fixture(scope="module")
def three(scan):
    return intaglio.prepare_relief(scan, "smooth").candidates(3, seed=4)


def test_candidates_are_completions_of_successive_seeds(scan, three):
    prepared = intaglio.prepare_relief(scan, "smooth")
    for k, candidate in enumerate(three):
        alone = prepared.complete(seed=4 + k)
        assert np.array_equal(candidate.vertices, alone.vertices)
        assert np.array_equal(candidate.source, alone.source)
    assert not np.array_equal(three[0].vertices, three[1].vertices)


def test_candidates_of_a_hole_with_a_like_differ():
    """The second takes another place, or pieces: the like alone has nothing that a seed could change."""
    one, two = intaglio.prepare_relief(cut(sheet(pair())), "smooth").candidates(2)
    assert any("a place that is alike" in note for note in one.notes)
    assert not np.array_equal(one.vertices, two.vertices)


def test_progress_goes_over_all(scan):
    seen = []
    intaglio.prepare_relief(scan, "smooth").candidates(2, progress=lambda done, total: seen.append(done / total))
    assert seen == sorted(seen)
    assert seen[-1] == 1
    assert min(seen) < 0.5


@pytest.mark.parametrize("count", [0, -1, 101, 1.5, True, "2", None])
def test_senseless_counts_are_refused(scan, count):
    with pytest.raises(InputError, match="count"):
        intaglio.prepare_relief(scan, "smooth").candidates(count)


def test_the_page_shows_them_together(tmp_path, scan, three):
    reports = intaglio.write_candidates_report(
        three, tmp_path / "c.html", truth=sheet(rough), scan=scan, size=24, device="cpu", title="Which?"
    )
    page = (tmp_path / "c.html").read_text(encoding="utf-8")
    assert "<h1>Which?</h1>" in page
    for number, report in enumerate(reports, 1):
        assert f"Candidate {number}" in page
        assert f"{report.truth.rms:.4g}" in page
    # Three views of the scan, three candidates and the truth.
    assert page.count("data:image/png") == 3 * 5


def test_pages_of_what_doesnt_belong_together_are_refused(tmp_path, three):
    path = tmp_path / "c.html"
    with pytest.raises(InputError, match="holds no surface"):
        intaglio.write_candidates_report([], path)
    with pytest.raises(InputError, match=r"candidates\[1\] must be a Surface"):
        intaglio.write_candidates_report([three[0], 3], path)
    with pytest.raises(InputError, match="completes another scan"):
        intaglio.write_candidates_report([three[0], sheet(pair())], path)
    assert not path.exists()


def test_the_command_writes_each(tmp_path, monkeypatch, capsys, scan):
    scan.write(tmp_path / "scan.ply")
    arguments = (
        "complete",
        tmp_path / "scan.ply",
        "--base",
        "smooth",
        "--candidates",
        2,
        "--seed",
        4,
        "-o",
        tmp_path / "whole.ply",
    )
    status, out, _ = run(monkeypatch, capsys, *arguments, "--report", tmp_path / "both.html")
    assert status == 0
    assert "whole-1.ply" in out
    assert "whole-2.ply" in out
    assert not (tmp_path / "whole.ply").exists()
    again = intaglio.prepare_relief(intaglio.read_surface(tmp_path / "scan.ply"), "smooth").candidates(
        2, ReliefSettings(), seed=4
    )
    for number, candidate in enumerate(again, 1):
        assert np.array_equal(intaglio.read_surface(tmp_path / f"whole-{number}.ply").vertices, candidate.vertices)
    assert "Candidate 2" in (tmp_path / "both.html").read_text(encoding="utf-8")
