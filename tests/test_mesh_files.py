"""What mesh files hold, as other programs write them, and what is refused because it is damaged."""

from __future__ import annotations

import io
import json
import struct

import numpy as np
import pytest

import intaglio
from intaglio import IntaglioError, IntaglioWarning
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh import read_mesh_file
from intaglio.mesh.ply_file import read_ply

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0.5, 0]], float)


def write(path, content):
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def png(color=(255, 0, 0), size=(2, 2)):
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(np.tile(np.uint8(color), (*size, 1))).save(buffer, "PNG")
    return buffer.getvalue()


def ply(order, polygons, extra=b"", strips=()):
    """Return a PLY of CORNERS with polygons of any size, and triangle strips."""
    name = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = f"ply\nformat {name} 1.0\nelement vertex {len(CORNERS)}\n" + "".join(f"property float {c}\n" for c in "xyz")
    head += f"element face {len(polygons)}\nproperty uchar flag\nproperty list uchar int vertex_indices\n"
    head += f"element tristrips {len(strips)}\nproperty list int int vertex_indices\nend_header\n"
    if not order:
        rows = [" ".join(map(str, c)) for c in CORNERS]
        rows += [" ".join(map(str, (7, len(p), *p))) for p in polygons]
        rows += [" ".join(map(str, (len(s), *s))) for s in strips]
        return head.encode() + "\n".join(rows).encode() + extra
    body = CORNERS.astype(f"{order}f4").tobytes()
    body += b"".join(struct.pack(f"{order}BB{len(p)}i", 7, len(p), *p) for p in polygons)
    body += b"".join(struct.pack(f"{order}i{len(s)}i", len(s), *s) for s in strips)
    return head.encode() + body + extra


@pytest.mark.parametrize("order", ["", "<", ">"])
def test_ply_polygons_and_strips(tmp_path, order):
    path = write(tmp_path / "a.ply", ply(order, [(0, 1, 2, 3), (1, 4, 2), (0, 1)], strips=[(0, 1, 3, 2, -1, 1, 4, 2)]))
    raw = read_mesh_file(path)
    np.testing.assert_array_equal(raw.vertices, CORNERS)
    assert raw.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2], [0, 1, 3], [3, 1, 2], [1, 4, 2]]
    assert raw.notes == ("1 faces of fewer than three corners left out",)
    surface = intaglio.read_surface(path)
    assert "mended: 1 repeated face left out" in surface.notes


@pytest.mark.parametrize("order", ["", "<", ">"])
def test_lists_of_every_length_in_any_order(tmp_path, order):
    random = np.random.default_rng(0)
    lengths = np.concatenate([np.full(6000, 3), random.integers(0, 6, 900), np.full(5000, 4)])
    polygons = [tuple(random.integers(0, 5, n).tolist()) for n in lengths]
    lists = read_ply(write(tmp_path / "a.ply", ply(order, polygons))).lists("face", "vertex_indices")
    np.testing.assert_array_equal(lists.counts, lengths)
    np.testing.assert_array_equal(lists.values, [v for p in polygons for v in p])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda b: b[:-3], "cut off"),
        (lambda b: b.replace(b"element face 2", b"element face"), "no PLY"),
        (lambda b: b.replace(b"element face 2", b"element face 2000000000"), "can't hold"),
        (lambda b: b.replace(b"element face 2", b"element face -2"), "no PLY"),
        (lambda b: b.replace(b"property float y", b"property float x"), "twice"),
        (lambda b: b.replace(b"format ", b"fromat "), "no PLY"),
        (lambda b: b.replace(b"int vertex_indices", b"float vertex_indices", 1), "fractional|names vertex"),
        (lambda b: b.replace(b"property float x", b"property text x"), "no PLY"),
    ],
)
@pytest.mark.parametrize("order", ["", "<"])
def test_damaged_ply(tmp_path, order, change, message):
    path = write(tmp_path / "a.ply", change(ply(order, [(0, 1, 2), (1, 4, 2)])))
    with pytest.raises(IntaglioError, match=rf"a\.ply: .*({message})") as caught:
        intaglio.read_surface(path)
    assert "\n" not in str(caught.value)


