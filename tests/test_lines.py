"""Lines that reach a rim: how they are found, paired and joined, how they steer a filling, and guides drawn by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import intaglio
from intaglio import FileError, InputError, ReliefSettings, Surface
from intaglio.mesh import grid_faces
from intaglio.relief.coherent.joining import Anchors, Wishes, join
from intaglio.relief.ground import GroundOptions, prepare_ground
from intaglio.relief.lines import Curve, checked_guides, find_ends, find_features, guide_curves, joined, steered, without_guided
from intaglio.relief.lines.curves import End, hermite
from tests.test_cli import run

SIDE, RADIUS = 60, 9.0
MIDDLE = SIDE / 2


def bent(x, y):
    """A line of uneven profile along y that winds: a carved fold that no other place of the sheet is like."""
    return -0.8 * np.abs(x - winding(y)) + 0.15 * np.sin(0.35 * y + 0.2 * x)


def winding(y):
    return MIDDLE + 2.5 * np.sin(y / 11)


def fold_height(x, y):
    return bent(x, y)


def sheet(height, seed=0, noise=0.01):
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.arange(float(SIDE)), np.arange(float(SIDE)))
    x, y = (axis + rng.uniform(-0.2, 0.2, axis.shape) for axis in (x, y))
    vertices = np.stack([x, y, height(x, y) + rng.normal(0, noise, x.shape)], axis=-1).reshape(-1, 3)
    return Surface(vertices=vertices, faces=grid_faces(SIDE, SIDE)[:, ::-1])


def cut(surface, radius=RADIUS):
    away = np.hypot(surface.vertices[:, 0] - MIDDLE, surface.vertices[:, 1] - MIDDLE)
    return surface.part(away >= radius)


def ground_of(scan):
    """The ground of the sheet's hole, as completion works on it."""
    hole = max((h for h in intaglio.list_holes(scan) if not h.outer), key=lambda h: h.length)
    return prepare_ground(scan, "smooth", GroundOptions(holes=hole.number))


@pytest.fixture(scope="module")
def ground():
    return ground_of(cut(sheet(fold_height)))


def test_features_know_ridges_from_valleys():
    """A cylinder bends by one over its radius, across; so the sign and the direction can be told."""
    for sign in (1.0, -1.0):
        x, y = np.meshgrid(np.arange(24.0), np.arange(24.0))
        z = sign * 6 * np.cos((x - 11.5) / 24)
        away = np.hypot(x - 11.5, y - 11.5) < 3
        points = np.stack([x, y, z], axis=-1)
        points[away] = np.nan
        scan = intaglio.surface_from_range_image(points, view=(12, 12, 500))
        features = find_features(prepare_ground(scan, "smooth"))
        at = np.flatnonzero(np.abs(scan.vertices[:, 0] - 11.5) < 1)
        at = at[np.abs(scan.vertices[at, 1] - 4) < 2]
        # z'' = 6 / 24^2 at the top.
        assert features.bend[at] == pytest.approx(sign * 6 / 24**2, rel=0.1)
        assert np.abs(features.along[at, 1]).min() > 0.99
        assert not features.on_line.any()


def test_features_lie_on_the_fold(ground):
    features = find_features(ground)
    at = ground.vertices[features.on_line]
    assert len(at) > 25
    assert np.abs(at[:, 0] - winding(at[:, 1])).max() < 1.5
    assert (features.bend[features.on_line] > 0.2).all()
    assert not features.on_line[~ground.measured].any()


def test_features_turn_with_the_scan():
    scan = cut(sheet(fold_height))
    turn = Rotation.random(random_state=3).as_matrix()
    moved = replace(scan, vertices=scan.vertices @ turn.T * 40, base=None, normal=None)
    one, other = (find_features(ground_of(s)) for s in (scan, moved))
    measured = len(scan.vertices)
    np.testing.assert_allclose(one.bend[:measured], other.bend[:measured], atol=1e-6)


def test_the_fold_is_joined_across_the_hole(ground):
    (curve,) = joined(find_ends(ground, find_features(ground)), ground.spacing)
    assert np.abs(curve.points[:, 0] - winding(curve.points[:, 1])).max() < 1.2
    assert np.ptp(curve.points[:, 1]) > 2 * RADIUS - 3
    assert curve.bend > 0.2


def test_ends_that_dont_fit_are_left_alone():
    ahead = np.array([1.0, 0, 0])
    left, right = End(np.zeros(3), ahead, 0.5), End(10 * ahead, -ahead, 0.4)
    assert len(joined([left, right], 1.0)) == 1
    # A valley, a much fainter ridge, one that runs away to the side, and none.
    assert joined([left, replace(right, bend=-0.4)], 1.0) == []
    assert joined([left, replace(right, bend=0.05)], 1.0) == []
    assert joined([left, replace(right, way=np.array([0.0, 1, 0]))], 1.0) == []
    assert joined([left], 1.0) == []
    assert joined([], 1.0) == []


