"""Nearest windows: for many windows, the most similar of a set, by matrix products on principal components."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array
from intaglio.kernels.launch import run_parallel, single_threaded_blas

# Principal components that are compared; windows of natural textures have little beyond them.
COMPONENTS = 48

# Windows whose spread the components are fitted to.
_FITTED = 4096

# Entries of a table of costs; it stays in the caches, and is fixed, so that results do not depend on threads.
_TABLE = 2_000_000


class NearestWindows:
    """Finds, for each query, the nearest of a set of windows, in squared distance over principal components.

    Parameters
    ----------
    windows : (M, D) float32 array
    components : int
        Principal components that are compared.
    relative : bool
        Take the least of |q - p|^2 / (|q|^2 + |p|^2) instead: the plain distance prefers windows of little contrast where
        nothing fits well. For windows of mean zero.
    """

    def __init__(self, windows: Array, components: int = COMPONENTS, *, relative: bool = False) -> None:
        self._relative = relative
        with single_threaded_blas():
            part = windows[np.unique(np.linspace(0, len(windows) - 1, min(len(windows), _FITTED)).astype(int))]
            self._mean = part.mean(axis=0, dtype=np.float64).astype(np.float32)
            centred = (part - self._mean).astype(np.float64)
            if centred.shape[1] > components:
                spread, axes = np.linalg.eigh(centred.T @ centred)
                self._axes = np.ascontiguousarray(axes[:, np.argsort(-spread)[:components]], np.float32)
            else:
                self._axes = np.eye(centred.shape[1], dtype=np.float32)
            self._points = np.ascontiguousarray(((windows - self._mean) @ self._axes).T)
        self._half = 0.5 * np.sum(self._points.astype(np.float64) ** 2, axis=0).astype(np.float32)

    def find(self, queries: Array) -> Array:
        """Return the nearest window of each query (Q, D): (Q,)."""
        index = np.zeros(len(queries), np.int64)
        rows = max(1, _TABLE // self._points.shape[1])

        def work(chunk: int) -> None:
            part = slice(chunk * rows, min((chunk + 1) * rows, len(queries)))
            query = (queries[part] - self._mean) @ self._axes
            if self._relative:
                own = 0.5 * np.einsum("ij,ij->i", query, query)[:, None] + np.float32(1e-12)
                index[part] = np.argmax((query @ self._points) / (own + self._half), axis=1)
            else:
                index[part] = np.argmin(self._half - query @ self._points, axis=1)

        with single_threaded_blas():
            run_parallel(work, range(-(-len(queries) // rows)))
        return index


def rms_difference(a: Array, b: Array) -> Array:
    """Return the root mean square differences (M,) of corresponding windows (M, D)."""
    found: Array = np.sqrt(np.mean((a - b) ** 2, axis=1))
    return found
