"""Counter-based random numbers: a pure function of the seed and of what they are for.

The same seed gives the same bits whatever the number of threads or the order of work.
"""

from __future__ import annotations

import numpy as np

from intaglio.errors import InputError

_GAMMA = np.uint64(0x9E3779B97F4A7C15)


def _mix(z: np.ndarray) -> np.ndarray:
    """Return the bits of ``z`` mixed by SplitMix64's finaliser (Steele, Lea & Flood 2014)."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def uniform(seed: int, stream: int, *keys: np.ndarray | int) -> np.ndarray:
    """Return numbers in [0, 1), one for every element of the broadcast integer ``keys``.

    Parameters
    ----------
    seed : int
        The user's seed, any integer.
    stream : int
        Says what the numbers are for, so that two uses never share them.
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
