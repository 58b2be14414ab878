"""Lenses: their formulas against OpenCV and COLMAP, their inverses, how far they reach, and photographs taken through them."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import grid, sphere
from test_photographs import around, color_at, seen_by

from intaglio import Camera, InputError, bind_photographs, combine_photographs, compare_with_photograph, parameterize
from intaglio.kernels.surface_views import SurfaceViews
from intaglio.photographs.lens import MODELS, coefficient_names
from intaglio.scenes.photographs import camera_towards

K = np.array([[500, 0, 320], [0, 510, 239.75], [0, 0, 1]])
POINTS = np.array([[0.3, -0.2, 1.0], [-0.5, 0.4, 1.2], [0.7, 0.6, 1.5], [0.02, 0.9, 2.0]])

# Coefficients such as calibrations have.
TYPICAL = {
    "opencv": [-0.11, 0.02, 0.003, -0.002, 0.01, 0.05, -0.01, 0.002, 0.001, -0.002, 0.003, 0.0005],
    "brown": [-0.12, 0.06, -0.02, 0.004, 0.002, -0.001],
    "fisheye": [0.02, -0.01, 0.003, -0.001],
    "thin_prism_fisheye": [0.02, -0.01, 0.001, -0.002, 0.003, -0.001, 0.002, -0.003],
    "rad_tan_thin_prism_fisheye": [0.02, -0.01, 0.003, -0.001, 0.0005, -0.0002, 0.001, -0.002, 0.002, -0.003, 0.0015, 0.001],
    "fov": [0.9],
    "division": [-0.2],
    "eucm": [0.6, 1.1],
    "inverse": [-0.1],
}


def through(model, distortion, k=K):
    return Camera(K=k, R=np.eye(3), t=np.zeros(3), model=model, distortion=distortion)


def ahead(count, wide=0.8):
    """Return points in front of the camera, one on its axis and one next to it."""
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform(-wide, wide, (count, 2)), np.ones((count, 1))], axis=1) * rng.uniform(1, 3, (count, 1))
    points[:2] = [[0, 0, 2], [1e-7, 0, 1]]
    return points


# cv2.projectPoints and cv2.fisheye.projectPoints of OpenCV 5.0.
@pytest.mark.parametrize(
    ("model", "count", "wanted"),
    [
        (
            "opencv",
            12,
            [
                [466.535933018561, 140.451983047378],
                [119.506044583492, 404.062672509917],
                [540.346653239834, 433.878241171165],
                [324.716863143478, 463.418157493434],
            ],
        ),
        (
            "opencv",
            5,
            [
                [467.4189955, 139.61558306],
                [116.757075250012, 405.799518262657],
                [544.175513488797, 436.651734650206],
                [324.703790479679, 465.263301017257],
            ],
        ),
        (
            "fisheye",
            4,
            [
                [464.289083278447, 141.633423370656],
                [127.808230721833, 396.578483730984],
                [530.31141936575, 423.622269502627],
                [324.713624773942, 456.105377123918],
            ],
        ),
    ],
)
def test_projection_is_opencvs(model, count, wanted):
    pixel, _ = through(model, TYPICAL[model][:count]).project(POINTS)
    np.testing.assert_allclose(pixel, wanted, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "model", "own"),
    [
        ("OPENCV", "opencv", TYPICAL["opencv"][:4]),
        ("FULL_OPENCV", "opencv", TYPICAL["opencv"][:8]),
        ("OPENCV_FISHEYE", "fisheye", TYPICAL["fisheye"]),
        ("THIN_PRISM_FISHEYE", "thin_prism_fisheye", None),
        ("RAD_TAN_THIN_PRISM_FISHEYE", "rad_tan_thin_prism_fisheye", None),
        ("FOV", "fov", None),
        ("FOV", "fov", [0.2]),
        ("DIVISION", "division", None),
        ("DIVISION", "division", [0.05]),
        ("EUCM", "eucm", None),
        ("FISHEYE", "fisheye", []),
    ],
)
def test_projection_is_colmaps(name, model, own):
    pycolmap = pytest.importorskip("pycolmap")
    terms = TYPICAL[model] if own is None else own
    points = ahead(300)
    wanted = pycolmap.Camera(model=name, width=640, height=480, params=[500, 510, 320.5, 240.25, *terms]).img_from_cam(points)
    pixel, _ = through(model, terms).project(points)
    np.testing.assert_allclose(pixel, wanted - 0.5, atol=1e-6)


def test_visualsfms_lens_is_the_inverse_of_a_polynomial():
    for k in (-0.1, 0.2):
        moved = through("inverse", [k], np.eye(3)).project(ahead(100))[0]
        s = np.sum(moved**2, axis=1, keepdims=True)
        np.testing.assert_allclose(moved * (1 + k * s), ahead(100)[:, :2] / ahead(100)[:, 2:], atol=1e-12)


def test_metashapes_fourth_coefficient_is_a_power_more():
    x, y = 0.4, -0.3
    pixel, _ = through("brown", [0, 0, 0, 0.5], np.eye(3)).project(np.array([[x, y, 1.0]]))
    np.testing.assert_allclose(pixel[0], np.array([x, y]) * (1 + 0.5 * 0.25**4), rtol=1e-14)


@pytest.mark.parametrize("model", MODELS)
def test_pixels_look_back_at_what_they_show(model):
    camera = Camera(K=[[500, 3, 320], [0, 510, 240], [0, 0, 1]], R=np.diag([1.0, -1, -1]), t=[0.1, -0.2, 0.3])
    camera = Camera(K=camera.K, R=camera.R, t=camera.t, model=model, distortion=TYPICAL[model])
    points = (ahead(300) - camera.t) @ camera.R
    way = points - camera.center
    found = camera.unproject(camera.project(points)[0])
    np.testing.assert_allclose(found, way / np.linalg.norm(way, axis=1, keepdims=True), atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_kernels_distort_as_the_camera_does(model, device):
    camera = through(model, TYPICAL[model])
    points = ahead(200)
    views = SurfaceViews(points, points, np.array([[0, 1, 2]]), device)
    pinhole = views.pinhole(camera.K, camera.R, camera.t, camera.lens, camera.reach)
    pixel, _ = views.visible(pinhole, (640, 480), 1e-3)
    np.testing.assert_allclose(pixel, camera.project(points)[0], atol=2e-3)


@pytest.mark.parametrize(
    ("model", "terms", "reach"),
    [
        ("opencv", [-1 / 3], 1.0),
        ("brown", [0, 0, 0, -1 / 9], 1.0),
        ("fisheye", [-1 / 3 / 0.25], np.tan(0.5) ** 2),
        ("division", [0.25], 1.0),
        ("inverse", [-4 / 27], 1.0),
        # A pole of the rational factor.
        ("opencv", [0, 0, 0, 0, 0, -1.0], None),
    ],
)
def test_what_a_lens_folds_over_is_not_seen(model, terms, reach):
    camera = through(model, terms)
    assert camera.reach == pytest.approx(reach) if reach else camera.reach <= 1.0
    far = np.sqrt(camera.reach)
    points = np.array([[0.98 * far, 0, 1], [0, 1.02 * far, 1], [3 * far, 3 * far, 1]])
    pixel = camera.project(points)[0]
    assert np.isfinite(pixel[0]).all()
    assert np.isnan(pixel[1:]).all()
    assert np.isnan(camera.unproject(np.array([[1e6, 1e6]]))).all()
    views = SurfaceViews(points, points, np.array([[0, 1, 2]]), "cpu")
    seen = views.visible(views.pinhole(camera.K, camera.R, camera.t, camera.lens, camera.reach), (10**4, 10**4), 1e-3)[1]
    assert not seen[1:].any()


def test_tangential_terms_that_fold_limit_the_reach():
    camera = through("brown", [0, 0, 0, 0, 0.2, 0])
    assert 0 < camera.reach < np.inf
    # x' = x + 2 p1 x y, y' = y + p1 (x^2 + 3 y^2): folds first at y = -1 / (6 p1).
    assert np.sqrt(camera.reach) == pytest.approx(1 / 1.2, rel=0.07)
    assert np.sqrt(camera.reach) <= 1 / 1.2


def test_lenses_that_do_nothing_are_pinholes():
    for model in MODELS:
        assert through(model, []).distorts == ("fisheye" in model)
    points = ahead(50)
    for model in ("fov", "division", "eucm", "inverse", "brown"):
        np.testing.assert_allclose(through(model, []).project(points)[0], through("opencv", []).project(points)[0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"model": "plumb_bob"}, "model must be one of"),
        ({"model": None}, "model"),
        ({"distortion": [1] * 13}, "up to 12 coefficients"),
        ({"distortion": [[0.1]]}, "coefficients"),
        ({"distortion": [np.nan]}, "distortion"),
        ({"distortion": [1e20]}, "k1 is out of range"),
        ({"distortion": "k1"}, "distortion"),
        ({"distortion": [0.1j]}, "distortion"),
        ({"model": "fov", "distortion": [4]}, "omega"),
        ({"model": "eucm", "distortion": [2, 1]}, "alpha"),
    ],
)
def test_bad_lenses_are_named(change, message):
    with pytest.raises(InputError, match=message):
        Camera(**{"K": K, "R": np.eye(3), "t": np.zeros(3), **change})


def test_points_and_pixels_are_checked():
    camera = through("opencv", [])
    for wrong in (np.zeros(3), np.full((2, 3), np.nan), "points", np.zeros((2, 2))):
        with pytest.raises(InputError, match="points"):
            camera.project(wrong)
    for wrong in (np.zeros(2), np.full((2, 2), np.inf), np.zeros((2, 3))):
        with pytest.raises(InputError, match="pixel"):
            camera.unproject(wrong)


@pytest.mark.parametrize("model", ["brown", "fisheye", "fov"])
def test_photographs_through_a_lens_give_the_texture(model):
    surface = grid(24, 24)
    camera = camera_towards(
        np.array([0.5, 0.5, 0]), np.array([0.1, -0.2, 1]), np.array([0, 1.0, 0]), 1.0, focal=90, size=(120, 120)
    )
    bent = Camera(K=camera.K, R=camera.R, t=camera.t, size=camera.size, model=model, distortion=TYPICAL[model])
    photograph = seen_by(surface, bent)
    made = combine_photographs(surface, surface.vertices[:, :2], [photograph], 64, blend="none")
    v, u = (np.mgrid[:64, :64] + 0.5) / 64
    # Away from the border, where photographs also show what is beside the surface.
    inner = (np.abs(u - 0.5) < 0.4) & (np.abs(v - 0.5) < 0.4)
    error = np.abs(made.image - color_at(np.stack([u, 1 - v, 0 * u], axis=-1)))[made.known & inner]
    assert made.known.mean() > 0.85
    assert error.max() < 0.03
    # As a pinhole, it would show other places.
    straight = combine_photographs(
        surface, surface.vertices[:, :2], [type(photograph)(camera=camera, picture=photograph.picture)], 64, blend="none"
    )
    wrong = np.abs(straight.image - color_at(np.stack([u, 1 - v, 0 * u], axis=-1)))[straight.known & inner]
    assert wrong.max() > 4 * error.max()


def test_a_left_out_view_through_a_lens_is_undistorted_first():
    surface = sphere(3)
    laid = parameterize(surface)
    taken = around(surface, [(0, 0.2, 1), (0.3, 0.1, 1), (-0.3, 0.1, 1), (0.1, 0.5, 1), (0.1, -0.4, 1)])
    made = combine_photographs(surface, laid, taken, 256)
    plain = taken[0].camera
    bent = Camera(K=plain.K, R=plain.R, t=plain.t, size=plain.size, distortion=[-1.5, 4.0, 0.02, 0.01])
    assert bind_photographs(surface, [seen_by(surface, bent)]).valid.any()
    found = compare_with_photograph(surface, laid, made.image, made.known, seen_by(surface, bent), samples=8)
    assert found.psnr > 30
    assert found.comparison.ssim > 0.9


def test_coefficients_have_names():
    assert [len(coefficient_names(model)) for model in MODELS] == [12, 6, 6, 8, 12, 1, 1, 2, 1]
