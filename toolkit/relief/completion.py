"""`complete_relief` and `prepare_relief`: what a scan did not see, with its relief."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_arguments, checked_choice
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.mesh import Base, Surface, border_edges
from intaglio.relief.exemplar import Exemplar, chosen_sources
from intaglio.relief.ground import FRAMES, Ground, GroundOptions, Holes, prepare_ground
from intaglio.relief.growth import (
    ReliefSettings,
)
from intaglio.relief.lines import Guides
from intaglio.relief.prepared import PreparedRelief


@checked_arguments
def complete_relief(
    surface: Surface,
    base: Base | str = "auto",
    *,
    window: int | None = None,
    rotations: int | None = None,
    refine: int | None = None,
    color_weight: float | None = None,
    spacing: float | None = None,
    extent: str | Sequence[float] | None = None,
    holes: Holes = None,
    exemplar: Exemplar = "near",
    guides: Guides = "auto",
    symmetry: str | Sequence[float] = "auto",
    seed: int = 0,
    device: str | None = None,
    progress: Progress | None = None,
) -> Surface:
    """Complete what a scan did not see: its smooth base, and over it the scan's own relief.

    Stage one fits the base and lays target points over the missing part at the scan's density. Stage two fills in the relief:
    over a smooth base from a place of the scan that is alike, where there is one, else by coherent pieces of what was measured
    nearby, found at all scales and joined by their differences; over the others, or where one of its options is given, by Breckon
    & Fisher's propagation from the rim. `prepare_relief` does stage one alone, so that stage two can be tried with other
    settings, seeds or exemplars, and has all other options.

    Parameters
    ----------
    surface : Surface
        The scan. Its vertices come out bit for bit as they are, first and in the same order, except those of pieces that
        don't lie on the base or that no face uses: these are left out, and the notes say how many.
    base : Base or {"auto", "plane", "cylinder", "sphere", "smooth"}
        The base, or the kind to fit. "smooth": the scan's own smoothed surface, carried on over its holes. "auto": a plane,
        cylinder or sphere where one fits, else "smooth".
    window : int, optional
        Propagation: radius of the neighbourhoods in edges, 1 to 64. See `ReliefSettings` for this and the next ones.
    rotations : int, optional
        1: relief is copied as it lies; more: it may be turned. Default from the relief.
    refine : int, optional
        Propagation: refinement passes, 0 to 100.
    color_weight : float, optional
        Propagation: how much colour counts beside shape, 0 to 1.
    spacing : float, optional
        Distance between targets, a length in the input's unit; default from the scan's edges.
    extent : str or sequence of float, optional
        What to complete of a plane, cylinder or sphere: None or "whole", "rectangle", "holes", or numbers, (low, high) along
        an axis or (u0, u1, v0, v1) in the chart.
    holes : {"all", "largest", "every"}, int or sequence of int, optional
        With a smooth base: what to fill. "all": the holes that the scan encloses (default); "every": where the scan ends as
        well; numbers as `list_holes` gives them.
    exemplar : {"near", "all"}, (V,) bool array, (K,) int array, (4,) sequence of float, Surface or sequence
        Where relief may come from. "near": over a smooth base the surroundings of each hole, else all of the scan. A mask or
        numbers of the scan's vertices, or a ball: its centre and radius. Pieces: another scan of the same material and at the
        same scale, wherever it lies, or several, and "near" or "all" among them for the scan's own relief as well.
    guides : {"auto", "none"} or sequence of (K, 3) arrays
        Pieces: lines across the holes. "auto": creases, ridges and valleys that reach a rim on both sides and fit together are
        carried on. Polylines, as `read_guides` gives them, replace what is found near them and add to the rest.
    symmetry : {"auto", "none"} or sequence of float
        Pieces: whether a hole is filled as a whole from its like elsewhere on the scan; a mirror plane (nx, ny, nz, d) or an axis
        (px, py, pz, dx, dy, dz, count) say where that is. See `ReliefSettings`.
    seed : int
        The same seed gives the same bits.
    device : str, optional
        "cpu", "cuda:0"; default CUDA if there is one.
    progress : callable, optional
        Called with (steps done, steps to do).

    Returns
    -------
    Surface
        Measured vertices first, filled ones after them, with ``measured``, ``source``, ``rotation``, ``error``, ``confidence``
        (pieces), the base in ``model`` and in ``notes`` what was chosen. Over a smooth base, vertices too far from every hole to
        matter have no base: theirs is the vertex itself.

    Raises
    ------
    InputError
        For a surface or argument that can't be used.
    FitError
        If no base fits, or several fit equally well.

    References
    ----------
    T. P. Breckon, R. B. Fisher, "Three-Dimensional Surface Relief Completion via Nonparametric Techniques", IEEE TPAMI
    30(12), 2008; "Non-parametric 3D Surface Completion", 3DIM 2005, section 3 and appendix A.

    Examples
    --------
    A wavy sheet with a hole:

    >>> import numpy as np
    >>> import intaglio
    >>> x, y = np.meshgrid(np.arange(24.0), np.arange(24.0))
    >>> points = np.stack([x, y, 0.4 * np.sin(x)], axis=-1)
    >>> points[9:13, 9:13] = np.nan
    >>> scan = intaglio.surface_from_range_image(points, view=(12, 12, 100))
    >>> whole = intaglio.complete_relief(scan, "plane", window=4, rotations=1, extent="holes")
    >>> int((~whole.measured).sum())
    16
    >>> bool(np.array_equal(whole.vertices[whole.measured], scan.vertices))
    True
    """
    settings = ReliefSettings(
        window=window,
        rotations=rotations,
        refine=refine,
        color_weight=color_weight,
        symmetry=symmetry,
    )
    near = chosen_sources(surface, exemplar).near
    prepared = prepare_relief(surface, base, spacing=spacing, extent=extent, holes=holes, near=near, device=device)
    return prepared.complete(settings, exemplar=exemplar, guides=guides, seed=seed, progress=progress)


@checked_arguments
def prepare_relief(
    surface: Surface,
    base: Base | str = "auto",
    *,
    spacing: float | None = None,
    extent: str | Sequence[float] | None = None,
    holes: Holes = None,
    hole_size: Sequence[float] | None = None,
    relief_scale: float | None = None,
    frames: str | None = None,
    reference: Array | None = None,
    near: bool = True,
    device: str | None = None,
) -> PreparedRelief:
    """Prepare a scan for completion: fit its base, lay targets over what is missing, and set local frames.

    Parameters
    ----------
    surface : Surface
        The scan; all its vertices count as measured.
    base : Base or {"auto", "plane", "cylinder", "sphere", "smooth"}
        The base, or the kind to fit; see `complete_relief`.
    spacing : float, optional
        Distance between targets, a length in the input's unit; default from the scan's edges.
    extent : str or sequence of float, optional
        What to complete of a plane, cylinder or sphere; see `complete_relief`.
    holes : {"all", "largest", "every"}, int or sequence of int, optional
        With a smooth base: what to fill; see `complete_relief`.
    hole_size : (low, high), optional
        With a smooth base: only holes whose rim is so long, in the input's unit.
    relief_scale : float, optional
        With a smooth base: the wave length, in the input's unit, below which the surface is relief; default 12 spacings.
    frames : {"algebraic", "sweep", "reference"}, optional
        Local frames: from the normal's smallest component, swept from neighbour to neighbour, or the projection of one
        vector. Default by the base: a global reference on a plane and a cylinder, the sweep elsewhere.
    reference : (3,) array, optional
        The vector for "reference"; default the cylinder's axis or the plane's chart direction.
    near : bool
        With a smooth base: work on the surroundings of the holes alone, which costs by the hole and not by the scan.
    device : str, optional
        "cpu", "cuda:0"; default CUDA if there is one.

    Returns
    -------
    PreparedRelief
        Its ``complete`` grows relief with any settings, without fitting again.

    Raises
    ------
    InputError
        For a surface or argument that can't be used.
    FitError
        If no base fits, or several fit equally well.

    References
    ----------
    Breckon & Fisher, IEEE TPAMI 30(12), 2008, section 2.1.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> x, y = np.meshgrid(np.arange(24.0), np.arange(24.0))
    >>> points = np.stack([x, y, 0.4 * np.sin(x)], axis=-1)
    >>> points[9:13, 9:13] = np.nan
    >>> scan = intaglio.surface_from_range_image(points, view=(12, 12, 100))
    >>> prepared = intaglio.prepare_relief(scan, "plane", extent="holes")
    >>> prepared.base.kind, prepared.targets
    ('plane', 16)
    >>> narrow, wide = (prepared.complete(intaglio.ReliefSettings(window=w, rotations=1)) for w in (3, 6))
    >>> len(narrow.vertices) == len(wide.vertices)
    True
    """
    _check_surface(surface)
    if frames is not None:
        checked_choice("frames", frames, FRAMES)
    chosen_device = device_or_error(device)
    options = GroundOptions(spacing, extent, holes, hole_size, relief_scale, frames, reference, near)
    ground = prepare_ground(surface, base, options, device=chosen_device)
    _check_samples(ground)
    return PreparedRelief(surface, ground, options, chosen_device)


def _check_surface(surface: Surface) -> None:
    """Raise `InputError` for what is no surface, or one that holds filled vertices."""
    if not isinstance(surface, Surface):
        raise InputError(f"surface must be an intaglio.Surface, not {type(surface).__name__}; read_surface(path) gives one")
    made_up = int((~surface.measured).sum())
    if made_up:
        raise InputError(
            f"the surface holds {made_up} vertices that were filled, not measured: they can't serve as measurements; "
            "complete the scan itself"
        )


def _check_samples(ground: Ground) -> None:
    """Raise `InputError` where no measured vertex has measured surface all around it."""
    inner = ground.measured.copy()
    inner[ground.faces[~ground.measured[ground.faces].all(axis=1)]] = False
    inner[np.unique(border_edges(ground.faces))] = False
    if not inner.any():
        raise InputError(
            f"fewer samples than the smallest window needs: none of {int(ground.measured.sum())} measured vertices has "
            "measured surface all around it"
        )
