"""`complete_relief`: what a scan did not see, with its relief."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.randomness import checked_seed
from intaglio.relief.base import Base
from intaglio.relief.displacement_metric import DisplacementMetric
from intaglio.relief.frames import FRAMES
from intaglio.relief.holes import Holes
from intaglio.relief.prepare import Ground, number, prepare_ground
from intaglio.relief.propagate import Growth, Metric, Selection, grow_relief
from intaglio.relief.refine import refine_relief
from intaglio.relief.rim import shift_to_rim
from intaglio.relief.samples import sample_set
from intaglio.relief.smooth_base import SmoothBase
from intaglio.relief.surface_metric import SurfaceMetric
from intaglio.surface import Surface
from intaglio.topology import border_edges

Array = np.ndarray

DEFAULT_WINDOW = 7
# Beyond this many candidates (samples times rotations) the sample set is not oversampled unless asked for: halving all
# edges makes four times as many.
_OVERSAMPLE_UP_TO = 100_000


def complete_relief(
    surface: Surface,
    base: Base | str = "auto",
    window: int | None = None,
    error: float | None = None,
    rotations: int = 1,
    metric: str = "displacement",
    order: str = "wave",
    levels: int = 1,
    refine: int = 0,
    color_weight: float | None = None,
    spacing: float | None = None,
    extent: str | Sequence[float] | None = None,
    search: str = "auto",
    seed: int = 0,
    device: str | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    frames: str | None = None,
    reference: Array | None = None,
    oversample: bool | None = None,
    bootstrap: bool = False,
    selection: str = "near-best",
    factor: float = 1.1,
    eta: float = 10.0,
    engine: str = "auto",
    holes: Holes = None,
    hole_size: Sequence[float] | None = None,
    relief_scale: float | None = None,
) -> Surface:
    """Complete what a scan did not see: its smooth base, and over it the scan's own relief.

    Stage one fits the base and lays target points over the missing part at the scan's density. Stage two grows the
    relief from the scan's border over the targets: every target takes the displacement of a measured vertex whose
    surroundings look like what is known of its own.

    Parameters
    ----------
    surface : Surface
        The scan. Its vertices come out bit for bit as they are, first and in the same order, except those of pieces that
        don't lie on the base or that no face uses: these are left out, and the notes say how many.
    base : Base or {"auto", "plane", "cylinder", "sphere"}
        The base, or the kind to fit.
    window : int, optional
        w: radius of the neighbourhoods, in edges (times ``spacing`` in length). It should cover the largest feature that
        repeats. Default 7.
    error : float, optional
        e: a match is accepted below this weighted mean squared distance, in squared input units; default half the
        variance of the measured displacement. Rises by 10 % whenever no target can be filled.
    rotations : int
        R: every sample is tried at R rotations about its normal. 0 or 1 for none, as suits relief with a direction; more
        for isotropic relief.
    metric : {"displacement", "surface"}
        "displacement" compares heights over a tangent grid; "surface" is the papers' point-to-triangle measure, slower.
    order : {"wave", "sequential"}
        "wave" fills the whole boundary list at once; "sequential" one vertex after the other, as the papers do.
    levels : int
        Only 1: relief is completed at one scale.
    refine : int
        Passes that match the filled part again as a whole, vote, and copy; removes what growth got wrong. 0: none.
    color_weight : float, optional
        Only None: shape alone decides; colours are carried along with the relief.
    spacing : float, optional
        Distance between targets, a length in the input's unit; default from the scan's edges.
    extent : str or sequence of float, optional
        What to complete: None or "whole", "rectangle", "holes", or numbers; see `intaglio.relief.extent`.
    search : {"auto", "exhaustive"}
        Every sample is compared.
    seed : int
        The same seed gives the same bits.
    device : str, optional
        "cpu", "cuda:0"; default CUDA if there is one.
    progress : callable, optional
        Called with (vertices matched, vertices to match); refinement passes match every filled vertex again.
    frames : {"algebraic", "sweep", "reference"}, optional
        Local frames; default by the base. ``reference`` is the vector for "reference".
    oversample : bool, optional
        Halve the sample set's edges; default where targets don't continue the scan's lattice and candidates stay few.
    bootstrap : bool
        Filled vertices become samples.
    selection : {"near-best", "best-percent"}
        At random among matches within ``factor`` of the best (paper 000), or among the best ``eta`` percent (paper 001).
    engine : {"auto", "blas", "warp"}
        How the displacement metric's costs are computed; with "near-best" the choices are the same.

    Returns
    -------
    Surface
        Measured vertices first, filled ones after them, with ``measured``, ``source``, ``rotation``, ``error``, the base
        in ``model`` and in ``notes`` what was chosen.

    Raises
    ------
    InputError
        For a surface or argument that can't be used.
    FitError
        If no base fits, or several fit equally well.

    References
    ----------
    T. P. Breckon, R. B. Fisher, *Three-Dimensional Surface Relief Completion via Nonparametric Techniques*, IEEE TPAMI
    30(12), 2008; *Non-parametric 3D Surface Completion*, section 3 and appendix A.

    Examples
    --------
    >>> import intaglio
    >>> scan = intaglio.read_surface("golfball.ply")  # doctest: +SKIP
    >>> whole = intaglio.complete_relief(scan, base="sphere", rotations=24, seed=1)  # doctest: +SKIP
    """
    _check_surface(surface)
    window = DEFAULT_WINDOW if window is None else _whole(window, "window", 1, 64)
    rotations = _whole(rotations, "rotations", 0, 720) or 1
    refine = _whole(refine, "refine", 0, 100)
    seed = checked_seed(seed)
    for name, value, known in (
        ("metric", metric, ("displacement", "surface")),
        ("order", order, ("wave", "sequential")),
        ("search", search, ("auto", "exhaustive")),
        ("engine", engine, ("auto", "blas", "warp")),
        ("frames", frames, (None, *FRAMES)),
    ):
        if not (value is None or isinstance(value, str)) or value not in known:
            raise InputError(f"{name} must be one of {', '.join(map(repr, known))}, not {value!r}")
    if progress is not None and not callable(progress):
        raise InputError(f"progress must be callable, not {type(progress).__name__}")
    _check_combination(levels, color_weight, refine, metric, bootstrap)
    chosen_device = device_or_error(device)
    if engine == "blas" and not chosen_device.startswith("cpu"):
        raise InputError(f"engine='blas' runs on the CPU, not on {chosen_device}; give device='cpu' or engine='auto'")
    ground = prepare_ground(
        surface, base, spacing=spacing, extent=extent, frames=frames, reference=reference,
        holes=holes, hole_size=hole_size, relief_scale=relief_scale, device=chosen_device,
    )  # fmt: skip
    relief = ground.height[ground.measured]
    rule = _selection(selection, factor, eta, error, relief, ground.spacing)
    if oversample is None:
        oversample = not ground.regular and 4 * len(relief) * rotations <= _OVERSAMPLE_UP_TO
    samples = sample_set(ground, oversample)
    _check_samples(ground)
    matcher: Metric
    if metric == "displacement":
        matcher = DisplacementMetric(ground, samples, window, rotations, chosen_device, engine)
    else:
        matcher = SurfaceMetric(ground, samples, window, rotations, chosen_device)
    # A refinement pass counts as much as growth: every vertex is matched once in each.
    shares = 1 + refine

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(done, total * shares)

    growth = grow_relief(
        ground, matcher, window=window, selection=rule, order=order, bootstrap=bootstrap, seed=seed, progress=report
    )
    passes = 0
    if refine:
        assert isinstance(matcher, DisplacementMetric)
        passes = refine_relief(ground, matcher, growth.state, window=window, passes=refine, seed=seed, progress=progress)
    settings: tuple[str, ...] = (
        f"window {window} (reach {window * ground.spacing:.6g}), rotations {rotations}, metric {metric}, order {order}, "
        f"{len(samples.vertex)} samples{' (oversampled)' if oversample else ''}, seed {seed}, device {chosen_device}",
        f"grown in {growth.waves} lists; error bound {rule.error:.6g} at first, {growth.threshold:.6g} at last; "
        f"{growth.shrunk} windows shrunk" + (f"; {passes} refinement passes" if passes else ""),
    )
    if growth.orphans:
        settings += (f"{growth.orphans} targets had no sample to compare with and carry a neighbour's relief",)
    return _completed(ground, growth, settings)


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


def _completed(ground: Ground, growth: Growth, settings: tuple[str, ...]) -> Surface:
    state = growth.state
    vertices = ground.vertices.copy()
    filled = state.textured & ~ground.measured
    foot, model = ground.foot, ground.base
    if isinstance(model, SmoothBase):
        foot = foot + shift_to_rim(ground, state)[:, None] * ground.normal
        model = replace(model, vertices=foot)
    vertices[filled] = foot[filled] + state.height[filled, None] * ground.normal[filled]
    return Surface(
        vertices=vertices,
        faces=ground.faces,
        base=foot,
        normal=ground.normal,
        color=state.color,
        measured=ground.measured,
        source=state.source,
        rotation=state.rotation,
        error=state.error,
        model=model,
        notes=ground.notes + settings,
    )


def _check_surface(surface: Surface) -> None:
    if not isinstance(surface, Surface):
        raise InputError(f"surface must be an intaglio.Surface, not {type(surface).__name__}; read_surface(path) gives one")
    made_up = int((~surface.measured).sum())
    if made_up:
        raise InputError(
            f"the surface holds {made_up} vertices that were filled, not measured: they can't serve as measurements; "
            "complete the scan itself, or surface.part(surface.measured)"
        )


def _check_combination(levels: int, color_weight: float | None, refine: int, metric: str, bootstrap: bool) -> None:
    """Refuse what can't be had, or not together."""
    if levels != 1:
        raise InputError(f"levels={levels!r}: relief is completed at one scale only; leave levels at 1")
    if color_weight is not None:
        raise InputError("color_weight: matching goes by shape alone; leave it None (colours are carried along)")
    if refine and metric == "surface":
        raise InputError("refine works with metric='displacement'; set refine=0 or change the metric")
    if refine and bootstrap:
        raise InputError("refine copies from measured samples; set bootstrap=False or refine=0")


def _selection(rule: str, factor: float, eta: float, error: float | None, relief: Array, spacing: float) -> Selection:
    """How matches are chosen; the default error bound is half the variance of the measured relief."""
    if rule not in ("near-best", "best-percent"):
        raise InputError(f"selection must be 'near-best' or 'best-percent', not {rule!r}")
    factor, eta = number(factor, "factor"), number(eta, "eta")
    if factor < 1:
        raise InputError(f"factor must be at least 1, not {factor!r}")
    if not 0 < eta <= 100:
        raise InputError(f"eta is a percentage in (0, 100], not {eta!r}")
    if error is None:
        error = max(0.5 * float(relief.var()), 1e-12 * spacing**2)
    elif number(error, "error") <= 0:
        raise InputError(f"error must be a positive number, in squared input units, not {error!r}")
    return Selection(rule, factor, eta, float(error))


def _whole(value: int, name: str, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise InputError(f"{name} must be a whole number from {least} to {most}, not {value!r}")
    return int(value)
