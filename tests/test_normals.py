"""Normals of points without: towards the scanner, out of closed clouds; and normals that were turned wrongly."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from geometry_reference import fibonacci_sphere
from test_geometry_parts import chain_mail
from test_point_files import turned, write_e57

from intaglio import geometry_from_points, read_geometry_texture, read_surface
from intaglio.geometry.normals import estimate_normals, mend_sides, normals_facing
from intaglio.geometry.sampling import local_spacing


def sampled(mesh, count, seed=0):
    """Points spread over a mesh, with the normals of its faces."""
    points, face = trimesh.sample.sample_surface_even(mesh, count, seed=seed)
    return np.asarray(points), np.asarray(mesh.face_normals[face])


def ball(count=4000, radius=1.0):
    points, _ = fibonacci_sphere(count)
    points = points / np.linalg.norm(points, axis=1, keepdims=True)
    return radius * points, points.copy()


def shell():
    """A hollow ball: its inner wall faces the cavity."""
    (outer, out), (inner, inwards) = ball(4000), ball(2500, 0.8)
    return np.concatenate([outer, inner]), np.concatenate([out, -inwards])


def two_balls():
    points, normals = ball(3000)
    return np.concatenate([points, points + (2.2, 0, 0)]), np.concatenate([normals, normals])


def torus(noise=0.0):
    points, normals = sampled(trimesh.creation.torus(1, 0.35, major_sections=96, minor_sections=48), 6000)
    return points + noise * np.random.default_rng(0).normal(size=points.shape), normals


def plate():
    return sampled(trimesh.creation.box((1, 1, 0.06)), 6000)


def cup():
    """A cup with a wall of two distances of samples."""
    turn = np.linspace(0, np.pi / 2, 20)
    outer = np.column_stack([0.8 * np.sin(turn), 0.8 - 0.8 * np.cos(turn)])
    inner = np.column_stack([0.74 * np.sin(turn), 0.8 - 0.74 * np.cos(turn)])
    mesh = trimesh.creation.revolve(np.concatenate([outer, [[0.8, 1.6], [0.74, 1.6]], inner[::-1]]), sections=96)
    if mesh.volume < 0:
        mesh.invert()
    return sampled(mesh, 12000)


def folded():
    """An open sheet in three layers, like an S; its normals are of one side, either one."""
    rng = np.random.default_rng(0)
    along, across = rng.random(6000) * (12 + 0.8 * np.pi), rng.random(6000) * 4
    bend = 0.4 * np.pi
    ends = [4, 4 + bend, 8 + bend, 8 + 2 * bend]
    part = np.searchsorted(ends, along)
    first, second = (along - 4) / 0.4, (along - 8 - bend) / 0.4
    zero, one = 0 * along, 1 + 0 * along
    x = np.choose(part, [along, 4 + 0.4 * np.sin(first), 8 + bend - along, -0.4 * np.sin(second), along - ends[3]])
    z = np.choose(part, [zero, 0.4 - 0.4 * np.cos(first), 0.8 * one, 1.2 - 0.4 * np.cos(second), 1.6 * one])
    u = np.choose(part, [zero, -np.sin(first), zero, -np.sin(second), zero])
    w = np.choose(part, [one, np.cos(first), -one, -np.cos(second), one])
    return np.column_stack([x, across, z]), np.column_stack([u, zero, w])


def estimated(points):
    return estimate_normals(points, int(np.argmin(np.ptp(points, axis=0))), float(np.median(local_spacing(points))))


def right(found, normals):
    return ((found * normals).sum(axis=1) > 0).mean()


@pytest.mark.parametrize(
    ("made", "share"),
    [
        (ball, 1),
        (shell, 1),
        (two_balls, 1),
        (torus, 1),
        (lambda: torus(0.01), 0.999),
        (plate, 0.999),
        (cup, 0.985),
        (lambda: chain_mail(3, 4, 0.1)[:2], 0.99),
    ],
)
def test_normals_of_closed_clouds_point_out_of_the_solid(made, share):
    points, normals = made()
    found, note = estimated(points)
    assert right(found, normals) >= share
    assert "out of the solid" in note
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1)


@pytest.mark.parametrize("made", [folded, lambda: [value[ball()[0][:, 2] > 0.3] for value in ball()]])
def test_normals_of_open_clouds_are_of_one_side(made):
    points, normals = made()
    share = right(estimated(points)[0], normals)
    assert max(share, 1 - share) > 0.999


@pytest.mark.parametrize("name", ["odedstein_lionstatue", "nikolov_birdBath", "bunny_range_scans/bun_zipper.ply"])
def test_normals_of_real_statues_point_outwards(real, name):
    path = real(f"meshes/{name}")
    path = path if path.is_file() else next(p for p in sorted(path.rglob("*")) if p.suffix in (".ply", ".obj", ".stl"))
    surface = read_surface(path)
    points, normals = sampled(trimesh.Trimesh(surface.vertices, surface.faces, process=False), 8000)
    found, _ = estimated(points)
    assert right(found, normals) > 0.99


def test_normals_face_the_scanner_where_its_place_is_known():
    points, normals = sampled(trimesh.creation.torus(1, 0.35), 6000)
    places = np.array([[0, 0, 9.0], [0, 0, -9.0]])
    stood = places[(normals[:, 2] < 0).astype(int)]
    # Where a surface is seen along it, its side is anyone's guess.
    assert right(normals_facing(points, stood), normals) > 0.99
    # As the scanner stood inside, so do normals face the inside.
    inside, out = ball()
    assert right(normals_facing(inside, np.zeros((4000, 3))), out) == 0


def test_swatches_of_e57_scans_have_normals_towards_their_scanners(tmp_path):
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.random((900, 2)) * 3, np.zeros(900)])
    matrix, quaternion = turned((1, 0, 0), np.pi)
    for above in (5.0, -5.0):
        stood = np.array([500_000.0, 0, above])
        local = (flat + (500_000, 0, 0) - stood) @ matrix
        write_e57(tmp_path / "a.e57", [(local, quaternion, stood, {})])
        found = read_geometry_texture(tmp_path / "a.e57", axis="z", spacing=0.15)
        assert any("turned to where the scanner stood" in n for n in found.notes)
        assert (np.sign(found.points.normals[:, 2]) == np.sign(above)).all()


FLIPS = {
    "half": lambda p: np.random.default_rng(1).random(len(p)) < 0.5,
    "third": lambda p: np.random.default_rng(1).random(len(p)) < 0.3,
    "one side": lambda p: p[:, 0] > np.quantile(p[:, 0], 0.6),
    "few": lambda p: np.random.default_rng(1).random(len(p)) < 0.02,
}


@pytest.mark.parametrize("flips", FLIPS)
@pytest.mark.parametrize("made", [ball, torus, plate, shell])
def test_normals_that_face_the_wrong_side_are_turned(made, flips):
    points, normals = made()
    wrong = FLIPS[flips](points)
    axis, spacing = int(np.argmin(np.ptp(points, axis=0))), float(np.median(local_spacing(points)))
    found, note = mend_sides(points, np.where(wrong[:, None], -normals, normals), axis, spacing)
    assert right(found, normals) > 0.99
    assert "were turned" in note
    # Directions stay, to the bit.
    np.testing.assert_array_equal(np.abs(found), np.abs(normals))
    again, note = mend_sides(points, normals, axis, spacing)
    assert note is None
    assert again is normals


@pytest.mark.parametrize("thickness", [0.05, 0.2, 0.5, 1.0, 2.0])
def test_the_two_sides_of_a_thin_sheet_are_no_mistake(thickness):
    rng = np.random.default_rng(2)
    upper = np.column_stack([rng.random((3000, 2)) * 55, np.zeros(3000)])
    lower = np.column_stack([rng.random((3000, 2)) * 55, np.full(3000, -thickness)])
    normals = np.repeat([[0, 0, 1.0], [0, 0, -1.0]], 3000, axis=0)
    found, note = mend_sides(np.concatenate([upper, lower]), normals, 2, 1.0)
    assert note is None
    assert found is normals


def test_a_swatch_says_that_normals_were_turned():
    x, y = np.meshgrid(np.arange(30.0), np.arange(30.0))
    points = np.column_stack([x.ravel(), y.ravel(), np.sin(x.ravel() / 3)])
    normals = np.column_stack([-np.cos(x.ravel() / 3) / 3, np.zeros(900), np.ones(900)])
    normals[::2] *= -1
    found = geometry_from_points(points, normals)
    assert any("450 of 900 normals" in note for note in found.notes)
    assert (found.points.normals[:, 2] > 0).all()
