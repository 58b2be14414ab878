"""How it is filled: settings, samples, metrics, propagation, levels, refinement."""

from intaglio.relief.growth.comparison import Comparison, compare_by
from intaglio.relief.growth.levels import complete_coarse_levels, frames_along
from intaglio.relief.growth.parameters import Parameters, choose_parameters
from intaglio.relief.growth.rim import shift_to_rim
from intaglio.relief.growth.samples import Samples, sample_set
from intaglio.relief.growth.settings import (
    METHODS,
    METRICS,
    ORDERS,
    PARTNERS,
    RULES,
    SEARCHES,
    ReliefSettings,
    Selection,
    refinement_passes,
)
from intaglio.relief.growth.stage import Resources, Stage, run_stage

__all__ = [
    "METHODS",
    "METRICS",
    "ORDERS",
    "PARTNERS",
    "RULES",
    "SEARCHES",
    "Comparison",
    "Parameters",
    "ReliefSettings",
    "Resources",
    "Samples",
    "Selection",
    "Stage",
    "choose_parameters",
    "compare_by",
    "complete_coarse_levels",
    "frames_along",
    "refinement_passes",
    "run_stage",
    "sample_set",
    "shift_to_rim",
]
