"""What is to be filled: base, holes, targets, triangulation, frames."""

from intaglio.relief.ground.extent import sampling_distance
from intaglio.relief.ground.fit import fit_base
from intaglio.relief.ground.frames import FRAMES
from intaglio.relief.ground.holes import Hole, Holes
from intaglio.relief.ground.prepare import Ground, number, prepare_ground
from intaglio.relief.ground.scan import list_holes
from intaglio.relief.ground.thin_plate import smoothed

__all__ = [
    "FRAMES",
    "Ground",
    "Hole",
    "Holes",
    "fit_base",
    "list_holes",
    "number",
    "prepare_ground",
    "sampling_distance",
    "smoothed",
]
