"""EXR files with named channels."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.errors import FileError, InputError
from intaglio.files.paths import check_readable, whole_file


def read_exr(path: PathLike) -> tuple[dict[str, Array], dict[str, object]]:
    """Read every channel of an EXR file by name, and the attributes of its header.

    Parameters
    ----------
    path : path
        The .exr file; of several parts the first is read.

    Returns
    -------
    channels : dict of str to (H, W) float32 array
        Values as they are stored; row 0 is the top.
    header : dict of str to object
        Attributes of the header by name, those that ``metadata`` of `write_exr` added among them.

    Raises
    ------
    FileError
        If the file is missing, empty, a folder, or can't be read as EXR.

    See Also
    --------
    intaglio.read_image : Colours of an EXR, or of other images, as one array.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = f"{folder}/relief.exr"
    ...     intaglio.write_exr({"height": np.array([[0.0, 0.5], [1.0, 2.0]])}, path, metadata={"unit": "mm"})
    ...     channels, header = intaglio.read_exr(path)
    >>> channels["height"]
    array([[0. , 0.5],
           [1. , 2. ]], dtype=float32)
    >>> header["unit"]
    'mm'
    """
    import OpenEXR

    path = check_readable(path)
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {n: np.asarray(c.pixels, np.float32) for n, c in file.channels().items()}
            header = dict(file.header())
    except Exception as error:
        raise FileError(f"{path}: can't be read as an EXR image ({error})") from error
    return channels, header


def write_exr(channels: Mapping[str, Array], path: PathLike, *, metadata: Mapping[str, object] | None = None) -> None:
    """Write named channels to an EXR file as 32-bit floats, compressed without loss.

    Parameters
    ----------
    channels : mapping of str to (H, W) array
        At least one channel, all of one size; values are stored as float32. Other programs show channels R, G, B as colour
        and Y as grey.
    path : path
        The .exr file. It appears whole, or stays as it was.
    metadata : mapping of str to object, optional
        Texts or numbers that are added to the header; default none.

    Raises
    ------
    InputError
        If there is no channel, or channels are not (H, W) or differ in size.
    FileError
        If the file can't be written.

    See Also
    --------
    intaglio.write_image : Write one array as an image of any type.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> normal = np.zeros((4, 4, 3))
    >>> normal[..., 2] = 1
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = f"{folder}/normals.exr"
    ...     intaglio.write_exr({f"normal.{c}": normal[..., i] for i, c in enumerate("XYZ")}, path)
    ...     channels, _ = intaglio.read_exr(path)
    >>> sorted(channels)
    ['normal.X', 'normal.Y', 'normal.Z']
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
