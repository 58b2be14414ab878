"""What a file of points holds, and what all its readers share: tidying, colours, short quotations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.kernels.transfer import decode_srgb

_QUOTED = 40
# Neighbours whose mean replaces a normal that is no direction.
_AROUND = 4
# Share of normals that may be no direction; beyond it all are left out.
_FEW = 0.2
# Squares of larger coordinates overflow: they are damaged, as those that are no numbers.
_LARGEST = 1e100


@dataclass(frozen=True)
class PointFile:
    """Points as a file holds them.

    Attributes
    ----------
    points : (N, 3) float64 array
        Positions in the file's own unit and world coordinates: poses of scans have been applied.
    normals : (N, 3) float64 array or None
        Normals of any length but 0.
    color : (N, 3) float32 array or None
        Linear Rec.709 colours from 0 to 1.
    intensity : (N,) float32 array or None
        Strengths of the returned signal, in the file's own scale.
    viewpoints : (S, 3) float64 array or None
        Where scanners stood, in the coordinates of the points.
    scan : (N,) int32 array or None
        The viewpoint, from 0, that saw each point; None without viewpoints.
    notes : tuple of str
        What was found, left out or mended, as sentences for the user.
    """

    points: Array
    normals: Array | None = None
    color: Array | None = None
    intensity: Array | None = None
    viewpoints: Array | None = None
    scan: Array | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.points)

    def part(self, chosen: Array) -> PointFile:
        """Return some of the points, by a mask or by their numbers, with what belongs to them."""
        kept = {name: getattr(self, name) for name in ("points", "normals", "color", "intensity", "scan")}
        return replace(self, **{name: value[chosen] for name, value in kept.items() if value is not None})

    def sight(self) -> Array | None:
        """Return the direction of sight (3,), from scanner to object, if all points were seen from one place; else None."""
        if self.viewpoints is None or self.scan is None or len(np.unique(self.scan)) != 1:
            return None
        towards = self.points.mean(axis=0) - self.viewpoints[self.scan[0]]
        length = float(np.linalg.norm(towards))
        return towards / length if length > 0 else None


def quoted(text: str) -> str:
    """Return the begin of a text in quotation marks, on one line."""
    return repr(text.strip()[:_QUOTED])


def is_number(word: str) -> bool:
    """Tell whether a word of a text file is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word


def odd_line(lines: list[str], width: int, first: int = 1) -> str:
    """Return what the first line that does not hold ``width`` numbers holds instead; ``first`` is the number of the first one."""
    for number, line in enumerate(lines, first):
        words = line.split()
        if words and (len(words) != width or not all(map(is_number, words))):
            return f"line {number} holds {quoted(line)}"
    return f"line {first} holds no rows"


def named(count: int, what: str) -> str:
    """Return ``count`` and a noun that agrees with it."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def plain(error: BaseException) -> str:
    """Return what a foreign error says, on one short line."""
    # What libE57 says for its own authors comes after that word.
    said = " ".join(str(error).split()).split(" Debug info", 1)[0][:160]
    return f"{type(error).__name__}: {said}" if said else type(error).__name__


def colors_from(levels: Array, white: float) -> Array:
    """Return linear colours of sRGB levels from 0 to ``white``."""
    return decode_srgb(np.clip(levels.astype(np.float32) / np.float32(white), 0, 1))


def colors_of_words(levels: Array) -> tuple[Array | None, str | None]:
    """Return linear colours (N, 3) of 16-bit sRGB levels (N, 3), and a note on their scale.

    Many programs write 8-bit levels into 16-bit fields as they are, or times 256; black alone means that no colour was measured.
    """
    most = int(levels.max(initial=0))
    if most == 0:
        return None, "its colours are all black: they were never filled in, and are left out"
    if most <= 255:
        return colors_from(levels, 255), "its 16-bit colours reach from 0 to 255 only: they were read as 8-bit ones"
    return colors_from(levels, 65280 if not (levels & 255).any() else 65535), None


def tidied(found: PointFile) -> PointFile:
    """Return points that are finite and differ, with normals that are directions; notes say what was left out or mended.

    Raises
    ------
    InputError
        If no point remains.
    """
    notes = list(found.notes)
    points = found.points
    with np.errstate(invalid="ignore"):
        finite = (np.abs(points) < _LARGEST).all(axis=1)
    if not finite.all():
        found = found.part(finite)
        notes.append(f"{named(int((~finite).sum()), 'point')} without finite coordinates left out")
    if not len(found):
        raise InputError("holds no points" + (f" ({notes[-1]})" if notes else ""))
    first = _first_of_equals(found.points)
    if len(first) < len(found):
        notes.append(f"{named(len(found) - len(first), 'point')} that lie exactly on another left out")
        found = found.part(first)
    changed: dict[str, Any] = {}
    if found.normals is not None:
        changed["normals"], note = _directions(found.points, found.normals)
        notes += note
    for name, what in (("color", "colours"), ("intensity", "intensities")):
        value = getattr(found, name)
        if value is not None and not np.isfinite(value).all():
            rows = ~np.isfinite(value).reshape(len(found), -1).all(axis=1)
            changed[name] = None
            notes.append(f"the {what} of {named(int(rows.sum()), 'point')} are not finite: {what} left out")
    if found.intensity is not None and not (found.intensity != 0).any():
        changed["intensity"] = None
    return replace(found, notes=tuple(notes), **changed)


def _first_of_equals(points: Array) -> Array:
    """Return the numbers of points, in order, without those that equal an earlier one; sorting hashes is ten times faster."""
    # Adding 0 makes of -0 a 0, which it equals.
    bits = np.ascontiguousarray(points + 0.0).view(np.uint64)
    odd = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
    mixed = (bits ^ (bits >> np.uint64(29))) * odd
    code = mixed[:, 0] ^ (mixed[:, 1] >> np.uint64(7)) ^ (mixed[:, 2] << np.uint64(11))
    order = np.argsort(code, kind="stable")
    same = np.diff(code[order]) == 0
    if not same.any():
        return np.arange(len(points))
    # Only points of equal hashes are compared in full.
    run = np.concatenate([same, [False]]) | np.concatenate([[False], same])
    alike = np.sort(order[run])
    _, first = np.unique(points[alike], axis=0, return_index=True)
    keep = np.ones(len(points), bool)
    keep[alike] = False
    keep[alike[first]] = True
    return np.flatnonzero(keep)


def _directions(points: Array, normals: Array) -> tuple[Array | None, list[str]]:
    """Return normals that all are directions, taken from neighbours where they were none."""
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(normals, axis=1)
    good = np.isfinite(length) & (length > 0)
    bad = int((~good).sum())
    if not bad:
        return normals, []
    if bad > _FEW * len(normals):
        return None, [f"{bad} of {len(normals)} normals are no directions: all are left out"]
    unit = normals[good] / length[good, None]
    _, near = cKDTree(points[good]).query(points[~good], min(_AROUND, int(good.sum())))
    mended = normals.copy()
    around = unit[near.reshape(bad, -1)]
    mean = around.mean(axis=1)
    mended[~good] = np.where(np.linalg.norm(mean, axis=1, keepdims=True) > 0.1, mean, around[:, 0])
    return mended, [f"{named(bad, 'normal')} without a direction taken from the nearest points"]
