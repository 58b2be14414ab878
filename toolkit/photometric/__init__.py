"""Image stacks to relightable representations (Dong, Three-dimensional Surface Texture Synthesis, chapters 3 and 4)."""

from intaglio.photometric.assess import RepresentationReport, assess_representation
from intaglio.photometric.heights import Integrability, gradients_from_height, height_from_gradients, integrability
from intaglio.photometric.mirror_sphere import SphereLights, fit_circle, lights_from_sphere
from intaglio.photometric.normals import SurfaceMaps, surface_maps
from intaglio.photometric.reading import read_stack
from intaglio.photometric.relightable import Relightable
from intaglio.photometric.represent import represent
from intaglio.photometric.stack import PhotometricStack

__all__ = [
    "Integrability",
    "PhotometricStack",
    "Relightable",
    "RepresentationReport",
    "SphereLights",
    "SurfaceMaps",
    "assess_representation",
    "fit_circle",
    "gradients_from_height",
    "height_from_gradients",
    "integrability",
    "lights_from_sphere",
    "read_stack",
    "represent",
    "surface_maps",
]
