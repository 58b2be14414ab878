"""Points of laser scanners: LAS, LAZ and COPC through laspy and lazrs, E57 through pye57 (the extra `points`)."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError, IntaglioError
from intaglio.files import check_memory, hushed_streams
from intaglio.mesh.point_cloud import PointFile, colors_from, colors_of_words, named, plain

# Points that are decoded at once, and bytes that a point takes while it is read.
_CHUNK, _PER_POINT = 1_000_000, 200
# More compressed points than this on a byte are no scan.
_DENSEST = 64
# Layers of LAZ's items in point formats from 6 on; extra bytes have one each.
_LAYERS, _EXTRA_BYTES = {10: 9, 11: 1, 12: 2, 13: 1}, 14
# A number of points a chunk that says that the table of chunks has it.
_CHUNKS_DIFFER = 0xFFFFFFFF
# Classes of noise in LAS, low and high.
_NOISE = (7, 18)
_LAS_NORMALS = (("normalx", "normaly", "normalz"), ("nx", "ny", "nz"))


def _extra(path: Path, what: str, packages: str, problem: ImportError) -> FileError:
    return FileError(
        f"{path}: reading {what} needs {packages} ({plain(problem)}); install it with: pip install 'intaglio[points]'"
    )


def read_las(path: Path) -> PointFile:
    """Read a .las or .laz file, COPC too; withheld points and noise are left out.

    Raises
    ------
    FileError
        If laspy or lazrs is missing, or the file is damaged or holds fewer points than its header declares.
    """
    try:
        import laspy
        import lazrs
    except ImportError as problem:
        raise _extra(path, "LAS and LAZ", "laspy and lazrs", problem) from problem
    _check_las(path)
    parts: list[dict[str, Array]] = []
    try:
        # A panic in lazrs is written to the process's errors before it is raised.
        with hushed_streams(), laspy.open(path, read_evlrs=False) as file:
            count = file.header.point_count
            if file.header.are_points_compressed:
                _check_chunks(lazrs, path, file.header)
            fields = _las_fields(file.header.point_format)
            for chunk in file.chunk_iterator(_CHUNK):
                parts.append(_las_columns(chunk, fields))
    except (KeyboardInterrupt, SystemExit, MemoryError, IntaglioError):
        raise
    except BaseException as problem:  # a panic is no Exception
        raise FileError(f"{path}: can't be read as {path.suffix[1:].upper()} ({plain(problem)})") from problem
    columns = {name: np.concatenate([part[name] for part in parts]) for name in fields} if parts else {}
    found = len(columns["points"]) if columns else 0
    if found < count:
        raise FileError(f"{path}: its header declares {count} points, but it holds {found}: the file is cut off")
    if not found:
        raise InputError("holds no points")
    return _las_points(columns)


def _check_las(path: Path) -> None:
    """Raise `FileError` unless the header's counts and places agree with the file's size, before anything is allocated."""
    size = path.stat().st_size
    with open(path, "rb") as file:
        head = file.read(375)
    if head[:4] != b"LASF" or len(head) < 227:
        raise FileError(f"{path}: is named {path.suffix}, but its content is not LAS")
    minor = head[25]
    header_size, data, vlrs = struct.unpack_from("<HII", head, 94)
    record = struct.unpack_from("<H", head, 105)[0]
    count = struct.unpack_from("<I", head, 107)[0]
    if minor >= 4 and len(head) >= 255:
        count = struct.unpack_from("<Q", head, 247)[0]
    if head[24] != 1 or header_size > data or data > size or vlrs * 54 > data - header_size or record == 0:
        raise FileError(f"{path}: its header is damaged: its points begin at byte {data} of {size}, after {vlrs} records")
    # The two highest bits of the format mark compressed points, eight bytes of which say where the table of chunks lies.
    compressed = bool(head[104] & 0xC0)
    held = size - data
    if count > (held * _DENSEST if compressed else held // record):
        raise FileError(f"{path}: its header declares {count} points, but {held} bytes follow it: the file is cut off")
    check_memory(path, count * _PER_POINT, f"a cloud of {count} points")
    if compressed:
        _check_chunk_table(path, data, size)


def _check_chunks(lazrs: Any, path: Path, header: Any) -> None:
    """Raise `FileError` unless compressed chunks, and the layers of each, lie in the file: room is made for what they declare."""
    record = bytes(header.vlrs.get("LasZipVlr")[0].record_data)
    first, size = header.offset_to_point_data, path.stat().st_size
    many = int.from_bytes(record[12:16], "little")
    if many != _CHUNKS_DIFFER:
        # Room for one is made at once.
        check_memory(path, many, f"a compressed chunk of {many} points")
    layers, point = 0, 0
    for kind, wide, _ in struct.iter_unpack("<HHH", record[34 : 34 + 6 * struct.unpack_from("<H", record, 32)[0]]):
        layers += wide if kind == _EXTRA_BYTES else _LAYERS.get(kind, 0)
        point += wide
    with open(path, "rb") as file:
        file.seek(first)
        chunks = lazrs.read_chunk_table(file, lazrs.LazVlr(record))
        place = first + 8
        for _, held in chunks:
            if held > size - place:
                raise FileError(
                    f"{path}: a compressed chunk of {held} bytes reaches beyond its end: the file is cut off or damaged"
                )
            file.seek(place + point + 4)
            sizes = np.frombuffer(file.read(4 * layers), "<u4")
            if int(sizes.sum(dtype=np.int64)) > held:
                raise FileError(f"{path}: a compressed chunk of {held} bytes declares larger layers: the file is damaged")
            place += held


def _check_chunk_table(path: Path, data: int, size: int) -> None:
    """Raise `FileError` unless the table of compressed chunks lies in the file and has no more entries than it has bytes."""
    with open(path, "rb") as file:
        file.seek(data)
        place = int.from_bytes(file.read(8), "little", signed=True)
        if place == -1:
            file.seek(size - 8)
            place = int.from_bytes(file.read(8), "little", signed=True)
        if not data <= place <= size - 8:
            raise FileError(f"{path}: its table of compressed chunks lies outside of it: the file is cut off or damaged")
        file.seek(place + 4)
        chunks = int.from_bytes(file.read(4), "little")
    if chunks > size - data:
        raise FileError(f"{path}: its table lists {chunks} compressed chunks, more than it has bytes: the file is damaged")


def _las_fields(form: Any) -> dict[str, tuple[str, ...]]:
    """Return what is read of each point, and the names of its dimensions."""
    names = set(form.dimension_names)
    extra = {"".join(c for c in name.lower() if c.isalpha()): name for name in form.extra_dimension_names}
    fields: dict[str, tuple[str, ...]] = {"points": ("x", "y", "z")}
    if {"red", "green", "blue"} <= names:
        fields["color"] = ("red", "green", "blue")
    for name in ("intensity", "classification", "withheld"):
        if name in names:
            fields[name] = (name,)
    for triple in _LAS_NORMALS:
        if set(triple) <= set(extra):
            fields["normals"] = tuple(extra[name] for name in triple)
    return fields


def _las_columns(chunk: Any, fields: dict[str, tuple[str, ...]]) -> dict[str, Array]:
    columns = {name: np.stack([np.asarray(chunk[d]) for d in dimensions], axis=1) for name, dimensions in fields.items()}
    return {name: value if value.shape[1] > 1 else value[:, 0] for name, value in columns.items()}


def _las_points(columns: dict[str, Array]) -> PointFile:
    count = len(columns["points"])
    out = columns.get("withheld", np.zeros(count)).astype(bool)
    notes = [f"{named(int(out.sum()), 'point')} marked as withheld left out"] if out.any() else []
    noise = np.isin(columns.get("classification", np.zeros(count)), _NOISE) & ~out
    if noise.any():
        notes.append(f"{named(int(noise.sum()), 'point')} classified as noise left out")
    columns = {name: value[~(out | noise)] for name, value in columns.items()}
    color = None
    if "color" in columns:
        color, note = colors_of_words(columns["color"])
        notes += [note] if note else []
    return PointFile(
        points=np.ascontiguousarray(columns["points"], np.float64),
        normals=np.ascontiguousarray(columns["normals"], np.float64) if "normals" in columns else None,
        color=color,
        intensity=columns["intensity"].astype(np.float32) if "intensity" in columns else None,
        notes=tuple(notes),
    )


def read_e57(path: Path) -> PointFile:
    """Read all scans of an .e57 file, each by its pose; points marked as invalid are left out.

    Raises
    ------
    FileError
        If pye57 is missing, or the file is damaged.
    """
    try:
        from pye57 import libe57
    except ImportError as problem:
        raise _extra(path, "E57", "pye57", problem) from problem
    with open(path, "rb") as opened:
        if opened.read(8) != b"ASTM-E57":
            raise FileError(f"{path}: is named .e57, but its content is not E57")
    scans: list[dict[str, Array]] = []
    notes: list[str] = []
    try:
        file = libe57.ImageFile(str(path), "r")
        try:
            root = file.root()
            listed = root["data3D"] if root.isDefined("data3D") else []
            for number in range(len(listed)):
                scans.append(_e57_scan(libe57, file, listed[number], path, number, notes))
        finally:
            file.close()
    except (MemoryError, IntaglioError):
        raise
    except Exception as problem:
        raise FileError(f"{path}: can't be read as E57 ({plain(problem)})") from problem
    scans = [scan for scan in scans if len(scan["points"])]
    if not scans:
        raise InputError("holds no points" + (f" ({notes[0]})" if notes else ""))

    def joined(name: str) -> Array | None:
        have = [scan for scan in scans if name in scan]
        if have and len(have) < len(scans):
            notes.append(f"{len(have)} of {len(scans)} scans have a {name}: it was left out")
        return np.concatenate([scan[name] for scan in scans]) if len(have) == len(scans) else None

    seen = all("stood" in scan for scan in scans)
    return PointFile(
        points=np.concatenate([scan["points"] for scan in scans]),
        normals=joined("normals"),
        color=joined("color"),
        intensity=joined("intensity"),
        viewpoints=np.stack([scan["stood"] for scan in scans]) if seen else None,
        scan=np.repeat(np.arange(len(scans), dtype=np.int32), [len(scan["points"]) for scan in scans]) if seen else None,
        notes=tuple(notes),
    )


def _e57_scan(libe57: Any, file: Any, node: Any, path: Path, number: int, notes: list[str]) -> dict[str, Array]:
    """Return points, colours and so on of one scan in the file's coordinates, and where the scanner stood."""
    cloud = node["points"]
    count = int(cloud.childCount())
    # A point has at least a bit.
    if count > 8 * path.stat().st_size:
        raise FileError(f"{path}: scan {number + 1} promises {count} points, more than the file has bits: it is damaged")
    check_memory(path, count * _PER_POINT, f"a scan of {count} points")
    form = libe57.StructureNode(cloud.prototype())
    names = [form.get(k).elementName() for k in range(form.childCount())]
    columns = _e57_columns(libe57, file, cloud, [n for n in names if _e57_wanted(n)], count)
    points, invalid = _e57_places(columns, path, number)
    out = invalid | ~points.any(axis=1)
    if out.any():
        notes.append(f"{named(int(out.sum()), 'reading')} of scan {number + 1} without a point")
    kept: dict[str, Array] = {"points": points[~out]}
    turn, stood = _e57_pose(node, path, number)
    kept["points"] = kept["points"] @ turn.T + stood
    if node.isDefined("pose"):
        kept["stood"] = stood
    if {"colorRed", "colorGreen", "colorBlue"} <= set(columns):
        levels = np.stack([columns[f"color{c}"] for c in ("Red", "Green", "Blue")], axis=1)[~out]
        kept["color"] = colors_from(levels, _e57_white(node, levels))
    if "intensity" in columns:
        kept["intensity"] = columns["intensity"][~out].astype(np.float32)
    normals = [f"nor:normal{axis}" for axis in "XYZ"]
    if set(normals) <= set(columns):
        kept["normals"] = np.stack([columns[n] for n in normals], axis=1)[~out] @ turn.T
    return kept


