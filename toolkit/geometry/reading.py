"""Reading swatches of geometry texture from files of points, meshes and height maps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_number, checked_positive
from intaglio.errors import FileError, InputError
from intaglio.files import READABLE_SUFFIXES, check_readable, read_image, read_samples
from intaglio.geometry.point_set import GeometryTexture
from intaglio.geometry.texture import geometry_from_height, geometry_from_mesh, geometry_from_points
from intaglio.mesh import load_mesh, vertex_colors

POINT_FILES = (".xyz", ".txt", ".pts")
_MESHES = (".ply", ".obj", ".stl", ".off", ".gltf", ".glb")
# Default range of a height map, as a share of its shorter side.
_RELIEF = 1 / 30


def read_geometry_texture(
    path: PathLike,
    *,
    bounds: Array | None = None,
    axis: int | str | None = None,
    spacing: float | None = None,
    height: float | None = None,
    pixel: float | None = None,
    seed: int = 0,
) -> GeometryTexture:
    """Read a swatch of geometry texture from a file of points, a mesh or a height map.

    Parameters
    ----------
    path : path
        The file:

        * points: .ply, .obj (``v`` and ``vn`` lines without faces) or .xyz, .txt, .pts (a line x y z, or x y z nx ny nz,
          each);
        * a mesh, which is sampled evenly: .ply, .obj, .stl, .off, .gltf, .glb;
        * a height map: .png, .tif, .exr, .jpg.
    bounds : (2, 3) array, optional
        Least and greatest corner of the box that is the texture; see `geometry_from_points`. Default None: the extent of
        the points.
    axis : {0, 1, 2, "x", "y", "z"}, optional
        Height axis of points and meshes. Default None: the one along which they extend least.
    spacing : float, optional
        Distance at which a mesh or height map is sampled, or to which points are thinned. Default None: see
        `geometry_from_mesh`, `geometry_from_height` and `geometry_from_points`.
    height : float, optional
        For height maps: the height of white (1) over black (0), in the unit of ``pixel``. Default None: a thirtieth of the
        shorter side, but 1 for EXR and float TIFF, which hold heights as they are.
    pixel : float, optional
        For height maps: side of a pixel. Default None: 1.
    seed : int, optional
        Seed of the sampling: the same seed gives the same points. Default 0.

    Returns
    -------
    GeometryTexture
        The points, their bounds and the distance of samples.

    Raises
    ------
    FileError
        If the file is missing, empty, damaged or of an unknown type.
    InputError
        If its content is not a usable swatch (see `geometry_from_points`), or an option is for another sort of file.

    Warns
    -----
    IntaglioWarning
        As `geometry_from_points`.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:16, :16]
    >>> rows = np.column_stack([x.ravel(), y.ravel(), np.sin(x.ravel()), -np.cos(x.ravel()), 0 * x.ravel(), np.ones(256)])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     np.savetxt(f"{folder}/waves.xyz", rows)
    ...     swatch = intaglio.read_geometry_texture(f"{folder}/waves.xyz")
    >>> len(swatch.points), swatch.axis
    (256, 2)
    """
    path = check_readable(path)
    kind = path.suffix.lower()
    picture = kind in READABLE_SUFFIXES
    for name, value, wanted in (("height", height, True), ("pixel", pixel, True), ("axis", axis, False)):
        if value is not None and picture != wanted:
            raise InputError(
                f"{path}: {name} goes with {'height maps' if wanted else 'points and meshes'}, not with {kind} files"
            )
    common: dict[str, Any] = {"bounds": bounds, "spacing": spacing}
    try:
        if kind in POINT_FILES:
            points, normals = _read_table(path)
            return geometry_from_points(points, normals, axis=axis, **common)
        if kind == ".obj" and (found := _obj_points(path)) is not None:
            return geometry_from_points(*found, axis=axis, **common)
        if kind in _MESHES:
            return _from_mesh_file(path, axis, common, seed)
        if picture:
            return _from_picture(path, height, 1.0 if pixel is None else pixel, common, seed)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from problem
    known = (*POINT_FILES, *_MESHES, *READABLE_SUFFIXES)
    raise FileError(f"{path}: unknown type {kind!r} of a swatch; known: {', '.join(sorted(set(known)))}")


def holds_points(path: Path) -> bool:
    """Return whether a file holds points without faces: a list of points, or a PLY or OBJ file of nothing else."""
    kind = path.suffix.lower()
    if kind == ".obj":
        return _obj_points(path) is not None
    if kind == ".ply":
        with open(path, "rb") as file:
            header = file.read(65536).split(b"end_header")[0].split(b"\n")
        counts = [line.split()[2] for line in header if line.startswith((b"element face", b"element range_grid"))]
        return all(count == b"0" for count in counts)
    return kind in POINT_FILES


def _read_table(path: Path) -> tuple[Array, Array | None]:
    """Rows of x y z, or x y z nx ny nz; commas count as spaces, lines that begin with # or // are skipped."""
    rows: list[list[float]] = []
    with open(path, encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            words = line.replace(",", " ").replace(";", " ").split()
            if not words or words[0].startswith(("#", "//")):
                continue
            # The .pts format, and some writers of .xyz, begin with the number of points.
            if not rows and len(words) == 1 and words[0].isdigit():
                continue
            try:
                rows.append([float(word) for word in words])
            except ValueError as problem:
                raise FileError(f"{path}: line {number} holds {line.strip()[:40]!r} where numbers are needed") from problem
    widths = {len(row) for row in rows}
    if len(widths) != 1 or not widths <= {3, 6}:
        raise FileError(f"{path}: lines must hold 3 numbers (x y z) or 6 (x y z nx ny nz), all alike; found {sorted(widths)}")
    table = np.array(rows)
    return table[:, :3], table[:, 3:] if table.shape[1] == 6 else None


def _obj_points(path: Path) -> tuple[Array, Array | None] | None:
    """Points and normals of an OBJ file without faces; None where it has faces."""
    points: list[list[float]] = []
    normals: list[list[float]] = []
    with open(path, encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, 1):
            words = line.split()
            if not words or words[0] not in ("v", "vn", "f", "fo"):
                continue
            if words[0] in ("f", "fo"):
                return None
            try:
                (points if words[0] == "v" else normals).append([float(word) for word in words[1:4]])
            except ValueError as problem:
                raise FileError(f"{path}: line {number} holds {line.strip()[:40]!r} where numbers are needed") from problem
    if any(len(row) != 3 for row in points + normals):
        raise FileError(f"{path}: has points or normals of fewer than 3 numbers")
    if normals and len(normals) != len(points):
        raise InputError(f"holds {len(points)} points but {len(normals)} normals; a normal for each, or none, is needed")
    return np.array(points).reshape(-1, 3), np.array(normals) if normals else None


def _from_mesh_file(path: Path, axis: int | str | None, common: dict[str, Any], seed: int) -> GeometryTexture:
    mesh = load_mesh(path)
    vertices = np.asarray(getattr(mesh, "vertices", np.zeros((0, 3))), np.float64)
    if not len(vertices):
        raise InputError("holds no points")
    faces = np.asarray(getattr(mesh, "faces", np.zeros((0, 3))), np.int64)
    color = vertex_colors(mesh, len(vertices))
    if len(faces):
        return geometry_from_mesh(vertices, faces, color=color, axis=axis, seed=seed, **common)
    return geometry_from_points(vertices, _ply_normals(mesh, len(vertices)), color=color, axis=axis, **common)


def _ply_normals(mesh: Any, count: int) -> Array | None:
    data = mesh.metadata.get("_ply_raw", {}).get("vertex", {}).get("data")
    take: Callable[[str], Any] = (lambda name: data[name]) if data is not None else (lambda name: None)
    try:
        parts = [np.asarray(take(name), np.float64).reshape(-1) for name in ("nx", "ny", "nz")]
    except (KeyError, ValueError, TypeError, IndexError):
        return None
    return np.stack(parts, axis=1) if all(len(part) == count for part in parts) else None


def _from_picture(path: Path, height: float | None, pixel: float, common: dict[str, Any], seed: int) -> GeometryTexture:
    picture = read_image(path, linear=True)
    gray = picture.mean(axis=2) if picture.ndim == 3 else picture
    note: tuple[str, ...] = ()
    if height is None:
        height = 1.0
        if read_samples(path).dtype.kind in "ui":
            height = _RELIEF * min(gray.shape) * checked_positive("pixel", pixel)
            note = (
                f"the height of white over black was taken as {height:.4g}, a thirtieth of the shorter side; set it with height",
            )
    made = geometry_from_height(gray * checked_number("height", height, -np.inf), pixel=pixel, seed=seed, **common)
    return replace(made, notes=made.notes + note)
