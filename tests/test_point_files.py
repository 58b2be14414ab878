"""Files of points: LAS, LAZ, COPC, E57, tables, PTS, PTX, PCD, PLY; what is mended, and what is refused."""

from __future__ import annotations

import struct
import warnings

import numpy as np
import pytest

from intaglio import FileError, InputError, IntaglioError
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh import holds_points, read_point_file

SURVEY = np.array([512_345.125, 5_403_210.5, 431.25])


def cloud(count=500, seed=0):
    """Points of a survey, in steps that all formats hold exactly, and 8-bit colours."""
    rng = np.random.default_rng(seed)
    points = SURVEY + np.round(rng.random((count, 3)) * 10 * 1024) / 1024
    return points, rng.integers(0, 256, (count, 3))


def shown(levels):
    return decode_srgb(np.asarray(levels, np.float32) / 255)


def turned(axis, angle):
    """The matrix and quaternion (w, x, y, z) of a rotation."""
    x, y, z = axis = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix, np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])


# --- LAS, LAZ and COPC


def write_las(path, points, color=None, form=7, **dimensions):
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=form, version="1.4" if form > 5 else "1.2")
    header.scales, header.offsets = np.full(3, 1 / 1024), np.floor(points.min(axis=0))
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    if color is not None:
        las.red, las.green, las.blue = np.asarray(color, np.uint16).T
    for name, value in dimensions.items():
        if name not in las.point_format.dimension_names:
            las.add_extra_dim(laspy.ExtraBytesParams(name=name, type=np.float32))
        las[name] = value
    las.write(str(path))


