"""Where relief may come from: the user's choice as vertices of the scan."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.mesh import Surface

Exemplar = str | Array | Sequence[float]


def chosen_vertices(surface: Surface, exemplar: Exemplar) -> Array | None:
    """Return which of a scan's vertices (V,) relief may be taken from; None for all that lie near enough.

    Parameters
    ----------
    surface : Surface
    exemplar : {"near", "all"}, (V,) bool array, (K,) int array or (4,) sequence of float
        See `complete_relief`.

    Raises
    ------
    InputError
        For an unknown choice, or one that holds no vertex.
    """
    meaning = "exemplar must be 'near', 'all', a mask or numbers of vertices, or a ball (x, y, z, radius)"
    count = len(surface.vertices)
    if isinstance(exemplar, str):
        if exemplar not in ("near", "all"):
            raise InputError(f"{meaning}, not {exemplar!r}")
        return None
    try:
        given = np.asarray(exemplar)
    except ValueError:
        given = np.zeros(0, object)
    if given.dtype == bool:
        if given.shape != (count,):
            raise InputError(f"exemplar must be a bool array of shape ({count},), not {given.shape}")
        chosen = given
    elif given.dtype.kind in "iu" and given.ndim == 1 and len(given) != 4:
        if len(given) and not (given.min() >= 0 and given.max() < count):
            raise InputError(f"exemplar names vertices from {given.min()} to {given.max()}; the scan has 0 to {count - 1}")
        chosen = np.zeros(count, bool)
        chosen[given] = True
    elif given.dtype.kind in "iuf" and given.shape == (4,):
        if not (np.isfinite(given).all() and given[3] > 0):
            raise InputError(f"exemplar as a ball needs a finite centre and a radius above 0, not {exemplar!r}")
        chosen = np.asarray(np.linalg.norm(surface.vertices - given[:3], axis=1) <= given[3])
    else:
        raise InputError(f"{meaning}, not {given.dtype} {given.shape}")
    if not chosen.any():
        raise InputError("exemplar selects no vertex of the scan: there is nothing to take relief from")
    return chosen
