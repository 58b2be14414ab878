"""Texturing a mesh from photographs (Yamauchi et al. 2005, section 4)."""

from intaglio.photographs.assess import ViewComparison, border_step, compare_with_photograph
from intaglio.photographs.binding import Binding, bind_photographs
from intaglio.photographs.camera import Camera, Photograph
from intaglio.photographs.camera_files import read_photographs
from intaglio.photographs.combine import combine_photographs
from intaglio.photographs.restored import restore_texture
from intaglio.photographs.texture import Texture
from intaglio.photographs.textured_mesh import write_textured

__all__ = [
    "Binding",
    "Camera",
    "Photograph",
    "Texture",
    "ViewComparison",
    "bind_photographs",
    "border_step",
    "combine_photographs",
    "compare_with_photograph",
    "read_photographs",
    "restore_texture",
    "write_textured",
]
