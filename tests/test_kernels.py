"""Launching, grids, location: exact facts and brute force."""

from __future__ import annotations

import itertools
import subprocess
import sys

import numpy as np
import pytest
import trimesh
import warp as wp

from intaglio.kernels.launch import choose_device, launch, run_parallel, set_threads, split, threads
from intaglio.kernels.location import GridLocator, height_above, polar_grid
from intaglio.mesh.base import Cylinder, Plane, Sphere, perpendicular
from intaglio.mesh.topology import Topology
from intaglio.randomness import uniform


@wp.kernel
def mark_kernel(start: int, out: wp.array2d(dtype=wp.int32)):
    """Count how often an element is visited."""
    i, j = wp.tid()
    out[start + i, j] = out[start + i, j] + 1000 * (start + i) + j


@pytest.mark.parametrize("count", [1, 2, 5, None])
@pytest.mark.parametrize("rows", [0, 1, 7, 1000])
def test_every_index_is_launched_once(count, rows, device):
    set_threads(count)
    try:
        out = wp.zeros((rows, 3), dtype=wp.int32, device=device)
        launch(mark_kernel, (rows, 3), inputs=[], outputs=[out], device=device, grain=2)
        expected = 1000 * np.arange(rows)[:, None] + np.arange(3)[None, :]
        np.testing.assert_array_equal(out.numpy(), expected)
    finally:
        set_threads(None)


def test_splits_cover_the_range():
    for count in (1, 2, 10, 17):
        for parts in (1, 3, 40):
            pieces = list(split(count, parts))
            assert pieces[0][0] == 0
            assert pieces[-1][1] == count
            assert all(a[1] == b[0] for a, b in itertools.pairwise(pieces))


def test_an_error_in_a_thread_reaches_the_caller():
    def work(item):
        if item == 3:
            raise RuntimeError("three")

    with pytest.raises(RuntimeError, match="three"):
        run_parallel(work, range(8))


def test_devices():
    assert choose_device("cpu") == "cpu"
    assert choose_device() in [str(d) for d in wp.get_devices()]
    with pytest.raises(ValueError, match="available"):
        choose_device("cuda:77")
    assert threads() >= 1
    with pytest.raises(ValueError, match="at least 1"):
        set_threads(0)


@pytest.mark.parametrize(("window", "rotations"), [(1, 1), (3, 4), (5, 12), (9, 36), (2, 7)])
def test_grid_rotations_are_permutations(window, rotations):
    points, ring, permutation = polar_grid(window, rotations)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), ring, atol=1e-5)
    for q in range(rotations):
        assert sorted(permutation[q]) == list(range(len(points)))
        angle = 2 * np.pi * q / rotations
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        np.testing.assert_allclose(points[permutation[q]], points @ turn.T, atol=1e-5)


def locator(points, faces, base, device):
    kind, origin, axis, radius = base.kernel_parameters
    return GridLocator(points, faces, Topology.of(faces, len(points)).across, kind, origin, axis, radius, device)


def test_linear_heights_on_a_plane_are_interpolated_exactly(device):
    rng = np.random.default_rng(0)
    from scipy.spatial import Delaunay

    flat = rng.uniform(-5, 5, (800, 2))
    faces = Delaunay(flat).simplices.astype(np.int32)
    points = np.column_stack([flat, np.zeros(800)])
    base = Plane(point=np.zeros(3), normal=np.array([0, 0, 1.0]))
    loc = locator(points, faces, base, device)
    inner = np.flatnonzero(np.abs(flat).max(axis=1) < 3)
    u = np.tile((1.0, 0, 0), (len(inner), 1))
    v = np.tile((0, 1.0, 0), (len(inner), 1))
    offsets, _, _ = polar_grid(4, 3)
    first = np.array([np.flatnonzero((faces == i).any(axis=1))[0] for i in inner])
    located = loc.locate(points[inner], u, v, first, 0.3 * offsets, 0.01)
    height = (2 * flat[:, 0] - 3 * flat[:, 1] + 1).astype(np.float32)
    ones = wp.array(np.ones(800, np.uint8), dtype=wp.uint8, device=device)
    value, known = loc.gather(np.arange(len(inner)), located, wp.array(height, dtype=float, device=device), ones)
    at = points[inner][:, None, :2] + 0.3 * offsets[None]
    assert (known.numpy() == 1).all()
    np.testing.assert_allclose(value.numpy(), 2 * at[..., 0] - 3 * at[..., 1] + 1, atol=2e-4)


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_grids_follow_curved_bases(kind, device):
    if kind == "sphere":
        mesh = trimesh.creation.icosphere(5, 10.0)
        base = Sphere(center=np.zeros(3), radius=10.0)
    else:
        mesh = trimesh.creation.cylinder(10.0, 40.0, sections=200)
        side = np.abs(mesh.face_normals[:, 2]) < 0.5
        mesh = trimesh.Trimesh(mesh.vertices, mesh.faces[side]).subdivide().subdivide()
        mesh.vertices[:, :2] *= (10 / np.linalg.norm(mesh.vertices[:, :2], axis=1))[:, None]
        base = Cylinder(point=np.zeros(3), axis=np.array([0, 0, 1.0]), radius=10.0)
    points, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32)
    at = np.flatnonzero(np.abs(points[:, 2]) < 4)[::37]
    normal = base.foot(points[at])[1]
    u = perpendicular(normal)
    v = np.cross(normal, u)
    topology = Topology.of(faces, len(points))
    offsets, _, _ = polar_grid(3, 1)
    loc = locator(points, faces, base, device)
    located = loc.locate(points[at], u, v, topology.incident[topology.face_offsets[at]], 0.8 * offsets, 0.05)
    assert (located[0].numpy() >= 0).all()
    ones = wp.array(np.ones(len(points), np.uint8), dtype=wp.uint8, device=device)
    found = np.stack(
        [
            loc.gather(np.arange(len(at)), located, wp.array(points[:, c].astype(np.float32), dtype=float, device=device), ones)[
                0
            ].numpy()
            for c in range(3)
        ],
        axis=-1,
    )
    # Geodesic distance from the centre, against the grid's: the facets' sagitta is the tolerance.
    if kind == "sphere":
        cosine = np.einsum("nkc,nc->nk", found, points[at]) / np.linalg.norm(found, axis=2) / 10
        distance = 10 * np.arccos(np.clip(cosine, -1, 1))
    else:
        angle = np.arctan2(found[..., 1], found[..., 0]) - np.arctan2(points[at, 1], points[at, 0])[:, None]
        arc = 10 * ((angle + np.pi) % (2 * np.pi) - np.pi)
        distance = np.hypot(arc, found[..., 2] - points[at, 2][:, None])
    np.testing.assert_allclose(distance, np.tile(0.8 * np.linalg.norm(offsets, axis=1), (len(at), 1)), atol=0.02)


