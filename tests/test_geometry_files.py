"""Swatches from files and arrays, points written and read, meshes and shells, the command extend."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from intaglio import (
    FileError,
    InputError,
    IntaglioWarning,
    PointSet,
    assess_geometry,
    extend_geometry,
    geometry_from_height,
    geometry_from_mesh,
    geometry_from_points,
    mesh_geometry,
    read_geometry_texture,
    write_image,
    write_points,
)


def sheet(side=30):
    x, y = np.meshgrid(np.arange(side, dtype=float), np.arange(side, dtype=float), indexing="ij")
    points = np.stack([x, y, 0.5 * np.sin(x / 2) * np.sin(y / 2)], axis=-1).reshape(-1, 3)
    normals = np.stack([-0.25 * np.cos(x / 2) * np.sin(y / 2), -0.25 * np.sin(x / 2) * np.cos(y / 2), np.ones_like(x)], axis=-1)
    normals = normals.reshape(-1, 3)
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("suffix", [".ply", ".xyz", ".obj"])
def test_points_are_written_and_read_again(tmp_path, suffix):
    points, normals = sheet()
    color = np.random.default_rng(0).random((900, 3)).astype(np.float32)
    count = np.arange(900, dtype=np.int32)
    whole = PointSet(points, normals, color=color, source=count, moved=count / 7, patch=count // 10, notes=("a note",))
    path = tmp_path / f"points{suffix}"
    whole.write(path)
    again = read_geometry_texture(path)
    np.testing.assert_array_equal(again.points.points, points)
    np.testing.assert_allclose(again.points.normals, normals, atol=1e-6)
    assert again.axis == 2
    assert again.spacing == pytest.approx(1, rel=0.1)
    if suffix == ".ply":
        raw = trimesh.load(path).metadata["_ply_raw"]["vertex"]["data"]
        np.testing.assert_array_equal(raw["source"].ravel(), count)
        np.testing.assert_array_equal(raw["patch"].ravel(), count // 10)
        np.testing.assert_allclose(raw["moved"].ravel(), count / 7, rtol=1e-6)
        assert np.abs(again.points.color - color).max() < 0.01
    with pytest.raises(FileError, match="unknown type"):
        whole.write(tmp_path / "points.stl")


def test_xyz_without_normals_and_with_a_count(tmp_path):
    points, normals = sheet()
    path = tmp_path / "a.pts"
    path.write_text("900\n" + "\n".join(f"{x},{y};{z}" for x, y, z in points) + "\n# end\n")
    found = read_geometry_texture(path)
    assert any("estimated" in n for n in found.notes)
    inner = (points[:, :2] > 1).all(axis=1) & (points[:, :2] < 28).all(axis=1)
    assert (found.points.normals * normals).sum(axis=1)[inner].min() > 0.9


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.xyz", "", "empty"),
        ("a.xyz", "1 2\n3 4\n", "3 numbers"),
        ("a.xyz", "1 2 3\n1 2 3 4 5 6\n", "all alike"),
        ("a.xyz", "1 2 three\n", "line 1"),
        ("a.xyz", "1 2 3\n" * 5, "too few"),
        ("a.obj", "v 1 2 3\nvn 0 0 1\nv 2 2 2\n", "normals"),
        ("a.obj", "v 1 2\n", "fewer than 3"),
        ("a.obj", "v a b c\n", "line 1"),
        ("a.obj", "# nothing\n", "holds no"),
        ("a.ply", "ply\nnonsense\n", "can't be read as PLY|header"),
        ("a.docx", "text", "unknown type"),
        ("a.png", "text", "PNG|image"),
    ],
)
def test_wrong_files_are_told(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises((FileError, InputError), match=message) as told:
        read_geometry_texture(path)
    assert name in str(told.value)


def test_missing_files_are_told(tmp_path):
    with pytest.raises(FileError, match="no such file"):
        read_geometry_texture(tmp_path / "none.ply")


def test_a_mesh_is_sampled_evenly_with_its_colours(tmp_path):
    box = trimesh.creation.box((10, 8, 1))
    box.visual.vertex_colors = np.tile([200, 100, 50, 255], (8, 1))
    box.export(tmp_path / "box.ply")
    found = read_geometry_texture(tmp_path / "box.ply", spacing=0.2)
    assert len(found.points) == pytest.approx((2 * (80 + 10 + 8)) / 0.04, rel=0.1)
    assert found.spacing == pytest.approx(0.2, rel=0.08)
    assert found.axis == 2
    assert np.ptp(found.points.color, axis=0).max() < 1e-6
    assert found.points.color[0, 0] > found.points.color[0, 1] > found.points.color[0, 2]
    assert (np.abs(found.points.normals).max(axis=1) > 0.999).all()
    with pytest.raises(InputError, match="2 million"):
        read_geometry_texture(tmp_path / "box.ply", spacing=1e-4)


def test_a_height_map_becomes_points_the_right_way_up(tmp_path):
    height = np.zeros((20, 30), np.float32)
    height[2, 25] = 1.0
    found = geometry_from_height(height, pixel=0.5)
    top = found.points.points[found.points.points[:, 2].argmax()]
    # Row 2 from the top, column 25: high y, high x.
    np.testing.assert_allclose(top, [12.75, 8.75, 1.0])
    assert (found.points.normals[:, 2] > 0).all()
    beside = found.points.points[:, 0] == 12.25
    beside &= found.points.points[:, 1] == 8.75
    assert found.points.normals[beside][0, 0] < 0
    write_image(np.clip(height, 0, 1), tmp_path / "bump.png")
    read = read_geometry_texture(tmp_path / "bump.png", pixel=0.5, height=2.0)
    assert read.height == pytest.approx(2.0)
    guessed = read_geometry_texture(tmp_path / "bump.png")
    assert any("thirtieth of the shorter side" in n for n in guessed.notes)
    steep = geometry_from_height(6 * np.sin(np.arange(40) / 2)[None] * np.ones((40, 1)))
    assert any("steeper than 45" in n for n in steep.notes)
    assert steep.spacing == pytest.approx(1, rel=0.12)
    assert len(steep.points) > 1.5 * 1600
    dense = geometry_from_height(np.tile(np.linspace(0, 30, 30), (20, 1)), spacing=0.7)
    assert dense.spacing == pytest.approx(0.7, rel=0.12)
    for bad in (np.zeros((3, 3)), np.zeros(9), np.full((9, 9), np.nan)):
        with pytest.raises(InputError, match="height"):
            geometry_from_height(bad)


def test_duplicates_are_left_out_and_told():
    points, normals = sheet()
    found = geometry_from_points(np.concatenate([points, points[:50]]), np.concatenate([normals, normals[:50]]))
    assert len(found.points) == 900
    assert any("50 points" in n for n in found.notes)


def test_uneven_sampling_is_refused_and_thinning_cures_it():
    rng = np.random.default_rng(1)
    dense = np.concatenate([rng.random((4000, 2)) * (1, 4), np.zeros((4000, 1))], axis=1)
    thin = np.concatenate([rng.random((700, 2)) * (4, 4) + (1, 0), np.zeros((700, 1))], axis=1)
    points = np.concatenate([dense, thin])
    with pytest.raises(InputError, match=r"unevenly.*give spacing="):
        geometry_from_points(points, np.tile([0, 0, 1.0], (4700, 1)))
    found = geometry_from_points(points, np.tile([0, 0, 1.0], (4700, 1)), spacing=0.2)
    assert any("thinned" in n for n in found.notes)


def test_opposing_sheets_too_near_are_warned_of():
    points, _ = sheet()
    points[:, 2] = 0
    low = points - (0.2, 0.2, 0.3)
    normals = np.tile([0, 0, 1.0], (900, 1))
    with pytest.warns(IntaglioWarning, match="opposing surface"):
        geometry_from_points(np.concatenate([points, low]), np.concatenate([normals, -normals]))


def test_a_swatch_that_fills_no_rectangle_is_warned_of():
    points, normals = sheet(40)
    disc = np.linalg.norm(points[:, :2] - 19.5, axis=1) < 19
    with pytest.warns(IntaglioWarning, match="rectangle"):
        geometry_from_points(points[disc], normals[disc])


@pytest.mark.parametrize(
    ("change", "settings", "message"),
    [
        (lambda p, n: (p[:20], n[:20]), {}, "too few"),
        (lambda p, n: (np.where(np.arange(900)[:, None] == 3, np.nan, p), n), {}, "NaN"),
        (lambda p, n: (p, np.where(np.arange(900)[:, None] < 2, 0.0, n)), {}, "2 normals are zero"),
        (lambda p, n: (p, n[:10]), {}, "10 normals for 900"),
        (lambda p, n: (p[:, :2], None), {}, r"\(N, 3\)"),
        (lambda p, n: ("abc", None), {}, "points must be"),
        (lambda p, n: (np.ones((900, 3)), n), {}, "only 1 points differ"),
        (lambda p, n: (p * (1, 0, 0) + (0, 0, 0), n), {}, "only 30 points differ|line"),
        (lambda p, n: (np.outer(np.arange(900.0), (1, 0, 0)), n), {}, "line|unevenly"),
        (lambda p, n: (p, n), {"axis": "w"}, "axis must be"),
        (lambda p, n: (p, n), {"axis": [0]}, "axis must be"),
        (lambda p, n: (p, n), {"bounds": "abc"}, "bounds must be"),
        (lambda p, n: (p, n), {"bounds": np.array([[0, 0, 5.0], [9, 9, 6.0]]), "axis": 2}, "no point lies between"),
        (lambda p, n: (p, n), {"color": "red"}, "color must"),
        (lambda p, n: (p, n), {"color": np.full((900, 3), np.nan)}, "color holds NaN"),
        (lambda p, n: (p * 1e-20, n), {}, "bring them to a unit"),
        (lambda p, n: (p, n), {"bounds": np.zeros((2, 3))}, "no extent|no height"),
        (lambda p, n: (p, n), {"bounds": np.array([[0, 0, 1.0], [9, 9, 1.0]]), "axis": 2}, "no height along z"),
        (lambda p, n: (p, n), {"bounds": np.zeros(5)}, "two finite corners"),
        (lambda p, n: (p, n), {"bounds": np.array([[90, 90, 0.0], [99, 99, 1.0]])}, "only 0 points lie within"),
        (lambda p, n: (p, n), {"spacing": -1}, "spacing must be"),
        (lambda p, n: (p, n), {"spacing": 20.0}, "leaves"),
        (lambda p, n: (p, n), {"color": np.zeros((3, 3))}, "color must have"),
    ],
)
def test_bad_points_are_told(change, settings, message):
    with pytest.raises(InputError, match=message):
        geometry_from_points(*change(*sheet()), **settings)


@pytest.mark.parametrize(
    ("faces", "message"),
    [(np.zeros((0, 3), int), "faces must be"), (np.array([[0, 1, 99]]), "vertices"), (np.array([[0, 0, 0]]), "no area")],
)
def test_bad_meshes_are_told(faces, message):
    with pytest.raises(InputError, match=message):
        geometry_from_mesh(np.eye(3), faces)


@pytest.mark.parametrize(
    ("points", "normals", "settings", "message"),
    [
        (np.full((3, 3), np.nan), np.ones((3, 3)), {}, "points hold NaN"),
        ("a", "b", {}, "array of numbers"),
        (np.ones((3, 3)), np.ones((2, 3)), {}, "normals must be"),
        (np.ones((3, 3)), np.ones((3, 3)), {"source": "a"}, "source must be"),
        (np.ones((3, 3)), np.ones((3, 3)), {"source": [1, 2]}, "source must have"),
    ],
)
def test_bad_point_sets_are_told(points, normals, settings, message):
    with pytest.raises(InputError, match=message):
        PointSet(points, normals, **settings)


def test_what_is_no_point_set_is_told(tmp_path):
    for call in (mesh_geometry, lambda p: assess_geometry(p, None), lambda p: write_points(p, tmp_path / "a.ply")):
        with pytest.raises(InputError, match="PointSet"):
            call(None)


def test_a_thin_plate_is_no_height_field():
    points, _ = sheet(40)
    points[:, 2] = 0
    plate = np.concatenate([points, points + (0.4, 0.4, 2.0)])
    found = geometry_from_points(plate)
    below = found.points.points[:, 2] < 1
    assert any("neighbour to neighbour" in n for n in found.notes)
    # Two sheets apart: each is turned alike, but for points at their corners.
    assert abs(np.sign(found.points.normals[below, 2]).mean()) > 0.99


def test_colours_follow_their_points():
    points, normals = sheet(40)
    color = np.stack([points[:, 0] % 8 / 8, points[:, 1] / 40, np.full(1600, 0.5)], axis=1)
    texture = geometry_from_points(points, normals, color=color)
    made = extend_geometry(texture, 30, 10)
    np.testing.assert_array_equal(made.color, color.astype(np.float32)[made.source])


def test_copies_that_differ_by_rounding_are_refused(tmp_path):
    """Their distances vanish beside the extent: of columns of such a width there are more than numbers for them."""
    rng = np.random.default_rng(0)
    points = np.repeat(rng.random((3, 3)), 20, axis=0) + 1e-300 * rng.random((60, 3))
    points[:20] *= 0
    points[:20] += 1e-300 * rng.random((20, 3))
    points[20:40] = 1e-290 * rng.random((20, 3))
    (tmp_path / "a.xyz").write_text("\n".join(" ".join(map(repr, map(float, p))) for p in points))
    with pytest.raises(InputError, match=r"a\.xyz: half of the points are within .* copies of few points"):
        read_geometry_texture(tmp_path / "a.xyz")


def test_sides_where_a_place_is_a_source(tmp_path):
    """The distance that stands for none must not vanish when it is raised to the third power."""
    from intaglio.geometry.winding import turn_outwards

    points, normals = sheet(6)
    points[1] = points[0]
    with np.errstate(all="raise"):
        turn_outwards(points, normals.copy(), np.zeros(36, int), np.zeros(36))
