"""Lines that a user draws: polylines, from the interface or a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments
from intaglio.errors import FileError, InputError
from intaglio.files import check_readable
from intaglio.relief.ground import Ground
from intaglio.relief.lines.curves import Curve
from intaglio.relief.lines.features import Features

Guides = str | Sequence[Array]

_MEANING = "guides must be 'auto', 'none', or polylines: arrays (K, 3) of two points or more"
# Measured lines within so many spacings of a guide are what it carries on; found curves that come so near to one give way to it.
_NEAR = 4.0


def checked_guides(guides: Guides) -> str | list[Array]:
    """Return "auto", "none", or polylines (K, 3) as float64 arrays; raise `InputError` for anything else."""
    if isinstance(guides, str):
        if guides not in ("auto", "none"):
            raise InputError(f"{_MEANING}, not {guides!r}")
        return guides
    if not isinstance(guides, (Sequence, np.ndarray)):
        raise InputError(f"{_MEANING}, not {type(guides).__name__}")
    out = []
    for number, guide in enumerate(guides):
        try:
            points = np.asarray(guide, np.float64)
        except (TypeError, ValueError):
            points = np.zeros(0)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2:
            raise InputError(f"{_MEANING}; number {number} has shape {points.shape}")
        if not np.isfinite(points).all():
            raise InputError(f"guide {number} holds a coordinate that is not finite")
        if not np.ptp(points, axis=0).max() > 0:
            raise InputError(f"guide {number} is a single point")
        out.append(points)
    return out


def guide_curves(guides: list[Array], ground: Ground, features: Features) -> list[Curve]:
    """Return the guides' parts that run across a ground's hole, with the bend of the scan's lines that they carry on.

    Parameters
    ----------
    guides : list of (K, 3) arrays
    ground : Ground
        Around the hole.
    features : Features
        Of the ground.
    """
    tree = cKDTree(ground.vertices)
    size = float(np.ptp(ground.vertices[~ground.measured], axis=0).max())
    out = []
    for guide in guides:
        points = _resampled(guide, ground.spacing)
        away, nearest = tree.query(points)
        # A smooth filling may lie below a crease by a third of the hole.
        inside = ~ground.measured[nearest] & (away < 0.5 * size + 2 * ground.spacing)
        if not inside.any():
            continue
        lines = np.flatnonzero(features.on_line)
        bend = 0.0
        if len(lines):
            beside = cKDTree(points).query(ground.vertices[lines])[0] < _NEAR * ground.spacing
            bend = float(np.median(features.bend[lines[beside]])) if beside.any() else 0.0
        out.append(Curve(points[inside], bend))
    return out


def without_guided(found: list[Curve], guided: list[Curve], spacing: float) -> list[Curve]:
    """Return the found curves that no guide replaces: those that come near one at both ends give way."""
    if not guided:
        return found
    tree = cKDTree(np.concatenate([curve.points for curve in guided]))
    return [c for c in found if (tree.query(c.points[[0, -1]])[0] > _NEAR * spacing).any()]


def _resampled(points: Array, spacing: float) -> Array:
    """Return points (K, 3) of a polyline, about a spacing apart."""
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    keep = np.concatenate([[True], step > 0])
    points, length = points[keep], np.concatenate([[0.0], np.cumsum(step[step > 0])])
    at = np.linspace(0, length[-1], max(2, int(np.ceil(length[-1] / spacing)) + 1))
    return np.stack([np.interp(at, length, points[:, k]) for k in range(3)], axis=1)


@checked_arguments
def read_guides(path: PathLike) -> list[Array]:
    r"""Read polylines that guide a completion.

    Parameters
    ----------
    path : str or Path
        An OBJ file with line elements (``l``), as modelling programs write curves; or text with three numbers a line, an empty
        line after each polyline.

    Returns
    -------
    list of (K, 3) float64 arrays
        In the file's coordinates, which must be the scan's.

    Raises
    ------
    FileError
        If the file can't be read, or holds no polyline.

    Examples
    --------
    >>> import intaglio, tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "crease.txt"
    >>> _ = file.write_text("0 0 0\n1 0 0\n\n0 2 0\n0 3 0\n0 4 1\n")
    >>> [len(line) for line in intaglio.read_guides(file)]
    [2, 3]
    """
    path = check_readable(path)
    rows = path.read_text(encoding="utf-8", errors="replace").splitlines()
    lines = _obj_lines(rows, path) if path.suffix.lower() == ".obj" else _text_lines(rows, path)
    lines = [line for line in lines if len(line) >= 2]
    if not lines:
        raise FileError(f"{path}: holds no polyline of two points or more")
    return lines


def _numbers(row: str, words: list[str], path: Path) -> list[float]:
    try:
        found = [float(word) for word in words]
    except ValueError as error:
        raise FileError(f"{path}: {row[:60]!r} is not three numbers") from error
    if len(found) != 3 or not np.isfinite(found).all():
        raise FileError(f"{path}: {row[:60]!r} is not three finite numbers")
    return found


def _obj_lines(rows: list[str], path: Path) -> list[Array]:
    vertices = [_numbers(row, row.split()[1:4], path) for row in rows if row.startswith("v ")]
    lines = []
    for row in rows:
        if not row.startswith("l "):
            continue
        try:
            # As in faces, v/vt, and negative numbers count from the end.
            number = [int(word.partition("/")[0]) for word in row.split()[1:]]
            lines.append(np.array([vertices[n - 1 if n > 0 else n] for n in number if n != 0], np.float64).reshape(-1, 3))
        except (ValueError, IndexError) as error:
            raise FileError(f"{path}: {row[:60]!r} names no vertices of the file") from error
    return lines


def _text_lines(rows: list[str], path: Path) -> list[Array]:
    lines: list[list[list[float]]] = [[]]
    for row in rows:
        text = row.partition("#")[0].replace(",", " ").strip()
        if text:
            lines[-1].append(_numbers(row, text.split(), path))
        elif not row.strip():
            lines.append([])
    return [np.array(line, np.float64).reshape(-1, 3) for line in lines]
