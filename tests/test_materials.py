"""Folders of material maps: what names mean, what is chosen and mended, and the same names written back."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from skimage import data

import intaglio
from intaglio import FileError, InputError
from intaglio.files import read_samples
from intaglio.kernels.transfer import decode_srgb
from intaglio.synthesis import holds_material

SIZE = (48, 56)
GRAY = data.gravel()[: SIZE[0], : SIZE[1]]
COLOR = np.stack([np.roll(GRAY, 3 * i, 1) for i in range(3)], axis=2)


def unit_normals():
    """Return 8-bit normals (H, W, 3) of the gravel, of unit length up to rounding."""
    slope = np.stack(np.gradient(GRAY / 64.0)[::-1], axis=2)
    normal = np.dstack([-slope[..., 0], slope[..., 1], np.ones(SIZE)])
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return np.round((normal + 1) / 2 * 255).astype(np.uint8)


NORMAL = unit_normals()


def save(path, values):
    Image.fromarray(values).save(path)


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("Bricks001_2K-JPG_Color.png", "color"),
        ("Bricks001_2K_NormalGL.png", "normal"),
        ("Bricks001_2K_AmbientOcclusion.png", "ao"),
        ("Metal032_1K-PNG_Metalness.png", "metalness"),
        ("rusty_metal_diff_2k.png", "color"),
        ("rusty_metal_nor_gl_2k.png", "normal"),
        ("rusty_metal_disp_4k.png", "displacement"),
        ("rusty_metal_arm_2k.png", "arm"),
        ("rusty_metal_rough_2k.png", "roughness"),
        ("Wood_Base_Color.png", "color"),
        ("Wood_BaseColor.1001.png", "color"),
        ("Wood_Normal_OpenGL.png", "normal"),
        ("Wood_Ambient_Occlusion.png", "ao"),
        ("Wood_Metallic.png", "metalness"),
        ("Wood_Height_16bit.png", "displacement"),
        ("Map-COL.png", "color"),
        ("brick_bump.png", "bump"),
        ("wool_depth.png", "displacement"),
        ("albedo.png", "color"),
    ],
)
def test_names(tmp_path, name, kind):
    save(tmp_path / name, NORMAL)
    material = intaglio.read_material(tmp_path)
    assert dict(material.files) == {kind: name}
    assert material.notes == ()


def test_maps_get_their_meaning_from_their_names(tmp_path):
    for name in ("w_Color.png", "w_Specular.png", "w_NormalGL.png", "w_ARM.png"):
        save(tmp_path / name, NORMAL)
    for name in ("w_Roughness.png", "w_Opacity.png"):
        save(tmp_path / name, GRAY)
    save(tmp_path / "w_Displacement.png", GRAY.astype(np.uint16) * 200)
    material = intaglio.read_material(tmp_path)
    assert dict(material.bits) == dict.fromkeys(material.maps, 8) | {"displacement": 16}
    for kind in ("color", "specular"):
        np.testing.assert_allclose(material.maps[kind], decode_srgb(NORMAL / np.float32(255)), atol=1e-6)
    for kind in ("normal", "arm"):
        np.testing.assert_allclose(material.maps[kind], NORMAL / 255, atol=1e-6)
    for kind in ("roughness", "opacity"):
        np.testing.assert_allclose(material.maps[kind], GRAY / 255, atol=1e-6)
    np.testing.assert_allclose(material.maps["displacement"], GRAY.astype(float) * 200 / 65535, atol=1e-6)
    assert material.notes == ()
    assert material.values.shape == (*SIZE, 15)


def test_written_back_to_the_bit(tmp_path):
    save(tmp_path / "w_Color.png", COLOR)
    save(tmp_path / "w_NormalGL.png", NORMAL)
    save(tmp_path / "w_Height.tif", GRAY.astype(np.uint16) * 201)
    intaglio.write_exr({"Y": GRAY.astype(np.float32) * 3}, tmp_path / "w_Bump.exr")
    written = intaglio.read_material(tmp_path).write(tmp_path / "out")
    assert sorted(p.name for p in written) == ["w_Bump.exr", "w_Color.png", "w_Height.tif", "w_NormalGL.png"]
    for path in written:
        np.testing.assert_array_equal(read_samples(path), read_samples(tmp_path / path.name))
        assert read_samples(path).dtype == read_samples(tmp_path / path.name).dtype


def test_normals_for_directx_are_turned(tmp_path):
    save(tmp_path / "w_NormalGL.png", NORMAL)
    save(tmp_path / "w_NormalDX.png", np.dstack([NORMAL[..., 0], 255 - NORMAL[..., 1], NORMAL[..., 2]]))
    material = intaglio.read_material(tmp_path)
    assert material.files["normal"] == "w_NormalGL.png"
    assert material.notes == ("left out: w_NormalDX.png, since w_NormalGL.png is the normal map too",)
    (tmp_path / "w_NormalGL.png").unlink()
    turned = intaglio.read_material(tmp_path)
    assert turned.files["normal"] == "w_NormalGL.png"
    assert "DirectX" in turned.notes[0]
    np.testing.assert_allclose(turned.maps["normal"], material.maps["normal"], atol=1e-6)


def test_normals_become_of_unit_length(tmp_path):
    values = NORMAL.copy()
    values[:10] = (128, 128, 200)  # straight up, but short
    values[10, 0] = (127, 128, 127)  # nowhere
    save(tmp_path / "w_Normal.png", values)
    material = intaglio.read_material(tmp_path)
    length = np.linalg.norm(material.maps["normal"].astype(float) * 2 - 1, axis=2)
    assert np.abs(length - 1).max() < 0.021
    assert "w_Normal.png: 20.9% of its normals were made of unit length" in material.notes
    # What was right keeps its bits.
    np.testing.assert_array_equal(material.maps["normal"][11:], (values / np.float32(255))[11:].astype(np.float32))
    save(tmp_path / "w_Normal.png", np.dstack([NORMAL[..., :2], np.zeros(SIZE, np.uint8)]))
    made = intaglio.read_material(tmp_path)
    assert "its blue is empty" in made.notes[0]
    np.testing.assert_allclose(made.maps["normal"], NORMAL / 255, atol=0.03)


def test_one_of_several_resolutions_and_materials(tmp_path):
    for name in ("a_1K_Color.png", "a_1K_Roughness.png", "a_2K_Color.png", "a_2K_Roughness.png", "b_Color.png", "preview.png"):
        save(tmp_path / name, GRAY)
    material = intaglio.read_material(tmp_path)
    assert set(material.files.values()) == {"a_2K_Color.png", "a_2K_Roughness.png"}
    assert material.notes == (
        "left out as another size or material: a_1K_Color.png, a_1K_Roughness.png, b_Color.png",
        "left out, since their names tell no map: preview.png",
    )


def test_maps_that_do_not_fit(tmp_path):
    save(tmp_path / "w_Color.png", COLOR)
    save(tmp_path / "w_Roughness.png", GRAY[:20])
    with pytest.raises(InputError, match=r"differ in size \(w_Color.png 56 x 48, w_Roughness.png 56 x 20\)"):
        intaglio.read_material(tmp_path)
    (tmp_path / "w_Roughness.png").unlink()
    save(tmp_path / "w_Normal.png", GRAY)
    with pytest.raises(InputError, match=r"w_Normal.png: is named like a map of three channels"):
        intaglio.read_material(tmp_path)
    (tmp_path / "w_Normal.png").unlink()
    intaglio.write_exr({"Y": np.full(SIZE, np.nan)}, tmp_path / "w_Height.exr")
    with pytest.raises(InputError, match="not finite"):
        intaglio.read_material(tmp_path)
    for wrong, message in ((tmp_path / "none", "no such folder"), (tmp_path / "w_Color.png", "is a file")):
        with pytest.raises(FileError, match=message):
            intaglio.read_material(wrong)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileError, match="no image in it is named like a map"):
        intaglio.read_material(tmp_path / "empty")


def test_photographs_under_lights_are_no_material(tmp_path):
    save(tmp_path / "albedo.png", COLOR)
    assert holds_material(tmp_path)
    (tmp_path / "capture.lp").write_text("1\nalbedo.png 0 0 1\n")
    assert not holds_material(tmp_path)
    assert not holds_material(tmp_path / "none")


def test_a_larger_material(run, tmp_path):
    folder = tmp_path / "wood"
    folder.mkdir()
    save(folder / "Wood_1K-PNG_Color.png", COLOR)
    save(folder / "Wood_1K-PNG_NormalDX.png", NORMAL)
    save(folder / "Wood_1K-PNG_Displacement.png", GRAY.astype(np.uint16) * 201)
    Image.fromarray(GRAY).save(folder / "Wood_1K-PNG_Roughness.jpg", quality=95)
    out = tmp_path / "big"
    status, said, errors = run("synthesize", folder, "-o", out, "--size", "80x70", "--block", "14", "--exact")
    assert status == 0, errors
    assert "normal (Wood_1K-PNG_NormalGL.png)" in errors
    assert "80 x 70 pixels" in said
    names = {"Wood_1K-PNG_Color.png", "Wood_1K-PNG_NormalGL.png", "Wood_1K-PNG_Displacement.png", "Wood_1K-PNG_Roughness.jpg"}
    assert {p.name for p in out.iterdir()} == {*names, "source.exr"}
    channels, _ = intaglio.read_exr(out / "source.exr")
    row, column = (channels[f"source.{n}"].astype(int) for n in ("row", "column"))
    np.testing.assert_array_equal(read_samples(out / "Wood_1K-PNG_Color.png"), COLOR[row, column])
    np.testing.assert_array_equal(read_samples(out / "Wood_1K-PNG_Displacement.png"), GRAY[row, column].astype(np.uint16) * 201)
    green = 255 - NORMAL[..., 1]
    np.testing.assert_array_equal(read_samples(out / "Wood_1K-PNG_NormalGL.png")[..., 1], green[row, column])
    for words, message in [
        ([folder, "-o", folder, "--size", "80x70"], "is the folder of the sample itself"),
        ([folder, "-o", tmp_path / "o.png", "--size", "80x70"], "give the name of one"),
        ([folder, "-o", out, "--size", "80x70", "--kind", "ptm"], "--kind is for photographs"),
    ]:
        status, _, errors = run("synthesize", *words)
        assert status == 2
        assert message in errors
        assert errors.count("\n") == 1


def test_what_a_folder_is(run, tmp_path):
    save(tmp_path / "w_Color.png", COLOR)
    save(tmp_path / "w_Height.png", GRAY.astype(np.uint16) * 201)
    status, said, _ = run("info", tmp_path)
    assert status == 0
    assert "material: 2 maps of 56 x 48 pixels" in said
    assert "displacement: w_Height.png, 16 bits, 1 channel" in said


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("ambientcg_Facade005", {"color", "normal", "roughness", "displacement", "metalness"}),
        ("ambientcg_Rock053", {"color", "normal", "roughness", "displacement", "ao"}),
        ("threejs_brick", {"color", "roughness", "bump"}),
        ("godot_wool", {"color", "normal", "displacement"}),
    ],
)
def test_real_materials(real, name, kinds):
    folder = real(f"materials/{name}")
    assert holds_material(folder)
    material = intaglio.read_material(folder)
    assert set(material.maps) == kinds
    if "normal" in kinds:
        length = np.linalg.norm(material.maps["normal"].astype(float) * 2 - 1, axis=2)
        assert np.abs(length - 1).max() < 0.021


def test_deep_colours_are_encoded_whether_or_not_they_say_so(tmp_path):
    deep = COLOR.astype(np.uint16) * 257
    intaglio.write_image(deep / 65535, tmp_path / "w_Color.png", bits=16, linear=True)
    material = intaglio.read_material(tmp_path)
    np.testing.assert_allclose(material.maps["color"], decode_srgb(deep / np.float32(65535)), atol=1e-5)
    material.write(tmp_path / "out")
    np.testing.assert_array_equal(read_samples(tmp_path / "out" / "w_Color.png"), deep)