@pytest.mark.parametrize("suffix", [".las", ".laz", ".LAZ"])
@pytest.mark.parametrize(("factor", "note"), [(1, "8-bit"), (256, None), (257, None)])
def test_las_keeps_survey_coordinates_and_decodes_colours_of_8_and_16_bits(tmp_path, suffix, factor, note):
    points, color = cloud()
    color[0] = 255
    write_las(tmp_path / f"a{suffix}", points, color * factor, intensity=np.arange(500))
    found = read_point_file(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(found.points, points)
    np.testing.assert_allclose(found.color, shown(color), atol=1e-6)
    np.testing.assert_array_equal(found.intensity, np.arange(500))
    assert any("8-bit" in n for n in found.notes) == (note is not None)
    assert found.viewpoints is None
    assert found.scan is None


def test_las_without_colours_with_normals_withheld_points_and_noise(tmp_path):
    points, color = cloud()
    normals = np.random.default_rng(1).normal(size=(500, 3)).astype(np.float32)
    withheld, kind = np.zeros(500, int), np.zeros(500, int)
    withheld[:3], kind[3:8] = 1, (7, 18, 7, 7, 18)
    write_las(
        tmp_path / "a.laz", points, 0 * color, withheld=withheld, classification=kind,
        NormalX=normals[:, 0], NormalY=normals[:, 1], NormalZ=normals[:, 2],
    )  # fmt: skip
    found = read_point_file(tmp_path / "a.laz")
    np.testing.assert_array_equal(found.points, points[8:])
    np.testing.assert_array_equal(found.normals, normals[8:])
    assert found.color is None
    assert found.intensity is None
    said = "; ".join(found.notes)
    assert "3 points marked as withheld" in said
    assert "5 points classified as noise" in said
    assert "never filled in" in said
    write_las(tmp_path / "old.las", points, form=0)
    old = read_point_file(tmp_path / "old.las")
    assert old.color is None
    assert old.notes == ()


def test_a_real_copc_file_is_read(real):
    pytest.importorskip("laspy")
    found = read_point_file(real("meshes/lion_takanawa_points/lion_takanawa.copc.laz"))
    assert len(found) == 275_855
    assert any("66134 points that lie exactly on another" in n for n in found.notes)
    np.testing.assert_allclose(found.points.min(axis=0), [-4.985, 1.039, -3.445], atol=0.006)
    np.testing.assert_allclose(found.points.max(axis=0), [-0.789, 6.724, 1.124], atol=0.006)
    assert found.color.max() == 1
    assert found.intensity.max() == 65535


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_damaged_las_is_refused(tmp_path, suffix):
    points, color = cloud()
    path = tmp_path / f"a{suffix}"
    write_las(path, points, color)
    data = path.read_bytes()

    def told(changed, match):
        path.write_bytes(changed)
        with pytest.raises(FileError, match=match) as error:
            read_point_file(path)
        assert str(error.value).startswith(str(path))
        assert "\n" not in str(error.value)

    told(data[:-200], "cut off|can't be read")
    told(b"LASF", "not LAS")
    told(b"text" + data[4:], "not LAS")
    told(data[:247] + struct.pack("<Q", 2**50) + data[255:], "declares 1125899906842624 points")
    told(data[:96] + struct.pack("<I", 2**31) + data[100:], "header is damaged")


def test_what_is_missing_to_read_scans_is_named(tmp_path, monkeypatch):
    for name, package in (("a.laz", "laspy"), ("a.e57", "pye57")):
        monkeypatch.setitem(__import__("sys").modules, package, None)
        (tmp_path / name).write_bytes(b"x" * 400)
        with pytest.raises(FileError, match=r"pip install 'intaglio\[points\]'"):
            read_point_file(tmp_path / name)


# --- E57


def write_e57(path, scans):
    """Write scans: points in their scanner's coordinates, rotation quaternion, position, and further fields."""
    pye57 = pytest.importorskip("pye57")
    with pye57.E57(str(path), mode="w") as file:
        for points, quaternion, stood, fields in scans:
            data = {f"cartesian{axis}": points[:, k].astype(np.float64) for k, axis in enumerate("XYZ")}
            file.write_scan_raw({**data, **fields}, rotation=quaternion, translation=stood)


def test_e57_scans_are_posed_and_their_positions_kept(tmp_path):
    rng = np.random.default_rng(3)
    scans, worlds, colors = [], [], []
    for number in range(2):
        local = np.round(rng.random((300, 3)) * 1024) / 1024 + 1
        color = rng.integers(0, 256, (300, 3)).astype(np.uint8)
        matrix, quaternion = turned((1, 2, 3), 0.7 + number)
        stood = SURVEY + (10.0 * number, 5, 2)
        fields = {f"color{name}": color[:, k] for k, name in enumerate(("Red", "Green", "Blue"))}
        fields["intensity"] = rng.random(300).astype(np.float32)
        invalid = np.zeros(300, np.int8)
        invalid[: 5 * number] = 1
        scans.append((local, quaternion, stood, {**fields, "cartesianInvalidState": invalid}))
        worlds.append((local @ matrix.T + stood)[5 * number :])
        colors.append(color[5 * number :])
    write_e57(tmp_path / "a.e57", scans)
    found = read_point_file(tmp_path / "a.e57")
    np.testing.assert_allclose(found.points, np.concatenate(worlds), atol=1e-6)
    np.testing.assert_allclose(found.color, shown(np.concatenate(colors)), atol=1e-6)
    np.testing.assert_allclose(found.viewpoints, [stood for _, _, stood, _ in scans])
    np.testing.assert_array_equal(found.scan, np.repeat([0, 1], [300, 295]))
    assert found.intensity.max() <= 1
    assert any("5 readings of scan 2 without a point" in n for n in found.notes)


def test_e57_in_spherical_coordinates(tmp_path):
    pye57 = pytest.importorskip("pye57")
    lib = pye57.libe57
    rng = np.random.default_rng(0)
    away, around, up = rng.uniform(1, 5, 50), rng.uniform(-3, 3, 50), rng.uniform(-1.5, 1.5, 50)
    away[:4] = 0
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        image = file.image_file
        scan, form, buffers = lib.StructureNode(image), lib.StructureNode(image), lib.VectorSourceDestBuffer()
        for name, values in (("Range", away), ("Azimuth", around), ("Elevation", up)):
            form.set(f"spherical{name}", lib.FloatNode(image, 0.0, lib.E57_DOUBLE, -10.0, 10.0))
            buffers.append(lib.SourceDestBuffer(image, f"spherical{name}", values, 50, True, True))
        points = lib.CompressedVectorNode(image, form, lib.VectorNode(image, True))
        scan.set("points", points)
        file.data3d.append(scan)
        writer = points.writer(buffers)
        writer.write(50)
        writer.close()
    found = read_point_file(tmp_path / "a.e57")
    assert len(found) == 46
    np.testing.assert_allclose(np.linalg.norm(found.points, axis=1), away[4:])
    np.testing.assert_allclose(np.arcsin(found.points[:, 2] / away[4:]), up[4:])
    np.testing.assert_allclose(np.arctan2(found.points[:, 1], found.points[:, 0]), around[4:])
    assert found.viewpoints is None


def test_damaged_e57_is_refused(tmp_path):
    points, _ = cloud()
    path = tmp_path / "a.e57"
    write_e57(path, [(points - SURVEY, (1, 0, 0, 0), SURVEY, {})])
    data = path.read_bytes()
    for changed, match in ((data[:-1500], "can't be read as E57"), (b"text" * 500, "not E57"), (data[:3000], "can't be read")):
        path.write_bytes(changed)
        with pytest.raises(FileError, match=match) as error:
            read_point_file(path)
        assert "\n" not in str(error.value)


# --- tables


def rows(*columns):
    return "".join(" ".join(f"{value:.17g}" for value in row) + "\n" for row in np.column_stack(columns))


POINTS, LEVELS = cloud(200)
LEVELS[0] = 255
UNIT = np.random.default_rng(4).normal(size=(200, 3))
UNIT /= np.linalg.norm(UNIT, axis=1, keepdims=True)
STRENGTH = np.arange(200.0) - 100


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        (rows(POINTS), ""),
        (rows(POINTS, STRENGTH), "i"),
        (rows(POINTS, LEVELS), "c"),
        (rows(POINTS, UNIT), "n"),
        (rows(POINTS, STRENGTH, LEVELS), "ic"),
        (rows(POINTS, LEVELS, STRENGTH), "ic"),
        (rows(POINTS, LEVELS, UNIT), "cn"),
        (rows(POINTS, UNIT, LEVELS), "cn"),
        (rows(POINTS, STRENGTH, LEVELS, UNIT), "icn"),
        (rows(POINTS, LEVELS, UNIT, STRENGTH), "icn"),
        ("200\n" + rows(POINTS, STRENGTH, LEVELS), "ic"),
        ("\ufeff// exported\n//X Y Z R G B Nx Ny Nz\n" + rows(POINTS, LEVELS, UNIT), "cn"),
        ("x,y,z,nx,ny,nz,red,green,blue\n" + rows(POINTS, UNIT, LEVELS).replace(" ", ","), "cn"),
        ("Intensity;Z [m];Y [m];X [m];other\n" + rows(STRENGTH, POINTS[:, ::-1], STRENGTH).replace(" ", ";"), "i"),
        ("X\tY\tZ\n" + rows(POINTS).replace(" ", "\t"), ""),
        (rows(POINTS).replace(" ", ", "), ""),
        (rows(POINTS).replace(" ", " ; "), ""),
        (rows(POINTS).replace("\n", " \r\n"), ""),
        (rows(POINTS).replace(" ", ",").replace("\n", ",\n"), ""),
        (rows(POINTS).replace(".", ",").replace(" ", ";"), ""),
        (rows(POINTS).replace(".", ","), ""),
        ("# one\n" + rows(POINTS[:90]) + "# between\n\n" + rows(POINTS[90:]), ""),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_tables_are_read_however_they_are_laid_out(tmp_path, text, kept, encoding):
    (tmp_path / "a.xyz").write_bytes(text.encode(encoding))
    found = read_point_file(tmp_path / "a.xyz")
    np.testing.assert_array_equal(found.points, POINTS)
    assert found.notes == ()
    for name, value, wanted in (("c", found.color, shown(LEVELS)), ("n", found.normals, UNIT), ("i", found.intensity, STRENGTH)):
        assert (value is not None) == (name in kept)
        if value is not None:
            np.testing.assert_allclose(value, wanted, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "note", "left"),
    [
        (rows(POINTS) + "1 2 three\n1 2\n", "2 lines without 3 numbers left out, the first is line 201: '1 2 three'", 200),
        ("201\n" + rows(POINTS) + "oops\n", "1 line without 3 numbers left out, the first is line 202: 'oops'", 200),
        (rows(POINTS) + "1 nan 2\n1 inf 2\n", "2 points without finite coordinates", 200),
        (rows(POINTS, POINTS[::-1])[: rows(POINTS, POINTS[::-1]).rfind("\n")], "not of length 1", 200),
        (rows(POINTS) + rows(POINTS[:7]), "7 points that lie exactly on another", 200),
        (rows(POINTS, POINTS[:, :2]), "columns 4 to 5 have no names", 200),
        ("900\n" + rows(POINTS), "promises 900 points, but holds 200: the file may be cut off", 200),
        ("20\n" + rows(POINTS), "promises 20 points, but holds 200: all were read", 200),
        ("-200\n" + rows(POINTS), "line 1, '-200', is no number of points", 200),
        ("200.5\n" + rows(POINTS), "line 1, '200.5', is no number of points", 200),
        ("inf\n" + rows(POINTS), "line 1, 'inf', is no number of points", 200),
        ("my scan\n" + rows(POINTS), "line 1 holds 'my scan', not the names of columns", 200),
        (rows(POINTS, np.where(np.arange(200)[:, None] < 3, 0, UNIT)), "3 normals without a direction", 200),
        (rows(POINTS, np.where(np.arange(200)[:, None] < 3, np.nan, UNIT)), "3 normals without a direction", 200),
    ],
)
def test_what_is_odd_in_tables_is_mended_with_a_word(tmp_path, text, note, left):
    (tmp_path / "a.pts").write_text(text)
    found = read_point_file(tmp_path / "a.pts")
    assert len(found) == left
    assert [n for n in found.notes if note in n], found.notes
    np.testing.assert_array_equal(found.points, POINTS[:left])
    if found.normals is not None:
        np.testing.assert_array_equal(found.normals[3:], (POINTS[::-1] if "length 1" in note else UNIT)[3:])
        assert (np.linalg.norm(found.normals, axis=1) > 0).all()


