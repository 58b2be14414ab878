"""Reading calibrated photographs: the cameras of whatever program, and where its photographs lie."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from intaglio.arrays import PathLike
from intaglio.checks import checked_arguments
from intaglio.errors import FileError, InputError, IntaglioWarning
from intaglio.files import check_readable
from intaglio.photographs.camera import Camera, Photograph
from intaglio.photographs.camera_parts import View, Views, short
from intaglio.photographs.classic_cameras import bundler_views, middlebury_views, mve_views, nvm_views
from intaglio.photographs.colmap_cameras import colmap_views
from intaglio.photographs.json_cameras import json_views
from intaglio.photographs.meshroom_cameras import meshroom_views
from intaglio.photographs.metashape_cameras import metashape_views
from intaglio.photographs.picture_files import PictureFolders, fitted, picture_size
from intaglio.photographs.realitycapture_cameras import csv_views, xmp_views

_COLMAP = ("cameras.bin", "images.bin", "cameras.txt", "images.txt")

_readers: dict[str, Callable[[Path], Views]] = {
    ".json": json_views,
    ".sfm": meshroom_views,
    ".xml": metashape_views,
    ".csv": csv_views,
    ".out": bundler_views,
    ".nvm": nvm_views,
    ".txt": middlebury_views,
}

# Where the programs put their cameras in the folder of a project, the first that is there counts. A folder is COLMAP's.
_PLACES = (
    ".",
    "transforms.json",
    "sparse/0",
    "sparse",
    "colmap/sparse/0",
    "colmap/sparse",
    "colmap",
    "dense/sparse",
    "dense/0/sparse",
    "cameras.sfm",
    "sfm.json",
    "sfm_data.json",
    "reconstruction/sfm_data.json",
    "cameras.json",
    "cameras.xml",
    "cameras.csv",
    "bundle.out",
    "bundle/bundle.out",
    "bundle.rd.out",
)
# If nothing has such a name, the only file that ends so.
_ENDINGS = ("_par.txt", ".sfm", ".nvm", ".out", ".xml", ".csv", ".json")


@checked_arguments
def read_photographs(path: PathLike, *, images: PathLike | None = None, strict: bool = False) -> list[Photograph]:
    """Read cameras and find their photographs; the pictures themselves are read when they are needed.

    Every lens of these programs is understood. Where a photograph has another size than the one calibrated for, but the same
    shape, its calibration is scaled.

    Parameters
    ----------
    path : path
        One of these, or a project's folder, in which they are looked for (``sparse/0``, ``transforms.json``, …):

        * COLMAP: the folder with ``cameras.bin`` and ``images.bin``, or with these as ``.txt``, or one of these files;
        * ``transforms.json`` of nerfstudio and instant-ngp, ``cameras.json`` of Gaussian splatting;
        * ``.sfm`` or ``.json`` of Meshroom (AliceVision); ``sfm_data.json`` of OpenMVG;
        * ``.xml``: the cameras that Metashape exports;
        * ``.csv``: RealityCapture's internal and external camera parameters; or a folder with its XMP files;
        * ``.out``: Bundler, with ``list.txt`` beside it; ``.nvm``: VisualSFM; the folder of a scene of MVE;
        * ``.txt``: Middlebury's ``_par.txt`` (name, K, R, t on a line);
        * ``.json``: a list of views, or an object of views by name. A view has ``K`` and ``R`` (3 x 3), ``t`` (R X + t) or
          ``C`` (the camera's position), and may have ``image`` (file name; default the view's name), ``width`` and
          ``height``, ``distortion`` and ``model`` (see `Camera`), and ``present``: false to be left out.
    images : path, optional
        Folder of the photographs, or of folders with them. Default None: where the cameras are, or a folder there or beside it.
    strict : bool, optional
        Refuse a file some of whose photographs are missing or have another size than the one calibrated for.

    Returns
    -------
    list of Photograph
        One per view whose photograph is there, each with its own name.

    Raises
    ------
    FileError
        If a file can't be read as cameras, or no photograph (with ``strict``, not every one) is there.
    InputError
        If a calibration is not usable, there is no view, two have one name, or a photograph could be one of several files; the
        message names the view.

    Warns
    -----
    IntaglioWarning
        For photographs that are missing and left out, calibrations that are scaled, and photographs that are turned as their
        EXIF orientation says because only so they fit. Where both fit, pixels count as they are stored.

    Examples
    --------
    >>> import json
    >>> import pathlib
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> view = {"K": [[4, 0, 3.5], [0, 4, 3.5], [0, 0, 1]], "R": np.eye(3).tolist(), "t": [0, 0, 2]}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     intaglio.write_image(np.full((8, 8, 3), 0.5), f"{folder}/front.png")
    ...     _ = pathlib.Path(folder, "cameras.json").write_text(json.dumps({"front.png": view}))
    ...     photographs = intaglio.read_photographs(f"{folder}/cameras.json")
    ...     shape = photographs[0].image.shape
    >>> photographs[0].name, shape
    ('front.png', (8, 8, 3))
    """
    path, folder = Path(path), None if images is None else Path(images)
    try:
        lacking = folder is not None and not folder.is_dir()
    except OSError as problem:
        raise FileError(f"{folder}: is no usable folder name ({problem.strerror})") from problem
    if lacking:
        raise FileError(f"{folder}: is not a folder")
    path, reader = _reader(path)
    try:
        with np.errstate(all="ignore"):
            views = reader(path)
    except (FileError, InputError):
        raise
    except Exception as problem:
        # What is malformed in a way of its own; its reader says what it knows.
        raise FileError(f"{path}: is no readable camera file ({type(problem).__name__}: {short(problem)})") from problem
    if not views.views:
        raise InputError(f"{path}: holds no view")
    views.views = _with_own_names(path, views.views)
    found, notes = _photographs(
        path, views, PictureFolders(path if path.is_dir() else path.parent, folder, views.folders), strict
    )
    for note in (*views.notes, *notes):
        warnings.warn(f"{path}: {note}", IntaglioWarning, stacklevel=3)
    return found


def _reader(path: Path) -> tuple[Path, Callable[[Path], Views]]:
    """Return the file (or folder) of cameras, and what reads it."""
    try:
        is_folder = path.is_dir()
    except (OSError, ValueError) as problem:
        raise FileError(f"{short(path)}: is no usable file name ({short(problem)})") from problem
    if is_folder:
        return _in_folder(path)
    check_readable(path)
    if path.name.lower() in _COLMAP:
        return path, colmap_views
    suffix = path.suffix.lower()
    if suffix not in _readers:
        raise FileError(
            f"{path}: unknown camera file {short(path.suffix)!r}; known: {', '.join(sorted(_readers))}, or the folder of a "
            "project (COLMAP, MVE, RealityCapture's XMP files)"
        )
    return path, _readers[suffix]


def _in_folder(folder: Path) -> tuple[Path, Callable[[Path], Views]]:
    for place in _PLACES:
        at = folder / place
        if at.is_dir():
            for one, other in (_COLMAP[:2], _COLMAP[2:]):
                if (at / one).is_file() and (at / other).is_file():
                    return check_readable(at / one), colmap_views
        elif at.is_file():
            return check_readable(at), _readers[at.suffix.lower()]
    if (folder / "views").is_dir() and any((folder / "views").glob("*.mve/meta.ini")):
        return folder, mve_views
    files = [p for p in islice(sorted(folder.iterdir()), 100_000) if p.is_file()]
    for ending in _ENDINGS:
        own = [p for p in files if p.name.lower().endswith(ending)]
        if len(own) == 1:
            return check_readable(own[0]), _readers[own[0].suffix.lower()]
        if own:
            raise FileError(f"{folder}: holds {own[0].name} and {own[1].name}; say which of them has the cameras")
    for pictures in (folder, folder / "images"):
        if pictures.is_dir() and any(p.suffix.lower() == ".xmp" for p in pictures.iterdir()):
            return pictures, xmp_views
    raise FileError(
        f"{folder}: the folder holds no cameras that are known: COLMAP's cameras.bin or .txt (here or in sparse/0), "
        "transforms.json, sfm_data.json, a .sfm, .xml, .csv, .nvm or .out file"
    )


def _with_own_names(path: Path, views: list[View]) -> list[View]:
    """Return the views, those of one name told apart by the folders of their photographs.

    Raises
    ------
    InputError
        If they can't be.
    """
    count = Counter(view.name for view in views)
    if len(count) == len(views):
        return views
    made = [
        view if count[view.name] == 1 else replace(view, name=(view.picture or view.name).replace("\\", "/").lstrip("/"))
        for view in views
    ]
    again = Counter(view.name for view in made)
    if len(again) < len(made):
        raise InputError(f"{path}: names a view twice: {short(again.most_common(1)[0][0])}")
    return made


def _photographs(path: Path, views: Views, folders: PictureFolders, strict: bool) -> tuple[list[Photograph], list[str]]:
    """Return a photograph for each view whose picture is there, and what is to be said about them."""
    found: list[Photograph] = []
    missing: list[str] = []
    turned: list[str] = []
    scaled: list[str] = []
    for view in views.views:
        try:
            picture = folders.find(view.picture or view.name)
        except InputError as problem:
            raise InputError(f"{path}: {problem}") from problem
        if picture is None:
            missing.append(view.name)
            # A calibration that can't be used is worth knowing, photograph or not.
            _camera(path, view, (1, 1))
            continue
        size = picture_size(picture)
        camera, change = fitted(_camera(path, view, size.stored), size)
        if change == "turned":
            turned.append(view.name)
        elif change == "scaled":
            scaled.append(f"{view.name}, {size.stored[1]} x {size.stored[0]}")
        found.append(Photograph(camera=camera, picture=picture, name=view.name))
    where = ", ".join(str(f) for f in folders.folders[:4])
    if missing and (strict or not found):
        raise FileError(
            f"{path}: {_which(missing, len(views.views))} {_is(missing)} in none of {where}; say where (images=, --images)"
        )
    if scaled and strict:
        raise InputError(f"{path}: {_which(scaled, len(views.views))} {_has(scaled)} another size than the one calibrated for")
    notes = []
    if missing:
        notes.append(f"{_which(missing, len(views.views))} {_is(missing)} missing and left out (looked for in {where})")
    if scaled:
        notes.append(
            f"{_which(scaled, len(views.views))} {_has(scaled)} another size than calibrated for; calibrations are scaled"
        )
    if turned:
        notes.append(f"{_which(turned, len(views.views))} {_is(turned)} turned as EXIF says, as only so the calibrated size fits")
    return found, notes


def _which(names: list[str], total: int) -> str:
    if len(names) == 1:
        return f"the photograph {short(names[0])!r}"
    return f"{len(names)} of {total} photographs (the first: {short(names[0])!r})"


def _is(names: list[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _has(names: list[str]) -> str:
    return "has" if len(names) == 1 else "have"


def _camera(path: Path, view: View, size: Iterable[int]) -> Camera:
    """Return a view's camera; ``size`` is its photograph's rows and columns, on which it may depend."""
    try:
        with np.errstate(all="ignore"):
            values = view.camera(*size) if callable(view.camera) else view.camera
        return Camera(**values)
    except InputError as problem:
        raise InputError(f"{path}: view {short(view.name)}: {problem}") from problem