def _e57_wanted(name: str) -> bool:
    return name.startswith(("cartesian", "spherical", "color", "nor:normal")) or name == "intensity"


def _e57_columns(libe57: Any, file: Any, cloud: Any, names: list[str], count: int) -> dict[str, Array]:
    size = max(1, min(count, _CHUNK))
    held = {name: np.empty(size) for name in names}
    buffers = libe57.VectorSourceDestBuffer()
    for name in names:
        buffers.append(libe57.SourceDestBuffer(file, name, held[name], size, True, True))
    reader = cloud.reader(buffers)
    parts: list[dict[str, Array]] = []
    try:
        while found := int(reader.read()):
            parts.append({name: values[:found].copy() for name, values in held.items()})
    finally:
        reader.close()
    return {name: np.concatenate([np.zeros(0), *(part[name] for part in parts)]) for name in names}


def _e57_places(columns: dict[str, Array], path: Path, number: int) -> tuple[Array, Array]:
    """Return points (N, 3) in the scanner's coordinates, and which are marked as invalid."""
    if {"cartesianX", "cartesianY", "cartesianZ"} <= set(columns):
        points = np.stack([columns[f"cartesian{axis}"] for axis in "XYZ"], axis=1)
        state = columns.get("cartesianInvalidState")
    elif {"sphericalRange", "sphericalAzimuth", "sphericalElevation"} <= set(columns):
        away, around, up = (columns[f"spherical{name}"] for name in ("Range", "Azimuth", "Elevation"))
        points = away[:, None] * np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=1)
        state = columns.get("sphericalInvalidState")
    else:
        raise FileError(f"{path}: scan {number + 1} has neither cartesian nor spherical coordinates")
    return points, np.zeros(len(points), bool) if state is None else state != 0


