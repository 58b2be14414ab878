"""Completion by coherent pieces: a correspondence field over what is missing, found coarse to fine and joined by differences."""

from intaglio.relief.coherent.fill import CoherentFilling, fill_coherently
from intaglio.relief.coherent.guidance import Guidance
from intaglio.relief.coherent.search import Weights

__all__ = ["CoherentFilling", "Guidance", "Weights", "fill_coherently"]
