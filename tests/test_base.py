"""Base shapes and their fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import intaglio
from intaglio.mesh.base import Cylinder, Plane, Sphere, face_the_scan, perpendicular

RNG = np.random.default_rng(11)


def cylinder_points(radius=2.5, height=6.0, arc=2.0, count=900, shift=(1e5, -2e5, 40.0)):
    angle, z = RNG.uniform(0, arc, count), RNG.uniform(0, height, count)
    axis = np.array([1.0, 2.0, 2.0]) / 3
    e1 = perpendicular(axis)
    e2 = np.cross(axis, e1)
    radial = np.cos(angle)[:, None] * e1 + np.sin(angle)[:, None] * e2
    return radius * radial + z[:, None] * axis + np.array(shift), axis, radial


def sphere_points(radius=10.0, half_angle=60, count=900, center=(3e5, 1.0, -7.0)):
    z = RNG.uniform(np.cos(np.radians(half_angle)), 1, count)
    phi = RNG.uniform(0, 2 * np.pi, count)
    outward = np.stack([np.sqrt(1 - z**2) * np.cos(phi), np.sqrt(1 - z**2) * np.sin(phi), z], axis=1)
    return radius * outward + np.array(center), outward


def test_a_cylinder_is_found_exactly():
    points, axis, _ = cylinder_points()
    base = intaglio.fit_base(points)
    assert isinstance(base, Cylinder)
    assert base.radius == pytest.approx(2.5, rel=1e-6)
    assert abs(base.axis @ axis) == pytest.approx(1, abs=1e-9)
    assert base.fit.rms < 1e-6
    assert not base.fit.ambiguous


def test_a_sphere_is_found_exactly():
    points, _ = sphere_points()
    base = intaglio.fit_base(points)
    assert isinstance(base, Sphere)
    assert base.radius == pytest.approx(10, rel=1e-6)
    np.testing.assert_allclose(base.center, (3e5, 1, -7), atol=1e-5)


def test_a_plane_is_found_exactly():
    uv = RNG.uniform(-5, 5, (400, 2))
    normal = np.array([1.0, 1.0, 1.0]) / np.sqrt(3)
    u = perpendicular(normal)
    points = uv[:, :1] * u + uv[:, 1:] * np.cross(normal, u) + 100.0
    base = intaglio.fit_base(points, ("plane",))
    assert isinstance(base, Plane)
    assert abs(base.normal @ normal) == pytest.approx(1, abs=1e-12)


def test_the_fit_is_geometric():
    """On a small arc the algebraic circle fit shrinks; orthogonal distances do not."""
    points, _, radial = cylinder_points(arc=1.0, count=4000)
    noisy = points + RNG.normal(0, 0.02, (4000, 1)) * radial
    assert intaglio.fit_base(noisy, ("cylinder",)).radius == pytest.approx(2.5, rel=0.02)


@pytest.mark.parametrize("side", [1, -1])
def test_relief_on_one_side_pulls_little(side):
    points, outward = sphere_points(count=4000)
    bump = np.where(RNG.uniform(size=4000) < 0.2, 0.5 * side, 0.0) + RNG.normal(0, 0.01, 4000)
    relief = points + bump[:, None] * outward
    fitted = intaglio.fit_base(relief, ("sphere",)).radius
    squares = np.linalg.lstsq(
        np.column_stack([2 * (relief - relief.mean(0)), np.ones(4000)]),
        ((relief - relief.mean(0)) ** 2).sum(axis=1), rcond=None,
    )[0]  # fmt: skip
    plain = np.sqrt(squares[3] + squares[:3] @ squares[:3])
    assert abs(fitted - 10) < 0.25 * abs(plain - 10)
    assert abs(fitted - 10) < 0.05


def test_a_nearly_flat_piece_of_a_large_sphere_is_reported_as_ambiguous():
    points, outward = sphere_points(radius=1000.0, half_angle=0.6, count=2000)
    rough = points + RNG.normal(0, 0.2, (2000, 1)) * outward
    base = intaglio.fit_base(rough)
    assert base.fit.ambiguous
    assert "does not decide" in base.fit.note
    assert set(base.fit.candidates) >= {"plane", "sphere"}


def test_units_scale_with_the_data():
    points, _ = sphere_points()
    assert intaglio.fit_base(points * 1000, ("sphere",)).radius == pytest.approx(1e4, rel=1e-6)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 3)), "too few"),
        (np.zeros((50, 3)), "one place"),
        (np.linspace(0, 1, 50)[:, None] * [[1.0, 2.0, 3.0]], "on a line"),
        (np.ones((5, 2)), "shape"),
        (np.full((50, 3), np.nan), "not finite"),
    ],
)
def test_bad_points(points, message):
    with pytest.raises(intaglio.IntaglioError, match=message):
        intaglio.fit_base(points)


def test_unknown_kind():
    with pytest.raises(intaglio.InputError, match="cone"):
        intaglio.fit_base(RNG.normal(size=(50, 3)), ("cone",))


@pytest.mark.parametrize(
    "base",
    [
        Plane(point=np.array([1.0, 2, 3]), normal=np.array([0.0, 1, 1])),
        Cylinder(point=np.array([1.0, 2, 3]), axis=np.array([1.0, 1, 0]), radius=2.0),
        Sphere(center=np.array([1.0, 2, 3]), radius=2.0),
    ],
)
@pytest.mark.parametrize("inward", [False, True])
def test_foot_distance_and_normal_agree(base, inward):
    base = replace(base, inward=inward)
    points = RNG.normal(size=(200, 3)) * 3
    foot, normal = base.foot(points)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(points, foot + base.distance(points)[:, None] * normal, atol=1e-9)
    np.testing.assert_allclose(base.distance(foot), 0, atol=1e-9)


@pytest.mark.parametrize("inward", [False, True])
def test_charts_invert(inward):
    uv = RNG.uniform(-2, 2, (50, 2))
    for base in (
        Plane(point=np.ones(3), normal=np.array([1.0, 2, 3]), inward=inward),
        Cylinder(point=np.ones(3), axis=np.array([1.0, 2, 3]), radius=4.0, inward=inward),
    ):
        np.testing.assert_allclose(base.chart(base.from_chart(uv)), uv, atol=1e-12)
    with pytest.raises(intaglio.InputError, match="unrolled"):
        Sphere(center=np.zeros(3), radius=1.0).chart(uv)


def test_the_inside_of_a_bowl_faces_inwards():
    points, _outward = sphere_points(center=(0, 0, 0), count=300)
    from scipy.spatial import Delaunay

    faces = Delaunay(points[:, :2]).simplices
    a, b, c = (points[faces[:, i]] for i in range(3))
    down = np.cross(b - a, c - a)[:, 2] < 0
    faces[down] = faces[down][:, ::-1]
    base = Sphere(center=np.zeros(3), radius=10.0)
    assert not face_the_scan(base, points, faces).inward
    assert face_the_scan(base, points, faces[:, ::-1]).inward


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan, "wide", None])
def test_a_radius_is_positive(radius):
    with pytest.raises(intaglio.InputError, match="radius"):
        Sphere(center=np.zeros(3), radius=radius)
