"""Lines that end at a hole's rim, paired and joined across it by smooth curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import connected_components

from intaglio.arrays import Array
from intaglio.mesh import unit
from intaglio.relief.coherent import edges_from
from intaglio.relief.ground import Ground
from intaglio.relief.lines.features import Features

# Ends are looked for so many edges from the rim, and are so many long.
_BAND, _LONG = 8, 4.0
# A curve turns by at most so much at either end against the straight way, and the lines it joins bend alike up to this factor.
_TURN, ALIKE = np.radians(50.0), 2.5
# Cost of leaving an end alone, in squared radians.
_ALONE = 0.5
# An end runs into the hole at no less than this cosine.
_INWARDS = 0.35


@dataclass(frozen=True)
class End:
    """Where a line meets the rim.

    Attributes
    ----------
    at, way : (3,) arrays
        Its last place, and the direction into the hole.
    bend : float
        Of the line: positive on a ridge.
    """

    at: Array
    way: Array
    bend: float


@dataclass(frozen=True)
class Curve:
    """A line across a hole: points (K, 3), a spacing apart, and its bend; 0 for a guide whose lines bend as they may."""

    points: Array
    bend: float


def find_ends(ground: Ground, features: Features) -> list[End]:
    """Return the lines' ends at the rim of a ground's hole.

    Parameters
    ----------
    ground : Ground
    features : Features
    """
    target = ~ground.measured
    hops = edges_from(ground.topology.graph, target)
    chosen = np.flatnonzero(features.on_line & (hops <= _BAND))
    if len(chosen) == 0:
        return []
    graph = ground.topology.graph
    # Gaps of one vertex are bridged; a ridge isn't joined to a valley.
    near = graph[chosen] @ graph[:, chosen] + graph[chosen][:, chosen]
    near = near.multiply(np.sign(features.bend[chosen])[:, None] == np.sign(features.bend[chosen])[None])
    number, label = connected_components(near, directed=False)
    middle = ground.vertices[target].mean(axis=0)
    ends = []
    for k in range(number):
        own = chosen[label == k]
        if len(own) < _LONG or hops[own].min() > 3:
            continue
        points = ground.vertices[own]
        center = points.mean(axis=0)
        _, sizes, axes = np.linalg.svd(points - center, full_matrices=False)
        along = (points - center) @ axes[0]
        long = np.ptp(along) / ground.spacing
        # Long, and several times as long as wide.
        if long < _LONG or sizes[0] < 2 * sizes[1]:
            continue
        # Towards the rim.
        slope = np.polyfit(along, hops[own], 1)[0]
        way = -axes[0] * np.sign(slope)
        tip = points[np.argsort(hops[own], kind="stable")[:3]].mean(axis=0)
        inward = unit((middle - tip)[None])[0]
        if way @ inward < _INWARDS:
            continue
        ends.append(End(center + way * ((tip - center) @ way), way, float(np.median(features.bend[own]))))
    return ends


def joined(ends: list[End], spacing: float) -> list[Curve]:
    """Return curves that join ends in pairs, so that they turn least; ends that fit no other are left alone.

    Parameters
    ----------
    ends : list of End
    spacing : float
        Of the curves' points.
    """
    count = len(ends)
    if count < 2:
        return []
    cost = np.full((count, count), 1e6)
    for i, one in enumerate(ends):
        for j, other in enumerate(ends):
            if i == j or one.bend * other.bend <= 0:
                continue
            straight = unit((other.at - one.at)[None])[0]
            leaving, arriving = (float(np.arccos(np.clip(w, -1, 1))) for w in (one.way @ straight, -other.way @ straight))
            ratio = abs(np.log(abs(one.bend / other.bend)))
            if max(leaving, arriving) < _TURN and ratio < np.log(ALIKE):
                cost[i, j] = leaving**2 + arriving**2 + 0.2 * ratio**2
    # Each end is joined to another, or to itself: left alone.
    np.fill_diagonal(cost, _ALONE)
    partner = linear_sum_assignment(cost)[1]
    pairs = [(i, int(j)) for i, j in enumerate(partner) if i < j and partner[j] == i and cost[i, j] < 2 * _ALONE]
    return [Curve(hermite(ends[i], ends[j], spacing), 0.5 * (ends[i].bend + ends[j].bend)) for i, j in pairs]


def hermite(one: End, other: End, spacing: float) -> Array:
    """Return points (K, 3) of the cubic that leaves one end and arrives at the other in their directions."""
    length = float(np.linalg.norm(other.at - one.at))
    t = np.linspace(0, 1, max(2, int(np.ceil(length / spacing)) + 1))[:, None]
    # Hermite's polynomials.
    return (
        (2 * t**3 - 3 * t**2 + 1) * one.at
        + (t**3 - 2 * t**2 + t) * length * one.way
        + (3 * t**2 - 2 * t**3) * other.at
        - (t**3 - t**2) * length * other.way
    )
