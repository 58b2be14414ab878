"""Finding the photographs that camera files name, and bringing calibrations to the sizes in which they lie there."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np

from intaglio.errors import InputError
from intaglio.files import READABLE_SUFFIXES, check_readable, note_input, read_samples
from intaglio.photographs.camera import Camera
from intaglio.photographs.camera_parts import short

# How far below its start a search for photographs goes, in folders and in files.
_DEPTH = 5
_MOST_FILES = 100_000

# Folders of pictures that are no photographs.
_OTHERS = ("mask", "depth", "normal", "confidence", "semantic")

# Folders that structure-from-motion programs put their results into, below the project's own.
_RESULTS = ("sparse", "colmap", "dense", "model", "models", "sfm", "bundle", "reconstruction", "text", "txt", "cameras")

# Pillow's names of image types whose header gives the size in which the pixels are stored.
_BY_HEADER = ("PNG", "JPEG", "MPO", "WEBP", "BMP", "TGA")

# Tags of EXIF and TIFF, and the orientations of pictures that lie on their side.
_WIDTH, _LENGTH, _ORIENTATION = 0x0100, 0x0101, 0x0112
_TURNING = (5, 6, 7, 8)


class PictureFolders:
    """Where the photographs of a camera file are looked for.

    Parameters
    ----------
    cameras : Path
        The folder of the camera file.
    images : Path or None
        The folder that the user gave; nothing else is searched then.
    named : list of Path
        Folders that the file itself names.
    """

    def __init__(self, cameras: Path, images: Path | None, named: list[Path]) -> None:
        self._index: dict[str, list[Path]] | None = None
        self._beside = cameras if images is not None else None
        if images is not None:
            self.folders = [images]
            self._roots = [images]
            return
        root = _project(cameras)
        above = [cameras, *[p for p in cameras.parents if p == root or root in p.parents]]
        self.folders = [*[p for p in named if _is_folder(p)], *above, *(p / "images" for p in above)]
        beside = cameras.parent / "images"
        if _is_folder(beside):
            self.folders.append(beside)
        self._roots = [p for p in (*named, root, beside) if _is_folder(p)]

    def find(self, name: str) -> Path | None:
        """Return the file of a photograph: its name as it is, with an image's suffix, in a folder below, or in another case.

        Raises
        ------
        InputError
            If several files could be it.
        """
        wanted = PurePosixPath(name.replace("\\", "/"))
        if self._beside is not None:
            # A photograph that lies where the list says is an input, also where others are taken in its place.
            note_input(self._beside / wanted)
        if wanted.is_absolute() and _is_file(Path(name)):
            return Path(name)
        # Exported calibrations may hold paths of another machine: the end of them counts.
        starts = [k for k, part in enumerate(wanted.parts) if part not in ("/", "..")]
        tails = [PurePosixPath(*wanted.parts[k:]) for k in (starts[0], starts[-1])] if starts else []
        for tail in tails:
            for folder in self.folders:
                for candidate in (folder / tail, *(folder / f"{tail}{suffix}" for suffix in READABLE_SUFFIXES)):
                    if _is_file(candidate):
                        return candidate
        return self._search(tails[-1], wanted) if tails else None

    def _search(self, last: PurePosixPath, wanted: PurePosixPath) -> Path | None:
        index = self._files()
        found = index.get(last.name.lower()) or index.get(last.stem.lower()) or []
        if len(found) < 2:
            return found[0] if found else None
        parts = [p.lower() for p in wanted.parts[:-1]]
        likeness = [_common_tail([q.lower() for q in path.parts[:-1]], parts) for path in found]
        best = [path for path, same in zip(found, likeness, strict=True) if same == max(likeness)]
        if len(best) > 1 and len({path.parent for path in best}) == 1:
            # A camera's raw file beside its JPEG.
            return min(best, key=lambda path: READABLE_SUFFIXES.index(path.suffix.lower()))
        if len(best) > 1:
            raise InputError(
                f"the photograph {short(wanted)} could be {best[0]} or {best[1]}; say which folder (images=, --images)"
            )
        return best[0]

    def _files(self) -> dict[str, list[Path]]:
        """Return the image files below, by their names and by their names without suffix, in lower case."""
        if self._index is not None:
            return self._index
        index: dict[str, list[Path]] = {}
        seen: set[str] = set()
        left = _MOST_FILES
        for root in self._roots:
            for folder, below, files in os.walk(root):
                depth = len(Path(folder).relative_to(root).parts)
                keep = (
                    [] if depth >= _DEPTH else [f for f in below if not f.startswith(".") and not f.lower().startswith(_OTHERS)]
                )
                below[:] = sorted(keep)
                left -= len(files)
                for file in sorted(files) if left > 0 else ():
                    path = Path(folder, file)
                    if path.suffix.lower() not in READABLE_SUFFIXES or str(path.resolve()) in seen:
                        continue
                    seen.add(str(path.resolve()))
                    for key in {file.lower(), path.stem.lower()}:
                        index.setdefault(key, []).append(path)
        self._index = index
        return index


def _common_tail(one: list[str], other: list[str]) -> int:
    count = 0
    while count < min(len(one), len(other)) and one[-1 - count] == other[-1 - count]:
        count += 1
    return count


def _project(folder: Path) -> Path:
    """Return the folder of the project that a folder of results belongs to."""
    for _ in range(4):
        name = folder.name.lower()
        if not (name.isdigit() or name.startswith(_RESULTS)) or folder.parent == folder:
            break
        folder = folder.parent
    return folder


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


@dataclass(frozen=True)
class PictureSize:
    """Rows and columns of a photograph as it is stored, and whether viewers show it turned by a quarter."""

    stored: tuple[int, int]
    turned: bool

    @property
    def upright(self) -> tuple[int, int]:
        """Rows and columns as viewers show it."""
        return self.stored[::-1] if self.turned else self.stored


def picture_size(path: Path) -> PictureSize:
    """Return the size of a photograph, from its header where that can be read alone.

    Raises
    ------
    FileError
        If it can't be read.
    """
    from PIL import Image

    check_readable(path)
    with warnings.catch_warnings():
        # Nothing is decoded here, however large it is.
        warnings.simplefilter("ignore")
        try:
            with Image.open(path) as image:
                # Of others, Pillow gives the size as viewers show them, or that of a small copy in a raw file.
                if image.format in _BY_HEADER:
                    return PictureSize(image.size[::-1], image.getexif().get(_ORIENTATION) in _TURNING)
                if image.format == "TIFF" and path.suffix.lower() in (".tif", ".tiff"):
                    tags = image.tag_v2
                    return PictureSize((int(tags[_LENGTH]), int(tags[_WIDTH])), tags.get(_ORIENTATION) in _TURNING)
        except Exception:
            # What is wrong with a damaged file, its own reader says below.
            pass
    height, width = read_samples(path, orient=False).shape[:2]
    return PictureSize((height, width), False)


def fitted(camera: Camera, picture: PictureSize) -> tuple[Camera, str | None]:
    """Return a camera for a photograph as it is, and what had to be done for that: "scaled", "turned" or None.

    A calibration for the same picture at another scale is scaled; another size is left, to be refused where it is read.
    """
    if camera.size is None or camera.size == picture.stored:
        return camera, None
    if camera.size == picture.upright:
        return camera, "turned"
    rows, columns = camera.size
    for size in (picture.stored, picture.upright):
        down, along = size[0] / rows, size[1] / columns
        if abs(size[0] - rows * along) <= min(1.5, 0.02 * size[0]) or abs(size[1] - columns * down) <= min(1.5, 0.02 * size[1]):
            # Pixel centres are whole numbers: the picture's corner, which stays, is at (-0.5, -0.5).
            change = np.array([[along, 0, 0.5 * along - 0.5], [0, down, 0.5 * down - 0.5], [0, 0, 1]])
            return replace(camera, K=change @ camera.K, size=size), "scaled"
    return camera, None
