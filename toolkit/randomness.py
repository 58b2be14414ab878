"""Counter-based random numbers: a pure function of the seed and of what they are for.

The same seed gives the same bits whatever the number of threads or the order of work.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError

_GAMMA = np.uint64(0x9E3779B97F4A7C15)


class Stream(IntEnum):
    """What random numbers are for: every use in Intaglio has a stream of its own, so that no two share numbers.

    A number that stands here is never given to another use: it would change the bits of finished work.
    """

    RELIEF_PICK = 1
    RELIEF_SHUFFLE = 2
    RELIEF_REFINE = 3
    RELIEF_LANDMARKS = 4
    RELIEF_THINNING = 5
    RELIEF_LEVELS = 6
    RELIEF_NOISE = 7
    RELIEF_SUBSAMPLING = 8
    RELIEF_SWEEP = 9
    QUILT_CHOICE = 40
    GROW_EXHAUSTIVE = 41
    GROW_START = 42
    SYNTHESIS_DIRECTIONS = 43
    SYNTHESIS_TRIAL = 44
    SYNTHESIS_SWEEP = 45
    SYNTHESIS_START = 46
    RESTORATION_SWEEP = 47
    POINTS_THINNING = 62
    POINTS_PLACES = 63
    GEOMETRY_PATCH = 64


def _mix(z: Array) -> Array:
    """Return the bits of ``z`` mixed by SplitMix64's finaliser (Steele, Lea & Flood 2014)."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def uniform(seed: int, stream: int, *keys: Array | int) -> Array:
    """Return numbers in [0, 1), one for every element of the broadcast integer ``keys``.

    Parameters
    ----------
    seed : int
        The user's seed, any integer.
    stream : Stream or int
        What the numbers are for.
    keys : integer arrays
        Element numbers, such as vertex and attempt.
    """
    with np.errstate(over="ignore"):
        state = _mix(np.array(int(seed) & 0xFFFFFFFFFFFFFFFF, np.uint64) + _GAMMA * np.uint64(stream + 1))
        for key in np.broadcast_arrays(*[np.asarray(k) for k in keys]):
            state = _mix(state * _GAMMA + key.astype(np.int64).view(np.uint64) + _GAMMA)
    return (np.asarray(state) >> np.uint64(11)).astype(np.float64) * 2.0**-53


def checked_seed(seed: int) -> int:
    """Return ``seed`` as an int, or raise `InputError` for what is none."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer):
        raise InputError(f"seed must be an integer, not {seed!r}")
    return int(seed)
