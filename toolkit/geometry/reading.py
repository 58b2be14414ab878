"""Reading swatches of geometry texture from files of points, meshes and height maps."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments, checked_number, checked_positive
from intaglio.errors import FileError, InputError
from intaglio.files import READABLE_SUFFIXES, check_readable, read_image, read_samples
from intaglio.geometry.normals import normals_facing
from intaglio.geometry.point_set import GeometryTexture
from intaglio.geometry.texture import geometry_from_height, geometry_from_mesh, geometry_from_points
from intaglio.mesh import POINT_FILES, holds_points, read_point_file, read_surface

_MESHES = (".ply", ".obj", ".stl", ".off", ".gltf", ".glb")
# Default range of a height map, as a share of its shorter side.
_RELIEF = 1 / 30


@checked_arguments
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

        * points: .las, .laz, .e57 (``pip install 'intaglio[points]'``), .xyz, .txt, .csv, .asc, .pts, .ptx, .pcd, and .ply or
          .obj without faces. Normals are taken from the file, else estimated: facing the scanner where the file says where
          it stood;
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
        The points, their bounds and the distance of samples; notes say what was left out, estimated or mended.

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
        if kind in POINT_FILES or (kind in (".ply", ".obj") and holds_points(path)):
            return _from_point_file(path, axis, common)
        if kind in _MESHES:
            mesh = read_surface(path)
            made = geometry_from_mesh(mesh.vertices, mesh.faces, color=mesh.color, axis=axis, seed=seed, **common)
            return replace(made, notes=mesh.notes + made.notes)
        if picture:
            return _from_picture(path, height, 1.0 if pixel is None else pixel, common, seed)
    except InputError as problem:
        raise problem if str(problem).startswith(f"{path}: ") else InputError(f"{path}: {problem}") from problem
    known = (*POINT_FILES, *_MESHES, *READABLE_SUFFIXES)
    raise FileError(f"{path}: unknown type {kind!r} of a swatch; known: {', '.join(sorted(set(known)))}")


def _from_point_file(path: Path, axis: int | str | None, common: dict[str, Any]) -> GeometryTexture:
    found = read_point_file(path)
    normals, notes = found.normals, found.notes
    if normals is None and found.viewpoints is not None and found.scan is not None:
        normals = normals_facing(found.points, found.viewpoints[found.scan])
        notes += ("normals were estimated and turned to where the scanner stood",)
    made = geometry_from_points(found.points, normals, color=found.color, axis=axis, **common)
    return replace(made, notes=notes + made.notes)


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
