"""Wavefront OBJ: vertices with or without colours, polygons, texture coordinates, and the pictures of its materials."""

from __future__ import annotations

import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError, InputError
from intaglio.files import check_memory, check_readable, note_input
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh.polygons import polygon_triangles
from intaglio.mesh.raw_mesh import RawMesh

# What begins the lines of a material that name pictures.
_MAPS = ("map_", "norm", "bump", "disp", "decal", "refl")
# Curves, patches and lines: what a surface of triangles has no use for.
_OTHER_SHAPES = (b"l", b"p", b"curv", b"curv2", b"surf", b"parm", b"trim", b"hole", b"cstype")


def read_obj(path: Path) -> RawMesh:
    """Read an OBJ file; all its objects and groups are one mesh.

    Raises
    ------
    FileError
        If it isn't text, or a line can't be understood.
    InputError
        If a face names a vertex that does not exist.
    """
    size = check_readable(path).stat().st_size
    check_memory(path, 8 * size, "its content")
    content = path.read_bytes().replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    if b"\0" in content[:4096]:
        raise FileError(f"{path}: is named .obj, but its content is not text")
    lines: dict[bytes, list[bytes]] = {b"v": [], b"vt": [], b"f": []}
    before: list[tuple[int, int]] = []
    material, materials, names, libraries = -1, [], [], []
    others: Counter[str] = Counter()
    points, coordinates, faces = (lines[k] for k in (b"v", b"vt", b"f"))
    for line in content.splitlines():
        # Most lines by far, without looking for more than they begin with.
        if line.startswith(b"v "):
            points.append(line[2:])
            continue
        parts = line.split(None, 1)
        if len(parts) < 2:
            continue
        word, rest = parts
        if word == b"v":
            points.append(rest)
        elif word == b"f":
            faces.append(rest)
            before.append((len(points), len(coordinates)))
            materials.append(material)
        elif word == b"vt":
            coordinates.append(rest)
        elif word == b"usemtl":
            name = rest.strip()
            if name not in names:
                names.append(name)
            material = names.index(name)
        elif word == b"mtllib":
            libraries.append(rest.decode("utf-8", "replace").strip())
        elif word in _OTHER_SHAPES:
            others[word.decode()] += 1
    if not points and not faces:
        raise FileError(f"{path}: holds no vertices; an .obj file has lines `v x y z`")
    vertices, color = _vertices(path, points)
    counts, numbers = _corners(path, faces)
    at = _resolved(path, numbers[:, 0], counts, [b[0] for b in before], len(points), "vertices")
    triangles = polygon_triangles(counts, at, vertices)
    uv = None
    if numbers.shape[1] > 1 and coordinates and numbers[:, 1].any():
        places = _table(path, coordinates, "vt", (1, 2, 3))
        places = np.pad(places, ((0, 1), (0, 1)), constant_values=np.nan)[:, :2]
        places[-1] = np.nan
        which = _resolved(path, numbers[:, 1], counts, [b[1] for b in before], len(coordinates), "texture coordinates", gaps=True)
        uv = places[which][triangles]
    notes = [f"{sum(others.values())} lines of curves, patches, lines or points left out"] if others else []
    pictures, of_material = _pictures(path, libraries, names, notes if uv is not None else [])
    face_of = np.repeat(np.arange(len(counts)), counts)[triangles[:, 0]] if len(triangles) else np.zeros(0, int)
    shown = np.array([of_material.get(m, -1) for m in materials] or [-1])[face_of] if len(faces) else None
    return RawMesh(
        vertices=vertices,
        faces=at[triangles],
        color=color,
        uv=uv,
        pictures=pictures if uv is not None else (),
        picture=shown,
        notes=tuple(notes),
    )


