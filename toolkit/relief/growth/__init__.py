"""How it is filled: samples, metrics, propagation, levels, refinement."""

from intaglio.relief.growth.arguments import check_combination, check_samples, check_surface, checked_selection
from intaglio.relief.growth.comparison import compare_by
from intaglio.relief.growth.displacement_metric import DisplacementMetric
from intaglio.relief.growth.levels import coarse_relief, frames_along
from intaglio.relief.growth.parameters import choose_parameters
from intaglio.relief.growth.plan import plan_search
from intaglio.relief.growth.propagation import Growth, Metric, grow_relief
from intaglio.relief.growth.refinement import refine_relief
from intaglio.relief.growth.rim import shift_to_rim
from intaglio.relief.growth.samples import Samples, sample_set
from intaglio.relief.growth.surface_metric import SurfaceMetric

__all__ = [
    "DisplacementMetric",
    "Growth",
    "Metric",
    "Samples",
    "SurfaceMetric",
    "check_combination",
    "check_samples",
    "check_surface",
    "checked_selection",
    "choose_parameters",
    "coarse_relief",
    "compare_by",
    "frames_along",
    "grow_relief",
    "plan_search",
    "refine_relief",
    "sample_set",
    "shift_to_rim",
]
