"""Larger geometry textures from a swatch (Duranleau & Poulin): settings, checks, and the finished output."""

from __future__ import annotations

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_arguments, checked_count, checked_flag, checked_number
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.geometry.buckets import wrap
from intaglio.geometry.growth import Growth
from intaglio.geometry.layout import lay_out
from intaglio.geometry.options import PatchFit, Settings, checked_pair, checked_weights, suited_weights
from intaglio.geometry.point_set import GeometryTexture, PointSet
from intaglio.geometry.spreading import spread
from intaglio.geometry.swatch import Swatch
from intaglio.randomness import checked_seed

# The most points and nodes of a field; more would need more memory than a workstation has.
_MOST_POINTS = 200_000_000
_MOST_NODES = 50_000_000
# Least side of a patch in distances of samples; smaller ones hold too little surface to be matched.
_LEAST_PATCH = 6


@checked_arguments
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
    fit: PatchFit | None = None,
    relax: int = 3,
    tileable: bool = False,
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> PointSet:
    """Make a large piece of a geometry texture from a swatch, patch by patch.

    The patches are laid in scan-line order. Each is searched by the distance of signed distance fields where it overlaps what
    is already there (section 5.1), warped by a thin-plate spline through automatically paired points (section 5.2), blended by
    projection (section 5.3), and replaces what was there. Patches that are too far apart to influence each other are processed
    together; the result is the same as one after the other. The patches of a tileable output are laid one after the other.

    Parameters
    ----------
    texture : GeometryTexture
        The swatch. It should reach past its bounds by ``extra`` on all sides of the plane; if it does not, the bounds shrink.
    size : float or (float, float)
        Sides of the output along the two plane axes (`GeometryTexture.plane_axes`), in the swatch's unit.
    patch : float or (float, float), optional
        Sides of a patch in the swatch's unit; it should hold at least one element of the texture and some of its surroundings.
        Default None: a third of the swatch's shorter side.
    overlap : float, optional
        Least overlap of neighbouring patches in the swatch's unit, at most half a patch. Default None: 0.28 of a patch.
    extra : float, optional
        Width w_E of the region copied beyond a patch, and of the border cut off at the end, in the swatch's unit, at most a
        patch. Default None: a quarter of a patch.
    cell : float, optional
        Distance between the nodes of the field, and step of the positions that are searched, in the swatch's unit. Default
        None: a sixteenth of a patch, at least the distance of samples.
    tolerance : float, optional
        Relative tolerance ε: a patch is drawn from those whose distance is at most (1 + ε) times the least; at least 0.
    max_error : float, optional
        A patch has no candidate if its least distance is above this: the root mean square over the nodes, with distances in
        units of half the height and gradients of unit length. It is replaced by four of half the size; if these have none
        either, the best is taken and a note says where. Default None: no limit.
    fit : PatchFit, optional
        How patches are fitted to what is there. Default None: ``PatchFit()``.
    relax : int, optional
        Rounds of spreading at the end, 0 to 100: gaps are filled and crowded points pushed apart. 0 leaves the points as
        copied.
    tileable : bool, optional
        Make an output that repeats without a seam. Default False, since most outputs are not repeated.
    seed : int, optional
        The same seed gives the same bits.
    device : str, optional
        ``"cpu"``, ``"cuda:0"``. Default None: CUDA if there is one.
    progress : callable, optional
        Called with the patches laid and all patches.

    Returns
    -------
    PointSet
        From 0 to ``size`` in the plane, at the swatch's heights. ``source`` is the point of the swatch that each was copied
        from, ``moved`` how far warp, blending and spreading moved it, ``patch`` the number of the patch that laid it.

    Raises
    ------
    InputError
        If the swatch is smaller than a patch, an overlap or setting is out of range, a tileable output is too small to
        close, or the output would be too large.

    See Also
    --------
    intaglio.read_geometry_texture : Reads a swatch.
    intaglio.mesh_geometry, intaglio.wrap_geometry : What can be made of the result.

    References
    ----------
    Duranleau & Poulin, "Patch-based Synthesis of Geometry Textures with Point-set Surfaces", sections 4 and 5. Additions:
    averages are corrected for bending (`intaglio.kernels.points`), so that blending does not thin wires; pairs end on the
    surface instead of on its samples; geometry without a counterpart is cut in the middle of the overlap instead of at the
    box; anchors follow the mean move of the pairs.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:32, :32]
    >>> swatch = intaglio.geometry_from_height(np.sin(x / 2) + np.cos(y / 2))
    >>> larger = intaglio.extend_geometry(swatch, (40, 36), 12, device="cpu")
    >>> low, high = larger.points.min(axis=0)[:2], larger.points.max(axis=0)[:2]
    >>> bool((low >= 0).all() and (high < [40, 36]).all() and len(larger) > 1000)
    True
    """
    device = device_or_error(device)
    seed = checked_seed(seed)
    if not isinstance(texture, GeometryTexture):
        raise InputError(f"texture must be a GeometryTexture (see read_geometry_texture), not {type(texture).__name__}")
    fit = PatchFit() if fit is None else fit
    if not isinstance(fit, PatchFit):
        raise InputError(f"fit must be a PatchFit, not {fit!r}")
    tileable = checked_flag("tileable", tileable)
    wanted = checked_pair("size", size)
    sides = np.full(2, texture.base.min() / 3) if patch is None else checked_pair("patch", patch)
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
    chosen, note = checked_weights("weights", fit.weights), None
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
        fit=fit,
    )
    _check_amount(texture, wanted, step)
    swatch = Swatch(texture, extra, device)
    if (sides > swatch.base * (1 + 1e-9)).any():
        raise InputError(
            f"patch {_sides(sides)} is larger than the swatch's bounds, which are {_sides(swatch.base)} once {extra:.4g} is "
            "kept as padding on every side; give a smaller patch or extra, or a larger swatch"
        )
    margin = max(extra, 2 * swatch.support)
    if tileable and (wanted < sides + 2 * (extra + margin)).any():
        raise InputError(
            f"size {_sides(wanted)} is too small to close on itself (tileable) with patches of {_sides(sides)}: at least "
            f"{_sides(sides + 2 * (extra + margin))} is needed"
        )
    layout = lay_out(wanted, sides, overlap, extra, margin, tileable=tileable)
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
            "make a tileable piece and repeat it, or thin the swatch (spacing)"
        )
    nodes = float(np.prod(texture.base / cell + 1)) * (texture.height / cell + 2)
    if nodes > _MOST_NODES:
        raise InputError(f"cell {cell:.4g} makes a field of {nodes:.3g} nodes, more than {_MOST_NODES:.0e}; give a larger one")


def _sides(size: Array) -> str:
    return f"{size[0]:.4g} x {size[1]:.4g}"
