"""Completion by coherent pieces: a correspondence field over what is missing, found coarse to fine and joined by differences."""

from intaglio.relief.coherent.averages import average, averaging, edges_from
from intaglio.relief.coherent.fill import CoherentFilling, fill_coherently
from intaglio.relief.coherent.guidance import Guidance
from intaglio.relief.coherent.joining import Wishes, join
from intaglio.relief.coherent.search import Weights

__all__ = ["CoherentFilling", "Guidance", "Weights", "Wishes", "average", "averaging", "edges_from", "fill_coherently", "join"]
