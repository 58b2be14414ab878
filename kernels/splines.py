"""Thin-plate splines in space, evaluated with their Jacobian at many points of many patches.

The spline through n centres c_i is W(x) = A x + b + sum w_i |x - c_i|: |r| is the thin-plate (biharmonic) kernel in three
dimensions. Its Jacobian is J(x) = A + sum w_i (x - c_i)^T / |x - c_i|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload

wp.set_module_options({"enable_backward": False})


@wp.kernel
def warp_kernel(
    start: int,
    points: wp.array[wp.vec3],
    normals: wp.array[wp.vec3],
    group: wp.array[wp.int32],
    first: wp.array[wp.int32],
    centers: wp.array[wp.vec3],
    weights: wp.array[wp.vec3],
    linear: wp.array[wp.mat33],
    offset: wp.array[wp.vec3],
    # output
    warped: wp.array[wp.vec3],
    turned: wp.array[wp.vec3],
    volume: wp.array[wp.float32],
):
    """Write W(x) = A x + b + Σ w_i |x - c_i|, the normal carried by the Jacobian J(x), and det J(x).

    The cross product of two carried tangents is the cofactor matrix times the normal: (J u) x (J v) = cof(J) (u x v).
    """
    i = start + wp.tid()
    x = points[i]
    g = group[i]
    moved = linear[g] * x + offset[g]
    j0 = wp.vec3()
    j1 = wp.vec3()
    j2 = wp.vec3()
    for k in range(first[g], first[g + 1]):
        d = x - centers[k]
        # |r| has a kink at the centre, where its mean slope is 0: the small number turns the quotient 0 / 0 into that.
        r = wp.sqrt(wp.dot(d, d) + 1.0e-30)
        w = weights[k]
        moved += r * w
        d = d / r
        j0 += w[0] * d
        j1 += w[1] * d
        j2 += w[2] * d
    a = linear[g]
    j0 += wp.vec3(a[0, 0], a[0, 1], a[0, 2])
    j1 += wp.vec3(a[1, 0], a[1, 1], a[1, 2])
    j2 += wp.vec3(a[2, 0], a[2, 1], a[2, 2])
    n = normals[i]
    c0 = wp.cross(j1, j2)
    cofactor = wp.vec3(wp.dot(c0, n), wp.dot(wp.cross(j2, j0), n), wp.dot(wp.cross(j0, j1), n))
    length = wp.length(cofactor)
    if length > 0.0:
        n = cofactor / length
    warped[i] = moved
    turned[i] = n
    volume[i] = wp.dot(j0, c0)


@dataclass(frozen=True)
class Splines:
    """Warps of several patches, W(x) = A x + b + Σ w_i |x - c_i|.

    Attributes
    ----------
    first : (B + 1,) int array
        Where each patch's centres begin.
    centers, weights : (n, 3) arrays
    linear, offset : (B, 3, 3), (B, 3) arrays
    """

    first: np.ndarray
    centers: np.ndarray
    weights: np.ndarray
    linear: np.ndarray
    offset: np.ndarray


def warp_points(
    points: np.ndarray, normals: np.ndarray, group: np.ndarray, splines: Splines, device: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points and normals (m, 3) warped by the spline of their group, and the Jacobian's determinant (m,), float32.

    Parameters
    ----------
    points, normals : (m, 3) arrays
    group : (m,) int array
        Which spline.
    splines : Splines
    device : str
        From `choose_device`.
    """
    count, first = len(points), splines.first
    warped = wp.empty(count, dtype=wp.vec3, device=device)
    turned = wp.empty(count, dtype=wp.vec3, device=device)
    volume = wp.empty(count, dtype=wp.float32, device=device)
    launch(
        warp_kernel,
        count,
        inputs=[
            upload(points, wp.vec3, device),
            upload(normals, wp.vec3, device),
            upload(group, wp.int32, device),
            upload(first, wp.int32, device),
            upload(splines.centers, wp.vec3, device),
            upload(splines.weights, wp.vec3, device),
            upload(splines.linear, wp.mat33, device),
            upload(splines.offset, wp.vec3, device),
        ],
        outputs=[warped, turned, volume],
        device=device,
        work=10 * len(splines.centers) / max(len(first) - 1, 1),
    )
    return warped.numpy().copy(), turned.numpy().copy(), volume.numpy().copy()
