"""Parts of the extension of geometry textures: buckets, layout, clustering, pairing, splines, spreading, normals, sampling."""

from __future__ import annotations

import geometry_reference as reference
import numpy as np
import pytest

from intaglio.geometry.buckets import RECORD, Buckets
from intaglio.geometry.clustering import cluster
from intaglio.geometry.layout import PatchPlace, lay_out
from intaglio.geometry.normals import estimate_normals, is_height_field
from intaglio.geometry.sampling import RADIUS, local_spacing, sample_triangles, thin_points
from intaglio.geometry.spreading import spread
from intaglio.geometry.warping import most_coherent, solve_splines
from intaglio.kernels.launch import set_threads
from intaglio.kernels.pairing import PairCosts, Targets, pair_points
from intaglio.kernels.point_surface import PointSurface
from intaglio.kernels.splines import warp_points
from intaglio.scenes.swatches import chain_mail, weave


def records(points):
    made = np.zeros(len(points), RECORD)
    made["point"] = points
    made["normal"] = (0, 0, 1)
    made["source"] = np.arange(len(points))
    return made


@pytest.mark.parametrize("period", [(None, None), (4.0, None), (4.0, 3.0)])
def test_buckets_hold_what_brute_force_holds(period):
    rng = np.random.default_rng(0)
    buckets = Buckets(0.37, period)
    kept = np.zeros((0, 4))
    for turn in range(12):
        points = np.concatenate([rng.uniform(0, 3, (200, 2)), rng.random((200, 1))], axis=1)
        new = records(points)
        new["source"] += 1000 * turn
        buckets.add(new)
        kept = np.concatenate([kept, np.concatenate([points, new["source"][:, None]], axis=1)])
        low = rng.uniform(-1, 2, 2)
        high = low + rng.uniform(0.1, 1.5, 2)
        away = np.zeros(len(kept), bool)
        shown = set()
        for i in range(-2, 3):
            for j in range(-2, 3):
                if (i and period[0] is None) or (j and period[1] is None):
                    continue
                at = kept[:, :2] + (i * (period[0] or 0), j * (period[1] or 0))
                inside = ((at >= low) & (at < high)).all(axis=1)
                away |= inside
                shown |= {(int(s), round(x, 9), round(y, 9)) for (x, y), s in zip(at[inside], kept[inside, 3], strict=True)}
        found = buckets.inside(low, high)
        assert {(int(r["source"]), round(r["point"][0], 9), round(r["point"][1], 9)) for r in found} == shown
        if turn % 2:
            buckets.remove(low, high)
            kept = kept[~away]
            assert not len(buckets.inside(low, high))
        assert len(buckets) == len(kept)
    assert sorted(buckets.everything()["source"].tolist()) == sorted(kept[:, 3].astype(int).tolist())


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("size", [(5.0, 4.0), (9.3, 7.1), (20.0, 6.0)])
def test_patches_cover_the_output_and_levels_keep_scan_line_order(size, tileable):
    layout = lay_out(np.array(size), np.array([2.0, 1.6]), 0.5, 0.4, 0.45, tileable=tileable)
    assert [p.number for p in layout.places] == list(range(len(layout.places)))
    x, y = np.meshgrid(np.linspace(0, size[0], 200, endpoint=False), np.linspace(0, size[1], 150, endpoint=False))
    covered = np.zeros(x.shape, bool)
    for p in layout.places:
        for i in (-1, 0, 1) if tileable else (0,):
            for j in (-1, 0, 1) if tileable else (0,):
                at = x - p.origin[0] + i * size[0], y - p.origin[1] + j * size[1]
                covered |= (at[0] >= 0) & (at[0] <= p.size[0]) & (at[1] >= 0) & (at[1] <= p.size[1])
    assert covered.all()
    # Neighbours overlap by at least what was asked for, and the first of all by nothing.
    assert (layout.places[0].overlap == 0).all()
    for p in layout.places[1:]:
        assert p.overlap.max() >= 0.5 - 1e-9
    # A patch follows every earlier one whose box it can see.
    level = {number: k for k, numbers in enumerate(layout.levels) for number in numbers}
    assert sorted(level) == list(range(len(layout.places)))
    shifts = [(i * size[0], j * size[1]) for i in (-1, 0, 1) for j in (-1, 0, 1)] if tileable else [(0.0, 0.0)]
    for a in layout.places:
        for b in layout.places[: a.number]:
            meet = any(
                (b.low + s < a.high + 0.45 - 1e-9).all() and (b.high + s > a.low - 0.45 + 1e-9).all() for s in np.array(shifts)
            )
            if meet:
                assert level[b.number] < level[a.number]


