"""The texture of what was filled: from where its relief is from, level with the scan at the rim; the scan's stays as it is."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest

import intaglio
from intaglio.kernels.texels import rasterize
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh import samples_of
from intaglio.relief.texturing import texture_filling
from tests.test_cli import run

SIDE, TEXELS, PERIOD = 28, 8, 4


def png(samples):
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(samples).save(buffer, "PNG")
    return buffer.getvalue()


def stripes(x):
    """Shown values of stripes that go along with the relief."""
    return 0.5 + 0.4 * np.sin(2 * np.pi * x / PERIOD)


def scan(picture, hole=slice(11, 17)):
    """A wavy sheet with a square hole, laid flat in its picture as it is seen from above."""
    y, x = np.mgrid[:SIDE, :SIDE].astype(float)
    points = np.stack([x, y, 0.3 * np.sin(2 * np.pi * x / PERIOD)], axis=-1)
    points[hole, hole] = np.nan
    surface = intaglio.surface_from_range_image(points, view=(SIDE / 2, SIDE / 2, 300))
    return replace(surface, uv=surface.vertices[surface.faces][:, :, :2] / (SIDE - 1), picture=picture)


def striped():
    size = SIDE * TEXELS
    row = np.uint8(np.round(255 * stripes((np.arange(size) + 0.5) / size * (SIDE - 1))))
    return png(np.repeat(np.tile(row, (size, 1))[:, :, None], 3, axis=2))


@pytest.fixture(scope="module")
def whole():
    return intaglio.complete_relief(scan(striped()), "plane", extent="holes", window=3, rotations=1, refine=3)


def texels(whole):
    """Return the texels (K, 3) of the filling, from 0 to 1, and the points (K, 3) of the surface that they lie on."""
    filled = ~whole.measured_face
    image = samples_of(whole.pictures[-1])
    uv = whole.uv[filled]
    face, weight = rasterize(uv.reshape(-1, 2), np.arange(3 * len(uv)).reshape(-1, 3), *image.shape[:2], "cpu")
    inside = face >= 0
    weights = np.column_stack([weight[inside], 1 - weight[inside].sum(axis=1)])
    points = np.einsum("kc,kcd->kd", weights, whole.vertices[whole.faces[filled]][face[inside]])
    return image[inside] / 255, points


def test_the_scans_texture_stays_to_the_bit(whole):
    given = scan(striped())
    count = len(given.faces)
    assert whole.picture == given.picture
    np.testing.assert_array_equal(whole.uv[:count], given.uv)
    np.testing.assert_array_equal(whole.faces[:count], given.faces)
    np.testing.assert_array_equal(whole.face_picture, np.arange(len(whole.faces)) >= count)
    np.testing.assert_array_equal(whole.measured_face, np.arange(len(whole.faces)) < count)
    assert len(whole.more_pictures) == 1
    assert np.isfinite(whole.uv).all()
    assert any(note.startswith("the filling's texture: ") and note.endswith(" as the scan's") for note in whole.notes)


def test_colour_goes_along_with_relief(whole):
    """Stripes in the picture lie on the waves of the relief; so they do where both were filled."""
    found, points = texels(whole)
    assert len(found) > 20 * TEXELS**2
    np.testing.assert_allclose(found, np.tile(stripes(points[:, :1]), (1, 3)), atol=2.0 / 255)


def test_texels_are_as_dense_as_the_scans(whole):
    found, _ = texels(whole)
    corners = whole.base[whole.faces[~whole.measured_face]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    assert np.sqrt(len(found) / area) == pytest.approx(SIDE * TEXELS / (SIDE - 1), rel=0.04)


def test_a_picture_of_one_colour_gives_that_colour():
    one = np.full((60, 60, 3), (200, 100, 50), np.uint8)
    filled = intaglio.complete_relief(scan(png(one)), "plane", extent="holes", window=3, rotations=1)
    # Charts, their margins, and all the rest.
    np.testing.assert_array_equal(samples_of(filled.pictures[-1]).reshape(-1, 3), np.tile(one[0, :1], (filled_size(filled), 1)))


def filled_size(whole):
    height, width = samples_of(whole.pictures[-1]).shape[:2]
    return height * width


def test_the_same_comes_out_again(whole):
    again = intaglio.complete_relief(scan(striped()), "plane", extent="holes", window=3, rotations=1, refine=3)
    assert again.pictures == whole.pictures
    np.testing.assert_array_equal(again.uv, whole.uv)


def by_hand(given, source, rotation):
    """Return a scan's completion in which every filled vertex takes a given source and rotation; frames are x and y."""
    prepared = intaglio.prepare_relief(given, "plane", extent="holes", spacing=1.0)
    ground = prepared.ground
    flat = ground.foot.copy()
    along, across = ground.foot[:, 0], ground.foot[:, 1]
    measured = ground.measured
    numbers = np.arange(len(flat))
    sources = numbers.copy()
    for vertex in np.flatnonzero(~measured):
        wanted = source(np.array([along[vertex], across[vertex]]))
        sources[vertex] = np.argmin(np.where(measured, (along - wanted[0]) ** 2 + (across - wanted[1]) ** 2, np.inf))
    whole = intaglio.Surface(
        vertices=ground.vertices,
        faces=ground.faces,
        base=flat,
        normal=ground.normal,
        measured=measured,
        source=sources,
        rotation=np.where(measured, 0, rotation),
    )
    u, v = np.tile([1.0, 0, 0], (len(flat), 1)), np.tile([0, 1.0, 0], (len(flat), 1))
    return texture_filling(given, whole, ground.kept, u, v)


