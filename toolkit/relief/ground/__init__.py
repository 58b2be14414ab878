"""What is to be filled: base, holes, targets, triangulation, frames."""

from intaglio.relief.ground.extent import sampling_distance
from intaglio.relief.ground.fit import fit_base
from intaglio.relief.ground.frames import FRAMES, local_frames
from intaglio.relief.ground.holes import Hole, Holes
from intaglio.relief.ground.prepare import Ground, GroundOptions, prepare_ground
from intaglio.relief.ground.relaying import relaid
from intaglio.relief.ground.scan import check_faces, list_holes
from intaglio.relief.ground.thin_plate import ThinPlate, smooth_over_surface

__all__ = [
    "FRAMES",
    "Ground",
    "GroundOptions",
    "Hole",
    "Holes",
    "ThinPlate",
    "check_faces",
    "fit_base",
    "list_holes",
    "local_frames",
    "prepare_ground",
    "relaid",
    "sampling_distance",
    "smooth_over_surface",
]
