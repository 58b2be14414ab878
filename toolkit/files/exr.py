"""EXR files with named channels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.errors import FileError, InputError
from intaglio.files.paths import check_readable, whole_file


def read_exr(path: PathLike) -> tuple[dict[str, Array], dict[str, object]]:
    """Read every channel of an EXR by name, (H, W) float32, and its header's attributes."""
    import OpenEXR

    path = check_readable(path)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {n: np.asarray(c.pixels, np.float32) for n, c in file.channels().items()}
            header = dict(file.header())
    except Exception as error:
        raise FileError(f"{path}: is no readable EXR image ({error})") from error
    return channels, header


def write_exr(channels: Mapping[str, Array], path: PathLike, *, metadata: Mapping[str, object] | None = None) -> None:
    """Write named channels, all (H, W), as 32-bit floats (ZIP-compressed), with text or number ``metadata``.

    Raises
    ------
    InputError
        If channels are missing or differ in shape.
    """
    import OpenEXR

    planes = {n: np.ascontiguousarray(c, np.float32) for n, c in channels.items()}
    shapes = {p.shape for p in planes.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2:
        raise InputError(f"{path}: EXR channels must all be (H, W) of one size, not {sorted(shapes)}")
    header: dict[str, object] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header.update(metadata or {})
    try:
        with whole_file(path) as beside, OpenEXR.File(header, planes) as file:
            file.write(str(beside))
    except RuntimeError as error:
        raise FileError(f"{path}: could not be written ({error})") from error
