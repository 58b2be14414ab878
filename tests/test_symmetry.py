"""Holes filled from their like: registration, copies, provenance, what is refused, and the options."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import intaglio
from intaglio import InputError, ReliefSettings, Surface
from intaglio.mesh import grid_faces, vertex_normals
from intaglio.relief.ground import GroundOptions, prepare_ground
from intaglio.relief.symmetry import given_poses
from intaglio.relief.symmetry.copies import lay_copy, unlikeness
from intaglio.relief.symmetry.poses import Pose
from intaglio.relief.symmetry.registration import Register
from tests.test_filling_texture import png
from tests.test_filling_texture import texels as texels_of

WIDTH, DEPTH = 84, 40
# The middles of a carving and of its like, and how wide the hole in the first is.
HERE, THERE, RADIUS = np.array([20.0, 20.0]), np.array([62.0, 20.0]), 7.5


def carving(x, y):
    """An uneven carving around the origin, some 12 units wide."""
    r = np.hypot(x, y)
    return 2.2 * np.exp(-((r / 9) ** 2)) * (np.sin(0.7 * x + 0.3) + np.cos(0.55 * y + 0.2 * x) + 0.04 * x * y / (1 + 0.1 * r))


def sheet(height, seed=0, jitter=0.2):
    """A sheet of heights over a lattice of unit steps, shaken."""
    x, y = np.meshgrid(np.arange(float(WIDTH)), np.arange(float(DEPTH)))
    move = np.random.default_rng(seed).uniform(-jitter, jitter, (2, DEPTH, WIDTH))
    x, y = x + move[0], y + move[1]
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)
    return Surface(vertices=vertices, faces=grid_faces(DEPTH, WIDTH)[:, ::-1])


def pair(mirror=False):
    """Heights with the carving here, and moved or mirrored there."""
    sign = -1.0 if mirror else 1.0
    return lambda x, y: carving(x - HERE[0], y - HERE[1]) + carving(sign * (x - THERE[0]), y - THERE[1])


def cut(surface, center=HERE, radius=RADIUS):
    return surface.part(np.hypot(*(surface.vertices[:, :2] - center).T) >= radius)


def off(whole, height):
    """Root mean square distance along z of what was filled from the truth."""
    filled = whole.vertices[~whole.measured]
    return float(np.sqrt(((filled[:, 2] - height(filled[:, 0], filled[:, 1])) ** 2).mean()))


def moved(surface, seed=5):
    """The surface turned and moved, as scanners deliver it."""
    turn = Rotation.random(random_state=seed).as_matrix()
    return replace(surface, vertices=surface.vertices @ turn.T + [3.0, -7.0, 11.0], base=None, normal=None), turn


@pytest.mark.parametrize("mirror", [False, True])
def test_registration_finds_the_like(mirror):
    scan = cut(sheet(pair(mirror)))
    away = np.hypot(*(scan.vertices[:, :2] - HERE).T)
    around = np.flatnonzero(away < 1.9 * RADIUS)
    inside = np.random.default_rng(1).uniform(-0.6 * RADIUS, 0.6 * RADIUS, (50, 2)) + HERE
    missing = np.column_stack([inside, pair(mirror)(*inside.T)])
    best = Register(scan.vertices, vertex_normals(scan.vertices, scan.faces)).find(around, missing, RADIUS)[0]
    assert best.pose.mirrors == mirror
    there = (inside - HERE) * [-1 if mirror else 1, 1] + THERE
    assert np.abs(best.pose.apply(missing)[:, :2] - there).max() < 0.3
    assert best.residual < 0.1


def test_registration_refuses_what_leads_nowhere():
    scan = cut(sheet(lambda x, y: carving(x - HERE[0], y - HERE[1])))
    around = np.flatnonzero(np.hypot(*(scan.vertices[:, :2] - HERE).T) < 1.9 * RADIUS)
    register = Register(scan.vertices, scan.normal)
    missing = np.column_stack([np.full((3, 2), HERE), np.zeros(3)])
    # Beyond the sheet, and back onto the hole.
    for shift in ([500.0, 0, 0], [0.5, 0, 0]):
        assert register.settle([Pose(np.eye(3), np.array(shift))], around, missing, RADIUS) == []


def test_copies_lie_on_the_moved_scan():
    ripples = lambda x, y: 0.8 * np.sin(0.6 * x) * np.cos(0.5 * y)  # noqa: E731
    scan = cut(sheet(ripples, jitter=0.0))
    ground = prepare_ground(scan, "plane", GroundOptions(extent="holes"))
    pose = Pose(np.eye(3), np.array([2 * np.pi / 0.6 * 4, 0.0, 0.0]))
    wanted = ~ground.measured
    copy = lay_copy(ground, pose, wanted, scan.vertices, scan.faces, "cpu")
    assert copy.reached[wanted].all()
    assert not copy.reached[~wanted].any()
    at = ground.foot + copy.height[:, None] * ground.normal
    # Facets of unit steps leave this much of the waves.
    assert np.abs(at[wanted, 2] - ripples(at[wanted, 0], at[wanted, 1])).max() < 0.06
    nearest = np.linalg.norm(pose.apply(at[wanted])[:, None] - scan.vertices[None], axis=2).min(axis=1)
    chosen = np.linalg.norm(pose.apply(at[wanted]) - scan.vertices[copy.source[wanted]], axis=1)
    assert (chosen <= nearest + 0.3).all()


def test_unlikeness_knows_a_copy_from_chance():
    height = lambda x, y: np.sin(0.9 * x) * np.sin(0.8 * y)  # noqa: E731
    scan = cut(sheet(height, jitter=0.0))
    ground = prepare_ground(scan, "plane", GroundOptions(extent="holes"))
    around = ground.measured & (np.hypot(*(ground.vertices[:, :2] - HERE).T) < 1.9 * RADIUS)
    true, chance = (
        lay_copy(ground, Pose(np.eye(3), np.array([shift, 0.0, 0.0])), around, scan.vertices, scan.faces, "cpu")
        for shift in (2 * np.pi / 0.9 * 5, 2 * np.pi / 0.9 * 4.75)
    )
    assert unlikeness(ground, true, around, RADIUS) < 0.1
    # A quarter of a wave off: nothing in common, so the squares add up.
    assert unlikeness(ground, chance, around, RADIUS) == pytest.approx(np.sqrt(2), abs=0.15)


@pytest.mark.parametrize("mirror", [False, True])
def test_a_carving_is_filled_from_its_like(mirror):
    height = pair(mirror)
    truth = sheet(height)
    scan, turn = moved(cut(truth))
    whole = intaglio.complete_relief(scan, "smooth")
    assert any("a place that is alike" in note for note in whole.notes)
    back = replace(whole, vertices=(whole.vertices - [3.0, -7.0, 11.0]) @ turn, base=None, normal=None)
    assert off(back, height) < 0.12
    by_pieces = intaglio.complete_relief(scan, "smooth", symmetry="none")
    assert not any("a place that is alike" in note for note in by_pieces.notes)
    filled = ~whole.measured
    assert np.array_equal(whole.vertices[whole.measured], scan.vertices)
    # Sources lie where the like of the filled place is.
    source = back.vertices[whole.source[filled]]
    there = (back.vertices[filled, :2] - HERE) * [-1 if mirror else 1, 1] + THERE
    assert np.abs(source[:, :2] - there).max() < 1.5
    assert whole.measured[whole.source[filled]].all()
    assert (whole.mirrored is not None and whole.mirrored[filled].all()) if mirror else whole.mirrored is None


def test_the_same_bits_again():
    scan = cut(sheet(pair()))
    first, second = (intaglio.complete_relief(scan, "smooth", seed=s) for s in (0, 7))
    # Nothing in it is drawn at random.
    assert np.array_equal(first.vertices, second.vertices)
    assert np.array_equal(first.source, second.source)


def test_all_of_the_scan_gives_the_same_like():
    """A like is looked for everywhere anyhow; only the ground that is worked on is larger, and cut to the hole's surroundings."""
    scan = cut(sheet(pair()))
    near, everything = (intaglio.complete_relief(scan, "smooth", exemplar=e) for e in ("near", "all"))
    for whole in (near, everything):
        assert any("a place that is alike" in note for note in whole.notes)
        assert off(whole, pair()) < 0.12