def test_the_share_of_the_old_falls_from_the_border_to_the_end_of_the_overlap():
    place = PatchPlace(5, np.zeros(2), np.array([4.0, 4.0]), np.array([1.0, 1.2, 0, 0]), np.array([0, 0, 0.8, 0.8]))
    middle = np.full(5, 2.5)
    across = place.share_of_old(np.array([-0.1, 0.0, 0.5, 1.0, 2.0]), middle)
    np.testing.assert_allclose(across, [1, 1, 0.5, 0, 0], atol=1e-12)
    up = place.share_of_old(middle, np.array([0.0, 0.6, 1.2, 3.9, 4.7]))
    np.testing.assert_allclose(up, [1, 0.5, 0, 0, 0], atol=1e-12)
    # Where the strip below goes on past the patch, what is there must meet it again at the box's end.
    beside = place.share_of_old(np.array([4.0, 4.4, 4.8]), np.full(3, 0.6))
    assert beside[0] == pytest.approx(0.5)
    assert 0.5 < beside[1] < 1
    assert beside[2] == pytest.approx(1)
    assert place.overlapping(np.array([0.5, 2.0, 2.0, 4.5]), np.array([2.0, 1.0, 2.0, 0.5])).tolist() == [
        True,
        True,
        False,
        False,
    ]
    free = place.free_places(0.5)
    assert len(free)
    assert (free > 1).all()


def test_quarters_fill_the_patch():
    place = PatchPlace(7, np.array([3.0, 2.0]), np.array([4.0, 3.0]), np.array([1.0, 0.8, 0, 0]), np.array([0, 0, 0.7, 0.7]))
    quarters = place.quarters()
    assert [q.part for q in quarters] == [1, 2, 3, 4]
    x, y = np.meshgrid(np.linspace(3, 7, 60), np.linspace(2, 5, 60))
    covered = np.zeros(x.shape, bool)
    for q in quarters:
        assert (q.low >= place.low - 1e-9).all()
        assert (q.high <= place.high + 1e-9).all()
        covered |= (x >= q.origin[0]) & (x <= q.origin[0] + q.size[0]) & (y >= q.origin[1]) & (y <= q.origin[1] + q.size[1])
    assert covered.all()
    assert (quarters[3].overlap[:2] > 0).all()


def test_clusters_are_small_flat_and_of_one_group():
    rng = np.random.default_rng(1)
    flat = np.concatenate([rng.random((600, 2)) * 4, np.zeros((600, 1))], axis=1)
    ball, _ = reference.fibonacci_sphere(600)
    points = np.concatenate([flat, ball + (9, 0, 0)])
    group = np.repeat([0, 1], 600)
    chosen = cluster(points, group, largest=np.array([100, 100]), smallest=np.array([5, 5]), flatness=0.01)
    counts = np.bincount(group[chosen], minlength=2)
    # A plane is only cut by size, a ball also where it bends.
    assert 6 <= counts[0] <= 16
    assert counts[1] > 2 * counts[0]
    assert (np.diff(group[chosen]) >= 0).all()
    again = cluster(points[::-1], group[::-1] * 1, largest=np.array([100, 100]), smallest=np.array([5, 5]), flatness=0.01)
    assert len(again) == len(chosen)
    assert not len(cluster(np.zeros((0, 3)), np.zeros(0, int), largest=np.zeros(0), smallest=np.zeros(0), flatness=0.1))
    # Points in one place can't be split.
    assert len(cluster(np.ones((50, 3)), np.zeros(50, int), largest=np.array([5]), smallest=np.array([1]), flatness=0.0)) == 1


