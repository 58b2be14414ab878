"""Completing at several scales: coarse relief first, to guide the finer.

The relief is split by smoothing it over the base. A coarse level has targets and neighbourhoods ``2^level`` times as far apart,
so that the same window covers so much more; what it completes is known everywhere when the next level's neighbourhoods are
compared.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.kernels.geodesics import nearest_on_mesh
from intaglio.kernels.location import polar_grid
from intaglio.mesh import unit
from intaglio.randomness import Stream, uniform
from intaglio.relief.ground import Ground, smoothed
from intaglio.relief.growth.comparison import Comparison
from intaglio.relief.growth.displacement_metric import DisplacementMetric
from intaglio.relief.growth.plan import plan_search
from intaglio.relief.growth.propagation import Selection, grow_relief
from intaglio.relief.growth.refinement import refine_relief
from intaglio.relief.growth.samples import sample_set

# Waves shorter than this many spacings of a level do not belong to it.
_SHORTEST_WAVE = 3.0
_PASSES = 2
_FEWEST_SAMPLES = 1_000


def band(ground: Ground, length: float) -> Array:
    """Return the measured relief (N,) without waves shorter than ``length`` (input's unit); 0 at targets."""
    measured = ground.measured
    faces = ground.faces[measured[ground.faces].all(axis=1)]
    out = np.zeros(len(measured))
    count = int(measured.sum())
    out[:count] = smoothed(ground.height[:count, None], ground.foot[:count], faces, length)[:, 0]
    return out


def coarse_relief(
    ground: Ground,
    at_spacing: Callable[[float], Ground],
    levels: int,
    *,
    window: int,
    rotations: int,
    selection: Selection,
    seed: int,
    device: str,
    memory: float | None = None,
) -> Array:
    """Complete the coarser levels and return the coarse relief (N,) of every vertex of ``ground``.

    Parameters
    ----------
    ground : Ground
        Of the finest level.
    at_spacing : callable
        ``at_spacing(length) -> Ground``: the same scan with targets at another distance.
    levels : int
        At least 2, the finest counted.
    window, rotations, selection, seed, device, memory
        As for the finest level; the error bound goes by each level's own variance.
    """
    guide: Array | None = None
    last: Ground | None = None
    for level in range(levels - 1, 0, -1):
        spacing = ground.spacing * 2**level
        try:
            coarse = at_spacing(spacing)
            height = band(coarse, _SHORTEST_WAVE * spacing)
            coarse = replace(coarse, vertices=coarse.foot + height[:, None] * coarse.normal)
            known = None
            if guide is not None and last is not None:
                known = _carried(last, guide, coarse, band(coarse, 2 * _SHORTEST_WAVE * spacing), device)
            metric = _metric(coarse, known, level, window, rotations, seed, device, memory)
        except InputError as problem:
            message = f"levels={levels} are too many for this scan, give {level}: with targets {spacing:.4g} apart, {problem}"
            raise InputError(message) from problem
        measured = coarse.measured
        rule = replace(selection, error=max(0.5 * float(height[measured].var()), 1e-12 * spacing**2))
        growth = grow_relief(coarse, metric, window=window, selection=rule, seed=seed + level)
        refine_relief(coarse, metric, growth.state, window=window, passes=_PASSES, seed=seed + level)
        guide, last = growth.state.height, coarse
    assert guide is not None
    assert last is not None
    return _carried(last, guide, ground, band(ground, 2 * _SHORTEST_WAVE * ground.spacing), device)


def _metric(
    coarse: Ground,
    known: Array | None,
    level: int,
    window: int,
    rotations: int,
    seed: int,
    device: str,
    memory: float | None,
) -> DisplacementMetric:
    """Compare neighbourhoods of one coarse level: with as many of the samples as a scan of its density would have."""
    samples = sample_set(coarse, False)
    share = max(4.0**-level, _FEWEST_SAMPLES / len(samples.vertex))
    samples = samples.part(np.flatnonzero(uniform(seed, Stream.RELIEF_LEVELS, samples.vertex, level) < share))
    comparison = Comparison(coarse=known)
    points = len(polar_grid(max(window, 2), rotations)[1]) * len(comparison.factors())
    plan = plan_search(coarse, samples, points, rotations, "auto", memory, seed)
    return DisplacementMetric(
        coarse, plan.samples, window, rotations, device,
        comparison=comparison, approximate=plan.approximate, keep_grids=plan.keep_grids, seed=seed + level,
    )  # fmt: skip


def _carried(coarse: Ground, guide: Array, ground: Ground, own: Array, device: str) -> Array:
    """Coarse relief of a finer ground's vertices: the scan's own where measured, else between the coarse targets."""
    targets = np.flatnonzero(~ground.measured)
    face, weight = nearest_on_mesh(ground.foot[targets], coarse.foot, coarse.faces, device)
    out = own.copy()
    out[targets] = np.einsum("ik,ik->i", weight, guide[coarse.faces[face]])
    return out


def frames_along(ground: Ground, coarse: Array) -> tuple[Array, Array]:
    """Return frames u, v (N, 3) along the slope of the coarse relief: a neighbourhood is then alike however it is turned.

    Slopes are averaged over some spacings; where there is none the frame stays as it was.
    """
    faces = ground.faces
    corners = ground.foot[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    square = np.maximum(np.einsum("ij,ij->i", cross, cross), 1e-300)
    slope = np.zeros((len(faces), 3))
    for k in range(3):
        opposite = corners[:, (k + 2) % 3] - corners[:, (k + 1) % 3]
        slope += coarse[faces[:, k], None] * np.cross(cross, opposite)
    # Area times gradient of a linear function on each triangle, summed at its corners.
    slope *= (0.5 * np.sqrt(square) / square)[:, None]
    total = np.stack([np.bincount(faces.reshape(-1), np.repeat(slope[:, c], 3), len(coarse)) for c in range(3)], axis=1)
    total = smoothed(total, ground.foot, faces, 4 * _SHORTEST_WAVE * ground.spacing)
    total -= np.einsum("ij,ij->i", total, ground.normal)[:, None] * ground.normal
    length = np.linalg.norm(total, axis=1)
    weak = length < 1e-3 * float(np.median(length)) + 1e-300
    u = np.where(weak[:, None], ground.u, unit(total))
    return u, np.cross(ground.normal, u)
