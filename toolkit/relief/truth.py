"""A completion held against the surface that was there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.kernels.geodesics import nearest_on_mesh
from intaglio.kernels.location import height_above
from intaglio.mesh import Surface, border_edges
from intaglio.relief.figures import TruthComparison
from intaglio.relief.fillings import Filling, list_fillings, restrict
from intaglio.relief.roughness import measure_roughness
from intaglio.relief.smooth_filling import without_relief
from intaglio.statistics import earth_movers_distance, mean_surface_integral

# Of more filled vertices no smooth filling is made: it would take minutes.
_MOST_SMOOTH = 60_000
# A nearest point that owes filled corners less than this lies on measured surface.
_OWED = 1e-3


def compare_with_truth(
    surface: Surface, truth: Surface, measured: Array, filled: Array, fillings: list[Filling], device: str
) -> TruthComparison:
    """Return how far a completion is from the truth; ``measured`` and ``filled`` (N,) say which vertices count."""
    if len(truth.faces) == 0:
        raise InputError("the truth has no faces: it can't be compared with")
    relief = surface.relief
    extent = float(np.linalg.norm(np.ptp(surface.base, axis=0)))
    reach = min(0.2 * extent, 10 * float(np.abs(relief).max()) + 1e-3 * extent)
    true_relief = height_above(surface.base, surface.normal, truth.vertices, truth.faces, reach, device)
    difference = relief - true_relief
    known = np.isfinite(true_relief)
    at, own = filled & known, measured & known
    if not at.any():
        raise InputError("the truth has no surface over the filled part: is it in the same coordinates and unit?")
    msi = mean_surface_integral(true_relief[at])
    over, distance_rms, smooth_rms = _distances(surface, truth, filled, max(reach, fillings[0].radius), device)
    return TruthComparison(
        difference=difference,
        rms=float(np.sqrt((difference[at] ** 2).mean())),
        measured_rms=float(np.sqrt((difference[own] ** 2).mean())) if own.any() else float("nan"),
        msi=msi,
        msi_percent=percent(mean_surface_integral(relief[at]), msi),
        displacement_emd=earth_movers_distance(relief[at], true_relief[at]),
        coverage=float(at.sum() / filled.sum()),
        distance_rms=distance_rms,
        smooth_rms=smooth_rms,
        roughness=_true_roughness(truth, over, fillings),
    )


def percent(value: float, reference: float) -> float:
    """Return the difference of a value from a reference in percent of its size; NaN for a reference of 0."""
    return 100 * (value - reference) / abs(reference) if reference != 0 else float("nan")


def _true_roughness(truth: Surface, over: Array, fillings: list[Filling]) -> Array:
    """Return the roughness (3, 3) of the truth where it lies over the fillings, in waves of their spacings."""
    marked = replace(truth, measured=~over)
    own = cKDTree([filling.center for filling in fillings])
    true = [replace(filling, spacing=fillings[own.query(filling.center)[1]].spacing) for filling in list_fillings(marked)]
    return measure_roughness(truth.vertices, truth.faces, marked.measured, true).whole


def _distances(surface: Surface, truth: Surface, filled: Array, reach: float, device: str) -> tuple[Array, float, float]:
    """Return which of the truth's vertices lie over the fillings, and their rms distances from these and from smooth ones.

    A vertex lies over a filling if its nearest point, on either surface, does, and is no farther than ``reach``.
    """
    low, high = (f(surface.vertices[filled], axis=0) for f in (np.min, np.max))
    at = np.flatnonzero(((truth.vertices >= low - reach) & (truth.vertices <= high + reach)).all(axis=1))
    away = cKDTree(surface.vertices[filled]).query(truth.vertices[at], distance_upper_bound=reach)[0]
    at = at[np.isfinite(away)]
    # All that can be nearest to these.
    near = ((surface.vertices >= low - 3 * reach) & (surface.vertices <= high + 3 * reach)).all(axis=1)
    kept, faces = restrict(surface.faces, near)
    over = np.zeros(len(truth.vertices), bool)
    if len(at) == 0:
        return over, float("nan"), float("nan")
    surfaces = [surface.vertices[kept]]
    if int(filled.sum()) <= _MOST_SMOOTH:
        surfaces.append(without_relief(surface).vertices[kept])
    found = [_nearest(truth, at, vertices, faces, filled[kept], device) for vertices in surfaces]
    inside = np.any([inside for _, inside in found], axis=0)
    if not inside.any():
        return over, float("nan"), float("nan")
    over[at[inside]] = True
    rms = [float(np.sqrt((distance[inside] ** 2).mean())) for distance, _ in found]
    return over, rms[0], rms[1] if len(rms) > 1 else float("nan")


def _nearest(truth: Surface, at: Array, vertices: Array, faces: Array, filled: Array, device: str) -> tuple[Array, Array]:
    """Return the distances of the truth's vertices ``at`` from a mesh, and which of them lie over its filled part.

    Those whose nearest point is on the mesh's border lie beyond it; those that face the other way belong to another side.
    """
    face, weight = nearest_on_mesh(truth.vertices[at], vertices, faces, device)
    corner = faces[face]
    points = np.einsum("ik,ikc->ic", weight, vertices[corner])
    owed = (weight * filled[corner]).sum(axis=1)
    border = np.zeros(len(vertices), bool)
    border[np.unique(border_edges(faces))] = True
    beyond = (weight * ~border[corner]).sum(axis=1) < _OWED
    a, b, c = (vertices[corner[:, k]] for k in range(3))
    facing = np.einsum("ij,ij->i", np.cross(b - a, c - a), truth.normal[at]) > 0
    return np.linalg.norm(points - truth.vertices[at], axis=1), (owed > _OWED) & ~beyond & facing