def test_a_pts_file_of_several_scans_adds_up_their_counts(tmp_path):
    path = tmp_path / "a.pts"
    path.write_text("90\n" + rows(POINTS[:90]) + "110\n" + rows(POINTS[90:]))
    assert read_point_file(path).notes == ()
    path.write_text("90\n" + rows(POINTS[:90]) + "200\n" + rows(POINTS[90:]))
    assert any("promises 290 points, but holds 200" in n for n in read_point_file(path).notes)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.xyz", b"\n\n", "holds no points"),
        ("a.xyz", b"5\n", "holds no points"),
        ("a.xyz", b"nan nan nan\n", "holds no points"),
        ("a.xyz", b"1 2\n3 4\n", "line 1 holds '1 2'"),
        ("a.xyz", b"# a\n\n1 2 three\n", "line 3 holds '1 2 three'"),
        ("a.xyz", b"1 2 3\n" * 9 + b"1 2 x\n" * 5, "line 10: '1 2 x'.*and in 4 further lines"),
        ("a.xyz", b"1 2 3\n1 2 3 4 5 6\n", "all alike"),
        ("a.xyz", b"1 2 3\n\0\1\2", "binary data, not text"),
        ("a.xyz", b"x" * 100_000, r"line 1 holds 'x{40}'; lines of at least 3"),
        ("a.csv", b"name,x,y,z\nP1,1,2,3\n", "line 1 holds 'name,x,y,z'"),
        ("a.ptx", b"2\n2\nwords\n", "begins no scan"),
        ("a.docx", b"text", "unknown type"),
        ("a.obj", b"v 1 2 3\nvn 0 0 1\nv 2 2 2\n", "2 points but 1 normals"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 99999\nproperty float x\nend_header\n1\n", "99999 vertex.*cut off"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex -1\nproperty float x\nend_header\n1\n", "a line that is no PLY"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "no x, y and z"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n", "holds no points"),
        ("a.pcd", b"nothing", "no header"),
    ],
)
def test_what_can_not_be_read_is_told_in_a_line(tmp_path, name, data, message):
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises((FileError, InputError), match=message) as told:
        read_point_file(path)
    said = str(told.value)
    assert said.startswith(f"{path}: ")
    assert said.count(str(path)) == 1
    assert "\n" not in said
    assert len(said) < len(str(path)) + 250


