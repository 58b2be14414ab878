"""Reading and writing relightable textures; the suffix of a file decides its type."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from intaglio.arrays import PathLike
from intaglio.checks import checked_arguments
from intaglio.errors import FileError
from intaglio.files import check_readable
from intaglio.photometric.exr_file import read_relightable_exr, write_relightable_exr
from intaglio.photometric.materials import write_gltf
from intaglio.photometric.ptm_file import read_ptm, write_ptm
from intaglio.photometric.relightable import Relightable
from intaglio.photometric.web_planes import write_web_planes


@checked_arguments
def write_relightable(texture: Relightable, path: PathLike) -> None:
    """Write a texture to a file.

    Parameters
    ----------
    texture : Relightable
        From `represent` or `read_relightable`.
    path : path
        The file, whose suffix decides the type:

        * .exr keeps everything, and is read back bit for bit;
        * .ptm is a polynomial texture map of 8 bits per coefficient, to which other kinds are approximated;
        * .json is ``info.json`` with planes beside it for web viewers of RTI files (`write_web_planes`);
        * .glb is albedo and normal map on a plane (`write_gltf`).

    Raises
    ------
    FileError
        If the suffix is unknown, or the file can't be written.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> lights = np.array([intaglio.light_direction(tilt, 45) for tilt in (0, 90, 180, 270)])
    >>> images = 0.5 * np.ones((4, 8, 8, 1)) * lights[:, 2, None, None, None]
    >>> texture = intaglio.represent(intaglio.PhotometricStack(images, lights), "gradient", device="cpu")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     intaglio.write_relightable(texture, f"{folder}/sample.exr")
    ...     back = intaglio.read_relightable(f"{folder}/sample.exr")
    >>> np.array_equal(back.maps, texture.maps)
    True
    """
    path = Path(path)
    writer = _writers.get(path.suffix.lower())
    if writer is None:
        raise FileError(f"{path}: unknown type of texture {path.suffix!r}; known: {', '.join(_writers)}")
    writer(texture, path)


@checked_arguments
def read_relightable(path: PathLike) -> Relightable:
    """Read a relightable texture from a file.

    Parameters
    ----------
    path : path
        An .exr that `write_relightable` wrote, or a .ptm from any program (RGB, LRGB, JPEG_RGB or JPEG_LRGB).

    Returns
    -------
    Relightable
        The texture; from a .ptm it is of kind "ptm" and has the values as they are stored.

    Raises
    ------
    FileError
        If the file is missing, damaged, or of another type.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> tilts, slants = (0, 0, 60, 120, 180, 240, 300), (0, 45, 45, 45, 45, 45, 45)
    >>> lights = np.array([intaglio.light_direction(*angles) for angles in zip(tilts, slants)])
    >>> images = 0.5 * np.ones((7, 8, 8, 1)) * lights[:, 2, None, None, None]
    >>> texture = intaglio.represent(intaglio.PhotometricStack(images, lights), "ptm", device="cpu")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     intaglio.write_relightable(texture, f"{folder}/sample.ptm")
    ...     back = intaglio.read_relightable(f"{folder}/sample.ptm")
    >>> back.kind
    'ptm'
    >>> np.allclose(back.relight([0, 0, 1]), texture.relight([0, 0, 1]), atol=0.01)
    True
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
