"""Completing missing relief: Breckon & Fisher's two stages."""

from intaglio.relief.assess import ReliefReport, TruthComparison, assess_relief
from intaglio.relief.base import Base, Cylinder, Plane, Sphere
from intaglio.relief.complete import complete_relief
from intaglio.relief.fit import fit_base
from intaglio.relief.holes import Hole
from intaglio.relief.report import write_relief_report
from intaglio.relief.scan import list_holes
from intaglio.relief.smooth_base import SmoothBase

__all__ = [
    "Base",
    "Cylinder",
    "Hole",
    "Plane",
    "ReliefReport",
    "SmoothBase",
    "Sphere",
    "TruthComparison",
    "assess_relief",
    "complete_relief",
    "fit_base",
    "list_holes",
    "write_relief_report",
]
