"""Larger geometry textures from a swatch (Duranleau & Poulin): settings, checks, and the finished output."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_count, checked_number
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.geometry.buckets import wrap
from intaglio.geometry.growth import Growth
from intaglio.geometry.layout import lay_out
from intaglio.geometry.options import PairingWeights, Settings, checked_weights, one_or_two, suited_weights
from intaglio.geometry.point_set import GeometryTexture, PointSet
from intaglio.geometry.spreading import spread
from intaglio.geometry.swatch import Swatch
from intaglio.randomness import checked_seed

# More points than this are not attempted: they would need more memory than a workstation has.
_MOST_POINTS = 200_000_000
_MOST_NODES = 50_000_000
# In distances of samples; smaller ones hold no surface to be matched.
_LEAST_PATCH = 6


def extend_geometry(
    texture: GeometryTexture,
    size: float | tuple[float, float],
    patch: float | tuple[float, float] | None = None,
    *,
    overlap: float | None = None,
    extra: float | None = None,
    cell: float | None = None,
    tolerance: float = 0.1,
    max_error: float | None = None,
    weights: PairingWeights | str = "auto",
    pairs: int = 110,
    rounds: int = 1,
    smoothing: float = 1e-3,
    warp: bool = True,
    blend: bool = True,
    relax: int = 3,
    toroidal: bool = False,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> PointSet:
    """Make a large piece of a geometry texture from a swatch, patch by patch.

    In scan-line order each patch is searched by the distance of signed distance fields where it overlaps what is there
    (section 5.1), warped by a thin-plate spline through automatically paired points (5.2), blended by projection (5.3), and
    put in the place of what was there. Patches that can't see each other are worked on together; the result is that of one
    after the other. A toroidal output is laid one patch after the other.

    Parameters
    ----------
    texture : GeometryTexture
        Should reach past its bounds by ``extra`` on all sides of the plane; where it does not, the bounds shrink.
    size : float or (float, float)
        Sides of the output along the two plane axes (`GeometryTexture.plane_axes`), in the swatch's unit.
    patch : float or (float, float), optional
        Sides of a patch: at least one texture element and some of its surroundings. Default: a third of the shorter side.
    overlap : float, optional
        Least overlap of neighbouring patches; at most half a patch. Default: 0.28 of a patch.
    extra : float, optional
        Width w_E of the region copied beyond a patch, and of the border cut off at the end. Default: a quarter of a patch.
    cell : float, optional
        Distance of the field's nodes, and step of the positions that are searched. Default: a sixteenth of a patch, at least
        the distance of samples.
    tolerance : float
        ε: a patch is drawn from those within (1 + ε) of the least distance.
    max_error : float, optional
        A patch whose best distance, as the root mean square of a node's (half the height and a unit gradient count 1), is
        above this has no candidate: four of half the size are put in its place, and where these fail the best is taken and
        its place noted. Default: no limit.
    weights : PairingWeights or str
        A preset of the paper's Table 1 ("height field", "chain mail", "weave", "flowers"), or "auto": the first for a height
        field, else the second.
    pairs : int
        About how many points of an overlap are paired.
    rounds : int
        Rounds of pairing with the coherence term.
    smoothing : float
        Regularisation λ of the splines, over the spread of their centres: tiny; 0.1 and more leaves gaps to blending.
    warp, blend : bool
        Leave these steps out, for comparison.
    relax : int
        Rounds of spreading at the end: gaps are filled and crowded points pushed apart. 0: points stay as copied.
    toroidal : bool
        The output closes on itself: it tiles without a seam.
    seed : int
    device : str, optional
    progress : callable, optional
        Called with patches laid and all patches.

    Returns
    -------
    PointSet
        From 0 to ``size`` in the plane, at the swatch's heights; ``source`` is the swatch point each was copied from,
        ``moved`` how far warp and blending moved it from where copying had put it, and spreading after them, ``patch`` what
        laid it.

    Raises
    ------
    InputError
        If the swatch is smaller than a patch, an overlap or setting is out of range, a toroidal output is too small to
        close, or the output would be too large.

    References
    ----------
    Duranleau & Poulin, *Patch-based Synthesis of Geometry Textures with Point-set Surfaces*, sections 4 and 5. Beyond the
    paper: averages are corrected for bending (`intaglio.kernels.points`), so that blending does not thin wires; pairs end on
    the surface instead of on its samples; geometry without a counterpart is cut in the middle of the overlap instead of at
    the box; anchors follow the pairs' mean move.
    """
    device = device_or_error(device)
    seed = checked_seed(seed)
    if not isinstance(texture, GeometryTexture):
        raise InputError(f"texture must be a GeometryTexture (see read_geometry_texture), not {type(texture).__name__}")
    for name, value in (("toroidal", toroidal), ("warp", warp), ("blend", blend)):
        if not isinstance(value, bool | np.bool_):
            raise InputError(f"{name} must be True or False, not {value!r}")
    wanted = one_or_two(size, "size")
    sides = np.full(2, texture.base.min() / 3) if patch is None else one_or_two(patch, "patch")
    shorter, longer = float(sides.min()), texture.base
    if (sides > longer).any():
        raise InputError(
            f"patch {_sides(sides)} is larger than the swatch's bounds {_sides(longer)}; give a smaller patch or a larger swatch"
        )
    if shorter < _LEAST_PATCH * texture.spacing:
        raise InputError(
            f"patch {_sides(sides)} is too small for samples {texture.spacing:.4g} apart: at least "
            f"{_LEAST_PATCH * texture.spacing:.4g} is needed"
        )
    overlap = checked_number("overlap", 0.28 * shorter if overlap is None else overlap, texture.spacing, shorter / 2)
    extra = checked_number("extra", shorter / 4 if extra is None else extra, 0, shorter)
    step = max(shorter / 16, texture.spacing) if cell is None else checked_number("cell", cell, texture.spacing / 4, overlap)
    chosen, note = checked_weights(weights), None
    if chosen is None:
        name, chosen = suited_weights(texture)
        note = f"pairing weights: those of {name}"
    relax = checked_count("relax", relax, 0, 100)
    settings = Settings(
        patch=sides,
        overlap=overlap,
        extra=extra,
        cell=step,
        tolerance=checked_number("tolerance", tolerance, 0),
        max_error=np.inf if max_error is None else checked_number("max_error", max_error, 0),
        weights=chosen,
        pairs=checked_count("pairs", pairs, 8, 1000),
        rounds=checked_count("rounds", rounds, 0, 100),
        smoothing=checked_number("smoothing", smoothing, 1e-9, 1e3),
        warp=warp,
        blend=blend,
    )
    _check_amount(texture, wanted, step)
    swatch = Swatch(texture, extra, device)
    if (sides > swatch.base * (1 + 1e-9)).any():
        raise InputError(
            f"patch {_sides(sides)} is larger than the swatch's bounds, which are {_sides(swatch.base)} once {extra:.4g} is "
            "kept as padding on every side; give a smaller patch or extra, or a larger swatch"
        )
    margin = max(extra, 2 * swatch.support)
    if toroidal and (wanted < sides + 2 * (extra + margin)).any():
        raise InputError(
            f"size {_sides(wanted)} is too small to close on itself with patches of {_sides(sides)}: at least "
            f"{_sides(sides + 2 * (extra + margin))} is needed"
        )
    layout = lay_out(wanted, sides, overlap, extra, margin, toroidal=toroidal)
    growth = Growth(swatch, layout, settings, margin, seed)
    growth.grow(progress)
    records = spread(
        growth.records(), nearest=swatch.nearest, support=swatch.support, rounds=relax, period=layout.period, device=device
    )
    wrap(records["point"], layout.period)
    place = records["point"][:, :2]
    records = records[((place >= layout.low) & (place < layout.high)).all(axis=1)]
    if not len(records):
        raise InputError(f"no geometry lies in an output of {_sides(wanted)}; give a larger size or another seed")
    color = texture.points.color
    return PointSet(
        swatch.to_world(records["point"] + (0.0, 0.0, swatch.origin[2])),
        swatch.to_world(records["normal"].astype(np.float64)),
        color=None if color is None else color[records["source"]],
        source=records["source"],
        moved=records["moved"],
        patch=records["patch"],
        notes=(*swatch.notes, *([] if note is None else [note]), *growth.notes),
    )


def _check_amount(texture: GeometryTexture, size: Array, cell: float) -> None:
    with np.errstate(over="ignore"):
        count = len(texture.points) * float(np.prod(size)) / float(np.prod(texture.base))
    if count > _MOST_POINTS:
        raise InputError(
            f"size {_sides(size)} would take about {count:.3g} points, more than {_MOST_POINTS:.0e}; give a smaller size, "
            "make a toroidal piece and repeat it, or thin the swatch (spacing)"
        )
    nodes = float(np.prod(texture.base / cell + 1)) * (texture.height / cell + 2)
    if nodes > _MOST_NODES:
        raise InputError(f"cell {cell:.4g} makes a field of {nodes:.3g} nodes, more than {_MOST_NODES:.0e}; give a larger one")


def _sides(size: Array) -> str:
    return f"{size[0]:.4g} x {size[1]:.4g}"