def test_pairing_agrees_with_the_reference(device):
    rng = np.random.default_rng(2)
    costs = PairCosts(1.0, 2.0, 10.0, 6.0, 5.0, 0.3, 0.25, 0.04, unit=2.0, radius=0.5)
    sources = []
    for _ in range(2):
        normals = rng.normal(size=(150, 3)) * 0.3 + (0, 0, 1)
        points = rng.random((150, 3)) * (2, 2, 0.4)
        sources.append((points, normals / np.linalg.norm(normals, axis=1, keepdims=True), rng.random(150) * 0.2))
    points, normals, bent = (np.concatenate([s[k] for s in sources]) for k in range(3))
    points[150:] += (10, 0, 0)
    pick = [rng.choice(150, 25, replace=False), 150 + rng.choice(150, 40, replace=False)]
    shift = (0.12, 0.05, 0.0)
    chosen = np.concatenate(pick)
    targets = Targets(points[chosen] + shift, normals[chosen], bent[chosen], np.array([0, 25, 65]))
    surface = PointSurface(points, normals, 0.3, device=device)
    for rounds in (0, 1, 3):
        got = pair_points(surface, bent, targets, costs, rounds)
        for b in range(2):
            part = slice(targets.first[b], targets.first[b + 1])
            wanted = reference.pair(
                (points, normals, bent), (targets.points[part], targets.normals[part], targets.variation[part]), costs, rounds
            )
            assert (got[part] == wanted).mean() > 0.95
    # Rounds make the pairs move alike: that of the true shift wins.
    assert (got == chosen).mean() > (pair_points(surface, bent, targets, costs, 0) == chosen).mean()
    used = got[:25][got[:25] >= 0]
    assert len(set(used.tolist())) == len(used)
    nothing = Targets(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.array([0, 0]))
    assert not len(pair_points(surface, bent, nothing, costs, 1))


def test_normals_that_face_away_are_never_paired(device):
    points = np.stack(np.meshgrid(np.arange(10.0), np.arange(10.0), [0.0]), axis=-1).reshape(-1, 3)
    up = np.tile([0.0, 0, 1], (100, 1))
    costs = PairCosts(1.0, 1.0, 1.0, 1.0, 1.0, 5.0, 0.25, 1.0, unit=1.0, radius=2.0)
    surface = PointSurface(points, up, 2.0, device=device)
    targets = Targets(points[:20], -up[:20], np.zeros(20), np.array([0, 20]))
    assert (pair_points(surface, np.zeros(100), targets, costs, 2) == -1).all()


def spread_pairs(count, seed):
    rng = np.random.default_rng(seed)
    sources = rng.random((count, 3)) * (4, 4, 1)
    return sources, sources + 0.1 * np.sin(2 * sources[:, [1, 2, 0]])


