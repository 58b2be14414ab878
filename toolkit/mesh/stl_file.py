"""STL files, binary or text: triangles that share no vertices, which are joined where they are equal as the format intends."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import FileError
from intaglio.files import check_memory, check_readable
from intaglio.mesh.mending import equal_places
from intaglio.mesh.raw_mesh import RawMesh

_HEADER, _TRIANGLE = 84, 50
_CORNER = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


def read_stl(path: Path) -> RawMesh:
    """Read an STL file.

    Raises
    ------
    FileError
        If it is neither binary nor text STL, or shorter than it should be.
    """
    size = check_readable(path).stat().st_size
    check_memory(path, 6 * size, "its content")
    content = path.read_bytes()
    promised = int.from_bytes(content[80:_HEADER], "little") if size >= _HEADER else -1
    begins = content[:512].lstrip()[:5].lower() == b"solid"
    if begins and size != _HEADER + _TRIANGLE * promised:
        corners = _from_text(path, content)
    elif promised < 0 or size < _HEADER + _TRIANGLE * promised:
        raise FileError(
            f"{path}: is no STL file, or its {size} bytes are cut off: its header declares {max(promised, 0)} triangles"
        )
    else:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(content, record, promised, _HEADER)["corners"].reshape(-1, 3).astype(np.float64)
    place = equal_places(corners)
    own = place == np.arange(len(place))
    return RawMesh(vertices=corners[own], faces=(np.cumsum(own) - 1)[place].reshape(-1, 3))


def _from_text(path: Path, content: bytes) -> Array:
    """Return the corners (3F, 3) of a text."""
    words = _CORNER.findall(content)
    try:
        corners = np.array(words, np.float64).reshape(-1, 3)
    except ValueError as error:
        raise FileError(f"{path}: a vertex has something else than numbers") from error
    if len(corners) % 3 or b"endsolid" not in content[-4096:].lower():
        raise FileError(f"{path}: its text breaks off within a solid: the file is cut off")
    return corners
