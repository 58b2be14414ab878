"""A scan that is prepared for completion: stage two with any settings, seeds, exemplars and guides."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from intaglio.arrays import Array, Progress
from intaglio.checks import check_fields, checked_arguments, checked_count, checked_positive
from intaglio.errors import InputError
from intaglio.mesh import Base, SmoothBase, Surface
from intaglio.randomness import checked_seed
from intaglio.relief.assembly import Filled, assemble
from intaglio.relief.exemplar import Exemplar, chosen_sources
from intaglio.relief.ground import Ground, GroundOptions, prepare_ground
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
_MOST_CANDIDATES = 100


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
        exemplar : {"near", "all"}, (V,) bool array, (K,) int array, (4,) sequence of float, Surface or sequence
            The vertices of the scan whose relief may be taken, or other scans; see `complete_relief`. The scan's surroundings are
            compared as a whole all the same.
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
        return self._completed(settings, exemplar, guides, seed, 0, memory, progress)

    @checked_arguments
    def candidates(
        self,
        count: int,
        settings: ReliefSettings | None = None,
        *,
        exemplar: Exemplar = "near",
        guides: Guides = "auto",
        seed: int = 0,
        memory: float | None = None,
        progress: Progress | None = None,
    ) -> list[Surface]:
        """Grow relief over the targets several times, so that a person chooses.

        Parameters
        ----------
        count : int
            Of completions, 1 to 100.
        settings, exemplar, guides, seed, memory, progress : optional
            As in `complete`.

        Returns
        -------
        list of Surface
            The first is what `complete` gives. Candidate k, from 0, grows with seed + k; a hole that is filled from a place that
            is alike takes the k-th best such place, and pieces where there are no more.

        Raises
        ------
        InputError
            As `complete`.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> x, y = np.meshgrid(np.arange(24.0), np.arange(24.0))
        >>> points = np.stack([x, y, 0.4 * np.sin(x)], axis=-1)
        >>> points[9:13, 9:13] = np.nan
        >>> scan = intaglio.surface_from_range_image(points, view=(12, 12, 100))
        >>> prepared = intaglio.prepare_relief(scan, "plane", extent="holes")
        >>> three = prepared.candidates(3, intaglio.ReliefSettings(window=3))
        >>> [int((~whole.measured).sum()) for whole in three]
        [16, 16, 16]
        """
        count = checked_count("count", count, 1, _MOST_CANDIDATES)
        seed = checked_seed(seed)
        out = []
        for number in range(count):

            def report(done: int, total: int, number: int = number) -> None:
                if progress is not None:
                    progress(number * total + done, count * total)

            told = report if progress is None or callable(progress) else progress
            out.append(self._completed(settings, exemplar, guides, seed + number, number, memory, told))
        return out

    def _completed(
        self,
        settings: ReliefSettings | None,
        exemplar: Exemplar,
        guides: Guides,
        seed: int,
        rank: int,
        memory: float | None,
        progress: Progress | None,
    ) -> Surface:
        """Grow relief over the targets, from the place of that rank where some are alike to a hole."""
        settings = ReliefSettings() if settings is None else settings
        resources = self._resources(settings, seed, memory, rank)
        if progress is not None and not callable(progress):
            raise InputError(f"progress must be callable, not {type(progress).__name__}")
        ground = self.ground
        sources = chosen_sources(self.surface, exemplar)
        lines = checked_guides(guides)
        relief = ground.height[ground.measured]
        flat: tuple[str, ...] = ()
        if float(np.ptp(relief)) <= _NO_RELIEF * ground.spacing:
            flat = ("the scan has no relief over its base: what was filled is the smooth surface",)
        smooth = isinstance(ground.base, SmoothBase)
        if (settings.method or ("pieces" if smooth else "propagation")) == "pieces":
            filled = fill_regions(self.surface, ground, sources, lines, settings, resources, progress)
            return assemble(self.surface, ground, filled, filled.notes + flat, self.device)
        if sources.others:
            raise InputError("exemplar holds other scans, which go with method='pieces'; leave them out or change the method")
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
        samples, oversampled = self._samples(ground, settings, parameters, sources.allowed)
        stage = run_stage(ground, samples, parameters, settings, comparison, resources, progress)
        notes += stage.notes
        notes += _account(ground, stage, settings, parameters, resources, oversampled)
        notes += flat
        if stage.growth.orphans:
            notes += (f"{stage.growth.orphans} targets had no sample to compare with and carry a neighbour's relief",)
        return assemble(self.surface, ground, _grown(ground, stage), notes, self.device)

    def _resources(self, settings: ReliefSettings, seed: int, memory: float | None, rank: int) -> Resources:
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
        return Resources(seed, self.device, memory, rank)

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
