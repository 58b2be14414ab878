"""What is to be filled: base, holes, targets, triangulation, frames."""

from intaglio.relief.ground.extent import sampling_distance
from intaglio.relief.ground.fit import fit_base
from intaglio.relief.ground.frames import FRAMES
from intaglio.relief.ground.holes import Hole, Holes
from intaglio.relief.ground.prepare import Ground, GroundOptions, prepare_ground
from intaglio.relief.ground.relaying import relaid
from intaglio.relief.ground.scan import list_holes
from intaglio.relief.ground.thin_plate import ThinPlate, smooth_over_surface

__all__ = [
    "FRAMES",
    "Ground",
    "GroundOptions",
    "Hole",
    "Holes",
    "ThinPlate",
    "fit_base",
    "list_holes",
    "prepare_ground",
    "relaid",
    "sampling_distance",
    "smooth_over_surface",
]
