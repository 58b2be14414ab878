"""Images as they come: every format, orientation, colours, sizes, and what is no image at all."""

from __future__ import annotations

import io
import struct
import sys
import zlib

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms, ImageOps

import intaglio
from intaglio import FileError, InputError, IntaglioError, IntaglioWarning
from intaglio.files import check_memory, limit_memory, memory_limit, read_samples, write_samples
from intaglio.files.color_profiles import ADOBE_RGB, read_profile
from intaglio.kernels.transfer import decode_srgb, encode_srgb
from intaglio.render import mitsuba

RNG = np.random.default_rng(11)
COLOR = RNG.integers(0, 256, (20, 26, 3), np.uint8)
DEEP = RNG.integers(0, 65536, (20, 26, 3), np.uint16)
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


@pytest.fixture
def small_limit():
    limit_memory(0.001)
    yield
    limit_memory(None)


# Formats


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("a.png", {}),
        ("a.bmp", {}),
        ("a.tga", {}),
        ("a.tga", {"compression": "tga_rle"}),
        ("a.webp", {"lossless": True}),
        ("a.jp2", {}),
        ("a.tif", {}),
        ("a.tif", {"compression": "tiff_lzw"}),
        ("a.tif", {"compression": "tiff_adobe_deflate"}),
        ("a.tif", {"compression": "packbits"}),
        ("a.tif", {"compression": "zstd"}),
    ],
)
def test_colours_come_as_they_were_stored(tmp_path, name, options):
    Image.fromarray(COLOR).save(tmp_path / name, **options)
    np.testing.assert_array_equal(read_samples(tmp_path / name), COLOR)


MODES = {
    "a.png": ["L", "LA", "RGBA", "1", "P"],
    "a.tif": ["L", "LA", "RGBA", "1", "P"],
    "a.tga": ["L", "LA", "RGBA", "1", "P"],
    "a.webp": ["L", "LA", "RGBA", "P"],
    "a.bmp": ["L", "1", "P"],
    "a.jp2": ["L", "LA", "RGBA"],
}


@pytest.mark.parametrize(("name", "mode"), [(name, mode) for name, modes in MODES.items() for mode in modes])
def test_modes(tmp_path, name, mode):
    image = Image.fromarray(COLOR).convert("RGBA")
    image.putalpha(Image.fromarray(COLOR[..., 0]))
    image = image.convert("RGB").quantize(64) if mode == "P" else image.convert(mode)
    image.save(tmp_path / name, **({"lossless": True, "exact": True} if name == "a.webp" else {}))
    expected = image.convert({"L": "L", "1": "L", "P": "RGB"}.get(mode, "RGBA"))
    found = read_samples(tmp_path / name)
    if name == "a.webp" and mode == "L":
        expected = image.convert("RGB")
    np.testing.assert_array_equal(found, np.asarray(expected))


