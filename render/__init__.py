"""Mitsuba 3: arrays in, images out; image comparison."""

from intaglio.render.camera_views import through_camera
from intaglio.render.captures import Gloss, height_normals, photometric_capture
from intaglio.render.comparison import Comparison, compare
from intaglio.render.lit_textures import lit_texture
from intaglio.render.range_scans import RangeImage, range_scan
from intaglio.render.relightable import matte_bsdf, relightable_bsdf, relit, relit_plane
from intaglio.render.variants import Variant, mitsuba, usable_llvm, variant
from intaglio.render.views import CLAY, Light, Viewpoint, frame, view

__all__ = [
    "CLAY",
    "Comparison",
    "Gloss",
    "Light",
    "RangeImage",
    "Variant",
    "Viewpoint",
    "compare",
    "frame",
    "height_normals",
    "lit_texture",
    "matte_bsdf",
    "mitsuba",
    "photometric_capture",
    "range_scan",
    "relightable_bsdf",
    "relit",
    "relit_plane",
    "through_camera",
    "usable_llvm",
    "variant",
    "view",
]