def test_what_is_turned_is_turned():
    """A quarter turn, x' = -y and y' = x at the source, makes upright stripes of level ones, and level ones of upright."""
    size = SIDE * TEXELS
    row = np.uint8(np.round(255 * stripes((np.arange(size) + 0.5) / size * (SIDE - 1))))
    crossed = np.zeros((size, size, 3), np.uint8)
    crossed[:, :, 0], crossed[:, :, 1] = row[::-1, None], row
    middle = np.array([13.5, 13.5])

    def source(at):
        # Turned about the middle of the hole, and on by two periods to where there is a scan.
        x, y = at - middle
        return np.array([-y, x]) + middle + (2 * PERIOD, 0)

    turned = by_hand(scan(png(crossed)), source, np.pi / 2)
    found, points = texels(turned)
    inner = (np.abs(points[:, :2] - middle) < 2).all(axis=1)
    # Levelling may shift the tone a little; the stripes' direction and phase are what counts.
    x, y = points[inner, 0] - middle[0], points[inner, 1] - middle[1]
    assert np.corrcoef(found[inner, 0], stripes(middle[1] + x))[0, 1] > 0.93
    assert np.corrcoef(found[inner, 1], stripes(middle[0] - y))[0, 1] > 0.93


def test_tones_are_levelled():
    """Pieces of another tone than the rim's take the rim's on, and both sides meet in the same colour."""
    size = SIDE * TEXELS
    light = np.where(np.arange(size) < size * 8 / SIDE, 220, 100).astype(np.uint8)
    picture = png(np.repeat(np.tile(light, (size, 1))[:, :, None], 3, axis=2))
    # All relief is from the left end of the sheet, where the picture is light.
    filled = by_hand(scan(picture), lambda at: at - (10, 0), 0.0)
    found, _ = texels(filled)
    assert np.abs(found * 255 - 100).max() < 6
    raw = decode_srgb(np.array([220, 100]) / 255)
    assert raw[0] > 4 * raw[1]


