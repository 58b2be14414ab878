"""Completing with any option of the prepared scan or the settings, in one call."""

from __future__ import annotations

from dataclasses import fields

import intaglio
from intaglio.relief.ground import GroundOptions

_GROUND = {f.name for f in fields(GroundOptions)} | {"device"}
_CALL = {"seed", "memory", "progress", "exemplar"}
_SELECTION = {"rule", "tolerance", "eta"}


def complete_with(surface, base="auto", window=None, error=None, **options):
    """Prepare ``surface`` and complete it, each option going where it belongs."""
    ground = {n: v for n, v in options.items() if n in _GROUND}
    call = {n: v for n, v in options.items() if n in _CALL}
    selection = {n: v for n, v in options.items() if n in _SELECTION}
    rest = {n: v for n, v in options.items() if n not in _GROUND | _CALL | _SELECTION}
    # Growth alone, unless a test asks for more: it is what most of them look at.
    rest.setdefault("refine", 0)
    settings = intaglio.ReliefSettings(window=window, error=error, selection=intaglio.Selection(**selection), **rest)
    return intaglio.prepare_relief(surface, base, **ground).complete(settings, **call)
