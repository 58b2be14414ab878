"""Texture: an image over a surface, and where each texel comes from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array


@dataclass(frozen=True)
class Texture:
    """An image over a surface.

    Attributes
    ----------
    image : (H, W, 3) float32 array
        Linear Rec.709; row 0 is at v = 1. Texels outside the charts continue their borders.
    known : (H, W) bool array
        True where photographs show the surface; False where the colour was interpolated or restored, and outside.
    chart : (H, W) int32 array
        Number of the chart that a texel lies in, from 1; 0 outside.
    photograph : (H, W, k) int16 array
        Coverage: numbers of the photographs that a known texel is made of, the strongest first; -1 for none.
    weight : (H, W, k) float16 array
        Their shares, adding up to 1 (of the k strongest).
    names : tuple of str
        The photographs.
    gains : (P, 3) float64 array
        Factors by which their exposures were made to agree.
    notes : tuple of str
    """

    image: Array
    known: Array
    chart: Array
    photograph: Array
    weight: Array
    names: tuple[str, ...]
    gains: Array
    notes: tuple[str, ...] = ()

    @property
    def inside(self) -> Array:
        """Texels that lie on the surface, (H, W) bool."""
        return np.asarray(self.chart > 0)

    @property
    def coverage(self) -> dict[str, float]:
        """Share of the surface's texels that each photograph contributes, by name."""
        texels = max(int(self.inside.sum()), 1)
        found = {}
        for number, name in enumerate(self.names):
            found[name] = float(np.where(self.photograph == number, self.weight, 0).sum(dtype=np.float64)) / texels
        return found