def test_splines_interpolate_and_agree_with_the_reference(device):
    pairs = [spread_pairs(40, 0), spread_pairs(12, 1), spread_pairs(90, 2)]
    splines = solve_splines([s for s, _ in pairs], [t for _, t in pairs], 1e-9)
    group = np.repeat(np.arange(3), [40, 12, 90])
    sources, targets = (np.concatenate([p[k] for p in pairs]) for k in range(2))
    normals = np.tile([0.0, 0.6, 0.8], (len(sources), 1))
    warped, turned, volume = warp_points(sources, normals, group, splines, device)
    np.testing.assert_allclose(warped, targets, atol=2e-5)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1, atol=1e-5)
    at = np.random.default_rng(3).random((30, 3)) * (4, 4, 1)
    part = slice(splines.first[2], splines.first[3])
    moved, carried, volume = warp_points(at, np.tile([0.0, 0, 1], (30, 1)), np.full(30, 2), splines, device)

    def wanted(x):
        return reference.spline(splines.centers[part], splines.weights[part], splines.linear[2], splines.offset[2], x)

    for x, y, n, v in zip(at, moved, carried, volume, strict=True):
        np.testing.assert_allclose(y, wanted(x), atol=1e-5)
        # The Jacobian by central differences; it carries tangents, and the normal stays across them.
        jacobian = np.stack([(wanted(x + 1e-5 * e) - wanted(x - 1e-5 * e)) / 2e-5 for e in np.eye(3)], axis=1)
        across = np.cross(jacobian[:, 0], jacobian[:, 1])
        np.testing.assert_allclose(n, across / np.linalg.norm(across), atol=2e-3)
        assert v == pytest.approx(np.linalg.det(jacobian), rel=5e-3)


def test_an_affine_move_is_reproduced_without_bending():
    sources, _ = spread_pairs(30, 4)
    turn = np.array([[1.1, 0.2, 0], [-0.1, 0.9, 0.05], [0, 0.1, 1.0]])
    for smoothing in (1e-9, 1e-3, 10.0):
        splines = solve_splines([sources], [sources @ turn.T + (1, 2, 3)], smoothing)
        np.testing.assert_allclose(splines.linear[0], turn, atol=1e-6)
        np.testing.assert_allclose(splines.offset[0], (1, 2, 3), atol=1e-6)
        np.testing.assert_allclose(splines.weights, 0, atol=1e-6)


def test_singular_pairings_shift_and_never_give_nan():
    plane = np.concatenate([np.random.default_rng(0).random((20, 2)), np.zeros((20, 1))], axis=1)
    same = np.ones((10, 3))
    few = np.random.default_rng(1).random((3, 3))
    move = np.array([0.1, 0.2, 0.3])
    lists = [plane, same, few, np.zeros((0, 3))]
    splines = solve_splines(lists, [s + move for s in lists], 1e-3)
    for value in (splines.weights, splines.linear, splines.offset):
        assert np.isfinite(value).all()
    np.testing.assert_allclose(splines.linear[2] @ few[0] + splines.offset[2], few[0] + move, atol=1e-9)
    np.testing.assert_array_equal(splines.offset[3], 0)


def test_the_most_coherent_pairs_leave_the_strange_ones_out():
    sources, _ = spread_pairs(40, 5)
    targets = sources + (0.1, 0, 0)
    targets[7] += (0, 0, 0.8)
    targets[21] -= (0.9, 0, 0)
    kept = most_coherent(sources, targets, 2.0, 0.9)
    assert len(kept) == 36
    assert 7 not in kept
    assert 21 not in kept


def test_spreading_fills_holes_and_leaves_even_points_alone(device):
    x, y = np.meshgrid(np.arange(30.0), np.arange(30.0), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), 0.05 * np.sin(x / 4).ravel()], axis=1)
    settings = {"nearest": 1.0, "support": 2.5, "period": (None, None), "device": device}
    even = spread(records(points), rounds=3, **settings)
    assert len(even) == 900
    assert np.abs(even["point"] - points)[:, :2].max() < 0.05
    hole = (np.abs(points[:, 0] - 14.5) < 1.6) & (np.abs(points[:, 1] - 14.5) < 1.6)
    filled = spread(records(points[~hole]), rounds=3, **settings)
    assert len(filled) > 900 - hole.sum()
    inside = np.linalg.norm(filled["point"][:, :2] - 14.5, axis=1) < 1.5
    assert inside.any()
    assert np.abs(filled["point"][inside, 2] - 0.05 * np.sin(filled["point"][inside, 0] / 4)).max() < 0.02
    assert len(spread(records(points[~hole]), rounds=0, **settings)) == 900 - hole.sum()


