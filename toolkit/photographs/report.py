"""The page about a texture from photographs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from intaglio.arrays import Array, PathLike
from intaglio.files import listing, picture_row, table, write_page
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh import Surface
from intaglio.parameterization import Parameterization, checkerboard, describe_parameterization, layout_picture
from intaglio.photographs.assess import border_step
from intaglio.photographs.texture import Texture
from intaglio.render import frame, lit_texture

# Colours that represent the photographs in turn; made-up texels are dark, texels outside are white.
_TINTS = np.array(
    [
        [0.30, 0.55, 0.85],
        [0.90, 0.60, 0.20],
        [0.40, 0.72, 0.38],
        [0.80, 0.35, 0.35],
        [0.60, 0.45, 0.75],
        [0.55, 0.40, 0.30],
        [0.88, 0.55, 0.75],
        [0.70, 0.70, 0.25],
        [0.35, 0.75, 0.80],
    ]
)
_MADE_UP = np.array([0.15, 0.15, 0.15])

# The largest side of a picture of a texture, in pixels.
_SHOWN = 1024


def coverage_picture(texture: Texture) -> Array:
    """Return each texel's strongest photograph as a colour, (H, W, 3) linear."""
    strongest = texture.photograph[:, :, 0]
    tint = np.where((texture.known & (strongest >= 0))[:, :, None], _TINTS[strongest % len(_TINTS)], _MADE_UP)
    return np.asarray(decode_srgb(np.where(texture.inside[:, :, None], tint, 1.0)))


def viewpoints(surface: Surface, view: ArrayLike | None) -> list[tuple[str, Array]]:
    """Return names and directions of four views; the first is the given one, or the one that most of the surface faces."""
    corner = surface.vertices[surface.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    front = np.asarray(view, np.float64) if view is not None else normal.sum(axis=0)
    if np.linalg.norm(front) < 1e-3 * np.linalg.norm(normal, axis=1).sum():
        front = np.array([0.0, 0.0, 1.0])
    front = front / np.linalg.norm(front)
    up = np.array([0.0, 1.0, 0.0]) if abs(front[1]) < 0.9 else np.array([0.0, 0.0, -1.0])
    side = np.cross(up, front)
    side /= np.linalg.norm(side)
    return [
        ("from the front", front),
        ("from the right", front * 0.35 + side),
        ("from the left", front * 0.35 - side),
        ("from behind", -front),
    ]


def textured_views(
    surface: Surface, uv: Parameterization, image: Array, view: ArrayLike | None, *, size: tuple[int, int] = (480, 480)
) -> dict[str, Array]:
    """Return pictures (H, W, 3) of the textured surface from four sides, evenly lit, linear, by name."""
    vertices = surface.vertices[uv.vertex]
    found = {}
    for name, direction in viewpoints(surface, view):
        camera = frame(surface.vertices[np.unique(surface.faces)], direction, margin=1.02)
        found[name] = lit_texture(vertices, uv.faces, uv.uv, image, camera=camera, size=size, samples=24)
    return found


def write_texture_report(
    path: PathLike,
    surface: Surface,
    uv: Parameterization,
    texture: Texture,
    *,
    title: str,
    view: ArrayLike | None = None,
    extra: Sequence[str] = (),
) -> None:
    """Write a page of the textured mesh from four sides, its texture, where that comes from, and the layout.

    Parameters
    ----------
    path : path
        .html.
    surface : Surface
    uv : Parameterization
    texture : Texture
    title : str
    view : (3,) sequence, optional
        Direction of the first view, from the object to the eye.
    extra : sequence of str
        Lines for the list of figures.
    """
    made_up = np.where((texture.inside & ~texture.known)[:, :, None], np.array([0.75, 0.05, 0.05]), texture.image)
    share = 100 * texture.known.sum() / max(int(texture.inside.sum()), 1)
    lines = [
        f"texture {texture.image.shape[1]} x {texture.image.shape[0]}, {share:.1f} % of the surface's texels photographed",
        f"step at borders between photographs: {border_step(texture):.3f} of the texture's own there",
        *extra,
        *texture.notes,
    ]
    rows = [
        (name, f"{100 * part:.1f} %", " ".join(f"{g:.3f}" for g in gain))
        for (name, part), gain in zip(texture.coverage.items(), texture.gains, strict=True)
    ]
    flat = {
        "texture": _small(texture.image),
        "photographs it comes from; dark: made up": _small(coverage_picture(texture)),
        "layout, coloured by stretch": layout_picture(uv),
    }
    write_page(
        path,
        title,
        [
            picture_row("Textured", textured_views(surface, uv, texture.image, view)),
            picture_row("Made up, in red", textured_views(surface, uv, made_up, view)),
            picture_row("Texture", flat),
            listing("Figures", lines),
            table("Photographs", ("photograph", "share of the surface", "exposure factor (red green blue)"), rows),
            picture_row("Checkerboard", textured_views(surface, uv, checkerboard(), view)),
            listing("Parameterization", describe_parameterization(uv, surface, view)),
        ],
    )


def _small(image: Array) -> Array:
    step = -(-max(image.shape[:2]) // _SHOWN)
    return image[::step, ::step]
