"""Filling what is missing of an image (Yamauchi et al. 2005, section 5)."""

from intaglio.restoration.restore import Restoration, restoration, restore

__all__ = ["Restoration", "restoration", "restore"]