@pytest.mark.parametrize(("kind", "predictor"), [("u1", 1), ("u1", 2), ("u2", 1), ("u2", 2), ("f4", 1), ("f4", 3), ("f2", 3)])
@pytest.mark.parametrize("layout", ["strips", "tiles", "planes", "grey"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_compressed_tiffs_of_all_samples(tmp_path, predictor, kind, layout, order):
    # Written with libtiff's compressor and the predictor by hand: tifffile alone writes neither.
    values = (RNG.uniform(0, 60000, (37, 45, 3)) / (256 if kind == "u1" else 1)).astype(kind)
    values = values[..., 0] if layout == "grey" else values
    write_lzw(tmp_path / "a.tif", values, predictor, layout, order)
    found = read_samples(tmp_path / "a.tif")
    assert found.dtype == kind
    np.testing.assert_array_equal(found, values)


def write_lzw(path, values, predictor, layout, order):
    """Write an LZW-compressed TIFF of any samples."""
    planes = values[..., None] if values.ndim == 2 else values
    size = planes.dtype.itemsize
    split = [planes[..., c : c + 1] for c in range(planes.shape[2])] if layout == "planes" else [planes]
    rows, columns = (16, 32) if layout == "tiles" else (10, planes.shape[1])
    segments = []
    for plane in split:
        for y in range(0, plane.shape[0], rows):
            for x in range(0, plane.shape[1], columns):
                part = plane[y : y + rows, x : x + columns]
                if layout == "tiles":
                    part = np.pad(part, ((0, rows - part.shape[0]), (0, columns - part.shape[1]), (0, 0)))
                segments.append(lzw(differences(part, predictor, order)))
    data, offsets = b"", []
    for segment in segments:
        offsets.append(8 + len(data))
        data += segment + b"\0" * (len(segment) % 2)
    kind = {"u": 1, "f": 3}[planes.dtype.kind]
    tags = [
        (256, planes.shape[1]), (257, planes.shape[0]), (258, [8 * size] * planes.shape[2]), (259, 5),
        (262, 2 if planes.shape[2] == 3 else 1), (277, planes.shape[2]), (284, 2 if layout == "planes" else 1), (317, predictor),
        (339, [kind] * planes.shape[2]),
    ]  # fmt: skip
    counts = [len(s) for s in segments]
    if layout == "tiles":
        tags += [(322, columns), (323, rows), (324, offsets), (325, counts)]
    else:
        tags += [(273, offsets), (278, rows), (279, counts)]
    write_tags(path, sorted(tags), data, order)


def write_tags(path, tags, data, order="<"):
    start = 8 + len(data)
    extra = start + 2 + 12 * len(tags) + 4
    entries, more = b"", b""
    for tag, value in tags:
        numbers = value if isinstance(value, list) else [value]
        body = struct.pack(f"{order}{len(numbers)}I", *numbers)
        if len(numbers) > 1:
            more += body
            body = struct.pack(f"{order}I", extra + len(more) - len(body))
        entries += struct.pack(f"{order}HHI", tag, 4, len(numbers)) + body
    mark = b"II" if order == "<" else b"MM"
    head = struct.pack(f"{order}2sHI", mark, 42, start)
    path.write_bytes(head + data + struct.pack(f"{order}H", len(tags)) + entries + b"\0\0\0\0" + more)


def differences(part, predictor, order):
    """Return the bytes of (rows, columns, channels) samples, differenced."""
    if predictor == 3:
        big = np.ascontiguousarray(part.astype(part.dtype.newbyteorder(">")))
        planes = np.swapaxes(big.view(np.uint8).reshape(len(part), -1, part.dtype.itemsize), 1, 2).reshape(len(part), -1)
        channels = part.shape[2]
        whole = planes.reshape(len(part), -1, channels)
        return np.diff(whole, axis=1, prepend=np.zeros_like(whole[:, :1])).reshape(len(part), -1)
    if predictor == 2:
        part = np.diff(part, axis=1, prepend=np.zeros_like(part[:, :1]))
    ordered = np.ascontiguousarray(part.astype(part.dtype.newbyteorder(order)))
    return ordered.view(np.uint8).reshape(len(part), -1)


def lzw(rows):
    """Compress bytes as libtiff does."""
    buffer = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(rows)).save(buffer, "TIFF", compression="tiff_lzw", tiffinfo={278: len(rows), 317: 1})
    with tifffile.TiffFile(io.BytesIO(buffer.getvalue())) as file:
        page = file.pages.first
        assert len(page.dataoffsets) == 1
        return buffer.getvalue()[page.dataoffsets[0] :][: page.databytecounts[0]]


def test_pictures_of_several_views(tmp_path):
    Image.fromarray(COLOR).save(tmp_path / "a.jpg", "MPO", save_all=True, append_images=[Image.fromarray(COLOR // 2)])
    with Image.open(tmp_path / "a.jpg") as image:
        assert image.format == "MPO"
        expected = np.asarray(image)
    np.testing.assert_array_equal(read_samples(tmp_path / "a.jpg"), expected)


def test_damaged_tiffs_print_nothing(tmp_path, capfd):
    for compression in ("tiff_lzw", "jpeg", "zstd"):
        path = tmp_path / f"{compression}.tif"
        Image.fromarray(COLOR).save(path, compression=compression)
        with tifffile.TiffFile(path) as file:
            offset, count = file.pages.first.dataoffsets[0], file.pages.first.databytecounts[0]
        data = bytearray(path.read_bytes())
        data[offset + count // 4 : offset + count // 2] = RNG.integers(0, 256, count // 2 - count // 4, np.uint8).tobytes()
        data[offset + 1] ^= 255
        path.write_bytes(data)
        with pytest.raises(FileError, match="damaged"):
            read_samples(path)
    assert capfd.readouterr() == ("", "")


def test_a_jpeg_inside_a_tiff(tmp_path):
    smooth = np.linspace(20, 230, 64, dtype=np.uint8)[None, :, None] * np.ones((64, 1, 3), np.uint8)
    Image.fromarray(smooth).save(tmp_path / "a.tif", compression="jpeg", quality=95)
    assert np.abs(read_samples(tmp_path / "a.tif").astype(int) - smooth).max() <= 4


def test_float_images_of_values_that_single_precision_cannot_hold(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.full((5, 6), 1e308))
    assert np.isinf(intaglio.read_image(tmp_path / "a.tif")).all()


def radiance(values, width_line=None, flat=False, head=b""):
    """Return a Radiance picture's bytes, of the run-length encoding by channel."""
    mantissa, exponent = np.frexp(values.max(axis=2))
    scale = np.where(values.max(axis=2) > 0, mantissa * 256 / np.maximum(values.max(axis=2), 1e-30), 0)
    pixels = np.dstack([values * scale[..., None], np.where(scale > 0, exponent + 128, 0)]).astype(np.uint8)
    rows, columns = values.shape[:2]
    body = b""
    for row in pixels:
        if flat:
            body += row.tobytes()
            continue
        body += bytes([2, 2, columns >> 8, columns & 255])
        for channel in row.T:
            at = 0
            while at < columns:
                run = 1
                while at + run < columns and run < 127 and channel[at + run] == channel[at]:
                    run += 1
                body += bytes([128 + run, channel[at]]) if run > 1 else bytes([1, channel[at]])
                at += run
    return (
        b"#?RADIANCE\n# made here\nFORMAT=32-bit_rle_rgbe\n"
        + head
        + b"\n"
        + (width_line or b"-Y %d +X %d" % (rows, columns))
        + b"\n"
        + body
    )


@pytest.mark.parametrize("flat", [False, True])
def test_radiance_pictures(tmp_path, flat):
    values = (RNG.uniform(0, 1, (9, 20, 3)) * 10.0 ** RNG.integers(-3, 4, (9, 20, 1))).astype(np.float32)
    values[3, 4:12] = (5, 2, 1)
    values[5] = 0
    (tmp_path / "a.hdr").write_bytes(radiance(values, flat=flat))
    found = intaglio.read_image(tmp_path / "a.hdr")
    assert (np.abs(found - values) <= values.max(axis=2, keepdims=True) / 100).all()
    # Mitsuba reads the same numbers.
    np.testing.assert_array_equal(found, np.asarray(mitsuba().Bitmap(str(tmp_path / "a.hdr")))[..., :3])
    (tmp_path / "up.hdr").write_bytes(radiance(values, b"+Y 9 -X 20", flat, b"EXPOSURE=2.0\n"))
    np.testing.assert_array_equal(intaglio.read_image(tmp_path / "up.hdr"), found[::-1, ::-1] / 2)


def test_radiance_repeats_of_the_old_kind(tmp_path):
    body = bytes([10, 20, 30, 128]) + bytes([1, 1, 1, 4]) + bytes([40, 50, 60, 129]) + bytes([1, 1, 1, 1])
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 7\n" + body)
    found = intaglio.read_image(tmp_path / "a.hdr")[0] * 256
    np.testing.assert_allclose(found, [[10, 20, 30]] * 5 + [[80, 100, 120]] * 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.replace(b"rle_rgbe", b"rle_xyze"), "stores colours as"),
        (lambda d: d.replace(b"-Y 9", b"-Y 99999"), "less than"),
        (lambda d: d[:-20], "damaged in row 8"),
        (lambda d: d.replace(b"+X 20", b"+X 21"), "damaged in row 0"),
        (lambda d: d.replace(b"+X 20", b"+Y 20"), "its header"),
        (lambda d: d.replace(b"+X 20", b"+X 0"), "0 x 9 pixels"),
    ],
)
def test_damaged_radiance_pictures(tmp_path, change, message):
    (tmp_path / "a.hdr").write_bytes(change(radiance(np.ones((9, 20, 3)) * RNG.uniform(size=(9, 20, 1)))))
    with pytest.raises(FileError, match=message):
        intaglio.read_image(tmp_path / "a.hdr")


# Photographs as the sensor saw them


def write_dng(path, camera, orientation=1):
    """Write a mosaic of camera values (H, W, 3) whose white balance is (2, 1, 2) and whose colours are Rec.709's."""

    def rationals(values):
        return [n for value in values for n in (round(value * 10000), 10000)]

    mosaic = camera[..., 1].copy()
    mosaic[0::2, 0::2], mosaic[1::2, 1::2] = camera[0::2, 0::2, 0], camera[1::2, 1::2, 2]
    to_camera = [3.2404542, -1.5371385, -0.4985314, -0.9692660, 1.8760108, 0.0415560, 0.0556434, -0.2040259, 1.0572252]
    tags = [
        (274, "H", 1, orientation, True),
        (271, "s", 0, "Make", True),
        (272, "s", 0, "Model", True),
        (33421, "H", 2, (2, 2), True),
        (33422, "B", 4, bytes([0, 1, 1, 2]), True),
        (50706, "B", 4, bytes([1, 4, 0, 0]), True),
        (50708, "s", 0, "Make Model", True),
        (50717, "H", 1, 65535, True),
        (50721, "2i", 9, rationals(to_camera), True),
        (50728, "2I", 3, rationals([0.5, 1, 0.5]), True),
        (50778, "H", 1, 21, True),
    ]
    tifffile.imwrite(path, np.round(mosaic * 65535).astype(np.uint16), photometric=32803, extratags=tags, metadata=None)


def test_raw_photographs(tmp_path):
    pytest.importorskip("rawpy")
    camera = np.full((64, 96, 3), (0.1, 0.4, 0.05))
    camera[:32] /= 4
    write_dng(tmp_path / "a.dng", camera)
    # White balance doubles red and blue; half the light is half the value, in every photograph alike.
    found = intaglio.read_image(tmp_path / "a.dng")
    assert found.shape == (64, 96, 3)
    np.testing.assert_allclose(found[48, 40], (0.2, 0.4, 0.1), atol=1e-3)
    np.testing.assert_allclose(found[8, 40], (0.05, 0.1, 0.025), atol=1e-3)
    write_dng(tmp_path / "bright.dng", np.minimum(camera * 2.2, 1))
    np.testing.assert_allclose(intaglio.read_image(tmp_path / "bright.dng"), found * 2.2, atol=3e-3)
    write_dng(tmp_path / "turned.dng", camera, orientation=6)
    np.testing.assert_array_equal(intaglio.read_image(tmp_path / "turned.dng"), np.rot90(found, -1))
    np.testing.assert_array_equal(intaglio.read_image(tmp_path / "turned.dng", orient=False), found)
    # The name may say TIFF.
    (tmp_path / "a.dng").rename(tmp_path / "a.tif")
    np.testing.assert_array_equal(intaglio.read_image(tmp_path / "a.tif"), found)


def test_damaged_raw_photographs(tmp_path, capfd):
    pytest.importorskip("rawpy")
    write_dng(tmp_path / "a.dng", np.full((64, 96, 3), 0.2))
    data = (tmp_path / "a.dng").read_bytes()
    for end in (60, len(data) // 2, -100):
        (tmp_path / "a.dng").write_bytes(data[:end])
        with pytest.raises(FileError, match=r"a\.dng: (is cut short|can't be read as a raw photograph)"):
            intaglio.read_image(tmp_path / "a.dng")
    assert capfd.readouterr() == ("", "")


def test_raw_photographs_without_the_reader(tmp_path, monkeypatch):
    write_dng(tmp_path / "a.dng", np.full((64, 96, 3), 0.2))
    monkeypatch.setitem(sys.modules, "rawpy", None)
    with pytest.raises(FileError, match=r"pip install 'intaglio\[raw\]'"):
        intaglio.read_image(tmp_path / "a.dng")


# The content decides


def test_content_decides_and_the_name_is_told(tmp_path):
    for kind, suffix in (("PNG", "jpg"), ("JPEG", "png"), ("TIFF", "png"), ("WEBP", "jpg"), ("BMP", "tif")):
        Image.fromarray(COLOR).save(tmp_path / f"a.{suffix}", kind)
        with pytest.warns(IntaglioWarning, match=rf"a\.{suffix}: is named \.{suffix}, but holds a") as caught:
            found = read_samples(tmp_path / f"a.{suffix}")
        assert len(caught) == 1
        np.testing.assert_array_equal(found, np.asarray(Image.open(tmp_path / f"a.{suffix}")))
    intaglio.write_exr({"Y": COLOR[..., 0] / 255}, tmp_path / "y.exr")
    (tmp_path / "y.exr").rename(tmp_path / "y.png")
    with pytest.warns(IntaglioWarning, match="holds an EXR image"):
        np.testing.assert_allclose(intaglio.read_image(tmp_path / "y.png"), COLOR[..., 0] / 255, atol=1e-7)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"GIF89a........", "is a GIF image"),
        (b"<!DOCTYPE html><p>404", "is a page of HTML"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:1", "pointer of Git LFS"),
        (b"\0\0\0\x18ftypheic....", "is HEIC"),
        (b"no image at all", "is no image of a known type"),
        (b"x", "is no image of a known type"),
    ],
)
def test_what_is_no_image_is_named(tmp_path, content, message):
    for suffix in ("png", "tif", "tga"):
        (tmp_path / f"a.{suffix}").write_bytes(content)
        with pytest.raises(FileError, match=message):
            intaglio.read_image(tmp_path / f"a.{suffix}")


# Orientation


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.webp", "a.tif", "lzw.tif", "jpeg.tif", "deep.tif"])
def test_orientation(tmp_path, name, orientation):
    exif = Image.Exif()
    exif[0x0112] = orientation
    image = Image.fromarray(COLOR)
    if name == "deep.tif":
        tifffile.imwrite(tmp_path / name, DEEP, photometric="rgb", extratags=[(274, "H", 1, orientation, True)])
        stored, turned = DEEP, np.asarray(ImageOps.exif_transpose(with_orientation(DEEP[..., 0], exif)))
        np.testing.assert_array_equal(read_samples(tmp_path / name)[..., 0], turned)
    else:
        options = {"lossless": True} if name == "a.webp" else {"compression": "tiff_lzw"} if name == "lzw.tif" else {}
        options = {"compression": "jpeg"} if name == "jpeg.tif" else options
        image.save(tmp_path / name, exif=exif, **options)
        plain = Image.open(tmp_path / name)
        # Pillow turns TIFF as it reads, and the others when asked.
        turned = np.asarray(plain if name.endswith("tif") else ImageOps.exif_transpose(plain))
        image.save(tmp_path / f"plain-{name}", **options)
        stored = np.asarray(Image.open(tmp_path / f"plain-{name}"))
        np.testing.assert_array_equal(read_samples(tmp_path / name), turned)
    np.testing.assert_array_equal(read_samples(tmp_path / name, orient=False), stored)
    shape = intaglio.read_image(tmp_path / name).shape[:2]
    assert shape == ((26, 20) if orientation > 4 else (20, 26))
    assert intaglio.read_image(tmp_path / name, orient=False).shape[:2] == (20, 26)


def with_orientation(values, exif):
    buffer = io.BytesIO()
    Image.fromarray(values).save(buffer, "PNG", exif=exif)
    return Image.open(buffer)


# Colours


def chunk(name, data):
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))


