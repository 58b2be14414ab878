"""Interpolation of coefficients between the lights of a stack: on a grid, over triangles, and smooth.

Eigen images have no formula for c(l) (Dong, section 4.4.4): their coefficients are known at the lights of the stack.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import Delaunay

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.photometric.bases import Basis, NumpyMaths
from intaglio.photometric.light_positions import tilt_and_slant


@dataclass(frozen=True)
class GridBasis:
    """Bilinear interpolation over a grid of tilt and slant (eq. 4.4.16).

    The tilt is periodic. Below the least slant the coefficients are constant; above the largest they fall with the cosine of the
    slant, to 0 at the horizon.

    Attributes
    ----------
    tilts, slants : (T,), (S,) float64 arrays
        In degrees, increasing.
    table : (T, S, n) float64 array
        Coefficients at the nodes.
    """

    tilts: Array
    slants: Array
    table: Array

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return int(self.table.shape[2])

    def evaluate(self, x: Any, y: Any, z: Any, maths: Any) -> list[Any]:
        """Return sums of hat functions of tilt and slant times the table."""
        degree = 180 / np.pi
        tilt = degree * maths.arctan2(y, x)
        slant = degree * maths.arctan2(maths.sqrt(x * x + y * y), z)
        slant = maths.minimum(maths.maximum(slant, float(self.slants[0])), float(self.slants[-1]))
        lowest = math.cos(math.radians(float(self.slants[-1])))
        fall = maths.minimum(maths.maximum(z, 0.0) / lowest, 1.0)
        # The tilt from the first node on, in [0, 360).
        turn = tilt - float(self.tilts[0])
        turn = maths.where(turn < 0, turn + 360, turn)
        turn = maths.where(turn >= 360, turn - 360, turn)
        around = np.append(self.tilts - self.tilts[0], 360.0)
        hats = [_hat(turn, around, i, maths) for i in range(len(around))]
        hats[0] = hats[0] + hats.pop()
        up = [_hat(slant, self.slants, j, maths) for j in range(len(self.slants))]
        result = []
        for k in range(self.size):
            total: Any = 0 * x
            for i, across in enumerate(hats):
                row: Any = 0 * x
                for j, along in enumerate(up):
                    row = row + float(self.table[i, j, k]) * along
                total = total + across * row
            result.append(total * fall)
        return result

    def parameters(self) -> dict[str, Any]:
        """Return the grid and its table."""
        return {
            "basis": "grid",
            "tilts": self.tilts.tolist(),
            "slants": self.slants.tolist(),
            "table": self.table.tolist(),
        }


def _hat(value: Any, nodes: Array, i: int, maths: Any) -> Any:
    """Return the piecewise linear function that is 1 at node i and 0 at the others."""
    result: Any = 0 * value + 1
    if i > 0:
        result = maths.minimum(result, (value - float(nodes[i - 1])) / float(nodes[i] - nodes[i - 1]))
    if i < len(nodes) - 1:
        result = maths.minimum(result, (float(nodes[i + 1]) - value) / float(nodes[i + 1] - nodes[i]))
    return maths.maximum(result, 0.0)


@dataclass(frozen=True)
class TriangleBasis:
    """Linear interpolation over a spherical triangulation of scattered lights.

    A light inside a triangle is l = b₁l₁ + b₂l₂ + b₃l₃ with b ≥ 0, and c(l) = b₁c₁ + b₂c₂ + b₃c₃: whatever is linear in the
    light vector, such as Lambert's law, is interpolated exactly; what is constant becomes too large by a factor of at most 1/cos
    of a triangle's radius. Outside the lights' hull the coefficients are those of the hull's nearest point, falling with the
    cosine of the slant to 0 at the horizon; rings of further nodes, down to below the horizon, hold them.

    Attributes
    ----------
    nodes : (M, 3) float64 array
        The lights, then the nodes of the rings.
    triangles : (T, 3) int array
        Nodes of every triangle.
    table : (M, n) float64 array
        Coefficients at the nodes.
    """

    nodes: Array
    triangles: Array
    table: Array

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return int(self.table.shape[1])

    def evaluate(self, x: Any, y: Any, z: Any, maths: Any) -> list[Any]:
        """Return the combination in the triangle in which the smallest of b₁, b₂, b₃ is largest."""
        best: Any = 0 * x - 1e30
        result: list[Any] = [0 * x for _ in range(self.size)]
        for corner in self.triangles:
            inverse = np.linalg.inv(self.nodes[corner].T)
            b = [float(r[0]) * x + float(r[1]) * y + float(r[2]) * z for r in inverse]
            least = maths.minimum(maths.minimum(b[0], b[1]), b[2])
            better = least > best
            best = maths.where(better, least, best)
            for k in range(self.size):
                value = sum(b[i] * float(self.table[corner[i], k]) for i in range(3))
                result[k] = maths.where(better, value, result[k])
        return result

    def parameters(self) -> dict[str, Any]:
        """Return nodes, triangles and table."""
        return {
            "basis": "triangles",
            "nodes": self.nodes.tolist(),
            "triangles": self.triangles.tolist(),
            "table": self.table.tolist(),
        }


CHARTS = ("stereographic", "azimuthal", "chord")
KERNELS = ("thin-plate", "cubic")
TRENDS = ("lambert", "chart")


def chart(name: str, x: Any, y: Any, z: Any, maths: Any) -> list[Any]:
    """Return the coordinates in which distances between lights are measured.

    ``"stereographic"``: (x, y) / (1 + z); ``"azimuthal"``: the slant in radians along the tilt; ``"chord"``: the vector itself.
    """
    if name == "stereographic":
        return [x / (1 + z), y / (1 + z)]
    if name == "azimuthal":
        across = maths.sqrt(x * x + y * y)
        stretch = maths.where(across > 1e-9, maths.arctan2(across, z) / maths.maximum(across, 1e-9), 0 * x + 1)
        return [x * stretch, y * stretch]
    return [x, y, z]


def trend_of(name: str, chart_name: str, x: Any, y: Any, z: Any, maths: Any) -> list[Any]:
    """Return the functions of a trend, 1 first."""
    return [0 * x + 1, *((x, y, z) if name == "lambert" else chart(chart_name, x, y, z, maths))]


def radial(name: str, squared: Any, maths: Any) -> Any:
    """Return the radial function of a squared distance: r² log r (thin plate) or r³."""
    if name == "thin-plate":
        return 0.5 * squared * maths.log(maths.maximum(squared, 1e-30))
    return squared * maths.sqrt(squared)


@dataclass(frozen=True)
class RadialBasis:
    """Smooth interpolation over the hemisphere by radial functions about the lights, and a trend.

    c(l) = Σᵢ φ(|p(l) − p(lᵢ)|) wᵢ + v₀ + Σⱼ vⱼ tⱼ(l); the trend's functions t are x, y, z (``"lambert"``, for which Lambert's
    law is exact) or the coordinates p themselves (``"chart"``).

    Attributes
    ----------
    lights : (K, 3) float64 array
        Unit vectors lᵢ.
    weights : (K, n) float64 array
        The weights w.
    drift : (d, n) float64 array
        The coefficients v of the trend.
    chart, kernel, trend : str
        One each of `CHARTS`, `KERNELS` and `TRENDS`.
    smoothing : float
        The smoothing with which the weights were found.
    """

    lights: Array
    weights: Array
    drift: Array
    chart: str
    kernel: str
    trend: str
    smoothing: float = 0.0

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return int(self.weights.shape[1])

    def evaluate(self, x: Any, y: Any, z: Any, maths: Any) -> list[Any]:
        """Return the sums."""
        here = chart(self.chart, x, y, z, maths)
        there = chart(self.chart, self.lights[:, 0], self.lights[:, 1], self.lights[:, 2], NumpyMaths)
        trend = trend_of(self.trend, self.chart, x, y, z, maths)
        result = [sum(float(v) * t for v, t in zip(d, trend, strict=True)) for d in self.drift.T]
        for i in range(len(self.lights)):
            squared = sum((h - float(t[i])) * (h - float(t[i])) for h, t in zip(here, there, strict=True))
            phi = radial(self.kernel, squared, maths)
            result = [r + phi * float(w) for r, w in zip(result, self.weights[i], strict=True)]
        return result

    def parameters(self) -> dict[str, Any]:
        """Return lights, weights, drift and names."""
        return {
            "basis": "radial",
            "lights": self.lights.tolist(),
            "weights": self.weights.tolist(),
            "drift": self.drift.tolist(),
            "chart": self.chart,
            "kernel": self.kernel,
            "trend": self.trend,
            "smoothing": self.smoothing,
        }


def grid_of(lights: Array, tolerance: float = 1.0) -> tuple[Array, Array, Array] | None:
    """Return tilts (T,), slants (S,) and the (T, S) numbers of the lights if they form a full grid, else None.

    A light from straight above belongs to every tilt. Angles are in degrees; a light within ``tolerance`` of a node is on it.
    """
    tilt, slant = tilt_and_slant(lights)
    zenith = np.flatnonzero(slant < tolerance)
    rest = np.flatnonzero(slant >= tolerance)
    if len(zenith) > 1 or len(rest) < 4:
        return None
    tilts, slants = _levels(tilt[rest], tolerance, 360.0), _levels(slant[rest], tolerance, None)
    if len(tilts) < 3 or len(rest) != len(tilts) * len(slants) or len(slants) + len(zenith) < 2:
        return None
    numbers = np.full((len(tilts), len(slants)), -1)
    for k in rest:
        away = np.abs((tilts - tilt[k] + 180) % 360 - 180)
        numbers[np.argmin(away), np.argmin(np.abs(slants - slant[k]))] = k
    if (numbers < 0).any():
        return None
    if len(zenith):
        slants = np.concatenate([[0.0], slants])
        numbers = np.concatenate([np.full((len(tilts), 1), zenith[0]), numbers], axis=1)
    return tilts, slants, numbers


def _levels(values: Array, tolerance: float, period: float | None) -> Array:
    """Return the means of runs of values that lie within ``tolerance`` of each other."""
    ordered = np.sort(values)
    if period is not None and len(ordered) and ordered[-1] > period - tolerance:
        ordered = np.sort(np.where(ordered > period - tolerance, ordered - period, ordered))
    runs = np.split(ordered, np.flatnonzero(np.diff(ordered) > tolerance) + 1)
    return np.array([run.mean() for run in runs if len(run)])


def need_spread(lights: Array) -> None:
    """Raise `InputError` if the lights lie at one point or on one line of the hemisphere."""
    places = _plane_of(lights)
    if len(lights) < 3 or np.linalg.svd(places - places.mean(axis=0), compute_uv=False)[-1] < 1e-2:
        raise InputError("the lights lie on one line of the hemisphere; interpolation between them needs lights around it")


def triangulate(lights: Array, table: Array) -> TriangleBasis:
    """Return linear interpolation of ``table`` (K, n) over ``lights`` (K, 3).

    Raises
    ------
    InputError
        If the lights are fewer than three or all in one plane with the sample's centre.
    """
    need_spread(lights)
    places = _plane_of(lights)
    hull = Delaunay(places)
    # The rings are 12 degrees apart, so that triangles are small and the sum of b is near 1; the lowest encloses the hemisphere.
    slant, tilt = (a.ravel() for a in np.meshgrid(np.radians(np.arange(4, 101, 12)), np.radians(np.arange(0, 360, 15))))
    ring = np.stack([np.cos(tilt) * np.sin(slant), np.sin(tilt) * np.sin(slant), np.cos(slant)], axis=1)
    start, end = (places[hull.convex_hull[:, i]] for i in (0, 1))
    point = _plane_of(ring)[:, None]
    along = np.clip(((point - start) * (end - start)).sum(axis=2) / ((end - start) ** 2).sum(axis=1), 0, 1)
    away = np.linalg.norm(start + along[..., None] * (end - start) - point, axis=2)
    nearest = np.argmin(away, axis=1)
    # No node lies in a circle over an edge of the hull, so that these remain edges and the triangles inside don't change.
    apart = np.linalg.norm((start + end) / 2 - point, axis=2) > 0.501 * np.linalg.norm(end - start, axis=1)
    outside = (hull.find_simplex(point[:, 0]) < 0) & apart.all(axis=1) & (away.min(axis=1) > 0.02)
    ring, nearest, t = ring[outside], nearest[outside], along[np.arange(len(along)), nearest][outside][:, None]
    first, second = hull.convex_hull[nearest].T
    nodes = np.concatenate([lights, ring])
    held = (1 - t) * table[first] + t * table[second]
    cosine = (1 - t) * lights[first, 2:] + t * lights[second, 2:]
    values = np.concatenate([table, held * np.clip(ring[:, 2:] / cosine, 0, 1)])
    corners = Delaunay(_plane_of(nodes)).simplices
    corners = corners[np.abs(np.linalg.det(nodes[corners])) > 1e-9]
    return TriangleBasis(nodes, corners.astype(np.int64), values)


def _plane_of(lights: Array) -> Array:
    """Return stereographic coordinates (K, 2): they preserve circles, so Delaunay's triangles are those of the sphere."""
    return np.stack(chart("stereographic", lights[:, 0], lights[:, 1], lights[:, 2], NumpyMaths), axis=1)


