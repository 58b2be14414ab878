"""Completing missing relief: Breckon & Fisher's two stages."""

from intaglio.relief.assess import ReliefReport, TruthComparison, assess_relief
from intaglio.relief.base import Base, Cylinder, Plane, Sphere
from intaglio.relief.complete import complete_relief
from intaglio.relief.fit import fit_base
from intaglio.relief.report import write_relief_report

__all__ = [
    "Base",
    "Cylinder",
    "Plane",
    "ReliefReport",
    "Sphere",
    "TruthComparison",
    "assess_relief",
    "complete_relief",
    "fit_base",
    "write_relief_report",
]
