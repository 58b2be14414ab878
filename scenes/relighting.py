"""Rendered stacks relit at lights that no fit has seen, against the render: four surfaces, every kind."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from intaglio.files import listing, picture_row, table, write_image, write_page
from intaglio.photometric import KINDS, Relightable, represent, surface_maps
from intaglio.progress import ProgressBar
from intaglio.scenes.common import main
from intaglio.scenes.rough_surfaces import HELD_OUT, RoughSurface, thesis_surfaces

Array = np.ndarray

SHOWN = 1


@dataclass(frozen=True)
class Case:
    """Figures of one surface.

    Attributes
    ----------
    surface : RoughSurface
    eta : dict of str to float
        Mean over the held-out lights of rms(relit − render) / std(render), per kind.
    noise : float
        The same between two renders of different seed.
    normals : float
        Median angle between the gradient kind's normals and the true ones, in degrees.
    truth : (L, H, W, 3) array
    relit : dict of str to array
    """

    surface: RoughSurface
    eta: dict[str, float]
    noise: float
    normals: float
    truth: Array
    relit: dict[str, Array]


def eta(relit: Array, truth: Array) -> float:
    """Return the normalised rms error η over images (L, H, W, C)."""
    return float(np.mean([np.sqrt(np.mean((a - b) ** 2)) / b.std() for a, b in zip(relit, truth, strict=True)]))


def fitted(surface: RoughSurface, *, samples: int, seed: int, device: str | None) -> dict[str, Relightable]:
    """Return every kind fitted to 36 images; the eigen kinds also by triangles instead of the thesis's bilinear grid."""
    stack = surface.stack(samples=samples, seed=seed)
    textures = {kind: represent(stack, kind, device=device) for kind in KINDS}
    for kind in ("eigen3", "eigen6"):
        textures[f"{kind}, triangles"] = represent(stack, kind, interpolation="triangles", device=device)
    return textures


def measure(surface: RoughSurface, *, samples: int = 64, seed: int = 1, device: str | None = None) -> Case:
    """Fit, relight at the held-out lights, and compare with the render."""
    truth = surface.photograph(HELD_OUT, samples=4 * samples, seed=seed + 1)
    again = surface.photograph(HELD_OUT, samples=samples, seed=seed + 2)
    textures = fitted(surface, samples=samples, seed=seed, device=device)
    relit = {name: texture.relight(HELD_OUT) for name, texture in textures.items()}
    normal = surface_maps(textures["gradient"]).normal
    angle = np.degrees(np.arccos(np.clip((normal * surface.normal).sum(axis=2), -1, 1)))
    return Case(surface, {n: eta(r, truth) for n, r in relit.items()}, eta(again, truth), float(np.median(angle)), truth, relit)


def run(args: argparse.Namespace, *, size: int = 160, samples: int = 64) -> list[Case]:
    """Run the scene."""
    surfaces = thesis_surfaces(size, args.seed)
    cases = []
    with ProgressBar("rendering and fitting") as bar:
        for number, surface in enumerate(surfaces):
            cases.append(measure(surface, samples=samples, seed=args.seed, device=args.device))
            bar.update(number + 1, len(surfaces))
    names = ["surface", "render's noise", *cases[0].eta, "normals, median degrees"]
    rows = [[c.surface.title, f"{c.noise:.3f}", *(f"{v:.3f}" for v in c.eta.values()), f"{c.normals:.2f}"] for c in cases]
    for row in [names, *rows]:
        print("  " + " | ".join(row))
    body = [table("η at lights that were not fitted", names, rows)]
    sheet = []
    for case in cases:
        top = float(np.quantile(case.truth[SHOWN], 0.995))
        shown = {"render": case.truth[SHOWN]} | {kind: case.relit[kind][SHOWN] for kind in KINDS}
        body.append(picture_row(case.surface.title, {name: image / top for name, image in shown.items()}))
        away = {k: 4 * np.abs(case.relit[k][SHOWN] - case.truth[SHOWN]) / top for k in KINDS}
        body.append(picture_row("Difference from the render, times 4", away))
        sheet.append(np.concatenate([image / top for image in shown.values()], axis=1))
        sheet.append(np.concatenate([np.zeros_like(case.truth[SHOWN]), *away.values()], axis=1))
    body.append(
        listing("How", [f"36 lights fitted, {len(HELD_OUT)} others relit; {samples} paths a pixel, {size} x {size} pixels"])
    )
    page, picture = args.output / "relighting.html", args.output / "relighting.png"
    write_page(page, "Relighting rendered surfaces", body)
    write_image(np.concatenate(sheet, axis=0), picture)
    print(f"wrote {page} and {picture}")
    return cases


if __name__ == "__main__":
    main(run, __doc__)