def interpolate(lights: Array, table: Array, scheme: str = "auto") -> Basis:
    """Return a basis that takes the values ``table`` (K, n) at ``lights`` (K, 3) and is linear between them.

    Parameters
    ----------
    lights, table : (K, 3), (K, n) arrays
        Unit vectors, and the coefficients there.
    scheme : {"auto", "grid", "triangles"}
        Bilinear in tilt and slant, or triangulated; ``"auto"`` takes the grid where the lights form one.

    Raises
    ------
    InputError
        If the lights form no grid and one is asked for, or can't be triangulated.
    """
    grid = grid_of(lights) if scheme != "triangles" else None
    if grid is not None:
        tilts, slants, numbers = grid
        return GridBasis(tilts, slants, table[numbers])
    if scheme == "grid":
        raise InputError("the lights form no full grid of tilts and slants; use interpolation='triangles'")
    return triangulate(lights, table)


def smooth_matrix(lights: Array, chart_name: str, kernel: str, trend: str, smoothing: float) -> tuple[Array, list[int]]:
    """Return the system of smooth interpolation and the functions of the trend that it uses.

    The system is [[Φ + λE, D], [Dᵀ, 0]]; its solution for [values; 0] is weights and drift. D holds the trend's functions at
    the lights, except those that are linearly dependent there.

    Returns
    -------
    system : (K + d, K + d) float64 array
        The system.
    used : list of int
        Which functions D holds.
    """
    places = np.stack(chart(chart_name, lights[:, 0], lights[:, 1], lights[:, 2], NumpyMaths), axis=1)
    squared = ((places[:, None] - places[None]) ** 2).sum(axis=2)
    full = np.stack(trend_of(trend, chart_name, lights[:, 0], lights[:, 1], lights[:, 2], NumpyMaths), axis=1)
    used: list[int] = []
    for c in range(full.shape[1]):
        values = np.linalg.svd(full[:, [*used, c]], compute_uv=False)
        if values[-1] > 1e-3 * values[0]:
            used.append(c)
    d = full[:, used]
    system = np.zeros((len(lights) + len(used),) * 2)
    system[: len(lights), : len(lights)] = radial(kernel, squared, NumpyMaths) + smoothing * np.eye(len(lights))
    system[: len(lights), len(lights) :] = d
    system[len(lights) :, : len(lights)] = d.T
    return system, used


def smooth(lights: Array, table: Array, chart_name: str, kernel: str, trend: str, smoothing: float) -> RadialBasis:
    """Return a smooth basis that takes the values ``table`` (K, n) at ``lights`` (K, 3), or nearly so if ``smoothing`` > 0."""
    system, used = smooth_matrix(lights, chart_name, kernel, trend, smoothing)
    right = np.concatenate([table, np.zeros((len(used), table.shape[1]))])
    solution = np.linalg.solve(system, right)
    drift = np.zeros((len(trend_of(trend, chart_name, lights[:, 0], lights[:, 1], lights[:, 2], NumpyMaths)), table.shape[1]))
    drift[np.array(used, int)] = solution[len(lights) :]
    return RadialBasis(lights, solution[: len(lights)], drift, chart_name, kernel, trend, smoothing)
