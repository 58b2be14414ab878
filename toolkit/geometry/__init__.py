"""Geometry textures from point sets (Duranleau & Poulin): swatches, their extension, meshes and shells of the result."""

from intaglio.geometry.assess import GeometryReport, assess_geometry
from intaglio.geometry.extend import extend_geometry
from intaglio.geometry.mesh import mesh_geometry
from intaglio.geometry.options import PRESETS, PairingWeights
from intaglio.geometry.point_set import GeometryTexture, PointSet
from intaglio.geometry.reading import read_geometry_texture
from intaglio.geometry.shell import wrap_geometry
from intaglio.geometry.texture import geometry_from_height, geometry_from_mesh, geometry_from_points
from intaglio.geometry.writing import write_points

__all__ = [
    "PRESETS",
    "GeometryReport",
    "GeometryTexture",
    "PairingWeights",
    "PointSet",
    "assess_geometry",
    "extend_geometry",
    "geometry_from_height",
    "geometry_from_mesh",
    "geometry_from_points",
    "mesh_geometry",
    "read_geometry_texture",
    "wrap_geometry",
    "write_points",
]
