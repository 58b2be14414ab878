"""Image stacks to relightable representations (Dong, Three-dimensional Surface Texture Synthesis, chapters 3 and 4)."""

from intaglio.photometric.assess import RepresentationReport, assess_representation
from intaglio.photometric.bases import LambertBasis
from intaglio.photometric.examination import ImageFacts, table_lines
from intaglio.photometric.exr_file import ATTRIBUTE
from intaglio.photometric.heights import Integrability, gradients_from_height, height_from_gradients, integrability
from intaglio.photometric.light_positions import light_direction, read_light_positions, tilt_and_slant
from intaglio.photometric.materials import MAP_NAMES, height_of, write_gltf, write_maps
from intaglio.photometric.mirror_sphere import SphereLights, fit_circle, lights_from_sphere
from intaglio.photometric.normals import SurfaceMaps, surface_maps
from intaglio.photometric.reading import STACK_SUFFIXES, examine_capture, read_stack
from intaglio.photometric.relightable import KINDS, Relightable
from intaglio.photometric.rendering import bsdf_of, render_on_mesh
from intaglio.photometric.report import Reports, assess_kinds, assessment_lines, polar_plot, write_assessment
from intaglio.photometric.representation import integrable, represent
from intaglio.photometric.stack import Exposure, PhotometricStack, checked_lights
from intaglio.photometric.web_planes import write_web_planes
from intaglio.photometric.writing import TEXTURE_SUFFIXES, read_relightable, write_relightable

__all__ = [
    "ATTRIBUTE",
    "KINDS",
    "MAP_NAMES",
    "STACK_SUFFIXES",
    "TEXTURE_SUFFIXES",
    "Exposure",
    "ImageFacts",
    "Integrability",
    "LambertBasis",
    "PhotometricStack",
    "Relightable",
    "Reports",
    "RepresentationReport",
    "SphereLights",
    "SurfaceMaps",
    "assess_kinds",
    "assess_representation",
    "assessment_lines",
    "bsdf_of",
    "checked_lights",
    "examine_capture",
    "fit_circle",
    "gradients_from_height",
    "height_from_gradients",
    "height_of",
    "integrability",
    "integrable",
    "light_direction",
    "lights_from_sphere",
    "polar_plot",
    "read_light_positions",
    "read_relightable",
    "read_stack",
    "render_on_mesh",
    "represent",
    "surface_maps",
    "table_lines",
    "tilt_and_slant",
    "write_assessment",
    "write_gltf",
    "write_maps",
    "write_relightable",
    "write_web_planes",
]
