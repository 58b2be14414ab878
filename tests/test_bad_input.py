"""Bad input gets an error that names the culprit and the cure, before the work."""

from __future__ import annotations

import os

import numpy as np
import pytest
from reliefs import complete_with

import intaglio
from intaglio import InputError, IntaglioError, Surface


def square(n=12, z=0.0):
    x, y = np.meshgrid(np.arange(n, dtype=float), np.arange(n, dtype=float), indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.full(n * n, z)], axis=1)
    i, j = np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij")
    a = (i * n + j).ravel()
    return vertices, np.concatenate([np.stack([a, a + n, a + n + 1], 1), np.stack([a, a + n + 1, a + 1], 1)])


def test_not_a_surface():
    with pytest.raises(InputError, match="read_surface"):
        intaglio.complete_relief(np.zeros((3, 3)))


def test_empty():
    with pytest.raises(InputError, match="empty"):
        intaglio.complete_relief(Surface(vertices=np.zeros((0, 3)), faces=np.zeros((0, 3), int)))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_coordinates_that_are_not_finite(bad):
    vertices, faces = square()
    vertices[17, 1] = bad
    with pytest.raises(InputError, match=r"not finite.*row 17"):
        Surface(vertices=vertices, faces=faces)


@pytest.mark.parametrize("bad", [-1, 144, 2**31 - 1])
def test_faces_out_of_range(bad):
    vertices, faces = square()
    faces[3, 2] = bad
    with pytest.raises(InputError, match="face 3 names"):
        Surface(vertices=vertices, faces=faces)


def test_float_faces_and_polygons():
    vertices, faces = square()
    with pytest.raises(InputError, match="integers"):
        Surface(vertices=vertices, faces=faces.astype(float))
    with pytest.raises(InputError, match="triangulated"):
        Surface(vertices=vertices, faces=np.zeros((5, 4), int))


def test_nothing_missing():
    import trimesh

    ball = trimesh.creation.icosphere(3)
    with pytest.raises(InputError, match="nothing to complete"):
        intaglio.complete_relief(Surface(vertices=ball.vertices, faces=ball.faces), "sphere")


def test_no_holes_inside():
    vertices, faces = square()
    with pytest.raises(InputError, match="no hole"):
        intaglio.complete_relief(Surface(vertices=vertices, faces=faces), "plane", window=2, extent="holes")


def test_one_triangle():
    scan = Surface(vertices=np.eye(3), faces=np.array([[0, 1, 2]]))
    with pytest.raises(IntaglioError, match="too few"):
        intaglio.complete_relief(scan, "plane")


def test_fewer_samples_than_the_window_needs():
    vertices, faces = square(2)
    base = intaglio.Plane(point=np.zeros(3), normal=np.array([0, 0, 1.0]))
    with pytest.raises(InputError, match="fewer samples"):
        intaglio.complete_relief(Surface(vertices=vertices, faces=faces), base, window=7, extent=(-3, 3, -3, 3))


def test_all_points_on_a_line():
    t = np.linspace(0, 1, 30)
    faces = np.stack([np.arange(28), np.arange(1, 29), np.arange(2, 30)], axis=1)
    faces[1::2] = faces[1::2, ::-1]
    scan = Surface(vertices=np.stack([t, 2 * t, 3 * t], axis=1), faces=faces)
    with pytest.raises(IntaglioError, match=r"line|area zero"):
        intaglio.complete_relief(scan, "plane")


def test_a_base_that_the_scan_does_not_decide():
    vertices, faces = square(20)
    vertices[:, 2] = np.random.default_rng(0).normal(0, 0.3, len(vertices))
    with pytest.raises(intaglio.FitError, match="several bases"):
        intaglio.complete_relief(Surface(vertices=vertices, faces=faces))


def test_a_shape_that_no_base_carries():
    import trimesh

    box = trimesh.creation.box().subdivide().subdivide().subdivide()
    keep = ~((box.triangles_center > 0.45).any(axis=1) & (box.triangles_center[:, 0] > 0.49))
    whole = intaglio.complete_relief(Surface(vertices=box.vertices, faces=box.faces[keep]), rotations=1)
    assert whole.model.kind == "smooth"
    assert any("the smoothed scan, since" in note for note in whole.notes)
    open_box = ~(box.triangles_center[:, 0] > 0.49)
    with pytest.raises(intaglio.FitError, match=r"fits this scan|several bases"):
        intaglio.complete_relief(Surface(vertices=box.vertices, faces=box.faces[open_box & (box.triangles_center[:, 1] < 0.2)]))


