"""Displacement between the scan's vertices: relief taken from where a neighbourhood fits best, not from the vertex next to it.

Targets that don't continue the scan's lattice find their match between samples (3DIM 2005, section 4: a phase shift). From the
chosen sample the neighbourhood is moved over the scan until its difference is least (Gauss-Newton over two numbers), and the
displacement is read there. Relief between vertices is a polyharmonic spline through the nearest of them: straight
lines would flatten it (a wave of six samples loses a seventh of its height at the midpoints).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.mesh import border_edges, used_vertices
from intaglio.relief.ground import Ground
from intaglio.relief.growth.oversampling import blend_colors
from intaglio.relief.growth.samples import Samples
from intaglio.relief.growth.state import Picks, State

# Vertices that a spline goes through (three rings of a triangular lattice), and how far from one of them relief is still known,
# in spacings.
_NEIGHBORS, _KNOWN = 37, 1.0
# How much a neighbour counts that falls beside the scan's border: a spline that goes on to one side only is a poor one.
_AT_BORDER = 0.1
# The neighbourhood that is fitted reaches so far, and moves at most so far from its sample, in spacings.
_REACH, _FARTHEST = 4.0, 1.0
_STEPS = 6
# Damping of the steps, as a share of the mean squared slope: relief that has none along one direction is not moved along it.
_DAMPING = 1e-3
# Keeps systems of coinciding or collinear vertices solvable.
_RIDGE = 1e-9
_AT_ONCE, _FITTED_AT_ONCE = 512, 4096


class ReliefBetween:
    """The measured relief as a function between its vertices.

    Parameters
    ----------
    ground : Ground
    samples : Samples
        Relief is taken only where the nearest measured vertex is the source of one of them, and off the scan's border.
    """

    def __init__(self, ground: Ground, samples: Samples) -> None:
        self._ground = ground
        faces = ground.faces[ground.measured[ground.faces].all(axis=1)]
        self._given = np.flatnonzero(used_vertices(faces, len(ground.measured)))
        self._center = ground.foot.mean(axis=0)
        self._place = (ground.foot - self._center) / ground.spacing
        self._height = ground.height
        self._tree = cKDTree(self._place[self._given])
        self._everything = cKDTree(self._place)
        inner, allowed = np.zeros((2, len(ground.measured)), bool)
        inner[self._given] = True
        inner[np.unique(border_edges(faces))] = False
        allowed[samples.vertex] = True
        self._inner = inner[self._given]
        beside = ground.topology.graph @ (ground.measured & ~inner).astype(np.float32) > 0
        self._deep = self._inner & ~beside[self._given]
        self._allowed = allowed[self._given] & self._inner
        count, near = len(self._given), min(_NEIGHBORS, len(self._given))
        self._near = np.zeros((count, near), np.int32)
        self._weights = np.zeros((count, near + 3))
        self._fitted = np.zeros(count, bool)

    def inside(self, samples: Samples) -> Samples:
        """Return the samples two edges off the scan's border, so that places beside them lie off it; all, if none does."""
        nearest, _ = self._nearest((samples.foot - self._center) / self._ground.spacing)
        keep = np.flatnonzero(self._deep[nearest])
        return samples.part(keep) if len(keep) else samples

    def take(
        self, targets: Array, picks: Picks, window: Array, state: State, samples: Samples
    ) -> tuple[Array, Array, Array, Array | None]:
        """Return what each target takes: whether it lies between vertices (T,), height, source, colour.

        Where it does not, for the relief is not measured there, height, source and colour are those of its sample.

        Parameters
        ----------
        targets : (T,) array
            Vertices.
        picks : Picks
            Their matches, all found.
        window : (T,) array
            In spacings.
        state : State
            What is known around the targets.
        samples : Samples
            What the matches number.
        """
        chosen = picks.sample
        found = np.zeros(len(targets), bool)
        height, source = samples.height[chosen].copy(), samples.vertex[chosen].copy()
        color = None if samples.color is None else samples.color[chosen].copy()
        for first in range(0, len(targets), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            place = self._settle(targets[part], chosen[part], picks.rotation[part], window[part], state, samples)
            nearest, known = self._nearest(place)
            use = known & self._allowed[nearest]
            found[part] = use
            rows = first + np.flatnonzero(use)
            height[rows] = self._read(place[use], nearest[use])[0]
            source[rows] = self._given[nearest[use]]
            if color is not None and self._ground.color is not None:
                color[rows] = blend_colors(self._place[self._given], self._ground.color[self._given], place[use])
        return found, height, source, color

    def _settle(self, targets: Array, sample: Array, rotation: Array, window: Array, state: State, samples: Samples) -> Array:
        """Return where (T, 3) each target's neighbourhood fits best, beside its sample."""
        ground = self._ground
        lists = self._everything.query_ball_point(self._place[targets], np.minimum(window, _REACH) + 0.01, return_sorted=True)
        counts = np.array([len(near) for near in lists])
        row, near = np.repeat(np.arange(len(targets)), counts), np.concatenate(lists).astype(int)
        facing = np.einsum("ij,ij->i", ground.normal[near], ground.normal[targets[row]]) > 0.5
        use = state.textured[near] & facing & (near != targets[row])
        row, near = row[use], near[use]
        way = self._place[near] - self._place[targets[row]]
        x, y = (np.einsum("ij,ij->i", way, axis[targets[row]]) for axis in (ground.u, ground.v))
        up = np.einsum("ij,ij->i", way, ground.normal[targets[row]])
        c, s = np.cos(rotation[row]), np.sin(rotation[row])
        u, v = samples.u[sample], samples.v[sample]
        normal = np.cross(u, v)
        foot = (samples.foot[sample] - self._center) / ground.spacing
        laid = (c * x - s * y)[:, None] * u[row] + (s * x + c * y)[:, None] * v[row] + up[:, None] * normal[row] + foot[row]
        sigma = (2 * window[row] + 1) / 6.4
        weight = np.exp(-0.5 * ((x**2 + y**2) / sigma**2))
        height = state.height[near]
        count = len(targets)

        def summed(values: Array) -> Array:
            return np.bincount(row, values, count)

        move = np.zeros((count, 2))
        best, least = move.copy(), np.full(count, np.inf)
        for step in range(_STEPS):
            shifted = laid + move[row, :1] * u[row] + move[row, 1:] * v[row]
            nearest, known = self._nearest(shifted)
            value, slope = self._read(shifted, nearest)
            counted = weight * known * np.where(self._inner[nearest], 1.0, _AT_BORDER)
            off = height - value
            cost = summed(counted * off**2) / np.maximum(summed(counted), 1e-300)
            held, _ = self._nearest(foot + move[:, :1] * u + move[:, 1:] * v)
            better = (cost < least) & ((step == 0) | self._allowed[held])
            best[better], least[better] = move[better], cost[better]
            if step == _STEPS - 1:
                break
            p, q = (np.einsum("ij,ij->i", slope, axis[row]) for axis in (u, v))
            a, b, d = summed(counted * p * p), summed(counted * p * q), summed(counted * q * q)
            damping = _DAMPING * (a + d) + 1e-300
            a, d = a + damping, d + damping
            gp, gq = summed(counted * p * off), summed(counted * q * off)
            determinant = a * d - b * b
            move = best + np.stack([d * gp - b * gq, a * gq - b * gp], axis=1) / np.maximum(determinant, 1e-300)[:, None]
            move = move * np.minimum(1, _FARTHEST / np.maximum(np.linalg.norm(move, axis=1), 1e-300))[:, None]
        return foot + best[:, :1] * u + best[:, 1:] * v

    def _nearest(self, place: Array) -> tuple[Array, Array]:
        """Return the nearest of the given vertices (P,), and whether relief is known so near to it."""
        distance, nearest = self._tree.query(place)
        return nearest, distance <= _KNOWN

    def _read(self, place: Array, nearest: Array) -> tuple[Array, Array]:
        """Return relief (P,) at places by the spline of the nearest vertex, and its slope (P, 3) per spacing."""
        wanted = np.unique(nearest)
        self._fit(wanted[~self._fitted[wanted]])
        at = self._given[nearest]
        u, v = self._ground.u[at], self._ground.v[at]
        way = place - self._place[at]
        x, y = np.einsum("ij,ij->i", way, u), np.einsum("ij,ij->i", way, v)
        px, py = self._plane(nearest)
        dx, dy = x[:, None] - px, y[:, None] - py
        r = np.hypot(dx, dy)
        weights = self._weights[nearest]
        own, (constant, along, across) = weights[:, :-3], weights[:, -3:].T
        value = (own * r**3).sum(axis=1) + constant + along * x + across * y
        gx = (own * 3 * r * dx).sum(axis=1) + along
        gy = (own * 3 * r * dy).sum(axis=1) + across
        return value, gx[:, None] * u + gy[:, None] * v

    def _plane(self, numbers: Array) -> tuple[Array, Array]:
        """Return where the neighbours (P, K) of given vertices lie in their tangent planes, in spacings."""
        at = self._given[numbers]
        way = self._place[self._given[self._near[numbers]]] - self._place[at][:, None]
        x, y = (np.einsum("pkc,pc->pk", way, axis[at]) for axis in (self._ground.u, self._ground.v))
        return x, y

    def _fit(self, numbers: Array) -> None:
        """Lay a spline Σ w r³ + a + b x + c y through the relief of the nearest vertices of each given one."""
        count = self._near.shape[1]
        for first in range(0, len(numbers), _FITTED_AT_ONCE):
            part = numbers[first : first + _FITTED_AT_ONCE]
            self._near[part] = self._tree.query(self._place[self._given[part]], k=range(1, count + 1))[1]
            x, y = self._plane(part)
            system = np.zeros((len(part), count + 3, count + 3))
            system[:, :count, :count] = np.hypot(x[:, :, None] - x[:, None], y[:, :, None] - y[:, None]) ** 3
            linear = np.stack([np.ones_like(x), x, y], axis=2)
            system[:, :count, count:], system[:, count:, :count] = linear, linear.transpose(0, 2, 1)
            diagonal = np.arange(count + 3)
            system[:, diagonal, diagonal] += np.where(diagonal < count, _RIDGE, -_RIDGE)
            right = np.zeros((len(part), count + 3, 1))
            right[:, :count, 0] = self._height[self._given[self._near[part]]]
            self._weights[part] = np.linalg.solve(system, right)[:, :, 0]
            self._fitted[part] = True
