"""The topology of a surface, and errors for meshes that are not surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.mesh import Surface, Topology, border_loops, directed_edges, edge_keys, pieces, unique_edges
from intaglio.parameterization.charts import doubled_areas

# A triangle whose height is below this share of its longest side counts as having no area: its angles are lost to rounding.
_FLAT = 1e-10


@dataclass(frozen=True)
class Kind:
    """Topology of a mesh.

    Attributes
    ----------
    pieces : int
    genus : int
        Of a mesh of one piece; -1 for more.
    loops : list of arrays
        Border loops, longest first in space.
    """

    pieces: int
    genus: int
    loops: list[Array]

    def describe(self) -> str:
        """Return the topology in words."""
        if self.pieces > 1:
            return f"{self.pieces} separate pieces"
        borders = {0: "closed", 1: "one border"}.get(len(self.loops), f"{len(self.loops)} borders")
        return f"genus {self.genus}, {borders}"


def classify_topology(surface: Surface) -> Kind:
    """Return the topology of a mesh.

    Raises
    ------
    InputError
        For a mesh without faces, triangles without area, or edges and vertices at which it
        is not a surface.
    """
    vertices, faces = surface.vertices, surface.faces
    if len(faces) == 0:
        raise InputError("the mesh has no faces; there is nothing to lay flat")
    corner = vertices[faces]
    longest = np.max(np.sum((corner - np.roll(corner, 1, axis=1)) ** 2, axis=2), axis=1)
    scale = float(np.sqrt(longest.max())) or 1.0
    flat = np.flatnonzero(~(doubled_areas(vertices / scale, faces) > _FLAT * longest / scale**2))
    if len(flat):
        raise InputError(
            f"{len(flat)} triangles have no area, the first is face {flat[0]}; intaglio.mend_surface(surface) has their "
            "neighbours take them up"
        )
    keys = edge_keys(directed_edges(faces), len(vertices))
    if len(np.unique(keys)) < len(keys):
        raise InputError(
            "an edge has two faces on one side: intaglio.mend_surface(surface) turns faces and cuts apart what doesn't join"
        )
    topology = Topology.of(faces, len(vertices))
    fans = np.diff(topology.offsets) - np.diff(topology.face_offsets)
    if (fans > 1).any():
        raise InputError(
            f"at vertex {int(np.argmax(fans))} the surface touches itself in a point; intaglio.mend_surface(surface) gives each "
            "part its own vertex"
        )
    number, _ = pieces(faces, len(vertices))
    loops = border_loops(faces)
    lengths = [float(np.linalg.norm(vertices[loop] - vertices[np.roll(loop, -1)], axis=1).sum()) for loop in loops]
    loops = [loops[k] for k in np.argsort([-x for x in lengths], kind="stable")]
    euler = len(vertices) - len(unique_edges(faces)) + len(faces)
    genus = (2 - len(loops) - euler) // 2 if number == 1 else -1
    return Kind(number, genus, loops)