def test_beyond_the_border_nothing_is_found(device):
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2]], np.int32)
    loc = locator(points, faces, Plane(point=np.zeros(3), normal=np.array([0, 0, 1.0])), device)
    offsets = np.array([[0, 0], [0.3, 0.3], [2, 0], [-1, 0], [0.9, 0.9]], np.float32)
    face, _ = loc.locate(points[:1], np.array([[1.0, 0, 0]]), np.array([[0, 1.0, 0]]), np.array([0]), offsets, 0.01)
    np.testing.assert_array_equal(face.numpy()[0], [0, 0, -1, -1, -1])


def test_height_above(device):
    v, f = trimesh.creation.icosphere(4, 2.0).vertices, trimesh.creation.icosphere(4, 2.0).faces
    directions = np.random.default_rng(1).normal(size=(60, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    inside, outside = (height_above(r * directions + 1e5, directions, v + 1e5, f, 1.0, device) for r in (1.9, 2.2))
    np.testing.assert_allclose(inside, 0.1, atol=8e-3)
    np.testing.assert_allclose(outside, -0.2, atol=8e-3)
    assert np.isnan(height_above(0.1 * directions, directions, v, f, 1.0, device)).all()


def test_random_numbers_depend_on_their_keys_alone():
    keys = np.arange(20_000)
    a = uniform(3, 1, keys, 0)
    np.testing.assert_array_equal(a[::-1], uniform(3, 1, keys[::-1], 0))
    assert uniform(3, 1, 17, 0) == a[17]
    for other in (uniform(4, 1, keys, 0), uniform(3, 2, keys, 0), uniform(3, 1, keys, 1)):
        assert abs(np.corrcoef(a, other)[0, 1]) < 0.03
    assert 0 <= a.min() < a.max() < 1
    # Kolmogorov-Smirnov against the uniform distribution at 1 in 1e4: 1.95 / sqrt(n).
    assert np.abs(np.sort(a) - (np.arange(len(a)) + 0.5) / len(a)).max() < 2.2 / np.sqrt(len(a))


@pytest.mark.skipif(not wp.is_cuda_available() and wp.get_cuda_toolkit_version() is None, reason="this Warp has no CUDA compiler")
def test_every_kernel_compiles_for_cuda(tmp_path):
    """One source for CPU and CUDA: the CUDA compiler that comes with Warp needs no GPU."""
    script = tmp_path / "compile.py"
    script.write_text(
        "import importlib, pkgutil, sys, warp as wp, intaglio.kernels as kernels\n"
        "for found in pkgutil.iter_modules(kernels.__path__):\n"
        "    module = importlib.import_module(f'intaglio.kernels.{found.name}')\n"
        "    if any(isinstance(a, wp.Kernel) and a.module.name == module.__name__ for a in vars(module).values()):\n"
        "        wp.compile_aot_module(module, arch=80, module_dir=sys.argv[1])\n"
        "        print(found.name)\n"
    )
    made = tmp_path / "made"
    made.mkdir()
    done = subprocess.run([sys.executable, str(script), str(made)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert len(list(made.glob("*.cubin")) + list(made.glob("*.ptx"))) == len(done.stdout.split()) > 15
