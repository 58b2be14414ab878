"""What belongs into a hole: the roughness and direction of its surroundings, carried on into it, and the filling's contrast.

Energies of the relief in bands and the direction of its slopes are known around a hole; their harmonic continuation says what is
expected in it.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, diags_array

from intaglio.arrays import Array
from intaglio.relief.coherent.averages import average, averaging, bands
from intaglio.relief.ground import Ground
from intaglio.sparse import factor_symmetric

# Over how many averages a band's energy is taken.
_SPREAD = (64, 64, 128)
# Energies, in squared spacings, below which nothing is told apart.
_FAINT = 1e-6
# By how much a band of the filling may be raised.
_MOST_GAIN = 2.0
_PASSES = 4


class Surroundings:
    """What is expected at every vertex of a ground, from what was measured.

    Parameters
    ----------
    ground : Ground
    height : (N,) array
        Measured relief in spacings.

    Attributes
    ----------
    likeness : (N, 3) array
        Logarithms of the energies in three bands, in standard deviations of the measured ones.
    direction : (N, 2) array
        Cosine and sine of twice the angle of the slopes in the local frame, as long as they have one direction: 0 to 1.
    """

    def __init__(self, ground: Ground, height: Array) -> None:
        self._measured = ground.measured
        self._graph = ground.topology.graph
        self._all = averaging(self._graph, np.ones(len(height), bool))
        own = self._own = averaging(self._graph, ground.measured)
        log = np.log(self._energy(height))
        log = (log - log[ground.measured].mean(axis=0)) / (log[ground.measured].std(axis=0) + 0.1)
        tensor = _slope_tensor(ground, average(own, height, 4), own)
        carried = self._carry_on(np.concatenate([log, tensor], axis=1))
        self.likeness, self._tensor = carried[:, :3], carried[:, 3:]
        self.direction = self.direction_in(ground)

    def direction_in(self, ground: Ground) -> Array:
        """Return `direction` in the frames of ``ground``."""
        uu, vv, uv = (_form(self._tensor, a, b) for a, b in ((ground.u, ground.u), (ground.v, ground.v), (ground.u, ground.v)))
        return np.stack([uu - vv, 2 * uv], axis=1)

    def raise_contrast(self, height: Array) -> Array:
        """Return heights (N,) whose bands, where the filling is flatter than expected, are raised; measured ones are kept.

        Copies lose the finest waves where they fall between measured vertices, and joining evens out what pieces disagree about.
        """
        filled = ~self._measured
        # Over the base that the heights are over.
        expected = self._carry_on(self._energy(np.where(filled, 0.0, height)))
        for _ in range(_PASSES):
            change = np.zeros(len(height))
            for k, (band, times) in enumerate(zip(bands(self._all, height), _SPREAD, strict=True)):
                own = average(self._all, band**2, times) + _FAINT
                gain = np.clip(np.sqrt(expected[:, k] / own), 1.0, _MOST_GAIN)
                gain[self._measured] = 1.0
                change += (average(self._all, gain, 4) - 1.0) * band
            height = np.where(filled, height + change, height)
        return height

    def _energy(self, height: Array) -> Array:
        """Return the energies (N, 3) of the bands around measured vertices, in squared spacings."""
        parts = zip(bands(self._own, height), _SPREAD, strict=True)
        return np.stack([average(self._own, band**2, 2 * times) for band, times in parts], axis=1) + _FAINT

    def _carry_on(self, values: Array) -> Array:
        """Return ``values`` (N, C) with those of targets harmonic: each the mean of its neighbours'."""
        targets = np.flatnonzero(~self._measured)
        rows = csr_array(self._graph[targets].astype(np.float64))
        degree = np.asarray(rows.sum(axis=1)).reshape(-1)
        right = rows @ np.where(self._measured[:, None], values, 0.0)
        out = values.copy()
        # A trifle keeps the system regular where a piece of targets touches nothing measured.
        out[targets] = factor_symmetric(csr_array(diags_array(degree + 1e-9) - rows[:, targets])).solve(right)
        return out


def slopes(points: Array, faces: Array, height: Array) -> tuple[Array, Array]:
    """Return the gradients (F, 3) of heights over faces, and twice the faces' areas (F,)."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    square = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-20)
    total = sum(height[faces[:, k], None] * np.cross(normal, side) for k, side in enumerate((c - b, a - c, b - a)))
    return np.asarray(total / square[:, None]), np.sqrt(square)


_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _slope_tensor(ground: Ground, height: Array, own: csr_array) -> Array:
    """Return the six entries (N, 6) of the mean outer product of slopes around measured vertices, of trace 1."""
    faces = ground.faces[ground.measured[ground.faces].all(axis=1)]
    slope, area = slopes(ground.foot / ground.spacing, faces, height)
    entries = np.stack([slope[:, i] * slope[:, j] for i, j in _PAIRS], axis=1) * area[:, None]
    corner = faces.reshape(-1)
    total = np.stack([np.bincount(corner, np.repeat(entries[:, k], 3), len(height)) for k in range(6)], axis=1)
    total = average(own, total, 32)
    return total / np.maximum(total[:, :3].sum(axis=1), 1e-12)[:, None]


def _form(tensor: Array, x: Array, y: Array) -> Array:
    """Return x' T y (N,) for symmetric tensors of six entries."""
    out = np.zeros(len(tensor))
    for k, (i, j) in enumerate(_PAIRS):
        out += tensor[:, k] * (x[:, i] * y[:, j] + (x[:, j] * y[:, i] if i != j else 0.0))
    return out
