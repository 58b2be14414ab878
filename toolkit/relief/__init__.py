"""Completing missing relief: Breckon & Fisher's two stages."""

from intaglio.mesh import Base, Cylinder, Plane, SmoothBase, Sphere
from intaglio.relief.assess import ReliefReport, TruthComparison, assess_relief
from intaglio.relief.completion import complete_relief
from intaglio.relief.ground import Hole, fit_base, list_holes, sampling_distance, smoothed
from intaglio.relief.pictures import FILLED_TINT, clay_pictures, fixed_cameras, largest_filling, shown, viewpoints
from intaglio.relief.report import COMPLETED, RELIEF, SCAN, TRUTH, relief_pictures, write_relief_report

__all__ = [
    "COMPLETED",
    "FILLED_TINT",
    "RELIEF",
    "SCAN",
    "TRUTH",
    "Base",
    "Cylinder",
    "Hole",
    "Plane",
    "ReliefReport",
    "SmoothBase",
    "Sphere",
    "TruthComparison",
    "assess_relief",
    "clay_pictures",
    "complete_relief",
    "fit_base",
    "fixed_cameras",
    "largest_filling",
    "list_holes",
    "relief_pictures",
    "sampling_distance",
    "shown",
    "smoothed",
    "viewpoints",
    "write_relief_report",
]
