"""Texturing a mesh from photographs (Yamauchi et al. 2005, section 4)."""

from intaglio.photographs.assess import ViewComparison, border_step, compare_with_photograph
from intaglio.photographs.binding import BACKGROUND_THRESHOLD, GRAZING, Binding, bind_photographs
from intaglio.photographs.camera import Camera, Photograph
from intaglio.photographs.camera_files import read_photographs
from intaglio.photographs.combine import combine_photographs
from intaglio.photographs.exposure import exposure_gains
from intaglio.photographs.report import textured_views, write_texture_report
from intaglio.photographs.restored import restore_texture
from intaglio.photographs.texture import Texture
from intaglio.photographs.textured_mesh import TEXTURED_SUFFIXES, files_of, write_textured
from intaglio.photographs.vertex_colors import mean_vertex_colors, spread_colors

__all__ = [
    "BACKGROUND_THRESHOLD",
    "GRAZING",
    "TEXTURED_SUFFIXES",
    "Binding",
    "Camera",
    "Photograph",
    "Texture",
    "ViewComparison",
    "bind_photographs",
    "border_step",
    "combine_photographs",
    "compare_with_photograph",
    "exposure_gains",
    "files_of",
    "mean_vertex_colors",
    "read_photographs",
    "restore_texture",
    "spread_colors",
    "textured_views",
    "write_texture_report",
    "write_textured",
]
