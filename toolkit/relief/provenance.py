"""Where a filling's relief was taken from: how near, how connected, how evenly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.mesh import Surface
from intaglio.relief.fillings import Filling

# A source within so many radii of its filling's center is local.
_LOCAL = 2.0
# Sources of neighbours are neighbours if no farther apart than so many times the filled edge's own length.
_NEIGHBOURS = 2.0


@dataclass(frozen=True)
class Provenance:
    """Figures of the sources of all fillings.

    Attributes
    ----------
    local : float
        Share of filled vertices whose source lies within two radii of their filling's center.
    coherence : float
        Share of edges between filled vertices whose two sources lie no farther apart than twice the edge's length.
    largest_use : float
        Area that the most used place of the scan covers in the fillings, over its own, in units of even use.
    """

    local: float
    coherence: float
    largest_use: float


def measure_provenance(surface: Surface, fillings: list[Filling], edges: Array) -> Provenance:
    """Return where the fillings' relief comes from; every figure is NaN where no source is known.

    Lengths are taken on the base, so that steep relief counts as flat does. A place is a vertex with its neighbours, since pieces
    that are carried over fall on vertices by rounding. Even use is once, or as often as it takes where more was filled than
    measured.
    """
    base, source = surface.base, surface.source
    known = ~surface.measured & (source >= 0)
    local, total = 0, 0
    for filling in fillings:
        at = filling.vertices[known[filling.vertices]]
        away = np.linalg.norm(base[source[at]] - filling.center, axis=1)
        local += int((away <= _LOCAL * filling.radius).sum())
        total += len(at)
    if total == 0:
        return Provenance(float("nan"), float("nan"), float("nan"))
    inner = edges[known[edges].all(axis=1)]
    own = np.linalg.norm(base[inner[:, 0]] - base[inner[:, 1]], axis=1)
    apart = np.linalg.norm(base[source[inner[:, 0]]] - base[source[inner[:, 1]]], axis=1)
    coherence = float((apart <= _NEIGHBOURS * own).mean()) if len(inner) else float("nan")
    return Provenance(local / total, coherence, _largest_use(surface, known, edges))


def _largest_use(surface: Surface, known: Array, edges: Array) -> float:
    count = len(known)
    corners = surface.base[surface.faces]
    face_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 6
    area = np.bincount(surface.faces.reshape(-1), np.repeat(face_area, 3), count)
    carried = np.bincount(surface.source[known], area[known], count)
    own = np.where(surface.measured, area, 0)
    beside = edges[surface.measured[edges].all(axis=1)]
    place_carried, place_own = (
        v + np.bincount(beside[:, 0], v[beside[:, 1]], count) + np.bincount(beside[:, 1], v[beside[:, 0]], count)
        for v in (carried, own)
    )
    some = place_own > 0
    if not some.any():
        return float("nan")
    even = max(1.0, float(area[known].sum() / own.sum()))
    return float((place_carried[some] / place_own[some]).max() / even)
