"""Signed distance and gradient fields of point-set surfaces on regular grids, and the distance of patches in them.

After Duranleau & Poulin, section 5.1: at each node the distance to the surface, positive on the side its normals point to,
and the unit gradient, both by projection. Nodes farther than the reach from any surface hold the reach as distance, also inside
of thick solids, and a gradient of 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.lanes import LANES, squared_terms, vec16
from intaglio.kernels.launch import launch, upload
from intaglio.kernels.point_surface import PointSurface
from intaglio.kernels.points import PointGrid, nearest_point, settle

wp.set_module_options({"enable_backward": False})

CHANNELS = 4


@wp.kernel
def field_kernel(
    start: int,
    surface: PointGrid,
    at: wp.array[wp.vec3],
    group: wp.array[wp.int32],
    reach: float,
    # output
    field: wp.array[wp.vec4],
):
    """Write (d, n) at each node x: d = ±|x - foot|, with the sign of (x - foot) . n, and the normal n at the foot."""
    i = start + wp.tid()
    x = at[i]
    g = group[i]
    value = wp.vec4(reach, 0.0, 0.0, 0.0)
    j = nearest_point(surface, g, x, wp.vec3(), reach)
    if j >= 0:
        begin = surface.points[j]
        side = surface.normals[j]
        foot = begin
        n = side
        if wp.length(begin - x) < 0.5 * surface.support:
            begin = x
        at_foot, at_normal, found = settle(surface, g, x, begin, side)
        if found == 1:
            foot = at_foot
            n = at_normal
        d = wp.min(wp.length(x - foot), reach)
        if wp.dot(x - foot, n) < 0.0:
            d = -d
        value = wp.vec4(d, n[0], n[1], n[2])
    field[i] = value


@wp.kernel
def patch_distance_kernel(
    start: int,
    planes: wp.array[vec16],
    plane: int,
    width: int,
    first: wp.array[wp.int32],
    offset: wp.array[wp.int32],
    value: wp.array[wp.vec4],
    # output
    distance: wp.array3d[vec16],
):
    """Write Σ_k |f(k) - g(k + position)|² over the nodes k of one overlap, for 16 neighbouring positions of a patch.

    f is the field that is there already and g the swatch's, each with a distance and three components of the gradient.
    """
    r, b, c = wp.tid()
    row = start + r
    here = row * width + c * LANES
    total = vec16()
    for k in range(first[b], first[b + 1]):
        at = here + offset[k]
        wanted = value[k]
        total += squared_terms(planes[at], wanted[0])
        total += squared_terms(planes[at + plane], wanted[1])
        total += squared_terms(planes[at + 2 * plane], wanted[2])
        total += squared_terms(planes[at + 3 * plane], wanted[3])
    distance[b, row, c] = total


def signed_distance(surface: PointSurface, at: np.ndarray, *, group: np.ndarray | None = None, reach: float) -> np.ndarray:
    """Return the signed distance to a surface and its unit gradient at positions.

    Parameters
    ----------
    surface : PointSurface
    at : (K, 3) array
    group : (K,) int array, optional
        The set of points each position belongs to.
    reach : float
        How far to look; positions farther away get this distance and a gradient of 0.

    Returns
    -------
    (K, 4) float32 array
        Distance, gradient x, y, z.

    References
    ----------
    Duranleau & Poulin, *Patch-based Synthesis of Geometry Textures with Point-set Surfaces*, section 5.1.
    """
    at = np.ascontiguousarray(at, np.float32)
    if not len(surface):
        return np.repeat(np.array([[reach, 0, 0, 0]], np.float32), len(at), axis=0)
    groups = np.zeros(len(at), np.int32) if group is None else group
    field = wp.empty(len(at), dtype=wp.vec4, device=surface.device)
    launch(
        field_kernel,
        len(at),
        inputs=[
            surface.point_grid,
            upload(at, wp.vec3, surface.device),
            upload(groups, wp.int32, surface.device),
            float(reach),
        ],
        outputs=[field],
        device=surface.device,
        work=4000,
    )
    return field.numpy().copy()


@dataclass(frozen=True)
class Overlaps:
    """Nodes of several patches' overlaps with what is there already.

    Attributes
    ----------
    first : (B + 1,) int array
        Where each patch's nodes begin.
    node : (K, 3) int array
        Column, row and layer of each node, from the patch's first.
    value : (K, 4) float32 array
        The field there.
    """

    first: np.ndarray
    node: np.ndarray
    value: np.ndarray


class PatchSearch:
    """Compares overlaps with all patches of a swatch's field.

    Parameters
    ----------
    field : (columns, rows, layers, 4) float32 array
        Distances (scaled as they are to count against gradients) and gradients, at the nodes.
    device : str
        From `choose_device`.
    """

    def __init__(self, field: np.ndarray, device: str) -> None:
        self.device = device
        columns, rows, layers, channels = field.shape
        if channels != CHANNELS:
            raise ValueError(f"a field has {CHANNELS} channels, not {channels}")
        self.shape = (columns, rows, layers)
        # Groups of 16 positions read past the last column: each row ends with padding.
        self._width = columns + LANES
        self._plane = layers * rows * self._width
        padded = np.zeros((CHANNELS, layers, rows, self._width), np.float32)
        padded[..., :columns] = field.transpose(3, 2, 1, 0)
        self._flat = upload(np.concatenate([padded.ravel(), np.zeros(LANES, np.float32)]), wp.float32, device)
        # The same memory as vectors of 16 that begin at every number.
        self._lanes = wp.array(ptr=self._flat.ptr, dtype=vec16, shape=(padded.size,), strides=(4,), device=device)

    def distances(self, overlaps: Overlaps, positions: tuple[int, int]) -> np.ndarray:
        """Return the squared distance of every overlap to the swatch's patch at every position.

        Parameters
        ----------
        overlaps : Overlaps
            Of B patches.
        positions : (int, int)
            Columns and rows of nodes at which a patch may begin.

        Returns
        -------
        (B, columns, rows) float32 array
        """
        columns, rows = positions
        count = len(overlaps.first) - 1
        groups = -(-columns // LANES)
        node = overlaps.node
        offset = ((node[:, 2] * self.shape[1] + node[:, 1]) * self._width + node[:, 0]).astype(np.int32)
        out = wp.empty((count, rows, groups * LANES), dtype=wp.float32, device=self.device)
        lanes = wp.array(ptr=out.ptr, dtype=vec16, shape=(count, rows, groups), device=self.device)
        launch(
            patch_distance_kernel,
            (rows, count, groups),
            inputs=[
                self._lanes,
                self._plane,
                self._width,
                upload(overlaps.first, wp.int32, self.device),
                upload(offset, wp.int32, self.device),
                upload(overlaps.value, wp.vec4, self.device),
            ],
            outputs=[lanes],
            device=self.device,
            work=20 * len(node) * groups,
        )
        return np.ascontiguousarray(out.numpy()[:, :, :columns].transpose(0, 2, 1))


def candidates(distance: np.ndarray, tolerance: float) -> np.ndarray:
    """Return the indices, in order, of those within (1 + ``tolerance``) of the least distance (section 4, step 2)."""
    flat = np.asarray(distance, np.float64).ravel()
    least = flat.min(initial=np.inf)
    return np.flatnonzero(flat <= (1 + tolerance) * least)