def test_several_pieces_are_named_and_the_fitting_ones_taken():
    vertices, faces = square()
    far = vertices + (20.0, 0, 0)
    off = vertices + (0, 0, 50.0)
    both = Surface(vertices=np.concatenate([vertices, far, off]), faces=np.concatenate([faces, faces + 144, faces + 288]))
    base = intaglio.Plane(point=np.zeros(3), normal=np.array([0, 0, 1.0]))
    whole = intaglio.complete_relief(both, base, window=2)
    assert whole.measured.sum() == 288
    assert any("3 pieces: 2 on the base taken" in note and "left out (144 vertices)" in note for note in whole.notes)


def write_plain(path, surface):
    """Write a surface as another program would: without base and provenance."""
    import trimesh

    trimesh.Trimesh(surface.vertices, surface.faces, process=False).export(path)


def test_duplicate_vertices_and_their_mending(tmp_path):
    vertices, faces = square()
    soup = Surface(vertices=vertices[faces.ravel()], faces=np.arange(3 * len(faces)).reshape(-1, 3))
    with pytest.raises(InputError, match=r"exactly on one another.*mend_surface"):
        intaglio.complete_relief(soup, "plane", window=2, extent=(-3, 14, 0, 11))
    write_plain(tmp_path / "soup.ply", soup)
    mended = intaglio.read_surface(tmp_path / "soup.ply")
    assert len(mended.vertices) == 144
    assert any("merged" in note for note in mended.notes)


def test_inconsistent_winding_and_its_mending(tmp_path):
    vertices, faces = square()
    faces[40] = faces[40, ::-1]
    scan = Surface(vertices=vertices, faces=faces)
    with pytest.raises(InputError, match=r"opposite directions.*mend_surface"):
        intaglio.complete_relief(scan, "plane", window=2)
    write_plain(tmp_path / "turned.ply", scan)
    mended = intaglio.read_surface(tmp_path / "turned.ply")
    corners = mended.vertices[mended.faces]
    up = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    assert (up > 0).all()
    assert any("1 face turned" in note for note in mended.notes)


def test_more_than_two_faces_at_an_edge():
    vertices, faces = square()
    wing = np.array([[0.5, 0.5, 1.0]])
    scan = Surface(vertices=np.concatenate([vertices, wing]), faces=np.concatenate([faces, [[13, 26, 144]]]))
    with pytest.raises(InputError, match="more than two share an edge"):
        intaglio.complete_relief(scan, "plane", window=2)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("window", 0, "window"), ("window", 2.5, "window"), ("rotations", -1, "rotations"), ("seed", 1.5, "seed"),
        ("error", -1.0, "error"), ("error", float("nan"), "error"), ("spacing", 0.0, "spacing"),
        ("spacing", 1e-9, "larger spacing"),
        ("metric", "cubic", "metric"), ("order", "random", "order"), ("extent", "half", "extent"),
        ("spacing", 1e300, "smaller spacing"),
        ("spacing", 1e-300, "larger spacing"),
        ("extent", (3, 1, 0, 1), "low"),
        ("extent", (1, 2), "4 finite"), ("base", "cone", "cone"), ("device", "cuda:99", "available"), ("levels", 9, "levels"),
        ("color_weight", 0.5, "color_weight"), ("frames", "spiral", "frames"), ("engine", "fpga", "engine"),
        ("tolerance", -0.5, "tolerance"), ("eta", 0.0, "eta"), ("rule", "worst", "selection"), ("search", "tree", "search"),
    ],
)  # fmt: skip
def test_arguments(name, value, message):
    vertices, faces = square()
    settings = {"base": "plane", "window": 2, "extent": (-3, 14, 0, 11), name: value}
    with pytest.raises(InputError, match=message):
        complete_with(Surface(vertices=vertices, faces=faces), **settings)


def test_a_scan_that_covers_its_base_twice():
    vertices, faces = square()
    lid = vertices * (0.6, 0.6, 1) + (2.3, 2.1, 0.4)
    twice = Surface(vertices=np.concatenate([vertices, lid]), faces=np.concatenate([faces, faces + 144]))
    base = intaglio.Plane(point=np.array([0, 0, 0.2]), normal=np.array([0, 0, 1.0]))
    with pytest.raises(InputError, match="more than once"):
        intaglio.complete_relief(twice, base, window=2, extent=(-3, 14, 0, 11))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("none.ply", None, "no such file"),
        ("empty.ply", b"", "empty"),
        ("picture.ply", b"\x89PNG\r\n\x1a\n" + bytes(50), "not PLY"),
        ("cut.ply", b"ply\nformat ascii 1.0\nelement vertex 3\n", "no end"),
        ("short.ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 900\nproperty float x\nproperty float y\n"
                      b"property float z\nend_header\nabc", "cut off"),
        ("cutface.ply", b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                        b"element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
         "cut off"),
        ("scan.gif", b"1 2 3\n", "unknown mesh type"),
        ("noise.stl", b"\x00\x01\x02" * 30, "no STL"),
        ("text.glb", b"hello world, this is no glTF", "no glTF"),
    ],
)  # fmt: skip
def test_files_that_are_no_meshes(tmp_path, name, content, message):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(IntaglioError, match=message):
        intaglio.read_surface(path)


