"""The surface as a correspondence field walks over it: steps along edges, frames, and the patches around vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp
from scipy.spatial import cKDTree

from intaglio.arrays import Array
from intaglio.kernels.correspondence import Steps, patch_kernel, patch_rays
from intaglio.kernels.geodesics import trace_rays
from intaglio.kernels.launch import launch, upload
from intaglio.kernels.meshes import Triangles
from intaglio.mesh import largest_faces
from intaglio.relief.ground import Ground

# Vertices whose patches are read at a time where their places on the mesh are not kept.
_AT_ONCE = 32_768
# Side of the cells, in steps, of which one vertex's patch stands for all; and the least cosine between normals of one sheet.
_CELL, _SAME_SHEET = 0.5, 0.5


@dataclass(frozen=True)
class Located:
    """Where the grid points of patches around ``vertices`` (V,) lie: faces (V, G) and barycentric weights (V, G) vec2."""

    vertices: Array
    face: wp.array
    weight: wp.array


class SurfaceTables:
    """Steps and patches over the base of a ground, in units of the spacing near the origin.

    Parameters
    ----------
    ground : Ground
    device : str
    """

    def __init__(self, ground: Ground, device: str) -> None:
        topology = ground.topology
        self.device, self._ground = device, ground
        self.foot = (ground.foot - ground.foot.mean(axis=0)) / ground.spacing
        self.first = np.repeat(np.arange(len(self.foot)), np.diff(topology.offsets))
        self.other = topology.neighbors
        self._face_at = largest_faces(ground.faces, ground.foot)
        steps = Steps()
        steps.offsets = upload(topology.offsets, wp.int32, device)
        steps.neighbors = upload(topology.neighbors, wp.int32, device)
        steps.step = upload(self._steps(), wp.vec2, device)
        steps.turn = upload(self._turns(), wp.float32, device)
        for name, value in (("foot", self.foot), ("u", ground.u), ("v", ground.v)):
            setattr(steps, name, upload(value, wp.vec3, device))
        steps.face_offsets = upload(topology.face_offsets, wp.int32, device)
        steps.incident = upload(topology.incident, wp.int32, device)
        mesh = Triangles()
        mesh.points, mesh.faces = steps.foot, upload(ground.faces, wp.int32, device)
        mesh.across = upload(topology.across, wp.int32, device)
        self.steps, self.mesh = steps, mesh

    def _steps(self) -> Array:
        """Neighbours' positions (E, 2) in their vertices' frames, as long as the edges."""
        ground = self._ground
        way = self.foot[self.other] - self.foot[self.first]
        flat = np.stack([np.einsum("ij,ij->i", way, axis[self.first]) for axis in (ground.u, ground.v)], axis=1)
        length = np.linalg.norm(flat, axis=1)
        return flat * (np.linalg.norm(way, axis=1) / np.maximum(length, 1e-12))[:, None]

    def _turns(self) -> Array:
        """Angles (E,) of the neighbours' frames in their vertices' frames; the same with the other sign from the other end."""
        return _angles(self._ground.u, self._ground.v, self.first, self.other)

    def thinned(self, vertices: Array, step: float) -> tuple[Array, Array, Array]:
        """Choose vertices whose patches stand for those of all: patches change little over a small part of a step.

        Parameters
        ----------
        vertices : (V,) int array
        step : float
            Distance of the patches' rings, in spacings.

        Returns
        -------
        chosen : (K,) int array
            Some of ``vertices``.
        stands : (V,) int array
            For every vertex the number in ``chosen`` of the one that stands for it.
        turn : (V,) array
            The angle of its frame in that one's frame.
        """
        u, v, normal = self._ground.u, self._ground.v, self._ground.normal
        cell = np.floor(self.foot[vertices] / (_CELL * step)).astype(np.int64)
        chosen = np.sort(np.unique(cell, axis=0, return_index=True)[1])
        stands = cKDTree(self.foot[vertices[chosen]]).query(self.foot[vertices])[1]
        # What faces another way lies on another sheet: it stands for itself alone.
        odd = np.einsum("ij,ij->i", normal[vertices], normal[vertices[chosen[stands]]]) < _SAME_SHEET
        chosen, stands = np.unique(np.where(odd, np.arange(len(vertices)), chosen[stands]), return_inverse=True)
        j, i = vertices, vertices[chosen[stands]]
        return vertices[chosen], stands, _angles(u, v, i, j)

    def locate(self, vertices: Array, step: float) -> Located:
        """Lay patches around vertices (V,), their rings ``step`` spacings apart."""
        ground = self._ground
        frames = self.foot[vertices], ground.u[vertices], ground.v[vertices]
        directions, point = patch_rays()
        face, weight = trace_rays(*frames, self._face_at[vertices], directions, point, step, self.mesh, self.device)
        return Located(vertices, face, weight)

    def read(self, located: Located, height: Array, confidence: Array) -> Array:
        """Return what patches hold: (V, G, 4) float32, height, its derivatives outwards and around, and confidence.

        Parameters
        ----------
        located : Located
        height, confidence : (N,) arrays
            In spacings, and from 0 (unknown) to 1.
        """
        value = wp.empty(located.face.shape, dtype=wp.vec4, device=self.device)
        fields = [upload(field, wp.float32, self.device) for field in (height, confidence)]
        vertices = upload(located.vertices, wp.int32, self.device)
        launch(
            patch_kernel,
            len(located.vertices),
            inputs=[vertices, self.steps, located.face, located.weight, self.mesh, *fields],
            outputs=[value],
            device=self.device,
            grain=16,
        )
        return np.asarray(value.numpy())

    def patches(self, vertices: Array, step: float, height: Array, confidence: Array) -> Array:
        """Lay patches around vertices (V,) and read them; their places are not kept."""
        parts = [vertices[start : start + _AT_ONCE] for start in range(0, len(vertices), _AT_ONCE)]
        return np.concatenate([self.read(self.locate(part, step), height, confidence) for part in parts])


def _angles(u: Array, v: Array, i: Array, j: Array) -> Array:
    """Return the angles of the frames of ``j`` in those of ``i``; the same with the other sign the other way round."""
    cosine = np.einsum("ij,ij->i", u[j], u[i]) + np.einsum("ij,ij->i", v[j], v[i])
    return np.arctan2(np.einsum("ij,ij->i", u[j], v[i]) - np.einsum("ij,ij->i", v[j], u[i]), cosine)
