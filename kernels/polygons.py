"""Triangulating a closed polygon in space: the triangulation of least area, by dynamic programming.

Klincsek 1980; Barequet & Sharir 1995 for holes of meshes. W(i, k) is the least area over the chain from vertex i to vertex k; all
chains of one length are found at once.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload

wp.set_module_options({"enable_backward": False})

# The area of a chain that cannot be triangulated.
_NEVER = wp.constant(1.0e30)


@wp.kernel
def chain_kernel(
    start: int,
    points: wp.array[wp.vec3],
    number: wp.array[wp.int32],
    barred: wp.array2d[wp.uint8],
    length: int,
    # output
    best: wp.array2d[wp.float32],
    middle: wp.array2d[wp.int32],
):
    """Write W(i, k) = min_m W(i, m) + W(m, k) + area(i, m, k) for k = i + length, and the middle corner m."""
    i = start + wp.tid()
    k = i + length
    least = float(_NEVER)
    at = int(-1)
    closing = i == 0 and k == points.shape[0] - 1
    # A chord that is an edge of the mesh already would get too many triangles. The last chord is an edge of the rim, and free.
    if closing or barred[i, k] == 0:
        a = points[i]
        c = points[k]
        for m in range(i + 1, k):
            below = best[i, m] + best[m, k]
            if below < least and number[m] != number[i] and number[m] != number[k] and number[i] != number[k]:
                b = points[m]
                area = below + 0.5 * wp.length(wp.cross(b - a, c - a))
                if area < least:
                    least = area
                    at = m
    best[i, k] = least
    middle[i, k] = at


def least_area_triangles(points: np.ndarray, number: np.ndarray, barred: np.ndarray, device: str) -> np.ndarray | None:
    """Return the triangles (n - 2, 3) of the triangulation of least area of a closed polygon, as positions in it.

    Parameters
    ----------
    points : (n, 3) array
        The polygon's corners in order, n at least 3.
    number : (n,) array
        Which vertex each corner is: a vertex may stand at several corners, and no triangle has it twice.
    barred : (n, n) bool array
        Pairs of corners that must not be joined.
    device : str
        From `choose_device`.

    Returns
    -------
    array or None
        None where every triangulation needs a barred pair.
    """
    count = len(points)
    scale = float(np.ptp(points, axis=0).max()) or 1.0
    at = upload((points - points[0]) / scale, wp.vec3, device)
    table = np.full((count, count), float(_NEVER), np.float32)
    table[np.arange(count - 1), np.arange(1, count)] = 0
    best = upload(table, wp.float32, device)
    middle = wp.full((count, count), -1, dtype=wp.int32, device=device)
    inputs = [
        at,
        upload(number, wp.int32, device),
        upload(barred, wp.uint8, device),
    ]
    for length in range(2, count):
        launch(chain_kernel, count - length, inputs=[*inputs, length], outputs=[best, middle], device=device, work=3.0 * length)
    split = middle.numpy()
    triangles, open_chains = [], [(0, count - 1)]
    while open_chains:
        i, k = open_chains.pop()
        if k - i < 2:
            continue
        m = int(split[i, k])
        if m < 0:
            return None
        triangles.append((i, m, k))
        open_chains += [(i, m), (m, k)]
    return np.array(triangles, np.int64)
