"""What else the papers show: their patterns at their own rule, frames, pairing, a whole tower, sampling, noise, bark.

Breckon & Fisher, TPAMI 2008, figures 5 to 7 and 9 to 10, and 3DIM 2005, figures 7 to 9 and 12. The papers' rule is the surface
metric, one vertex after the other, a match among the best 10 %, samples oversampled once where targets are out of phase, and no
refinement.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from intaglio.files import write_image
from intaglio.mesh import Surface, unique_edges
from intaglio.relief import Selection, clay_pictures, fixed_cameras, prepare_relief
from intaglio.scenes.bark import DEPTH, material, seen, trunk
from intaglio.scenes.common import Result, main, run_scene
from intaglio.scenes.patterns import (
    PLANE_LENGTH,
    PLANE_SIDE,
    bumps,
    cylinder_base,
    grid_faces,
    on_cylinder,
    on_plane,
    plane_base,
    plane_wave,
    wave,
)
from intaglio.scenes.rough_surfaces import periodic_noise
from intaglio.scenes.tower import tower

Array = np.ndarray

PLANE_EXTENT = (0.0, PLANE_LENGTH - 1.0, 0.0, PLANE_SIDE - 1.0)
# Between the scan's steps of 1: no target stays in phase for long.
OUT_OF_PHASE = 0.93
PAPERS: dict[str, Any] = {
    "metric": "surface", "order": "sequential", "selection": Selection("best-percent", eta=10), "oversample": 0, "refine": 0,
    "rotations": 1,
}  # fmt: skip
PATTERNS: dict[str, tuple[str, Callable[[], tuple[Surface, Surface]], dict[str, Any]]] = {
    "cylinder_bumps": ("Bumps on a cylinder", lambda: on_cylinder(bumps), {"base": cylinder_base()}),
    "cylinder_wave": ("A wave on a cylinder", lambda: on_cylinder(wave), {"base": cylinder_base()}),
    "plane_wave": ("A wave on a plane", lambda: on_plane(plane_wave), {"base": plane_base(), "extent": PLANE_EXTENT}),
}


def by_the_papers(name: str, **other: Any) -> Callable[[str, argparse.Namespace], Result]:
    """Return the scene of a pattern of TPAMI 2008's figure 7 at the papers' rule, other settings changed."""

    def scene(own: str, args: argparse.Namespace) -> Result:
        title, make, laid = PATTERNS[name]
        scan, truth = make()
        settings = {**PAPERS, "window": 2, "error": 0.1, **laid, **other}
        phase = ", out of phase" if "spacing" in other else ""
        how = "relief between vertices" if "interpolate" in other else "the papers' rule"
        return run_scene(own, f"{title}, {how}{phase}", scan, args, truth=truth, **settings)

    return scene


def noisy_tower(noise: float) -> Callable[[str, argparse.Namespace], Result]:
    """Return the scene of a whole tower from the half that is seen (TPAMI 2008, figure 9; with more noise figure 10)."""

    def scene(own: str, args: argparse.Namespace) -> Result:
        truth, base = tower(step=0.2)
        outward = truth.vertices * (1, 1, 0) / np.linalg.norm(truth.vertices[:, :2], axis=1, keepdims=True)
        jitter = np.random.default_rng(0).normal(0, noise, len(truth.vertices))
        angle = np.arctan2(truth.vertices[:, 1], truth.vertices[:, 0])
        noisy = Surface(vertices=truth.vertices + jitter[:, None] * outward, faces=truth.faces)
        scan = noisy.part(np.abs(angle) < np.pi / 2)
        title = f"Whole tower from one half, noise {1000 * noise:g} mm"
        return run_scene(
            own, title, scan, args, truth=truth, base=base, window=7, error=0.1, rotations=1, refine=0
        )  # fmt: skip

    return scene


def sampled_at(spacing: float) -> Callable[[str, argparse.Namespace], Result]:
    """Return the scene of a wave of period 6 completed with targets so far apart (3DIM 2005, figure 7)."""

    def scene(own: str, args: argparse.Namespace) -> Result:
        scan, truth = on_plane(wave)
        title = f"A wave of period 6, targets {spacing:g} apart"
        return run_scene(
            own, title, scan, args, truth=truth, base=plane_base(), extent=PLANE_EXTENT, spacing=spacing, window=3, rotations=1,
            refine=0,
        )  # fmt: skip

    return scene


def plane_noise(own: str, args: argparse.Namespace) -> Result:
    """Complete noise on a plane (3DIM 2005, figure 8)."""
    noise = 0.5 * periodic_noise(96, seed=1, stream=7, slope=1.0, coarsest=6, finest=0.2)

    def pattern(column: Array, row: Array) -> Array:
        return np.asarray(noise[column.astype(int) % 96, row.astype(int) % 96])

    scan, truth = on_plane(pattern)
    return run_scene(
        own, "Noise on a plane", scan, args, truth=truth, base=plane_base(), extent=PLANE_EXTENT, rotations=1, refine=0
    )


def bark_relief(own: str, args: argparse.Namespace) -> Result:
    """Complete real bark without its colours (3DIM 2005, figure 9; TPAMI 2008, figure 11: R = 2)."""
    whole = trunk()
    low = whole.part(whole.vertices[:, 2] < 0.45 * whole.vertices[:, 2].max())
    truth = Surface(vertices=low.vertices, faces=low.faces)
    half = low.part(seen_vertices(low))
    scan = Surface(vertices=half.vertices, faces=half.faces)
    return run_scene(own, "Real bark, relief only", scan, args, truth=truth, base="cylinder", rotations=2, refine=0)


def seen_vertices(surface: Surface) -> Array:
    """Return which vertices (N,) of a part of the trunk are seen."""
    front = {v.tobytes() for v in seen(trunk()).vertices}
    return np.array([v.tobytes() in front for v in surface.vertices])


def bark_extended(own: str, args: argparse.Namespace) -> Result:
    """Extend a piece of real bark, relief and colour, to twice its width (3DIM 2005, figure 12)."""
    from intaglio.kernels.transfer import encode_srgb

    side, length = 96, 192
    height = encode_srgb(material("displacement"))[:length, :side, 0]
    height = DEPTH * (height - height.min()) / np.ptp(height)
    color = material("albedo")[:length, :side, :3].astype(np.float32)

    def sheet(columns: int) -> Surface:
        c, r = np.meshgrid(np.arange(columns), np.arange(side), indexing="ij")
        vertices = np.stack([c, r, height[c, r]], axis=-1).reshape(-1, 3).astype(float)
        return Surface(vertices=vertices, faces=grid_faces(columns, side, False), color=color[c, r].reshape(-1, 3))

    extent = (0.0, length - 1.0, 0.0, side - 1.0)
    return run_scene(
        own, "Bark extended, relief and colour", sheet(side), args, truth=sheet(length), base=plane_base(), extent=extent,
        color_weight=0.5, rotations=1, refine=0,
    )  # fmt: skip


def frames(own: str, args: argparse.Namespace) -> None:
    """Picture local frames as an L at every vertex, before and after they are made consistent (TPAMI 2008, figure 5)."""
    from intaglio.scenes.ball import ball

    smooth = ball(subdivisions=3)
    outward = smooth.vertices / np.linalg.norm(smooth.vertices, axis=1, keepdims=True)
    smooth = Surface(vertices=20 * outward, faces=smooth.faces)
    cap = smooth.part(smooth.vertices[:, 2] > -8)
    tube, _ = on_cylinder(wave)
    rows = []
    for what, scan, base, how in (
        ("sphere", cap, "sphere", "algebraic"),
        ("sphere", cap, "sphere", "sweep"),
        ("cylinder", tube, cylinder_base(), "algebraic"),
        ("cylinder", tube, cylinder_base(), "sweep"),
    ):
        ground = prepare_relief(scan, base, frames=how, device=args.device).ground
        edges = unique_edges(ground.faces)
        turn = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", *(ground.u[edges[:, k]] for k in range(2))), -1, 1)))
        print(f"  {what}, frames {how}: {(turn > 30).mean():.1%} of edges turn them by more than 30 degrees")
        marked = with_bars(ground.foot, ground.normal, ground.faces, (ground.u, ground.v), 0.7 * ground.spacing)
        shown = replace(marked, model=ground.base)
        up = np.array([0.0, 0.0, 1.0])
        sides = [("from one side", np.array([1.0, 0.3, 0.4]), up), ("from the other", np.array([-1.0, -0.5, 0.4]), up)]
        cameras = fixed_cameras(shown, sides)
        rows.append(np.concatenate(clay_pictures(shown, cameras), axis=0))
    write_image(np.concatenate(rows, axis=1), args.output / f"{own}.png")
    print(f"wrote {args.output / f'{own}.png'}")


def with_bars(foot: Array, normal: Array, faces: Array, axes: tuple[Array, Array], length: float) -> Surface:
    """Return a surface with two bars at every vertex: a long red one along the first axis, a short green one along the second."""
    vertices, triangles = [foot], [faces]
    colors = [np.tile(np.array([[0.55, 0.52, 0.48]]), (len(foot), 1))]
    count = len(foot)
    for along, across, reach, color in ((axes[0], axes[1], 1.0, (0.6, 0.02, 0.02)), (axes[1], axes[0], 0.5, (0.02, 0.4, 0.05))):
        start = foot + 0.05 * length * normal
        side = 0.08 * length * across
        corners = np.stack(
            [start - side, start + side, start + side + reach * length * along, start - side + reach * length * along]
        )
        number = count + np.arange(4 * len(foot)).reshape(4, -1)
        both = [number[[0, 1, 2]], number[[0, 2, 3]], number[[0, 2, 1]], number[[0, 3, 2]]]
        vertices.append(corners.reshape(-1, 3))
        triangles.append(np.concatenate([t.T for t in both]))
        colors.append(np.tile(np.array([color]), (4 * len(foot), 1)))
        count += 4 * len(foot)
    return Surface(
        vertices=np.concatenate(vertices), faces=np.concatenate(triangles), color=np.concatenate(colors).astype(np.float32)
    )


def pairing(own: str, args: argparse.Namespace) -> None:
    """Draw partners found as nearest points in space and by their place on the base (TPAMI 2008, figure 6)."""
    from PIL import Image, ImageDraw

    x = np.arange(0.0, 12.01, 0.25)
    sample, target = (np.stack([x, 1.6 * np.sin(2 * np.pi * (x - shift) / 6)], axis=1) for shift in (0.0, 1.5))
    nearest = np.argmin(np.linalg.norm(target[:, None] - sample[None], axis=2), axis=1)
    sheet = Image.new("RGB", (1200, 720), "white")
    draw = ImageDraw.Draw(sheet)
    for row, (title, partner) in enumerate((("nearest in space", nearest), ("nearest on the base", np.arange(len(x))))):
        place = [[(40 + 93 * a, 190 + 350 * row - 70 * b) for a, b in curve] for curve in (target, sample)]
        for k, other in enumerate(partner):
            draw.line([place[0][k], place[1][other]], fill=(200, 60, 40), width=2)
        for curve, color in zip(place, ((30, 90, 200), (40, 40, 40)), strict=True):
            draw.line(curve, fill=color, width=3)
            for a, b in curve:
                draw.ellipse((a - 4, b - 4, a + 4, b + 4), fill=color)
        cost = float((np.linalg.norm(target - sample[partner], axis=1) ** 2).mean())
        used = len(np.unique(partner)) / len(partner)
        said = f"{title}: mean squared distance {cost:.2f}, {used:.0%} of the samples are partners"
        draw.text((40, 20 + 350 * row), said, fill="black", font_size=22)
        print(f"  a wave against itself, a quarter of its period off; {said}")
    write_image(np.asarray(sheet, np.float32) / 255, args.output / f"{own}.png")
    print(f"wrote {args.output / f'{own}.png'}")


FIGURES: dict[str, Callable[[str, argparse.Namespace], Result | None]] = {
    **{f"{name}_by_the_papers": by_the_papers(name) for name in PATTERNS},
    **{f"{name}_out_of_phase": by_the_papers(name, spacing=OUT_OF_PHASE, oversample=1) for name in PATTERNS},
    **{
        f"{name}_between": by_the_papers(
            name,
            spacing=OUT_OF_PHASE,
            oversample=1,
            interpolate=True,
            metric="displacement",
            selection=Selection(),
            window=4,
            error=None,
        )
        for name in PATTERNS
    },
    "frames": frames,
    "pairing": pairing,
    "full_tower": noisy_tower(0.004),
    "noisy_tower": noisy_tower(0.06),
    "aliasing": sampled_at(4.0),
    "no_aliasing": sampled_at(1.0),
    "plane_noise": plane_noise,
    "bark_relief": bark_relief,
    "bark_extended": bark_extended,
}


def run(args: argparse.Namespace, *, names: tuple[str, ...] = tuple(FIGURES)) -> list[Result]:
    """Run the scenes of these names."""
    made = [FIGURES[name](name, args) for name in names]
    return [result for result in made if result is not None]


if __name__ == "__main__":
    main(run, __doc__, FIGURES)
