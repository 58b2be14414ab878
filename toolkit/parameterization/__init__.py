"""Laying a surface flat: one chart over the unit square, of low distortion (Yamauchi et al. 2005, section 3)."""

from intaglio.parameterization.atlas import atlas_at_density
from intaglio.parameterization.flattening import parameterize
from intaglio.parameterization.options import BOUNDARIES, ENERGIES
from intaglio.parameterization.pictures import checkerboard, describe_parameterization, layout_picture
from intaglio.parameterization.result import Parameterization, measure_parameterization

__all__ = [
    "BOUNDARIES",
    "ENERGIES",
    "Parameterization",
    "atlas_at_density",
    "checkerboard",
    "describe_parameterization",
    "layout_picture",
    "measure_parameterization",
    "parameterize",
]