def _table(path: Path, rows: list[bytes], what: str, widths: tuple[int, ...]) -> Array:
    """Return lines of numbers as an array, padded with NaN to the longest."""
    text = b"\n".join(rows)
    values = _numbers(path, text, what)
    width, left = divmod(len(values), len(rows))
    # Lines with as many spaces as others, and nothing else between numbers, are all alike.
    alike = left == 0 and {row.count(b" ") for row in rows} == {width - 1} and not any(s in text for s in (b"\t", b"\v", b"\f"))
    lengths = {width} if alike else {len(row.split(b"#", 1)[0].split()) for row in rows}
    if left == 0 and lengths == {width} != {0}:
        table = values.reshape(-1, width)
    else:
        table = np.full((len(rows), max(lengths)), np.nan)
        for k, row in enumerate(rows):
            found = row.split(b"#", 1)[0].split()
            table[k, : len(found)] = [float(v) for v in found]
    if not widths[0] <= min(lengths) or max(lengths) > widths[-1]:
        raise FileError(
            f"{path}: a line `{what}` has {min(lengths) if min(lengths) < widths[0] else max(lengths)} numbers, "
            f"where {widths[0]} to {widths[-1]} belong"
        )
    return table


def _numbers(path: Path, text: bytes, what: str) -> Array:
    """Return the numbers of a text."""
    if b"#" in text:
        text = b"\n".join(line.split(b"#", 1)[0] for line in text.splitlines())
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text, np.float64, sep=" ") if text.strip() else np.zeros(0)
        except (DeprecationWarning, ValueError):
            pass
    for word in text.split():
        try:
            float(word)
        except ValueError:
            shown = word[:40].decode("utf-8", "replace")
            raise FileError(f"{path}: a line `{what}` has {shown!r} where a number is needed") from None
    raise FileError(f"{path}: a line `{what}` has something else than numbers")


def _vertices(path: Path, rows: list[bytes]) -> tuple[Array, Array | None]:
    """Return positions and linear colours of the lines `v x y z`, `v x y z w` or `v x y z r g b`."""
    if not rows:
        return np.zeros((0, 3)), None
    table = _table(path, rows, "v", (3, 4, 6, 7, 8))
    vertices = np.ascontiguousarray(table[:, :3])
    if table.shape[1] < 6:
        return vertices, None
    color = table[:, 3:6]
    finite = np.isfinite(color).all(axis=1)
    if not finite.any():
        return vertices, None
    # Most programs write colours from 0 to 1, some as bytes.
    scale = 255.0 if color[finite].max() > 1 else 1.0
    color = np.where(finite[:, None], np.clip(color / scale, 0, 1), np.nan)
    return vertices, decode_srgb(color.astype(np.float32))


def _corners(path: Path, rows: list[bytes]) -> tuple[Array, Array]:
    """Return how many corners every face has, and the numbers (K, 1 to 3) of all corners; 0 for one that is not given."""
    if not rows:
        return np.zeros(0, np.int64), np.zeros((0, 1), np.int64)
    if any(b"#" in row for row in rows):
        rows = [row.split(b"#", 1)[0] for row in rows]
    spaces, text = rows[0].count(b" "), b" ".join(rows)
    if {row.count(b" ") for row in rows} == {spaces}:
        # Where each corner has as many slashes as the first, and a space after it, all are alike.
        slashes = rows[0].split(b" ", 1)[0].count(b"/")
        letters = np.frombuffer(text + b" ", np.uint8)
        marks = letters[(letters == ord(" ")) | (letters == ord("/"))]
        expected = np.array([ord("/")] * slashes + [ord(" ")], np.uint8)
        if len(marks) == len(rows) * (spaces + 1) * len(expected) and (marks.reshape(-1, len(expected)) == expected).all():
            numbers = _numbers(path, text.replace(b"/", b" "), "f")
            if len(numbers) == len(marks) and slashes < 3:
                return np.full(len(rows), spaces + 1), _whole(path, numbers.reshape(-1, slashes + 1))
    words = [row.split() for row in rows]
    counts = np.array([len(w) for w in words])
    flat = [word for row in words for word in row]
    table = np.zeros((len(flat), 3))
    for k, word in enumerate(flat):
        parts = word.split(b"/")
        try:
            if len(parts) > 3:
                raise ValueError
            for i, part in enumerate(parts):
                table[k, i] = int(part) if part else 0
        except (ValueError, OverflowError):
            shown = word[:40].decode("utf-8", "replace")
            raise FileError(f"{path}: a line `f` has the corner {shown!r}; corners are v, v/vt, v//vn or v/vt/vn") from None
    return counts, _whole(path, table)


