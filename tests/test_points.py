"""Point-set surfaces and their fields: exact facts, and a float64 reference."""

from __future__ import annotations

import geometry_reference as reference
import numpy as np
import pytest

from intaglio.kernels.distance_fields import Overlaps, PatchSearch, candidates, signed_distance
from intaglio.kernels.launch import set_threads
from intaglio.kernels.point_surface import PointSurface
from intaglio.kernels.relaxation import gaps, repel_points


def sheet(side=30, height=0.0):
    x, y = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.full(side * side, height)], axis=1)
    return points, np.tile([0.0, 0.0, 1.0], (side * side, 1))


@pytest.mark.parametrize(("hermite", "most"), [(False, 1.0), (True, 1e-2)])
def test_points_of_a_sphere_project_onto_the_sphere(hermite, most, device):
    points, spacing = reference.fibonacci_sphere(8000)
    surface = PointSurface(points, points, 3 * spacing, hermite=hermite, device=device)
    rng = np.random.default_rng(0)
    direction = points[rng.integers(0, 8000, 3000)] + rng.normal(0, spacing / 3, (3000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    at = direction * rng.uniform(0.85, 1.2, (3000, 1))
    feet = surface.project(at, reach=0.5)
    assert feet.found.all()
    # Averages lie inside by the mean of d²/2: within the square of the distance of samples, and far less once corrected.
    assert np.abs(np.linalg.norm(feet.points, axis=1) - 1).max() < most * spacing**2
    radial = feet.points / np.linalg.norm(feet.points, axis=1, keepdims=True)
    assert np.degrees(np.arcsin(np.linalg.norm(np.cross(feet.normals, radial), axis=1))).max() < 0.2
    # Quasi-orthogonal: the foot is the point straight below to a small part of the distance of samples.
    assert np.linalg.norm(feet.points - direction, axis=1).max() < 0.05 * spacing


def test_projection_agrees_with_the_reference(device):
    rng = np.random.default_rng(1)
    points, spacing = reference.fibonacci_sphere(1500)
    points = points * (1.0, 0.7, 0.5)
    normals = points / np.array([1.0, 0.7, 0.5]) ** 2
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    at = points[rng.integers(0, 1500, 60)] + rng.normal(0, 0.06, (60, 3))
    for hermite in (False, True):
        surface = PointSurface(points, normals, 3 * spacing, hermite=hermite, device=device)
        feet = surface.project(at, reach=1.0)
        for x, foot, normal in zip(at, feet.points, feet.normals, strict=True):
            wanted, wanted_normal = reference.project(points, normals, x, np.zeros(3), 3 * spacing, hermite)
            # Iterations end when they move by less than a thousandth of the support.
            assert np.linalg.norm(foot - wanted) < 2e-3 * 3 * spacing
            assert np.linalg.norm(normal - wanted_normal) < 5e-3


def test_a_line_meets_the_bottom_of_a_valley_where_projection_falls_on_its_sides(device):
    x, y = np.meshgrid(np.linspace(-2, 2, 161), np.linspace(-2, 2, 161), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.abs(x).ravel() * 2], axis=1)
    normals = np.stack([-2 * np.sign(x).ravel(), np.zeros(x.size), np.ones(x.size)], axis=1)
    normals[x.ravel() == 0] = (0, 0, 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    surface = PointSurface(points, normals, 0.1, device=device)
    at, up = np.array([[0.02, 0.0, 0.3]]), np.array([[0.0, 0.0, 1.0]])
    met = surface.project(at, facing=up, reach=0.5, along=True)
    dropped = surface.project(at, facing=up, reach=0.5)
    assert met.points[0, 0] == pytest.approx(0.02, abs=1e-5)
    assert met.points[0, 2] == pytest.approx(0.04, abs=0.05)
    assert dropped.points[0, 2] > met.points[0, 2] + 0.03


def test_the_line_takes_the_nearer_of_two_surfaces(device):
    low, up = sheet(20)
    high, _ = sheet(20, 6.0)
    surface = PointSurface(np.concatenate([low, high]), np.concatenate([up, up]), 2.5, device=device)
    at = np.array([[9.3, 9.7, 1.2], [9.3, 9.7, 4.5], [9.3, 9.7, 3.0 + 1e-3]])
    feet = surface.project(at, facing=np.tile([0.0, 0.0, 1.0], (3, 1)), reach=8.0, along=True)
    np.testing.assert_allclose(feet.points, [[9.3, 9.7, 0], [9.3, 9.7, 6], [9.3, 9.7, 6]], atol=1e-4)


def test_surfaces_that_face_away_are_not_seen(device):
    low, up = sheet(20)
    high, _ = sheet(20, 0.5)
    surface = PointSurface(np.concatenate([low, high]), np.concatenate([-up, up]), 2.5, device=device)
    at = np.array([[9.5, 9.5, 0.45], [9.5, 9.5, 0.45]])
    feet = surface.project(at, facing=np.array([[0.0, 0, 1], [0, 0, -1]]), reach=3.0)
    np.testing.assert_allclose(feet.points[:, 2], [0.5, 0.0], atol=1e-5)


def test_groups_do_not_see_each_other_and_far_positions_find_nothing(device):
    low, up = sheet(20)
    high, _ = sheet(20, 1.0)
    group = np.repeat([0, 1], 400)
    surface = PointSurface(np.concatenate([low, high]), np.concatenate([up, up]), 2.5, group=group, device=device)
    at = np.tile([[9.0, 9.0, 0.4]], (3, 1))
    feet = surface.project(at, group=np.array([0, 1, 2]), reach=5.0)
    np.testing.assert_allclose(feet.points[:2, 2], [0.0, 1.0], atol=1e-5)
    assert feet.found.tolist() == [True, True, False]
    assert not surface.project(np.array([[9.0, 9, 99]]), reach=5.0).found[0]
    empty = PointSurface(np.zeros((0, 3)), np.zeros((0, 3)), 1.0, device=device)
    assert not empty.project(at, reach=1.0).found.any()
    assert (empty.nearest(at, reach=1.0) == -1).all()


def test_nearest_is_that_of_brute_force(device):
    rng = np.random.default_rng(3)
    points, normals = rng.random((500, 3)), rng.normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    at, facing = rng.random((80, 3)), rng.normal(size=(80, 3))
    surface = PointSurface(points, normals, 0.1, device=device)
    found = surface.nearest(at, facing=facing, reach=3.0)
    assert found.tolist() == [reference.nearest(points, normals, x, f) for x, f in zip(at, facing, strict=True)]


def test_surface_variation(device):
    points, up = sheet(20)
    assert PointSurface(points, up, 3.0, device=device).variation(4.0).max() < 1e-6
    # A cap of angle a on the unit sphere: heights vary by (1 - cos a)² / 12, the plane's extents by about a² / 4 each.
    sphere, spacing = reference.fibonacci_sphere(20000)
    radius = 0.2
    value = PointSurface(sphere, sphere, 3 * spacing, device=device).variation(radius)
    cap = 1 - radius**2 / 2
    heights, sides = (1 - cap) ** 2 / 12, (1 - (1 + cap + cap**2) / 3) / 2
    assert np.median(value) == pytest.approx(heights / (heights + 2 * sides), rel=0.05)
    noise = np.random.default_rng(0).normal(size=(3000, 3))
    assert PointSurface(noise, np.tile([0.0, 0, 1], (3000, 1)), 0.5, device=device).variation(0.8).max() <= 1 / 3 + 1e-6


def test_the_field_of_a_sphere_is_its_distance(device):
    points, spacing = reference.fibonacci_sphere(8000)
    surface = PointSurface(points, points, 3 * spacing, device=device)
    rng = np.random.default_rng(5)
    at = rng.uniform(-1.6, 1.6, (2000, 3))
    at = at[np.linalg.norm(at, axis=1) > 0.3]
    field = signed_distance(surface, at, reach=3.0)
    np.testing.assert_allclose(field[:, 0], np.linalg.norm(at, axis=1) - 1, atol=0.02 * spacing)
    gradient = at / np.linalg.norm(at, axis=1, keepdims=True)
    assert (field[:, 1:] * gradient).sum(axis=1).min() > np.cos(np.radians(2))


def test_the_field_agrees_with_the_reference_and_ends_at_reach(device):
    points, spacing = reference.fibonacci_sphere(600)
    surface = PointSurface(points, points, 3 * spacing, device=device)
    at = np.random.default_rng(6).uniform(-1.3, 1.3, (40, 3))
    field = signed_distance(surface, at, reach=4.0)
    for x, value in zip(at, field, strict=True):
        np.testing.assert_allclose(value, reference.signed_distance(points, points, x, 3 * spacing), atol=0.01)
    far = signed_distance(surface, np.array([[9.0, 0, 0]]), reach=2.0)
    np.testing.assert_array_equal(far, [[2, 0, 0, 0]])
    nothing = signed_distance(PointSurface(np.zeros((0, 3)), np.zeros((0, 3)), 1.0, device=device), at, reach=2.0)
    np.testing.assert_array_equal(nothing[0], [2, 0, 0, 0])


def test_patch_distances_agree_with_the_reference(device):
    rng = np.random.default_rng(7)
    field = rng.normal(size=(40, 23, 5, 4)).astype(np.float32)
    search = PatchSearch(field, device)
    positions = (31, 14)
    nodes = [np.stack([rng.integers(0, 10, n), rng.integers(0, 10, n), rng.integers(0, 5, n)], axis=1) for n in (70, 0, 33)]
    values = [rng.normal(size=(len(n), 4)).astype(np.float32) for n in nodes]
    first = np.concatenate([[0], np.cumsum([len(n) for n in nodes])])
    got = search.distances(Overlaps(first, np.concatenate(nodes), np.concatenate(values)), positions)
    for b, (node, value) in enumerate(zip(nodes, values, strict=True)):
        wanted = reference.patch_distances(field, node, value, positions)
        np.testing.assert_allclose(got[b], wanted, rtol=1e-5, atol=1e-4)
    # The patch itself is at distance 0.
    node = nodes[0]
    own = field[node[:, 0] + 4, node[:, 1] + 9, node[:, 2]]
    there = search.distances(Overlaps(np.array([0, len(node)]), node, own), positions)[0]
    assert there[4, 9] == 0
    assert np.unravel_index(np.argmin(there), positions) == (4, 9)


def test_candidates_lie_within_the_tolerance():
    distance = np.array([[4.0, 2.0], [2.19, 2.21]])
    assert candidates(distance, 0.1).tolist() == [1, 2]
    assert candidates(distance, 0.0).tolist() == [1]
    assert candidates(np.zeros((2, 2)), 0.0).tolist() == [0, 1, 2, 3]


def test_points_push_each_other_apart_along_the_surface(device):
    points, up = sheet(20)
    points[210] += (0.45, 0.3, 0)
    surface = PointSurface(points, up, 2.5, device=device)
    moved = repel_points(surface, 1.0, 0.25)
    assert (moved[:, 2] == 0).all()
    towards = moved[210] - points[210]
    assert towards[0] < -0.01
    still = np.linalg.norm(points - points[210], axis=1) > 2.5
    np.testing.assert_array_equal(moved[still], points[still].astype(np.float32))


def test_gaps_are_found_and_borders_are_not(device):
    points, up = sheet(20)
    hole = (np.abs(points[:, 0] - 9.5) < 1.1) & (np.abs(points[:, 1] - 9.5) < 1.1)
    surface = PointSurface(points[~hole], up[~hole], 2.5, device=device)
    middle, width = gaps(surface, 1.8, 5.0)
    beside = width > 0
    assert beside.sum() > 3
    # Around the hole, all of them, and not at the sheet's border.
    assert (np.abs(points[~hole][beside, :2] - 9.5).max(axis=1) < 3).all()
    assert np.abs(middle[beside, :2] - 9.5).max() < 2
    assert width.max() < 5


def test_one_thread_and_two_give_the_same_bits():
    points, spacing = reference.fibonacci_sphere(4000)
    at = np.random.default_rng(8).uniform(-1.2, 1.2, (3000, 3))
    found = []
    for count in (1, 2):
        set_threads(count)
        try:
            surface = PointSurface(points, points, 3 * spacing)
            feet = surface.project(at, reach=1.0)
            field = signed_distance(surface, at, reach=1.0)
            found.append((feet.points, feet.normals, field, surface.variation(0.2), repel_points(surface, spacing, 0.2)))
        finally:
            set_threads(None)
    for one, two in zip(*found, strict=True):
        np.testing.assert_array_equal(one, two)
