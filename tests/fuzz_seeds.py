"""Small valid files of every format that Intaglio reads: what `fuzzing` spoils."""

from __future__ import annotations

import json
import struct
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import test_camera_files as cameras
import test_images as images
import test_mesh_files as meshes
import test_point_files as points
import test_texture_files as textures
import tifffile
from PIL import Image, ImageCms
from stacks import dome, lambertian, noisy, scattered, write_capture

import intaglio
from intaglio.files import write_samples

SIZE = (12, 14)
COLOR = np.random.default_rng(17).integers(0, 256, (*SIZE, 3), np.uint8)
GRAY = COLOR[..., 0]
DEEP = COLOR.astype(np.uint16) * 257


@dataclass(frozen=True)
class Seed:
    """Files of which one, or their folder (``"."``), is given to each of some targets."""

    name: str
    files: dict[str, bytes]
    entry: str
    targets: tuple[str, ...]


SURFACES = ("read_surface", "read_mesh_file", "info")
TEXTURED = (*SURFACES, "read_uv_mesh")
CLOUDS = ("read_point_file", "read_surface_of_points", "read_geometry_texture", "info")
IMAGES = ("read_image", "read_samples", "read_mask", "info")
CAMERAS = ("read_photographs",)
STACKS = ("read_stack", "info")
LIGHTS = ("read_light_positions", "read_stack", "info")
TEXTURES = ("read_relightable", "info")


