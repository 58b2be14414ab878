"""What a neighbourhood is compared in: relief, colour beside it, and the coarser relief that is known already."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.kernels.transfer import encode_srgb
from intaglio.relief.ground import Ground


@dataclass(frozen=True)
class Comparison:
    """How differences of relief, colour and coarse relief count.

    Attributes
    ----------
    color_weight : float
        1 - mu, in [0, 1]: the share of colour in the combined measure (3DIM 2005, section 6). 0: colour does not count.
    span : float
        The largest difference of two measured displacements, by which differences of relief are normalised to [0, 1].
    coarse : (N,) array or None
        Coarser relief of all vertices, in the input's unit, known everywhere.
    coarse_weight : float
        How much differences of it count, against 1 for relief's own.
    """

    color_weight: float = 0.0
    span: float = 1.0
    coarse: Array | None = None
    coarse_weight: float = 1.0

    def factors(self) -> list[tuple[float, bool]]:
        """Return for every channel what differences are multiplied by, and whether it is known everywhere.

        A cost is then in squared input units: with colour, the normalised sum of 3DIM 2005 times the squared ``span``.
        """
        out = [(float(np.sqrt(1 - self.color_weight)), False)]
        if self.color_weight > 0:
            out += 3 * [(float(np.sqrt(self.color_weight / 3)) * self.span, False)]
        if self.coarse is not None:
            out.append((float(np.sqrt(self.coarse_weight)), True))
        return out

    def variance(self, height: Array, color: Array | None) -> float:
        """Return the variance of what is compared, in squared input units, coarse relief left out."""
        channels = replace(self, coarse=None)
        pairs = zip(channels.factors(), channels.values(height, color), strict=True)
        return float(sum(factor**2 * float(value.var()) for (factor, _), value in pairs))

    def values(self, height: Array, color: Array | None) -> list[Array]:
        """Return the channels' values (N,): relief in the input's unit, colours as displayed, coarse relief."""
        out = [height]
        if self.color_weight > 0:
            assert color is not None
            out += list(encode_srgb(color).T)
        if self.coarse is not None:
            out.append(self.coarse)
        return out


def compare_by(ground: Ground, color_weight: float | None, coarse: Array | None = None) -> Comparison:
    """Return how neighbourhoods of ``ground`` are to be compared.

    Raises
    ------
    InputError
        For a weight outside [0, 1], or a weight of colour for a scan that has none.
    """
    weight = 0.0
    if color_weight is not None:
        try:
            weight = float(color_weight)
        except (TypeError, ValueError):
            weight = float("nan")
        if not 0 <= weight <= 1:
            raise InputError(f"color_weight must be a number from 0 (shape alone) to 1 (colour alone), not {color_weight!r}")
        if weight > 0 and ground.color is None:
            raise InputError("color_weight needs a scan with colours: it has neither vertex colours nor a texture")
    relief = ground.height[ground.measured]
    span = float(np.ptp(relief)) or ground.spacing
    return Comparison(weight, span, coarse)
