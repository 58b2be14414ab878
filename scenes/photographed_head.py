"""A head photographed from five sides under differing light and exposure: its texture, against the true one."""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intaglio.files import read_image, write_image
from intaglio.mesh import Surface
from intaglio.parameterization import Parameterization, parameterize
from intaglio.photographs import (
    Photograph,
    Texture,
    bind_photographs,
    border_step,
    combine_photographs,
    restore_texture,
    textured_views,
    write_texture_report,
    write_textured,
)
from intaglio.progress import ProgressBar
from intaglio.render import compare, through_camera
from intaglio.scenes.common import main, real_data, side_by_side
from intaglio.scenes.photographs import camera_towards, photographed

Array = np.ndarray

FRONT = (0.0, 0.0, 1.0)
# Name, direction, up, direction of the light, and exposure of red, green and blue.
VIEWS = (
    ("front", (0, 0.05, 1), (0, 1, 0), (0.3, 0.5, 1), (1.0, 1.0, 1.0)),
    ("left", (-1, 0.05, 0.1), (0, 1, 0), (-1, 0.6, 0.4), (1.5, 1.45, 1.35)),
    ("right", (1, 0.05, 0.1), (0, 1, 0), (1, 0.3, 0.6), (0.8, 0.82, 0.9)),
    ("back", (0, 0.05, -1), (0, 1, 0), (0.2, 0.8, -1), (1.2, 1.15, 1.05)),
    ("top", (0, 1, 0.15), (0, 0, -1), (0.2, 1, 0.3), (0.9, 0.9, 0.95)),
)
# Where the result is looked at, none of them photographed.
NOVEL = {"half left": (-0.8, 0.2, 0.8), "half right": (0.8, 0.1, 0.8), "from behind": (0.7, 0.4, -0.8)}


@dataclass(frozen=True)
class Result:
    """What the scene found."""

    laid: Parameterization
    texture: Texture
    plain_step: float
    step: float
    psnr: dict[str, float]
    plain_psnr: dict[str, float]


def head() -> tuple[Surface, tuple[Array, Array, Array, Array]]:
    """Return the head as one surface, and with its own texture: vertices, faces, texture positions and image."""
    import trimesh

    folder = real_data("meshes/lee_perry_smith_head/LeePerrySmith.glb").parent
    scene = trimesh.load(folder / "LeePerrySmith.glb", process=False)
    part = next(iter(scene.geometry.values()))
    vertices, whole = np.unique(np.asarray(part.vertices, float), axis=0, return_inverse=True)
    surface = Surface(vertices=vertices, faces=whole.reshape(-1)[part.faces].astype(np.int32))
    # The file's texture was made for v upwards, which glTF has downwards.
    uv = np.asarray(part.visual.uv, float) * (1, -1) + (0, 1)
    return surface, (np.asarray(part.vertices, float), np.asarray(part.faces), uv, read_image(folder / "Map-COL.jpg"))


def photographs(size: int, samples: int, seed: int) -> tuple[Surface, list[Photograph], tuple[Array, Array, Array, Array]]:
    """Return the head, its photographs, and the truth: vertices, faces, texture positions and image."""
    surface, truth = head()
    vertices = surface.vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    radius = float(np.linalg.norm(vertices - middle, axis=1).max())
    found = []
    for number, (name, direction, up, light, exposure) in enumerate(VIEWS):
        camera = camera_towards(
            middle, np.array(direction, float), np.array(up, float), 5 * radius, focal=2.35 * size, size=(size, size)
        )
        found.append(
            photographed(
                *truth,
                camera,
                name,
                lights=[(np.array(light, float), 1.1)],
                ambient=0.55,
                exposure=np.array(exposure),
                samples=samples,
                seed=seed + number,
            )
        )
    return surface, found, truth


