"""Laying a surface flat: one chart over the unit square, of low distortion (Yamauchi et al. 2005, section 3)."""

from intaglio.parameterization.parameterize import parameterize
from intaglio.parameterization.result import Parameterization

__all__ = ["Parameterization", "parameterize"]
