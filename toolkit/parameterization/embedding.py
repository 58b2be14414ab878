"""Linear embeddings with a convex border: one sparse solve, no triangle flipped (Tutte, Floater)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.parameterization.charts import Chart, doubled_texture_areas, flat_edges, invert_matrices, squared_stretches


def convex_border(chart: Chart, shape: str) -> Array:
    """Return positions (B, 2) of the chart's border on a circle or square inscribed in [0, 1]^2, by chord length.

    A square's corners take the border vertices next to the quarters of its length.
    """
    points = chart.vertices[chart.loop]
    lengths = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    along /= along[-1]
    if shape == "circle":
        angle = 2 * np.pi * along[:-1]
        return 0.5 + 0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    count = len(points)
    if count < 4:
        raise InputError(f"a border of {count} vertices can't be laid on a square; use boundary='circle' or 'free'")
    corner = np.array([np.argmin(np.abs(along[:-1] - q / 4)) for q in range(4)])
    if len(np.unique(corner)) < 4:
        raise InputError("the border is too uneven for a square: one edge spans two corners; use boundary='circle' or 'free'")
    ends = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    placed = np.zeros((count, 2))
    for side in range(4):
        first, last = corner[side], corner[side + 1] if side < 3 else count
        part = (along[first : last + 1] - along[first]) / (along[last] - along[first])
        spot = np.arange(first, last)
        placed[spot] = ends[side] + part[: len(spot), None] * (ends[side + 1] - ends[side])
    return placed


def embed(weights: csr_array, chart: Chart, border: Array) -> Array:
    """Return positions (N, 2): border vertices at ``border``, every other at the weighted mean of its neighbours."""
    count = len(chart.vertices)
    inside = np.ones(count, bool)
    inside[chart.loop] = False
    uv = np.zeros((count, 2))
    uv[chart.loop] = border
    if not inside.any():
        return uv
    rows = weights[inside]
    own = np.asarray(rows.sum(axis=1)).reshape(-1)
    system = coo_array((own, (np.arange(len(own)), np.arange(len(own)))), shape=(len(own),) * 2) - rows[:, inside]
    uv[inside] = splu(system.tocsc()).solve(np.asarray(rows[:, ~inside] @ uv[~inside]))
    return uv


def mean_value_weights(chart: Chart) -> csr_array:
    """Return Floater's mean value coordinates (2003) as a matrix (N, N): positive, so that nothing flips."""
    half = _tangents_of_half_angles(chart)
    return _per_edge(chart, half, half, inverse_power=1)


def uniform_weights(chart: Chart) -> csr_array:
    """Return ones for joined vertices: Tutte's embedding, which tolerates badly shaped triangles best."""
    ones = np.ones(chart.faces.shape)
    return _per_edge(chart, ones, ones, inverse_power=0)


def intrinsic_weights(chart: Chart, share: float) -> csr_array:
    """Return ``share`` of the conformal and the rest of the authalic weights (Desbrun, Meyer & Alliez 2002, section 3).

    Both are cotangents: conformal of the angles opposite an edge, authalic of those beside it, over its squared length. Where
    they are negative, triangles may flip.
    """
    corner = chart.vertices[chart.faces]
    cotangent = np.empty(chart.faces.shape)
    for k in range(3):
        p, q = corner[:, (k + 1) % 3] - corner[:, k], corner[:, (k + 2) % 3] - corner[:, k]
        cotangent[:, k] = np.einsum("ij,ij->i", p, q) / np.linalg.norm(np.cross(p, q), axis=1)
    count = len(chart.vertices)
    # Authalic weights are per area: the mean squared edge makes the two comparable.
    scale = float(np.mean((corner - np.roll(corner, -1, axis=1)) ** 2) * 3)
    rows, columns, values = [], [], []
    for k in range(3):
        i, j = chart.faces[:, k], chart.faces[:, (k + 1) % 3]
        squared = np.sum((corner[:, k] - corner[:, (k + 1) % 3]) ** 2, axis=1)
        opposite = share * cotangent[:, (k + 2) % 3]
        # Row i: the angle at j, beside the edge; row j: the angle at i.
        for a, b, beside in ((i, j, cotangent[:, (k + 1) % 3]), (j, i, cotangent[:, k])):
            rows.append(a)
            columns.append(b)
            values.append(opposite + (1 - share) * beside * scale / squared)
    table = coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count))
    return csr_array(table)


