"""Files of relightable textures, by suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from intaglio.arrays import PathLike
from intaglio.errors import FileError
from intaglio.files import check_readable
from intaglio.photometric.exr_file import read_relightable_exr, write_relightable_exr
from intaglio.photometric.materials import write_gltf
from intaglio.photometric.ptm_file import read_ptm, write_ptm
from intaglio.photometric.relightable import Relightable
from intaglio.photometric.web_planes import write_web_planes


def write_relightable(texture: Relightable, path: PathLike) -> None:
    """Write a texture.

    Parameters
    ----------
    texture : Relightable
    path : path
        .exr: all of it, read back bit for bit. .ptm: polynomial texture map, 8 bits a coefficient. .json: ``info.json`` and
        planes for web RTI viewers, beside each other. .glb: albedo and normal map on a plane.

    Raises
    ------
    FileError
        For another suffix, or if the file can't be written.
    """
    path = Path(path)
    writer = _writers.get(path.suffix.lower())
    if writer is None:
        raise FileError(f"{path}: unknown type of texture {path.suffix!r}; known: {', '.join(_writers)}")
    writer(texture, path)


def read_relightable(path: PathLike) -> Relightable:
    """Read a texture that `write_relightable` wrote as .exr, or a .ptm.

    Raises
    ------
    FileError
        If the file is missing, damaged, or of another type.
    """
    path = check_readable(path)
    reader = _readers.get(path.suffix.lower())
    if reader is None:
        raise FileError(f"{path}: unknown type of texture {path.suffix!r}; known: {', '.join(_readers)}")
    return reader(path)


_writers: dict[str, Callable[[Relightable, Path], object]] = {
    ".exr": write_relightable_exr,
    ".ptm": write_ptm,
    ".json": write_web_planes,
    ".glb": write_gltf,
}
_readers: dict[str, Callable[[Path], Relightable]] = {".exr": read_relightable_exr, ".ptm": read_ptm}
TEXTURE_SUFFIXES = tuple(_writers)
