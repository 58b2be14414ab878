"""Filling what is missing of an image (Yamauchi et al. 2005, section 5)."""

from intaglio.restoration.assess import RestorationReport, assess_restoration
from intaglio.restoration.restore import Restoration, restore, restore_in_detail

__all__ = ["Restoration", "RestorationReport", "assess_restoration", "restore", "restore_in_detail"]
