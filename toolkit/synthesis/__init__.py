"""Larger textures from small samples, in any number of dimensions (Dong, chapters 5 and 6)."""

from intaglio.synthesis.assess import SynthesisReport, assess_synthesis
from intaglio.synthesis.growing import grow
from intaglio.synthesis.nearest import NearestWindows
from intaglio.synthesis.pipelines import METHODS, synthesize, synthesize_each_light
from intaglio.synthesis.pyramid import smoothed
from intaglio.synthesis.quilting import CONTINUATIONS, CUTS, METRICS, quilt
from intaglio.synthesis.ranking_page import read_trials, write_ranking_page
from intaglio.synthesis.ranks import Friedman, MultipleComparison, friedman, multiple_comparison, read_ranks
from intaglio.synthesis.refinement import SIDES, refined
from intaglio.synthesis.report import THESIS_LIGHTS, write_source, write_synthesis_report
from intaglio.synthesis.result import Synthesis, copied_texture, places
from intaglio.synthesis.sample import SampleMaps, checked_mask, checked_size

__all__ = [
    "CONTINUATIONS",
    "CUTS",
    "METHODS",
    "METRICS",
    "SIDES",
    "THESIS_LIGHTS",
    "Friedman",
    "MultipleComparison",
    "NearestWindows",
    "SampleMaps",
    "Synthesis",
    "SynthesisReport",
    "assess_synthesis",
    "checked_mask",
    "checked_size",
    "copied_texture",
    "friedman",
    "grow",
    "multiple_comparison",
    "places",
    "quilt",
    "read_ranks",
    "read_trials",
    "refined",
    "smoothed",
    "synthesize",
    "synthesize_each_light",
    "write_ranking_page",
    "write_source",
    "write_synthesis_report",
]