def deep_png(path, *chunks):
    """Write `DEEP` as a PNG of 16 bits with chunks after its header."""
    rows = b"".join(b"\0" + row.astype(">u2").tobytes() for row in DEEP)
    header = struct.pack(">IIBBBBB", DEEP.shape[1], DEEP.shape[0], 16, 2, 0, 0, 0)
    parts = [chunk(b"IHDR", header), *chunks, chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND", b"")]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(parts))


def test_sixteen_bits_are_decoded_where_they_say_srgb(tmp_path):
    linear, decoded = DEEP / np.float32(65535), decode_srgb(DEEP / np.float32(65535))
    deep_png(tmp_path / "plain.png")
    deep_png(tmp_path / "chunk.png", chunk(b"sRGB", b"\0"))
    deep_png(tmp_path / "icc.png", chunk(b"iCCP", b"sRGB\0\0" + zlib.compress(SRGB)))
    tifffile.imwrite(tmp_path / "plain.tif", DEEP, photometric="rgb")
    tifffile.imwrite(tmp_path / "icc.tif", DEEP, photometric="rgb", iccprofile=SRGB)
    tifffile.imwrite(tmp_path / "grey.tif", DEEP[..., 0], photometric="minisblack", iccprofile=SRGB)
    for name in ("plain.png", "plain.tif"):
        np.testing.assert_allclose(intaglio.read_image(tmp_path / name), linear, atol=1e-6)
    for name in ("chunk.png", "icc.png", "icc.tif"):
        np.testing.assert_allclose(intaglio.read_image(tmp_path / name), decoded, atol=1e-6)
        np.testing.assert_allclose(intaglio.read_image(tmp_path / name, linear=True), linear, atol=1e-6)
    # Grey of 16 bits is a height or another map.
    np.testing.assert_allclose(intaglio.read_image(tmp_path / "grey.tif"), linear[..., 0], atol=1e-6)


def profile_of(columns, gamma, name=b"Wide gamut\0"):
    """Return an ICC profile of primaries (columns of XYZ under D50) and a gamma."""
    description = b"desc\0\0\0\0" + struct.pack(">I", len(name)) + name + b"\0" * 90
    curve = b"curv\0\0\0\0" + struct.pack(">IH", 1, round(gamma * 256)) + b"\0\0"
    tags = [(b"desc", description)] + [(c, curve) for c in (b"rTRC", b"gTRC", b"bTRC")]
    for tag, column in zip((b"rXYZ", b"gXYZ", b"bXYZ"), np.asarray(columns).T, strict=True):
        tags.append((tag, b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(v * 65536) for v in column))))
    at = 132 + 12 * len(tags)
    table, data = struct.pack(">I", len(tags)), b""
    for tag, body in tags:
        table += struct.pack(">4sII", tag, at + len(data), len(body))
        data += body
    head = bytearray(128)
    head[12:24] = b"mntrRGB XYZ "
    head[36:40] = b"acsp"
    head[8:12] = bytes([2, 0x20, 0, 0])
    head[68:80] = struct.pack(">3i", 63190, 65536, 54061)
    return bytes(head[:0]) + struct.pack(">I", 128 + len(table) + len(data)) + bytes(head[4:]) + table + data


