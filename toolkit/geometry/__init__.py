"""Geometry textures from point sets (Duranleau & Poulin): swatches, their extension, meshes and shells of the result."""

from intaglio.geometry.assess import FEWEST, GeometryReport, assess_geometry, label_pieces
from intaglio.geometry.extend import extend_geometry
from intaglio.geometry.mesh import mesh_geometry
from intaglio.geometry.normals import is_height_field
from intaglio.geometry.options import PRESETS, PairingWeights, PatchFit
from intaglio.geometry.point_set import GeometryTexture, PointSet
from intaglio.geometry.reading import POINT_FILES, holds_points, read_geometry_texture
from intaglio.geometry.report import comparison_pictures, write_geometry_report
from intaglio.geometry.sampling import RADIUS, thin_points
from intaglio.geometry.shell import read_uv_mesh, wrap_geometry
from intaglio.geometry.texture import geometry_from_height, geometry_from_mesh, geometry_from_points
from intaglio.geometry.writing import POINT_SUFFIXES, write_points

__all__ = [
    "FEWEST",
    "POINT_FILES",
    "POINT_SUFFIXES",
    "PRESETS",
    "RADIUS",
    "GeometryReport",
    "GeometryTexture",
    "PairingWeights",
    "PatchFit",
    "PointSet",
    "assess_geometry",
    "comparison_pictures",
    "extend_geometry",
    "geometry_from_height",
    "geometry_from_mesh",
    "geometry_from_points",
    "holds_points",
    "is_height_field",
    "label_pieces",
    "mesh_geometry",
    "read_geometry_texture",
    "read_uv_mesh",
    "thin_points",
    "wrap_geometry",
    "write_geometry_report",
    "write_points",
]