def test_chance_is_no_likeness():
    rng = np.random.default_rng(4)
    k = rng.uniform(-0.9, 0.9, (40, 2))
    phase = rng.uniform(0, 2 * np.pi, 40)
    rough = lambda x, y: 0.25 * np.cos(x[..., None] * k[:, 0] + y[..., None] * k[:, 1] + phase).sum(axis=-1)  # noqa: E731
    whole = intaglio.complete_relief(cut(sheet(rough)), "smooth")
    assert any("by pieces" in note for note in whole.notes)


def test_given_planes_and_axes():
    (mirror,) = given_poses(np.array([0.0, 2.0, 0.0, 6.0]))
    assert mirror.mirrors
    assert np.allclose(mirror.apply(np.array([[1.0, 1.0, 5.0]])), [[1, 5, 5]])
    turns = given_poses(np.array([1.0, 0, 0, 0, 0, 3.0, 4]))
    assert len(turns) == 3
    assert np.allclose(turns[0].apply(np.array([[2.0, 0, 7]])), [[1, 1, 7]])
    assert np.allclose(turns[0].inverse().apply(turns[0].apply(np.eye(3))), np.eye(3))


def test_a_given_plane_is_used_and_refined():
    height = pair(mirror=True)
    scan = cut(sheet(height))
    middle = (HERE[0] + THERE[0]) / 2
    # Half a unit beside the true plane.
    whole = intaglio.complete_relief(scan, "smooth", symmetry=(1.0, 0.0, 0.0, middle + 0.5))
    assert off(whole, height) < 0.12
    assert whole.mirrored[~whole.measured].all()


def test_a_plane_that_leads_nowhere_is_said():
    scan = cut(sheet(pair()))
    whole = intaglio.complete_relief(scan, "smooth", symmetry=(1.0, 0.0, 0.0, 900.0))
    assert any("lead to no measured surface" in note for note in whole.notes)
    assert any("by pieces" in note for note in whole.notes)


