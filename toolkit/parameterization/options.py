"""The options of a parameterization, validated."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from intaglio.arrays import Array
from intaglio.checks import checked_choice, checked_direction
from intaglio.errors import InputError
from intaglio.mesh import Surface, vertex_normals

ENERGIES = ("stretch", "stretch-max", "mips", "intrinsic", "mean-value")
BOUNDARIES = ("free", "circle", "square")


class Options:
    """Checked options, and what follows from them for each face of the surface."""

    def __init__(
        self,
        surface: Surface,
        energy: str,
        boundary: str,
        view: ArrayLike | None,
        importance: float,
        shape_threshold: float,
        max_stretch: float | None,
        conformal: float,
        iterations: int,
    ) -> None:
        if not isinstance(surface, Surface):
            raise InputError(f"surface must be a Surface (read_surface gives one), not {type(surface).__name__}")
        checked_choice("energy", energy, ENERGIES)
        checked_choice("boundary", boundary, BOUNDARIES)
        for name, number, low, high in (
            ("importance", importance, 1.001, 1e6),
            ("shape_threshold", shape_threshold, 0.0, 0.5),
            ("conformal", conformal, 0.0, 1.0),
            ("max_stretch", 1.01 if max_stretch is None else max_stretch, 1.01, 1e6),
            ("iterations", iterations, 1, 1e6),
        ):
            if isinstance(number, bool) or not isinstance(number, int | float | np.number) or not low <= number <= high:
                raise InputError(f"{name} must be a number from {low:g} to {high:g}, not {number!r}")
        self.surface, self.energy, self.boundary = surface, energy, boundary
        self.shape_threshold, self.conformal, self.iterations = float(shape_threshold), float(conformal), int(iterations)
        self.importance = np.ones(len(surface.faces))
        self.seam_cost: Array | None = None
        if view is not None:
            towards = checked_direction("view", view)
            corner = surface.vertices[surface.faces]
            normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
            normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
            self.importance = 1 / (importance - normal @ towards)
            facing = vertex_normals(surface.vertices, surface.faces) @ towards
            self.seam_cost = 1 + 4 * np.maximum(facing + 0.5, 0)
