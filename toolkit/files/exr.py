"""EXR files with named channels."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments, checked_path, shown
from intaglio.errors import FileError, InputError, IntaglioError, IntaglioWarning
from intaglio.files.limits import check_memory
from intaglio.files.paths import check_readable, whole_file
from intaglio.files.pixels import Pixels
from intaglio.files.quiet import hushed, hushed_streams, reason


def read_exr(path: PathLike, *, part: str | int | None = None) -> tuple[dict[str, Array], dict[str, object]]:
    """Read every channel of an EXR file by name, and the attributes of its header.

    Parameters
    ----------
    path : path
        The .exr file.
    part : str or int, optional
        Name, or number from 0, of the part to read of a file of several. Default None: the first, with a warning that names
        them all if there are more.

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
    InputError
        If there is no such part, or it needs more memory than there is.

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
    path = check_readable(path)
    channels, header, notes = _read_part(path, part)
    for note in notes:
        warnings.warn(f"{path}: {note}", IntaglioWarning, stacklevel=1)
    return channels, header


def read_exr_header(path: PathLike) -> dict[str, object]:
    """Return the attributes of the header of an EXR file's first part, without decoding its channels."""
    path = check_readable(path)
    try:
        parts = _headers(path)
    except Exception as error:
        raise FileError(f"{path}: is damaged, or no EXR image ({reason(error, path)})") from error
    return parts[0]


def read_exr_image(path: Path) -> Pixels:
    """Read the colours of an EXR: its R, G, B and A, or those of its only layer, or grey."""
    channels, _, notes = _read_part(path, None)
    layers = [""] if "R" in channels else sorted({n[:-1] for n in channels if n.endswith(".R")})
    if len(layers) == 1 and {f"{layers[0]}{c}" for c in "RGB"} <= channels.keys():
        names = [f"{layers[0]}{c}" for c in "RGBA" if f"{layers[0]}{c}" in channels]
    elif channels.keys() == {"Y", "A"}:
        names = ["Y", "Y", "Y", "A"]
    elif len(channels) == 1:
        return Pixels(next(iter(channels.values())), notes=notes)
    else:
        raise FileError(f"{path}: has channels {_listed(channels)}, no R, G, B; read them by name with read_exr")
    if len({channels[n].shape for n in names}) > 1:
        raise FileError(f"{path}: its channels {_listed(names)} differ in size; read them by name with read_exr")
    return Pixels(np.stack([channels[n] for n in names], axis=-1), notes=notes)


def _listed(names: Any) -> str:
    known = sorted(set(names))
    return ", ".join(known[:12]) + (f" and {len(known) - 12} more" if len(known) > 12 else "")


def _headers(path: Path) -> list[dict[str, Any]]:
    """Return the header of each part."""
    import OpenEXR

    with hushed(), hushed_streams(), OpenEXR.File(str(path), header_only=True) as file:
        parts = [dict(part.header) for part in file.parts]
    if not parts:
        raise ValueError("it has no part")
    return parts


def _read_part(path: Path, part: str | int | None) -> tuple[dict[str, Array], dict[str, object], tuple[str, ...]]:
    """Return channels, header, and what is to be said of the choice of the part."""
    import OpenEXR

    try:
        headers = _headers(path)
        number, notes = _chosen(path, headers, part)
        for header in headers:
            _check_memory(path, header)
        with hushed(), hushed_streams(), OpenEXR.File(str(path), separate_channels=True) as file:
            if len(file.parts) != len(headers):
                raise ValueError("its pixels can't be decoded")
            found = {n: np.asarray(c.pixels) for n, c in file.channels(number).items()}
            if any(c.dtype.kind not in "fui" or c.ndim != 2 or c.size == 0 for c in found.values()) or not found:
                raise FileError(f"{path}: holds deep or no pixels; flat channels are needed")
            channels = {n: np.ascontiguousarray(c, np.float32) for n, c in found.items()}
            header = dict(file.header(number))
    except IntaglioError:
        raise
    except MemoryError as error:
        raise InputError(f"{path}: there is not enough memory to read it; give a smaller image") from error
    except Exception as error:
        raise FileError(f"{path}: is damaged, or no EXR image that can be read ({reason(error, path)})") from error
    return channels, header, notes