def test_both_sides_of_the_rim_meet():
    """In a picture of noise as well: the texel beside the rim is that of the scan across it."""
    size = SIDE * TEXELS
    rng = np.random.default_rng(1)
    coarse = rng.uniform(0.2, 0.8, (size // 4, size // 4, 3))
    picture = png(np.uint8(255 * coarse.repeat(4, axis=0).repeat(4, axis=1)))
    given = scan(picture)
    filled = intaglio.complete_relief(given, "plane", extent="holes", window=3, rotations=1)
    found, points = texels(filled)
    image = samples_of(picture)
    at = points[:, :2] / (SIDE - 1) * size
    across = image[(size - 1 - np.clip(at[:, 1].astype(int), 0, size - 1)), np.clip(at[:, 0].astype(int), 0, size - 1)] / 255
    # The hole's border is a square; texels whose middle is half a texel off it.
    off = np.abs(points[:, :2] - 13.5).max(axis=1)
    beside = off > 3.5 - 1e-9 - 0.4 / TEXELS
    assert beside.sum() > 20
    middle = off < 2
    assert np.abs(found[beside] - across[beside]).mean() < 0.06
    # Elsewhere the noise is another one.
    assert np.abs(found[middle] - across[middle]).mean() > 0.12


def test_a_gap_closed_by_triangles_alone_has_colours_too():
    given = scan(striped(), hole=slice(13, 14))
    corner = np.flatnonzero(~np.isin(np.arange(len(given.faces)), [40]))
    holed = replace(given, faces=given.faces[corner], uv=given.uv[corner])
    whole = intaglio.complete_relief(holed, "smooth")
    assert (~whole.measured_face).sum() > 0
    small = (~whole.measured_face) & whole.measured[whole.faces].all(axis=1)
    assert small.any()
    assert np.isfinite(whole.uv[small]).all()
    found, points = texels(whole)
    assert np.abs(found[:, 0] - stripes(points[:, 0])).mean() < 0.08


def test_each_part_takes_from_its_own_picture():
    given = scan(striped())
    left = given.vertices[given.faces][:, :, 0].mean(axis=1) < 8
    red, blue = (png(np.full((64, 64, 3), c, np.uint8)) for c in ((250, 0, 0), (0, 0, 250)))
    two = replace(given, picture=red, more_pictures=(blue,), face_picture=np.where(left, 0, 1))
    whole = by_hand(two, lambda at: at + (8, 0), 0.0)
    assert whole.pictures[:2] == (red, blue)
    assert len(whole.pictures) == 3
    np.testing.assert_array_equal(whole.face_picture[: len(left)], np.where(left, 0, 1))
    # The hole and the sources lie in what is blue.
    found, _ = texels(whole)
    np.testing.assert_array_equal(np.round(found * 255), np.tile([0, 0, 250], (len(found), 1)))


def test_a_scan_without_a_texture_has_measured_faces_all_the_same():
    given = replace(scan(striped()), uv=None, picture=None)
    whole = intaglio.complete_relief(given, "plane", extent="holes", window=3, rotations=1)
    assert whole.uv is None
    assert whole.measured_face.sum() == len(given.faces)


@pytest.mark.parametrize("picture", [b"GIF89a, say", None])
def test_a_picture_that_cannot_be_read_costs_the_fillings_texture_only(picture):
    given = replace(scan(striped()), picture=picture)
    whole = intaglio.complete_relief(given, "plane", extent="holes", window=3, rotations=1)
    assert whole.picture == picture
    assert not whole.more_pictures
    np.testing.assert_array_equal(whole.uv[: len(given.faces)], given.uv)
    assert np.isnan(whole.uv[len(given.faces) :]).all()
    assert any("the filling has no texture" in note for note in whole.notes) == (picture is not None)


def test_the_command_keeps_the_texture(tmp_path, monkeypatch, capsys):
    given = scan(striped())
    loose = replace(
        given, vertices=np.concatenate([given.vertices, [[50.0, 50, 50]]]), base=None, normal=None, measured=None, source=None
    )
    loose.write(tmp_path / "scan.obj")
    output = tmp_path / "whole.obj"
    status, _, err = run(monkeypatch, capsys, "complete", tmp_path / "scan.obj", "-o", output, "--window", 3)
    assert status == 0, err
    names = {"whole.obj", "whole.mtl", "whole.png", "whole_filling.png", "whole_measured.png", "whole_filling_measured.png"}
    assert {p.name for p in tmp_path.glob("whole*")} == names
    assert (tmp_path / "whole.png").read_bytes() == given.picture
    back = intaglio.read_surface(output)
    assert back.picture == given.picture
    assert len(back.pictures) == 2
    np.testing.assert_array_equal(back.uv[: len(given.faces)], given.uv)
    assert not back.notes
    assert back.color[back.faces].std() > 0.1


def test_the_command_does_not_write_over_its_input(tmp_path, monkeypatch, capsys):
    scan(striped()).write(tmp_path / "whole_filling.ply")
    before = (tmp_path / "whole_filling.png").read_bytes()
    status, _, err = run(monkeypatch, capsys, "complete", tmp_path / "whole_filling.ply", "-o", tmp_path / "whole.obj")
    assert status == 2
    assert "whole_filling.png" in err
    assert (tmp_path / "whole_filling.png").read_bytes() == before


def test_a_real_scan(real):
    """A head with a hole in its forehead: its own texture stays, and the filling's looks like the skin around it."""
    folder = real("meshes/lee_perry_smith_head/LeePerrySmith.glb").parent
    head = intaglio.read_surface(folder / "LeePerrySmith.glb")
    # The file's texture was made for v upwards, which glTF has downwards.
    uv = head.uv * (1, -1) + (0, 1)
    head = replace(head, uv=uv, picture=(folder / "Map-COL.jpg").read_bytes())
    # On the forehead, above the nose's tip.
    tip = head.vertices[np.argmax(head.vertices[:, 2])]
    near = np.linalg.norm(head.vertices - tip - (0.3, 2.0, -0.4), axis=1)
    given = head.part((near < 1.3) & (near > 0.4))
    whole = intaglio.complete_relief(given, "smooth", holes="largest")
    assert (~whole.measured).sum() > 10
    assert whole.picture == head.picture
    # Crumbs at the edge of the cut are no scan.
    kept = np.isin(given.file_vertex[given.faces], whole.file_vertex[whole.measured]).all(axis=1)
    assert kept.mean() > 0.9
    np.testing.assert_array_equal(whole.uv[whole.measured_face], given.uv[kept])
    found, _ = texels(whole)
    assert len(found) > 1000
    image = samples_of(head.picture)
    column, row = np.moveaxis(head.part(near < 0.4).uv.mean(axis=1) * (1, -1) + (0, 1), 1, 0)
    truth = image[(row * image.shape[0]).astype(int), (column * image.shape[1]).astype(int)] / 255
    np.testing.assert_allclose(found.mean(axis=0), truth.mean(axis=0), atol=0.05)
    # No texel is of another colour than skin.
    assert found.min() > 0.2
    assert found[:, 0].min() > found[:, 2].min()


def test_relief_from_where_there_is_no_texture_is_said():
    """Half of many scans is textured: what was filled may be from the other half."""
    given = scan(striped())
    bare = given.uv.copy()
    bare[given.vertices[given.faces][:, :, 0].mean(axis=1) > 10] = np.nan
    whole = by_hand(replace(given, uv=bare), lambda at: at + (10, 0), 0.0)
    assert not whole.more_pictures
    np.testing.assert_array_equal(whole.uv[: len(given.faces)], bare)
    assert any("parts of the scan that have no place in its picture" in note for note in whole.notes)


def test_a_filling_that_would_need_too_many_texels_has_fewer(monkeypatch):
    monkeypatch.setattr("intaglio.relief.texturing._LEAST_SIDE", 16)
    given = scan(png(np.full((32, 32, 3), 90, np.uint8)))
    monkeypatch.setattr("intaglio.relief.texturing._Textured.density", lambda _: 100.0)
    whole = intaglio.complete_relief(given, "plane", extent="holes", window=3, rotations=1)
    assert max(samples_of(whole.pictures[-1]).shape[:2]) <= 32
    assert any("where the scan has 100" in note for note in whole.notes)
