"""How curves across a hole steer its filling: the smooth filling is drawn onto them, and they guide the search for pieces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.mesh import SmoothBase
from intaglio.relief.coherent import Guidance
from intaglio.relief.ground import Ground
from intaglio.relief.lines.curves import ALIKE, Curve
from intaglio.relief.lines.features import Features
from intaglio.sparse import factor_symmetric

# A line is felt over about so many spacings.
_WIDTH = 3.0


def steered(ground: Ground, curves: list[Curve], features: Features) -> tuple[Ground, Guidance]:
    """Return the ground with its targets drawn onto curves, and what guides the search.

    The shift that brings vertices onto the curves dies away towards the rim harmonically, so that the filling rises to a line as
    flanks do.

    Parameters
    ----------
    ground : Ground
    curves : list of Curve
        At least one.
    features : Features
        Of the ground.
    """
    target = np.flatnonzero(~ground.measured)
    points = np.concatenate([curve.points for curve in curves])
    tree = cKDTree(ground.vertices[target])
    nearest = target[tree.query(points)[1]]
    # Of several points that one vertex is nearest to, the closest.
    order = np.argsort(-np.linalg.norm(points - ground.vertices[nearest], axis=1), kind="stable")
    chosen = np.full(len(ground.measured), -1)
    chosen[nearest[order]] = order
    held = np.flatnonzero(chosen >= 0)
    goal = points[chosen[held]]
    shift = np.zeros(ground.vertices.shape)
    shift[held] = goal - ground.vertices[held]
    free = np.flatnonzero(~ground.measured & (chosen < 0))
    if len(free):
        rows = csr_array(ground.topology.graph[free].astype(np.float64))
        degree = np.asarray(rows.sum(axis=1)).reshape(-1)
        system = csr_array(diags_array(degree + 1e-9) - rows[:, free])
        shift[free] = factor_symmetric(system).solve(rows @ shift)
    vertices = ground.vertices + shift
    base, foot = ground.base, ground.foot
    if isinstance(base, SmoothBase):
        foot = np.where(ground.measured[:, None], ground.foot, vertices)
        base = replace(base, vertices=foot)
    return replace(ground, vertices=vertices, base=base, foot=foot), Guidance(
        held, goal, _nearness(ground, vertices, curves, features)
    )


def _nearness(ground: Ground, vertices: Array, curves: list[Curve], features: Features) -> Array:
    """Return how near a line every vertex is, with the line's sign; measured ones where lines bend as one of the curves does.

    Of a guide that carries on no line of the scan nothing is known but where it runs.
    """
    out = np.zeros(len(vertices))
    bent = [curve for curve in curves if curve.bend]
    if not bent:
        return out
    bends = np.array([curve.bend for curve in bent])
    lines = np.flatnonzero(features.on_line)
    ratio = features.bend[lines, None] / bends
    lines = lines[((ratio > 1 / ALIKE) & (ratio < ALIKE)).any(axis=1)]
    sign = np.concatenate([np.full(len(curve.points), np.sign(curve.bend)) for curve in bent])
    for part, at, signs in (
        (ground.measured, vertices[lines], np.sign(features.bend[lines])),
        (~ground.measured, np.concatenate([curve.points for curve in bent]), sign),
    ):
        if len(at):
            away, which = cKDTree(at).query(vertices[part])
            out[part] = signs[which] * np.exp(-0.5 * (away / (_WIDTH * ground.spacing)) ** 2)
    return out
