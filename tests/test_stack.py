"""Reading photometric stacks: every format, every depth, and what is wrong with a capture."""

from __future__ import annotations

import numpy as np
import pytest
import tifffile
from PIL import Image
from stacks import dome, noisy, write_capture

import intaglio
from intaglio import FileError, InputError, PhotometricStack, light_direction, read_stack
from intaglio.kernels.transfer import decode_srgb
from intaglio.photometric.light_positions import read_light_positions, read_lights_csv, read_table
from intaglio.photometric.mirror_sphere import fit_circle, lights_from_sphere
from intaglio.photometric.stack import Exposure


@pytest.fixture
def stack():
    return noisy(dome(4, (20, 50)), channels=3)


@pytest.mark.parametrize("count_line", [True, False])
def test_lp_file_and_folder_give_the_same_bits(stack, tmp_path, count_line):
    path = write_capture(tmp_path / "capture", stack, count_line=count_line)
    for given in (path, path.parent):
        read = read_stack(given)
        np.testing.assert_array_equal(read.images, stack.images)
        np.testing.assert_allclose(read.lights, stack.lights, atol=1e-15)
        assert read.names[3].endswith("image_3.exr")


def test_names_with_spaces_and_folders(stack, tmp_path):
    write_capture(tmp_path / "my pictures", stack)
    lines = [f"my pictures\\image_{k}.exr {x} {y} {z}" for k, (x, y, z) in enumerate(stack.lights)]
    (tmp_path / "a.lp").write_text("\n".join(lines))
    np.testing.assert_array_equal(read_stack(tmp_path / "a.lp").images, stack.images)


def test_lp_without_names_takes_images_in_natural_order(tmp_path):
    stack = noisy(dome(6, (20, 50)))
    path = write_capture(tmp_path, stack)
    path.write_text("\n".join(" ".join(map(str, light)) for light in stack.lights))
    names, lights = read_light_positions(path)
    assert names == []
    assert lights.shape == (12, 3)
    np.testing.assert_array_equal(read_stack(path).images, stack.images)


@pytest.mark.parametrize(
    "text",
    [
        "image,tilt,slant\nimage_0.exr,30,45\nimage_1.exr,270,0\n",
        "image_0.exr,30,45\nimage_1.exr,270,0\n",
        "slant;tilt;image\n45;30;image_0.exr\n0;270;image_1.exr\n",
        "image\tx\ty\tz\nimage_0.exr\t0.61237244\t0.35355339\t0.70710678\nimage_1.exr\t0\t0\t2\n",
        "image_0.exr,0.61237244,0.35355339,0.70710678\nimage_1.exr,0,0,7\n",
    ],
)
def test_lights_csv(text, tmp_path):
    (tmp_path / "lights.csv").write_text(text)
    names, lights = read_lights_csv(tmp_path / "lights.csv")
    assert names == ["image_0.exr", "image_1.exr"]
    np.testing.assert_allclose(lights, [light_direction(30, 45), [0, 0, 1]], atol=1e-8)


@pytest.mark.parametrize("text", ["", "a.png\n", "a.png,1,x\n", "a.png,nan,4\n", "a.png,0,0,0\n", "image,tilt\na.png,3\n"])
def test_lights_csv_that_is_none(text, tmp_path):
    (tmp_path / "lights.csv").write_text(text)
    with pytest.raises((InputError, FileError), match=r"lights\.csv"):
        read_lights_csv(tmp_path / "lights.csv")


@pytest.mark.parametrize("transposed", [False, True])
@pytest.mark.parametrize("strengths", [None, 1, 3])
def test_tables_of_directions_and_intensities(stack, tmp_path, transposed, strengths):
    write_capture(tmp_path, stack).unlink()
    table = stack.lights.T if transposed else stack.lights
    np.savetxt(tmp_path / "light_directions.txt", 2.5 * table)
    expected = stack.images.astype(np.float64)
    if strengths is not None:
        strength = np.linspace(0.5, 2, len(stack.lights) * strengths).reshape(-1, strengths)
        np.savetxt(tmp_path / "light_intensities.txt", strength)
        expected = expected / strength[:, None, None, :]
    read = read_stack(tmp_path)
    np.testing.assert_allclose(read.lights, stack.lights, atol=1e-12)
    np.testing.assert_allclose(read.images, expected, rtol=1e-6)