def test_thinning_keeps_a_distance_and_leaves_no_room():
    rng = np.random.default_rng(4)
    points = np.concatenate([rng.random((20000, 2)), np.zeros((20000, 1))], axis=1)
    up = np.tile([0.0, 0, 1], (20000, 1))
    kept = points[thin_points(points, up, 0.05)]
    from scipy.spatial import cKDTree

    tree = cKDTree(kept)
    assert tree.query(kept, 2)[0][:, 1].min() >= 0.05
    assert tree.query(points)[0].max() < 1.3 * 0.05
    # Both sides of a sheet are kept.
    both = np.concatenate([points[:2000], points[:2000]])
    sides = np.concatenate([up[:2000], -up[:2000]])
    assert len(thin_points(both, sides, 0.05)) > 1.5 * len(thin_points(points[:2000], up[:2000], 0.05))


def test_triangles_are_sampled_evenly_and_at_the_distance_asked_for():
    vertices = np.array([[0.0, 0, 0], [3, 0, 0], [3, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    points, normals, face, weights = sample_triangles(vertices, faces, 0.04, 0)
    assert len(points) == pytest.approx(3 / 0.04**2, rel=0.1)
    assert np.median(local_spacing(points, normals)) == pytest.approx(0.04, rel=0.08)
    np.testing.assert_allclose(np.einsum("nk,nkc->nc", weights, vertices[faces[face]]), points)
    np.testing.assert_allclose(normals, np.tile([0, 0, 1.0], (len(points), 1)))
    left = (points[:, 0] < 1.5).mean()
    assert left == pytest.approx(0.5, abs=0.03)
    assert RADIUS < 1


@pytest.mark.parametrize(("made", "share"), [(lambda: chain_mail(3, 4, 0.1), 0.97), (lambda: weave(4, 0.1), 0.9)])
def test_normals_of_threads_are_estimated_and_turned_outwards(made, share):
    points, normals, _ = made()
    found, note = estimate_normals(points, 2, 0.1)
    assert "neighbour to neighbour" in note
    assert ((found * normals).sum(axis=1) > 0.7).mean() > share


def test_normals_of_a_closed_surface_point_out_of_it():
    points, spacing = reference.fibonacci_sphere(3000)
    found, _ = estimate_normals(points * (3.0, 2.0, 1.0), 2, spacing)
    assert (found * points).sum(axis=1).min() > 0


def test_height_fields_are_told_from_what_passes_over_itself():
    rng = np.random.default_rng(0)
    plane = rng.random((4000, 2)) * 60
    field = np.concatenate([plane, 3 * np.sin(plane[:, :1] / 3)], axis=1)
    assert is_height_field(field, 2, 1.0)
    threads, normals, _ = weave(4, 0.12)
    assert not is_height_field(threads, 2, 0.12)
    assert not is_height_field(threads, 2, 0.12, normals)
    found, note = estimate_normals(field, 2, 1.0)
    assert "height field" in note
    assert (found[:, 2] > 0).all()


def test_pairing_and_splines_do_not_depend_on_threads():
    sources, targets = spread_pairs(200, 8)
    normals = np.tile([0.0, 0, 1], (200, 1))
    costs = PairCosts(1.0, 1.0, 1.0, 6.0, 5.0, 0.5, 0.5, 1.0, unit=1.0, radius=0.5)
    found = []
    for count in (1, 2):
        set_threads(count)
        try:
            surface = PointSurface(sources, normals, 0.5)
            wanted = Targets(targets[:80], normals[:80], np.zeros(80), np.array([0, 30, 80]))
            pairs = pair_points(surface, np.zeros(200), wanted, costs, 3)
            splines = solve_splines([sources], [targets], 1e-3)
            found.append((pairs, *warp_points(sources, normals, np.zeros(200, int), splines, "cpu")))
        finally:
            set_threads(None)
    for one, two in zip(*found, strict=True):
        np.testing.assert_array_equal(one, two)
