"""Parameters chosen from the measured relief: window, error bound, rotations, and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import diags_array

from intaglio.arrays import Array
from intaglio.mesh import directed_edges, vertex_normals
from intaglio.randomness import Stream, uniform
from intaglio.relief.ground import Ground, smooth_over_surface
from intaglio.statistics import autocovariance

# Lags that are looked at, in steps of the scan; a bin is half a step wide.
_REACH = 32
# A second peak of the autocorrelation this high is a period.
_PERIODIC = 0.15
_LEAST_WINDOW, _MOST_WINDOW = 4, 12
# Share of directed slope from which relief counts as having one direction everywhere.
_DIRECTED = 0.25
_ROTATIONS = 12
# A spacing wider than the scan's own by this much may be too wide; it is, where waves shorter than twice the spacing hold this
# share of the relief's variance.
_WIDER, _SHARE_LOST = 1.2, 0.25


@dataclass(frozen=True)
class Parameters:
    """What propagation works with.

    Attributes
    ----------
    window : int
        In edges.
    error : float
        In squared input units.
    rotations : int
    notes : tuple of str
        What was chosen and why, and what was given that can't serve; nothing else about what was given.
    """

    window: int
    error: float
    rotations: int
    notes: tuple[str, ...]


def choose_parameters(
    ground: Ground, window: int | None, error: float | None, rotations: int | None, variance: float, relief_share: float = 1.0
) -> Parameters:
    """Choose what was not given.

    Parameters
    ----------
    ground : Ground
    window, error, rotations
        As given; None to choose. ``window``: from the relief's period if its autocorrelation has a second peak, else from
        its correlation length. ``error``: from the noise, estimated by how single vertices differ from their neighbours.
        ``rotations``: 1 where slopes have one direction in the local frames, else 12.
    variance : float
        Of what is compared, in squared input units.
    relief_share : float
        How much relief counts in it, 1 without colour.
    """
    notes: list[str] = []
    if window is None:
        window, note = _window(ground)
        notes.append(note)
    if error is None:
        error, note = _error(ground, variance, relief_share)
        notes.append(note)
    if rotations is None:
        rotations, note = _rotations(ground)
        notes.append(note)
    notes += _aliasing(ground)
    return Parameters(window, error, rotations, tuple(notes))


def _aliasing(ground: Ground) -> list[str]:
    """Return a note where targets lie too far apart for the relief (3DIM 2005, section 4: the Nyquist frequency), or none."""
    measured = ground.measured
    faces = ground.faces[measured[ground.faces].all(axis=1)]
    edges = directed_edges(faces)
    step = float(np.median(np.linalg.norm(ground.foot[edges[:, 0]] - ground.foot[edges[:, 1]], axis=1)))
    if ground.spacing <= _WIDER * step:
        return []
    height = ground.height[measured]
    shortest = 2 * ground.spacing
    lost = height - smooth_over_surface(height[:, None], ground.foot[measured], faces, shortest)[:, 0]
    noise = noise_variance(ground)
    share = (float(lost.var()) - noise) / max(float(height.var()) - noise, 1e-300)
    if share < _SHARE_LOST:
        return []
    return [
        f"spacing {ground.spacing:.4g} is too wide for the relief (Nyquist): much of it lies in waves shorter than "
        f"{shortest:.4g}, which vertices so far apart can't carry; the scan's own lie {step:.4g} apart"
    ]


def correlation(ground: Ground) -> tuple[Array, Array]:
    """Return lags, in the input's unit, and the autocorrelation of the measured relief there; empty where there is no relief."""
    measured = ground.measured
    height = ground.height[measured]
    variance = float(height.var())
    if variance <= 1e-18 * ground.spacing**2:
        return np.zeros(0), np.zeros(0)
    faces = ground.faces[measured[ground.faces].all(axis=1)]
    edges = directed_edges(faces)
    # Bins narrower than the scan's own steps would hold a few odd pairs only.
    step = 0.5 * max(
        float(np.median(np.linalg.norm(ground.foot[edges[:, 0]] - ground.foot[edges[:, 1]], axis=1))), ground.spacing
    )
    lag, covariance = autocovariance(ground.foot[measured], height, step, 2 * _REACH)
    known = np.isfinite(covariance)
    return lag[known], covariance[known] / variance