def _chosen(path: Path, headers: list[dict[str, Any]], part: str | int | None) -> tuple[int, tuple[str, ...]]:
    """Return the number of the part to read, and a note if it was not asked for among several."""
    names = [str(header.get("name", number)) for number, header in enumerate(headers)]
    if part is None:
        if len(names) == 1:
            return 0, ()
        return 0, (f"holds {len(names)} parts: {', '.join(names[:12])}; {names[0]} is read (read_exr(part=…) reads another)",)
    if isinstance(part, str) and part in names:
        return names.index(part), ()
    if isinstance(part, int | np.integer) and not isinstance(part, bool) and 0 <= part < len(names):
        return int(part), ()
    raise InputError(f"{path}: has no part {shown(part)}; it has {len(names)}: {', '.join(names[:12])}")


def _check_memory(path: Path, header: Mapping[str, Any]) -> None:
    """Raise if decoding a part would take too much memory."""
    low, high = (np.asarray(corner, np.int64) for corner in header["dataWindow"])
    width, height = (int(n) for n in high - low + 1)
    if width < 1 or height < 1:
        raise FileError(f"{path}: is damaged: its data window is {width} x {height} pixels")
    count = len(header["channels"])
    # The channels as they are stored, and in single precision.
    check_memory(
        path, width * height * count * 8, f"an EXR of {width} x {height} pixels in {count} channel{'s' if count > 1 else ''}"
    )


@checked_arguments
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

    path = checked_path("path", path)
    planes = _planes(channels, path)
    shapes = {p.shape for p in planes.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 2 or 0 in next(iter(shapes)):
        raise InputError(f"{path}: EXR channels must all be (H, W) of one size, not {sorted(shapes)}")
    header: dict[str, object] = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header.update(_checked_metadata(metadata or {}))
    try:
        with whole_file(path) as beside, hushed_streams(), OpenEXR.File(header, planes) as file:
            file.write(str(beside))
    except (RuntimeError, TypeError, ValueError) as error:
        if isinstance(error, IntaglioError):
            raise
        raise FileError(f"{path}: could not be written ({reason(error)})") from error


def _checked_metadata(metadata: Mapping[str, object]) -> dict[str, object]:
    """Return metadata that EXR holds, or raise `InputError`."""
    checked: dict[str, object] = {}
    for name, value in metadata.items():
        plain = value.item() if isinstance(value, np.generic) else value
        whole = isinstance(plain, int) and abs(plain) < 2**31
        if not name or not (whole or isinstance(plain, str | float)):
            raise InputError(f"metadata {name!r} must be text, a number or a whole number of 32 bits, not {shown(value)}")
        checked[name] = float(plain) if isinstance(plain, bool) else plain
    return checked


def _planes(channels: Mapping[str, Array], path: PathLike) -> dict[str, Array]:
    """Return channels as single-precision planes, or raise `InputError`."""
    if not isinstance(channels, Mapping) or not all(isinstance(name, str) and name for name in channels):
        raise InputError(f"{path}: channels must be arrays by name, such as {{'height': …}}, not {type(channels).__name__}")
    planes = {}
    for name, channel in channels.items():
        try:
            array = np.asarray(channel)
            if array.dtype.kind not in "fiub":
                raise InputError(f"{path}: EXR channel {name!r} must hold real numbers, not {array.dtype}")
            with np.errstate(over="ignore"):
                planes[name] = np.ascontiguousarray(array, np.float32)
        except ValueError as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"{path}: EXR channel {name!r} is no array of numbers ({error})") from error
    return planes
