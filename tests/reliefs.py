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


def dimpled_ball():
    """A ball of radius 10 with bumps of a few edges and a hole."""
    import numpy as np
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=4, radius=10.0)
    v = np.asarray(mesh.vertices)
    k = np.random.default_rng(0).normal(size=(12, 3))
    k *= 3.0 / np.linalg.norm(k, axis=1, keepdims=True)
    v = v * (1 + np.sin(v @ k.T + np.arange(12)).mean(axis=1) / 10)[:, None]
    return intaglio.Surface(vertices=v, faces=np.asarray(mesh.faces)).part(np.linalg.norm(v - (0, 0, 10), axis=1) > 3)