def _e57_pose(node: Any, path: Path, number: int) -> tuple[Array, Array]:
    """Return the rotation matrix and translation of a scan."""
    if not node.isDefined("pose"):
        return np.eye(3), np.zeros(3)
    pose = node["pose"]

    def numbers(what: str, names: str, usual: tuple[float, ...]) -> Array:
        return np.array([pose[what][n].value() for n in names] if pose.isDefined(what) else usual, np.float64)

    w, x, y, z = turn = numbers("rotation", "wxyz", (1, 0, 0, 0))
    stood = numbers("translation", "xyz", (0, 0, 0))
    length = float(turn @ turn)
    if not np.isfinite(stood).all() or not 0 < length < np.inf:
        raise FileError(f"{path}: the pose of scan {number + 1} has no finite rotation and translation")
    s = 2 / length
    matrix = [
        [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
        [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
        [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
    ]
    return np.array(matrix), stood


def _e57_white(node: Any, levels: Array) -> float:
    """Return the level of white: 255 if all are under it, as a limit may be the brightest that was met, else the limit."""
    limits = node["colorLimits"] if node.isDefined("colorLimits") else None
    names = [f"color{c}Maximum" for c in ("Red", "Green", "Blue")]
    stated = [] if limits is None else [float(limits[name].value()) for name in names if limits.isDefined(name)]
    most = float(max([*stated, levels.max(initial=0)]))
    if most <= 1:
        return 1.0
    return 255.0 if most <= 255 else most if stated else max(most, 65535.0)