def make_seeds() -> list[Seed]:
    """Make all of them; the same ones at every call."""
    found = []
    for makers, targets in (
        (SURFACE_MAKERS, SURFACES),
        (CLOUD_MAKERS, CLOUDS),
        (IMAGE_MAKERS, IMAGES),
        (CAMERA_MAKERS, CAMERAS),
        (STACK_MAKERS, STACKS),
        (TEXTURE_MAKERS, TEXTURES),
        (OTHER_MAKERS, ()),
    ):
        for name, make in makers.items():
            with tempfile.TemporaryDirectory() as place:
                folder = Path(place)
                entry, *own = make(folder)
                files = {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
            found.append(Seed(name, files, entry, tuple(own[0]) if own else targets))
    return found


# Surfaces


def sheet(holed: bool = True) -> intaglio.Surface:
    """Return a wavy sheet of 9 x 9 points with a hole."""
    x, y = np.meshgrid(np.arange(9.0), np.arange(9.0))
    z = np.sin(x) / 4 + np.cos(y) / 5
    grid = np.stack([x, y, z], axis=-1)
    if holed:
        grid[3:5, 4:6] = np.nan
    return intaglio.surface_from_range_image(grid, view=(4, 4, 100))


def put(folder: Path, name: str, content: str | bytes) -> tuple[str]:
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return (name,)


def ply_of_polygons(order: str, folder: Path):
    return put(folder, "a.ply", meshes.ply(order, [(0, 1, 2, 3), (1, 4, 2), (0, 1)], strips=[(0, 1, 3, 2, -1, 1, 4, 2)]))


def ply_of_colors(order: str, folder: Path):
    """Vertices with normals, colours and texture coordinates, faces with coordinates at corners and numbers of pictures."""
    scan = sheet()
    kinds = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
    head = f"ply\nformat {order} 1.0\ncomment TextureFile wall.png\nelement vertex {len(scan.vertices)}\n"
    head += "".join(f"property float {n}\n" for n in ("x", "y", "z", "nx", "ny", "nz"))
    head += "".join(f"property uchar {n}\n" for n in ("red", "green", "blue"))
    head += f"element face {len(scan.faces)}\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n"
    head += "property int texnumber\nend_header\n"
    rows = np.column_stack([scan.vertices, scan.normal])
    if order == "ascii":
        body = "".join(" ".join(f"{v:.6g}" for v in row) + f" {k} 128 9\n" for k, row in enumerate(rows))
        body += "".join(f"3 {a} {b} {c} 6 0 0 1 0 1 1 0\n" for a, b, c in scan.faces)
        content = (head + body).encode()
    else:
        mark = kinds[order]
        data = b"".join(struct.pack(f"{mark}6f3B", *row, k, 128, 9) for k, row in enumerate(rows))
        data += b"".join(struct.pack(f"{mark}B3iB6fi", 3, *face, 6, 0, 0, 1, 0, 1, 1, 0) for face in scan.faces)
        content = head.encode() + data
    put(folder, "wall.png", meshes.png())
    put(folder, "a.ply", content)
    return "a.ply", TEXTURED


def ply_of_range_grid(folder: Path):
    scan = sheet(holed=False)
    head = "ply\nformat ascii 1.0\nobj_info num_cols 9\nobj_info num_rows 9\nelement vertex 81\n"
    head += "".join(f"property float {n}\n" for n in "xyz")
    head += "element range_grid 81\nproperty list uchar int vertex_indices\nend_header\n"
    body = "".join(" ".join(f"{v:.6g}" for v in row) + "\n" for row in scan.vertices)
    return put(folder, "a.ply", head + body + "".join("0\n" if k in (40, 41) else f"1 {k}\n" for k in range(81)))


def own_ply(folder: Path, base: intaglio.Base | None = None):
    """Provenance, base and model as Intaglio writes them."""
    scan = sheet(holed=False)
    measured = np.arange(81) % 9 > 2
    source = np.where(measured, np.arange(81), np.where(np.arange(81) % 9 == 0, -1, 40))
    foot = scan.vertices * (1, 1, 0)
    whole = intaglio.Surface(
        vertices=scan.vertices,
        base=foot,
        normal=np.tile([0.0, 0, 1], (81, 1)),
        faces=scan.faces,
        color=np.linspace(0, 1, 243, dtype=np.float32).reshape(81, 3),
        measured=measured,
        source=source.astype(np.int32),
        model=intaglio.Plane(point=np.zeros(3), normal=np.array([0, 0, 1.0])) if base is None else base,
        notes=("base as given", "42 % filled"),
    )
    whole.write(folder / "own.ply")
    return ("own.ply",)


def own_ply_on_a_smooth_base(folder: Path):
    from intaglio.mesh import SmoothBase

    scan = sheet(holed=False)
    up = np.tile([0.0, 0, 1], (81, 1))
    return own_ply(folder, SmoothBase(vertices=scan.vertices * (1, 1, 0), faces=scan.faces, normals=up, relief_scale=2.0))


def written(name: str, folder: Path):
    sheet().write(folder / name)
    # Sampling a mesh takes seconds.
    return name, (*SURFACES, "read_geometry_texture") if name == "a.off" else SURFACES


def textured(name: str, folder: Path):
    meshes.textured().write(folder / name)
    return name, TEXTURED


def obj(folder: Path):
    (folder / "textures").mkdir()
    put(folder, "textures/Red Wall.png", meshes.png())
    put(folder, "My Materials.MTL", "newmtl red\nKd 0.5 0.4 0.3\nmap_Kd -s 1 1 1 textures\\Red Wall.png\n")
    put(folder, "a.obj", meshes.OBJ)
    return "a.obj", TEXTURED


def text_stl(folder: Path):
    scan = sheet()
    facets = "".join(
        "facet normal 0 0 1\nouter loop\n" + "".join(f"vertex {x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in c) + "endloop\nendfacet\n"
        for c in scan.vertices[scan.faces]
    )
    return put(folder, "a.stl", f"solid a\n{facets}endsolid a\n")


def colored_off(folder: Path):
    text = "COFF # colours\n5 2 0\n" + "".join(f"{x} {y} {z} 255 0 0 255\n" for x, y, z in meshes.CORNERS)
    return put(folder, "a.off", text + "4 0 1 2 3\n3 1 4 2 0.1 0.2 0.3\n")


def gltf(folder: Path):
    meshes.gltf(folder / "a.gltf")
    return "a.gltf", TEXTURED


def gltf_of_parts(folder: Path):
    """Nodes with matrices and rotations, sparse values, strips, normalised colours, an interleaved view, data in the text."""

    def change(document):
        document["nodes"] = [{"children": [1, 2]}, {"mesh": 0, "matrix": np.eye(4).ravel().tolist()}, {"mesh": 1}]
        document["nodes"][2] |= {"rotation": [0, 0, 0.6, 0.8], "scale": [1, 2, 1], "translation": [0, 0, 3]}
        document["meshes"].append({"primitives": [{"attributes": {"POSITION": 0}, "indices": 2, "mode": 5}]})
        document["accessors"][0]["sparse"] = {
            "count": 2,
            "indices": {"bufferView": 2, "componentType": 5123},
            "values": {"bufferView": 0},
        }
        document["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 0.5, 0.5, 1]
        document["bufferViews"][0]["byteStride"] = 12

    meshes.gltf(folder / "b.gltf", change)
    return "b.gltf", TEXTURED


SURFACE_MAKERS: dict[str, Callable] = {
    **{f"ply of polygons, {order or 'ascii'}": partial(ply_of_polygons, order) for order in ("", "<", ">")},
    **{f"ply of colours, {k}": partial(ply_of_colors, k) for k in ("ascii", "binary_little_endian", "binary_big_endian")},
    "ply of a range grid": ply_of_range_grid,
    "own ply": own_ply,
    "own ply on a smooth base": own_ply_on_a_smooth_base,
    **{f"written {suffix}": partial(written, f"a{suffix}") for suffix in (".ply", ".obj", ".stl", ".off", ".gltf", ".glb")},
    **{f"textured {suffix}": partial(textured, f"a{suffix}") for suffix in (".ply", ".obj", ".gltf", ".glb")},
    "obj": obj,
    "text stl": text_stl,
    "coloured off": colored_off,
    "gltf": gltf,
    "gltf of parts": gltf_of_parts,
}


# Points


def swatch() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points of a wavy sheet, their colours and normals."""
    x, y = np.meshgrid(np.arange(9.0), np.arange(8.0))
    xyz = np.stack([x, y, np.sin(x) / 4 + np.cos(y) / 5], axis=-1).reshape(-1, 3)
    normals = np.stack([-np.cos(x) / 4, np.sin(y) / 5, np.ones_like(x)], axis=-1).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.round(xyz * 1024) / 1024, np.random.default_rng(17).integers(0, 256, xyz.shape), normals


def las(name: str, form: int, folder: Path):
    xyz, color, _ = swatch()
    points.write_las(folder / name, xyz, color if form in (2, 3, 7) else None, form, intensity=np.arange(len(xyz)))
    return (name,)


def e57(folder: Path):
    xyz, color, _ = swatch()
    fields = {f"color{n}": color[:, k].astype(np.uint8) for k, n in enumerate(("Red", "Green", "Blue"))}
    fields |= {"intensity": np.linspace(0, 1, len(xyz), dtype=np.float32), "cartesianInvalidState": np.zeros(len(xyz), np.int8)}
    turn = points.turned((1, 2, 3), 0.7)[1]
    scans = [(xyz, np.array([1.0, 0, 0, 0]), np.array([0, 0, 9.0]), fields), (xyz + 9, turn, np.array([1, 2, 3.0]), {})]
    points.write_e57(folder / "a.e57", scans)
    return ("a.e57",)


def pcd(kind: str, packed: str, folder: Path):
    xyz, color, normals = swatch()
    height = 8 if kind == "binary" else 1
    points.write_pcd(folder / "a.pcd", kind, xyz, color, normals.astype(np.float32), (4, 4, 30), packed, height)
    return ("a.pcd",)


def ptx(folder: Path):
    xyz, color, _ = swatch()
    cells = np.column_stack([np.linspace(0, 1, len(xyz)).round(3), color])
    turn, _ = points.turned((0, 0, 1), 0.5)
    points.write_ptx(folder / "a.ptx", [(xyz, turn, np.array([1, 2, 30.0]), 9, cells), (xyz, np.eye(3), np.zeros(3), 9, cells)])
    return ("a.ptx",)


def table(name: str, folder: Path):
    xyz, color, normals = swatch()
    text = {
        "a.xyz": points.rows(xyz),
        "b.xyz": "// X Y Z Nx Ny Nz\n" + points.rows(xyz, normals),
        "a.pts": f"{len(xyz)}\n" + points.rows(xyz, np.arange(len(xyz)) - 40, color),
        "a.csv": "x,y,z,red,green,blue,intensity\n" + points.rows(xyz, color, np.arange(len(xyz))).replace(" ", ","),
        "a.txt": points.rows(xyz, color).replace(" ", "; "),
        "a.asc": points.rows(xyz).replace(".", ","),
    }[name]
    return put(folder, name, text)


def ply_of_points(order: str, folder: Path):
    xyz, color, normals = swatch()
    names = [*"xyz", "nx", "ny", "nz", "red", "green", "blue", "intensity"]
    head = f"ply\nformat {order} 1.0\nelement vertex {len(xyz)}\n"
    head += "".join(f"property double {n}\n" for n in names) + "end_header\n"
    values = np.column_stack([xyz, normals, color / 255, np.arange(len(xyz))])
    body = points.rows(values).encode() if order == "ascii" else values.astype("<f8" if "little" in order else ">f8").tobytes()
    return put(folder, "a.ply", head.encode() + body)


def obj_of_points(folder: Path):
    xyz, _, normals = swatch()
    lines = points.rows(xyz, np.ones_like(xyz)).splitlines()
    return put(folder, "a.obj", "".join(f"v {line}\n" for line in lines) + "".join(f"vn {n[0]} {n[1]} {n[2]}\n" for n in normals))


def own_points(folder: Path):
    """Points of Intaglio's own, with where they come from."""
    xyz, color, normals = swatch()
    made = intaglio.PointSet(
        points=xyz, normals=normals, source=np.arange(len(xyz), dtype=np.int32), color=(color / 255).astype(np.float32)
    )
    intaglio.write_points(made, folder / "own.ply")
    return ("own.ply",)


CLOUD_MAKERS: dict[str, Callable] = {
    "las": partial(las, "a.las", 7),
    "las of 1.2": partial(las, "a.las", 2),
    "las without colours": partial(las, "a.las", 0),
    "laz": partial(las, "a.laz", 7),
    "laz of 1.2": partial(las, "a.laz", 3),
    "e57": e57,
    **{f"pcd, {kind}": partial(pcd, kind, "F") for kind in ("ascii", "binary", "binary_compressed")},
    "pcd of whole colours": partial(pcd, "ascii", "U"),
    "ptx": ptx,
    **{f"table {name}": partial(table, name) for name in ("a.xyz", "b.xyz", "a.pts", "a.csv", "a.txt", "a.asc")},
    **{f"ply of points, {k}": partial(ply_of_points, k) for k in ("ascii", "binary_little_endian", "binary_big_endian")},
    "obj of points": obj_of_points,
    "own points": own_points,
}


# Images


def by_pillow(name: str, mode: str, options: dict, folder: Path):
    image = Image.fromarray(COLOR).convert("RGBA")
    image.putalpha(Image.fromarray(GRAY))
    image = image.convert("RGB").quantize(16) if mode == "P" else image.convert(mode)
    if options.pop("orientation", False):
        exif = Image.Exif()
        exif[0x0112] = 6
        options["exif"] = exif
    if options.pop("profile", False):
        options["icc_profile"] = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    image.save(folder / name, **options)
    return (name,)


def by_samples(name: str, values: np.ndarray, folder: Path):
    write_samples(values, folder / name)
    return (name,)


def tiff(values: np.ndarray, options: dict, folder: Path):
    tifffile.imwrite(folder / "a.tif", values, **options)
    return ("a.tif",)


def lzw_tiff(kind: str, predictor: int, layout: str, order: str, folder: Path):
    values = (COLOR / (1 if kind == "u1" else 255)).astype(kind)
    images.write_lzw(folder / "a.tif", values, predictor, layout, order)
    return ("a.tif",)


def radiance(flat: bool, folder: Path):
    return put(folder, "a.hdr", images.radiance(COLOR.astype(np.float64) / 99, flat=flat))


def dng(folder: Path):
    images.write_dng(folder / "a.dng", np.full((32, 48, 3), (0.1, 0.4, 0.05)))
    return ("a.dng",)


def exr(names: tuple[str, ...], folder: Path):
    intaglio.write_exr({n: GRAY / 255.0 + k for k, n in enumerate(names)}, folder / "a.exr", metadata={"unit": "mm"})
    return "a.exr", (*IMAGES, "read_exr")


def exr_of_parts(compression: str, folder: Path):
    import OpenEXR

    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION"), "type": OpenEXR.scanlineimage}
    half = (GRAY / 255.0).astype(np.float16)
    parts = [
        OpenEXR.Part({**header, "name": "left"}, dict.fromkeys("RGB", half)),
        OpenEXR.Part({**header, "name": "right"}, {"Y": half.astype(np.float32), "id": GRAY.astype(np.uint32)}),
    ]
    with OpenEXR.File(parts) as file:
        file.write(str(folder / "a.exr"))
    return "a.exr", (*IMAGES, "read_exr")


def tiled_exr(folder: Path):
    import OpenEXR

    header = {
        "compression": OpenEXR.PIZ_COMPRESSION,
        "type": OpenEXR.tiledimage,
        "tiles": OpenEXR.TileDescription(),
    }
    with OpenEXR.File(header, {"RGBA": (np.dstack([COLOR, GRAY]) / 255.0).astype(np.float16)}) as file:
        file.write(str(folder / "a.exr"))
    return "a.exr", (*IMAGES, "read_exr")


IMAGE_MAKERS: dict[str, Callable] = {
    **{f"png {mode}": partial(by_pillow, "a.png", mode, {}) for mode in ("L", "LA", "RGB", "RGBA", "1", "P")},
    "png with a profile": lambda f: by_pillow("a.png", "RGB", {"profile": True, "orientation": True}, f),
    "png of 16 bits": partial(by_samples, "a.png", DEEP),
    "grey png of 16 bits": partial(by_samples, "a.png", DEEP[..., 0]),
    **{f"jpeg {mode}": partial(by_pillow, "a.jpg", mode, {}) for mode in ("L", "RGB", "CMYK")},
    "jpeg with a profile": lambda f: by_pillow("a.jpg", "RGB", {"profile": True, "orientation": True}, f),
    "progressive jpeg": partial(by_pillow, "a.jpeg", "RGB", {"progressive": True}),
    "bmp": partial(by_pillow, "a.bmp", "RGB", {}),
    "bmp with a palette": partial(by_pillow, "a.bmp", "P", {}),
    "tga": partial(by_pillow, "a.tga", "RGBA", {}),
    "packed tga": partial(by_pillow, "a.tga", "RGB", {"compression": "tga_rle"}),
    "tga with a palette": partial(by_pillow, "a.tga", "P", {}),
    "webp": partial(by_pillow, "a.webp", "RGBA", {"lossless": True}),
    "lossy webp": partial(by_pillow, "a.webp", "RGB", {}),
    "jpeg 2000": partial(by_pillow, "a.jp2", "RGB", {}),
    "tiff": partial(tiff, COLOR, {"photometric": "rgb"}),
    "tiff of 16 bits": partial(tiff, DEEP, {"photometric": "rgb", "compression": "zlib", "predictor": True}),
    "tiff of floats": partial(tiff, COLOR.astype(np.float32) / 255, {"photometric": "rgb"}),
    "tiff of doubles": partial(tiff, GRAY.astype(np.float64), {}),
    "tiff of tiles": partial(tiff, np.pad(GRAY, 10), {"tile": (16, 16), "compression": "zlib"}),
    "tiff of pages": partial(tiff, np.stack([GRAY, GRAY]), {"photometric": "minisblack"}),
    "tiff of packbits": partial(by_pillow, "a.tif", "RGB", {"compression": "packbits"}),
    "tiff of a jpeg": partial(by_pillow, "a.tiff", "RGB", {"compression": "jpeg"}),
    "tiff with a palette": partial(by_pillow, "a.tif", "P", {}),
    "tiff of bits": partial(by_pillow, "a.tif", "1", {"compression": "group4"}),
    **{
        f"lzw tiff, {kind} {layout}": partial(lzw_tiff, kind, predictor, layout, order)
        for kind, predictor, layout, order in (("u1", 2, "strips", "<"), ("u2", 2, "tiles", ">"), ("f4", 3, "planes", "<"))
    },
    "hdr": partial(radiance, False),
    "flat hdr": partial(radiance, True),
    "dng": dng,
    "exr": partial(exr, ("R", "G", "B")),
    "grey exr": partial(exr, ("Y",)),
    "exr of layers": partial(exr, ("a.R", "a.G", "a.B", "height")),
    **{f"exr of parts, {c}": partial(exr_of_parts, c) for c in ("NO", "RLE", "ZIPS", "PIZ")},
    "tiled exr": tiled_exr,
}


# Cameras


def camera_folder(write: Callable, folder: Path):
    for name in ("a.png", "b.png"):
        intaglio.write_image(np.random.default_rng(5).random((48, 64)).round(1), folder / name)
    return (write(folder)[0],)


def colmap(kind: str, folder: Path):
    lens = cameras.LENS
    params = [80.0, 81.0, 31.0, 24.5, *lens[:2], *lens[4:]]
    turn = [0.9, 0.1, -0.3, 0.2]
    names = ("a.png", "b.png")
    if kind == "text":
        put(
            folder, "cameras.txt", f"# cameras\n1 OPENCV 64 48 {' '.join(map(str, params))}\n2 SIMPLE_RADIAL 64 48 80 32 24 0.1\n"
        )
        lines = [f"{k} {' '.join(map(str, turn))} 0 0 5 {k} {n}\n1.5 2.5 -1 3 4 7\n" for k, n in enumerate(names, 1)]
        put(folder, "images.txt", "".join(lines))
    else:
        data = struct.pack("<QIiQQ8d", 2, 1, 4, 64, 48, *params) + struct.pack("<IiQQ4d", 2, 2, 64, 48, 80, 32, 24, 0.1)
        put(folder, "cameras.bin", data)
        data = struct.pack("<Q", 2)
        for k, name in enumerate(names, 1):
            data += struct.pack("<I7dI", k, *turn, 0, 0, 5, k) + name.encode() + b"\0" + struct.pack("<Qddq", 1, 1.5, 2.5, -1)
        put(folder, "images.bin", data)
    return ".", CAMERAS


def middlebury(folder: Path):
    numbers = [*cameras.camera().K.ravel(), *cameras.TURN.ravel(), *cameras.SHIFT]
    put(folder, "scene_par.txt", f"2\na.png {' '.join(map(str, numbers))}\nb.png {' '.join(map(str, numbers))}\n")
    return ("scene_par.txt",)


CAMERA_MAKERS: dict[str, Callable] = {
    **{f"cameras, {write.__name__}": partial(camera_folder, write) for write in cameras.WRITERS},
    "cameras, colmap": lambda f: (camera_folder(lambda _: "."[:1], f), colmap("binary", f))[1],
    "cameras, colmap's text": lambda f: (camera_folder(lambda _: "."[:1], f), colmap("text", f))[1],
    "cameras, middlebury": lambda f: (camera_folder(lambda _: "."[:1], f), middlebury(f))[1],
}


# Captures


def capture(suffix: str, folder: Path):
    write_capture(folder, lambertian(scattered(6), *SIZE), suffix)
    return "capture.lp", LIGHTS


def capture_with_more(folder: Path):
    """Intensities and a mask beside the photographs."""
    write_capture(folder, lambertian(scattered(6), *SIZE), ".png")
    put(folder, "light_intensities.txt", "1 1 1\n0.9 1 1.1\n1 1 1\n1 1 1\n1 0.5 1\n1 1 1\n")
    intaglio.write_image(np.pad(np.ones((8, 10)), 2), folder / "mask.png")
    return "capture.lp", STACKS


def lights_csv(folder: Path):
    write_capture(folder, lambertian(dome(5, (30, 60)), *SIZE), ".png")
    (folder / "capture.lp").unlink()
    lines = [f"image_{k}.png;{tilt};{slant}" for k, (slant, tilt) in enumerate((s, 72 * t) for s in (30, 60) for t in range(5))]
    put(folder, "lights.csv", "image;tilt;slant\n" + "\n".join(lines) + "\n")
    return ("lights.csv",)


def light_directions(folder: Path):
    lights = scattered(6)
    write_capture(folder, lambertian(lights, *SIZE), ".png")
    (folder / "capture.lp").unlink()
    put(folder, "light_directions.txt", points.rows(lights))
    return (".",)


STACK_MAKERS: dict[str, Callable] = {
    **{f"capture, {suffix}": partial(capture, suffix) for suffix in (".png", ".jpg", ".exr", ".tif")},
    "capture with intensities": capture_with_more,
    "lights.csv": lights_csv,
    "light_directions.txt": light_directions,
}


# Textures


def own_texture(kind: str, folder: Path, color: str = "channels"):
    stack = noisy(dome(5, (20, 60)) if kind in ("eigen3", "rbf") else scattered(9), channels=3, height=6, width=7)
    intaglio.write_relightable(intaglio.represent(stack, kind, color=color), folder / "t.exr")
    return ("t.exr",)


def ptm(color: str, folder: Path):
    texture = intaglio.represent(noisy(scattered(9), channels=3, height=6, width=7), "ptm", color=color)
    intaglio.write_relightable(texture, folder / "t.ptm")
    return ("t.ptm",)


def jpeg_ptm(count: int, folder: Path):
    column = np.mgrid[:8, :9][1]
    planes = np.stack([60 + 3 * column + 5 * i for i in range(count)]).astype(np.uint8)
    reference = [-1] * count if count == 18 else [-1, 2, 0, -1, -1, -1, -1, 6, 7]
    order = [0, 2, 1, 3, 4, 5, 6, 7, 8] if count == 9 else range(18)
    side = [[] if k != 5 else [(3 * 9 + 7, 222)] for k in range(count)]
    transforms = [k % 2 for k in range(count)] if count == 9 else [0] * 18
    textures.jpeg_ptm(folder / "t.ptm", planes, order=order, reference=reference, transforms=transforms, side=side)
    return ("t.ptm",)


TEXTURE_MAKERS: dict[str, Callable] = {
    **{f"texture, {kind}": partial(own_texture, kind) for kind in intaglio.photometric.KINDS},
    "texture of luminance": partial(own_texture, "ptm", color="luminance"),
    "ptm of rgb": partial(ptm, "channels"),
    "ptm of lrgb": partial(ptm, "luminance"),
    "ptm of jpeg rgb": partial(jpeg_ptm, 18),
    "ptm of jpeg lrgb": partial(jpeg_ptm, 9),
}


# What else is read


def material(folder: Path):
    normal = np.dstack([GRAY // 8 + 112, GRAY // 8 + 112, np.full(SIZE, 250)]).astype(np.uint8)
    for name, values in {"w_1K_Color.png": COLOR, "w_1K_NormalDX.png": normal, "w_1K_Rough.jpg": GRAY}.items():
        Image.fromarray(values).save(folder / name)
    write_samples(DEEP[..., 0], folder / "w_1K_Height.tif")
    intaglio.write_exr({"Y": GRAY.astype(np.float32)}, folder / "w_1K_Bump.exr")
    return ".", ("read_material", "info")


def ranks(folder: Path):
    put(folder, "ranks.csv", "observer,quilt,grow,tile\nAnna,1,2,3\nBen,2,1,3\nCleo,1.5,1.5,3\n")
    return "ranks.csv", ("read_ranks",)


def trials(folder: Path):
    for texture in ("wood", "stone"):
        (folder / texture).mkdir()
        for name in ("sample", "quilt", "grow", "tile"):
            Image.fromarray(COLOR).save(folder / texture / f"{name}.png")
    return ".", ("read_trials",)


def description(folder: Path):
    """A list of views of our own, with all that it may hold."""
    camera_folder(cameras.own, folder)
    data = json.loads((folder / "views.json").read_text())
    put(folder, "views.json", json.dumps({"front": {**data[0], "present": True}, "b.png": {**data[0], "image": "b.png"}}))
    return "views.json", CAMERAS


OTHER_MAKERS: dict[str, Callable] = {
    "material": material,
    "ranks": ranks,
    "trials": trials,
    "cameras, views by name": description,
}
