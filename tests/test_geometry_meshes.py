"""Meshes of point sets, and shells over surfaces."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from geometry_reference import fibonacci_sphere
from test_geometry_files import sheet

from intaglio import (
    InputError,
    IntaglioWarning,
    PointSet,
    mesh_geometry,
    read_surface,
    wrap_geometry,
)
from intaglio.geometry.shell import read_uv_mesh
from intaglio.scenes.swatches import chain_mail, weave
from intaglio.scenes.weave_on_vase import vase


def test_a_mesh_of_closed_rings_is_watertight_piece_by_piece(tmp_path):
    points, normals, label = chain_mail(2, 3, 0.06)
    made = mesh_geometry(PointSet(points, normals, color=np.full((len(points), 3), 0.25)), 0.03, axis=None)
    solid = trimesh.Trimesh(made.vertices, made.faces, process=False)
    assert solid.is_watertight
    assert solid.body_count == label.max() + 1 == 6
    # A torus of radii 1 and 0.17, six times.
    assert solid.volume == pytest.approx(6 * 2 * np.pi**2 * 0.17**2, rel=0.05)
    assert not made.measured.any()
    np.testing.assert_allclose(made.color, 0.25)
    for suffix in (".ply", ".obj", ".glb"):
        made.write(tmp_path / f"rings{suffix}")
        assert len(read_surface(tmp_path / f"rings{suffix}").faces) == len(made.faces)


def test_a_mesh_cut_by_the_border_is_open_or_closed_as_asked():
    points, normals, _ = weave(4, 0.1)
    inside = ((points[:, :2] > 0.2) & (points[:, :2] < 2.8)).all(axis=1)
    part = PointSet(points[inside], normals[inside])
    for closed in (False, True):
        made = mesh_geometry(part, 0.06, closed=closed)
        solid = trimesh.Trimesh(made.vertices, made.faces, process=False)
        assert solid.is_watertight == closed
    with pytest.raises(InputError, match="grid"):
        mesh_geometry(part, 1e-4)
    with pytest.raises(InputError, match="too few"):
        mesh_geometry(part.part(np.arange(5)))


def test_a_height_field_becomes_an_open_sheet():
    points, normals = sheet()
    made = mesh_geometry(PointSet(points, normals))
    assert np.abs(made.vertices[:, 2] - 0.5 * np.sin(made.vertices[:, 0] / 2) * np.sin(made.vertices[:, 1] / 2)).max() < 0.12
    assert np.ptp(made.vertices[:, 0]) == pytest.approx(29, abs=0.2)
    assert (made.normal[:, 2] > 0).all()


def test_a_shell_over_a_flat_sheet_is_the_texture_itself():
    points, normals = sheet()
    swatch = PointSet(points, normals, source=np.arange(900))
    corners = np.array([[0.0, 0, 5], [29, 0, 5], [29, 29, 5], [0, 29, 5]])
    faces, uv = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    made = wrap_geometry(swatch, corners, faces, uv, size=29, base=0.0)
    wanted = points[made.source] + (0, 0, 5)
    np.testing.assert_allclose(made.points, wanted, atol=1e-5)
    np.testing.assert_allclose(made.normals, normals[made.source], atol=1e-5)
    assert "is 1 on the mesh on average" in made.notes[-1]
    # Stretched twofold along x, normals turn as the surface does.
    wide = wrap_geometry(swatch, corners * (2, 1, 1), faces, uv, size=29, base=0.0, thickness=1.0)
    carried = normals[wide.source] / (2, 1, 1)
    np.testing.assert_allclose(wide.normals, carried / np.linalg.norm(carried, axis=1, keepdims=True), atol=1e-5)


def test_a_shell_over_a_cylinder_follows_it():
    x, y = np.meshgrid(np.linspace(0, 4, 81)[:-1], np.linspace(0, 2, 41), indexing="ij")
    flat = PointSet(np.stack([x, y, 0 * x + 0.1], axis=-1).reshape(-1, 3), np.tile([0.0, 0, 1], (x.size, 1)))
    u, v = np.meshgrid(np.linspace(0, 1, 257), np.linspace(0, 1, 9), indexing="ij")
    place = np.stack([np.cos(2 * np.pi * u), np.sin(2 * np.pi * u), 3 * v], axis=-1).reshape(-1, 3)
    number = np.arange(u.size).reshape(u.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    uv = np.stack([u, v], axis=-1).reshape(-1, 2)
    made = wrap_geometry(flat, place, faces, uv, size=(4, 2), repeat=(3, 2), base=0.0, thickness=2.0)
    assert len(made) == pytest.approx(6 * len(flat), rel=0.06)
    np.testing.assert_allclose(np.linalg.norm(made.points[:, :2], axis=1), 1.2, atol=1e-3)
    outward = made.points[:, :2] / np.linalg.norm(made.points[:, :2], axis=1, keepdims=True)
    assert (made.normals[:, :2] * outward).sum(axis=1).min() > 0.999


def test_bad_shells_are_told(tmp_path):
    points, normals = sheet()
    swatch = PointSet(points, normals)
    vertices, faces, uv = vase(8, 8)
    for settings, message in (
        ({"uv": uv[:4]}, "uv must be"),
        ({"uv": uv * 0}, "no area"),
        ({"uv": uv + 7}, "outside of 0 to 1"),
        ({"uv": uv * np.nan}, "NaN"),
        ({"repeat": (0, 1)}, "repeat must be"),
        ({"repeat": 2}, "repeat must be"),
        ({"thickness": 0}, "thickness must be"),
        ({"axis": 5}, "axis must be"),
        ({"faces": faces * 1.0}, "faces must hold"),
        ({"repeat": (1.5, 1)}, "repeat must be"),
        ({"faces": faces + 1000}, "faces name"),
        ({"normals": np.zeros((3, 3))}, "normals must"),
    ):
        given = {"faces": faces, "uv": uv, **settings}
        with pytest.raises(InputError, match=message):
            wrap_geometry(swatch, vertices, given.pop("faces"), given.pop("uv"), size=29, **given)
    trimesh.creation.box().export(tmp_path / "plain.ply")
    with pytest.raises(InputError, match="texture coordinates"):
        read_uv_mesh(tmp_path / "plain.ply")


def test_a_sphere_of_points_becomes_a_sphere():
    points, spacing = fibonacci_sphere(1500)
    made = mesh_geometry(PointSet(points, points), axis=None)
    np.testing.assert_allclose(np.linalg.norm(made.vertices, axis=1), 1, atol=0.1 * spacing)
    assert made.notes[-1].endswith("closed")
    for cell in (spacing, 0.5 * spacing, 0.15 * spacing):
        made = mesh_geometry(PointSet(points, points), cell, axis=None)
        solid = trimesh.Trimesh(made.vertices, made.faces, process=False)
        assert solid.is_watertight
        # Counter-clockwise from outside: the volume is positive.
        assert solid.volume == pytest.approx(4 / 3 * np.pi, rel=0.02)
    with pytest.warns(IntaglioWarning, match="thinner than a cell"):
        mesh_geometry(PointSet(points, points), 3 * spacing, axis=None)
