"""Intaglio completes, synthesises and relights the fine surface texture of real objects."""

from intaglio.errors import FileError, FitError, InputError, IntaglioError, IntaglioWarning
from intaglio.images import read_exr, read_image, write_exr, write_image
from intaglio.mesh_reading import read_surface
from intaglio.mesh_writing import write_surface
from intaglio.relief import (
    Base,
    Cylinder,
    Plane,
    ReliefReport,
    Sphere,
    TruthComparison,
    assess_relief,
    complete_relief,
    fit_base,
    write_relief_report,
)
from intaglio.surface import Surface, surface_from_points, surface_from_range_image

__version__ = "0.1.0"

__all__ = [
    "Base",
    "Cylinder",
    "FileError",
    "FitError",
    "InputError",
    "IntaglioError",
    "IntaglioWarning",
    "Plane",
    "ReliefReport",
    "Sphere",
    "Surface",
    "TruthComparison",
    "__version__",
    "assess_relief",
    "complete_relief",
    "fit_base",
    "read_exr",
    "read_image",
    "read_surface",
    "surface_from_points",
    "surface_from_range_image",
    "write_exr",
    "write_image",
    "write_relief_report",
    "write_surface",
]
