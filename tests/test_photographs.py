"""Photographs: cameras and their files, binding, sampling, blending, files, held-out views."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from shapes import cylinder, grid, half_sphere, sphere, torus

from intaglio import (
    Camera,
    FileError,
    InputError,
    IntaglioWarning,
    Photograph,
    Surface,
    bind_photographs,
    border_step,
    combine_photographs,
    compare_with_photograph,
    parameterize,
    read_image,
    read_photographs,
    restore_texture,
    write_image,
    write_textured,
)
from intaglio.kernels.launch import launch, set_threads
from intaglio.kernels.pull_push import continue_image
from intaglio.kernels.texels import rasterize
from intaglio.parameterization.charts import doubled_texture_areas
from intaglio.photographs.blend import SplineBlend
from intaglio.photographs.exposure import exposure_gains
from intaglio.photographs.selection import shrink_regions
from intaglio.photographs.textured_mesh import coverage_levels
from intaglio.photographs.vertex_colors import spread_colors
from intaglio.render import through_camera
from intaglio.scenes.photographs import camera_towards


def color_at(points):
    """Return a smooth colour (N, 3) of places in space, with some detail."""
    x, y, z = np.moveaxis(np.asarray(points), -1, 0)
    return np.stack([0.5 + 0.25 * np.sin(3 * x + 1), 0.5 + 0.25 * np.sin(3 * y + 2 * z), 0.4 + 0.2 * np.cos(4 * z + x)], axis=-1)


@wp.kernel
def meet_kernel(start: int, mesh: wp.uint64, origin: wp.vec3, along: wp.array(dtype=wp.vec3), distance: wp.array(dtype=float)):
    """Distance at which a ray meets the mesh, -1 where it does not."""
    i = start + wp.tid()
    query = wp.mesh_query_ray(mesh, origin, along[i], 1.0e6)
    distance[i] = wp.where(query.result, query.t, -1.0)


def seen_by(surface, camera, exposure=1.0, alpha=True):
    """Return a photograph of a surface whose colour is `color_at`: by rays through pixel centres, without noise."""
    height, width = camera.size
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    rays = camera.unproject(np.stack([x, y], axis=-1).reshape(-1, 2))
    # What a lens shows nothing of looks back, where nothing is.
    rays = np.where(np.isnan(rays), -camera.R[2], rays)
    mesh = wp.Mesh(
        points=wp.array(surface.vertices.astype(np.float32), dtype=wp.vec3, device="cpu"),
        indices=wp.array(surface.faces.reshape(-1), dtype=wp.int32, device="cpu"),
    )
    along = wp.array(rays.astype(np.float32), dtype=wp.vec3, device="cpu")
    distance = wp.empty(len(rays), dtype=float, device="cpu")
    launch(meet_kernel, len(rays), [mesh.id, wp.vec3(*camera.center), along], [distance], device="cpu")
    distance = distance.numpy()
    hit = distance > 0
    image = np.zeros((width * height, 4), np.float32)
    image[hit, :3] = color_at(camera.center + distance[hit, None] * rays[hit]) * exposure
    image[hit, 3] = 1
    image = image.reshape(height, width, 4)
    return Photograph(camera=camera, picture=image if alpha else image[:, :, :3], name=f"view {exposure}")


def around(surface, directions, size=72, **options):
    view = {"focal": 2.3 * size, "size": (size, size)}
    up = np.array([0.02, 0.99, 0.1])
    cameras = [camera_towards(np.zeros(3), np.array(d, float), up, 6.0, **view) for d in directions]
    return [replace(seen_by(surface, c, **options), name=f"view {i}") for i, c in enumerate(cameras)]


SIX = [(1, 0.1, 0), (-1, 0, 0.1), (0, 1, 0.2), (0.1, -1, 0), (0, 0.2, 1), (0.1, 0, -1)]


def true_texture(surface, laid, size):
    face, weight = rasterize(laid.uv, laid.faces, size, size, "cpu")
    corner = surface.vertices[surface.faces[face]]
    third = 1 - weight.sum(axis=2, keepdims=True)
    return color_at(weight[..., :1] * corner[..., 0, :] + weight[..., 1:] * corner[..., 1, :] + third * corner[..., 2, :])


@pytest.fixture(scope="module")
def ball():
    surface = sphere(3)
    return surface, parameterize(surface), around(surface, SIX)


def test_rasterized_texels_lie_in_their_triangles(device):
    surface = half_sphere(300)
    laid = parameterize(surface)
    face, weight = rasterize(laid.uv, laid.faces, 50, 40, device)
    inside = face >= 0
    y, x = np.nonzero(inside)
    corner = laid.uv[laid.faces[face[inside]]] * (40, -50) + (0, 50)
    w = np.concatenate([weight[inside], 1 - weight[inside].sum(axis=1, keepdims=True)], axis=1)
    np.testing.assert_allclose(np.einsum("mk,mkc->mc", w, corner), np.stack([x, y], axis=1) + 0.5, atol=1e-3)
    assert w.min() > -1e-4
    area = np.abs(doubled_texture_areas(laid.uv, laid.faces)).sum() / 2
    assert inside.mean() == pytest.approx(area, rel=0.03)


def test_neighbouring_triangles_leave_no_gap():
    surface = grid(20, 20)
    face, _ = rasterize(surface.vertices[:, :2], surface.faces, 333, 217, "cpu")
    assert (face >= 0).all()


def test_projection_is_the_formula_and_the_center_is_seen_nowhere():
    camera = Camera(K=[[300, 2, 90], [0, 330, 140], [0, 0, 1]], R=np.eye(3), t=[0.1, -0.2, 4], distortion=(0.1, -0.02))
    pixel, depth = camera.project(np.array([[0.3, 0.5, 1.0], [0, 0, -9]]))
    x, y = 0.4 / 5, 0.3 / 5
    r = x * x + y * y
    f = 1 + 0.1 * r - 0.02 * r * r
    np.testing.assert_allclose(pixel[0], [300 * x * f + 2 * y * f + 90, 330 * y * f + 140], rtol=1e-12)
    assert np.isnan(pixel[1]).all()
    np.testing.assert_allclose(depth, [5, -5])
    np.testing.assert_allclose(camera.center, [-0.1, 0.2, -4])


def test_distortion_that_turns_back_sees_nothing_beyond():
    camera = Camera(K=[[100, 0, 200], [0, 100, 200], [0, 0, 1]], R=np.eye(3), t=[0, 0, 0], distortion=(-0.5, 0.05))
    assert camera.reach == pytest.approx(min(r for r in np.roots([0.25, -1.5, 1]) if r > 0))
    assert np.isnan(camera.project(np.array([[2.83, 0, 1.0]]))[0]).all()
    assert np.isfinite(camera.project(np.array([[0.5, 0, 1.0]]))[0]).all()


def test_the_renderer_and_the_camera_agree():
    image = np.full((64, 64, 3), 0.2, np.float32)
    image[4:10, 6:12] = (1, 0, 0)
    surface = grid(2, 2)
    turn = camera_towards(np.zeros(3), np.array([0.3, -0.2, 1]), np.array([0.2, 1, 0]), 4, focal=300, size=(260, 200)).R
    camera = Camera(K=[[300, 2, 60], [0, 330, 170], [0, 0, 1]], R=turn, t=[-0.3, 0.4, 4], size=(260, 200))
    view = {"matrix": camera.K, "turn": camera.R, "shift": camera.t, "size": camera.size}
    picture, alpha = through_camera(surface.vertices, surface.faces, surface.vertices[:, :2], image, samples=32, **view)
    y, x = np.nonzero((picture[:, :, 0] > 0.6) & (picture[:, :, 1] < 0.1))
    np.testing.assert_allclose([x.mean(), y.mean()], camera.project(np.array([[9 / 64, 1 - 7 / 64, 0]]))[0][0], atol=0.25)
    assert 0 < alpha.mean() < 1


def test_binding_follows_visibility_facing_and_silhouette(device):
    surface = sphere(3)
    wall = surface.vertices[:3] * 0 + np.array([[-0.4, -0.4, 3.0], [0.4, -0.4, 3], [0, 0.4, 3]])
    both = Surface(
        vertices=np.concatenate([surface.vertices, wall]),
        faces=np.concatenate([surface.faces, np.array([[0, 1, 2]]) + len(surface.vertices)]),
    )
    photograph = around(surface, [(0, 0, 1)])[0]
    free = bind_photographs(surface, [photograph], background=None, device=device).valid[0]
    hidden = bind_photographs(both, [replace(photograph, picture=photograph.read()[0])], background=None, device=device).valid[0]
    z = surface.vertices[:, 2]
    assert free[z > 0.4].all()
    assert not free[z < 0.1].any()
    behind = np.hypot(surface.vertices[:, 0], surface.vertices[:, 1] + 0.1) < 0.1
    assert not hidden[: len(z)][behind & (z > 0)].any()
    assert hidden[: len(z)][(z > 0.5) & (np.abs(surface.vertices[:, 0]) > 0.75)].all()


def test_vertices_on_the_background_are_unbound():
    surface = sphere(3)
    photograph = around(surface, [(0, 0, 1)], alpha=False)[0]
    image = photograph.picture.copy()
    image[:, 40:] = 0
    found = bind_photographs(surface, [replace(photograph, picture=image)])
    x, z = surface.vertices[:, 0], surface.vertices[:, 2]
    assert found.valid[0][(x < -0.15) & (z > 0.6)].all()
    assert not found.valid[0][(x > 0.3) & (z > 0.3)].any()
    assert "background" in found.notes[0]
    assert bind_photographs(surface, [replace(photograph, picture=image)], background=None).valid.sum() > found.valid.sum()


def test_classes_and_rings():
    valid = np.array([[True, True, True, False, False], [False, False, True, True, False]])
    surface = grid(2, 3)
    binding = replace(bind_photographs(sphere(1), around(sphere(1), [(0, 0, 1)])), valid=valid)
    faces = np.array([[0, 1, 2], [1, 2, 3], [2, 3, 4]])
    np.testing.assert_array_equal(binding.triangle_class(faces), [1, 2, 3])
    common = np.ones((1, len(surface.faces)), bool)
    assert shrink_regions(common, surface.faces, 6).all()
    common[0, 0] = False
    assert not shrink_regions(common, surface.faces, 6)[0][(surface.faces == surface.faces[0, 0]).any(axis=1)].any()


def test_missing_vertex_colours_spread_in_passes():
    surface = grid(9, 9)
    rng = np.random.default_rng(1)
    color, has = rng.random((81, 3)), rng.random(81) < 0.4
    found = spread_colors(color, has, surface.faces)
    np.testing.assert_array_equal(found[has], color[has])
    assert found.min() >= color[has].min()
    assert found.max() <= color[has].max()
    one = np.zeros(81, bool)
    one[40] = True
    np.testing.assert_allclose(spread_colors(color, one, surface.faces), np.tile(color[40], (81, 1)))


def test_exposures_are_found():
    surface = sphere(3)
    factors = (1.0, 1.3, 0.8, 1.1, 0.9, 1.2)
    cameras = [p.camera for p in around(surface, SIX)]
    taken = [replace(seen_by(surface, c, exposure=f), name=str(f)) for c, f in zip(cameras, factors, strict=True)]
    gains = exposure_gains(bind_photographs(surface, taken))
    ratio = gains * np.array(factors)[:, None]
    np.testing.assert_allclose(ratio / ratio.mean(axis=0), 1, atol=0.02)


@pytest.mark.parametrize("select", ["best", "average"])
@pytest.mark.parametrize("blend", ["none", "spline"])
def test_exact_photographs_give_the_exact_texture(ball, select, blend, device):
    surface, laid, taken = ball
    found = combine_photographs(surface, laid, taken, 128, select=select, blend=blend, device=device)
    error = np.abs(found.image - true_texture(surface, laid, 128))[found.known]
    assert found.known.sum() > 0.9 * found.inside.sum()
    assert np.sqrt(np.mean(error**2)) < 0.012
    assert (found.photograph[found.known][:, 0] >= 0).all()
    np.testing.assert_allclose(found.weight[found.known].sum(axis=1, dtype=float), 1, atol=5e-3)
    assert sum(found.coverage.values()) <= 1 + 1e-3


def test_charts_do_not_bleed_into_each_other():
    surface = torus()
    laid = parameterize(surface)
    taken = around(surface, SIX)
    truth = true_texture(surface, laid, 192)
    error = {}
    for blend in ("none", "spline"):
        found = combine_photographs(surface, laid, taken, 192, blend=blend)
        error[blend] = np.sqrt(np.mean((found.image - truth)[found.known] ** 2))
    assert laid.charts > 3
    assert error["spline"] < error["none"] + 0.01


def test_a_difference_of_exposure_leaves_no_border():
    surface = sphere(3)
    laid = parameterize(surface)
    cameras = [p.camera for p in around(surface, SIX)]
    factors = (1, 1.5) * 3
    taken = [replace(seen_by(surface, c, exposure=f), name=str(i)) for i, (c, f) in enumerate(zip(cameras, factors, strict=True))]
    steps = {
        (b, e): border_step(combine_photographs(surface, laid, taken, 256, blend=b, exposure=e))
        for b, e in (("none", False), ("spline", False), ("spline", True))
    }
    assert steps["none", False] > 5
    assert steps["spline", False] < 0.5 * steps["none", False]
    assert steps["spline", True] < 1.1


def test_one_layer_comes_back_from_the_spline(device):
    rng = np.random.default_rng(2)
    color = rng.random((40, 56, 3)).astype(np.float32)
    defined = np.ones((40, 56), bool)
    defined[:, 50:] = False
    spline = SplineBlend((40, 56), device)
    spline.add(color, defined, defined.astype(np.float32))
    np.testing.assert_allclose(spline.result()[defined], color[defined], atol=2e-6)


def test_values_are_continued_everywhere(device):
    color = np.full((64, 300, 3), 0.3, np.float32)
    defined = np.zeros((64, 300), bool)
    defined[:, :20] = True
    np.testing.assert_allclose(continue_image(color * defined[:, :, None], defined, device), 0.3, atol=1e-5)


def test_sampling_averages_over_a_texels_footprint():
    surface = grid(2, 2)
    uv = surface.vertices[:, :2]
    up, front = np.array([0, 1.0, 0]), np.array([0, 0, 1.0])
    camera = camera_towards(np.array([0.5, 0.5, 0]), front, up, 4.0, focal=4 * 256, size=(300, 300))
    rng = np.random.default_rng(3)
    noise = rng.random((300, 300, 3)).astype(np.float32)
    taken = [Photograph(camera=camera, picture=noise)]
    coarse = combine_photographs(surface, uv, taken, 16, blend="none", background=None)
    whole = noise[22:278, 22:278].reshape(16, 16, 16, 16, 3).mean(axis=(1, 3))
    # A texel is 16 pixels wide: nearly the mean of 256 pixels, where single samples would spread by 0.29.
    assert np.abs(coarse.image - whole).std() < 0.02
    fine = combine_photographs(surface, uv, taken, 256, blend="none", background=None, exposure=False)
    assert np.abs(fine.image - noise[22:278, 22:278]).std() < 0.03


def test_threads_change_no_bits(ball):
    surface, laid, taken = ball
    found = []
    for count in (1, 2):
        set_threads(count)
        found.append(combine_photographs(surface, laid, taken, 64).image)
    set_threads(None)
    np.testing.assert_array_equal(*found)


def test_what_no_photograph_saw_is_restored_and_marked(ball):
    surface, laid, taken = ball
    made = combine_photographs(surface, laid, taken[4:5], 128)
    whole = restore_texture(made)
    np.testing.assert_array_equal(whole.image[made.known], made.image[made.known])
    np.testing.assert_array_equal(whole.known, made.known)
    assert np.isfinite(whole.image).all()
    assert made.known.sum() < 0.6 * made.inside.sum()


@pytest.mark.parametrize("suffix", [".glb", ".gltf", ".obj"])
def test_textured_meshes_are_written_and_read(ball, tmp_path, suffix):
    import trimesh

    surface, laid, taken = ball
    made = combine_photographs(surface, laid, taken[:2], 64)
    written = write_textured(surface, laid, made, tmp_path / f"a ball{suffix}")
    assert all(p.exists() for p in written)
    assert sorted(tmp_path.iterdir()) == sorted(written)
    loaded = trimesh.load(written[0], process=False)
    loaded = next(iter(loaded.geometry.values())) if isinstance(loaded, trimesh.Scene) else loaded
    assert len(loaded.faces) == len(surface.faces)
    np.testing.assert_allclose(loaded.vertices[loaded.faces], surface.vertices[surface.faces], atol=1e-6)
    np.testing.assert_allclose(loaded.visual.uv[loaded.faces], laid.uv[laid.faces], atol=1e-5)
    levels = np.round(read_image(written[-1], linear=True) * 255)
    np.testing.assert_array_equal(levels, coverage_levels(made))
    assert set(np.unique(levels)) <= {0, 1, 2, 3}


def test_a_left_out_view_is_close(ball):
    surface, laid, _ = ball
    taken = around(surface, [*SIX, (0.6, 0.5, 0.7)])
    made = combine_photographs(surface, laid, taken[:6], 256)
    found = compare_with_photograph(surface, laid, made.image, made.known, taken[6], samples=8)
    assert found.psnr > 32
    assert found.comparison.ssim > 0.95


def test_camera_files_of_all_kinds_agree(tmp_path):
    rng = np.random.default_rng(5)
    write_image(rng.random((48, 64, 3)), tmp_path / "a.png")
    write_image(rng.random((48, 64, 3)), tmp_path / "b.png")
    turn = camera_towards(np.zeros(3), np.array([0.3, 0.4, 1]), np.array([0, 1.0, 0]), 5, focal=80, size=(48, 64)).R
    k, t = np.array([[80, 0, 31.5], [0, 80, 23.5], [0, 0, 1]]), np.array([0.1, -0.2, 5])
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    center = -turn.T @ t
    flip = np.diag([1, -1, -1])
    views = [{"image": "a.png", "K": k.tolist(), "R": turn.tolist(), "t": t.tolist(), "width": 64, "height": 48}]
    (tmp_path / "list.json").write_text(json.dumps(views))
    named = {"a": {"K": k.tolist(), "R": turn.tolist(), "C": center.tolist()}, "b": {**views[0], "present": False}}
    (tmp_path / "named.json").write_text(json.dumps(named))
    (tmp_path / "m_par.txt").write_text("1\na.png " + " ".join(f"{v:.12g}" for v in (*k.reshape(-1), *turn.reshape(-1), *t)))
    (tmp_path / "v.nvm").write_text(f"NVM_V3\n\n1\na.png 80 {w} {x} {y} {z} {' '.join(map(str, center))} 0 0\n")
    rows = "\n".join(" ".join(map(str, r)) for r in flip @ turn)
    moved = " ".join(map(str, flip @ t))
    (tmp_path / "bundle.out").write_text(f"# Bundle file v0.3\n2 0\n80 0 0\n{rows}\n{moved}\n" + "0 0 0\n" * 5)
    (tmp_path / "list.txt").write_text("a.png\nb.png\n")
    colmap = tmp_path / "colmap"
    colmap.mkdir()
    (colmap / "cameras.txt").write_text("# cameras\n1 PINHOLE 64 48 80 80 32 24\n")
    (colmap / "images.txt").write_text(f"# images\n1 {w} {x} {y} {z} {t[0]} {t[1]} {t[2]} 1 a.png\n\n")
    points = rng.random((10, 3))
    wanted = Camera(K=k, R=turn, t=t).project(points)[0]
    for path in ("list.json", "named.json", "m_par.txt", "v.nvm", "bundle.out", "colmap"):
        found = read_photographs(tmp_path / path, images=tmp_path)
        assert len(found) == 1
        np.testing.assert_allclose(found[0].camera.project(points)[0], wanted, atol=1e-6, err_msg=path)
        assert found[0].image.shape == (48, 64, 3)


VIEW = {"image": "a.png", "K": [[80, 0, 32], [0, 80, 24], [0, 0, 1]], "R": np.eye(3).tolist(), "t": [0, 0, 5]}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"R": (2 * np.eye(3)).tolist()}, "not a rotation"),
        ({"R": np.diag([1, 1, -1.0]).tolist()}, "reflection"),
        ({"R": [[1, 0], [0, 1]]}, "3 x 3"),
        ({"K": [[80, 0, 32], [5, 80, 24], [0, 0, 1]]}, "upper triangular"),
        ({"t": None}, "t"),
        ({"image": "missing.png"}, "missing.png"),
    ],
)
def test_bad_views_are_named(tmp_path, change, message):
    write_image(np.zeros((48, 64, 3)), tmp_path / "a.png")
    (tmp_path / "cameras.json").write_text(json.dumps([{**VIEW, **change}]))
    with pytest.raises((InputError, FileError), match=message):
        read_photographs(tmp_path / "cameras.json")


@pytest.mark.parametrize("content", ["", "{", "[]", "3", '{"a": {}}', "[{}]", '[{"image": 3}]'])
def test_bad_camera_files_are_named(tmp_path, content):
    (tmp_path / "cameras.json").write_text(content)
    with pytest.raises((InputError, FileError), match=r"cameras\.json"):
        read_photographs(tmp_path / "cameras.json")


def test_photographs_of_another_size_are_named():
    surface = sphere(1)
    photograph = around(surface, [(0, 0, 1)])[0]
    small = replace(photograph, picture=photograph.picture[:40])
    with pytest.raises(InputError, match="72 x 40"):
        bind_photographs(surface, [small])
    unsized = replace(small.camera, size=None, K=[[80, 0, 300], [0, 80, 30], [0, 0, 1]])
    with pytest.raises(InputError, match="principal point"):
        bind_photographs(surface, [replace(small, camera=unsized)])


def test_a_camera_that_looks_away_is_left_out_with_a_warning():
    surface = sphere(2)
    taken = around(surface, [(0, 0, 1), (1, 0, 0)])
    turn = np.diag([-1, 1, -1]) @ taken[1].camera.R
    away = replace(taken[1].camera, R=turn, t=-turn @ taken[1].camera.center)
    with pytest.warns(IntaglioWarning, match="view 1"):
        found = bind_photographs(surface, [taken[0], replace(taken[1], camera=away)])
    assert not found.valid[1].any()
    with pytest.warns(IntaglioWarning), pytest.raises(InputError, match="same coordinates"):
        bind_photographs(surface, [replace(taken[1], camera=away)])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"size": 4}, "size"),
        ({"size": "large"}, "size"),
        ({"select": "all"}, "select"),
        ({"binding": True}, "binding must be"),
        ({"blend": "poisson"}, "blend"),
        ({"uv": np.full((642, 2), 3.0)}, "in \\[0, 1\\]"),
        ({"uv": np.zeros((5, 2))}, "uv must be"),
        ({"photographs": []}, "no photographs"),
        ({"photographs": [3]}, "Photograph"),
    ],
)
def test_bad_arguments_are_named(ball, change, message):
    surface, laid, taken = ball
    arguments = {"surface": surface, "uv": laid, "photographs": taken, "size": 64, **change}
    with pytest.raises(InputError, match=message):
        combine_photographs(**arguments)


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda s, uv, t, p: border_step(t.image), "texture"),
        (lambda s, uv, t, p: border_step(replace(t, known=t.known[1:])), "known"),
        (lambda s, uv, t, p: border_step(replace(t, weight=t.weight[:, :, 0])), "weight"),
        (lambda s, uv, t, p: restore_texture(None), "texture"),
        (lambda s, uv, t, p: restore_texture(replace(t, chart=t.chart[:, :5])), "chart"),
        (lambda s, uv, t, p: write_textured(s, uv, t.image, "never.glb"), "texture"),
        (lambda s, uv, t, p: write_textured(s, uv.uv, t, "never.glb"), "uv"),
        (lambda s, uv, t, p: write_textured(s.vertices, uv, t, "never.glb"), "surface"),
        (lambda s, uv, t, p: write_textured(s, uv, t, 3), "path"),
        (lambda s, uv, t, p: write_textured(sphere(1), uv, t, "never.glb"), "another surface"),
        (lambda s, uv, t, p: compare_with_photograph(s, uv, t.known.view(np.matrix), t.known, p), "image"),
        (lambda s, uv, t, p: compare_with_photograph(s, uv, t.image, t.known[:5].view(np.matrix), p), "known"),
        (lambda s, uv, t, p: compare_with_photograph(s, uv, t.image * np.nan, t.known, p), "image"),
        (lambda s, uv, t, p: compare_with_photograph(s, uv, t.image, t.known, p.camera), "photograph"),
        (lambda s, uv, t, p: compare_with_photograph(sphere(1), uv, t.image, t.known, p), "another surface"),
        (lambda s, uv, t, p: compare_with_photograph(s, uv, t.image, t.known, p, reduce=0), "reduce"),
        (lambda s, uv, t, p: compare_with_photograph(s, uv, t.image, t.known, p, reduce=500), "reduce"),
        (lambda s, uv, t, p: compare_with_photograph(s, uv, t.image, t.known, p, samples=2.5), "samples"),
        (lambda s, uv, t, p: compare_with_photograph(s, uv, t.image, t.known, p, seed=-1), "seed"),
    ],
)
def test_what_is_no_texture_or_photograph_is_named(ball, call, name):
    surface, laid, taken = ball
    made = combine_photographs(surface, laid, taken[:2], 32)
    with pytest.raises(InputError, match=name):
        call(surface, laid, made, taken[0])


def test_matrices_of_numpy_are_arrays(ball):
    surface, laid, taken = ball
    made = combine_photographs(surface, laid, taken, 64)
    found = compare_with_photograph(surface, laid, made.image, made.known.view(np.matrix), taken[0], samples=2)
    assert found.comparison.ssim > 0.9
    grey = Photograph(camera=taken[0].camera, picture=np.full((72, 72), 0.5).view(np.matrix))
    assert grey.image.shape == (72, 72, 3)


@pytest.mark.parametrize("option", [{"background": None}, {"background_threshold": 0.1}, {"grazing": 70}])
def test_options_of_a_new_binding_are_refused_beside_a_given_one(ball, option):
    surface, uv, taken = ball
    binding = bind_photographs(surface, taken)
    with pytest.raises(InputError, match="leave them out with a binding"):
        combine_photographs(surface, uv, taken, 64, binding=binding, **option)


def test_cylinder_with_own_texture_positions(device):
    surface = cylinder(48, 24)
    angle = np.arctan2(surface.vertices[:, 1], surface.vertices[:, 0]) / (2 * np.pi) % 1
    corner = angle[surface.faces]
    corner = np.where((np.ptp(corner, axis=1) > 0.5)[:, None] & (corner < 0.5), corner + 1, corner)
    uv = np.stack([corner * 0.95, surface.vertices[surface.faces][:, :, 2] / 4], axis=2)
    moved = Surface(vertices=surface.vertices * (1, 1, 0.5) - (0, 0, 1), faces=surface.faces)
    found = combine_photographs(moved, uv, around(moved, [(1, 0, 0.1), (-0.5, 0.8, 0)]), 64, device=device)
    assert 0.3 < found.known.mean() < 1


def test_real_temple(real, tmp_path, run):
    folder = real("multiview/middlebury_templeSparseRing")
    photographs = read_photographs(folder / "templeSR_par.txt")
    same = read_photographs(folder / "cameras.json")
    points = np.random.default_rng(1).random((5, 3)) * 0.1
    for one, other in zip(photographs, same, strict=True):
        np.testing.assert_allclose(one.camera.project(points)[0], other.camera.project(points)[0], atol=1e-3)