def test_a_square_table_is_read_by_rows(tmp_path):
    np.savetxt(tmp_path / "t.txt", [[1, 2, 3], [4, 5, 6], [7, 8, 9]])
    np.testing.assert_array_equal(read_table(tmp_path / "t.txt", (3,), "numbers")[0], [1, 2, 3])
    np.savetxt(tmp_path / "t.txt", np.zeros((4, 5)))
    with pytest.raises(InputError, match="need 3 columns or rows, the table is 4 x 5"):
        read_table(tmp_path / "t.txt", (3,), "numbers")


def depth_of(path, samples):
    """Write 16-bit samples with steps far finer than 8 bits."""
    if path.suffix == ".png":
        from intaglio.render.variants import mitsuba

        mitsuba().Bitmap(samples).write(str(path))
    else:
        tifffile.imwrite(path, samples, photometric="rgb" if samples.ndim == 3 else "minisblack")


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("channels", [1, 3])
def test_sixteen_bits_are_read_as_sixteen(tmp_path, suffix, channels):
    samples = (np.arange(6 * 5 * channels, dtype=np.uint16) * 3 + 30000).reshape(6, 5, channels)
    for k in range(3):
        depth_of(tmp_path / f"i{k}{suffix}", samples[..., 0] if channels == 1 else samples)
    (tmp_path / "l.lp").write_text("\n".join(f"i{k}{suffix} {k} 0 1" for k in range(3)))
    read = read_stack(tmp_path / "l.lp")
    np.testing.assert_array_equal(np.round(read.images[1] * 65535).astype(np.uint16), samples)


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tga", ".tif", ".jpg"])
@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_eight_bit_types(tmp_path, suffix, mode):
    levels = np.arange(64, dtype=np.uint8).reshape(8, 8) * 3 + 20
    image = Image.fromarray(levels).convert(mode)
    for k in range(3):
        image.save(tmp_path / f"i{k}{suffix}", **({"quality": 100} if suffix == ".jpg" else {}))
    (tmp_path / "l.lp").write_text("\n".join(f"i{k}{suffix} {k} 0 1" for k in range(3)))
    read = read_stack(tmp_path / "l.lp", "linear")
    assert read.shape == (3, 8, 8, 1 if mode == "L" else 3)
    np.testing.assert_allclose(read.images[2, :, :, 0] * 255, levels, atol=2 if suffix == ".jpg" else 1e-4)


@pytest.mark.parametrize(
    ("response", "linear"),
    [(None, decode_srgb), ("srgb", decode_srgb), ("linear", lambda v: v), (2.2, lambda v: v**2.2)],
)
def test_response(tmp_path, response, linear):
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    Image.fromarray(levels).save(tmp_path / "a.png")
    (tmp_path / "l.lp").write_text("a.png 0 0 1")
    np.testing.assert_allclose(read_stack(tmp_path / "l.lp", response).images[0, :, :, 0], linear(levels / 255), atol=1e-6)


def test_a_stack_on_disk_reads_the_same(stack, tmp_path):
    path = write_capture(tmp_path, stack)
    far = read_stack(path, memory=0)
    assert not far.in_memory
    assert "one at a time" in far.notes[0]
    for k in range(len(stack.lights)):
        np.testing.assert_array_equal(far.image(k), stack.image(k))
    strips = list(far.strips(size=4000))
    assert len(strips) == 3
    np.testing.assert_array_equal(np.concatenate([s for _, s in strips], axis=1), stack.images)
    np.testing.assert_array_equal(far.subset([5, 2]).image(1), stack.image(2))
    np.testing.assert_allclose(far.luminance().image(1), stack.luminance().image(1), rtol=1e-6)
    near = read_stack(path, gray=True)
    np.testing.assert_allclose(near.images, stack.images.mean(axis=3, keepdims=True), rtol=1e-6)


