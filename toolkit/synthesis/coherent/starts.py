"""Where synthesis by coherent pieces begins: blocks on a coarse level that use the sample evenly, chosen by trial."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.kernels.blocks import BlockLayer, Sample
from intaglio.randomness import Stream, uniform
from intaglio.synthesis.layout import plan_blocks
from intaglio.synthesis.nearest import NearestWindows, rms_difference
from intaglio.synthesis.sample import window_starts
from intaglio.synthesis.trial import patch_distance

# Sides of blocks that are tried, in shares of the sample's shorter side, and how strongly use counts against fit: the weight of
# a candidate's use, and the most that a block may exceed the least difference.
_SHARES = (0.2, 0.28, 0.36, 0.44)
_EVENNESS = ((1.0, 0.4), (4.0, 1.0), (16.0, 4.0))

# A trial lays a square so many times as wide as the sample; so many of the best are tried again on the whole canvas.
_WIDTH, _FINALISTS = 1.5, 3

# Windows whose nearest ones in the sample tell whether blocks meet well: their side, how many, and among how many.
_WINDOW, _WINDOWS, _AMONG = 12, 1_000, 6_000

# Power of the windows' distance in a trial's score, beside the distance of the patches' distribution.
_FIT = 2.0


@dataclass(frozen=True)
class Start:
    """The first arrangement: blocks' side on the coarse level, its weights, and where pixels are copied from."""

    side: int
    evenness: tuple[float, float]
    source: Array
    tried: int


def begin(
    planes: Array,
    usable: Array,
    shape: tuple[int, int],
    *,
    block: int | None,
    wrap: bool,
    squared: bool,
    seed: int,
    device: str,
) -> Start | None:
    """Return blocks laid on a canvas of ``shape``, those whose trial resembled the sample most; None if no block fits.

    Parameters
    ----------
    planes : (n, h, w) float32 array
        The sample on the coarsest level, as it is compared.
    usable : (h, w) bool array
    shape : (int, int)
        Rows and columns of the canvas on that level.
    block : int, optional
        Side of a block on that level. None: by trial.
    wrap : bool
        The canvas is a torus.
    squared : bool
        Blocks are compared by squared differences.
    seed : int
    device : str
    """
    shorter = min(*usable.shape, *shape) if wrap else min(usable.shape)
    wanted = [block] if block is not None else [round(share * min(usable.shape)) for share in _SHARES]
    sides = sorted({int(np.clip(side, 2, shorter)) for side in wanted})
    sides = [side for side in sides if window_starts(usable, side).any()]
    if not sides and block is None:
        smaller = [side for side in range(2, shorter + 1) if window_starts(usable, side).any()]
        sides = smaller[-1:]
    if not sides:
        return None

    def lay(side: int, evenness: tuple[float, float], shape: tuple[int, int], wrap: bool) -> Array:
        lap = max(1, round(side / 3))
        blocks = plan_blocks(shape, side, lap, tileable=wrap, continued=False)
        layer = BlockLayer(
            Sample(planes, window_starts(usable, side)),
            blocks,
            squared=squared,
            tolerance=evenness[1],
            shortcut=False,
            radius=-1,
            uniform=uniform(seed, Stream.SYNTHESIS_START, blocks.origin[:, 0], blocks.origin[:, 1]),
            device=device,
            evenness=evenness[0],
        )
        layer.lay()
        return layer.canvas[: shape[0], : shape[1]]

    longest = round(_WIDTH * max(usable.shape))
    size = (min(shape[0], longest), min(shape[1], longest))
    trials = [(side, evenness) for side in sides for evenness in _EVENNESS]
    likeness = _Likeness(planes, usable, seed)
    if len(trials) > 1:
        scores = [likeness.score(lay(*trial, size, False)) for trial in trials]
        trials = [trials[k] for k in np.argsort(scores, kind="stable")[:_FINALISTS]]
    found = [lay(*trial, shape, wrap) for trial in trials]
    best = int(np.argmin([likeness.score(source) for source in found])) if len(found) > 1 else 0
    return Start(*trials[best], found[best], len(sides) * len(_EVENNESS))


class _Likeness:
    """Scores small results: how far their patches are distributed from the sample's, and how far windows are from any of it."""

    def __init__(self, planes: Array, usable: Array, seed: int) -> None:
        self._planes, self._usable, self._seed = planes, usable, seed
        self._side = min(_WINDOW, *usable.shape)
        corner = np.argwhere(window_starts(usable, self._side))
        corner = corner[np.linspace(0, len(corner) - 1, min(len(corner), _AMONG)).astype(int)] if len(corner) else corner
        self._among = _windows(planes, corner, self._side)
        half = len(corner) // 2
        apart = self._among[:half] - self._among[half : 2 * half]
        self._typical = float(np.sqrt(np.mean(apart**2))) if half else 0.0
        self._nearest = NearestWindows(self._among) if self._typical > 0 else None

    def score(self, source: Array) -> float:
        """Return the score of what ``source`` (H, W, 2) copies; the less, the more alike."""
        made = self._planes[:, source[..., 0], source[..., 1]]
        height, width = source.shape[:2]
        off = patch_distance(made, self._planes, self._usable, self._seed)
        if self._nearest is None or min(height, width) < self._side:
            return off
        draw = [uniform(self._seed, Stream.SYNTHESIS_START, -1 - k, np.arange(_WINDOWS)) for k in range(2)]
        corner = np.stack([d * (n - self._side + 1) for d, n in zip(draw, (height, width), strict=True)], axis=1).astype(int)
        query = _windows(made, corner, self._side)
        away = rms_difference(self._among[self._nearest.find(query)], query)
        return off * (float(np.sqrt(np.mean(away**2))) / self._typical) ** _FIT


def _windows(planes: Array, corner: Array, side: int) -> Array:
    """Return windows (M, n side^2) of planes (n, H, W) that begin at ``corner`` (M, 2)."""
    at = np.arange(side)
    y, x = corner[:, 0, None, None] + at[None, :, None], corner[:, 1, None, None] + at[None, None, :]
    return np.ascontiguousarray(np.moveaxis(planes[:, y, x], 0, 1).reshape(len(corner), -1), np.float32)