def test_ply_colours_of_every_kind(tmp_path):
    head = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {c}\n" for c in "xyz")
    tail = "element face 1\nproperty list uchar int vertex_index\n{}end_header\n"
    for kind, values in (("uchar", "51 102 255"), ("ushort", "13107 26214 65535"), ("float", "0.2 0.4 1.0")):
        colors = "".join(f"property {kind} {c}\n" for c in ("red", "green", "blue"))
        rows = "\n".join(f"{x} {y} 0 {values}" for x, y in ((0, 0), (1, 0), (0, 1)))
        raw = read_mesh_file(write(tmp_path / "a.ply", head + colors + tail.format("") + rows + "\n3 0 1 2\n"))
        np.testing.assert_allclose(raw.color, decode_srgb(np.tile(np.float32([0.2, 0.4, 1]), (3, 1))), atol=1e-6)
    at_face = "".join(f"property uchar {c}\n" for c in ("red", "green", "blue"))
    raw = read_mesh_file(write(tmp_path / "a.ply", head + tail.format(at_face) + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 51 102 255\n"))
    np.testing.assert_allclose(raw.color, decode_srgb(np.tile(np.float32([0.2, 0.4, 1]), (3, 1))), atol=1e-6)


OBJ = """# quads, negative numbers, comments, continued lines, materials
mtllib my materials.mtl
o first
v 0 0 0 # a corner
v 1 0 0
v 1 1 0
v 0 1 0
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vn 0 0 1
usemtl red
f 1/1/1 2/2/1 \\
3/3/1 4/4/1
o second
v 2 0.5 0
f -4//1 -1//1 -3//1
l 1 2
"""


def test_obj(tmp_path):
    write(tmp_path / "My Materials.MTL", "newmtl red\nmap_Kd textures\\Red Wall.png\n")
    (tmp_path / "textures").mkdir()
    write(tmp_path / "textures" / "Red Wall.png", png())
    raw = read_mesh_file(write(tmp_path / "a.obj", OBJ))
    np.testing.assert_array_equal(raw.vertices, CORNERS)
    assert raw.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2]]
    assert raw.uv[:2].tolist() == [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]
    assert np.isnan(raw.uv[2]).all()
    assert raw.notes == ("1 lines of curves, patches, lines or points left out",)
    surface = intaglio.read_surface(tmp_path / "a.obj")
    np.testing.assert_array_equal(surface.color[:4], np.tile([1.0, 0, 0], (4, 1)))
    assert surface.picture == png()
    (tmp_path / "textures" / "Red Wall.png").unlink()
    assert any("Red Wall.png not found" in note for note in intaglio.read_surface(tmp_path / "a.obj").notes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "is 0 in face 1"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "is 4 in face 1; there are 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n", "is -4 in face 1"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", "'x'"),
        ("v 0 0 0\nv 1 zero 0\nv 0 1 0\nf 1 2 3\n", "'zero'"),
        ("v 0 0\nv 1 0\n", "has 2 numbers"),
        ("v #\nv # 1 0 0\n", "has 0 numbers"),
        ("v 0 0 0\nv 1  0\nv 0 1\t0 0\n", "has 2 numbers"),
        (f"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2 {'9' * 400}\n", "'9999"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/2/3/4 2 3\n", "corners are v, v/vt"),
        ("hello\n", "no vertices"),
        ("\0\0\0\0", "not text"),
    ],
)
def test_damaged_obj(tmp_path, text, message):
    with pytest.raises(IntaglioError, match=message):
        intaglio.read_surface(write(tmp_path / "a.obj", text))


def test_obj_vertices_with_colours(tmp_path):
    text = "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0\nf 1 2 3\n"
    color = intaglio.read_surface(write(tmp_path / "a.obj", text)).color
    np.testing.assert_array_equal(color, [[1, 0, 0], [0, 1, 0], [0, 0, 0]])


