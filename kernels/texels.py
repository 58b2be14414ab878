"""Texture space: which triangle each texel lies in."""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, upload

wp.set_module_options({"enable_backward": False})

# Side of the tiles that triangles are sorted into, in texels.
_TILE = 32
_TILE_SIDE = wp.constant(_TILE)

# A texel that no triangle holds belongs to one that it is outside of by no more than this, in barycentric coordinates: rounding
# would leave gaps between neighbours otherwise.
_SLACK = wp.constant(-1.0e-5)


@wp.kernel
def rasterize_kernel(
    start: int,
    uv: wp.array[wp.vec2],
    faces: wp.array2d[wp.int32],
    first: wp.array[wp.int32],
    member: wp.array[wp.int32],
    tiles_across: int,
    # output
    face: wp.array2d[wp.int32],
    weight: wp.array2d[wp.vec2],
):
    """Write the first triangle that holds each texel's centre, for one tile, and the barycentric weights of two corners.

    The weight of a corner is the area of the triangle that the centre spans with the opposite side, over the whole area.
    """
    tile = start + wp.tid()
    top = (tile / tiles_across) * _TILE_SIDE
    left = (tile % tiles_across) * _TILE_SIDE
    bottom = wp.min(top + _TILE_SIDE, face.shape[0])
    right = wp.min(left + _TILE_SIDE, face.shape[1])
    for k in range(first[tile], first[tile + 1]):
        f = member[k]
        a = uv[faces[f, 0]]
        b = uv[faces[f, 1]]
        c = uv[faces[f, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area != 0.0:
            low_x = wp.max(left, int(wp.ceil(wp.min(a[0], wp.min(b[0], c[0])) - 0.5)))
            high_x = wp.min(right - 1, int(wp.floor(wp.max(a[0], wp.max(b[0], c[0])) - 0.5)) + 1)
            low_y = wp.max(top, int(wp.ceil(wp.min(a[1], wp.min(b[1], c[1])) - 0.5)))
            high_y = wp.min(bottom - 1, int(wp.floor(wp.max(a[1], wp.max(b[1], c[1])) - 0.5)) + 1)
            for y in range(low_y, high_y + 1):
                for x in range(low_x, high_x + 1):
                    px = float(x) + 0.5
                    py = float(y) + 0.5
                    wa = ((b[0] - px) * (c[1] - py) - (b[1] - py) * (c[0] - px)) / area
                    wb = ((c[0] - px) * (a[1] - py) - (c[1] - py) * (a[0] - px)) / area
                    if wa >= _SLACK and wb >= _SLACK and 1.0 - wa - wb >= _SLACK and face[y, x] < 0:
                        face[y, x] = f
                        weight[y, x] = wp.vec2(wa, wb)


def rasterize(uv: np.ndarray, faces: np.ndarray, height: int, width: int, device: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangle that holds each texel's centre, (H, W) int32, -1 outside, and weights of two corners (H, W, 2).

    Parameters
    ----------
    uv : (N, 2) array
        Positions in [0, 1]^2, v up: row 0 of the texture is at v = 1.
    faces : (F, 3) int array
    height, width : int
    device : str
    """
    placed = np.stack([uv[:, 0] * width, (1 - uv[:, 1]) * height], axis=1)
    across, down = -(-width // _TILE), -(-height // _TILE)
    corner = placed[faces]
    # A triangle's tiles reach one texel farther than it does, because of the slack.
    low = np.clip(np.floor((corner.min(axis=1) - 1) / _TILE), 0, (across - 1, down - 1)).astype(np.int64)
    high = np.clip(np.floor((corner.max(axis=1) + 1) / _TILE), 0, (across - 1, down - 1)).astype(np.int64)
    span = high - low + 1
    number = span[:, 0] * span[:, 1]
    member = np.repeat(np.arange(len(faces)), number)
    within = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    row, column = low[member, 1] + within // span[member, 0], low[member, 0] + within % span[member, 0]
    tile = row * across + column
    order = np.argsort(tile, kind="stable")
    first = np.searchsorted(tile[order], np.arange(across * down + 1))
    face = wp.full((height, width), -1, dtype=wp.int32, device=device)
    weight = wp.zeros((height, width), dtype=wp.vec2, device=device)
    inputs = [
        upload(placed, wp.vec2, device),
        upload(faces, wp.int32, device),
        upload(first, wp.int32, device),
        upload(member[order], wp.int32, device),
        across,
    ]
    launch(rasterize_kernel, across * down, inputs=inputs, outputs=[face, weight], device=device, work=20_000)
    return face.numpy(), weight.numpy()
