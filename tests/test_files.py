"""Images and surfaces, to disk and back."""

from __future__ import annotations

import numpy as np
import pytest

import intaglio
from intaglio import FileError, InputError, Surface
from intaglio.kernels.transfer import decode_srgb, encode_srgb

RNG = np.random.default_rng(4)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".tiff"])
@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("shape", [(7, 5), (7, 5, 3), (7, 5, 4)])
def test_lossless_images_keep_every_level(tmp_path, suffix, bits, shape):
    stored = RNG.integers(0, 2**bits, shape)
    linear = stored / (2**bits - 1)
    intaglio.write_image(linear, tmp_path / f"a{suffix}", bits=bits, linear=True)
    back = intaglio.read_image(tmp_path / f"a{suffix}", linear=True)
    assert back.dtype == np.float32
    np.testing.assert_array_equal(np.round(back.astype(np.float64) * (2**bits - 1)), stored)


def test_sixteen_bit_colour_is_not_cut_to_eight(tmp_path):
    ramp = np.linspace(0, 1, 300, dtype=np.float32)[None, :, None] * np.ones((2, 1, 3), np.float32)
    intaglio.write_image(ramp, tmp_path / "ramp.png", bits=16)
    assert len(np.unique(intaglio.read_image(tmp_path / "ramp.png")[0, :, 0])) == 300


def test_eight_bits_are_srgb_by_default(tmp_path):
    intaglio.write_image(np.full((3, 3, 3), 0.2158605), tmp_path / "grey.png")
    from PIL import Image

    assert np.asarray(Image.open(tmp_path / "grey.png"))[0, 0, 0] == 128
    assert intaglio.read_image(tmp_path / "grey.png")[0, 0, 0] == pytest.approx(0.2158605, abs=1e-6)


def test_row_zero_is_the_top(tmp_path):
    picture = np.zeros((4, 6, 3), np.float32)
    picture[0, 1] = (1, 0, 0)
    for name in ("a.png", "a.tif", "a.exr"):
        intaglio.write_image(picture, tmp_path / name)
        np.testing.assert_allclose(intaglio.read_image(tmp_path / name), picture, atol=1e-6)


def test_jpeg_is_close(tmp_path):
    smooth = np.linspace(0.1, 0.9, 64)[None, :, None] * np.ones((64, 1, 3))
    intaglio.write_image(smooth, tmp_path / "a.jpg")
    assert np.abs(intaglio.read_image(tmp_path / "a.jpg") - smooth).max() < 0.02


def test_exr_keeps_names_bits_and_metadata(tmp_path):
    channels = {"normal.x": RNG.normal(size=(5, 9)).astype(np.float32), "Z": np.full((5, 9), 1e30, np.float32)}
    intaglio.write_exr(channels, tmp_path / "maps.exr", metadata={"kind": "ptm", "scale": 2.5})
    back, header = intaglio.read_exr(tmp_path / "maps.exr")
    assert set(back) == set(channels)
    for name, plane in channels.items():
        assert back[name].tobytes() == plane.tobytes()
    assert header["kind"] == "ptm"
    assert header["scale"] == pytest.approx(2.5)
    with pytest.raises(FileError, match="read them by name"):
        intaglio.read_image(tmp_path / "maps.exr")


def test_srgb_curves_invert():
    x = np.linspace(0, 1, 1001, dtype=np.float32)
    np.testing.assert_allclose(decode_srgb(encode_srgb(x)), x, atol=2e-6)


