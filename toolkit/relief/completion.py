"""`complete_relief` and the prepared scan behind it: what a scan did not see, with its relief."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import check_fields, checked_arguments, checked_choice, checked_positive
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.mesh import Base, SmoothBase, Surface, border_edges
from intaglio.randomness import checked_seed
from intaglio.relief.assembly import Filled, assemble
from intaglio.relief.exemplar import Exemplar, chosen_vertices
from intaglio.relief.ground import FRAMES, Ground, GroundOptions, Holes, prepare_ground
from intaglio.relief.growth import (
    Comparison,
    Parameters,
    ReliefSettings,
    Resources,
    Samples,
    Stage,
    choose_parameters,
    compare_by,
    complete_coarse_levels,
    frames_along,
    refinement_passes,
    run_stage,
    sample_set,
    shift_to_rim,
)
from intaglio.relief.lines import Guides, checked_guides
from intaglio.relief.regions import fill_regions

# A scan whose heights differ by less than this share of the spacing has no relief.
_NO_RELIEF = 1e-4
# Beyond this many candidates (samples times rotations) the sample set is not oversampled unless asked for: halving all
# edges makes four times as many.
_OVERSAMPLE_UP_TO = 100_000


@checked_arguments
def complete_relief(
    surface: Surface,
    base: Base | str = "auto",
    *,
    window: int | None = None,
    rotations: int | None = None,
    levels: int = 1,
    refine: int | None = None,
    color_weight: float | None = None,
    spacing: float | None = None,
    extent: str | Sequence[float] | None = None,
    holes: Holes = None,
    exemplar: Exemplar = "near",
    guides: Guides = "auto",
    symmetry: str | Sequence[float] = "auto",
    search: str = "auto",
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
    levels : int
        Propagation: scales, 1 to 6.
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
    exemplar : {"near", "all"}, (V,) bool array, (K,) int array or (4,) sequence of float
        Where relief may come from. "near": over a smooth base the surroundings of each hole, else all of the scan. A mask or
        numbers of the scan's vertices, or a ball: its centre and radius.
    guides : {"auto", "none"} or sequence of (K, 3) arrays
        Pieces: lines across the holes. "auto": creases, ridges and valleys that reach a rim on both sides and fit together are
        carried on. Polylines, as `read_guides` gives them, replace what is found near them and add to the rest.
    symmetry : {"auto", "none"} or sequence of float
        Pieces: whether a hole is filled as a whole from its like elsewhere on the scan; a mirror plane (nx, ny, nz, d) or an axis
        (px, py, pz, dx, dy, dz, count) say where that is. See `ReliefSettings`.
    search : {"auto", "exhaustive", "approximate"}
        Propagation: compare every sample, or look in likely places.
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
        levels=levels,
        refine=refine,
        color_weight=color_weight,
        search=search,
        symmetry=symmetry,
    )
    near = isinstance(exemplar, str) and exemplar == "near"
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


@dataclass(frozen=True)
class PreparedRelief:
    """A scan over its base, with targets over what is missing: what `prepare_relief` returns.

    Parameters
    ----------
    surface : Surface
        The scan.
    ground : Ground
        Base, targets, triangulation and frames.
    options : GroundOptions
        What the ground was laid with.
    device : str
        Where the work is done.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> x, y = np.meshgrid(np.arange(24.0), np.arange(24.0))
    >>> points = np.stack([x, y, 0.4 * np.sin(x)], axis=-1)
    >>> points[9:13, 9:13] = np.nan
    >>> scan = intaglio.surface_from_range_image(points, view=(12, 12, 100))
    >>> prepared = intaglio.prepare_relief(scan, "plane", extent="holes")
    >>> prepared.targets, round(prepared.spacing, 2)
    (16, 1.0)
    """

    surface: Surface
    ground: Ground
    options: GroundOptions
    device: str

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def base(self) -> Base:
        """The smooth base, with its fit if it was fitted.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> x, y = np.meshgrid(np.arange(16.0), np.arange(16.0))
        >>> points = np.stack([x, y, 0.4 * np.sin(x)], axis=-1)
        >>> points[6:9, 6:9] = np.nan
        >>> scan = intaglio.surface_from_range_image(points, view=(8, 8, 100))
        >>> prepared = intaglio.prepare_relief(scan, "plane", extent="holes")
        >>> prepared.base.kind
        'plane'
        """
        return self.ground.base

    @property
    def spacing(self) -> float:
        """Distance between targets, in the input's unit.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> x, y = np.meshgrid(np.arange(16.0), np.arange(16.0))
        >>> points = np.stack([x, y, 0.4 * np.sin(x)], axis=-1)
        >>> points[6:9, 6:9] = np.nan
        >>> scan = intaglio.surface_from_range_image(points, view=(8, 8, 100))
        >>> prepared = intaglio.prepare_relief(scan, "plane", extent="holes")
        >>> round(prepared.spacing, 1)
        1.0
        """
        return self.ground.spacing

    @property
    def targets(self) -> int:
        """How many vertices are to be filled.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> x, y = np.meshgrid(np.arange(16.0), np.arange(16.0))
        >>> points = np.stack([x, y, 0.4 * np.sin(x)], axis=-1)
        >>> points[6:9, 6:9] = np.nan
        >>> scan = intaglio.surface_from_range_image(points, view=(8, 8, 100))
        >>> prepared = intaglio.prepare_relief(scan, "plane", extent="holes")
        >>> prepared.targets
        9
        """
        return int((~self.ground.measured).sum())

    @property
    def notes(self) -> tuple[str, ...]:
        """What was chosen, for the user.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> x, y = np.meshgrid(np.arange(16.0), np.arange(16.0))
        >>> points = np.stack([x, y, 0.4 * np.sin(x)], axis=-1)
        >>> points[6:9, 6:9] = np.nan
        >>> scan = intaglio.surface_from_range_image(points, view=(8, 8, 100))
        >>> prepared = intaglio.prepare_relief(scan, "plane", extent="holes")
        >>> prepared.notes[-1]
        '9 targets in 1 region'
        """
        return self.ground.notes

    @checked_arguments
    def complete(
        self,
        settings: ReliefSettings | None = None,
        *,
        exemplar: Exemplar = "near",
        guides: Guides = "auto",
        seed: int = 0,
        memory: float | None = None,
        progress: Progress | None = None,
    ) -> Surface:
        """Grow relief over the targets.

        Parameters
        ----------
        settings : ReliefSettings, optional
            Default: every choice left to the relief.
        exemplar : {"near", "all"}, (V,) bool array, (K,) int array or (4,) sequence of float
            The vertices of the scan whose relief may be taken; see `complete_relief`. Their surroundings are compared as a whole
            all the same.
        guides : {"auto", "none"} or sequence of (K, 3) arrays
            Lines across the holes; see `complete_relief`.
        seed : int
            The same seed gives the same bits.
        memory : float, optional
            Most memory of the process, in GiB: propagation makes its tables in chunks and thins samples to fit, with the
            displacement metric.
        progress : callable, optional
            Called with (steps done, steps to do).

        Returns
        -------
        Surface
            See `complete_relief`.

        Raises
        ------
        InputError
            For settings that don't go with the scan, or an exemplar that leaves no sample.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> x, y = np.meshgrid(np.arange(24.0), np.arange(24.0))
        >>> points = np.stack([x, y, 0.4 * np.sin(x)], axis=-1)
        >>> points[9:13, 9:13] = np.nan
        >>> scan = intaglio.surface_from_range_image(points, view=(12, 12, 100))
        >>> prepared = intaglio.prepare_relief(scan, "plane", extent="holes")
        >>> left = scan.vertices[:, 0] < 9
        >>> whole = prepared.complete(intaglio.ReliefSettings(window=3), exemplar=left)
        >>> bool(left[whole.source[~whole.measured]].all())
        True
        """
        settings = ReliefSettings() if settings is None else settings
        resources = self._resources(settings, seed, memory)
        if progress is not None and not callable(progress):
            raise InputError(f"progress must be callable, not {type(progress).__name__}")
        ground = self.ground
        chosen = chosen_vertices(self.surface, exemplar)
        lines = checked_guides(guides)
        relief = ground.height[ground.measured]
        flat: tuple[str, ...] = ()
        if float(np.ptp(relief)) <= _NO_RELIEF * ground.spacing:
            flat = ("the scan has no relief over its base: what was filled is the smooth surface",)
        smooth = isinstance(ground.base, SmoothBase)
        if (settings.method or ("pieces" if smooth else "propagation")) == "pieces":
            near = isinstance(exemplar, str) and exemplar == "near"
            everything = np.ones(len(self.surface.vertices), bool) if chosen is None else chosen
            allowed = None if near else everything[ground.kept]
            filled = fill_regions(self.surface, ground, allowed, lines, settings, resources, progress)
            return assemble(self.surface, ground, filled, filled.notes + flat, self.device)
        if not isinstance(lines, str):
            raise InputError("guides go with method='pieces'; leave them out or change the method")
        settings = replace(settings, refine=refinement_passes(settings, smooth or self.options.extent == "holes"))
        comparison = compare_by(ground, settings.color_weight)
        variance = comparison.variance(relief, None if ground.color is None else ground.color[ground.measured])
        parameters = choose_parameters(
            ground, settings.window, settings.error, settings.rotations, variance, 1 - comparison.color_weight
        )
        notes = parameters.notes
        if settings.levels > 1:
            ground, comparison, parameters, said = self._complete_coarser(settings, comparison, parameters, resources)
            notes += said
        samples, oversampled = self._samples(ground, settings, parameters, chosen)
        stage = run_stage(ground, samples, parameters, settings, comparison, resources, progress)
        notes += stage.notes
        notes += _account(ground, stage, settings, parameters, resources, oversampled)
        notes += flat
        if stage.growth.orphans:
            notes += (f"{stage.growth.orphans} targets had no sample to compare with and carry a neighbour's relief",)
        return assemble(self.surface, ground, _grown(ground, stage), notes, self.device)

    def _resources(self, settings: ReliefSettings, seed: int, memory: float | None) -> Resources:
        """Return what the work may use, checked against the settings."""
        if not isinstance(settings, ReliefSettings):
            raise InputError(f"settings must be an intaglio.ReliefSettings, not {type(settings).__name__}")
        seed = checked_seed(seed)
        if memory is not None:
            memory = checked_positive("memory", memory)
            if settings.metric == "surface":
                raise InputError("memory works with metric='displacement'; leave it out or change the metric")
        if settings.engine == "blas" and not self.device.startswith("cpu"):
            raise InputError(f"engine='blas' runs on the CPU, not on {self.device}; give device='cpu' or engine='auto'")
        return Resources(seed, self.device, memory)

    def _complete_coarser(
        self, settings: ReliefSettings, comparison: Comparison, parameters: Parameters, resources: Resources
    ) -> tuple[Ground, Comparison, Parameters, tuple[str, ...]]:
        """Complete the coarser levels; return ground, comparison and parameters of the finest, guided by them, and notes."""
        ground = self.ground
        guide = complete_coarse_levels(ground, self._at_spacing(), parameters, settings, resources)
        notes = [f"{settings.levels} levels, the coarsest with targets {ground.spacing * 2 ** (settings.levels - 1):.4g} apart"]
        if settings.along_relief:
            u, v = frames_along(ground, guide)
            ground = replace(ground, u=u, v=v)
            if settings.rotations is None:
                notes.append("rotations 1 at the finest level: frames lie along the coarser relief")
                parameters = replace(parameters, rotations=1)
        return ground, replace(comparison, coarse=guide), parameters, tuple(notes)

    def _at_spacing(self) -> Callable[[float], Ground]:
        """Return what lays targets further apart over the same base; a smooth base is laid anew, at the same relief scale."""
        base: Base | str = self.ground.base
        options = self.options
        if isinstance(base, SmoothBase):
            options, base = replace(options, relief_scale=base.relief_scale), "smooth"
        return lambda spacing: prepare_ground(self.surface, base, replace(options, spacing=spacing), device=self.device)

    def _samples(
        self, ground: Ground, settings: ReliefSettings, parameters: Parameters, exemplar: Array | None
    ) -> tuple[Samples, bool | int]:
        """Return the samples, those of the exemplar if there is one, and whether their edges were halved."""
        oversample = settings.oversample
        if oversample is None:
            candidates = 4 * int(ground.measured.sum()) * parameters.rotations
            oversample = not ground.regular and candidates <= _OVERSAMPLE_UP_TO
        samples = sample_set(ground, int(oversample))
        if exemplar is None:
            return samples, oversample
        if settings.bootstrap:
            raise InputError("exemplar and bootstrap exclude each other: with bootstrap every textured vertex becomes a sample")
        keep = np.flatnonzero(exemplar[ground.kept][samples.vertex])
        if len(keep) == 0:
            raise InputError("exemplar selects no vertex of the scan that lies on the base: there is nothing to take relief from")
        return samples.part(keep), oversample


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


def _account(
    ground: Ground, stage: Stage, settings: ReliefSettings, parameters: Parameters, resources: Resources, oversampled: bool | int
) -> tuple[str, ...]:
    """Return notes of what the relief was grown with and how it went."""
    window, growth = parameters.window, stage.growth
    return (
        f"window {window} (reach {window * ground.spacing:.6g}), rotations {parameters.rotations}, metric {settings.metric}, "
        f"order {settings.order}, {len(stage.samples.vertex)} samples{' (oversampled)' if oversampled else ''}, "
        f"seed {resources.seed}, device {resources.device}",
        f"grown in {growth.waves} lists; error bound {parameters.error:.6g} at first, {growth.threshold:.6g} at last; "
        f"{growth.shrunk} windows shrunk" + (f"; {stage.passes} refinement passes" if stage.passes else ""),
    )


def _grown(ground: Ground, stage: Stage) -> Filled:
    """Return what propagation filled."""
    state = stage.growth.state
    foot = ground.foot
    if isinstance(ground.base, SmoothBase):
        foot = foot + shift_to_rim(ground, state, stage.samples)[:, None] * ground.normal
    filled = state.textured & ~ground.measured
    vertices = np.where(filled[:, None], foot + state.height[:, None] * ground.normal, ground.vertices)
    base = replace(ground.base, vertices=foot) if isinstance(ground.base, SmoothBase) else ground.base
    ground = replace(ground, foot=foot, base=base)
    return Filled(ground, vertices, state.source, state.rotation, state.error, None, state.color, ())
