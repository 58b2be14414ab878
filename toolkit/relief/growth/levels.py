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
from intaglio.mesh import unit
from intaglio.randomness import Stream, uniform
from intaglio.relief.ground import Ground, smooth_over_surface
from intaglio.relief.growth.comparison import Comparison
from intaglio.relief.growth.parameters import Parameters
from intaglio.relief.growth.samples import Samples, sample_set
from intaglio.relief.growth.settings import ReliefSettings
from intaglio.relief.growth.stage import Resources, run_stage

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
    out[:count] = smooth_over_surface(ground.height[:count, None], ground.foot[:count], faces, length)[:, 0]
    return out


def complete_coarse_levels(
    ground: Ground, at_spacing: Callable[[float], Ground], parameters: Parameters, settings: ReliefSettings, resources: Resources
) -> Array:
    """Complete the coarser levels and return the coarse relief (N,) of every vertex of ``ground``.

    Parameters
    ----------
    ground : Ground
        Of the finest level.
    at_spacing : callable
        ``at_spacing(length) -> Ground``: the same scan with targets at another distance.
    parameters : Parameters
        Window and rotations are those of the finest level; the error bound goes by each level's own variance.
    settings : ReliefSettings
        With ``levels`` of at least 2, the finest counted.
    resources : Resources

    Raises
    ------
    InputError
        Where the scan is too small for so many levels.
    """
    coarse_settings = ReliefSettings(refine=_PASSES, selection=settings.selection)
    guide: Array | None = None
    last: Ground | None = None
    for level in range(settings.levels - 1, 0, -1):
        spacing = ground.spacing * 2**level
        own = replace(resources, seed=resources.seed + level)
        try:
            coarse = at_spacing(spacing)
            height = band(coarse, _SHORTEST_WAVE * spacing)
            coarse = replace(coarse, vertices=coarse.foot + height[:, None] * coarse.normal)
            known = None
            if guide is not None and last is not None:
                known = _carry(last, guide, coarse, band(coarse, 2 * _SHORTEST_WAVE * spacing), resources.device)
            samples = _thin_samples(coarse, level, resources.seed)
            error = max(0.5 * float(height[coarse.measured].var()), 1e-12 * spacing**2)
            stage = run_stage(coarse, samples, replace(parameters, error=error), coarse_settings, Comparison(coarse=known), own)
        except InputError as problem:
            message = (
                f"levels={settings.levels} are too many for this scan, give {level}: with targets {spacing:.4g} apart, {problem}"
            )
            raise InputError(message) from problem
        guide, last = stage.growth.state.height, coarse
    assert guide is not None
    assert last is not None
    return _carry(last, guide, ground, band(ground, 2 * _SHORTEST_WAVE * ground.spacing), resources.device)


def _thin_samples(coarse: Ground, level: int, seed: int) -> Samples:
    """Return as many of a coarse level's samples as a scan of its density would have."""
    samples = sample_set(coarse, False)
    share = max(4.0**-level, _FEWEST_SAMPLES / len(samples.vertex))
    return samples.part(np.flatnonzero(uniform(seed, Stream.RELIEF_LEVELS, samples.vertex, level) < share))


def _carry(coarse: Ground, guide: Array, ground: Ground, own: Array, device: str) -> Array:
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
    total = smooth_over_surface(total, ground.foot, faces, 4 * _SHORTEST_WAVE * ground.spacing)
    total -= np.einsum("ij,ij->i", total, ground.normal)[:, None] * ground.normal
    length = np.linalg.norm(total, axis=1)
    weak = length < 1e-3 * float(np.median(length)) + 1e-300
    u = np.where(weak[:, None], ground.u, unit(total))
    return u, np.cross(ground.normal, u)
