"""Laying a surface flat: one chart over the unit square, of low distortion (Yamauchi et al. 2005, section 3)."""

from intaglio.parameterization.flattening import parameterize
from intaglio.parameterization.options import BOUNDARIES, ENERGIES
from intaglio.parameterization.pictures import checkerboard, figures, layout_picture
from intaglio.parameterization.result import Parameterization

__all__ = [
    "BOUNDARIES",
    "ENERGIES",
    "Parameterization",
    "checkerboard",
    "figures",
    "layout_picture",
    "parameterize",
]
