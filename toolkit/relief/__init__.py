"""Completing missing relief: Breckon & Fisher's two stages."""

from intaglio.mesh import Base, Cylinder, Plane, SmoothBase, Sphere
from intaglio.relief.assess import assess_relief
from intaglio.relief.candidates import write_candidates_report
from intaglio.relief.completion import complete_relief, prepare_relief
from intaglio.relief.exemplar import chosen_sources
from intaglio.relief.figures import ReliefReport, TruthComparison
from intaglio.relief.ground import FRAMES, Hole, fit_base, list_holes, sampling_distance, smooth_over_surface
from intaglio.relief.growth import METHODS, METRICS, ORDERS, PARTNERS, RULES, SEARCHES, ReliefSettings, Selection
from intaglio.relief.lines import read_guides
from intaglio.relief.pictures import FILLED_TINT, choose_viewpoints, clay_pictures, fixed_cameras, largest_filling, mark_pictured
from intaglio.relief.prepared import PreparedRelief
from intaglio.relief.report import COMPLETED, RELIEF, SCAN, TRUTH, relief_pictures, write_relief_report
from intaglio.relief.smooth_filling import without_relief

__all__ = [
    "COMPLETED",
    "FILLED_TINT",
    "FRAMES",
    "METHODS",
    "METRICS",
    "ORDERS",
    "PARTNERS",
    "RELIEF",
    "RULES",
    "SCAN",
    "SEARCHES",
    "TRUTH",
    "Base",
    "Cylinder",
    "Hole",
    "Plane",
    "PreparedRelief",
    "ReliefReport",
    "ReliefSettings",
    "Selection",
    "SmoothBase",
    "Sphere",
    "TruthComparison",
    "assess_relief",
    "choose_viewpoints",
    "chosen_sources",
    "clay_pictures",
    "complete_relief",
    "fit_base",
    "fixed_cameras",
    "largest_filling",
    "list_holes",
    "mark_pictured",
    "prepare_relief",
    "read_guides",
    "relief_pictures",
    "sampling_distance",
    "smooth_over_surface",
    "without_relief",
    "write_candidates_report",
    "write_relief_report",
]
