"""Correspondence fields in NumPy: slow, obvious and in double precision, beside the kernels' own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

TURNS = 24
UNFIT = 1e6


def rotated(angle, w):
    """Return ``w`` (2,) turned by ``angle``."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ w


def mapped(angle, mirror, w):
    """Return ``w`` (2,), its second component turned round where mirrored, then turned by ``angle``."""
    return rotated(angle, w * [1, -1 if mirror else 1])


@dataclass(frozen=True)
class Paths:
    """The tables that walks are done on, as NumPy holds them."""

    offsets: np.ndarray
    neighbors: np.ndarray
    step: np.ndarray
    turn: np.ndarray
    foot: np.ndarray

    @classmethod
    def of(cls, tables):
        """Read them from a `SurfaceTables`."""
        steps = tables.steps
        read = {name: getattr(steps, name).numpy() for name in ("offsets", "neighbors", "step", "turn", "foot")}
        return cls(**{name: a if a.dtype.kind == "i" else a.astype(np.float64) for name, a in read.items()})

    def around(self, i):
        """Return the numbers of the steps from vertex i."""
        return range(self.offsets[i], self.offsets[i + 1])

    def walk(self, first, way):
        """Step to the neighbour that is nearest to the goal for as long as one is nearer; return vertex, rest, frame's angle."""
        at, rest, turn = int(first), np.asarray(way, np.float64), 0.0
        for _ in range(96):
            around = np.array(self.around(at))
            left = ((rest - self.step[around]) ** 2).sum(axis=1)
            if left.min() >= 0.9999 * (rest**2).sum():
                break
            e = around[np.argmin(left)]
            rest, turn, at = rotated(-self.turn[e], rest - self.step[e]), turn + self.turn[e], int(self.neighbors[e])
        return at, rest, turn

    def carried(self, field, i, e):
        """Return what the target that step e leads to from i says about i: place, offset and angle."""
        j = self.neighbors[e]
        # Back from j to i, in the frame of j; that of i stands at -turn there.
        back = -rotated(-self.turn[e], self.step[e])
        angle, mirror = field.angle[j], field.mirror[j]
        p, rest, turn = self.walk(field.place[j], field.offset[j] + mapped(angle, mirror, back))
        return p, rest, angle + (self.turn[e] if mirror else -self.turn[e]) - turn


@dataclass
class NumPyField:
    """A correspondence field as NumPy holds it."""

    place: np.ndarray
    offset: np.ndarray
    angle: np.ndarray
    mirror: np.ndarray
    cost: np.ndarray

    @classmethod
    def of(cls, field):
        """Read a kernel's field."""
        names = ("place", "offset", "angle", "mirror", "cost")
        return cls(
            *(np.array(getattr(field, name).numpy()).astype(float if k in (1, 2, 4) else int) for k, name in enumerate(names))
        )


def patch_difference(target, source, weight, terms):
    """Return the difference of two patches (G, 4) whose points lie on one another."""
    g = weight * target[:, 3]
    both, lost = (g > 0) & (source[:, 3] > 0), (g > 0) & (source[:, 3] <= 0)
    total = g.sum()
    if total == 0:
        return 0.0
    if g[both].sum() < 0.5 * total:
        return UNFIT
    d = (target - source)[both]
    mean = np.average(d[:, 0], weights=g[both]) if terms.afloat else 0.0
    height = (g[both] * (d[:, 0] - mean) ** 2).sum()
    slope = (g[both] * (d[:, 1] ** 2 + d[:, 2] ** 2)).sum()
    cost = (terms.w_height * height + terms.w_slope * slope + terms.missing * g[lost].sum()) / total
    return cost * total / (total + 0.05)


def turned_patch(patch, turns, angle, mirror):
    """Return a source's patch (G, 4) as a target sees it that is mapped to it."""
    q = int(np.round(angle * TURNS / (2 * np.pi))) % TURNS
    out = patch[turns[q + TURNS * mirror]]
    return out * [1, 1, -1, 1] if mirror else out


def match_cost(look, i, p, angle, mirror, terms):
    """Return the cost of source p for target i, without coherence.

    ``look`` has the NumPy arrays ``values``, ``row``, ``row_turn``, ``turns``, ``weight``, ``likeness``, ``direction``, ``used``
    and ``foot``.
    """
    source = turned_patch(look["values"][look["row"][p]], look["turns"], angle + look["row_turn"][p], mirror)
    cost = patch_difference(look["values"][look["row"][i]], source, look["weight"], terms)
    cost += terms.likeness * ((look["likeness"][i] - look["likeness"][p]) ** 2).sum()
    cost += terms.direction * ((mapped(2 * angle, mirror, look["direction"][i]) - look["direction"][p]) ** 2).sum()
    cost += 0.5 * terms.upright * (1 - np.cos(angle))
    far = np.linalg.norm(look["foot"][i] - look["foot"][p]) / terms.reach
    return cost + terms.locality * min(far, 1.0) + terms.use * look["used"][p]
