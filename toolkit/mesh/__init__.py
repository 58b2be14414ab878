"""Triangulated surfaces: base shapes, topology, mending, reading and writing."""

from intaglio.mesh.base import Base, BaseFit, Cylinder, Plane, Sphere, face_the_scan, perpendicular, tangents, unit
from intaglio.mesh.mending import equal_places, mend_surface
from intaglio.mesh.point_cloud import PointFile
from intaglio.mesh.point_files import POINT_FILES, holds_points, read_point_file
from intaglio.mesh.points import surface_from_points, surface_from_range_image
from intaglio.mesh.raw_mesh import RawMesh, samples_of
from intaglio.mesh.reading import read_mesh_file, read_surface
from intaglio.mesh.smooth_base import SmoothBase
from intaglio.mesh.surface import Surface, vertex_normals
from intaglio.mesh.topology import (
    LARGE,
    Topology,
    adjacency,
    border_edges,
    border_loops,
    directed_edges,
    edge_keys,
    edge_lengths,
    edges_pair_up,
    face_areas,
    following,
    grid_faces,
    largest_faces,
    numbered_sets,
    opposite_edges,
    pieces,
    unique_edges,
    used_vertices,
)
from intaglio.mesh.writing import WRITABLE, check_single_precision, color_fields, files_beside, ply_table, write_surface

__all__ = [
    "LARGE",
    "POINT_FILES",
    "WRITABLE",
    "Base",
    "BaseFit",
    "Cylinder",
    "Plane",
    "PointFile",
    "RawMesh",
    "SmoothBase",
    "Sphere",
    "Surface",
    "Topology",
    "adjacency",
    "border_edges",
    "border_loops",
    "check_single_precision",
    "color_fields",
    "directed_edges",
    "edge_keys",
    "edge_lengths",
    "edges_pair_up",
    "equal_places",
    "face_areas",
    "face_the_scan",
    "files_beside",
    "following",
    "grid_faces",
    "holds_points",
    "largest_faces",
    "mend_surface",
    "numbered_sets",
    "opposite_edges",
    "perpendicular",
    "pieces",
    "ply_table",
    "read_mesh_file",
    "read_point_file",
    "read_surface",
    "samples_of",
    "surface_from_points",
    "surface_from_range_image",
    "tangents",
    "unique_edges",
    "unit",
    "used_vertices",
    "vertex_normals",
    "write_surface",
]