def test_mask_beside_or_given(stack, tmp_path):
    path = write_capture(tmp_path, stack)
    levels = np.zeros(stack.shape[1:3], np.uint8)
    levels[2:5, 3:] = 255
    Image.fromarray(levels).save(tmp_path / "mask.png")
    for read in (read_stack(path), read_stack(path, mask=tmp_path / "mask.png"), read_stack(path, mask=levels > 0)):
        np.testing.assert_array_equal(read.mask, levels > 0)
    assert "mask.png" in read_stack(path).notes[0]


def test_missing_images_are_all_named(stack, tmp_path):
    path = write_capture(tmp_path, stack)
    for k in (1, 6):
        (tmp_path / f"image_{k}.exr").unlink()
    with pytest.raises(FileError, match=r"2 of its 8 images are missing.*image_1\.exr.*image_6\.exr"):
        read_stack(path, strict=True)


def test_images_of_unequal_size_or_kind(stack, tmp_path):
    path = write_capture(tmp_path, stack)
    intaglio.write_image(stack.image(0)[:-1], tmp_path / "image_4.exr")
    with pytest.raises(InputError, match=r"image_4\.exr.*10 x 8 pixels.*other images are 10 x 9"):
        read_stack(path, strict=True)
    intaglio.write_image(stack.image(0)[:, :, 0], tmp_path / "image_4.exr")
    with pytest.raises(InputError, match=r"image_4\.exr.*1 channel.*3 channels"):
        read_stack(path, strict=True)


