"""A relightable texture tiled on a teapot, under two lights and from two places (the thesis's figure 7.3.1)."""

from __future__ import annotations

import argparse

import numpy as np

from intaglio.files import write_image
from intaglio.photometric import PhotometricStack, Relightable, bsdf_of, light_direction, represent, write_relightable
from intaglio.render import Gloss, Viewpoint, frame, photometric_capture, relit
from intaglio.scenes.common import main
from intaglio.scenes.rough_surfaces import periodic_noise, wrapped
from intaglio.scenes.teapot import teapot

Array = np.ndarray

# On a round body light grazes somewhere: the piece is photographed under low lights as well.
DOME = np.array([light_direction(30 * t, s) for s in (15, 30, 45, 60, 75, 84) for t in range(12)])
LIGHTS = {"from the left": np.array([-0.7, 0.7, 0.9]), "from the right": np.array([0.9, 0.6, 0.7])}
VIEWS = {"front": np.array([0.15, 0.35, 1.0]), "spout": np.array([0.9, 0.55, 0.6])}


def hammered(size: int = 96, *, samples: int = 32, seed: int = 1) -> PhotometricStack:
    """Return photographs of a piece of hammered, glazed clay that repeats without a seam.

    Three by three pieces are photographed and the middle one is cut out, so that shadows cross its borders as well.
    """
    relief = periodic_noise(size, seed=seed, stream=11, slope=1.8, coarsest=4, finest=0.12)
    stain = periodic_noise(size, seed=seed, stream=12, slope=1.5)
    color = np.array([0.33, 0.16, 0.08]) * (1 + 0.15 * stain[..., None] - 0.12 * relief[..., None])
    height = wrapped(np.tile(0.6 * relief, (3, 3)))
    albedo = np.tile(np.clip(color, 0.02, 0.9), (3, 3, 1))
    images = photometric_capture(height, albedo, DOME, gloss=Gloss(alpha=0.18), samples=samples, seed=seed)
    middle = slice(size, 2 * size)
    return PhotometricStack(images[:, middle, middle], DOME, ceiling=np.inf)


def views(texture: Relightable, *, size: int = 480, samples: int = 64, seed: int = 0) -> list[list[Array]]:
    """Return the teapot's pictures: a row per place, a column per light."""
    vertices, faces, uv = teapot(repeats=7)
    bsdf = bsdf_of(texture, back=True)
    rows = []
    for direction in VIEWS.values():
        camera: Viewpoint = frame(vertices, direction, margin=0.77)
        rows.append(
            [
                relit(
                    vertices,
                    faces,
                    uv,
                    bsdf,
                    camera=camera,
                    light=light,
                    size=(size * 3 // 4, size),
                    samples=samples,
                    background=0.6,
                    seed=seed,
                )
                for light in LIGHTS.values()
            ]
        )
    return rows


def run(
    args: argparse.Namespace,
    *,
    kinds: tuple[str, ...] = ("gradient", "rbf"),
    texels: int = 96,
    size: int = 480,
    samples: int = 64,
) -> Array:
    """Run the scene."""
    print("photographing a hammered, glazed piece under 72 lights …")
    stack = hammered(texels, samples=max(2, samples // 2), seed=args.seed)
    columns = []
    for kind in kinds:
        texture = represent(stack, kind, device=args.device)
        print(f"rendering the teapot in {kind} …")
        rows = views(texture, size=size, samples=samples, seed=args.seed)
        columns.append(np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0))
        write_relightable(texture, args.output / f"relit_teapot_{kind}.exr")
    sheet = np.concatenate(columns, axis=0)
    path = args.output / "relit_teapot.png"
    write_image(sheet, path)
    print(f"wrote {path}: {', '.join(kinds)}, each from two places under two lights")
    return sheet


if __name__ == "__main__":
    main(run, __doc__)
