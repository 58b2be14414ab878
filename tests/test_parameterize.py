"""Parameterization: exact facts, derivatives against differences, topology, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import cylinder, grid, half_sphere, sphere, torus

from intaglio import InputError, Surface, parameterize
from intaglio.kernels.distortion import MIPS, STRETCH, Distortion
from intaglio.kernels.launch import set_threads
from intaglio.mesh.topology import border_loops
from intaglio.parameterization.border import barrier, close_pairs, crosses_itself
from intaglio.parameterization.charts import (
    Chart,
    doubled_areas,
    doubled_texture_areas,
    flat_edges,
    invert_matrices,
    squared_stretches,
)
from intaglio.parameterization.embedding import embed_without_flips, intrinsic_weights, mean_value_weights, relax_stretch
from intaglio.parameterization.pictures import area_by_view, checkerboard, describe_parameterization, layout_picture
from intaglio.parameterization.seams import cut_open


def laid_flat(surface, **options):
    found = parameterize(surface, **options)
    assert found.flips == 0
    assert np.isfinite(found.uv).all()
    assert found.uv.min() >= -1e-9
    assert found.uv.max() <= 1 + 1e-9
    np.testing.assert_array_equal(found.vertex[found.faces], surface.faces)
    return found


def stretch_reference(surface, found):
    """L2 and largest stretch by singular values, one triangle after the other."""
    total, area3, area2, largest = 0.0, 0.0, 0.0, 0.0
    for face, corner in zip(surface.faces, found.faces, strict=True):
        a, b, c = surface.vertices[face]
        along = (b - a) / np.linalg.norm(b - a)
        normal = np.cross(b - a, c - a)
        beside = np.cross(normal / np.linalg.norm(normal), along)
        flat = np.array([[along @ (b - a), along @ (c - a)], [beside @ (b - a), beside @ (c - a)]])
        p, q, r = found.uv[corner]
        back = flat @ np.linalg.inv(np.stack([q - p, r - p], axis=1))
        s = np.linalg.svd(back, compute_uv=False)
        area = np.linalg.norm(normal) / 2
        total += area * (s**2).sum() / 2
        area3 += area
        area2 += abs(np.linalg.det(np.stack([q - p, r - p], axis=1))) / 2
        largest = max(largest, s[0])
    scale = area2 / area3
    return np.sqrt(total / area3 * scale), largest * np.sqrt(scale)


@pytest.mark.parametrize("energy", ["stretch", "stretch-max", "mips"])
def test_a_plane_stays_a_plane(energy):
    found = laid_flat(grid(), energy=energy)
    assert found.l2_stretch == pytest.approx(1, abs=1e-4 if energy == "stretch" else 5e-3)
    assert not found.cut
    assert found.charts == 1


def test_stretch_is_that_of_singular_values():
    surface = half_sphere(400)
    found = laid_flat(surface)
    np.testing.assert_allclose((found.l2_stretch, found.linf_stretch), stretch_reference(surface, found), rtol=1e-9)


def test_a_developed_cylinder_is_an_optimum():
    found = laid_flat(cylinder())
    assert found.cut
    assert found.l2_stretch == pytest.approx(1, abs=2e-3)


@pytest.mark.parametrize("kind", [STRETCH, MIPS])
@pytest.mark.parametrize("power", [2.0, 4.0])
def test_gradients_are_differences_of_the_energy(kind, power, device):
    surface = half_sphere(60)
    chart = Chart(surface.vertices, surface.faces, border_loops(surface.faces)[0])
    area = doubled_areas(surface.vertices, surface.faces)
    uv = embed_without_flips(chart, "circle")[0] * 2
    least = np.full(len(surface.faces), 0.7)
    distortion = Distortion(
        surface.faces,
        invert_matrices(flat_edges(surface.vertices, surface.faces)),
        area / area.sum(),
        area / area.sum(),
        least,
        kind=kind,
        power=power,
        strictness=3.0,
        device=device,
    )
    gradient, hessian = distortion.derivatives(uv)
    total = np.zeros(uv.shape)
    for corner in range(3):
        np.add.at(total, surface.faces[:, corner], gradient[:, 2 * corner : 2 * corner + 2])
    eigenvalues = np.linalg.eigvalsh(hessian)
    assert eigenvalues.min() > -1e-9 * eigenvalues.max()
    step = 1e-6
    for vertex in range(0, len(uv), 7):
        for axis in range(2):
            moved = [uv.copy(), uv.copy()]
            moved[0][vertex, axis] += step
            moved[1][vertex, axis] -= step
            slope = (distortion.energies(moved[0]).sum() - distortion.energies(moved[1]).sum()) / (2 * step)
            assert total[vertex, axis] == pytest.approx(slope, rel=2e-5, abs=1e-7)


def test_a_flipped_triangle_has_infinite_energy(device):
    surface = grid(3, 3)
    area = doubled_areas(surface.vertices, surface.faces)
    rest = invert_matrices(flat_edges(surface.vertices, surface.faces))
    zero = np.zeros(len(area))
    distortion = Distortion(surface.faces, rest, area, area, zero, kind=STRETCH, power=2.0, strictness=1.0, device=device)
    assert np.isfinite(distortion.energies(surface.vertices[:, :2])).all()
    assert np.isinf(distortion.energies(surface.vertices[:, :2] * (-1, 1))).all()


def test_linear_embeddings_reproduce_a_plane():
    surface = grid()
    chart = Chart(surface.vertices, surface.faces, border_loops(surface.faces)[0])
    for weights in (mean_value_weights(chart), intrinsic_weights(chart, 1.0), intrinsic_weights(chart, 0.3)):
        inside = np.setdiff1d(np.arange(len(surface.vertices)), chart.loop)
        mean = (weights @ surface.vertices[:, :2]) / np.asarray(weights.sum(axis=1))[:, None]
        np.testing.assert_allclose(mean[inside], surface.vertices[inside, :2], atol=1e-9)


def test_intrinsic_weights_do_not_depend_on_which_corner_comes_first():
    surface = half_sphere(200)
    chart = Chart(surface.vertices, surface.faces, border_loops(surface.faces)[0])
    turned = Chart(surface.vertices, np.roll(surface.faces, 1, axis=1), chart.loop)
    np.testing.assert_allclose(
        intrinsic_weights(chart, 0.2).toarray(), intrinsic_weights(turned, 0.2).toarray(), rtol=1e-9, atol=1e-12
    )


def test_relaxation_lowers_the_stretch_and_flips_nothing():
    surface = half_sphere(4000, height=0.3, waves=14)
    chart = Chart(surface.vertices, surface.faces, border_loops(surface.faces)[0])
    area = doubled_areas(surface.vertices, surface.faces)
    rest = invert_matrices(flat_edges(surface.vertices, surface.faces))
    before, after = embed_without_flips(chart, "circle")[0], relax_stretch(chart, "circle", area / area.sum())
    assert (doubled_texture_areas(after, chart.faces) > 0).all()
    mean = [float(area @ squared_stretches(uv, chart.faces, rest)) for uv in (before, after)]
    assert mean[1] < 0.9 * mean[0]


def test_the_optimum_is_below_what_it_starts_from_and_other_energies():
    surface = half_sphere(2000)
    best = laid_flat(surface).l2_stretch
    for options in ({"energy": "mean-value"}, {"energy": "mips"}, {"boundary": "circle"}, {"boundary": "square"}):
        assert best < laid_flat(surface, **options).l2_stretch
    assert laid_flat(surface, energy="stretch-max").linf_stretch < laid_flat(surface).linf_stretch


def test_a_square_border_fills_the_square():
    found = laid_flat(half_sphere(1000), boundary="square")
    assert np.abs(doubled_texture_areas(found.uv, found.faces)).sum() / 2 == pytest.approx(1, abs=1e-9)


def test_what_faces_the_view_gets_more_of_the_texture():
    surface = half_sphere(2000, height=0.05)
    even, favoured = laid_flat(surface), laid_flat(surface, view=(0, 0, 1), importance=1.2)
    share = [{n: t for n, _, t in area_by_view(p, surface, (0, 0, 1))}["facing the view"] for p in (even, favoured)]
    assert share[1] > 1.1 * share[0]


def test_the_shape_limit_holds():
    surface = half_sphere(2000, height=0.35, waves=14)
    free = laid_flat(surface)
    limited = laid_flat(surface, shape_threshold=0.15)
    # Triangles that are thinner in space may stay so.
    corner = surface.vertices[surface.faces]
    longest = np.max(np.sum((corner - np.roll(corner, 1, axis=1)) ** 2, axis=2), axis=1)
    wanted = np.minimum(0.15, 0.9 * doubled_areas(surface.vertices, surface.faces) / longest)
    assert (free.shape_ratio < wanted).sum() > 0
    assert (limited.shape_ratio > 0.97 * wanted).all()


def test_closed_surfaces_are_cut_and_seams_lower_the_stretch():
    once = laid_flat(sphere())
    assert once.cut
    assert "cut open" in once.notes[0]
    more = laid_flat(sphere(), max_stretch=1.03)
    assert more.l2_stretch < once.l2_stretch
    assert len(more.vertex) > len(once.vertex)


def test_a_tetrahedron_opens():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    found = laid_flat(Surface(vertices=corners, faces=np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])))
    assert found.l2_stretch < 1.5


def test_one_triangle():
    found = laid_flat(Surface(vertices=np.array([[0.0, 0, 0], [3, 0, 0], [0, 0.1, 0]]), faces=np.array([[0, 1, 2]])))
    assert found.l2_stretch == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("first", range(100, 124, 3))
def test_small_holes_are_bridged_wherever_the_seam_runs(first):
    found = laid_flat(cylinder(holes=(first, first + 60)))
    assert found.l2_stretch < 1.02
    assert "2 small holes bridged" in found.notes[0]


def test_long_tubes_are_joined_end_to_end():
    tube = cylinder(12, 60)
    long = Surface(vertices=tube.vertices * (0.1, 0.1, 2.5), faces=tube.faces)
    found = laid_flat(long)
    assert "2 borders joined" in found.notes[0]
    assert found.l2_stretch < 1.01


@pytest.mark.parametrize("scale", [1e-4, 1e6])
def test_charts_do_not_depend_on_the_unit(scale):
    surface = torus()
    found = laid_flat(Surface(vertices=surface.vertices * scale, faces=surface.faces))
    assert found.l2_stretch == pytest.approx(parameterize(surface).l2_stretch, rel=0.02)


def test_a_torus_gets_charts():
    found = laid_flat(torus())
    assert found.charts > 1
    assert "xatlas" in found.notes[0]
    assert len(found.vertex) == len(found.uv)


def test_pieces_get_charts():
    one, other = grid(), grid()
    both = Surface(
        vertices=np.concatenate([one.vertices, other.vertices + (3, 0, 0)]),
        faces=np.concatenate([one.faces, other.faces + len(one.vertices)]),
    )
    assert "2 separate pieces" in parameterize(both).notes[0]


def test_survey_coordinates_change_nothing():
    surface = half_sphere(1000)
    moved = Surface(vertices=surface.vertices + (5e5, 4e6, 100), faces=surface.faces)
    assert parameterize(moved).l2_stretch == pytest.approx(parameterize(surface).l2_stretch, rel=1e-4)


def test_threads_change_no_bits():
    surface, found = half_sphere(6000), []
    for count in (1, 2):
        set_threads(count)
        found.append(parameterize(surface).uv)
    set_threads(None)
    np.testing.assert_array_equal(*found)


def test_cutting_keeps_faces_and_parts_vertices():
    surface = cylinder()
    seam = np.array([[24 * k, 24 * (k + 1)] for k in range(11)])
    faces, origin = cut_open(surface.faces, len(surface.vertices), seam)
    np.testing.assert_array_equal(origin[faces], surface.faces)
    assert len(origin) == len(surface.vertices) + 12
    assert len(border_loops(faces)) == 1


def test_borders_that_cross():
    square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    turn = 2 * np.pi * np.arange(12) / 12
    assert not crosses_itself(np.stack([np.cos(turn), np.sin(turn)], axis=1))
    assert crosses_itself(square[[0, 1, 3, 2]])
    hook = np.array([[0.0, 0], [4, 0], [4, 1], [1, 1], [1, 0.02], [0.9, 0.02], [0.9, 2], [0, 2]])
    assert not crosses_itself(hook)
    hook[[4, 5], 1] = -0.02
    assert crosses_itself(hook)


def test_the_barrier_pushes_apart():
    hook = np.array([[0.0, 0], [4, 0], [4, 1], [1, 1], [1, 0.02], [0.9, 0.02], [0.9, 2], [0, 2]])
    vertex, edge = close_pairs(hook, 0.1)
    assert (vertex == 4).any()
    energy, gradient, hessian = barrier(hook, vertex, edge, 0.1)
    at = int(np.flatnonzero((vertex == 4) & (edge == 0))[0])
    assert energy > 0
    assert gradient[at, 1] < 0
    assert np.linalg.eigvalsh(hessian).min() > -1e-9
    assert barrier(hook, vertex[:0], edge[:0], 0.1)[0] == 0


def test_pictures_and_figures():
    surface = half_sphere(400)
    found = parameterize(surface)
    assert checkerboard(64, 8).shape == (64, 64, 3)
    picture = layout_picture(found, 64)
    assert picture[0, 0].min() == pytest.approx(1)
    assert picture[32, 32].min() < 0.9
    lines = describe_parameterization(found, surface, (0, 0, 1))
    assert any("0 flipped" in line for line in lines)
    assert any("facing the view" in line for line in lines)


def _with(surface, **changes):
    return Surface(**{"vertices": surface.vertices, "faces": surface.faces, **changes})


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (_with(grid(), faces=np.concatenate([grid().faces, [[0, 1, 2]]])), "no area"),
        (_with(grid(), faces=np.concatenate([grid().faces, grid().faces[:1]])), "two faces on one side"),
        (_with(grid(), faces=np.zeros((0, 3), int)), "no faces"),
        (grid().vertices, "must be a Surface"),
    ],
)
def test_bad_meshes_are_named(mesh, message):
    with pytest.raises(InputError, match=message):
        parameterize(mesh)


def test_vertices_that_no_face_uses_get_no_place():
    whole = grid()
    stray = _with(whole, vertices=np.concatenate([[[9.0, 9, 9]], whole.vertices]), faces=whole.faces + 1)
    found, expected = parameterize(stray, device="cpu"), parameterize(whole, device="cpu")
    np.testing.assert_array_equal(found.uv, expected.uv)
    np.testing.assert_array_equal(found.vertex, expected.vertex + 1)
    assert not found.cut


@pytest.mark.parametrize(
    "options",
    [
        {"energy": "best"},
        {"boundary": "round"},
        {"view": (0, 0, 0)},
        {"view": "front"},
        {"importance": 1.0, "view": (0, 0, 1)},
        {"shape_threshold": 0.9},
        {"max_stretch": 1.0},
        {"iterations": 0},
    ],
)
def test_bad_options_are_named(options):
    with pytest.raises(InputError, match=next(iter(options))):
        parameterize(grid(), **options)


def test_a_pinched_surface_is_named():
    one = grid(3, 3)
    other = replace(one, vertices=one.vertices + (1, 1, 0), base=None, normal=None)
    both = np.concatenate([one.vertices, other.vertices[1:]])
    faces = np.concatenate([one.faces, np.where(other.faces == 0, 8, other.faces + 8)])
    with pytest.raises(InputError, match="touches itself"):
        parameterize(Surface(vertices=both, faces=faces))


def test_real_head(real):
    import trimesh

    part = next(iter(trimesh.load(real("meshes/lee_perry_smith_head/LeePerrySmith.glb"), process=False).geometry.values()))
    vertices, whole = np.unique(np.asarray(part.vertices, float), axis=0, return_inverse=True)
    found = laid_flat(Surface(vertices=vertices, faces=whole.reshape(-1)[part.faces]), view=(0, 0, 1))
    assert found.l2_stretch < 1.2