def _whole(path: Path, numbers: Array) -> Array:
    """Return numbers as integers."""
    if not (np.isfinite(numbers).all() and (numbers == np.round(numbers)).all() and np.abs(numbers).max(initial=0) < 2**53):
        raise FileError(f"{path}: a line `f` has a number that is not whole")
    return np.asarray(numbers.astype(np.int64))


def _resolved(path: Path, numbers: Array, counts: Array, before: list[int], known: int, what: str, gaps: bool = False) -> Array:
    """Return numbers from 0, where the file counts from 1, or backwards from the line; with ``gaps`` 0 becomes -1."""
    out = numbers - 1
    if (numbers < 0).any():
        out = np.where(numbers < 0, numbers + np.repeat(np.asarray(before, np.int64), counts), out)
    wrong = (out < 0) | (out >= known)
    if gaps:
        wrong &= numbers != 0
    else:
        wrong |= numbers == 0
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        face = int(np.searchsorted(np.cumsum(counts), first, side="right"))
        raise InputError(
            f"{path}: {int(wrong.sum())} corners name {what} that don't exist, the first is {int(numbers[first])} in face "
            f"{face + 1}; there are {known}, counted from 1"
        )
    return np.asarray(np.where(numbers == 0, -1, out) if gaps else out)


def _pictures(path: Path, libraries: list[str], names: list[bytes], notes: list[str]) -> tuple[tuple[Path, ...], dict[int, int]]:
    """Return the pictures of the materials in use, and the number of each material's picture."""
    named: dict[str, str] = {}
    missing = []
    for library in libraries:
        at = find_beside(path.parent, library)
        if at is None:
            missing.append(library)
            continue
        check_readable(at)
        current = ""
        for line in at.read_text("utf-8", "replace").splitlines():
            words = line.split(None, 1)
            if len(words) == 2 and words[0].lower() == "newmtl":
                current = words[1].strip()
            elif len(words) == 2 and words[0].lower() == "map_kd":
                named.setdefault(current, words[1].strip())
            if len(words) == 2 and words[0].lower().startswith(_MAPS):
                # Pictures that are not read are the mesh's all the same.
                for name in (words[1], words[1].split()[-1]):
                    note_input(find_beside(path.parent, name))
    found: list[Path] = []
    of_material: dict[int, int] = {}
    used = [name.decode("utf-8", "replace") for name in names]
    for number, name in [*enumerate(used)] or [(-1, next(iter(named), ""))]:
        if name not in named:
            continue
        picture = find_beside(path.parent, named[name]) or find_beside(path.parent, named[name].split()[-1])
        if picture is None:
            missing.append(named[name])
            continue
        if picture not in found:
            found.append(picture)
        of_material[number] = found.index(picture)
    if missing or not found:
        what = f": {', '.join(missing)} not found" if missing else ""
        notes.append(f"the mesh has texture coordinates but no picture{what}; it is read without its colours")
    return tuple(found), of_material


def find_beside(folder: Path, name: str) -> Path | None:
    """Return the file that another one names, whatever system wrote the name: as it is, or by its last part; None without one."""
    plain = name.strip().strip('"').replace("\\", "/")
    for wanted in (plain, plain.rsplit("/", 1)[-1]):
        try:
            if wanted and (folder / wanted).is_file():
                return folder / wanted
        except (OSError, ValueError):
            return None
    last = plain.rsplit("/", 1)[-1].lower()
    alike = sorted(p for p in folder.iterdir() if p.name.lower() == last and p.is_file())
    return alike[0] if alike else None
