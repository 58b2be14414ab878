"""Real photographs of a stone head and a model temple: a texture from all but one, compared with the one left out."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from intaglio.files import picture_row, table, write_image, write_page
from intaglio.mesh import read_surface
from intaglio.parameterization import parameterize
from intaglio.photographs import (
    Binding,
    ViewComparison,
    bind_photographs,
    border_step,
    combine_photographs,
    compare_with_photograph,
    exposure_gains,
    read_photographs,
)
from intaglio.progress import ProgressBar
from intaglio.scenes.common import data_folder, main, real_data, side_by_side
from intaglio.scenes.photographs import vertex_color_texture

Array = np.ndarray

# Folder, mesh, cameras, the views that are left out one at a time, and by how much less resolution is compared.
SETS = {
    "buddha": ("multiview/buddha", "mesh_100k.ply", "cameras.json", ("00007", "00052", "00049", "00055"), 2),
    "temple": (
        "multiview/middlebury_templeSparseRing",
        "visual_hull_100k.ply",
        "templeSR_par.txt",
        ("templeSR0002.png", "templeSR0007.png", "templeSR0011.png"),
        1,
    ),
}
TEXELS = 1024

# Ours, the paper's weighting with the same blending, and what is compared with.
METHODS = {
    "best view, spline": {"select": "best"},
    "average, spline": {"select": "average"},
    "plain average": {"select": "average", "blend": "none", "exposure": False},
}
VERTEX_COLORS = "colours at vertices"


def without(binding: Binding, number: int) -> Binding:
    """Return a binding without one photograph."""
    keep = np.arange(len(binding.names)) != number
    parts = {name: getattr(binding, name)[keep] for name in ("valid", "cosine", "pixel", "color")}
    return replace(binding, **parts, names=tuple(n for n, k in zip(binding.names, keep, strict=True) if k))


def run(
    args: argparse.Namespace, *, texels: int = TEXELS, names: tuple[str, ...] = tuple(SETS), most: int = 4
) -> dict[tuple[str, str, str], ViewComparison]:
    """Run the scene on the sets that are there; return the comparison of each set, view and method."""
    if not any((data_folder() / SETS[n][0]).exists() for n in names):
        real_data(SETS[names[0]][0])
    figures: dict[tuple[str, str, str], ViewComparison] = {}
    body, strips = [], []
    for name in names:
        folder = data_folder() / SETS[name][0]
        if not folder.exists():
            print(f"skipped: {folder} is not there")
            continue
        _, mesh_file, camera_file, left_out, reduce = SETS[name]
        mesh, photographs = read_surface(folder / mesh_file), read_photographs(folder / camera_file)
        with ProgressBar(f"{name}: laying flat") as bar:
            laid = parameterize(mesh, device=args.device, progress=bar.update)
        print(f"{name}: {laid.charts} charts, L2 stretch {laid.l2_stretch:.3f}; {'; '.join(laid.notes)}")
        binding = bind_photographs(mesh, photographs, device=args.device)
        for view in left_out[:most]:
            number = binding.names.index(view)
            rest = [p for p in photographs if p.name != view]
            partly = without(binding, number)
            pictures = {}
            for method, settings in METHODS.items():
                made = combine_photographs(mesh, laid, rest, texels, binding=partly, device=args.device, **settings)  # type: ignore[arg-type]
                found = compare_with_photograph(mesh, laid, made.image, made.known, photographs[number], reduce=reduce)
                figures[name, view, method] = found
                pictures[method] = found.rendered * found.shown[:, :, None]
                if method == next(iter(METHODS)):
                    print(f"  without {view}: step at borders {border_step(made):.3f}")
                    known = made.known
                    pictures = {"the photograph": found.photograph * found.shown[:, :, None], **pictures}
            plain = vertex_color_texture(mesh, laid, partly, exposure_gains(partly), texels)
            found = compare_with_photograph(mesh, laid, plain, known, photographs[number], reduce=reduce)
            figures[name, view, VERTEX_COLORS] = found
            pictures[VERTEX_COLORS] = found.rendered * found.shown[:, :, None]
            for method in (*METHODS, VERTEX_COLORS):
                print(f"    {_line(method, figures[name, view, method])}")
            body.append(picture_row(f"{name}, {view} left out", pictures))
            strips.append(side_by_side([_cropped(p, found.shown) for p in pictures.values()]))
    rows = [
        (name, view, method, f"{c.psnr:.2f}", f"{c.comparison.ssim:.4f}", f"{c.comparison.flip:.4f}")
        for (name, view, method), c in figures.items()
    ]
    page, sheet = Path(args.output) / "photographed_objects.html", Path(args.output) / "photographed_objects.png"
    heading = ("set", "view left out", "texture", "PSNR in dB", "SSIM", "FLIP")
    write_page(page, "Photographed objects, one view left out", [table("Figures", heading, rows), *body])
    width = max(s.shape[1] for s in strips)
    write_image(
        np.concatenate([np.pad(s, ((0, 0), (0, width - s.shape[1]), (0, 0)), constant_values=1.0) for s in strips]), sheet
    )
    print(f"wrote {page} and {sheet}")
    return figures


def _line(method: str, found: ViewComparison) -> str:
    c = found.comparison
    return f"{method}: PSNR {found.psnr:.2f} dB, SSIM {c.ssim:.4f}, FLIP {c.flip:.4f}"


def _cropped(image: Array, shown: Array) -> Array:
    """Return the part of a picture that shows anything, no taller than 400 pixels."""
    rows, columns = np.nonzero(shown)
    part = image[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    step = -(-part.shape[0] // 400)
    return part[::step, ::step]


if __name__ == "__main__":
    main(run, __doc__, SETS)