def test_ends_are_paired_as_a_whole():
    """Two lines side by side: each goes straight on, although the ends of a pair are not the nearest."""
    ahead, aside = np.array([1.0, 0, 0]), np.array([0, 4.0, 0])
    ends = [End(aside * k, ahead, 0.5) for k in (0, 1)] + [End(aside * k + 12 * ahead, -ahead, 0.5) for k in (1, 0)]
    curves = joined(ends, 1.0)
    assert len(curves) == 2
    for curve in curves:
        assert np.ptp(curve.points[:, 1]) < 1e-9


def test_hermite_leaves_and_arrives_in_the_ends_directions():
    one = End(np.zeros(3), np.array([0.0, 1, 0]), 1.0)
    other = End(np.array([10.0, 0, 0]), np.array([0.0, 1, 0]), 1.0)
    points = hermite(one, other, 0.05)
    np.testing.assert_allclose(points[[0, -1]], [one.at, other.at], atol=1e-12)
    leaving, arriving = points[1] - points[0], points[-1] - points[-2]
    np.testing.assert_allclose(leaving / np.linalg.norm(leaving), one.way, atol=0.03)
    np.testing.assert_allclose(arriving / np.linalg.norm(arriving), -other.way, atol=0.03)


def test_steering_draws_the_filling_onto_the_curve(ground):
    features = find_features(ground)
    curves = joined(find_ends(ground, features), ground.spacing)
    drawn, guidance = steered(ground, curves, features)
    measured = ground.measured
    np.testing.assert_array_equal(drawn.vertices[measured], ground.vertices[measured])
    np.testing.assert_allclose(drawn.vertices[guidance.vertices], guidance.points)
    assert not measured[guidance.vertices].any()
    before, after = (np.abs(g.vertices[~measured, 2] - fold_height(*g.vertices[~measured, :2].T)).mean() for g in (ground, drawn))
    assert after < 0.5 * before
    away = np.abs(ground.vertices[:, 0] - winding(ground.vertices[:, 1]))
    assert guidance.nearness[(away < 1) & ~measured].min() > 0.5
    assert np.abs(guidance.nearness[away > 12]).max() < 0.05


def test_anchors_draw_heights():
    """Two targets in a row between held ends at 0: x = (A + w I)^-1 w h, by hand."""
    first, other = np.array([1, 1, 2, 2]), np.array([0, 2, 1, 3])
    wishes = Wishes(first, other, np.zeros(4), np.ones(4, bool), np.zeros(4), np.zeros(4, bool))
    active = np.array([False, True, True, False])
    found = join(wishes, np.zeros(4), active, 0.0, Anchors(np.array([1]), np.array([3.0]), 2.0))
    # Each inner edge is wished from both of its ends.
    system = np.array([[1 + 2 + 2.0, -2], [-2, 1 + 2]])
    np.testing.assert_allclose(found[1:3], np.linalg.solve(system, [6.0, 0]), atol=1e-6)
    np.testing.assert_array_equal(found[[0, 3]], 0)


def fold_off(whole):
    """Largest distance of the filling's height from that of the true fold, along the fold."""
    filled = whole.vertices[~whole.measured]
    beside = np.abs(filled[:, 0] - winding(filled[:, 1])) < 1
    return float(np.abs(filled[beside, 2] - fold_height(*filled[beside, :2].T)).max())


def test_a_fold_stays_a_fold():
    scan = cut(sheet(fold_height))
    whole = intaglio.complete_relief(scan, "smooth", holes="all", symmetry="none")
    assert any("carried on across the holes" in note for note in whole.notes)
    assert fold_off(whole) < 1.2
    np.testing.assert_array_equal(whole.vertices[whole.measured], scan.vertices)


def test_a_guide_is_followed():
    """Where a line isn't seen to go on, the user's is taken: here a ridge across the whole hole, on a flat sheet with dents."""
    rng = np.random.default_rng(2)
    k, phase = rng.uniform(-1.2, 1.2, (30, 2)), rng.uniform(0, 2 * np.pi, 30)

    def rough(x, y):
        return 0.06 * np.cos(x[..., None] * k[:, 0] + y[..., None] * k[:, 1] + phase).sum(axis=-1)

    scan = cut(sheet(rough))
    y = np.linspace(MIDDLE - 12, MIDDLE + 12, 9)
    arch = 3.0 * np.cos((y - MIDDLE) / 12 * np.pi / 2)
    guide = np.stack([np.full(9, MIDDLE), y, arch], axis=1)
    with_guide, without = (intaglio.complete_relief(scan, "smooth", guides=g) for g in ([guide], "none"))
    assert any("1 line " in note for note in with_guide.notes)
    for whole, low, high in ((with_guide, 1.8, 4.0), (without, -1.5, 1.5)):
        filled = whole.vertices[~whole.measured]
        at = np.linalg.norm(filled[:, :2] - MIDDLE, axis=1) < 2
        assert low < filled[at, 2].mean() < high


