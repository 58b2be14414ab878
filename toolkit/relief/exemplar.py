"""Where relief may come from: the user's choice as vertices of the scan, and other scans."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.mesh import Surface

Exemplar = str | Array | Sequence[float] | Surface | Sequence[str | Surface]


@dataclass(frozen=True)
class Sources:
    """Where relief may come from.

    Attributes
    ----------
    allowed : (V,) bool array or None
        The scan's own vertices; None for all that lie near enough.
    near : bool
        Whether a hole's surroundings are enough to work on.
    others : tuple of Surface
        Other scans.
    """

    allowed: Array | None
    near: bool
    others: tuple[Surface, ...]


def chosen_sources(surface: Surface, exemplar: Exemplar) -> Sources:
    """Return where a scan's relief may come from.

    Raises
    ------
    InputError
        For an unknown choice, or one that holds nothing.
    """
    if isinstance(exemplar, Surface):
        exemplar = [exemplar]
    if isinstance(exemplar, list | tuple) and any(isinstance(one, Surface | str) for one in exemplar):
        words = [one for one in exemplar if not isinstance(one, Surface)]
        if len(words) > 1 or not set(words) <= {"near", "all"}:
            raise InputError(f"exemplar as a sequence holds surfaces, and 'near' or 'all' once at most; it holds {words!r}")
        others = tuple(one for one in exemplar if isinstance(one, Surface))
        own = np.full(len(surface.vertices), words == ["all"])
        return Sources(None if words == ["near"] else own, words != ["all"], others)
    chosen = chosen_vertices(surface, exemplar)
    near = isinstance(exemplar, str) and exemplar == "near"
    if chosen is None and not near:
        chosen = np.ones(len(surface.vertices), bool)
    return Sources(chosen, near, ())


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
    meaning = "exemplar must be 'near', 'all', a mask or numbers of vertices, a ball (x, y, z, radius), or other surfaces"
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