def _window(ground: Ground) -> tuple[int, str]:
    lag, rho = correlation(ground)
    if len(lag) < 4:
        return 7, "window 7: the scan has no relief to choose it by"
    below = np.flatnonzero(rho < np.exp(-1))
    length = float(lag[below[0]]) if len(below) else float(lag[-1])
    # Means of neighbouring bins: a period shows as a maximum after the first minimum.
    smooth = np.convolve(rho, np.array([1, 2, 3, 2, 1]) / 9, mode="same")
    inner = np.arange(1, len(smooth) - 4)
    minima = inner[(smooth[inner] < smooth[inner - 1]) & (smooth[inner] <= smooth[inner + 1])]
    period = 0.0
    if len(minima):
        after = inner[(inner > minima[0]) & (smooth[inner] > smooth[inner - 1]) & (smooth[inner] >= smooth[inner + 1])]
        if len(after) and smooth[after[0]] > _PERIODIC and smooth[after[0]] - smooth[minima[0]] > 2 * _PERIODIC:
            period = float(lag[after[0]])
    if period > 0:
        wanted, why = 0.85 * period, f"the relief repeats after {period:.4g} (correlation length {length:.4g})"
    else:
        wanted, why = 2.5 * length, f"the relief's correlation length is {length:.4g}, no period is seen"
    window = int(np.clip(round(wanted / ground.spacing), _LEAST_WINDOW, _MOST_WINDOW))
    note = f"window {window} (reach {window * ground.spacing:.4g}): {why}"
    if wanted > 1.25 * _MOST_WINDOW * ground.spacing:
        note += f"; {wanted / ground.spacing:.0f} edges would cover it, levels=2 or 3 may do better"
    return window, note


def noise_variance(ground: Ground) -> float:
    """Return the variance of a single vertex's height, without what it shares with its neighbours.

    What each vertex stands off its neighbours' mean, and that once more, so that slopes and bends drop out; by how much the two
    steps enlarge independent noise is tried on such. Robust (median absolute deviation), so that edges of relief count little;
    on relief as fine as the sampling this is an upper bound.
    """
    graph = ground.topology.graph
    own = graph @ diags_array(ground.measured.astype(np.float32))
    degree = np.asarray(own.sum(axis=1)).reshape(-1)
    use = ground.measured & (degree >= 4)
    if not use.any():
        return 0.0
    share = np.where(degree > 0, 1 / np.maximum(degree, 1), 0.0)
    inner = use & (own @ use.astype(np.float32) >= degree)
    use = inner if inner.any() else use

    def spread(values: Array) -> float:
        off = values - share * (own @ values)
        off = (off - share * (own @ off))[use]
        return 1.4826 * float(np.median(np.abs(off - np.median(off))))

    independent = np.sqrt(12.0) * (uniform(0, Stream.RELIEF_NOISE, np.arange(len(share))) - 0.5)
    return float((spread(ground.height) / spread(independent)) ** 2)


def _error(ground: Ground, variance: float, relief_share: float) -> tuple[float, str]:
    noise = relief_share * noise_variance(ground)
    low, high = 0.1 * variance, 0.5 * variance
    error = max(float(np.clip(4 * noise, low, high)), 1e-12 * ground.spacing**2)
    which = (
        "a tenth of the variance, above" if 4 * noise < low else "half the variance, below" if 4 * noise > high else "equal to"
    )
    return error, f"error bound {error:.4g}: {which} four times the noise (standard deviation {np.sqrt(noise):.3g})"


def _rotations(ground: Ground) -> tuple[int, str]:
    share = direction_share(ground)
    if share > _DIRECTED:
        return 1, f"rotations 1: the relief has a direction ({share:.0%} of its slope, from {_DIRECTED:.0%} on)"
    return _ROTATIONS, f"rotations {_ROTATIONS}: the relief has no direction in common ({share:.0%} of its slope)"


def direction_share(ground: Ground) -> float:
    """Return how much of the measured relief's slope lies along one axis of the local frames: 0 isotropic, 1 parallel ridges.

    The anisotropy (a - b) / (a + b) of the mean structure tensor with eigenvalues a, b.
    """
    faces = ground.faces[ground.measured[ground.faces].all(axis=1)]
    surface = ground.foot + ground.height[:, None] * ground.normal
    tilted = vertex_normals(surface, faces)
    flat = vertex_normals(ground.foot, faces)
    use = np.unique(faces)
    corners = ground.foot[faces]
    face_area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    # By area: where the scan is denser its slopes don't count more.
    area = np.bincount(faces.reshape(-1), np.repeat(face_area, 3), len(flat))[use]
    difference = (tilted - flat)[use] * np.sqrt(area)[:, None]
    x = np.einsum("ij,ij->i", difference, ground.u[use])
    y = np.einsum("ij,ij->i", difference, ground.v[use])
    total = float((x**2 + y**2).sum())
    if total <= 0:
        return 0.0
    return float(np.hypot((x**2 - y**2).sum(), 2 * (x * y).sum()) / total)
