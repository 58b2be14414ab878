"""A scan under a pose, as heights over the ground of a hole, and how like it is to what lies around the hole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.arrays import Array
from intaglio.kernels.geodesics import copy_kernel
from intaglio.kernels.launch import launch, upload
from intaglio.kernels.meshes import build_mesh
from intaglio.mesh import vertex_normals
from intaglio.relief.coherent import average, averaging
from intaglio.relief.ground import Ground
from intaglio.relief.symmetry.poses import Pose

# A copy this many spacings beyond the ground's own extent is looked at.
_MARGIN = 8.0
# The least-fitting share of the surroundings doesn't count: there the place may have something else beside it.
_TRIMMED = 0.15
# Waves up to this share of the hole's radius are the relief by which places are compared.
_FINE = 1.0


@dataclass(frozen=True)
class Copy:
    """The scan under a pose, over the ground of a hole.

    Attributes
    ----------
    pose : Pose
    height : (N,) array
        Over the ground's base, in the input's unit.
    source : (N,) int array
        The scan's vertex that is nearest.
    reached : (N,) bool array
        Where the base's normal meets the copy.
    """

    pose: Pose
    height: Array
    source: Array
    reached: Array


def lay_copy(ground: Ground, pose: Pose, wanted: Array, points: Array, faces: Array, device: str) -> Copy:
    """Return the scan under a pose as heights over a ground.

    Parameters
    ----------
    ground : Ground
    pose : Pose
        From the hole to the place that it is like.
    wanted : (N,) bool array
        The ground's vertices where heights are wanted; the others are not reached.
    points, faces : (M, 3), (F, 3) arrays
        The measured scan.
    device : str
    """
    count, spacing = len(ground.foot), ground.spacing
    # All is done where the original lies: nothing of it moves.
    at = np.flatnonzero(wanted)
    foot, way = pose.apply(ground.foot[at]), ground.normal[at] @ pose.turn.T
    low, high = foot.min(axis=0) - _MARGIN * spacing, foot.max(axis=0) + _MARGIN * spacing
    near = ((points > low) & (points < high)).all(axis=1)
    faces = faces[near[faces].all(axis=1)]
    copy = Copy(pose, np.zeros(count), np.zeros(count, np.int32), np.zeros(count, bool))
    if len(faces) == 0:
        return copy
    number = np.flatnonzero(near)
    local = (np.cumsum(near) - 1)[faces]
    own = points[number]
    center = own.mean(axis=0)
    # In spacings near the origin, as single precision wants it.
    scaled = upload((own - center) / spacing, wp.vec3, device)
    height = upload(np.where(ground.measured, ground.height, 0.0)[at] / spacing, wp.float32, device)
    source, reached = wp.zeros(len(at), dtype=wp.int32, device=device), wp.zeros(len(at), dtype=wp.uint8, device=device)
    mesh = build_mesh(scaled, local)
    launch(
        copy_kernel,
        len(at),
        inputs=[
            upload((foot - center) / spacing, wp.vec3, device),
            upload(way, wp.vec3, device),
            mesh.id,
            upload(vertex_normals(own, local), wp.vec3, device),
        ],
        outputs=[height, source, reached],
        device=device,
    )
    copy.height[at] = height.numpy().astype(np.float64) * spacing
    copy.source[at] = number[source.numpy()]
    copy.reached[at] = reached.numpy() > 0
    return copy


def unlikeness(ground: Ground, copy: Copy, around: Array, radius: float) -> float:
    """Return how unlike a copy is to the surroundings of a hole: 0 for the same, about 1.4 where they have nothing in common.

    Root mean square of the difference of relief over that of the relief itself, of waves up to the hole's radius.

    Parameters
    ----------
    ground : Ground
    copy : Copy
    around : (N,) bool array
        The measured vertices that count.
    radius : float
        In the input's unit.
    """
    known = around & copy.reached
    matrix = averaging(ground.topology.graph, known)
    values = np.stack([ground.height, ground.height - copy.height], axis=1) * known[:, None]
    # Averaged t times, waves shorter than some 3 sqrt(t) edges are gone.
    times = max(1, int((_FINE * radius / ground.spacing / 3) ** 2))
    relief, difference = trimmed_mean((values - average(matrix, values, times))[known] ** 2)
    return float(np.sqrt(difference / max(relief, 1e-300)))


def trimmed_mean(values: Array) -> Array:
    """Return the means of values (N,) or (N, C) without the largest 15 %: where the surroundings go on otherwise."""
    kept = max(1, int((1 - _TRIMMED) * len(values)))
    return np.asarray(np.sort(values, axis=0)[:kept].mean(axis=0))
