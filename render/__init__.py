"""Mitsuba 3: arrays in, images out; image comparison."""

from intaglio.render.compare import Comparison, compare
from intaglio.render.lit_texture import lit_texture
from intaglio.render.photometric_capture import Gloss, photometric_capture
from intaglio.render.range_scan import RangeImage, range_scan
from intaglio.render.relightable import matte_bsdf, relightable_bsdf, relit, relit_plane
from intaglio.render.through_camera import through_camera
from intaglio.render.variant import Variant, variant
from intaglio.render.view import Camera, Light, frame, view

__all__ = [
    "Camera",
    "Comparison",
    "Gloss",
    "Light",
    "RangeImage",
    "Variant",
    "compare",
    "frame",
    "lit_texture",
    "matte_bsdf",
    "photometric_capture",
    "range_scan",
    "relightable_bsdf",
    "relit",
    "relit_plane",
    "through_camera",
    "variant",
    "view",
]
