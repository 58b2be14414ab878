"""Surfaces with several pictures, and what a filling adds to a textured scan's files: every type keeps all of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import intaglio
from intaglio import InputError, IntaglioWarning
from intaglio.mesh import files_beside
from tests.test_mesh_files import CORNERS, png, textured, write

RED, GREEN, BLUE = png((255, 0, 0)), png((0, 255, 0)), png((0, 0, 255), (4, 4))


def partly_filled():
    """Two measured triangles, and one that was filled between measured vertices, with a picture of its own."""
    uv = np.concatenate([textured().uv, [[[0.1, 0.1], [0.9, 0.1], [0.5, 0.9]]]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 2]])
    return intaglio.Surface(
        vertices=CORNERS,
        faces=faces,
        uv=uv,
        picture=RED,
        more_pictures=(GREEN,),
        face_picture=np.array([0, 0, 1]),
        measured_face=np.array([True, True, False]),
        confidence=np.array([1, 1, 1, 1, 0.25]),
        measured=np.array([True, True, True, True, False]),
        source=np.array([0, 1, 2, 3, 1]),
    )


@pytest.mark.parametrize("name", ["a.ply", "a b.obj", "a.glb", "a.gltf"])
def test_all_pictures_come_back_to_the_bit(tmp_path, name):
    surface = partly_filled()
    surface.write(tmp_path / name)
    back = intaglio.read_surface(tmp_path / name)
    assert back.pictures == (RED, GREEN)
    np.testing.assert_array_equal(back.face_picture, [0, 0, 1])
    np.testing.assert_allclose(back.uv, surface.uv, atol=1e-7)
    np.testing.assert_array_equal(back.vertices[back.faces], surface.vertices[surface.faces])
    if name != "a.ply":
        # Colours are those of the picture that a face shows.
        np.testing.assert_array_equal(back.color[[back.faces[0, 0], back.faces[2, 1]]], [[1, 0, 0], [0, 1, 0]])


def test_provenance_of_faces_and_confidence_come_back(tmp_path):
    surface = partly_filled()
    surface.write(tmp_path / "a.ply")
    back = intaglio.read_surface(tmp_path / "a.ply")
    np.testing.assert_array_equal(back.measured_face, surface.measured_face)
    np.testing.assert_array_equal(back.confidence, surface.confidence)
    bare = replace(surface, uv=None, picture=None, more_pictures=(), face_picture=None)
    bare.write(tmp_path / "b.ply")
    np.testing.assert_array_equal(intaglio.read_surface(tmp_path / "b.ply").measured_face, surface.measured_face)


def test_a_part_keeps_what_its_faces_have():
    part = partly_filled().part(np.array([False, True, True, False, True]))
    assert part.measured_face.tolist() == [False]
    assert part.face_picture.tolist() == [1]
    np.testing.assert_array_equal(part.confidence, np.float32([1, 1, 0.25]))


def test_mending_keeps_what_faces_have():
    surface = partly_filled()
    order = [2, 0, 0, 1]
    fields = {name: getattr(surface, name)[order] for name in ("faces", "uv", "face_picture", "measured_face")}
    mended = intaglio.mend_surface(replace(surface, **fields))
    assert mended.measured_face.tolist() == [False, True, True]
    assert mended.face_picture.tolist() == [1, 0, 0]


def test_files_beside_an_obj(tmp_path):
    surface = partly_filled()
    surface.write(tmp_path / "a.obj")
    assert (tmp_path / "a.png").read_bytes() == RED
    assert (tmp_path / "a_filling.png").read_bytes() == GREEN
    text = (tmp_path / "a.mtl").read_text()
    assert [line.split()[1] for line in text.splitlines() if line.startswith("newmtl")] == ["textured", "filling"]
    assert {p.name for p in tmp_path.iterdir()} == {"a.obj", *(p.name for p in files_beside(surface, tmp_path / "a.obj"))}
    assert intaglio.read_image(tmp_path / "a_measured.png").tolist() == [[0, 1], [1, 0]]
    assert (intaglio.read_image(tmp_path / "a_filling_measured.png") == 0).all()


def test_masks_show_where_measured_faces_lie(tmp_path):
    surface = replace(partly_filled(), picture=BLUE)
    uv = surface.uv.copy()
    # The measured faces lie in the left half of a picture of 4 x 4, one repetition further.
    uv[:2] = [[[1, 0], [1.5, 0], [1.5, 1]], [[1, 0], [1.5, 1], [1, 1]]]
    replace(surface, uv=uv).write(tmp_path / "a.glb")
    mask = intaglio.read_image(tmp_path / "a_measured.png")
    assert mask.shape == (4, 4)
    assert mask[:, 2:].max() == 0
    assert mask[:, :2].min() == 1
    assert {p.name for p in tmp_path.iterdir()} == {"a.glb", "a_measured.png", "a_filling_measured.png"}


def test_a_filling_to_come_is_told_by_what_it_adds(tmp_path):
    scan = textured()
    for name in ("a.ply", "a.obj", "a.glb"):
        told = set(files_beside(scan, tmp_path / name, to_be_filled=True))
        assert told == set(files_beside(partly_filled(), tmp_path / name)), name
    assert not files_beside(scan, tmp_path / "a.stl", to_be_filled=True)


def test_a_picture_that_cannot_be_read_has_no_mask(tmp_path):
    with pytest.warns(IntaglioWarning, match=r"a_measured\.png: not written, since its picture"):
        replace(partly_filled(), picture=b"GIF89a, say").write(tmp_path / "a.obj")
    assert not (tmp_path / "a_measured.png").exists()
    assert (tmp_path / "a_filling_measured.png").exists()


def test_a_scan_without_a_filling_has_no_masks(tmp_path):
    textured().write(tmp_path / "a.obj")
    assert {p.name for p in tmp_path.iterdir()} == {"a.obj", "a.mtl", "a.png"}


def test_materials_of_other_programs_keep_their_pictures(tmp_path):
    write(tmp_path / "one.png", RED)
    write(tmp_path / "two.png", BLUE)
    write(tmp_path / "a.mtl", "newmtl bark\nmap_Kd one.png\nnewmtl moss\nmap_Kd two.png\nnewmtl bare\nKd 1 0 0\n")
    text = "mtllib a.mtl\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
    text += "vt 0 0\nvt 1 0\nvt 1 1\nusemtl moss\nf 1/1 2/2 3/3\nusemtl bare\nf 1/1 3/2 4/3\nusemtl bark\nf 2/1 5/2 3/3\n"
    surface = intaglio.read_surface(write(tmp_path / "a.obj", text))
    assert surface.pictures == (BLUE, RED)
    assert surface.face_picture.tolist() == [0, -1, 1]
    assert not surface.notes
    surface.write(tmp_path / "b.obj")
    again = intaglio.read_surface(tmp_path / "b.obj")
    assert again.pictures == (BLUE, RED)
    assert again.face_picture.tolist() == [0, -1, 1]


def test_an_obj_with_vertices_that_no_face_uses_keeps_its_colours(tmp_path):
    """Positions and texture coordinates of vertices that were cut out of a scan stay behind in many files."""
    write(tmp_path / "a.png", RED)
    write(tmp_path / "a.mtl", "newmtl skin\nmap_Kd a.png\n")
    text = "mtllib a.mtl\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
    text += "vt 0 0\nvt 1 0\nvt 1 1\nvt 0.5 0.5\nusemtl skin\nf 2/2 5/1 3/3\n"
    surface = intaglio.read_surface(write(tmp_path / "a.obj", text))
    assert surface.picture == RED
    np.testing.assert_array_equal(surface.color[[1, 4, 2]], np.tile([1.0, 0, 0], (3, 1)))
    for name in ("b.obj", "b.glb", "b.ply"):
        surface.write(tmp_path / name)
        back = intaglio.read_surface(tmp_path / name)
        assert back.picture == RED
        np.testing.assert_array_equal(back.color[back.faces[0]], np.tile([1.0, 0, 0], (3, 1)))
    plain = replace(surface, uv=None, picture=None)
    for name in ("c.obj", "c.off", "c.glb", "c.ply"):
        plain.write(tmp_path / name)
        back = intaglio.read_surface(tmp_path / name)
        np.testing.assert_array_equal(back.color[back.faces[0]], np.tile([1.0, 0, 0], (3, 1)))


def test_dark_colours_of_an_off_stay_dark(tmp_path):
    dark = intaglio.Surface(vertices=CORNERS[:3], faces=np.array([[0, 1, 2]]), color=np.full((3, 3), 1 / 255 / 12.92))
    dark.write(tmp_path / "a.off")
    np.testing.assert_allclose(intaglio.read_surface(tmp_path / "a.off").color, dark.color, rtol=1e-5)


def test_vertices_without_a_colour_take_the_pictures(tmp_path):
    write(tmp_path / "a.png", RED)
    write(tmp_path / "a.mtl", "newmtl skin\nmap_Kd a.png\n")
    text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0 0 1 0\nv 0 1 0\nv 9 9 9\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl skin\nf 1/1 2/2 3/3\n"
    surface = intaglio.read_surface(write(tmp_path / "a.obj", text))
    np.testing.assert_array_equal(surface.color, [[1, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 0]])


def test_a_ply_of_which_one_picture_is_missing(tmp_path):
    partly_filled().write(tmp_path / "a.ply")
    (tmp_path / "a.png").unlink()
    back = intaglio.read_surface(tmp_path / "a.ply")
    assert back.pictures == (GREEN,)
    assert back.face_picture.tolist() == [-1, -1, 0]
    assert any("a.png not found" in note for note in back.notes)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"measured_face": np.ones(2, bool)}, "measured_face must have shape"),
        ({"measured_face": np.ones(3)}, "measured_face must be bool"),
        ({"confidence": np.full(5, 1.5)}, "confidence must be from 0 to 1"),
        ({"face_picture": np.array([0, 1, 2])}, "face_picture must hold numbers of the 2 pictures"),
        ({"face_picture": None}, "more_pictures go with"),
    ],
)
def test_fields_that_do_not_fit(fields, message):
    with pytest.raises(InputError, match=message):
        replace(partly_filled(), **fields)