ADOBE = profile_of(
    [[0.6097559, 0.2052401, 0.1492240], [0.3111242, 0.6256560, 0.0632197], [0.0194811, 0.0608902, 0.7448387]],
    563 / 256,
    b"Adobe RGB (1998)\0",
)


def test_profiles_give_the_colours_that_littlecms_gives(tmp_path):
    inside = (COLOR // 2 + 60).astype(np.uint8)  # colours that sRGB can show
    Image.fromarray(inside).save(tmp_path / "a.png", icc_profile=ADOBE)
    to_srgb = ImageCms.profileToProfile(
        Image.fromarray(inside), ImageCms.ImageCmsProfile(io.BytesIO(ADOBE)), ImageCms.createProfile("sRGB"),
        renderingIntent=ImageCms.Intent.RELATIVE_COLORIMETRIC,
    )  # fmt: skip
    found = encode_srgb(intaglio.read_image(tmp_path / "a.png")) * 255
    assert np.abs(found - np.asarray(to_srgb)).max() < 1.5
    assert np.abs(inside.astype(int) - np.asarray(to_srgb)).max() > 8
    tifffile.imwrite(tmp_path / "deep.tif", inside.astype(np.uint16) * 257, photometric="rgb", iccprofile=ADOBE)
    np.testing.assert_allclose(intaglio.read_image(tmp_path / "deep.tif"), intaglio.read_image(tmp_path / "a.png"), atol=1e-5)
    np.testing.assert_allclose(intaglio.read_image(tmp_path / "a.png", linear=True), inside / 255, atol=1e-6)
    with pytest.warns(IntaglioWarning, match=r"its colour profile is Adobe RGB \(1998\), not sRGB"):
        np.testing.assert_array_equal(read_samples(tmp_path / "a.png"), inside)


def test_profiles_that_are_srgb_change_nothing(tmp_path):
    Image.fromarray(COLOR).save(tmp_path / "plain.png")
    Image.fromarray(COLOR).save(tmp_path / "srgb.png", icc_profile=SRGB)
    assert intaglio.read_image(tmp_path / "plain.png").tobytes() == intaglio.read_image(tmp_path / "srgb.png").tobytes()
    assert read_profile(SRGB).is_srgb
    assert not ADOBE_RGB.is_srgb
    for damaged in (SRGB[:200], SRGB[:140], b"", ADOBE.replace(b"curv", b"what")):
        assert read_profile(damaged) is None


@pytest.mark.parametrize("name", ["a.jpg", "a.tif"])
def test_cmyk_needs_a_profile(tmp_path, name):
    Image.fromarray(COLOR).convert("CMYK").save(tmp_path / name)
    with pytest.raises(FileError, match="stores CMYK colours without a profile"):
        intaglio.read_image(tmp_path / name)


@pytest.mark.parametrize(
    ("values", "options", "message"),
    [
        (np.ones((6, 8), np.complex64), {}, "complex values"),
        (
            np.ones((6, 8, 2), np.uint8),
            {"photometric": "minisblack", "planarconfig": "contig"},
            "2 channels, neither of them alpha",
        ),
        (np.ones((6, 8, 5), np.uint8), {"photometric": "minisblack", "planarconfig": "contig"}, "at most 4 channels"),
        (np.ones((6, 8, 3), np.uint8), {"photometric": "cielab"}, "stores colours as CIELAB"),
        (np.ones((4, 6, 8), np.uint8), {"volumetric": True, "tile": (4, 16, 16), "photometric": "minisblack"}, "flat"),
    ],
)
def test_tiffs_that_are_no_pictures(tmp_path, values, options, message):
    tifffile.imwrite(tmp_path / "a.tif", values, **options)
    with pytest.raises(FileError, match=message):
        intaglio.read_image(tmp_path / "a.tif")


def test_gray_with_alpha_of_sixteen_bits(tmp_path):
    values = DEEP[..., :2]
    mitsuba().Bitmap(np.ascontiguousarray(values), mitsuba().Bitmap.PixelFormat.YA).write(str(tmp_path / "a.png"))
    tifffile.imwrite(tmp_path / "a.tif", values, photometric="minisblack", planarconfig="contig", extrasamples=["unassalpha"])
    for name in ("a.png", "a.tif"):
        found = read_samples(tmp_path / name)
        np.testing.assert_array_equal(found, values[..., [0, 0, 0, 1]])


def test_pages_and_frames_are_told(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        for k in range(3):
            file.write(np.full((6, 8), 10 * k, np.uint8), photometric="minisblack")
    with pytest.warns(IntaglioWarning, match="holds 3 pages; the first is read"):
        assert read_samples(tmp_path / "a.tif").max() == 0
    with tifffile.TiffWriter(tmp_path / "pyramid.tif") as file:
        file.write(COLOR, photometric="rgb")
        file.write(COLOR[::2, ::2], photometric="rgb", subfiletype=1)
    np.testing.assert_array_equal(read_samples(tmp_path / "pyramid.tif"), COLOR)
    frames = [Image.fromarray(np.roll(COLOR, k, 0)) for k in range(3)]
    for name in ("a.png", "a.webp"):
        frames[0].save(tmp_path / name, save_all=True, append_images=frames[1:], **({"lossless": True} if "webp" in name else {}))
        with pytest.warns(IntaglioWarning, match="holds 3 frames; the first is read"):
            np.testing.assert_array_equal(read_samples(tmp_path / name)[..., :3], COLOR)


# EXR


def test_parts_of_an_exr(tmp_path):
    import OpenEXR

    parts = [OpenEXR.Part({"name": n}, {"Y": np.full((5, 6), v, np.float32)}) for n, v in (("left", 1), ("right", 2))]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    with pytest.warns(IntaglioWarning, match="holds 2 parts: left, right; left is read"):
        channels, header = intaglio.read_exr(tmp_path / "a.exr")
    assert channels["Y"].max() == 1
    assert header["name"] == "left"
    for part in ("right", 1):
        assert intaglio.read_exr(tmp_path / "a.exr", part=part)[0]["Y"].min() == 2
    for part in ("middle", 2, -1, 1.5, True):
        with pytest.raises(InputError, match="has no part"):
            intaglio.read_exr(tmp_path / "a.exr", part=part)


def test_channels_of_an_exr_that_are_colours(tmp_path):
    values = RNG.uniform(size=(5, 6, 4)).astype(np.float32)
    intaglio.write_exr({f"beauty.{c}": values[..., i] for i, c in enumerate("RGBA")}, tmp_path / "layer.exr")
    np.testing.assert_array_equal(intaglio.read_image(tmp_path / "layer.exr"), values)
    intaglio.write_exr({"Y": values[..., 0], "A": values[..., 3]}, tmp_path / "ya.exr")
    np.testing.assert_array_equal(intaglio.read_image(tmp_path / "ya.exr"), values[..., [0, 0, 0, 3]])
    intaglio.write_exr({f"{n}.{c}": values[..., 0] for n in ("a", "b") for c in "RGB"}, tmp_path / "two.exr")
    with pytest.raises(FileError, match=r"has channels a\.B, a\.G"):
        intaglio.read_image(tmp_path / "two.exr")


def test_a_damaged_exr_prints_nothing(tmp_path, capfd):
    intaglio.write_exr({"Y": RNG.uniform(size=(40, 50))}, tmp_path / "a.exr")
    data = (tmp_path / "a.exr").read_bytes()
    for end in (40, 300, len(data) // 2, len(data) - 10):
        (tmp_path / "a.exr").write_bytes(data[:end])
        with pytest.raises(FileError, match=r"a\.exr: is damaged") as caught:
            intaglio.read_exr(tmp_path / "a.exr")
        assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_damaged_png_of_sixteen_bits_prints_nothing(tmp_path, capfd):
    deep_png(tmp_path / "a.png")
    data = (tmp_path / "a.png").read_bytes()
    comment = bytearray(chunk(b"tEXt", b"a\0b"))
    comment[-1] ^= 1  # its checksum is wrong now, which libpng warns of
    end = data.index(b"IEND") - 4
    (tmp_path / "a.png").write_bytes(data[:end] + comment + data[end:])
    np.testing.assert_array_equal(read_samples(tmp_path / "a.png"), DEEP)
    for cut in (40, len(data) // 2):
        (tmp_path / "a.png").write_bytes(data[:cut])
        with pytest.raises(FileError, match=r"a\.png: is damaged") as caught:
            read_samples(tmp_path / "a.png")
        assert "\n" not in caught.value.args[0]
    assert capfd.readouterr() == ("", "")


# Sizes


def empty_png(path, width, height):
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * 99)) + chunk(b"IEND", b"")
    )


def test_sizes_are_read_before_pixels(tmp_path, small_limit):
    zeros = np.zeros((1000, 2000, 3), np.uint8)
    names = ["a.png", "a.jpg", "a.tif", "lzw.tif", "a.webp", "a.bmp", "a.tga", "a.jp2"]
    for name in names:
        Image.fromarray(zeros).save(tmp_path / name, **({"compression": "tiff_lzw"} if "lzw" in name else {}))
    tifffile.imwrite(tmp_path / "tiles.tif", zeros, tile=(256, 256), photometric="rgb", compression="zlib")
    intaglio.write_exr({"Y": zeros[..., 0]}, tmp_path / "a.exr")
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000 +X 2000\n" + b"\2\2" * 5000)
    deep_png(tmp_path / "deep.png")
    for name in [*names, "tiles.tif", "a.exr", "a.hdr"]:
        with pytest.raises(InputError, match=r"2000 x 1000 pixels.* needs .* GiB of memory, the limit is 0.001 GiB"):
            intaglio.read_image(tmp_path / name)
    assert read_samples(tmp_path / "deep.png").shape == DEEP.shape


def test_a_size_that_no_machine_holds(tmp_path):
    empty_png(tmp_path / "a.png", 2**31 - 1, 2**31 - 1)
    with pytest.raises(IntaglioError, match=r"a\.png") as caught:
        intaglio.read_image(tmp_path / "a.png")
    assert "memory" in str(caught.value)


def test_the_limit_of_memory(monkeypatch):
    limit_memory(2)
    try:
        assert memory_limit() == 2 * 2**30
        check_memory("a.png", 2**31, "an image")
        with pytest.raises(InputError, match=r"a\.png: an image needs 3 GiB of memory, the limit is 2 GiB; .*--memory"):
            check_memory("a.png", 3 * 2**30, "an image")
        for wrong in (0, -1, float("nan"), "much", True):
            with pytest.raises(InputError, match="memory must be"):
                limit_memory(wrong)
    finally:
        limit_memory(None)
    monkeypatch.setenv("INTAGLIO_MEMORY", "0.5")
    assert memory_limit() == 2**29
    monkeypatch.setenv("INTAGLIO_MEMORY", "lots")
    with pytest.raises(InputError, match="INTAGLIO_MEMORY=lots"):
        memory_limit()
    monkeypatch.delenv("INTAGLIO_MEMORY")
    assert memory_limit() > 2**20


# Writing


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"quality": 10**30}, "quality must be"),
        ({"quality": "high"}, "quality must be"),
        ({"bits": 16.5}, "bits must be"),
        ({"bits": [8]}, "bits must be"),
        ({"linear": "yes"}, "linear must be"),
    ],
)
def test_wrong_options_of_writing(tmp_path, options, message):
    with pytest.raises(InputError, match=message):
        intaglio.write_image(np.zeros((3, 3)), tmp_path / "a.png", **options)
    assert list(tmp_path.iterdir()) == []


