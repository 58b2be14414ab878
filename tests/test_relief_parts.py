"""Frames, extents, lattices, oversampling, propagation's bookkeeping."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from reliefs import complete_with

import intaglio
from intaglio.mesh.base import Cylinder, Plane, Sphere, unit
from intaglio.mesh.topology import Topology, border_edges, border_loops, unique_edges
from intaglio.relief.ground.extent import region_to_complete, sampling_distance, scan_lattice
from intaglio.relief.ground.frames import local_frames
from intaglio.relief.ground.prepare import prepare_ground
from intaglio.relief.growth.samples import sample_set
from intaglio.scenes.patterns import cylinder_base, grid_faces


@pytest.mark.parametrize("method", ["algebraic", "sweep", "reference"])
def test_frames_are_orthonormal(method):
    ball = trimesh.creation.icosphere(4)
    base = Sphere(center=np.zeros(3), radius=1.0)
    normal = unit(np.asarray(ball.vertices))
    u, v = local_frames(normal, np.asarray(ball.faces), base, method, reference=(0, 0, 1.0))
    axes = np.stack([u, v, normal], axis=1)
    np.testing.assert_allclose(axes @ axes.transpose(0, 2, 1), np.tile(np.eye(3), (len(u), 1, 1)), atol=1e-9)
    assert (np.linalg.det(axes) > 0).all()


def test_the_sweep_makes_neighbours_agree_where_algebra_does_not():
    ball = trimesh.creation.icosphere(4)
    normal, faces = unit(np.asarray(ball.vertices)), np.asarray(ball.faces)
    base = Sphere(center=np.zeros(3), radius=1.0)
    edges = unique_edges(faces)
    turn = {}
    for method in ("algebraic", "sweep"):
        u, _ = local_frames(normal, faces, base, method, seed_vertex=0)
        turn[method] = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", u[edges[:, 0]], u[edges[:, 1]]), -1, 1)))
    assert (turn["algebraic"] > 60).sum() > 5 * max(1, (turn["sweep"] > 60).sum())
    # A hemisphere around the seed has no seam at all.
    near = (normal[edges] @ normal[0] > 0.2).all(axis=1)
    assert turn["sweep"][near].max() < 25


def test_the_default_frame_of_a_cylinder_is_its_axis():
    base = cylinder_base()
    normal = base.foot(np.random.default_rng(0).normal(size=(40, 3)))[1]
    u, _ = local_frames(normal, np.zeros((0, 3), int), base)
    np.testing.assert_allclose(np.abs(u @ base.axis), 1, atol=1e-12)


def test_a_reference_on_a_sphere_must_be_given():
    with pytest.raises(intaglio.InputError, match="reference vector"):
        local_frames(np.eye(3), np.array([[0, 1, 2]]), Sphere(center=np.zeros(3), radius=1.0), "reference")


def test_one_tiny_edge_does_not_set_the_spacing():
    faces = grid_faces(20, 20, False)
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    points[25] = points[26] + (0, 1e-7, 0)
    spacing, note = sampling_distance(points, faces)
    assert spacing == pytest.approx(1.0, abs=0.01)
    assert "1e-07" in note


@pytest.mark.parametrize("turn", [0.0, 0.4])
@pytest.mark.parametrize("skew", [0.0, 0.5])
def test_a_lattice_is_found_and_its_phase(turn, skew):
    i, j = np.meshgrid(np.arange(30.0), np.arange(25.0), indexing="ij")
    steps = 0.7 * np.array(
        [[np.cos(turn), np.sin(turn)], [skew * np.cos(turn) - np.sin(turn), skew * np.sin(turn) + np.cos(turn)]]
    )
    chart = np.stack([i.ravel(), j.ravel()], axis=1) @ steps + (3.3, -1.2)
    chart += np.random.default_rng(0).normal(0, 0.004, chart.shape)
    origin, found = scan_lattice(chart, grid_faces(30, 25, False))
    at = (chart - origin) @ np.linalg.inv(found)
    np.testing.assert_allclose(at, np.round(at), atol=0.05)
    assert abs(np.linalg.det(found)) == pytest.approx(0.49, rel=0.01)


def test_scattered_samples_are_no_lattice():
    rng = np.random.default_rng(0)
    from scipy.spatial import Delaunay

    chart = rng.uniform(0, 20, (500, 2))
    assert scan_lattice(chart, Delaunay(chart).simplices) is None


def test_targets_continue_the_scan_s_lattice(wave_tube):
    scan, truth = wave_tube
    ground = prepare_ground(scan, cylinder_base())
    targets = ground.foot[~ground.measured]
    expected = cylinder_base().foot(truth.vertices[720:])[0]
    from scipy.spatial import cKDTree

    assert cKDTree(targets).query(expected)[0].max() < 1e-6


@pytest.mark.parametrize("extent", [(1.0,), (5.0, 4.0), (1, 2, 3, 4), "rectangle"])
def test_extents_that_a_cylinder_does_not_have(extent):
    base = Cylinder(point=np.zeros(3), axis=np.array([0, 0, 1.0]), radius=3.0)
    points = base.from_chart(np.random.default_rng(0).uniform(0, 5, (50, 2)))
    with pytest.raises(intaglio.InputError, match=r"extent|rectangle"):
        region_to_complete(base, points, np.array([[0, 1, 2]]), 0.5, extent)


def test_a_longer_tube_can_be_asked_for(wave_tube):
    scan, _ = wave_tube
    whole = complete_with(scan, cylinder_base(), 2, 0.1, extent=(-6.0, 29.0))
    assert whole.vertices[:, 2].min() == pytest.approx(-6, abs=0.6)
    assert whole.vertices[:, 2].max() == pytest.approx(29, abs=0.6)
    assert len(border_loops(whole.faces)) == 2


def test_oversampling_halves_every_edge(wave_tube):
    scan, _ = wave_tube
    ground = prepare_ground(scan, cylinder_base())
    plain, fine = sample_set(ground, False), sample_set(ground, True)
    assert len(plain.vertex) == 720
    assert len(fine.vertex) == 720 + len(unique_edges(scan.faces))
    np.testing.assert_allclose(fine.height[:720], plain.height)
    distance = np.abs(cylinder_base().distance(fine.foot))
    assert distance.max() < 1e-9
    assert fine.height.max() <= plain.height.max() + 1e-12
    assert ground.measured[fine.vertex].all()


def test_topology_tables():
    faces = grid_faces(5, 4, False)
    topology = Topology.of(faces, 20)
    for vertex in range(20):
        near = topology.neighbors[topology.offsets[vertex] : topology.offsets[vertex + 1]]
        edges = unique_edges(faces)
        expected = sorted({*edges[edges[:, 0] == vertex, 1], *edges[edges[:, 1] == vertex, 0]})
        assert near.tolist() == expected
        incident = topology.incident[topology.face_offsets[vertex] : topology.face_offsets[vertex + 1]]
        assert sorted(incident) == np.flatnonzero((faces == vertex).any(axis=1)).tolist()
    for face in range(len(faces)):
        for corner in range(3):
            other = topology.across[face, corner]
            pair = {faces[face, corner], faces[face, (corner + 1) % 3]}
            sharing = [f for f in range(len(faces)) if f != face and pair <= set(faces[f])]
            assert sharing == ([other] if other >= 0 else [])
    assert len(border_edges(faces)) == 14


def test_a_bowl_seen_from_inside_is_completed_from_inside(cap):
    inner = intaglio.Surface(vertices=cap.vertices, faces=cap.faces[:, ::-1])
    whole = complete_with(inner, "sphere", window=3)
    assert whole.model.inward
    corners = whole.base[whole.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", normal, corners.mean(axis=1) - whole.model.center) < 0).mean() > 0.999


def test_a_border_that_noise_knots_is_laid_out(wave_sheet):
    scan, _ = wave_sheet
    rng = np.random.default_rng(1)
    vertices = scan.vertices.copy()
    rim = np.unique(border_edges(scan.faces))
    vertices[rim, :2] += rng.normal(0, 0.45, (len(rim), 2))
    base = Plane(point=np.zeros(3), normal=np.array([0, 0, 1.0]), direction=np.array([1.0, 0, 0]))
    whole = complete_with(intaglio.Surface(vertices=vertices, faces=scan.faces), base, 2, extent=(-5, 46, -5, 46))
    assert whole.vertices[: len(vertices)].tobytes() == vertices.tobytes()
    assert len(border_loops(whole.faces)) == 1