def test_off(tmp_path):
    text = (
        "COFF # colours\n5 2 0\n"
        + "".join(f"{x} {y} {z} 255 0 0 255\n" for x, y, z in CORNERS)
        + "4 0 1 2 3\n3 1 4 2 0.1 0.2 0.3\n"
    )
    raw = read_mesh_file(write(tmp_path / "a.off", text))
    np.testing.assert_array_equal(raw.vertices, CORNERS)
    assert raw.faces.tolist() == [[0, 1, 2], [0, 2, 3], [1, 4, 2]]
    np.testing.assert_array_equal(raw.color, np.tile([1.0, 0, 0], (5, 1)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("OFF\n5 1 0\n0 0 0\n1 0 0\n", "cut off"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "declares 3 corners"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "vertex -1"),
        ("OFF\n3 1 0\n0 0 0\n1 0 x\n0 1 0\n3 0 1 2\n", "'x'"),
        ("OFF BINARY\n3 1 0\n", "binary"),
        ("NOT\n3 1 0\n", "OFF"),
    ],
)
def test_damaged_off(tmp_path, text, message):
    with pytest.raises(IntaglioError, match=message):
        intaglio.read_surface(write(tmp_path / "a.off", text))


def test_stl_of_both_kinds(tmp_path):
    corners = CORNERS[[[0, 1, 2], [0, 2, 3]]]
    record = np.zeros(2, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    record["corners"] = corners
    binary = b"solid in name only".ljust(80) + struct.pack("<I", 2) + record.tobytes()
    facets = "".join(
        "facet normal 0 0 1\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in c) + "endloop\nendfacet\n"
        for c in corners
    )
    for content in (binary, f"solid a\n{facets}endsolid a\n"):
        raw = read_mesh_file(write(tmp_path / "a.stl", content))
        np.testing.assert_array_equal(raw.vertices, CORNERS[:4])
        assert raw.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    for content in (binary[:-1], f"solid a\n{facets}"[:-90], b"noise" * 30):
        with pytest.raises(IntaglioError, match="cut off"):
            intaglio.read_surface(write(tmp_path / "a.stl", content))


def gltf(path, change=lambda d: None, picture=None):
    """Write a glTF file of two triangles with texture coordinates."""
    uv = np.float32([[0, 0], [1, 0], [1, 1], [0, 1]])
    data = CORNERS[:4].astype("<f4").tobytes() + uv.tobytes() + np.array([0, 1, 2, 0, 2, 3], "<u2").tobytes()
    (path.parent / "my data.bin").write_bytes(data)
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "my%20wall.png"}],
        "buffers": [{"uri": "my%20data.bin", "byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 32},
            {"buffer": 0, "byteOffset": 80, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
    }
    change(document)
    (path.parent / "my wall.png").write_bytes(png((0, 255, 0)) if picture is None else picture)
    return write(path, json.dumps(document))


def test_gltf_with_files_beside_it(tmp_path):
    surface = intaglio.read_surface(gltf(tmp_path / "a.gltf"))
    np.testing.assert_array_equal(surface.vertices, CORNERS[:4])
    assert surface.picture == png((0, 255, 0))
    np.testing.assert_array_equal(surface.color, np.tile([0.0, 1, 0], (4, 1)))
    # glTF counts v downwards, Intaglio upwards.
    assert surface.uv[0].tolist() == [[0, 1], [1, 1], [1, 0]]


def set_at(*way):
    *way, value = way

    def change(document):
        for step in way[:-1]:
            document = document[step]
        document[way[-1]] = value

    return change


@pytest.mark.parametrize(
    "change",
    [
        set_at("accessors", 0, "bufferView", -1),
        set_at("accessors", 0, "count", 10**9),
        set_at("accessors", 0, "count", -1),
        set_at("bufferViews", 0, "byteOffset", -8),
        set_at("bufferViews", 2, "byteLength", 100),
        set_at("buffers", 0, "byteLength", 1000),
        set_at("buffers", 0, "uri", "missing.bin"),
        set_at("nodes", [{"mesh": 0, "children": [0]}]),
        set_at("nodes", 0, "mesh", -1),
        set_at("scene", 4),
        set_at("meshes", [{}]),
        set_at("asset", 3),
        set_at("extensionsRequired", ["KHR_draco_mesh_compression"]),
    ],
)
def test_damaged_gltf(tmp_path, change):
    with pytest.raises(IntaglioError, match=r"a\.gltf|missing\.bin") as caught:
        intaglio.read_surface(gltf(tmp_path / "a.gltf", change))
    assert "\n" not in str(caught.value)


def textured():
    """Two triangles with a seam between them, colours and a picture."""
    uv = np.array([[[0, 0], [0.5, 0], [0.5, 1]], [[0.5, 0], [1, 1], [0.5, 1]]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return intaglio.Surface(vertices=CORNERS[:4], faces=faces, color=np.tile([1.0, 0, 0], (4, 1)), uv=uv, picture=png())


@pytest.mark.parametrize("name", ["a.ply", "a.obj", "a.glb", "a.gltf"])
def test_texture_and_colours_come_back(tmp_path, name):
    surface = textured()
    surface.write(tmp_path / name)
    back = intaglio.read_surface(tmp_path / name)
    np.testing.assert_array_equal(back.vertices, surface.vertices)
    np.testing.assert_array_equal(back.faces, surface.faces)
    np.testing.assert_allclose(back.uv, surface.uv, atol=1e-7)
    assert back.picture == surface.picture
    np.testing.assert_allclose(back.color, surface.color, atol=1e-6)


def test_a_texture_that_a_type_cannot_hold_is_said(tmp_path):
    for name in ("a.stl", "a.off"):
        with pytest.warns(IntaglioWarning, match=r"texture"):
            textured().write(tmp_path / name)


def test_the_vertices_of_the_file_come_back(tmp_path):
    whole = intaglio.read_surface(write(tmp_path / "a.ply", ply("<", [(0, 1, 2), (0, 1, 4), (1, 0, 3)])))
    assert whole.file_vertex is not None
    whole.write(tmp_path / "b.ply")
    np.testing.assert_array_equal(intaglio.read_surface(tmp_path / "b.ply").file_vertex, whole.file_vertex)


# What fuzzing found


@pytest.mark.parametrize("name", ["a.gltf", "a.glb", "a.obj"])
@pytest.mark.parametrize("damage", [b"GIF89a, say", png()[:40]])
def test_a_picture_that_cannot_be_read_costs_the_colours_only(tmp_path, name, damage):
    surface = textured()
    surface = intaglio.Surface(vertices=surface.vertices, faces=surface.faces, uv=surface.uv, picture=surface.picture)
    if name == "a.gltf":
        gltf(tmp_path / name, picture=damage)
    else:
        surface.write(tmp_path / name)
        for path in tmp_path.iterdir():
            data = path.read_bytes()
            path.write_bytes(data.replace(png(), damage.ljust(len(png()), b" ")))
    back = intaglio.read_surface(tmp_path / name)
    assert len(back.faces) == 2
    assert back.uv is not None
    assert back.color is None
    (note,) = (note for note in back.notes if "without its colours" in note)
    assert "\n" not in note
    assert name != "a.obj" or ".png: is " in note
    assert name == "a.obj" or note.startswith("its picture: is ")
    assert not list(tmp_path.glob("tmp*"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (set_at("meshes", 0, "primitives", 0, "attributes", "TEXCOORD_0", 0), "TEXCOORD_0 are of type VEC3"),
        (set_at("meshes", 0, "primitives", 0, "indices", 1), "indices are of type VEC2"),
        (set_at("buffers", 0, "byteLength", "2.0"), "a buffer is damaged"),
        (set_at("buffers", 0, "byteLength", float("inf")), "a buffer is damaged"),
        (set_at("bufferViews", 0, "byteLength", float("inf")), "is damaged"),
    ],
)
def test_gltf_numbers_that_mean_nothing(tmp_path, change, message):
    with pytest.raises(IntaglioError, match=message) as caught:
        intaglio.read_surface(gltf(tmp_path / "a.gltf", change))
    assert str(caught.value).startswith(str(tmp_path / "a.gltf"))


def test_gltf_faces_of_vertices_that_are_not_there(tmp_path):
    path = gltf(tmp_path / "a.gltf")
    data = (tmp_path / "my data.bin").read_bytes()
    (tmp_path / "my data.bin").write_bytes(data[:-2] + struct.pack("<H", 999))
    for read in (intaglio.read_surface, read_mesh_file):
        with pytest.raises(IntaglioError, match=r"a\.gltf: a face names vertex 999, but its mesh has only 4"):
            read(path)


def test_a_glb_that_announces_more_than_memory_holds(tmp_path, monkeypatch):
    import trimesh

    def exhausted(*_, **__):
        raise MemoryError

    monkeypatch.setattr(trimesh, "load", exhausted)
    textured().write(tmp_path / "a.glb")
    with pytest.raises(IntaglioError, match=r"a\.glb: there is not enough memory"):
        intaglio.read_surface(tmp_path / "a.glb")


def test_single_precision_numbers_that_are_none(tmp_path):
    """A signalling NaN makes NumPy warn of the conversion."""
    record = np.zeros(2, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    record["corners"] = CORNERS[[[0, 1, 2], [0, 2, 3]]]
    content = bytearray(bytes(80) + struct.pack("<I", 2) + record.tobytes())
    content[84 + 50 + 12 : 84 + 50 + 16] = struct.pack("<I", 0x7F800001)
    surface = intaglio.read_surface(write(tmp_path / "a.stl", bytes(content)))
    assert len(surface.faces) == 1
    assert np.isfinite(surface.vertices).all()


def test_own_files_without_vertices(tmp_path):
    surface = intaglio.Surface(vertices=CORNERS[:3], faces=np.array([[0, 1, 2]]))
    surface.write(tmp_path / "a.ply")
    head = (
        (tmp_path / "a.ply")
        .read_bytes()
        .split(b"end_header\n")[0]
        .replace(b"vertex 3", b"vertex 0")
        .replace(b"face 1", b"face 0")
    )
    with pytest.raises(IntaglioError, match=r"a\.ply: holds no vertices"):
        intaglio.read_surface(write(tmp_path / "a.ply", head + b"end_header\n"))


def test_own_models_of_absurd_numbers(tmp_path):
    x, y = np.meshgrid(np.arange(3.0), np.arange(3.0))
    flat = intaglio.surface_from_range_image(np.stack([x, y, x * 0], axis=-1), view=(1, 1, 9))
    up = np.tile([0.0, 0, 1], (9, 1))
    model = intaglio.mesh.SmoothBase(vertices=flat.vertices, faces=flat.faces, normals=up, relief_scale=2.0)
    intaglio.Surface(vertices=flat.vertices, faces=flat.faces, model=model).write(tmp_path / "a.ply")
    data = (tmp_path / "a.ply").read_bytes()
    changed = data.replace(b'"relief_scale": 2.0', b'"relief_scale": ' + b"9" * 400)
    assert changed != data
    with pytest.raises(IntaglioError, match=r"a\.ply: Intaglio's own comments in it are damaged"):
        intaglio.read_surface(write(tmp_path / "a.ply", changed))


def test_range_grids_are_mended_like_meshes(tmp_path):
    rows = [f"{x} {y} {np.sin(x) / 4 + np.cos(y) / 5:.6g}" for y in range(9) for x in range(9)]
    # Two points so far off that the sides of a triangle lie in one line.
    rows[8], rows[80] = "8 65536 0.44734", "8 99999999999999999999 0.21824"
    head = "ply\nformat ascii 1.0\nobj_info num_cols 9\nobj_info num_rows 9\nelement vertex 81\n"
    head += "".join(f"property float {c}\n" for c in "xyz")
    head += "element range_grid 81\nproperty list uchar int vertex_indices\nend_header\n"
    cells = "".join("0\n" if k in (40, 41) else f"1 {k}\n" for k in range(81))
    path = write(tmp_path / "a.ply", head + "\n".join(rows) + "\n" + cells)
    surface = intaglio.read_surface(path)
    assert any("mended: 1 flat triangle" in note for note in surface.notes)
    assert surface.file_vertex is None
    assert intaglio.mend_surface(surface, strict=True) is surface
    with pytest.raises(IntaglioError, match=r"a\.ply: .*flat triangle"):
        intaglio.read_surface(path, strict=True)


def test_texture_coordinates_of_vertices_that_are_not_finite(tmp_path):
    textured().write(tmp_path / "a.obj")
    path = tmp_path / "a.obj"
    path.write_text(path.read_text().replace("v 1.0 1.0 0.0", "v nan 1.0 0.0").replace("v 1 1 0", "v nan 1 0"))
    assert "nan" in path.read_text()
    with pytest.raises(IntaglioError, match=r"a\.obj: has vertices that are not finite"):
        intaglio.geometry.read_uv_mesh(path)
