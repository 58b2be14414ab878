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
from intaglio.relief.lines.curves import Curve
from intaglio.relief.lines.features import Features
from intaglio.sparse import factor_symmetric

# A line is felt over about so many spacings.
_WIDTH = 3.0
# Measured lines that bend as a curve does, up to this factor, are its like.
_ALIKE = 2.5


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
    sign = np.concatenate([np.full(len(curve.points), np.sign(curve.bend)) for curve in curves])
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
        held, goal, _nearness(ground, vertices, curves, points, sign, features)
    )


def _nearness(ground: Ground, vertices: Array, curves: list[Curve], points: Array, sign: Array, features: Features) -> Array:
    """Return how near a line every vertex is, with the line's sign."""
    width = _WIDTH * ground.spacing
    bends = np.array([curve.bend for curve in curves])
    # A guide may be a ridge or a valley: whatever line of the scan is stronger nearby tells.
    own = features.bend[:, None]
    alike = (own * bends > 0) & (np.abs(np.log(np.abs(own) + 1e-9) - np.log(np.abs(bends) + 1e-9)) < np.log(_ALIKE))
    like = features.on_line & (alike.any(axis=1) | (bends == 0).any())
    out = np.zeros(len(vertices))
    for mask, at, signs in (
        (ground.measured, vertices[like], np.sign(features.bend[like])),
        (~ground.measured, points, sign),
    ):
        if len(at):
            away, which = cKDTree(at).query(vertices[mask])
            out[mask] = signs[which] * np.exp(-0.5 * (away / width) ** 2)
    return out
