"""`complete_relief`: what a scan did not see, with its relief."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import checked_count, checked_positive
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.kernels.location import polar_grid
from intaglio.mesh import Base, SmoothBase, Surface
from intaglio.randomness import checked_seed
from intaglio.relief.ground import FRAMES, Ground, Holes, prepare_ground
from intaglio.relief.growth import (
    DisplacementMetric,
    Growth,
    Metric,
    Samples,
    SurfaceMetric,
    check_combination,
    check_samples,
    check_surface,
    checked_selection,
    choose_parameters,
    coarse_relief,
    compare_by,
    frames_along,
    grow_relief,
    plan_search,
    refine_relief,
    sample_set,
    shift_to_rim,
)

# A scan whose heights differ by less than this share of the spacing has no relief.
_NO_RELIEF = 1e-4
# Beyond this many candidates (samples times rotations) the sample set is not oversampled unless asked for: halving all
# edges makes four times as many.
_OVERSAMPLE_UP_TO = 100_000


def complete_relief(
    surface: Surface,
    base: Base | str = "auto",
    window: int | None = None,
    error: float | None = None,
    rotations: int | None = None,
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
    progress: Progress | None = None,
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
    memory: float | None = None,
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
    base : Base or {"auto", "plane", "cylinder", "sphere", "smooth"}
        The base, or the kind to fit. "smooth": the scan's own smoothed surface, carried on over its holes. "auto": a plane,
        cylinder or sphere where one fits, else "smooth".
    window : int, optional
        w: radius of the neighbourhoods, in edges (times ``spacing`` in length). It should cover the largest feature that
        repeats. Default from the relief's period or correlation length.
    error : float, optional
        e: a match is accepted below this weighted mean squared distance, in squared input units; default
        from the noise, between a tenth and a half of the variance of what is compared. Rises by 10 % whenever no target can be
        filled. With several levels the difference in coarse relief counts in a match's distance as well.
    rotations : int, optional
        R: every sample is tried at R rotations about its normal. 0 or 1 for none, as suits relief with a direction; more
        for isotropic relief. Default 1 where the relief has a direction, else 12.
    metric : {"displacement", "surface"}
        "displacement" compares heights over a tangent grid; "surface" is the papers' point-to-triangle measure, slower.
    order : {"wave", "sequential"}
        "wave" fills the whole boundary list at once; "sequential" one vertex after the other, as the papers do.
    levels : int
        Scales, 1 to 6: relief is completed coarse to fine, each level's targets half as far apart as the one's before, and
        compared in the coarser relief as well.
    refine : int
        Passes that match the filled part again as a whole, vote, and copy; removes what growth got wrong. 0: none.
    color_weight : float, optional
        1 - mu of paper 000, section 6, in [0, 1]: how much colour counts beside shape, both normalised to [0, 1]. Costs are
        then the combined measure times the squared largest difference of measured displacements. Default: shape alone
        decides. Colours are carried along with the relief in any case.
    spacing : float, optional
        Distance between targets, a length in the input's unit; default from the scan's edges.
    extent : str or sequence of float, optional
        What to complete: None or "whole", "rectangle", "holes", or numbers; see `intaglio.relief.ground.extent`.
    search : {"auto", "exhaustive", "approximate"}
        "exhaustive" compares every sample; "approximate" looks beside what neighbours were matched to, and beside the best of
        some thousand samples. "auto": exhaustive up to 50,000 candidates (samples times rotations), and beyond while it is
        a matter of seconds.
    seed : int
        The same seed gives the same bits.
    device : str, optional
        "cpu", "cuda:0"; default CUDA if there is one.
    progress : callable, optional
        Called with (vertices matched, vertices to match); refinement passes match every filled vertex again.
    frames : {"algebraic", "sweep", "reference", "relief"}, optional
        Local frames; default by the base. ``reference`` is the vector for "reference". "relief" turns every frame along the
        slope of the coarser relief (levels > 1), so that one rotation does for relief without a direction.
    oversample : bool, optional
        Halve the sample set's edges; default where targets don't continue the scan's lattice and candidates stay few.
    bootstrap : bool
        Filled vertices become samples.
    selection : {"near-best", "best-percent"}
        At random among matches within ``factor`` of the best (paper 000), or among the best ``eta`` percent (paper 001).
    engine : {"auto", "blas", "warp"}
        How the displacement metric's costs are computed; with "near-best" the choices are the same.

    holes : {"all", "largest", "every"}, int or sequence of int, optional
        With a smooth base: what to fill. "all": the holes that the scan encloses (default); "every": where the scan ends as
        well; numbers as `intaglio info` lists them.
    hole_size : (low, high), optional
        With a smooth base: only holes whose rim is so long, in the input's unit.
    relief_scale : float, optional
        With a smooth base: the wave length, in the input's unit, below which the surface is relief; default 12 spacings.
    memory : float, optional
        Most memory of the process, in GiB: tables are made in chunks and samples thinned to fit.

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
    check_surface(surface)
    window = None if window is None else checked_count("window", window, 1, 64)
    rotations = None if rotations is None else checked_count("rotations", rotations, 0, 720) or 1
    refine = checked_count("refine", refine, 0, 100)
    levels = checked_count("levels", levels, 1, 6)
    seed = checked_seed(seed)
    for name, value, known in (
        ("metric", metric, ("displacement", "surface")),
        ("order", order, ("wave", "sequential")),
        ("search", search, ("auto", "exhaustive", "approximate")),
        ("engine", engine, ("auto", "blas", "warp")),
        ("frames", frames, (None, *FRAMES, "relief")),
    ):
        if not (value is None or isinstance(value, str)) or value not in known:
            raise InputError(f"{name} must be one of {', '.join(map(repr, known))}, not {value!r}")
    if progress is not None and not callable(progress):
        raise InputError(f"progress must be callable, not {type(progress).__name__}")
    check_combination(
        levels,
        color_weight,
        refine,
        metric,
        bootstrap=bootstrap,
        selection=selection,
        search=search,
        frames=frames,
        memory=memory,
    )
    memory = None if memory is None else checked_positive("memory", memory)
    chosen_device = device_or_error(device)
    if engine == "blas" and not chosen_device.startswith("cpu"):
        raise InputError(f"engine='blas' runs on the CPU, not on {chosen_device}; give device='cpu' or engine='auto'")

    def ground_at(distance: float | None, shape: Base | str = base, scale: float | None = relief_scale) -> Ground:
        return prepare_ground(
            surface, shape, spacing=distance, extent=extent, frames=None if frames == "relief" else frames,
            reference=reference, holes=holes, hole_size=hole_size, relief_scale=scale, device=chosen_device,
        )  # fmt: skip

    ground = ground_at(spacing)
    check_samples(ground)
    comparison = compare_by(ground, color_weight)
    relief = ground.height[ground.measured]
    variance = comparison.variance(relief, None if ground.color is None else ground.color[ground.measured])
    rule = checked_selection(selection, factor, eta, error)
    chosen = choose_parameters(ground, window, error, rotations, variance, 1 - comparison.color_weight)
    turned = rotations is None and frames == "relief"
    window, rotations = chosen.window, chosen.rotations
    rule = replace(rule, error=chosen.error)
    notes = chosen.notes
    if levels > 1:
        guide = coarse_relief(
            ground, _coarser(ground, ground_at), levels,
            window=window, rotations=rotations, selection=rule, seed=seed, device=chosen_device, memory=memory,
        )  # fmt: skip
        comparison = replace(comparison, coarse=guide)
        notes += (f"{levels} levels, the coarsest with targets {ground.spacing * 2 ** (levels - 1):.4g} apart",)
        if frames == "relief":
            u, v = frames_along(ground, guide)
            ground = replace(ground, u=u, v=v)
            if turned:
                notes += ("rotations 1 at the finest level: frames lie along the coarser relief",)
                rotations = 1
    if oversample is None:
        oversample = not ground.regular and 4 * len(relief) * rotations <= _OVERSAMPLE_UP_TO
    samples = sample_set(ground, oversample)
    matcher: Metric
    if metric == "displacement":
        points = len(polar_grid(max(window, 2), rotations)[1]) * len(comparison.factors())
        plan = plan_search(ground, samples, points, rotations, _search(search, bootstrap, selection), memory, seed)
        notes += plan.notes
        matcher = DisplacementMetric(
            ground, plan.samples, window, rotations, chosen_device, engine,
            comparison=comparison, approximate=plan.approximate, keep_grids=plan.keep_grids, seed=seed,
        )  # fmt: skip
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
        f"{len(matcher.samples.vertex)} samples{' (oversampled)' if oversample else ''}, seed {seed}, device {chosen_device}",
        f"grown in {growth.waves} lists; error bound {rule.error:.6g} at first, {growth.threshold:.6g} at last; "
        f"{growth.shrunk} windows shrunk" + (f"; {passes} refinement passes" if passes else ""),
    )
    if float(np.ptp(relief)) <= _NO_RELIEF * ground.spacing:
        settings += ("the scan has no relief over its base: what was filled is the smooth surface",)
    if growth.orphans:
        settings += (f"{growth.orphans} targets had no sample to compare with and carry a neighbour's relief",)
    return _completed(ground, growth, matcher.samples, notes + settings)


def _coarser(ground: Ground, ground_at: Callable[..., Ground]) -> Callable[[float], Ground]:
    """Grounds over the same base with targets further apart; a smooth base is laid anew, at the same relief scale."""
    if isinstance(ground.base, SmoothBase):
        scale = ground.base.relief_scale
        return lambda distance: ground_at(distance, "smooth", scale)
    return lambda distance: ground_at(distance, ground.base)


def _search(search: str, bootstrap: bool, selection: str) -> str:
    """Ranks and growing sample sets need every sample compared."""
    return "exhaustive" if search == "auto" and (bootstrap or selection == "best-percent") else search


def _completed(ground: Ground, growth: Growth, samples: Samples, notes: tuple[str, ...]) -> Surface:
    state = growth.state
    vertices = ground.vertices.copy()
    filled = state.textured & ~ground.measured
    foot, model = ground.foot, ground.base
    if isinstance(model, SmoothBase):
        foot = foot + shift_to_rim(ground, state, samples)[:, None] * ground.normal
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
        notes=ground.notes + notes,
    )
