"""Larger textures from small samples, in any number of dimensions (Dong, chapters 5 and 6)."""

from intaglio.synthesis.assess import SynthesisReport, assess_synthesis
from intaglio.synthesis.grow import grow
from intaglio.synthesis.pipelines import synthesize, synthesize_each_light
from intaglio.synthesis.quilt import quilt
from intaglio.synthesis.result import Synthesis

__all__ = ["Synthesis", "SynthesisReport", "assess_synthesis", "grow", "quilt", "synthesize", "synthesize_each_light"]