def test_a_truncated_image(stack, tmp_path):
    path = write_capture(tmp_path, stack, ".png")
    content = (tmp_path / "image_3.png").read_bytes()
    (tmp_path / "image_3.png").write_bytes(content[: len(content) // 2])
    with pytest.raises(FileError, match=r"image_3\.png"):
        read_stack(path, strict=True)


def test_nan_pixels_are_named_or_masked(stack, tmp_path):
    images = stack.images.copy()
    images[2, 4, 1] = np.nan
    with pytest.raises(InputError, match=r"image 2: 1 pixels are not finite.*row 4, column 1"):
        PhotometricStack(images, stack.lights)
    mask = np.ones(stack.shape[1:3], bool)
    mask[4, 1] = False
    PhotometricStack(images, stack.lights, mask)


@pytest.mark.parametrize(
    ("lights", "message"),
    [
        ([[0, 0, 1], [0, 0, 0]], "not zero; light 1 is"),
        ([[0, 0, 1], [0, np.nan, 1]], "light 1"),
        ([[0, 0, 1], [1, 0, -0.1]], "light 1.*below the surface"),
        ([[0, 0, 1]], "2 images but 1 lights"),
        ([[0, 1], [1, 1]], r"must be \(K, 3\)"),
        ("abc", "lights"),
    ],
)
def test_bad_lights(lights, message):
    with pytest.raises(InputError, match=message):
        PhotometricStack(np.ones((2, 3, 3, 1)), lights)


@pytest.mark.parametrize(
    ("images", "message"),
    [
        (np.ones((2, 3)), r"must be \(K, H, W, C\)"),
        (np.ones((0, 3, 3, 1)), "with pixels"),
        (np.ones((2, 3, 3, 1), np.uint8), "divide uint8 levels"),
        ([np.ones((3, 3)), np.ones((3, 4))], "images"),
    ],
)
def test_bad_images(images, message):
    with pytest.raises(InputError, match=message):
        PhotometricStack(images, [[0, 0, 1], [0, 1, 1]])


def test_bad_masks():
    images, lights = np.ones((2, 3, 3, 1)), [[0, 0, 1], [0, 1, 1]]
    with pytest.raises(InputError, match=r"\(3, 4\).*\(3, 3\)"):
        PhotometricStack(images, lights, np.ones((3, 4), bool))
    with pytest.raises(InputError, match="empty"):
        PhotometricStack(images, lights, np.zeros((3, 3), bool))


@pytest.mark.parametrize("response", ["gamma", -1.0, 0.0, np.nan])
def test_bad_response(stack, tmp_path, response):
    with pytest.raises(InputError, match="response"):
        read_stack(write_capture(tmp_path, stack), response)


def test_folders_that_are_no_capture(stack, tmp_path):
    with pytest.raises(FileError, match=r"neither an \.lp"):
        read_stack(tmp_path)
    path = write_capture(tmp_path, stack)
    (tmp_path / "other.lp").write_text(path.read_text())
    with pytest.raises(InputError, match="more than one"):
        read_stack(tmp_path)
    with pytest.raises(FileError, match=r"known are \.lp"):
        read_stack(tmp_path / "image_0.exr")
    with pytest.raises(FileError, match="no such file"):
        read_stack(tmp_path / "nowhere.lp")
    (tmp_path / "light_intensities.txt").write_text("1\n2\n")
    with pytest.raises(InputError, match="2 light intensities for 8 images"):
        read_stack(path)


def test_exposure_counts():
    images = np.full((2, 2, 5, 1), 0.5, np.float32)
    images[0, 0, :3] = 1
    images[1, 1, 0] = 0
    stack = PhotometricStack(images, [[0, 0, 1], [0, 1, 1]], np.array([[True] * 5, [False] + [True] * 4]))
    seen = Exposure()
    for k in range(2):
        seen.add(stack, k, stack.image(k))
    assert seen.shares == (3 / 18, 0.0)


def mirror(lights, size=201, radius=80.0, centre=(103.0, 97.0)):
    """Pictures of a mirror sphere: a spot where the normal halves the angle between light and eye, on a dark disc."""
    row, column = np.mgrid[:size, :size]
    u, v = (column - centre[0]) / radius, -(row - centre[1]) / radius
    inside = u * u + v * v < 1
    normal = np.stack([u, v, np.sqrt(np.maximum(1 - u * u - v * v, 0))], axis=-1)
    pictures = []
    for light in lights:
        half = light + (0, 0, 1)
        half = half / np.linalg.norm(half)
        pictures.append(np.where(inside, 0.05 + np.exp(-((1 - normal @ half) / 2e-3)), 0.4))
    return pictures


def test_lights_from_a_mirror_sphere():
    lights = dome(6, (10, 40, 65))
    found = lights_from_sphere(mirror(lights))
    np.testing.assert_allclose(found.circle, (103, 97, 80), atol=1.0)
    angle = np.degrees(np.arccos(np.clip((found.lights * lights).sum(axis=1), -1, 1)))
    assert angle.max() < 1.5
    given = lights_from_sphere(mirror(lights), circle=(103.0, 97.0, 80.0))
    angle = np.degrees(np.arccos(np.clip((given.lights * lights).sum(axis=1), -1, 1)))
    assert angle.max() < 0.5


def test_a_sphere_in_the_photographs_themselves(tmp_path):
    """A hand-held flash: sample to the left, mirror ball to the right, and no other record of the lights."""
    lights = dome(6, (20, 50))
    sample = noisy(lights, height=201, width=150).images[..., 0]
    for k, ball in enumerate(mirror(lights)):
        picture = np.concatenate([0.5 * sample[k], ball], axis=1)
        Image.fromarray(np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)).save(tmp_path / f"{k:02d}.png")
    stack = read_stack(tmp_path, "linear", sphere=tmp_path, circle=(150 + 103.0, 97.0, 80.0))
    assert np.degrees(np.arccos(np.clip((stack.lights * lights).sum(axis=1), -1, 1))).max() < 0.6
    assert stack.shape == (12, 201, 351, 1)
    for circle in ((999, 97, 80), (103, 97, 0), (1, 2), "ball"):
        with pytest.raises(InputError, match="circle"):
            read_stack(tmp_path, sphere=tmp_path, circle=circle)
    with pytest.raises(InputError, match="give the folder of its pictures"):
        read_stack(tmp_path, circle=(103, 97, 80))


def test_spheres_that_are_none():
    with pytest.raises(InputError, match="one size"):
        lights_from_sphere([])
    with pytest.raises(InputError, match="no highlight"):
        lights_from_sphere([np.full((50, 50), 0.3)], circle=(25, 25, 20))
    with pytest.raises(intaglio.FitError, match="no circle"):
        fit_circle(np.zeros((64, 64)))
    with pytest.raises(intaglio.FitError, match="too small"):
        fit_circle(np.zeros((5, 64)))


def test_real_chrome_sphere(real):
    """The capture's own directions, from its authors' hand-fitted circles, within a degree on average."""
    folder = real("photometric/harvard_cat")
    for probe in ("LightProbe-1", "LightProbe-2"):
        stack = read_stack(folder / "Objects", "linear", sphere=folder / probe)
        known = read_table(folder / probe / "light_directions.txt", (3,), "directions")
        known /= np.linalg.norm(known, axis=1, keepdims=True)
        angle = np.degrees(np.arccos(np.clip((stack.lights * known).sum(axis=1), -1, 1)))
        assert angle.mean() < 1.5
        assert angle.max() < 3.0


def test_real_formats(real):
    stack = read_stack(real("photometric/diligent_ball"))
    assert stack.shape == (96, 158, 158, 3)
    assert stack.mask is not None
    # 16 bits: far more levels than 8 could have.
    assert len(np.unique(stack.images[0])) > 1000
    assert read_stack(real("photometric/harvard_cat"), "linear").shape == (20, 640, 500, 1)
    assert read_stack(real("photometric/lionhead_rti_tiny"), "linear").shape == (240, 43, 64, 3)
    names, lights = read_light_positions(real("photometric/formats/cceh_dome1.lp"))
    assert names == []
    assert len(lights) == 60


# ---- hostile input ----


def eight_bit_capture(folder, count=3, suffix=".png", write=None):
    for k in range(count):
        levels = (np.arange(48, dtype=np.uint8).reshape(6, 8) * 3 + 10 * k + 20).astype(np.uint8)
        if write is None:
            Image.fromarray(levels).save(folder / f"i{k}{suffix}")
        else:
            write(folder / f"i{k}{suffix}", levels)
    path = folder / "c.lp"
    path.write_text("\n".join(f"i{k}{suffix} {k} 0.5 1" for k in range(count)))
    return path


def test_sample_types_must_not_mix(tmp_path):
    path = eight_bit_capture(tmp_path, suffix=".tif", write=lambda p, v: tifffile.imwrite(p, v))
    for other in (np.int8, np.int16, np.uint16, np.float32):
        tifffile.imwrite(tmp_path / "i1.tif", np.full((6, 8), 3, other))
        with pytest.raises(FileError, match=rf"i1\.tif: holds {np.dtype(other)} values"):
            read_stack(path, strict=True)


@pytest.mark.parametrize("kind", [np.uint32, np.int32, np.uint64, np.complex64])
def test_sample_types_without_a_range(tmp_path, kind):
    tifffile.imwrite(tmp_path / "i0.tif", np.ones((6, 8), kind))
    (tmp_path / "c.lp").write_text("i0.tif 0 0 1")
    with pytest.raises(FileError, match=r"i0\.tif"):
        read_stack(tmp_path / "c.lp")


def test_tiff_colours_are_read_as_they_are_meant(tmp_path):
    color = np.random.default_rng(0).integers(0, 255, (6, 8, 3), np.uint8)
    tifffile.imwrite(tmp_path / "planar.tif", np.moveaxis(color, 2, 0), photometric="rgb", planarconfig="separate")
    np.testing.assert_array_equal(np.round(intaglio.read_image(tmp_path / "planar.tif", linear=True) * 255), color)
    tifffile.imwrite(tmp_path / "white.tif", color[..., 0], photometric="miniswhite")
    np.testing.assert_array_equal(np.round(intaglio.read_image(tmp_path / "white.tif", linear=True) * 255), 255 - color[..., 0])
    Image.fromarray(color).convert("CMYK").save(tmp_path / "cmyk.tif")
    with pytest.raises(FileError, match="CMYK"):
        intaglio.read_image(tmp_path / "cmyk.tif")
    palette = Image.fromarray(color).quantize(64)
    palette.save(tmp_path / "palette.tif")
    found = np.round(intaglio.read_image(tmp_path / "palette.tif", linear=True) * 255)
    np.testing.assert_array_equal(found, np.asarray(palette.convert("RGB")))


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_lights_of_any_length(scale, tmp_path):
    path = eight_bit_capture(tmp_path)
    path.write_text("\n".join(f"i{k}.png {k * scale} {0.5 * scale} {scale}" for k in range(3)))
    lights = read_stack(path).lights
    np.testing.assert_allclose(lights[1], np.array([1, 0.5, 1]) / 1.5, rtol=1e-12)
    np.testing.assert_allclose(PhotometricStack(np.ones((1, 2, 2)), [[0, 0, min(scale, 1e60)]]).lights, [[0, 0, 1]])


def test_masks_of_other_kinds(tmp_path):
    path = eight_bit_capture(tmp_path)
    alpha = np.full((6, 8, 4), 255, np.uint8)
    alpha[:, 4:, 3] = 0
    Image.fromarray(alpha).save(tmp_path / "cut.png")
    assert read_stack(path, mask=tmp_path / "cut.png").mask.sum() == 24
    levels = np.full((6, 8), 0.2)
    levels[0] = 0.8
    assert read_stack(path, mask=levels).mask.sum() == 8
    assert read_stack(path, mask=levels.tolist()).mask.sum() == 8
    with pytest.raises(InputError, match="mask"):
        read_stack(path, mask=np.full((6, 8), "x"))


def test_a_sphere_picture_for_every_image(tmp_path):
    (tmp_path / "object").mkdir()
    (tmp_path / "sphere").mkdir()
    eight_bit_capture(tmp_path / "object").unlink()
    eight_bit_capture(tmp_path / "sphere", count=5)
    with pytest.raises(InputError, match="5 pictures of a sphere for 3 images"):
        read_stack(tmp_path / "object", sphere=tmp_path / "sphere")


@pytest.mark.parametrize("text", ["²\ni0.png 0 0 1\n", "9" * 5000 + "\ni0.png 0 0 1\n"])
def test_first_lines_that_are_no_count(text, tmp_path):
    eight_bit_capture(tmp_path)
    (tmp_path / "c.lp").write_text(text)
    with pytest.raises(InputError, match="entry 1"):
        read_stack(tmp_path / "c.lp")


def test_byte_order_marks_and_line_ends(tmp_path):
    path = eight_bit_capture(tmp_path)
    path.write_bytes(b"\xef\xbb\xbf3\r\n" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert read_stack(path).shape == (3, 6, 8, 1)


def test_an_image_has_one_light(tmp_path):
    path = eight_bit_capture(tmp_path)
    path.write_text("i0.png 0 0 1\ni0.png 1 0 1\n")
    with pytest.raises(InputError, match=r"names i0\.png more than once"):
        read_stack(path, strict=True)
    with pytest.raises(InputError, match=r"only 0 of 2 photographs can be used: i0\.png: named more than once, under different"):
        read_stack(path)


def test_outputs_beside_a_capture_are_no_images(tmp_path):
    path = eight_bit_capture(tmp_path)
    np.savetxt(tmp_path / "light_directions.txt", read_stack(path).lights)
    path.unlink()
    intaglio.write_exr({"Y": np.zeros((2, 2))}, tmp_path / "texture.exr")
    for name in ("normal.png", "albedo.png", "height.png", "maps.exr"):
        (tmp_path / name).write_bytes(b"x")
    assert read_stack(tmp_path).shape == (3, 6, 8, 1)


def test_subset_knows_its_images():
    stack = noisy(dome(4, (30,)))
    with pytest.raises(InputError, match="not numbers of the stack's 4 images"):
        stack.subset([1, 40])
