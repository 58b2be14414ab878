"""Extension of geometry textures: exact facts, quality on small swatches, provenance, tiling, bad settings."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
import pytest
from scipy.spatial import cKDTree

from intaglio import (
    GeometryTexture,
    InputError,
    IntaglioWarning,
    PairingWeights,
    PatchFit,
    PointSet,
    assess_geometry,
    extend_geometry,
    geometry_from_points,
)
from intaglio.geometry.fitting import PatchFitter
from intaglio.geometry.growth import Growth
from intaglio.geometry.layout import lay_out
from intaglio.kernels.launch import set_threads
from intaglio.scenes.connections import broken_threads, closed_rings
from intaglio.scenes.swatches import chain_mail, weave


def grid_sheet(side=40, amplitude=0.0, period=8.0):
    """A square sheet of points a unit apart, with waves along both axes."""
    x, y = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float), indexing="ij")
    k = 2 * np.pi / period
    z = amplitude * np.sin(k * x) * np.sin(k * y)
    slope = amplitude * k * np.stack([np.cos(k * x) * np.sin(k * y), np.sin(k * x) * np.cos(k * y)])
    normals = np.stack([-slope[0], -slope[1], np.ones_like(x)], axis=-1).reshape(-1, 3)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), normals


@pytest.fixture(scope="session")
def cloth():
    """A small weave of touching threads."""
    points, normals, _ = weave(7, 0.1)
    low, high = points[:, 2].min(), points[:, 2].max()
    with warnings.catch_warnings():
        # Its threads do touch here and there.
        warnings.simplefilter("ignore", IntaglioWarning)
        return geometry_from_points(points, normals, bounds=np.array([[0, 0, low], [6, 6, high]]), axis="z")


def test_a_flat_swatch_gives_a_flat_output(device):
    points, normals = grid_sheet()
    made = extend_geometry(geometry_from_points(points, normals), (60, 45), 12, device=device)
    np.testing.assert_allclose(made.points[:, 2], 0, atol=1e-5)
    np.testing.assert_allclose(made.normals, np.tile([0, 0, 1.0], (len(made), 1)), atol=1e-4)
    assert (made.points[:, :2] >= 0).all()
    assert (made.points[:, :2] < (60, 45)).all()
    # As dense as the swatch, everywhere.
    assert len(made) == pytest.approx(60 * 45, rel=0.08)
    assert cKDTree(made.points).query(np.random.default_rng(0).uniform(2, 43, (500, 3)) * (1, 1, 0))[0].max() < 1.5


def test_a_wave_goes_on_where_it_should():
    points, normals = grid_sheet(80, 2.0, 16.0)
    made = extend_geometry(geometry_from_points(points, normals), (110, 90), 24, seed=2)
    # The output's phase is that of its first patch.
    k = 2 * np.pi / 16
    basis = np.stack([f(k * made.points[:, 0]) * g(k * made.points[:, 1]) for f in (np.sin, np.cos) for g in (np.sin, np.cos)], 1)
    fitted, *_ = np.linalg.lstsq(basis, made.points[:, 2])
    residual = made.points[:, 2] - basis @ fitted
    assert np.sqrt((residual**2).mean()) < 0.1
    assert np.linalg.norm(fitted) == pytest.approx(2, abs=0.05)


def test_threads_that_enter_leave_and_samples_stay_even(cloth, device):
    made = extend_geometry(cloth, (11, 10), 3.2, seed=1, device=device)
    threads, broken = broken_threads(made, cloth.spacing)
    assert threads >= 19
    assert broken == 0
    report = assess_geometry(made, cloth, device=device)
    assert report.nearest == pytest.approx(1, abs=0.1)
    assert report.holes < 0.005
    assert report.normal_angle < 10
    assert report.step < 0.5
    assert len(report.lines()) == 5


def test_rings_of_mail_stay_closed():
    points, normals, _ = chain_mail(6, 12, 0.11)
    low, high = points[:, 2].min(), points[:, 2].max()
    texture = geometry_from_points(points, normals, bounds=np.array([[1.3, 0.6, low], [12.5, 7.2, high]]), axis="z")
    made = extend_geometry(texture, (16, 11), 4.8, seed=0)
    rings, closed = closed_rings(made, texture.spacing, 1.0)
    assert rings > 50
    assert closed / rings >= 0.97
    rings, closed = closed_rings(PointSet(points, normals), texture.spacing, 1.0)
    assert rings == closed


def test_warp_and_blend_close_steps(cloth):
    plain = assess_geometry(extend_geometry(cloth, 9, 3.2, fit=PatchFit(warp=False, blend=False), relax=0), cloth)
    blended = assess_geometry(extend_geometry(cloth, 9, 3.2, fit=PatchFit(warp=False), relax=0), cloth)
    both = assess_geometry(extend_geometry(cloth, 9, 3.2), cloth)
    assert blended.step < 0.7 * plain.step
    assert both.step < 0.5 * plain.step
    assert both.step_high < 0.7 * plain.step_high


def test_the_warp_brings_patches_onto_what_is_there(cloth, monkeypatch):
    apart = {True: [], False: []}
    blend = PatchFitter._blend

    def measure(self, places, old, surface, new, group):
        share = np.concatenate([p.share_of_old(*new["point"][group == b, :2].T) for b, p in enumerate(places)])
        at = share > 0.3
        feet = surface.project(new["point"][at], facing=new["normal"][at], group=group[at], reach=1.0)
        apart[self.settings.fit.warp].append(np.abs(((feet.points - new["point"][at]) * feet.normals).sum(axis=1))[feet.found])
        return blend(self, places, old, surface, new, group)

    monkeypatch.setattr(PatchFitter, "_blend", measure)
    for warp in (True, False):
        extend_geometry(cloth, 9, 3.2, fit=PatchFit(warp=warp), relax=0)
    gap = {warp: np.median(np.concatenate(parts)) / cloth.spacing for warp, parts in apart.items()}
    assert gap[True] < 0.5 * gap[False]
    assert gap[True] < 0.15


def test_every_point_tells_where_it_comes_from(cloth):
    made = extend_geometry(cloth, 8, 3.2, relax=0, seed=3)
    assert made.source.min() >= 0
    assert made.source.max() < len(cloth.points)
    # Without the move, a patch's points are the swatch's, shifted by one vector in the plane and none in height.
    for patch in np.unique(made.patch):
        of = made.patch == patch
        shift = made.points[of] - cloth.points.points[made.source[of]]
        typical = np.median(shift, axis=0)
        assert np.abs(typical[2]) < 0.1
        away = np.linalg.norm(shift - typical, axis=1)
        assert np.quantile(away, 0.9) < np.quantile(made.moved[of], 0.9) + 4 * cloth.spacing
    plain = extend_geometry(cloth, 8, 3.2, relax=0, seed=3, fit=PatchFit(warp=False, blend=False))
    np.testing.assert_array_equal(plain.moved, 0)
    for patch in np.unique(plain.patch):
        of = plain.patch == patch
        shift = plain.points[of] - cloth.points.points[plain.source[of]]
        np.testing.assert_allclose(shift, np.tile(shift[0], (of.sum(), 1)), atol=1e-9)


def test_the_input_is_not_altered_and_the_seed_decides(cloth):
    before = cloth.points.points.copy(), cloth.points.normals.copy()
    one, two, other = (extend_geometry(cloth, (7, 6), 3.2, seed=s) for s in (5, 5, 6))
    np.testing.assert_array_equal(cloth.points.points, before[0])
    np.testing.assert_array_equal(cloth.points.normals, before[1])
    for name in ("points", "normals", "source", "moved", "patch"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    assert len(one) != len(other) or (one.source != other.source).any()


def test_one_thread_and_two_give_the_same_bits(cloth):
    found = []
    for count in (1, 2):
        set_threads(count)
        try:
            found.append(extend_geometry(cloth, (9, 8), 3.0, seed=4, tileable=False))
        finally:
            set_threads(None)
    for name in ("points", "normals", "source", "moved", "patch"):
        np.testing.assert_array_equal(getattr(found[0], name), getattr(found[1], name))


def test_patches_together_are_patches_one_by_one(cloth, monkeypatch):
    together = extend_geometry(cloth, (12, 10), 2.8, seed=7)
    monkeypatch.setattr("intaglio.geometry.growth._AT_ONCE", 1)
    alone = extend_geometry(cloth, (12, 10), 2.8, seed=7)
    np.testing.assert_array_equal(together.source, alone.source)
    np.testing.assert_array_equal(together.points, alone.points)


def test_a_tileable_output_tiles(cloth):
    tile = extend_geometry(cloth, (10, 10), 3.0, tileable=True, seed=1)
    shifts = [(10.0 * i, 10.0 * j, 0.0) for i in range(2) for j in range(2)]
    points = np.concatenate([tile.points + s for s in shifts])
    patch = np.concatenate([tile.patch + 1000 * k for k in range(4)])
    whole = PointSet(points, np.tile(tile.normals, (4, 1)), patch=patch)
    report = assess_geometry(whole, cloth)
    assert report.step < 0.5
    assert report.holes < 0.005
    threads, broken = broken_threads(whole, cloth.spacing)
    assert threads >= 40
    assert broken == 0
    plain = extend_geometry(cloth, (10.4, 10.4), 3.0, seed=1)
    cut = [plain.points + np.multiply(s, 1.04) for s in shifts]
    patch = np.concatenate([plain.patch + 1000 * k for k in range(4)])
    untiled = assess_geometry(PointSet(np.concatenate(cut), np.tile(plain.normals, (4, 1)), patch=patch), cloth)
    assert untiled.holes > 3 * report.holes


@pytest.mark.parametrize("overlap", [0.6, 1.2, 1.5])
def test_tileable_boxes_replace_nothing_past_the_period_but_by_overlapping_it(overlap):
    for size in (6.7, 8.7, 12.0, 13.1):
        layout = lay_out(np.array([size, size]), np.array([3.0, 3.0]), overlap, 0.75, 0.5, tileable=True)
        for place in layout.places:
            for axis in range(2):
                past = place.high[axis] - size
                assert past <= place.overlap[axis + 2] + 1e-9


def test_a_wave_goes_on_across_the_border_of_a_tile():
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(70.0), np.arange(70.0), indexing="ij")
    waves = [(rng.uniform(-0.5, 0.5, 2), rng.uniform(0, 6.3)) for _ in range(12)]
    z = sum(np.cos(k[0] * x + k[1] * y + phase) for k, phase in waves) / 2
    dx, dy = np.gradient(z)
    normals = np.stack([-dx, -dy, np.ones_like(z)], axis=-1).reshape(-1, 3)
    texture = geometry_from_points(np.stack([x, y, z], axis=-1).reshape(-1, 3), normals)
    for settings in ({}, {"overlap": 8.0}, {"max_error": 0.0}):
        tile = extend_geometry(texture, 64, 16, tileable=True, **settings)
        points = np.concatenate([tile.points + (64 * i, 64 * j, 0) for i in range(2) for j in range(2)])
        patch = np.concatenate([tile.patch + 1000 * k for k in range(4)])
        report = assess_geometry(PointSet(points, np.tile(tile.normals, (4, 1)), patch=patch), texture)
        assert report.step_high < 0.6, settings


def test_sizes_just_above_a_patch_take_no_longer(cloth):
    made = extend_geometry(cloth, 3.2 - 2 * 0.8 + 1e-4, 3.2)
    assert len(made) > 100


@pytest.mark.parametrize("axis", [0, 1])
def test_the_height_axis_may_be_any(cloth, axis):
    order = np.roll(np.arange(3), 2 - axis)
    back = np.argsort(order)
    turned = GeometryTexture(
        PointSet(cloth.points.points[:, back], cloth.points.normals[:, back]), cloth.bounds[:, back], axis, cloth.spacing
    )
    assert [*turned.plane_axes, turned.axis] == order.tolist()
    made, wanted = extend_geometry(turned, (6, 5), 3.0), extend_geometry(cloth, (6, 5), 3.0)
    np.testing.assert_array_equal(made.points[:, order], wanted.points)
    np.testing.assert_array_equal(made.normals[:, order], wanted.normals)


def test_survey_coordinates_and_units_change_nothing(cloth):
    wanted = extend_geometry(cloth, (6, 5), 3.0)
    moved = dataclasses.replace(
        cloth,
        points=PointSet(cloth.points.points * 1024 + (5e5, 4e6, 100), cloth.points.normals),
        bounds=cloth.bounds * 1024 + (5e5, 4e6, 100),
        spacing=cloth.spacing * 1024,
    )
    made = extend_geometry(moved, (6 * 1024, 5 * 1024), 3.0 * 1024)
    assert len(made) == pytest.approx(len(wanted), rel=0.02)
    assert np.ptp(made.points[:, 2]) == pytest.approx(1024 * np.ptp(wanted.points[:, 2]), rel=0.02)
    assert made.points[:, 2].min() == pytest.approx(100 + 1024 * wanted.points[:, 2].min(), abs=20)


def test_a_patch_that_fits_badly_is_divided_and_its_place_told(cloth):
    made = extend_geometry(cloth, 8, 3.2, max_error=1e-3)
    told = [n for n in made.notes if "no candidate" in n]
    assert told
    assert any("four smaller" in n for n in told)
    assert "the patch at" in told[0]
    whole = extend_geometry(cloth, 8, 3.2)
    assert not any("no candidate" in n for n in whole.notes)

    # No silent gap: no square of half a thread's distance, that is full elsewhere, stays empty.
    def empty(points):
        counts, *_ = np.histogram2d(points.points[:, 0], points.points[:, 1], bins=8, range=[[0, 8], [0, 8]])
        return (counts < 0.3 * np.median(counts)).sum()

    assert empty(made) == empty(whole) == 0


def test_less_padding_than_needed_shrinks_the_bounds_and_says_so():
    points, normals = grid_sheet()
    made = extend_geometry(geometry_from_points(points, normals), 30, 10)
    assert any("does not reach" in n and "shrunk" in n for n in made.notes)
    inside = geometry_from_points(points, normals, bounds=np.array([[4, 4, -1], [35, 35, 1.0]]))
    assert not any("shrunk" in n for n in extend_geometry(inside, 30, 10).notes)


def test_an_output_smaller_than_a_patch_is_cut_from_one(cloth):
    made = extend_geometry(cloth, (1.5, 1.0), 3.0)
    assert len(made)
    assert (np.unique(made.patch) == [0]).all()


def test_empty_parts_of_a_swatch_are_no_trouble():
    rng = np.random.default_rng(0)
    dots = rng.normal(size=(400, 3))
    dots /= np.linalg.norm(dots, axis=1, keepdims=True)
    centers = np.stack(np.meshgrid(np.arange(4) * 6.0, np.arange(4) * 6.0, [0.0]), axis=-1).reshape(-1, 3)
    points = np.concatenate([dots + c for c in centers])
    texture = geometry_from_points(points, np.tile(dots, (16, 1)), axis="z", bounds=np.array([[2.0, 2, -1], [16, 16, 1]]))
    made = extend_geometry(texture, 25, 3.0, fit=PatchFit(weights="flowers"))
    assert len(made) > 1000
    assert np.isfinite(made.points).all()


@pytest.mark.parametrize(
    ("size", "patch", "settings", "message"),
    [
        (8, 30, {}, "larger than the swatch's bounds"),
        (8, (3, 30), {}, "larger than the swatch's bounds"),
        (8, 5.9, {"extra": 2.0}, "kept as padding"),
        (8, 3.2, {"extra": 3.1}, "too small|kept as padding"),
        (8, 3.2, {"overlap": 2.0}, "overlap must be from"),
        (8, 3.2, {"overlap": 1e-6}, "overlap must be from"),
        (8, 3.2, {"cell": 5.0}, "cell must be from"),
        (8, 3.2, {"cell": 1e-5}, "cell must be from"),
        (8, 3.2, {"tolerance": -1}, "tolerance must be"),
        (8, 3.2, {"relax": -1}, "relax must be"),
        (8, 3.2, {"max_error": "x"}, "max_error must be"),
        (8, 3.2, {"fit": "weave"}, "fit must be a PatchFit"),
        (6, 3.2, {"tileable": True}, "too small to close"),
        (8, 3.2, {"seed": 1.5}, "seed must be"),
        (8, 3.2, {"device": "tpu"}, "not available"),
        (0, 3.2, {}, "size must be"),
        ((1, 2, 3), 3.2, {}, "size must be"),
        (float("nan"), 3.2, {}, "size must be"),
        (1e6, 3.2, {}, "more than"),
        (8, -1, {}, "patch must be"),
        (8, 3.2, {"tileable": "no"}, "tileable must be True or False"),
        (8, 0.3, {}, "patch .* is too small"),
        (1e300, 3.2, {}, "more than"),
        ("wide", 3.2, {}, "size must be"),
    ],
)
def test_bad_settings_are_told(cloth, size, patch, settings, message):
    with pytest.raises(InputError, match=message):
        extend_geometry(cloth, size, patch, **settings)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pairs": 3}, "pairs must be"),
        ({"rounds": -1}, "rounds must be"),
        ({"smoothing": 0}, "smoothing must be"),
        ({"warp": "no"}, "warp must be True or False"),
        ({"blend": 1}, "blend must be True or False"),
        ({"weights": "tweed"}, "choose auto, height field"),
        ({"weights": PairingWeights(1, 1, -1, 1)}, "length must be"),
        ({"weights": ["auto"]}, "are not known"),
    ],
)
def test_a_bad_fit_is_named_when_it_is_made(options, message):
    with pytest.raises(InputError, match=message):
        PatchFit(**options)


def test_something_else_than_a_texture_is_told():
    with pytest.raises(InputError, match="must be a GeometryTexture"):
        extend_geometry(np.zeros((10, 3)), 3)


def test_progress_ends_with_all_patches(cloth):
    seen = []
    extend_geometry(cloth, 8, 3.2, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1][0] == seen[-1][1] > 4
    assert [d for d, _ in seen] == sorted(d for d, _ in seen)


def test_an_interrupt_reaches_the_caller(cloth, monkeypatch):
    def stop(self, places, begin):
        raise KeyboardInterrupt

    monkeypatch.setattr(Growth, "_copy", stop)
    with pytest.raises(KeyboardInterrupt):
        extend_geometry(cloth, 8, 3.2)