@pytest.mark.parametrize(
    "symmetry", ["mirror", (1, 2), (0, 0, 0, 1), (0, 0, 0, 0, 0, 1, 1), (0, 0, 0, 0, 0, 1, 2.5), (np.nan, 0, 0, 1), 3, [None] * 4]
)
def test_senseless_symmetries_are_refused(symmetry):
    with pytest.raises(InputError, match="symmetry must be"):
        ReliefSettings(symmetry=symmetry)


def test_symmetry_excludes_what_contradicts_it():
    scan = cut(sheet(pair()))
    with pytest.raises(InputError, match="symmetry goes with method='pieces'"):
        ReliefSettings(method="propagation", symmetry="none")
    with pytest.raises(InputError, match="symmetry and exemplar"):
        intaglio.complete_relief(scan, "smooth", symmetry=(1, 0, 0, 40.0), exemplar=(60.0, 20.0, 0.0, 10.0))
    assert ReliefSettings(symmetry=[1, 0, 0, 2]).symmetry == (1.0, 0.0, 0.0, 2.0)


def test_an_exemplar_is_kept_to():
    scan = cut(sheet(pair()))
    ball = (*HERE, 0.0, 1.8 * RADIUS)
    whole = intaglio.complete_relief(scan, "smooth", exemplar=ball)
    used = scan.vertices[whole.source[~whole.measured]]
    assert (np.linalg.norm(used - ball[:3], axis=1) <= ball[3]).all()


def test_colour_and_mirror_come_along(tmp_path):
    scan = cut(sheet(pair(mirror=True)))
    color = np.random.default_rng(0).uniform(0, 1, (len(scan.vertices), 3)).astype(np.float32)
    whole = intaglio.complete_relief(replace(scan, color=color), "smooth")
    filled = ~whole.measured
    assert np.array_equal(whole.color[filled], whole.color[whole.source[filled]])
    intaglio.write_surface(whole, tmp_path / "whole.ply")
    again = intaglio.read_surface(tmp_path / "whole.ply")
    assert np.array_equal(again.mirrored, whole.mirrored)
    assert again.mirrored.dtype == bool
    with pytest.raises(InputError, match="mirrored"):
        replace(whole, mirrored=np.ones(3, bool))
    with pytest.raises(InputError, match="mirrored must be bool"):
        replace(whole, mirrored=np.ones(len(whole.vertices)))


@pytest.mark.parametrize("mirror", [False, True])
def test_texture_comes_from_the_same_place(mirror):
    """Stripes askew around both carvings, mirrored as they are: where frames or the mirror were wrong, they would run across."""
    scan = cut(sheet(pair(mirror)))
    sign = -1.0 if mirror else 1.0

    def stripes(x, y):
        own = np.where(x < (HERE[0] + THERE[0]) / 2, x - HERE[0], sign * (x - THERE[0]))
        return 0.5 + 0.4 * np.sin(0.9 * own + 0.7 * (y - HERE[1]))

    texels = 6
    y, x = np.mgrid[: DEPTH * texels, : WIDTH * texels] + 0.5
    values = stripes(x / texels - 0.5, y / texels - 0.5)
    picture = png(np.repeat(np.uint8(np.round(255 * values))[:, :, None], 3, axis=2))
    uv = (scan.vertices[scan.faces][:, :, :2] + 0.5) / [WIDTH, DEPTH]
    whole = intaglio.complete_relief(replace(scan, uv=np.stack([uv[..., 0], 1 - uv[..., 1]], axis=-1), picture=picture), "smooth")
    found, points = texels_of(whole)
    assert len(found) > 1000
    # Sources are rounded to vertices, which shifts stripes by up to half a unit; other stripes would be 0.4 off.
    assert np.sqrt(((found[:, 0] - stripes(points[:, 0], points[:, 1])) ** 2).mean()) < 0.12


def test_a_hole_of_a_few_targets_has_a_size():
    """A plane that is given is tried for the smallest hole as well: its rim says how large it is."""
    height = pair(mirror=True)
    truth = sheet(height, jitter=0.0)
    scan = truth.part((np.abs(truth.vertices[:, :2] - HERE) >= 0.5).any(axis=1))
    whole = intaglio.complete_relief(scan, "smooth", symmetry=(1.0, 0.0, 0.0, (HERE[0] + THERE[0]) / 2))
    filled = whole.vertices[~whole.measured]
    assert 0 < len(filled) < 6
    assert np.abs(filled[:, 2] - height(*filled[:, :2].T)).max() < 0.3
    assert whole.mirrored[~whole.measured].all()


def test_progress_goes_over_holes_of_both_kinds():
    scan = sheet(pair())
    for center, radius in ((HERE, RADIUS), ((42.0, 33.0), 3.0)):
        scan = cut(scan, np.asarray(center), radius)
    seen = []
    whole = intaglio.complete_relief(scan, "smooth", progress=lambda done, total: seen.append(done / total))
    assert any("a place that is alike" in note for note in whole.notes)
    assert any("by pieces" in note for note in whole.notes)
    assert seen == sorted(seen)
    assert seen[-1] == 1
