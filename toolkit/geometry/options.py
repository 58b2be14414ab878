"""Settings of the extension of geometry textures, checked and filled in from the swatch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_count, checked_flag, checked_number, shown
from intaglio.errors import InputError
from intaglio.geometry.normals import is_height_field
from intaglio.geometry.point_set import GeometryTexture


@dataclass(frozen=True)
class PairingWeights:
    """Weights by which the points of two overlapping patches are paired.

    Lengths are in units of the shorter side of a patch.

    Parameters
    ----------
    normal : float
        Weight ω_n of the difference of normals, at least 0.
    variation : float
        Weight ω_v of the difference of surface variation, at least 0.
    length : float
        Weight ω_l of the difference in length between a pair's move and those of its neighbours, at least 0.
    direction : float
        Weight ω_d of the difference in direction of these moves, at least 0.
    position : float, optional
        Weight ω_p of the distance, at least 0. Default 1: the others are relative to it, as published.
    most_distance : float, optional
        Largest distance of a pair, above 0, in patch sides.
    most_angle : float, optional
        Largest angle between the normals of a pair, in degrees.
    most_variation : float, optional
        Largest difference of surface variation of a pair, 0 to 1/3.

    See Also
    --------
    intaglio.PatchFit : Takes them, or the name of a preset.

    References
    ----------
    Duranleau & Poulin, "Patch-based Synthesis of Geometry Textures with Point-set Surfaces", section 5.2, equation 2, and
    table 1.

    Examples
    --------
    >>> import intaglio
    >>> weights = intaglio.PairingWeights(normal=2, variation=15, length=6, direction=5)
    >>> intaglio.PatchFit(weights=weights).weights.variation
    15
    """

    normal: float
    variation: float
    length: float
    direction: float
    position: float = 1.0
    most_distance: float = 0.12
    most_angle: float = 60.0
    most_variation: float = 0.2

    def __post_init__(self) -> None:
        check_fields(self)


# Duranleau & Poulin, table 1.
PRESETS = {
    "height field": PairingWeights(3, 30, 9, 7),
    "chain mail": PairingWeights(1, 10, 8, 6),
    "weave": PairingWeights(2, 15, 6, 5),
    "flowers": PairingWeights(2, 2, 6, 6),
}


@dataclass(frozen=True)
class PatchFit:
    """How a patch is fitted to what is already there, for `extend_geometry`.

    Parameters
    ----------
    weights : PairingWeights or str, optional
        Weights by which points of the overlap are paired, or the name of a preset of table 1: "height field", "chain mail",
        "weave" or "flowers". Default "auto": the first for a height field, else the second.
    pairs : int, optional
        Approximate number of points of an overlap that are paired, 8 to 1000.
    rounds : int, optional
        Rounds of pairing with the coherence term, 0 to 100.
    smoothing : float, optional
        Regularisation λ of the thin-plate splines, in units of the spread of their centres, 1e-9 (interpolation) to 1e3.
        From 0.1 on, gaps are left to blending.
    warp : bool, optional
        Warp patches by the splines (section 5.2). False leaves it out, for comparison.
    blend : bool, optional
        Blend patches by projection (section 5.3). False leaves it out, for comparison.

    Raises
    ------
    InputError
        If a value is out of range or the weights are unknown.

    See Also
    --------
    intaglio.extend_geometry : The method.

    References
    ----------
    Duranleau & Poulin, "Patch-based Synthesis of Geometry Textures with Point-set Surfaces", sections 5.2 and 5.3.

    Examples
    --------
    >>> import intaglio
    >>> intaglio.PatchFit(weights="weave", pairs=60)
    PatchFit(weights='weave', pairs=60, rounds=1, smoothing=0.001, warp=True, blend=True)
    """

    weights: PairingWeights | str = "auto"
    pairs: int = 110
    rounds: int = 1
    smoothing: float = 1e-3
    warp: bool = True
    blend: bool = True

    def __post_init__(self) -> None:
        checked_weights("weights", self.weights)
        object.__setattr__(self, "pairs", checked_count("pairs", self.pairs, 8, 1000))
        object.__setattr__(self, "rounds", checked_count("rounds", self.rounds, 0, 100))
        object.__setattr__(self, "smoothing", checked_number("smoothing", self.smoothing, 1e-9, 1e3))
        object.__setattr__(self, "warp", checked_flag("warp", self.warp))
        object.__setattr__(self, "blend", checked_flag("blend", self.blend))
        check_fields(self)


@dataclass(frozen=True)
class Settings:
    """The checked settings of one extension; lengths in the input's unit. See `extend_geometry` and `PatchFit`."""

    patch: Array
    overlap: float
    extra: float
    cell: float
    tolerance: float
    max_error: float
    weights: PairingWeights
    fit: PatchFit


def suited_weights(texture: GeometryTexture) -> tuple[str, PairingWeights]:
    """Return the name and weights of the preset that suits a swatch.

    By the authors' remarks on table 1: features that are large compared with the sampling, as on a height field, need more
    weight on normals and variation; wires and threads need less, and pairs that move like their neighbours.
    """
    points = texture.points
    name = "height field" if is_height_field(points.points, texture.axis, texture.spacing, points.normals) else "chain mail"
    return name, PRESETS[name]


def checked_weights(name: str, value: PairingWeights | str) -> PairingWeights | None:
    """Return the weights that ``value`` is or names, None for ``"auto"``, or raise `InputError`."""
    if isinstance(value, PairingWeights):
        for field, number in vars(value).items():
            checked_number(f"{name}: {field}", number, 0)
        if value.most_distance <= 0:
            raise InputError(f"{name}: most_distance must be above 0")
        return value
    if isinstance(value, str) and value == "auto":
        return None
    if not isinstance(value, str) or value not in PRESETS:
        raise InputError(f"{name} {shown(value)} are not known; choose auto, {', '.join(PRESETS)}, or give PairingWeights")
    return PRESETS[value]


def checked_pair(name: str, value: object) -> Array:
    """Return one or two positive numbers as two, or raise `InputError`."""
    try:
        numbers = np.asarray(value, float).reshape(-1)
    except (TypeError, ValueError) as problem:
        raise InputError(f"{name} must be one or two numbers, not {value!r}") from problem
    if len(numbers) not in (1, 2) or not np.isfinite(numbers).all() or (numbers <= 0).any():
        raise InputError(f"{name} must be one or two positive numbers, not {value!r}")
    return np.broadcast_to(numbers, 2).astype(float)
