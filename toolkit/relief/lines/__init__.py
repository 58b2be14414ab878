"""Lines: creases, ridges and valleys that reach a hole's rim, joined across it, or drawn by the user; they steer the filling."""

from intaglio.relief.lines.curves import Curve, find_ends, joined
from intaglio.relief.lines.features import Features, find_features
from intaglio.relief.lines.guides import Guides, checked_guides, guide_curves, read_guides, without_guided
from intaglio.relief.lines.steering import steered

__all__ = [
    "Curve",
    "Features",
    "Guides",
    "checked_guides",
    "find_ends",
    "find_features",
    "guide_curves",
    "joined",
    "read_guides",
    "steered",
    "without_guided",
]
