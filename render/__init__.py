"""Mitsuba 3: arrays in, images out; image comparison."""

from intaglio.render.compare import Comparison, compare
from intaglio.render.range_scan import RangeImage, range_scan
from intaglio.render.variant import Variant, variant
from intaglio.render.view import Camera, Light, frame, view

__all__ = ["Camera", "Comparison", "Light", "RangeImage", "Variant", "compare", "frame", "range_scan", "variant", "view"]