def test_guides_replace_and_add(ground):
    features = find_features(ground)
    found = joined(find_ends(ground, features), ground.spacing)
    along = np.stack([winding(np.arange(5.0, 55)), np.arange(5.0, 55), np.zeros(50)], axis=1)
    along[:, 2] = fold_height(along[:, 0], along[:, 1])
    (guided,) = guide_curves([along], ground, features)
    # It carries on the scan's own ridge, and is cut off at the rim.
    assert guided.bend > 0.2
    assert np.hypot(*(guided.points[:, :2] - MIDDLE).T).max() < RADIUS + 1.5
    assert without_guided(found, [guided], ground.spacing) == []
    beside = Curve(guided.points + [12.0, 0, 0], 0.0)
    assert without_guided(found, [beside], ground.spacing) == found
    assert without_guided(found, [], ground.spacing) == found
    assert guide_curves([along + [500.0, 0, 0]], ground, features) == []


def test_a_guide_beside_all_holes_is_said():
    scan = cut(sheet(fold_height))
    whole = intaglio.complete_relief(scan, "smooth", guides=[np.array([[500.0, 0, 0], [510, 0, 0]])])
    assert any("none of them runs across a hole" in note for note in whole.notes)


@pytest.mark.parametrize(
    "guides",
    ["ridge", 3, [[1, 2, 3]], [np.zeros((1, 3))], [np.zeros((4, 2))], [np.ones((3, 3))], [np.full((3, 3), np.nan)], ["a"]],
)
def test_senseless_guides_are_refused(guides):
    with pytest.raises(InputError, match="guide"):
        checked_guides(guides)


def test_guides_go_with_pieces():
    scan = cut(sheet(fold_height))
    with pytest.raises(InputError, match="guides go with method='pieces'"):
        intaglio.complete_relief(scan, "smooth", window=3, guides=[np.eye(3)])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("lines.txt", "# a crease\n0 0 0\n1 0 0.5\n\n2,2,2\n3,3,3\n4,4,4\n"),
        ("lines.obj", "v 0 0 0\nv 1 0 0.5\nv 2 2 2\nv 3 3 3\nv 4 4 4\nl 1 2\nl 3/1 4/2 -1\nf 1 2 3\n"),
    ],
)
def test_guides_are_read(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    one, other = intaglio.read_guides(tmp_path / name)
    np.testing.assert_array_equal(one, [[0, 0, 0], [1, 0, 0.5]])
    np.testing.assert_array_equal(other, [[2, 2, 2], [3, 3, 3], [4, 4, 4]])


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.txt", "hello\n", "three numbers"),
        ("a.txt", "1 2\n3 4\n", "three finite numbers"),
        ("a.txt", "1 2 nan\n", "three finite numbers"),
        ("a.txt", "1 2 3\n", "no polyline"),
        ("a.obj", "v 0 0 0\nl 1 2\n", "names no vertices"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2 1\n", "no polyline"),
    ],
)
def test_files_without_guides_are_refused(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(FileError, match=said):
        intaglio.read_guides(tmp_path / name)
    with pytest.raises(FileError, match="no such file"):
        intaglio.read_guides(tmp_path / "missing.txt")


def test_the_command_reads_guides_and_symmetry(tmp_path, monkeypatch, capsys):
    cut(sheet(fold_height)).write(tmp_path / "scan.ply")
    (tmp_path / "line.txt").write_text("".join(f"{winding(y)} {y} {fold_height(winding(y), y)}\n" for y in np.arange(15.0, 46)))
    smooth = ("complete", tmp_path / "scan.ply", "--base", "smooth", "-o")
    status, _, said = run(monkeypatch, capsys, *smooth, tmp_path / "whole.ply", "--guides", tmp_path / "line.txt")
    assert status == 0
    assert "1 line " in said
    assert fold_off(intaglio.read_surface(tmp_path / "whole.ply")) < 1.2
    for option, value, why in (("--symmetry", "1,2", "symmetry must be"), ("--guides", tmp_path / "no.txt", "no such file")):
        status, _, said = run(monkeypatch, capsys, *smooth, tmp_path / "refused.ply", option, value)
        assert status != 0
        assert why in said
        assert not (tmp_path / "refused.ply").exists()


def test_settings_keep_to_one_method():
    assert ReliefSettings(symmetry="none").method == "pieces"


def test_a_guide_of_unknown_kind_asks_for_no_line(ground):
    """Where a guide carries on no line of the scan, nothing is said of where its relief is to come from."""
    features = find_features(ground)
    y = np.linspace(MIDDLE - 5, MIDDLE + 5, 11)
    alone = Curve(np.stack([np.full(11, MIDDLE + 6), y, np.zeros(11)], axis=1), 0.0)
    _, guidance = steered(ground, [alone], features)
    assert len(guidance.vertices)
    np.testing.assert_array_equal(guidance.nearness, 0)
    (found,) = joined(find_ends(ground, features), ground.spacing)
    _, both = steered(ground, [alone, found], features)
    _, one = steered(ground, [found], features)
    np.testing.assert_allclose(both.nearness[ground.measured], one.nearness[ground.measured])
