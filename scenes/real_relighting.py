"""Real photometric stacks: every kind's errors, and photographs beside what a fit to the others predicts."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from intaglio.files import listing, picture_row, table, write_image, write_page
from intaglio.photometric import KINDS, PhotometricStack, Reports, assess_kinds, read_stack, represent, tilt_and_slant
from intaglio.scenes.common import data_folder, main, real_data

Array = np.ndarray

# What is linear as stored; the ball's 16 bits are by default. One photograph of the clay relief is too dark: figures are of all.
STACKS: dict[str, tuple[str, dict[str, Any]]] = {
    "fresco": ("photometric/realrti_item2", {"response": "linear"}),
    "gilded icon": ("photometric/realrti_item3", {"response": "linear"}),
    "clay relief": ("photometric/realrti_item8", {"response": "linear", "keep": "image31.jpg"}),
    "lion's head": ("photometric/lionhead_rti_tiny", {"response": "linear"}),
    "ball": ("photometric/diligent_ball", {}),
    "cat": ("photometric/harvard_cat", {"response": "linear"}),
}
SHOWN = ("gradient", "ptm", "hsh", "eigen6", "rbf")


def predicted(stack: PhotometricStack, k: int, device: str | None) -> dict[str, Array]:
    """Return image ``k`` and what fits to all other images make of its light."""
    others = stack.subset(np.delete(np.arange(stack.shape[0]), k))
    textures = {kind: represent(others, kind, device=device) for kind in SHOWN}
    return {"photograph": stack.image(k)} | {kind: t.relight(stack.lights[k]) for kind, t in textures.items()}


def run(args: argparse.Namespace, names: tuple[str, ...] = tuple(STACKS)) -> dict[str, Reports]:
    """Run the scene on the stacks that are there."""
    if not any((data_folder() / STACKS[n][0]).exists() for n in names):
        real_data(STACKS[names[0]][0])
    figures: dict[str, Reports] = {}
    rows, body, sheet, notes = [], [], [], []
    for name in names:
        folder, reading = STACKS[name]
        path = data_folder() / folder
        if not path.exists():
            notes.append(f"{name}: {path} is not there")
            continue
        stack = read_stack(path, **reading)
        kinds = tuple(k for k in KINDS if k != "height") if stack.shape[0] > 100 else KINDS
        figures[name] = assess_kinds(stack.gray(), kinds, device=args.device)
        cells = [
            " / ".join("–" if r is None else f"{r.normalized_rms:.3f}" for r in figures[name][k]) if k in figures[name] else "–"
            for k in KINDS
        ]
        rows.append([f"{name}, {stack.shape[0]} lights", *cells])
        print("  " + " | ".join(rows[-1]))
        # A light of middle slant, from the upper left if there is one.
        _, slant = tilt_and_slant(stack.lights)
        k = int(np.argmin(np.abs(slant - 50) + 20 * (stack.lights[:, 0] > 0) + 20 * (stack.lights[:, 1] < 0)))
        pictures = predicted(stack, k, args.device)
        top = float(np.quantile(pictures["photograph"], 0.995)) or 1.0
        body.append(picture_row(f"{name}: image {k}, predicted from the others", {n: p / top for n, p in pictures.items()}))
        row = np.concatenate([p / top for p in pictures.values()], axis=1)
        sheet.append(np.repeat(row, 3, axis=2) if row.shape[2] == 1 else row)
        figures_of_best = min((r[1].normalized_rms, kind) for kind, r in figures[name].items() if r[1] is not None)
        notes.append(f"{name}: {figures_of_best[1]} predicts best, η {figures_of_best[0]:.3f}")
    page = args.output / "real_relighting.html"
    heading = "η of reconstruction / leaving one out, on the mean of the channels"
    write_page(page, "Real stacks relit", [table(heading, ["stack", *KINDS], rows), listing("Best", notes), *body])
    print("\n".join(f"  {note}" for note in notes))
    for name, row in zip(figures, sheet, strict=True):
        write_image(row, args.output / f"real_relighting_{name.replace(' ', '_').replace(chr(39), '')}.png")
    print(f"wrote {page} and a picture of each stack beside it")
    return figures


if __name__ == "__main__":
    main(run, __doc__, STACKS)
