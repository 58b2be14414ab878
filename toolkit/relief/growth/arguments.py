"""Checks of what `complete_relief` is given."""

from __future__ import annotations

import numpy as np

from intaglio.errors import InputError
from intaglio.mesh import Surface, border_edges
from intaglio.relief.ground import Ground, number
from intaglio.relief.growth.propagation import Selection


def check_surface(surface: Surface) -> None:
    """Raise `InputError` for what is no surface, or one that holds filled vertices."""
    if not isinstance(surface, Surface):
        raise InputError(f"surface must be an intaglio.Surface, not {type(surface).__name__}; read_surface(path) gives one")
    made_up = int((~surface.measured).sum())
    if made_up:
        raise InputError(
            f"the surface holds {made_up} vertices that were filled, not measured: they can't serve as measurements; "
            "complete the scan itself"
        )


def check_combination(
    levels: int,
    color_weight: float | None,
    refine: int,
    metric: str,
    *,
    bootstrap: bool,
    selection: str,
    search: str,
    frames: str | None,
    memory: float | None,
) -> None:
    """Refuse what can't be had together."""
    if metric == "surface":
        for name, asked in (
            ("refine", refine > 0),
            ("levels", levels > 1),
            ("color_weight", color_weight is not None),
            ("search='approximate'", search == "approximate"),
            ("memory", memory is not None),
        ):
            if asked:
                raise InputError(f"{name} works with metric='displacement'; leave it out or change the metric")
    if refine and bootstrap:
        raise InputError("refine copies from measured samples; set bootstrap=False or refine=0")
    if search == "approximate" and (bootstrap or selection == "best-percent"):
        other = "bootstrap" if bootstrap else "selection='best-percent'"
        raise InputError(f"{other} compares every sample: leave search at 'auto' or 'exhaustive'")
    if frames == "relief" and levels == 1:
        raise InputError("frames='relief' turns neighbourhoods by the coarser relief: give levels=2 or more")


def checked_selection(rule: str, factor: float, eta: float, error: float | None) -> Selection:
    """How matches are chosen; an error bound that is not given is 0 for now."""
    if rule not in ("near-best", "best-percent"):
        raise InputError(f"selection must be 'near-best' or 'best-percent', not {rule!r}")
    factor, eta = number(factor, "factor"), number(eta, "eta")
    if factor < 1:
        raise InputError(f"factor must be at least 1, not {factor!r}")
    if not 0 < eta <= 100:
        raise InputError(f"eta is a percentage in (0, 100], not {eta!r}")
    if error is not None and number(error, "error") <= 0:
        raise InputError(f"error must be a positive number, in squared input units, not {error!r}")
    return Selection(rule, factor, eta, 0.0 if error is None else float(error))


def check_samples(ground: Ground) -> None:
    """Raise `InputError` where no measured vertex has measured surface all around it."""
    inner = ground.measured.copy()
    inner[ground.faces[~ground.measured[ground.faces].all(axis=1)]] = False
    inner[np.unique(border_edges(ground.faces))] = False
    if not inner.any():
        raise InputError(
            f"fewer samples than the smallest window needs: none of {int(ground.measured.sum())} measured vertices has "
            "measured surface all around it"
        )