def test_wrong_things_to_write(tmp_path):
    path = tmp_path / "a.exr"
    for image in ("text", None, {}, np.zeros((3, 3), complex), [[1, 2], [3]], np.array([["a"]])):
        with pytest.raises(InputError, match=r"image|channel|a\.exr"):
            intaglio.write_image(image, path)
        with pytest.raises(InputError, match=r"image|channel|a\.exr"):
            intaglio.write_exr({"Y": image}, path)
        with pytest.raises(InputError, match=r"samples|image|a\."):
            write_samples(image, tmp_path / "a.png")
    for channels in (None, [np.zeros((3, 3))], {1: np.zeros((3, 3))}, {"": np.zeros((3, 3))}):
        with pytest.raises(InputError, match="channels"):
            intaglio.write_exr(channels, path)
    for wrong in (None, 5, ""):
        with pytest.raises(InputError, match="path must be"):
            intaglio.write_image(np.zeros((3, 3)), wrong)
        with pytest.raises(InputError, match="path must be"):
            intaglio.write_exr({"Y": np.zeros((3, 3))}, wrong)
    with pytest.raises(IntaglioError, match=r"metadata|could not be written"):
        intaglio.write_exr({"Y": np.zeros((3, 3))}, path, metadata={"x": object()})
    assert list(tmp_path.iterdir()) == []


def test_long_names_are_shortened(tmp_path):
    with pytest.raises(IntaglioError) as caught:
        intaglio.read_image("x" * 5000 + ".png")
    assert len(str(caught.value)) < 700
    with pytest.raises(IntaglioError) as caught:
        intaglio.read_image("a\nb\x1b[31m.png")
    assert str(caught.value) == "a b [31m.png: no such file"


def test_info_tells_values_that_are_not_finite(run, tmp_path):
    values = np.full((4, 5), 0.25, np.float32)
    values[0] = np.nan
    values[1, 0] = np.inf
    intaglio.write_exr({"Y": values}, tmp_path / "a.exr")
    status, said, errors = run("info", tmp_path / "a.exr")
    assert (status, errors) == (0, "")
    assert "channel 0: least 0.25, mean 0.25, most 0.25; 0.00% at or over 1, 0.00% at or under 0; 6 values are not finite" in said
    tifffile.imwrite(tmp_path / "a.tif", np.full((3, 3), -1e308))
    status, said, errors = run("info", tmp_path / "a.tif")
    assert (status, errors) == (0, "")
    assert "channel 0: no value is finite" in said
