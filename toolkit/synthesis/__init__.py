"""Larger textures from small samples, in any number of dimensions (Dong, chapters 5 and 6)."""

from intaglio.synthesis.assess import SynthesisReport, assess_synthesis
from intaglio.synthesis.coherent import covered_pixels, mean_step, refine_source, sum_in_patches
from intaglio.synthesis.growing import grow
from intaglio.synthesis.light import EvenLight, even_light
from intaglio.synthesis.material import Material, holds_material, read_material
from intaglio.synthesis.nearest import NearestWindows
from intaglio.synthesis.options import CONTINUATIONS, CUTS, GrowOptions, QuiltOptions, WeaveOptions
from intaglio.synthesis.pipelines import synthesize, synthesize_each_light
from intaglio.synthesis.pyramid import halve_planes, smooth_plane
from intaglio.synthesis.quilting import quilt
from intaglio.synthesis.ranking_page import read_trials, write_ranking_page
from intaglio.synthesis.ranks import Friedman, MultipleComparison, friedman, multiple_comparison, read_ranks
from intaglio.synthesis.refinement import SIDES, optimize_texture
from intaglio.synthesis.report import THESIS_LIGHTS, write_source, write_synthesis_report
from intaglio.synthesis.result import Synthesis, copy_texture, pixel_positions
from intaglio.synthesis.sample import METRICS, Match, SampleMaps, window_starts
from intaglio.synthesis.weaving import weave

__all__ = [
    "CONTINUATIONS",
    "CUTS",
    "METRICS",
    "SIDES",
    "THESIS_LIGHTS",
    "EvenLight",
    "Friedman",
    "GrowOptions",
    "Match",
    "Material",
    "MultipleComparison",
    "NearestWindows",
    "QuiltOptions",
    "SampleMaps",
    "Synthesis",
    "SynthesisReport",
    "WeaveOptions",
    "assess_synthesis",
    "copy_texture",
    "covered_pixels",
    "even_light",
    "friedman",
    "grow",
    "halve_planes",
    "holds_material",
    "mean_step",
    "multiple_comparison",
    "optimize_texture",
    "pixel_positions",
    "quilt",
    "read_material",
    "read_ranks",
    "read_trials",
    "refine_source",
    "smooth_plane",
    "sum_in_patches",
    "synthesize",
    "synthesize_each_light",
    "weave",
    "window_starts",
    "write_ranking_page",
    "write_source",
    "write_synthesis_report",
]
