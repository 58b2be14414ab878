"""Synthesis by coherent pieces: even starts from blocks on a coarse level, then patches and borders level by level."""

from intaglio.synthesis.coherent.levels import covered_pixels, mean_step, refine_source, sum_in_patches

__all__ = ["covered_pixels", "mean_step", "refine_source", "sum_in_patches"]
