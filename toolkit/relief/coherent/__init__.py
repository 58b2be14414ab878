"""Completion by coherent pieces: a correspondence field over what is missing, found coarse to fine and joined by differences."""

from intaglio.relief.coherent.fill import CoherentFilling, fill_coherently

__all__ = ["CoherentFilling", "fill_coherently"]
