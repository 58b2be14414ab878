"""Settings of the extension of geometry textures, checked and filled in from the swatch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import checked_number
from intaglio.errors import InputError
from intaglio.geometry.normals import is_height_field
from intaglio.geometry.point_set import GeometryTexture


@dataclass(frozen=True)
class PairingWeights:
    """Weights of equation 2 and of the coherence term of section 5.2; lengths count in patch sides.

    Attributes
    ----------
    normal, variation, length, direction, position : float
        ω_n, ω_v, ω_l, ω_d, ω_p.
    most_distance : float
        Farthest pair.
    most_angle : float
        Degrees between the normals of a pair.
    most_variation : float
        Difference of surface variation of a pair.
    """

    normal: float
    variation: float
    length: float
    direction: float
    position: float = 1.0
    most_distance: float = 0.12
    most_angle: float = 60.0
    most_variation: float = 0.2


# Table 1 of the paper.
PRESETS = {
    "height field": PairingWeights(3, 30, 9, 7),
    "chain mail": PairingWeights(1, 10, 8, 6),
    "weave": PairingWeights(2, 15, 6, 5),
    "flowers": PairingWeights(2, 2, 6, 6),
}


@dataclass(frozen=True)
class Settings:
    """What patches are searched, warped and blended with; lengths in the input's unit. See `extend_geometry`."""

    patch: Array
    overlap: float
    extra: float
    cell: float
    tolerance: float
    max_error: float
    weights: PairingWeights
    pairs: int
    rounds: int
    smoothing: float
    warp: bool
    blend: bool


def suited_weights(texture: GeometryTexture) -> tuple[str, PairingWeights]:
    """Return the name and weights of the preset that suits a swatch.

    After the paper's remarks on Table 1: features that are large against the sampling, as on a height field, want more weight
    on normals and variation; wires and threads want less, and pairs that move as their neighbours do.
    """
    points = texture.points
    name = "height field" if is_height_field(points.points, texture.axis, texture.spacing, points.normals) else "chain mail"
    return name, PRESETS[name]


def checked_weights(weights: PairingWeights | str) -> PairingWeights | None:
    """Return the weights that a name or a record gives, None for ``"auto"``."""
    if isinstance(weights, PairingWeights):
        for name, value in vars(weights).items():
            checked_number(f"weights: {name}", value, 0)
        if weights.most_distance <= 0:
            raise InputError("weights: most_distance must be above 0")
        return weights
    if isinstance(weights, str) and weights == "auto":
        return None
    if not isinstance(weights, str) or weights not in PRESETS:
        raise InputError(f"weights {weights!r} are not known; choose auto, {', '.join(PRESETS)}, or give PairingWeights")
    return PRESETS[weights]


def one_or_two(value: object, name: str) -> Array:
    """Return one or two positive numbers as two."""
    try:
        numbers = np.asarray(value, float).reshape(-1)
    except (TypeError, ValueError) as problem:
        raise InputError(f"{name} must be one or two numbers, not {value!r}") from problem
    if len(numbers) not in (1, 2) or not np.isfinite(numbers).all() or (numbers <= 0).any():
        raise InputError(f"{name} must be one or two positive numbers, not {value!r}")
    return np.broadcast_to(numbers, 2).astype(float)
