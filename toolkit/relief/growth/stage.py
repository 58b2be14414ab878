"""One stage of growth: samples, a plan of their search, a metric, growth, refinement. Every level of a completion is one."""

from __future__ import annotations

from dataclasses import dataclass

from intaglio.arrays import Progress
from intaglio.kernels.location import polar_grid
from intaglio.relief.ground import Ground
from intaglio.relief.growth.comparison import Comparison
from intaglio.relief.growth.displacement_metric import DisplacementMetric
from intaglio.relief.growth.interpolation import ReliefBetween
from intaglio.relief.growth.parameters import Parameters
from intaglio.relief.growth.plan import plan_search
from intaglio.relief.growth.propagation import grow_relief
from intaglio.relief.growth.refinement import refine_relief
from intaglio.relief.growth.samples import Samples
from intaglio.relief.growth.settings import ReliefSettings
from intaglio.relief.growth.state import Growth, Metric, VotingMetric
from intaglio.relief.growth.surface_metric import SurfaceMetric


@dataclass(frozen=True)
class Resources:
    """What a stage may use: ``seed`` of its random numbers, ``device``, and ``memory`` of the process in GiB, None for all.

    ``rank`` says which of the places is taken that are alike to a hole: 0 the best.
    """

    seed: int
    device: str
    memory: float | None = None
    rank: int = 0


@dataclass(frozen=True)
class Stage:
    """A stage that is done.

    Attributes
    ----------
    growth : Growth
    samples : Samples
        What the state's ``sample`` numbers count.
    passes : int
        Refinement passes made.
    notes : tuple of str
        How the samples were searched.
    """

    growth: Growth
    samples: Samples
    passes: int
    notes: tuple[str, ...]


def run_stage(
    ground: Ground,
    samples: Samples,
    parameters: Parameters,
    settings: ReliefSettings,
    comparison: Comparison,
    resources: Resources,
    progress: Progress | None = None,
) -> Stage:
    """Grow relief over the targets of ``ground`` from ``samples``, and refine it.

    Parameters
    ----------
    ground : Ground
    samples : Samples
        The candidates; the plan may thin them to fit the memory.
    parameters : Parameters
        Window, rotations and error bound, all decided.
    settings : ReliefSettings
        Everything else that the user decides; its levels are not looked at.
    comparison : Comparison
        What neighbourhoods are compared in.
    resources : Resources
    progress : callable, optional
        Called with (vertices matched, vertices to match); refinement passes match every filled vertex again.
    """
    between = None
    if settings.interpolate:
        between = ReliefBetween(ground, samples)
        samples = between.inside(samples)
    samples = samples.subsampled(settings.subsample, resources.seed)
    metric, notes = _metric(ground, samples, parameters, settings, comparison, resources)
    # A refinement pass counts as much as growth: every vertex is matched once in each.
    shares = 1 + (settings.refine or 0)

    def report(done: int, total: int) -> None:
        if progress is not None:
            progress(done, total * shares)

    growth = grow_relief(
        ground,
        metric,
        window=parameters.window,
        error=parameters.error,
        selection=settings.selection,
        order=settings.order,
        bootstrap=settings.bootstrap,
        between=between,
        seed=resources.seed,
        progress=report,
    )
    passes = 0
    if settings.refine:
        assert isinstance(metric, VotingMetric)
        passes = refine_relief(
            ground,
            metric,
            growth.state,
            window=parameters.window,
            passes=settings.refine,
            seed=resources.seed,
            between=between,
            progress=progress,
        )
    return Stage(growth, metric.samples, passes, notes)


def _metric(
    ground: Ground,
    samples: Samples,
    parameters: Parameters,
    settings: ReliefSettings,
    comparison: Comparison,
    resources: Resources,
) -> tuple[Metric, tuple[str, ...]]:
    """Return the metric that the settings ask for, and notes about its search."""
    window, rotations = parameters.window, parameters.rotations
    if settings.metric == "surface":
        return SurfaceMetric(ground, samples, window, rotations, resources.device, comparison, settings.partners), ()
    search = "exhaustive" if settings.search == "auto" and settings.compares_all else settings.search
    points = len(polar_grid(max(window, 2), rotations)[1]) * len(comparison.factors())
    plan = plan_search(ground, samples, points, rotations, search, resources.memory, resources.seed)
    metric = DisplacementMetric(
        ground,
        plan.samples,
        window,
        rotations,
        resources.device,
        settings.engine,
        comparison=comparison,
        approximate=plan.approximate,
        keep_grids=plan.keep_grids,
        seed=resources.seed,
        partners=settings.partners,
    )
    return metric, plan.notes