@pytest.mark.parametrize(
    ("image", "name", "options", "error"),
    [
        (np.zeros((3, 3, 2)), "a.png", {}, InputError),
        (np.zeros((0, 3)), "a.png", {}, InputError),
        (np.full((3, 3), np.nan), "a.png", {}, InputError),
        (np.zeros((3, 3)), "a.jpg", {"bits": 16}, InputError),
        (np.zeros((3, 3, 4)), "a.jpg", {}, InputError),
        (np.zeros((3, 3)), "a.gif", {}, FileError),
        (np.zeros((3, 3)), "none/a.png", {}, FileError),
    ],
)
def test_images_that_cannot_be_written(tmp_path, image, name, options, error):
    with pytest.raises(error, match=r"a\."):
        intaglio.write_image(image, tmp_path / name, **options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.tif", "a.exr"])
def test_damaged_images(tmp_path, name):
    intaglio.write_image(RNG.uniform(size=(40, 40, 3)), tmp_path / name)
    data = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(data[: len(data) // 3])
    with pytest.raises(FileError, match="a\\."):
        intaglio.read_image(tmp_path / name)


def a_surface():
    rng = np.random.default_rng(1)
    vertices = rng.normal(size=(50, 3)) + 1e6
    normal = rng.normal(size=(50, 3))
    return Surface(
        vertices=vertices,
        faces=rng.permuted(np.tile(np.arange(50), (80, 1)), axis=1)[:, :3],
        base=vertices - 1e-3 * normal,
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        color=rng.uniform(size=(50, 3)).astype(np.float32),
        measured=np.arange(50) < 30,
        source=rng.integers(0, 30, 50),
        rotation=rng.uniform(size=50),
        error=rng.uniform(size=50),
        model=intaglio.Cylinder(point=np.array([0.1, 0.2, 0.3]), axis=np.array([1.0, 2, 3]), radius=np.pi, inward=True),
        notes=("spacing ½ mm", "a line\nand another"),
    )


def test_ply_brings_everything_back_bit_for_bit(tmp_path):
    surface = a_surface()
    surface.write(tmp_path / "s.ply")
    back = intaglio.read_surface(tmp_path / "s.ply")
    for name in ("vertices", "faces", "base", "normal", "color", "measured", "source", "rotation", "error"):
        assert getattr(back, name).tobytes() == getattr(surface, name).tobytes(), name
    assert back.notes == surface.notes
    assert back.model.parameters.keys() == surface.model.parameters.keys()
    assert back.model.radius == surface.model.radius
    assert back.model.axis.tobytes() == surface.model.axis.tobytes()
    assert back.model.inward


@pytest.mark.parametrize("suffix", [".obj", ".stl", ".off", ".glb", ".gltf"])
def test_other_formats_keep_the_shape(tmp_path, wave_tube, suffix):
    scan, _ = wave_tube
    scan.write(tmp_path / f"s{suffix}")
    back = intaglio.read_surface(tmp_path / f"s{suffix}")
    assert len(back.vertices) == len(scan.vertices)
    np.testing.assert_allclose(back.vertices[back.faces].mean(axis=1), scan.vertices[scan.faces].mean(axis=1), atol=1e-5)


def test_obj_and_ply_keep_survey_coordinates(tmp_path):
    vertices = np.array([[512345.678901, 5412345.123456, 123.456789], [512346, 5412345, 123], [512345, 5412346, 123]])
    scan = Surface(vertices=vertices, faces=np.array([[0, 1, 2]]))
    for name in ("s.obj", "s.ply", "s.off"):
        scan.write(tmp_path / name)
        np.testing.assert_allclose(intaglio.read_surface(tmp_path / name).vertices, vertices, atol=1e-6, rtol=0)


def test_nothing_is_overwritten_unasked(tmp_path):
    a_surface().write(tmp_path / "s.ply")
    with pytest.raises(FileError, match="exists already"):
        a_surface().write(tmp_path / "s.ply", overwrite=False)


def test_a_range_image_is_triangulated_without_bridging_steps():
    x, y = np.meshgrid(np.arange(20.0), np.arange(15.0))
    z = np.where(x < 10, 0.0, 8.0)
    points = np.stack([x, -y, z], axis=-1)
    points[7, 4] = np.nan
    scan = intaglio.surface_from_range_image(points, view=(10, -7, 1000))
    span = np.ptp(scan.vertices[scan.faces][:, :, 2], axis=1)
    assert span.max() == 0
    corners = scan.vertices[scan.faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()
    assert len(scan.vertices) == 299


def test_a_point_cloud_is_triangulated_in_its_view(tmp_path):
    points = np.random.default_rng(0).uniform(-1, 1, (800, 3)) * (1, 1, 0.05)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    direction = turn @ (0, 0, -1.0)
    scan = intaglio.surface_from_points(points @ turn.T, direction)
    corners = scan.vertices[scan.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normal @ direction < 0).all()
    assert len(scan.vertices) > 780
    for direction in ((0, 0, 0), (1, 0), "down"):
        with pytest.raises(InputError, match="direction"):
            intaglio.surface_from_points(points, direction)
    with pytest.raises(InputError, match="view"):
        intaglio.surface_from_range_image(points.reshape(20, 40, 3), view=(1, 2))


def test_part_renumbers_and_keeps_provenance():
    surface = a_surface()
    keep = np.arange(50) % 2 == 0
    part = surface.part(keep)
    assert part.vertices.tobytes() == surface.vertices[keep].tobytes()
    has = part.source >= 0
    np.testing.assert_array_equal(part.vertices[part.source[has]], surface.vertices[surface.source[keep][has]])


def test_real_range_grid(real):
    scan = intaglio.read_surface(real("meshes/bunny_range_scans/bun000.ply"))
    # 40,256 vertices in the file; those on no triangle of the grid are no surface.
    assert 39_500 < len(scan.vertices) <= 40_256
    corners = scan.vertices[scan.faces]
    assert np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max() < 0.01


def test_real_colours(real):
    lion = intaglio.read_surface(real("meshes/lion_takanawa_points/lion_mesh_colour_300k.ply"))
    # 152,755 vertices in the file, and those that were doubled where faces touch without joining.
    assert lion.color.shape == lion.vertices.shape
    assert 152_755 < len(lion.vertices) < 152_900
    assert 0 <= lion.color.min() < lion.color.max() <= 1
