"""Filling what is missing of an image (Yamauchi et al. 2005, section 5)."""

from intaglio.restoration.assess import RestorationReport, assess_restoration
from intaglio.restoration.pipeline import METHODS, Restoration, restore
from intaglio.restoration.report import write_restoration_report

__all__ = [
    "METHODS",
    "Restoration",
    "RestorationReport",
    "assess_restoration",
    "restore",
    "write_restoration_report",
]
