"""Joining: heights whose differences along edges are those of the sources, held to the rim (Poisson on the surface)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from scipy.sparse import coo_array, csr_array, diags_array

from intaglio.arrays import Array
from intaglio.kernels.correspondence import Field, wish_kernel
from intaglio.kernels.launch import launch, upload
from intaglio.relief.coherent.tables import SurfaceTables
from intaglio.sparse import factor_symmetric

# What an edge weighs that no source knows: flat, if nothing else is said.
_UNKNOWN = 0.02
# Two sources are neighbours where the place that one implies for the other lies this close to it, in spacings.
_NEIGHBOR = 1.5


@dataclass(frozen=True)
class Wishes:
    """What the sources say about the edges from targets i to vertices j, targets or not.

    Attributes
    ----------
    first, other : (E,) arrays
        i and j.
    difference : (E,) array
        h_j - h_i at the source of i, in spacings.
    known : (E,) bool array
        Whether the source is measured at both ends.
    height : (E,) array
        h_i at the source of i, in spacings.
    agrees : (E,) bool array
        Whether j has its source where that of i implies it; False where j is measured.
    """

    first: Array
    other: Array
    difference: Array
    known: Array
    height: Array
    agrees: Array


def ask_sources(tables: SurfaceTables, field: Field, height: Array, measured: Array) -> Wishes:
    """Return the sources' wishes for every edge of a target.

    Parameters
    ----------
    tables : SurfaceTables
    field : Field
    height : (N,) array
        Measured relief in spacings.
    measured : (N,) bool array
    """
    device = tables.device
    entry = np.flatnonzero(~measured[tables.first])
    first, other = tables.first[entry], tables.other[entry]
    count = len(entry)
    difference, known, own = (wp.zeros(count, dtype=wp.float32, device=device) for _ in range(3))
    reached = wp.zeros(count, dtype=wp.int32, device=device)
    launch(
        wish_kernel,
        count,
        inputs=[
            upload(first, wp.int32, device),
            upload(entry, wp.int32, device),
            tables.steps,
            tables.mesh,
            upload(height, wp.float32, device),
            upload(measured, wp.uint8, device),
            field,
        ],
        outputs=[difference, known, own, reached],
        device=device,
    )
    implied = np.asarray(reached.numpy())
    place = field.place.numpy()[other]
    apart = np.linalg.norm(tables.foot[implied] - tables.foot[place], axis=1)
    agrees = (implied >= 0) & (place >= 0) & (apart < _NEIGHBOR) & ~measured[other]
    said = difference.numpy().astype(np.float64), known.numpy() > 0, own.numpy().astype(np.float64)
    return Wishes(first, other, *said, agrees)


def coherence(wishes: Wishes, measured: Array) -> float:
    """Return the share of the edges between targets whose two sources are neighbours."""
    inner = ~measured[wishes.other]
    return float(wishes.agrees[inner].mean()) if inner.any() else 1.0


@dataclass(frozen=True)
class Anchors:
    """Vertices (K,) whose heights are known to be about ``height`` (K,), each as sure as ``weight`` edges."""

    vertices: Array
    height: Array
    weight: float


def join(wishes: Wishes, height: Array, active: Array, pull: float = 0.0, anchors: Anchors | None = None) -> Array:
    """Return heights (N,) that fulfil the wishes of active targets in the least squares; all others keep theirs.

    Minimises the sum over edges of (h_j - h_i - wish)^2 + pull (h_i - h_source)^2; inside a piece all wishes agree.

    Parameters
    ----------
    wishes : Wishes
    height : (N,) array
        Held where measured.
    active : (N,) bool array
        The targets to solve for; edges to other targets don't count.
    pull : float
        How much the sources' own heights count: 0 where the base below them is not certain.
    anchors : Anchors, optional
        Adds weight (h_k - height)^2 for each.
    """
    targets = np.flatnonzero(active)
    held = np.ones(len(height), bool)
    held[wishes.first] = False
    use = active[wishes.first] & (active | held)[wishes.other]
    number = np.full(len(height), -1)
    number[targets] = np.arange(len(targets))
    a, b = number[wishes.first[use]], number[wishes.other[use]]
    weight = np.where(wishes.known[use], 1.0, _UNKNOWN)
    wish = np.where(wishes.known[use], wishes.difference[use], 0.0) * weight
    inner = b >= 0
    count = len(targets)
    diagonal = np.bincount(a, weight, count) + np.bincount(b[inner], weight[inner], count)
    right = np.bincount(b[inner], wish[inner], count) - np.bincount(a, wish, count)
    drawn = pull * wishes.known[use]
    diagonal += np.bincount(a, drawn, count)
    right += np.bincount(a, drawn * wishes.height[use], count)
    if anchors is not None:
        own = active[anchors.vertices]
        at = number[anchors.vertices[own]]
        diagonal += np.bincount(at, np.full(len(at), anchors.weight), count)
        right += np.bincount(at, anchors.weight * anchors.height[own], count)
    outer = wishes.other[use][~inner]
    right += np.bincount(a[~inner], weight[~inner] * height[outer], count)
    pairs = np.concatenate([a[inner], b[inner]]), np.concatenate([b[inner], a[inner]])
    graph = coo_array((np.tile(weight[inner], 2), pairs), shape=(count, count))
    out = height.copy()
    # A trifle keeps the system regular where targets touch nothing measured.
    out[targets] = factor_symmetric(csr_array(diags_array(diagonal + 1e-9) - graph)).solve(right)
    return out
