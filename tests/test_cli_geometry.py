"""The command extend."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from intaglio import (
    PointSet,
)
from intaglio.scenes.swatches import weave
from intaglio.scenes.weave_on_vase import vase


@pytest.fixture
def swatch_file(tmp_path):
    points, normals, _ = weave(6, 0.13)
    PointSet(points, normals).write(tmp_path / "weave.ply")
    return tmp_path / "weave.ply"


@pytest.mark.usefixtures("quick_pictures")
def test_the_command_writes_points_mesh_and_report(swatch_file, run):
    folder = swatch_file.parent
    before = swatch_file.read_bytes()
    code, said, errors = run(
        "extend", swatch_file, "-o", folder / "big.ply", "--size", "6,5", "--patch", "2.6", "--mesh", folder / "big.glb",
        "--report", folder / "big.html", "--axis", "z",
    )  # fmt: skip
    assert code == 0, errors
    assert swatch_file.read_bytes() == before
    assert "points from a swatch of" in said
    assert "step at patch borders" in said
    assert "shrunk" in errors
    raw = trimesh.load(folder / "big.ply").metadata["_ply_raw"]["vertex"]["data"]
    assert {"source", "moved", "patch"} <= set(raw.dtype.names)
    assert len(trimesh.load(folder / "big.glb", force="mesh").faces) > 1000
    assert (folder / "big.html").read_text("utf-8").count("<img") == 6


def test_the_command_lays_the_result_over_a_mesh(swatch_file, run):
    folder = swatch_file.parent
    vertices, faces, uv = vase(24, 24)
    visual = trimesh.visual.TextureVisuals(uv=uv)
    trimesh.Trimesh(vertices, faces, visual=visual, process=False).export(folder / "vase.obj")
    code, _, errors = run(
        "extend", swatch_file, "-o", folder / "vase.ply", "--size", "8", "--patch", "2.2", "--extra", "0.4", "--tileable",
        "--over", folder / "vase.obj", "--repeat", "2,1",
    )  # fmt: skip
    assert code == 0, errors
    assert "on the mesh on average" in errors
    points = trimesh.load(folder / "vase.ply").vertices
    assert np.linalg.norm(points[:, :2], axis=1).max() < 2


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "weave.ply", "--size", "6"], "is one of the inputs"),
        (["-o", "big.stl", "--size", "6"], "unknown points type|unknown"),
        (["-o", "none/big.ply", "--size", "6"], "does not exist"),
        (["-o", "big.ply", "--size", "6,5,4"], "--size takes one number or two"),
        (["-o", "big.ply", "--size", "6", "--patch", "99"], "larger than the swatch"),
        (["-o", "big.ply", "--size", "6", "--closed"], "--closed goes with --mesh"),
        (["-o", "big.ply", "--size", "6", "--repeat", "2,2"], "--repeat goes with --over"),
        (["-o", "big.ply", "--size", "6", "--mesh-cell", "2"], "--mesh-cell goes with --mesh"),
        (["-o", "big.ply", "--size", "6", "--over", "weave.ply"], "no triangles|texture coordinates"),
        (["-o", "big.ply", "--size", "6", "--bounds", "0,0,0,1,1,0"], "bounds have no"),
        (["-o", "big.ply", "--size", "6", "--mesh", "big.ply"], "must be different files"),
        (["-o", "big.ply", "--size", "6", "--mesh", "big.glb", "--mesh-cell", "0"], "mesh-cell"),
        (["-o", "big.ply", "--size", "0"], "--size must be above 0"),
        (["-o", "big.ply", "--size", "6", "--over", "weave.ply", "--repeat", "1.5,1"], "--repeat must be two whole"),
        (["-o", "big.ply", "--size", "6", "--height", "3"], "height goes with height maps"),
        (["-o", "big.ply", "--size", "6", "--mesh", "big.doc"], "unknown mesh type|unknown"),
        (["-o", "big.ply", "--size", "6", "--report", "big.txt"], "report"),
    ],
)
def test_the_command_tells_what_is_wrong(swatch_file, run, words, message):
    import re

    code, _, errors = run("extend", swatch_file, *words, cwd=swatch_file.parent)
    assert code == 2
    assert re.search(message, errors)
    assert "Traceback" not in errors
    assert sorted(p.name for p in swatch_file.parent.iterdir()) == ["weave.ply"]


def test_info_tells_of_points(swatch_file, run):
    code, said, _ = run("info", swatch_file)
    assert code == 0
    assert "points with normals" in said
    assert "height axis z" in said
    assert "no height field" in said


def test_info_tells_what_a_scan_holds_and_leaves_out_what_takes_minutes(tmp_path, run, monkeypatch):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.random((400, 2)) * 10, np.zeros(400)])
    table = np.column_stack([points, np.arange(400), rng.integers(0, 256, (400, 3))])
    head = "20\n20\n5 5 9\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n500000.25 5 9 1\n"
    (tmp_path / "a.ptx").write_text(head + "".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in table))
    code, said, _ = run("info", tmp_path / "a.ptx")
    assert code == 0
    for part in (
        "400 points",
        "colour per point: yes",
        "intensity: 0 to 399",
        "normals: no",
        "scan positions: (500000.25, 5, 9)",
    ):
        assert part in said
    assert "turned to where the scanner stood" in said
    monkeypatch.setattr("intaglio.cli.facts._MOST_POINTS", 399)
    code, said, _ = run("info", tmp_path / "a.ptx")
    assert code == 0
    assert "not looked at for more than 399 points" in said
    # Tables named as lists of lights are.
    np.savetxt(tmp_path / "cloud.txt", points)
    code, said, _ = run("info", tmp_path / "cloud.txt")
    assert code == 0
    assert "400 points" in said
    assert "scan positions: unknown" in said
