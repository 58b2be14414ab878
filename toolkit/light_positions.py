"""Light positions of image stacks (.lp files)."""

from __future__ import annotations

import os

import numpy as np

from intaglio.errors import InputError
from intaglio.files import check_readable


def read_light_positions(path: str | os.PathLike[str]) -> tuple[list[str], np.ndarray]:
    """Read an .lp file: a line with the number of images, which may be missing, then ``name x y z`` a line.

    Parameters
    ----------
    path : path

    Returns
    -------
    names : list of str
        Image files, relative to the .lp file, with forward slashes.
    lights : (K, 3) float64 array
        Unit vectors towards the light; x right, y up, z to the camera.

    Raises
    ------
    FileError
        If the file is missing or empty.
    InputError
        If a line is not a name and three finite numbers, or the count is wrong.
    """
    path = check_readable(path)
    lines = [line.strip() for line in path.read_text(encoding="utf-8", errors="replace").splitlines()]
    lines = [line for line in lines if line]
    promised = int(lines[0]) if lines and lines[0].isdigit() else None
    names, lights = [], []
    for number, line in enumerate(lines[promised is not None :], start=1):
        words = line.rsplit(maxsplit=3)
        try:
            vector = np.array([float(w) for w in words[1:]])
        except ValueError:
            vector = np.zeros(0)
        if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
            raise InputError(f"{path}: entry {number} is not 'name x y z' with a direction: {line!r}")
        names.append(words[0].replace("\\", "/"))
        lights.append(vector / np.linalg.norm(vector))
    if not names:
        raise InputError(f"{path}: holds no lights")
    if promised is not None and promised != len(names):
        raise InputError(f"{path}: its first line promises {promised} images, but {len(names)} follow")
    return names, np.array(lights)