def _tangents_of_half_angles(chart: Chart) -> Array:
    """Return tan(angle / 2) at every corner, (F, 3): (|p||q| - p.q) / |p x q|."""
    corner = chart.vertices[chart.faces]
    tangent = np.empty(chart.faces.shape)
    for k in range(3):
        p, q = corner[:, (k + 1) % 3] - corner[:, k], corner[:, (k + 2) % 3] - corner[:, k]
        lengths = np.linalg.norm(p, axis=1) * np.linalg.norm(q, axis=1)
        cross = np.linalg.norm(np.cross(p, q), axis=1)
        # sin / (1 + cos) where the angle is acute: the other form cancels there, down to nothing over nothing.
        dot = np.einsum("ij,ij->i", p, q)
        with np.errstate(divide="ignore", invalid="ignore"):
            tangent[:, k] = np.where(dot > 0, cross / (lengths + dot), (lengths - dot) / cross)
    return tangent


def _per_edge(chart: Chart, ahead: Array, behind: Array, *, inverse_power: int) -> csr_array:
    """Return the matrix whose row i holds, for each neighbour j, the corner values at i beside edge (i, j) over its length."""
    rows, columns, values = [], [], []
    count = len(chart.vertices)
    corner = chart.vertices[chart.faces]
    for k in range(3):
        i = chart.faces[:, k]
        for side, value in ((1, ahead[:, k]), (2, behind[:, k])):
            length = np.linalg.norm(corner[:, (k + side) % 3] - corner[:, k], axis=1)
            rows.append(i)
            columns.append(chart.faces[:, (k + side) % 3])
            values.append(value / length**inverse_power)
    table = coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(count, count))
    return csr_array(table)


def relax_stretch(chart: Chart, shape: str, importance: Array, *, most: int = 30) -> Array:
    """Return an embedding (N, 2) without flips and of low stretch, as a start for the minimisation.

    Weights are divided by the stretch found at each neighbour, and the system is solved again while the stretch falls
    (Yoshizawa, Belyaev & Seidel, A fast and simple stretch-minimizing mesh parameterization, 2004). All weights stay positive.

    Parameters
    ----------
    chart : Chart
    shape : {"circle", "square"}
    importance : (F,) array
        Weight of each triangle's squared stretch.
    most : int
        Solves, at most.
    """
    uv, weights = embed_without_flips(chart, shape)
    border = uv[chart.loop]
    rest = invert_matrices(flat_edges(chart.vertices, chart.faces))
    squared = squared_stretches(uv, chart.faces, rest)
    for _ in range(most):
        corners = chart.faces.reshape(-1)
        total = np.bincount(corners, np.repeat(importance, 3), len(uv))
        at = np.bincount(corners, np.repeat(importance * squared, 3), len(uv)) / total
        weights = weights @ diags_array(1 / np.sqrt(at / at.mean()))
        trial = embed(weights, chart, border)
        if not (np.isfinite(trial).all() and (doubled_texture_areas(trial, chart.faces) > 0).all()):
            break
        now = squared_stretches(trial, chart.faces, rest)
        before, after = float(importance @ squared), float(importance @ now)
        if not after < before:
            break
        uv, squared = trial, now
        if after > 0.95 * before:
            break
    return uv


def embed_without_flips(chart: Chart, shape: str) -> tuple[Array, csr_array]:
    """Return an embedding (N, 2) without flips, by mean values, or by uniform weights where rounding flips a triangle.

    Also the weights, (N, N).

    Raises
    ------
    InputError
        If neither works.
    """
    border = convex_border(chart, shape)
    for made in (mean_value_weights, uniform_weights):
        weights = made(chart)
        uv = embed(weights, chart, border)
        if np.isfinite(uv).all() and (doubled_texture_areas(uv, chart.faces) > 0).all():
            return uv, weights
    flat = int((doubled_texture_areas(uv, chart.faces) <= 0).sum())
    if shape == "square":
        raise InputError(
            f"{flat} triangles would be flat on a square, all their corners lie on one side; use boundary='circle' or 'free'"
        )
    raise InputError(
        f"{flat} triangles would be flat or flipped on a circle: the surface is too closed for its border, or has needles; "
        "allow more seams"
    )