# --- PTX


def write_ptx(path, scans):
    with open(path, "w") as file:
        for local, matrix, stood, columns, cells in scans:
            whole = np.eye(4)
            whole[:3, :3], whole[3, :3] = matrix.T, stood
            np.savetxt(file, [columns, len(cells) // columns], fmt="%d")
            np.savetxt(file, [stood, *matrix.T])
            np.savetxt(file, whole)
            np.savetxt(file, np.column_stack([local, cells]), fmt="%.12g")


def test_ptx_scans_are_posed_and_empty_cells_left_out(tmp_path):
    rng = np.random.default_rng(5)
    scans, worlds = [], []
    for number in range(2):
        local = np.round(rng.random((60, 3)), 6) + 1
        local[: 3 + number] = 0
        cells = np.column_stack([np.round(rng.random(60), 6), rng.integers(0, 256, (60, 3))])
        matrix, _ = turned((0, 1, 2), number + 0.3)
        stood = SURVEY + number
        scans.append((local, matrix, stood, 10, cells))
        worlds.append((local @ matrix.T + stood)[3 + number :])
    write_ptx(tmp_path / "a.ptx", scans)
    found = read_point_file(tmp_path / "a.ptx")
    np.testing.assert_allclose(found.points, np.concatenate(worlds), atol=1e-7)
    np.testing.assert_allclose(found.viewpoints, [SURVEY, SURVEY + 1])
    np.testing.assert_array_equal(found.scan, np.repeat([0, 1], [57, 56]))
    np.testing.assert_allclose(found.color[:57], shown(scans[0][4][3:, 1:]), atol=1e-6)
    assert any("7 cells of its grids" in n for n in found.notes)
    text = (tmp_path / "a.ptx").read_text().split("\n")
    (tmp_path / "a.ptx").write_text("\n".join(text[:100]))
    with pytest.raises(FileError, match="promises 60 points, but 20 follow: the file is cut off"):
        read_point_file(tmp_path / "a.ptx")


# --- PCD


def lzf(data):
    """Pack bytes by LibLZF's format: literals, and copies of what repeats at a distance of up to 8 KiB."""
    made, literals, at, seen = bytearray(), bytearray(), 0, {}

    def flush():
        for k in range(0, len(literals), 32):
            part = literals[k : k + 32]
            made.append(len(part) - 1)
            made.extend(part)
        literals.clear()

    while at < len(data):
        back = seen.get(data[at : at + 3], -1)
        seen[data[at : at + 3]] = at
        if back < 0 or at - back > 8192 or at + 3 > len(data):
            literals.append(data[at])
            at += 1
            continue
        length = 3
        while at + length < len(data) and length < 264 and data[back + length] == data[at + length]:
            length += 1
        flush()
        distance = at - back - 1
        if length < 9:
            made.append((length - 2) << 5 | distance >> 8)
        else:
            made.extend([7 << 5 | distance >> 8, length - 9])
        made.append(distance & 255)
        at += length
    flush()
    return bytes(made)


PCD = """# .PCD v0.7
VERSION 0.7
FIELDS x y z rgb normal_x normal_y normal_z intensity _
SIZE 8 8 8 4 4 4 4 4 1
TYPE F F F {} F F F F U
COUNT 1 1 1 1 1 1 1 1 3
WIDTH {}
HEIGHT {}
VIEWPOINT {} 1 0 0 0
POINTS {}
DATA {}
"""


def write_pcd(path, kind, points, color, normals, view=(0, 0, 0), packed="F", height=1):
    names = ["x", "y", "z", "rgb", "nx", "ny", "nz", "i"]
    table = np.zeros(len(points), [*zip(names, ["<f8"] * 3 + ["<u4"] + ["<f4"] * 4, strict=True), ("_", "u1", 3)])
    for k, name in enumerate("xyz"):
        table[name], table[f"n{name}"] = points[:, k], normals[:, k]
    table["rgb"] = color[:, 0] << 16 | color[:, 1] << 8 | color[:, 2]
    table["i"] = np.arange(len(points))
    head = PCD.format(packed, len(points) // height, height, " ".join(map(str, view)), len(points), kind).encode()
    if kind == "binary":
        body = table.tobytes()
    elif kind == "ascii":
        shade = table["rgb"].view(np.float32) if packed == "F" else table["rgb"]
        body = "".join(
            " ".join(
                [*(repr(float(v)) for v in row), repr(shade[k].item()), *(repr(float(v)) for v in normals[k]), f"{k} 0 0 0\n"]
            )
            for k, row in enumerate(points)
        ).encode()
    else:
        plain = b"".join(np.ascontiguousarray(table[name]).tobytes() for name in table.dtype.names)
        packed_bytes = lzf(plain)
        body = struct.pack("<II", len(packed_bytes), len(plain)) + packed_bytes
    path.write_bytes(head + body)


@pytest.mark.parametrize("packed", ["F", "U"])
@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_pcd_of_all_kinds_gives_the_same_points(tmp_path, kind, packed):
    write_pcd(tmp_path / "a.pcd", kind, POINTS, LEVELS, UNIT.astype(np.float32), (1.5, 2, 3), packed)
    found = read_point_file(tmp_path / "a.pcd")
    np.testing.assert_array_equal(found.points, POINTS)
    np.testing.assert_allclose(found.color, shown(LEVELS), atol=1e-6)
    np.testing.assert_array_equal(found.normals, UNIT.astype(np.float32))
    np.testing.assert_array_equal(found.intensity, np.arange(200))
    np.testing.assert_array_equal(found.viewpoints, [[1.5, 2, 3]])
    np.testing.assert_array_equal(found.scan, np.zeros(200))
    data = (tmp_path / "a.pcd").read_bytes()
    for cut in (len(data) - 60, len(data) // 2, 100):
        (tmp_path / "a.pcd").write_bytes(data[:cut])
        with pytest.raises(FileError, match=r"cut off|no header|damaged"):
            read_point_file(tmp_path / "a.pcd")


def test_pcd_on_a_grid_was_seen_from_its_origin_and_has_empty_cells(tmp_path):
    points = np.where(np.arange(200)[:, None] < 6, np.nan, POINTS)
    write_pcd(tmp_path / "a.pcd", "binary", points, LEVELS, UNIT, height=10)
    found = read_point_file(tmp_path / "a.pcd")
    np.testing.assert_array_equal(found.points, POINTS[6:])
    np.testing.assert_array_equal(found.viewpoints, [[0, 0, 0]])
    assert found.notes == ("6 cells of its grid without a point",)
    # Elsewhere the origin is what writers put that know of no viewpoint.
    write_pcd(tmp_path / "b.pcd", "binary", POINTS, LEVELS, UNIT)
    assert read_point_file(tmp_path / "b.pcd").viewpoints is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("POINTS 200", "POINTS 2000000000", "promises 2000000000 points in 200 columns"),
        ("WIDTH 200", "WIDTH -200", "promises 200 points in -200 columns"),
        ("WIDTH 200\nHEIGHT 1", "WIDTH 200000000\nHEIGHT 1", "promises 200 points"),
        ("SIZE 8", "SIZE 3", "'x' has type 'F', size 3"),
        ("COUNT 1", "COUNT 99999999", "count 99999999"),
        ("SIZE 8 ", "SIZE ", "names 9 fields, but 8 sizes"),
        ("TYPE F", "TYPE Q", "type 'Q'"),
        ("FIELDS x", "FIELDS w", "x, y and z are needed"),
        ("DATA binary", "DATA zip", "known are ascii"),
        ("WIDTH 200", "WIDTH many", "no whole numbers"),
        ("VIEWPOINT 0", "VIEWPOINT here", "no numbers"),
    ],
)
def test_wrong_headers_of_pcd_are_told(tmp_path, old, new, message):
    write_pcd(tmp_path / "a.pcd", "binary", POINTS, LEVELS, UNIT)
    data = (tmp_path / "a.pcd").read_bytes()
    assert old.encode() in data
    (tmp_path / "a.pcd").write_bytes(data.replace(old.encode(), new.encode(), 1))
    with pytest.raises(FileError, match=message):
        read_point_file(tmp_path / "a.pcd")


# --- PLY


@pytest.mark.parametrize("order", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(("kind", "scale"), [("uchar", 1), ("ushort", 257), ("float", 1 / 255)])
def test_ply_points_keep_double_precision_normals_and_colours(tmp_path, order, kind, scale):
    end = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[order]
    types = {"uchar": "u1", "ushort": "u2", "float": "f4"}
    head = f"ply\nformat {order} 1.0\nelement camera 1\nproperty float view\nelement vertex 200\n"
    fields = [*(("double", n) for n in "xyz"), *(("float", f"n{n}") for n in "xyz")]
    fields += [*((kind, n) for n in ("red", "green", "blue")), ("short", "intensity")]
    head += "".join(f"property {t} {n}\n" for t, n in fields) + "end_header\n"
    values = np.column_stack([POINTS, UNIT, LEVELS * scale, STRENGTH])
    if order == "ascii":
        body = ("7\n" + rows(values)).encode()
    else:
        codes = {"double": "f8", "short": "i2", **types}
        table = np.zeros(200, [(n, end + codes[t]) for t, n in fields])
        for k, (_, name) in enumerate(fields):
            table[name] = values[:, k]
        body = b"\0\0\0\0" + table.tobytes()
    (tmp_path / "a.ply").write_bytes(head.encode() + body)
    assert holds_points(tmp_path / "a.ply")
    found = read_point_file(tmp_path / "a.ply")
    np.testing.assert_array_equal(found.points, POINTS)
    np.testing.assert_allclose(found.normals, UNIT, atol=1e-7)
    np.testing.assert_allclose(found.color, shown(LEVELS), atol=1e-6)
    np.testing.assert_array_equal(found.intensity, STRENGTH)


def test_lists_of_lights_are_no_points(tmp_path):
    (tmp_path / "lights.csv").write_text("image,x,y,z\na.png,0,0,1\n")
    (tmp_path / "points.csv").write_text("x,y,z\n0,0,1\n")
    (tmp_path / "points.txt").write_text("1\n0 0 1\n")
    assert not holds_points(tmp_path / "lights.csv")
    assert holds_points(tmp_path / "points.csv")
    assert holds_points(tmp_path / "points.txt")


# --- whatever comes


def samples(folder):
    """Small files of every kind."""
    write_las(folder / "a.las", POINTS, LEVELS)
    write_las(folder / "a.laz", POINTS, LEVELS)
    write_e57(folder / "a.e57", [(POINTS - SURVEY, (1, 0, 0, 0), SURVEY, {})])
    for kind in ("ascii", "binary", "binary_compressed"):
        write_pcd(folder / f"{kind}.pcd", kind, POINTS, LEVELS, UNIT)
    (folder / "a.pts").write_text("200\n" + rows(POINTS, STRENGTH, LEVELS))
    (folder / "a.csv").write_text("x,y,z,r,g,b\n" + rows(POINTS, LEVELS).replace(" ", ","))
    write_ptx(folder / "a.ptx", [(POINTS[:40], np.eye(3), SURVEY, 10, np.ones((40, 1)))])
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 200\n" + "".join(f"property double {n}\n" for n in "xyz")
    (folder / "a.ply").write_bytes((head + "end_header\n").encode() + POINTS.astype("<f8").tobytes())
    (folder / "a.obj").write_text("".join(f"v {line}\n" for line in rows(POINTS).splitlines()))
    return sorted(folder.iterdir())


def mutated(data, rng):
    """Bytes with something wrong: cut off, flipped, repeated, or with a huge number in a header."""
    data = bytearray(data)
    kind = rng.integers(5)
    head = min(len(data), 600)
    if kind == 0:
        return bytes(data[: rng.integers(1, len(data))])
    for _ in range(rng.integers(1, 6)):
        at = int(rng.integers(head if rng.random() < 0.6 else len(data)))
        if kind == 1:
            data[at] = rng.integers(256)
        elif kind == 2:
            data[at : at + 4] = rng.choice([b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\0", b"\0\0\0\x80"])
        elif kind == 3:
            data[at : at + 1] = bytes(rng.choice([b"999999999", b"-1", b"nan", b"1e400", b" ", b"\n", b"\0", b"0.5"]))
        else:
            other = int(rng.integers(len(data)))
            data[at : at + 20] = data[other : other + int(rng.integers(0, 40))]
    return bytes(data) or b"\0"


def test_nothing_but_our_errors_comes_of_damaged_files(tmp_path):
    originals = tmp_path / "originals"
    originals.mkdir()
    rng = np.random.default_rng(0)
    told = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for path in samples(originals):
            data = path.read_bytes()
            for number in range(40):
                damaged = tmp_path / path.name
                damaged.write_bytes(mutated(data, rng))
                try:
                    found = read_point_file(damaged)
                except IntaglioError as error:
                    told.append(str(error))
                    continue
                assert np.isfinite(found.points).all(), (path.name, number)
                assert len(found), (path.name, number)
    assert not [said for said in told if "\n" in said or len(said) > len(str(tmp_path)) + 400]


# What fuzzing found


def test_numbers_beyond_single_precision_say_nothing_of_their_own(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 2\n" + "".join(f"property double {n}\n" for n in ("x", "y", "z", *COLOR_NAMES))
    (tmp_path / "a.ply").write_text(head + "end_header\n0 0 0 1e300 0 0\n1 0 0 0 1 0\n")
    assert read_point_file(tmp_path / "a.ply").color[0].tolist() == [1, 0, 0]
    (tmp_path / "a.xyz").write_text(rows(POINTS, UNIT) + "0 0 0 1e200 0 0\n")
    assert read_point_file(tmp_path / "a.xyz").normals is not None
    points, color = cloud()
    write_las(tmp_path / "a.las", points, color)
    data = bytearray((tmp_path / "a.las").read_bytes())
    data[131:139] = struct.pack("<d", 1e308)
    (tmp_path / "a.las").write_bytes(data)
    with pytest.raises(InputError, match=r"a\.las: holds no points \(500 points without finite coordinates"):
        read_point_file(tmp_path / "a.las")


COLOR_NAMES = ("red", "green", "blue")


def test_long_lines_of_brackets_take_no_time(tmp_path):
    """Where each bracket looked for its partner to the end of the line this took minutes."""
    (tmp_path / "a.txt").write_text("(" * 200_000 + "\n" + rows(POINTS))
    np.testing.assert_array_equal(read_point_file(tmp_path / "a.txt").points, POINTS)
    (tmp_path / "b.txt").write_text("X (m),Y [m],Z(m)\n" + rows(POINTS).replace(" ", ","))
    np.testing.assert_array_equal(read_point_file(tmp_path / "b.txt").points, POINTS)


def test_a_ptx_file_of_blank_lines(tmp_path):
    (tmp_path / "a.ptx").write_text(" \n\t\n")
    with pytest.raises(InputError, match=r"a\.ptx: holds no points"):
        read_point_file(tmp_path / "a.ptx")


def test_what_the_unpacking_of_points_says_is_not_printed(tmp_path, capfd):
    points, color = cloud()
    write_las(tmp_path / "a.laz", points, color, form=3)
    data = (tmp_path / "a.laz").read_bytes()
    record = data.index(b"laszip encoded") - 2 + 54
    # A point of no items has no size, by which the library divides.
    assert struct.unpack_from("<H", data, record + 32) == (3,)
    (tmp_path / "a.laz").write_bytes(data[: record + 32] + struct.pack("<H", 0) + data[record + 34 :])
    with pytest.raises(FileError, match=r"a\.laz: can't be read as LAZ"):
        read_point_file(tmp_path / "a.laz")
    assert capfd.readouterr() == ("", "")


def test_chunks_of_more_points_than_memory(tmp_path, monkeypatch):
    """The library that unpacks them would end the process."""
    monkeypatch.setenv("INTAGLIO_MEMORY", "1")
    points, color = cloud()
    write_las(tmp_path / "a.laz", points, color, form=3)
    data = (tmp_path / "a.laz").read_bytes()
    record = data.index(b"laszip encoded") - 2 + 54
    assert struct.unpack_from("<I", data, record + 12) == (50_000,)
    (tmp_path / "a.laz").write_bytes(data[: record + 12] + struct.pack("<I", 0x8000C350) + data[record + 16 :])
    with pytest.raises(InputError, match=r"a\.laz: a compressed chunk of 2147533648 points needs 2 GiB"):
        read_point_file(tmp_path / "a.laz")
