"""Image stacks to relightable representations (Dong, Three-dimensional Surface Texture Synthesis, chapters 3 and 4)."""

from intaglio.photometric.assess import RepresentationReport, assess_representation
from intaglio.photometric.heights import Integrability, gradients_from_height, height_from_gradients, integrability
from intaglio.photometric.light_positions import light_direction, tilt_and_slant
from intaglio.photometric.materials import height_of, write_gltf, write_maps
from intaglio.photometric.mirror_sphere import SphereLights, fit_circle, lights_from_sphere
from intaglio.photometric.normals import SurfaceMaps, surface_maps
from intaglio.photometric.reading import read_stack
from intaglio.photometric.relightable import Relightable
from intaglio.photometric.represent import represent
from intaglio.photometric.stack import PhotometricStack
from intaglio.photometric.web_planes import write_web_planes
from intaglio.photometric.writing import read_relightable, write_relightable

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
    "height_of",
    "integrability",
    "light_direction",
    "lights_from_sphere",
    "read_relightable",
    "read_stack",
    "represent",
    "surface_maps",
    "tilt_and_slant",
    "write_gltf",
    "write_maps",
    "write_relightable",
    "write_web_planes",
]
