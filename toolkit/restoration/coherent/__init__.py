"""Filling holes of images by coherent pieces of what is known (Wexler et al. 2007, Barnes et al. 2009, Newson et al. 2014)."""

from intaglio.restoration.coherent.pieces import fill_by_pieces, whole_patches

__all__ = ["fill_by_pieces", "whole_patches"]