def run(args: argparse.Namespace, *, size: int = 1200, texels: int = 2048, samples: int = 48) -> Result:
    """Photograph, texture, restore, and compare with the truth from new directions."""
    print("photographing the head from five sides …")
    surface, taken, truth = photographs(size, samples, args.seed)
    start = time.perf_counter()
    with ProgressBar("laying flat") as bar:
        laid = parameterize(surface, view=FRONT, importance=1.5, shape_threshold=0.02, device=args.device, progress=bar.update)
    flat = time.perf_counter() - start
    binding = bind_photographs(surface, taken, device=args.device)
    start = time.perf_counter()
    made = combine_photographs(surface, laid, taken, texels, binding=binding, device=args.device)
    combined = time.perf_counter() - start
    plain = combine_photographs(surface, laid, taken, texels, binding=binding, device=args.device, blend="none", exposure=False)
    average = combine_photographs(
        surface, laid, taken, texels, binding=binding, device=args.device, select="average", blend="none", exposure=False
    )
    start = time.perf_counter()
    with ProgressBar("restoring") as bar:
        whole = restore_texture(made, device=args.device, progress=bar.update)
    restored = time.perf_counter() - start
    step, plain_step = border_step(made), border_step(plain)
    scores = {n: _novel_views(surface, laid, t.image, truth, size) for n, t in (("ours", whole), ("average", average))}
    lines = [
        f"laid flat in {flat:.1f} s: L2 stretch {laid.l2_stretch:.4f}, {laid.flips} flips",
        f"combined in {combined:.1f} s, restored in {restored:.1f} s",
        f"step at borders {step:.3f}; without blending {plain_step:.3f}",
    ]
    for name in NOVEL:
        ours, simple = scores["ours"][name], scores["average"][name]
        lines.append(f"{name}: PSNR {ours:.2f} dB, plain average {simple:.2f} dB")
    for line in lines:
        print(f"  {line}")
    mesh, page, sheet = (Path(args.output) / f"photographed_head{suffix}" for suffix in (".glb", ".html", ".png"))
    write_textured(surface, laid, whole, mesh)
    write_texture_report(page, surface, laid, whole, title="Photographed head", view=FRONT, extra=lines)
    rows = [[p.read()[0][::3, ::3] for p in taken]]
    rows += [list(textured_views(surface, laid, t.image, FRONT).values()) for t in (plain, made, whole)]
    strips = [side_by_side(row) for row in rows]
    width = max(s.shape[1] for s in strips)
    padded = [np.pad(s, ((0, 0), (0, width - s.shape[1]), (0, 0)), constant_values=1.0) for s in strips]
    write_image(np.concatenate(padded), sheet)
    print(f"wrote {mesh}, {page} and {sheet}")
    return Result(laid, whole, plain_step, step, scores["ours"], scores["average"])


def _novel_views(
    surface: Surface, laid: Parameterization, image: Array, truth: tuple[Array, Array, Array, Array], size: int
) -> dict[str, float]:
    """Return the PSNR of unlit views against the true texture's, after one factor per channel."""
    middle = (surface.vertices.min(axis=0) + surface.vertices.max(axis=0)) / 2
    radius = float(np.linalg.norm(surface.vertices - middle, axis=1).max())
    half = size // 2
    found = {}
    for name, direction in NOVEL.items():
        camera = camera_towards(
            middle, np.array(direction, float), np.array([0.0, 1, 0]), 5 * radius, focal=2.35 * half, size=(half, half)
        )
        view = {"matrix": camera.K, "turn": camera.R, "shift": camera.t, "size": (half, half), "samples": 16}
        ours, alpha = through_camera(surface.vertices[laid.vertex], laid.faces, laid.uv, image, **view)  # type: ignore[arg-type]
        wanted, _ = through_camera(*truth, **view)  # type: ignore[arg-type]
        seen = alpha > 0.99
        factor = np.median(wanted[seen], axis=0) / np.maximum(np.median(ours[seen], axis=0), 1e-6)
        pair = [np.where(seen[:, :, None], a, 0).astype(np.float32) for a in (ours * factor, wanted)]
        share = seen.mean()
        # PSNR over the pixels that show the head: those around it are equal in both.
        found[name] = compare(*pair).psnr + float(10 * np.log10(share))
    return found


if __name__ == "__main__":
    main(run, __doc__)