@pytest.mark.parametrize(
    ("old", "new"),
    [(b'"kind": "plane"', b'"kind": "torus"'), (b'{"kind"', b'{"kind'), (b"double nx", b"double qx"), (b'"inward"', b'"inwerd"')],
)
def test_damaged_properties_of_our_own(tmp_path, old, new):
    vertices, faces = square()
    plane = intaglio.Plane(point=np.zeros(3), normal=np.array([0, 0, 1.0]))
    Surface(vertices=vertices, faces=faces, model=plane).write(tmp_path / "s.ply")
    data = (tmp_path / "s.ply").read_bytes()
    assert old in data
    (tmp_path / "s.ply").write_bytes(data.replace(old, new))
    with pytest.raises(InputError, match=r"own (properties|comments)"):
        intaglio.read_surface(tmp_path / "s.ply")


def test_a_surface_without_faces_comes_back(tmp_path):
    Surface(vertices=np.eye(3), faces=np.zeros((0, 3), int)).write(tmp_path / "s.ply")
    assert len(intaglio.read_surface(tmp_path / "s.ply").vertices) == 3


def test_single_precision_formats_warn_before_they_round(tmp_path):
    vertices, faces = square()
    with pytest.warns(intaglio.IntaglioWarning, match=r"single precision.*write \.ply"):
        Surface(vertices=vertices * 0.01 + 4e6, faces=faces).write(tmp_path / "s.glb")
    with pytest.raises(InputError, match="don't fit"):
        Surface(vertices=vertices * 1e60, faces=faces).write(tmp_path / "s.stl")


def test_a_truth_without_faces(wave_sheet):
    scan, _ = wave_sheet
    holed = scan.part(np.linalg.norm(scan.vertices[:, :2] - 20, axis=1) > 5)
    whole = intaglio.complete_relief(holed, "plane", window=2)
    with pytest.raises(InputError, match="no faces"):
        intaglio.assess_relief(whole, Surface(vertices=np.eye(3), faces=np.zeros((0, 3), int)))
    with pytest.raises(InputError, match="Surface"):
        intaglio.assess_relief(whole, np.eye(3))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("spacing", "x"),
        ("tolerance", "x"),
        ("extent", ("a", 1)),
        ("error", [1, 2]),
        ("progress", 3),
        ("reference", (0, 0)),
        ("reference", (0, 0, np.nan)),
        ("base", np.eye(3)),
    ],
)
def test_arguments_of_the_wrong_type(name, value):
    vertices, faces = square()
    settings = {"base": "plane", "window": 2, "extent": (-3, 14, 0, 11), name: value}
    with pytest.raises(InputError):
        complete_with(Surface(vertices=vertices, faces=faces), **settings)


def test_an_extent_off_the_scan():
    vertices, faces = square()
    with pytest.raises(InputError, match="not joined to the scan"):
        intaglio.complete_relief(Surface(vertices=vertices, faces=faces), "plane", window=2, extent=(100, 110, 100, 110))


def test_a_thin_but_endless_extent():
    vertices, faces = square()
    with pytest.raises(InputError, match="smaller extent"):
        intaglio.complete_relief(Surface(vertices=vertices, faces=faces), "plane", window=2, extent=(0, 1e9, 0, 1e-9))


def test_points_need_a_view_direction(tmp_path):
    points = np.random.default_rng(0).uniform(size=(100, 3)) * (10, 10, 0.1)
    with pytest.raises(InputError, match="direction of sight"):
        read_plain(tmp_path, points)


def read_plain(folder, points):
    lines = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(points)}",
        "property float x",
        "property float y",
        "property float z",
    ]
    text = "\n".join([*lines, "end_header", *(" ".join(map(str, p)) for p in points)]) + "\n"
    (folder / "plain.ply").write_text(text)
    return intaglio.read_surface(folder / "plain.ply")


def test_a_folder_that_does_not_exist(tmp_path):
    vertices, faces = square()
    with pytest.raises(intaglio.FileError, match="does not exist"):
        Surface(vertices=vertices, faces=faces).write(tmp_path / "none" / "out.ply")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full, a disk that is always full")
def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    vertices, faces = square()
    surface = Surface(vertices=vertices, faces=faces)
    path = tmp_path / "out.ply"
    surface.write(path)
    before = path.read_bytes()

    def full(*_):
        with open("/dev/full", "wb") as file:
            file.write(bytes(1 << 20))

    monkeypatch.setattr("intaglio.mesh.writing._write_ply", full)
    with pytest.raises(intaglio.FileError, match="No space left"):
        surface.write(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["out.ply"]
