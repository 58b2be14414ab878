"""Files of relightable textures, read back by other means than those that wrote them."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from PIL import Image
from stacks import dome, lambertian, noisy, scattered

from intaglio import (
    FileError,
    InputError,
    Relightable,
    light_direction,
    read_image,
    read_relightable,
    represent,
    write_gltf,
    write_maps,
    write_relightable,
    write_web_planes,
)
from intaglio.files.exr import read_exr, write_exr
from intaglio.kernels.transfer import decode_srgb
from intaglio.photometric.bases import HemisphericalBasis
from intaglio.photometric.relightable import KINDS

LIGHTS = np.array([light_direction(t, s) for t, s in ((20, 15), (130, 40), (250, 50))])


def texture_of(kind, color="channels", channels=3, **options):
    return represent(noisy(scattered(30), channels=channels, height=17, width=13), kind, color=color, **options)


# ---- EXR ----


@pytest.mark.parametrize("color", ["channels", "luminance"])
@pytest.mark.parametrize("kind", KINDS)
def test_exr_reads_back_identically(kind, color, tmp_path):
    texture = texture_of(kind, color)
    write_relightable(texture, tmp_path / "t.exr")
    back = read_relightable(tmp_path / "t.exr")
    assert back.kind == texture.kind
    assert back.notes == texture.notes
    for name in ("maps", "chroma", "mask", "height", "confidence"):
        a, b = getattr(texture, name), getattr(back, name)
        assert (a is None) == (b is None)
        if a is not None:
            np.testing.assert_array_equal(a, b)
    assert back.basis.parameters() == texture.basis.parameters()
    np.testing.assert_array_equal(back.relight(LIGHTS), texture.relight(LIGHTS))


def test_exr_keeps_mask_confidence_and_grid(tmp_path):
    stack = noisy(dome())
    mask = np.zeros(stack.shape[1:3], bool)
    mask[1:, 2:] = True
    stack = type(stack)(stack.images, stack.lights, mask, ceiling=np.inf)
    for texture in (represent(stack, "gradient", robust=True), represent(stack, "eigen3"), represent(stack, "height")):
        write_relightable(texture, tmp_path / "t.exr")
        back = read_relightable(tmp_path / "t.exr")
        np.testing.assert_array_equal(back.mask, mask)
        if texture.confidence is not None:
            np.testing.assert_array_equal(back.confidence, texture.confidence)
        np.testing.assert_array_equal(back.relight(LIGHTS), texture.relight(LIGHTS))
    channels, _ = read_exr(tmp_path / "t.exr")
    assert {"map00.Y", "map02.Y", "height.Y", "mask.Y"} <= channels.keys()


def test_exr_files_that_are_no_texture(tmp_path):
    write_exr({"R": np.zeros((3, 3))}, tmp_path / "plain.exr")
    with pytest.raises(FileError, match="not a relightable texture"):
        read_relightable(tmp_path / "plain.exr")
    described = {"version": 1, "kind": "ptm", "basis": {"basis": "unheard"}, "notes": []}
    write_exr({"map00.Y": np.zeros((3, 3))}, tmp_path / "x.exr", metadata={"intaglioRelightable": json.dumps(described)})
    with pytest.raises(FileError, match="'unheard' is not known"):
        read_relightable(tmp_path / "x.exr")
    (tmp_path / "y.exr").write_bytes(b"no exr at all")
    with pytest.raises(FileError, match=r"y\.exr"):
        read_relightable(tmp_path / "y.exr")
    with pytest.raises(FileError, match=r"known: \.exr, \.ptm"):
        read_relightable(__file__)
    with pytest.raises(FileError, match=r"known: \.exr, \.ptm, \.json, \.glb"):
        write_relightable(texture_of("ptm"), tmp_path / "t.tiff")


# ---- PTM ----


def relit_by_hand(path, light):
    """Read an uncompressed .ptm as its specification says, and light it."""
    content = path.read_bytes()
    lines = content.split(b"\n", 6)
    assert lines[0] == b"PTM_1.2"
    width, height = int(lines[2]), int(lines[3])
    scale, bias = (np.array(lines[i].split(), float) for i in (4, 5))
    data = np.frombuffer(lines[6], np.uint8)
    x, y = light[:2]
    terms = np.array([x * x, y * y, x * y, x, y, 1])
    size = width * height
    if lines[1] == b"PTM_FORMAT_RGB":
        assert len(data) == 18 * size
        coefficients = data.reshape(3, height, width, 6)
        image = np.moveaxis(((coefficients - bias) * scale) @ terms, 0, 2)
    else:
        assert len(data) == 9 * size
        luminance = ((data[: 6 * size].reshape(height, width, 6) - bias) * scale) @ terms
        image = luminance[..., None] / 255 * data[6 * size :].reshape(height, width, 3)
    return np.clip(image[::-1] / 255, 0, None)


@pytest.mark.parametrize(("color", "channels"), [("channels", 3), ("luminance", 3), ("channels", 1)])
def test_ptm_within_its_eight_bits(color, channels, tmp_path):
    texture = texture_of("ptm", color, channels)
    write_relightable(texture, tmp_path / "t.ptm")
    back = read_relightable(tmp_path / "t.ptm")
    spread = np.ptp(texture.maps)
    for light in LIGHTS:
        wanted = np.broadcast_to(texture.relight(light), (17, 13, 3))
        by_hand = relit_by_hand(tmp_path / "t.ptm", light)
        # Six coefficients, each rounded to a 254th of its range, and colours to a 255th.
        np.testing.assert_allclose(by_hand, wanted, atol=spread * 6 / 254)
        assert np.abs(by_hand - wanted).mean() < spread / 254
        np.testing.assert_allclose(back.relight(light), by_hand, atol=1e-6)


def test_other_kinds_are_written_as_the_nearest_polynomial(tmp_path):
    texture = represent(lambertian(dome()), "gradient")
    write_relightable(texture, tmp_path / "t.ptm")
    light = light_direction(40, 30)
    # The parabola nearest to a cosine over the hemisphere is within 3 % of it.
    np.testing.assert_allclose(read_relightable(tmp_path / "t.ptm").relight(light), texture.relight(light), atol=0.05)


def test_real_ptm(real):
    """A clay tablet, JPEG_LRGB with planes predicted from each other: lit from the left its left edges are bright."""
    texture = read_relightable(real("photometric/formats/tablet1.ptm"))
    assert texture.shape == (512, 512, 3)
    left, right, above = (texture.relight(light_direction(t, 60)) for t in (180, 0, 90))
    tablet = slice(200, 330), slice(30, 60)
    assert left[tablet].mean() > 2 * right[tablet].mean()
    assert above[75:100, 200:330].mean() > above[400:425, 200:330].mean()
    # Wrong prediction of planes would leave blocks and noise: the relit tablet is smooth but for its signs.
    gray = texture.relight([0, 0, 1]).mean(axis=2)
    assert np.abs(np.diff(gray, axis=1)).mean() < 0.02


def jpeg_ptm(path, planes, *, order, reference, transforms, side=()):
    """Write a JPEG_LRGB (9 planes) or JPEG_RGB (18) file of given levels (N, H, W), predicting planes as asked."""
    streams = []
    for i, plane in enumerate(planes):
        stored = plane.astype(np.int16)
        if reference[i] >= 0:
            other = planes[reference[i]].astype(np.int16)
            stored = (stored - (255 - other if transforms[i] else other) + 128) % 256
        buffer = io.BytesIO()
        Image.fromarray(stored.astype(np.uint8)).save(buffer, "JPEG", quality=100)
        streams.append(buffer.getvalue())
    extra = [b"".join(int(w).to_bytes(4, "big") + bytes([v]) for w, v in entries) for entries in side] or [b""] * len(planes)
    count = len(planes)
    numbers = [transforms, [0] * count, [0] * count, order, reference, [len(e) for e in streams], [len(e) for e in extra]]
    rows = ["PTM_1.2", "PTM_FORMAT_JPEG_LRGB" if count == 9 else "PTM_FORMAT_JPEG_RGB"]
    rows += [f"{planes.shape[2]} {planes.shape[1]}", "2 2 2 2 2 2", "128 128 128 128 128 0", "90"]
    rows += [" ".join(map(str, line)) for line in numbers]
    path.write_bytes(("\n".join(rows) + "\n").encode() + b"".join(s + e for s, e in zip(streams, extra, strict=True)))


def test_jpeg_ptm_of_three_polynomials(tmp_path):
    column = np.mgrid[:16, :24][1]
    planes = np.stack([60 + 3 * column + 5 * i for i in range(18)]).astype(np.uint8)
    jpeg_ptm(tmp_path / "t.ptm", planes, order=range(18), reference=[-1] * 18, transforms=[0] * 18)
    texture = read_relightable(tmp_path / "t.ptm")
    assert texture.chroma is None
    bias = np.array([128] * 5 + [0])[:, None, None, None]
    expected = (np.moveaxis(planes[:, ::-1].reshape(3, 6, 16, 24), 0, 3).astype(float) - bias) * 2 / 255
    np.testing.assert_allclose(texture.maps, expected, atol=2 * 3 / 255)


def test_predicted_planes_of_jpeg_ptm(tmp_path):
    row, column = np.mgrid[:16, :24]
    planes = np.stack([100 + 4 * column + i for i in range(9)]).astype(np.uint8)
    planes[5] = 40 + 6 * row
    side = [[] for _ in range(9)]
    side[5] = [(3 * 24 + 7, 222)]
    jpeg_ptm(
        tmp_path / "t.ptm",
        planes,
        order=[0, 2, 1, 3, 4, 5, 6, 7, 8],
        reference=[-1, 2, 0, -1, -1, -1, -1, 6, 7],
        transforms=[0, 1, 0, 0, 0, 0, 0, 0, 1],
        side=side,
    )
    texture = read_relightable(tmp_path / "t.ptm")
    planes[5, 3, 7] = 222
    expected = (planes[:6, ::-1].astype(float) - np.array([128] * 5 + [0])[:, None, None]) * 2 / 255
    # JPEG at quality 100 is off by a level or two per stream.
    np.testing.assert_allclose(texture.maps[..., 0], expected, atol=2 * 5 / 255)
    np.testing.assert_allclose(texture.chroma, np.moveaxis(planes[6:, ::-1], 0, 2) / 255, atol=5 / 255)
    assert texture.maps[5, 12, 7, 0] == pytest.approx(222 * 2 / 255, abs=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"GIF89a\n", "not a PTM_1.2"),
        (b"PTM_1.2", "ends in its header"),
        (b"PTM_1.2\nPTM_FORMAT_LUM\n", "'PTM_FORMAT_LUM' can't be read; known: PTM_FORMAT_RGB"),
        (b"PTM_1.2\nPTM_FORMAT_RGB\n4\nx\n", "'x' in its header instead of numbers"),
        (b"PTM_1.2\nPTM_FORMAT_RGB\n4 4 4\n", "3 numbers in its header instead of 2"),
        (b"PTM_1.2\nPTM_FORMAT_RGB\n-4\n4\n1 1 1 1 1 1\n0 0 0 0 0 0\n", "size of -4 x 4"),
        (b"PTM_1.2\nPTM_FORMAT_RGB\n4\n4\n1 1 1 1 1 1\n0 0 0 0 0 0\n" + bytes(100), "truncated: .* bytes are missing"),
    ],
)
def test_broken_ptm(content, message, tmp_path):
    (tmp_path / "t.ptm").write_bytes(content)
    with pytest.raises(FileError, match=message):
        read_relightable(tmp_path / "t.ptm")


# ---- web planes ----


def pixels(path):
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def viewer(folder, light, name="info.json"):
    """Light web planes by the viewers' own formulas."""
    info = json.loads((folder / name).read_text())
    x, y, z = np.asarray(light) / np.linalg.norm(light)
    count = info["nplanes"]
    images = [pixels(folder / f"plane_{j}.jpg") / 255 for j in range(-(-count // 3))]
    planes = np.concatenate(images, axis=2)[..., :count]
    assert planes.shape[:2] == (info["height"], info["width"])
    material = info["materials"][0]
    values = (planes - np.array(material["bias"])) * np.array(material["scale"])
    polynomial = np.array([1, x, y, x * x, x * y, y * y])
    if info["type"] == "ptm" and info["colorspace"] == "lrgb":
        return planes[..., :3] * (values[..., 3:] @ polynomial)[..., None]
    if info["type"] in ("ptm", "hsh"):
        terms = polynomial
        if info["type"] == "hsh":
            # Viewers light no lower than π / 2 − 0.5.
            z = max(z, np.cos(np.pi / 2 - 0.5))
            across = np.hypot(x, y) / np.sqrt(1 - z * z)
            terms = np.array(HemisphericalBasis(round(np.sqrt(count / 3))).evaluate(x / across, y / across, z, Numbers))
        return np.stack([values[..., c::3] @ terms for c in range(3)], axis=-1)
    assert info["colorspace"] == "mrgb"
    lights = np.array(info["lights"]).reshape(-1, 3)
    weight = np.exp(-((lights - (x, y, z)) ** 2).sum(axis=1) / info["sigma"] ** 2)
    weight = np.where(weight / weight.sum() > 0.001, weight, 0)
    weight /= weight.sum()
    table = np.frombuffer((folder / "materials.bin").read_bytes(), np.uint8).reshape(count + 1, len(lights), 3)
    if "basis" in info:
        np.testing.assert_array_equal(np.array(info["basis"]), table.ravel())
    mean = np.einsum("l,lc->c", weight, table[0] / 255)
    basis = np.einsum("l,plc->pc", weight, (table[1:] - 127.0) / np.array(material["range"])[:, None, None])
    return mean + values @ basis


class Numbers:
    """NumPy's functions for single numbers."""

    sqrt, log, arctan2, where, minimum, maximum = np.sqrt, np.log, np.arctan2, np.where, np.minimum, np.maximum


def test_the_reader_of_these_tests_reads_real_planes(real):
    """Four fits of one coin by the format's own program look alike under one light, as they must if they are read right."""
    light = light_direction(60, 55)
    images = {}
    for kind in ("ptm", "lptm", "hsh", "rbf27"):
        images[kind] = np.clip(viewer(real(f"photometric/formats/{kind}"), light), 0, 1)
    for kind, image in images.items():
        away = np.sqrt(np.mean((image - images["rbf27"]) ** 2))
        assert away < 0.09, kind
        assert np.corrcoef(image.ravel(), images["rbf27"].ravel())[0, 1] > 0.95, kind


@pytest.mark.parametrize("color", ["channels", "luminance"])
@pytest.mark.parametrize("kind", KINDS)
def test_web_planes_show_what_relight_shows(kind, color, tmp_path):
    texture = texture_of(kind, color)
    write_relightable(texture, tmp_path / "info.json")
    for light in LIGHTS:
        shown, wanted = viewer(tmp_path, light), texture.relight(light, clip=False)
        # 8 bits and JPEG per plane (of noise here, its worst case); for rbf also the table's 8 bits and the viewer's Gaussian.
        assert np.abs(shown - wanted).mean() < 0.02
        assert np.corrcoef(shown.ravel(), wanted.ravel())[0, 1] > 0.985


def test_web_planes_of_a_grey_texture(tmp_path):
    for kind, wanted in (("ptm", ("ptm", "rgb")), ("hsh", ("hsh", "rgb")), ("eigen6", ("rbf", "mrgb"))):
        texture = texture_of(kind, channels=1)
        write_relightable(texture, tmp_path / "info.json")
        info = json.loads((tmp_path / "info.json").read_text())
        assert (info["type"], info["colorspace"]) == wanted
        shown = viewer(tmp_path, LIGHTS[0])
        assert np.abs(shown[..., 0] - texture.relight(LIGHTS[0], clip=False)[..., 0]).mean() < 0.015


def test_tiles_are_the_planes(tmp_path):
    rng = np.random.default_rng(0)
    smooth = np.cumsum(np.cumsum(rng.normal(size=(6, 300, 520, 1)), axis=1), axis=2)
    texture = Relightable("ptm", smooth.astype(np.float32) / 1e4, texture_of("ptm").basis)
    whole, tiled = tmp_path / "whole", tmp_path / "tiled"
    for folder in (whole, tiled):
        folder.mkdir()
    write_web_planes(texture, whole / "info.json")
    written = write_web_planes(texture, tiled / "info.json", tiles=True)
    assert written[-1].name == "info.json"
    assert 'Width="520" Height="300"' in (tiled / "plane_0.dzi").read_text()
    levels = sorted(int(p.name) for p in (tiled / "plane_0_files").iterdir())
    assert levels == list(range(11))
    assert pixels(tiled / "plane_0_files" / "0" / "0_0.jpg").shape == (1, 1, 3)
    rows = [np.concatenate([pixels(tiled / "plane_0_files" / "10" / f"{x}_{y}.jpg") for x in range(3)], axis=1) for y in range(2)]
    plane = pixels(whole / "plane_0.jpg")
    np.testing.assert_allclose(np.concatenate(rows).astype(int), plane.astype(int), atol=12)


def test_web_planes_need_a_json(tmp_path):
    with pytest.raises(FileError, match=r"info\.json"):
        write_web_planes(texture_of("ptm"), tmp_path / "planes")


# ---- materials ----


def test_maps_of_a_material(tmp_path):
    stack = lambertian(dome())
    paths = write_maps(represent(stack, "gradient"), tmp_path / "new")
    assert [p.name for p in paths] == ["normal.png", "albedo.png", "height.png", "maps.exr"]
    channels, _ = read_exr(paths[3])
    normal = read_image(paths[0]) * 2 - 1
    for i, c in enumerate("XYZ"):
        np.testing.assert_allclose(normal[..., i], channels[f"normal.{c}"], atol=2e-5)
    from stacks import relief

    np.testing.assert_allclose(channels["normal.Y"], relief()[0][..., 1], atol=1e-4)
    np.testing.assert_allclose(read_image(paths[1]), relief()[1], atol=0.005)
    heights = channels["height.Y"]
    stretched = (heights - heights.min()) / np.ptp(heights)
    np.testing.assert_allclose(read_image(paths[2]), stretched, atol=2e-5)


def test_height_agrees_with_normals(tmp_path):
    """x to the right, y up: the height map rises where the normal leans away."""
    texture = represent(lambertian(dome()), "gradient")
    channels, _ = read_exr(write_maps(texture, tmp_path)[3])
    slope = np.gradient(channels["height.Y"].astype(float))
    assert np.corrcoef(slope[1].ravel(), (-channels["normal.X"]).ravel())[0, 1] > 0.95
    assert np.corrcoef(-slope[0].ravel(), (-channels["normal.Y"]).ravel())[0, 1] > 0.95


def test_gltf_material(tmp_path):
    import trimesh

    texture = represent(lambertian(dome()), "gradient")
    write_gltf(texture, tmp_path / "t.glb")
    scene = trimesh.load(tmp_path / "t.glb")
    (plane,) = scene.geometry.values()
    np.testing.assert_allclose(plane.extents[:2], [1, 11 / 17], rtol=1e-6)
    material = plane.visual.material
    assert (material.metallicFactor, material.roughnessFactor) == (0.0, 1.0)
    shown = decode_srgb(np.asarray(material.baseColorTexture.convert("RGB"), np.float32) / 255)
    from stacks import relief

    np.testing.assert_allclose(shown, relief()[1], atol=0.006)
    # Row 0 of the image is at the top of the plane: the upper left corner has v = 1.
    corner = np.argmin(plane.vertices[:, 0] - plane.vertices[:, 1])
    np.testing.assert_allclose(plane.visual.uv[corner], [0, 1], atol=1e-6)
    with pytest.raises(FileError, match=r"\.glb"):
        write_gltf(texture, tmp_path / "t.gltf")


def test_maps_into_a_file(tmp_path):
    (tmp_path / "x").write_text("")
    with pytest.raises(FileError, match="is a file"):
        write_maps(texture_of("ptm"), tmp_path / "x")


# ---- hostile input ----


def tampered(tmp_path, change):
    """Write a texture of a kind, change its description, and return the path."""
    kind, edit = change
    texture = represent(
        noisy(dome() if kind == "grid" else scattered(20)), {"grid": "eigen3", "triangles": "eigen6"}.get(kind, kind)
    )
    write_relightable(texture, tmp_path / "t.exr")
    channels, header = read_exr(tmp_path / "t.exr")
    described = json.loads(header["intaglioRelightable"])
    edit(described)
    write_exr(channels, tmp_path / "t.exr", metadata={"intaglioRelightable": json.dumps(described)})
    return tmp_path / "t.exr"


@pytest.mark.parametrize(
    "change",
    [
        ("ptm", lambda d: d.update(version=99)),
        ("ptm", lambda d: d.update(basis=None)),
        ("ptm", lambda d: d.update(basis=[1, 2])),
        ("ptm", lambda d: d.update(kind="hdr")),
        ("ptm", lambda d: d["basis"].update(extra=1)),
        ("hsh", lambda d: d["basis"].update(order=-3)),
        ("3i", lambda d: d["basis"].update(lights=[[0, 0, 1]] * 3)),
        ("3i", lambda d: d["basis"].update(lights=[[float("nan")] * 3] * 3)),
        ("grid", lambda d: d["basis"].update(tilts=d["basis"]["tilts"][::-1])),
        ("grid", lambda d: d["basis"].update(slants=[])),
        ("grid", lambda d: d["basis"].update(tilts=d["basis"]["tilts"] + [359.0])),
        ("triangles", lambda d: d["basis"].update(triangles=[])),
        ("triangles", lambda d: d["basis"]["triangles"][0].__setitem__(0, -1)),
        ("triangles", lambda d: d["basis"]["triangles"][0].__setitem__(0, 10**6)),
        ("rbf", lambda d: d["basis"].update(chart="mercator")),
        ("rbf", lambda d: d["basis"].update(trend="none")),
        ("rbf", lambda d: d["basis"].update(lights=d["basis"]["lights"][:-1])),
        ("rbf", lambda d: d["basis"]["weights"][0].__setitem__(0, float("nan"))),
        ("rbf", lambda d: d["basis"]["weights"][0].__setitem__(0, 1e20)),
        ("rbf", lambda d: d["basis"]["lights"][0].__setitem__(0, 1e200)),
        ("hsh", lambda d: d["basis"].update(order=10**400)),
    ],
)
def test_tampered_textures(change, tmp_path):
    with pytest.raises(FileError, match=r"t\.exr: is an EXR, but not a relightable texture"):
        read_relightable(tampered(tmp_path, change))


def test_maps_that_are_not_finite(tmp_path):
    texture = texture_of("ptm")
    maps = texture.maps.copy()
    maps[2, 3, 4] = np.inf
    with pytest.raises(InputError, match="not finite"):
        Relightable("ptm", maps, texture.basis)


@pytest.mark.parametrize(
    ("row", "value"),
    [
        (2, "nan 4"),
        (2, "inf 4"),
        (2, "20.5 4"),
        (2, "1e300 4"),
        (3, "nan 1 1 1 1 1"),
        (4, "0 0 inf 0 0 0"),
        (3, "1e40 1 1 1 1 1"),
    ],
)
def test_ptm_headers_that_make_no_sense(row, value, tmp_path):
    rows = ["PTM_1.2", "PTM_FORMAT_RGB", "4 4", "1 1 1 1 1 1", "0 0 0 0 0 0"]
    rows[row] = value
    (tmp_path / "t.ptm").write_bytes(("\n".join(rows) + "\n").encode() + bytes(18 * 16))
    with pytest.raises(FileError, match=r"t\.ptm"):
        read_relightable(tmp_path / "t.ptm")


@pytest.mark.parametrize(
    ("reference", "order"), [([1, 0, *[-1] * 7], range(9)), ([0, *[-1] * 8], range(9)), ([1, *[-1] * 8], range(9))]
)
def test_planes_predicted_from_later_ones(reference, order, tmp_path):
    planes = np.full((9, 8, 8), 100, np.uint8)
    jpeg_ptm(tmp_path / "t.ptm", planes, order=order, reference=reference, transforms=[0] * 9)
    with pytest.raises(FileError, match="are inconsistent"):
        read_relightable(tmp_path / "t.ptm")


def test_a_failed_set_of_planes_leaves_the_old_one(tmp_path, monkeypatch):
    write_relightable(texture_of("ptm"), tmp_path / "info.json")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    (tmp_path / "plane_3.jpg").unlink()
    (tmp_path / "plane_3.jpg").mkdir()
    with pytest.raises(FileError, match=r"plane_3\.jpg: is in the way"):
        write_relightable(texture_of("ptm", channels=1), tmp_path / "info.json")
    after = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    assert all(after[name] == before[name] for name in after)
    assert set(before) - set(after) == {"plane_3.jpg"}

    from intaglio.photometric import web_planes

    (tmp_path / "plane_3.jpg").rmdir()
    monkeypatch.setattr(web_planes, "_write_plane", lambda image, path, quality: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        write_relightable(texture_of("hsh"), tmp_path / "info.json")
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == after


def test_tiles_are_replaced_whole(tmp_path):
    large = Relightable("ptm", np.zeros((6, 600, 600, 1), np.float32), texture_of("ptm").basis)
    small = Relightable("ptm", np.zeros((6, 30, 30, 1), np.float32), texture_of("ptm").basis)
    for texture, levels in ((large, 11), (small, 6)):
        write_web_planes(texture, tmp_path / "info.json", tiles=True)
        assert len(list((tmp_path / "plane_0_files").iterdir())) == levels
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".part")]


@pytest.mark.parametrize("color", ["channels", "luminance"])
def test_values_whose_images_would_not_be_finite(color, tmp_path):
    write_relightable(texture_of("ptm", color), tmp_path / "t.exr")
    channels, header = read_exr(tmp_path / "t.exr")
    channels = {name: values if name.startswith("mask") else values + 1e38 for name, values in channels.items()}
    write_exr(channels, tmp_path / "t.exr", metadata={"intaglioRelightable": header["intaglioRelightable"]})
    with pytest.raises(FileError, match=r"t\.exr: .*values over 1e\+12"):
        read_relightable(tmp_path / "t.exr")
