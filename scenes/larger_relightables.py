"""Larger textures of photographs under known lights: the thesis' five approaches, two other ways, and the render of one."""

from __future__ import annotations

import argparse

import numpy as np

from intaglio.files import listing, picture_row, table, write_image, write_page
from intaglio.photometric import PhotometricStack, Relightable, bsdf_of, read_stack, represent
from intaglio.progress import ProgressBar
from intaglio.render import relit_plane
from intaglio.scenes.common import data_folder, main, side_by_side
from intaglio.scenes.rough_surfaces import thesis_surfaces
from intaglio.synthesis import (
    THESIS_LIGHTS,
    SynthesisReport,
    assess_synthesis,
    copy_texture,
    pixel_positions,
    synthesize,
    synthesize_each_light,
)

Array = np.ndarray

APPROACHES = ("3i", "gradient", "ptm", "eigen3", "eigen6", "height")

# Where a patch that is all of one material begins, and how large it is.
STACKS: dict[str, tuple[str, tuple[int, int], int]] = {
    "fresco": ("photometric/realrti_item2", (230, 120), 144),
    "clay relief": ("photometric/realrti_item8", (60, 40), 200),
    "lion's head": ("photometric/lionhead_rti_tiny", (0, 0), 43),
}
RESULT = 288


def cropped(texture: Relightable, rows: slice, columns: slice) -> Relightable:
    """Return a patch of a texture."""
    patch = pixel_positions(texture.maps.shape[1:3])[rows, columns]
    return copy_texture(texture, patch, None if texture.mask is None else texture.mask[rows, columns])


def stacks(args: argparse.Namespace, size: int) -> dict[str, tuple[PhotometricStack, tuple[slice, slice]]]:
    """Return a rendered stack of a rough surface with shadows, and the real ones that are there, with a patch of each."""
    surface = thesis_surfaces(size, args.seed)[2]
    found = {surface.title: (surface.stack(samples=32, seed=args.seed), (slice(None), slice(None)))}
    for name, (file, (top, left), side) in STACKS.items():
        if (data_folder() / file).exists():
            stack = read_stack(data_folder() / file, "linear")
            found[name] = (stack, (slice(top, top + side), slice(left, left + side)))
    return found


def rendered_difference(texture: Relightable, light: Array) -> float:
    """Return the largest difference between the texture's render on a plane and its own relighting, over the largest value."""
    own = texture.relight(light)
    image = relit_plane(bsdf_of(texture, tiled=False, smooth=False), own.shape[:2], light)
    return float(np.abs(image - own).max() / own.max())


def run(args: argparse.Namespace, *, size: int = 128, result: int = RESULT) -> dict[str, dict[str, SynthesisReport]]:
    """Run the scene."""
    if not data_folder().exists():
        print(f"real stacks left out: {data_folder()} is not there; set INTAGLIO_DATA to a folder that holds them")
    figures: dict[str, dict[str, SynthesisReport]] = {}
    rows, body, sheets, notes = [], [], [], []
    cases = stacks(args, size)
    with ProgressBar("synthesising") as bar:
        for number, (name, (stack, patch)) in enumerate(cases.items()):
            figures[name] = {}
            sheet = []
            for kind in APPROACHES:
                sample = cropped(represent(stack, kind, device=args.device), *patch)
                made = synthesize(sample, result, seed=args.seed, device=args.device)
                assert made.texture is not None
                report = assess_synthesis(sample, made, lights=THESIS_LIGHTS)
                figures[name][kind] = report
                top = float(np.quantile(sample.relight(next(iter(THESIS_LIGHTS.values()))), 0.995))
                pictures = {f"sample, {n}": sample.relight(v) / top for n, v in THESIS_LIGHTS.items()}
                pictures |= {f"result, {n}": made.texture.relight(v) / top for n, v in THESIS_LIGHTS.items()}
                body.append(picture_row(f"{name}, {kind}: {len(sample.maps)} maps", pictures))
                if kind == "gradient":
                    sheet += list(pictures.values())
                    other = synthesize_each_light(
                        sample, result, np.stack(list(THESIS_LIGHTS.values())), seed=args.seed, device=args.device
                    )
                    body.append(
                        picture_row(
                            f"{name}, {kind}, relit first: another arrangement under every light",
                            {n: o.maps / top for n, o in zip(THESIS_LIGHTS, other, strict=True)},
                        )
                    )
                    away = rendered_difference(made.texture, THESIS_LIGHTS["tilt 60°, slant 60°"])
                    notes.append(f"{name}: render of the result on a plane within {away:.1g} of its relighting")
                relit = [report.relit[f"under {n}"] for n in THESIS_LIGHTS]
                rows.append(
                    [
                        name,
                        kind,
                        f"{report.seam:.2f}",
                        f"{100 * report.used:.0f} %",
                        f"{report.likeness.correlation:.3f}",
                        *(f"{r.histogram.max():.2f} / {r.spectrum:.1f} dB / {r.coherence:.3f}" for r in relit),
                    ]
                )
                print("  " + " | ".join(rows[-1]))
            sheets.append(side_by_side(sheet))
            bar.update(number + 1, len(cases))
    page, picture = args.output / "larger_relightables.html", args.output / "larger_relightables.png"
    head = [
        "sample",
        "kind",
        "seam",
        "sample used",
        "correlation",
        *(f"{n}: histogram / spectrum / coherence" for n in THESIS_LIGHTS),
    ]
    write_page(
        page, "Larger relightable textures", [table("Result against sample", head, rows), listing("Rendered", notes), *body]
    )
    width = max(s.shape[1] for s in sheets)
    write_image(
        np.concatenate([np.pad(s, ((0, 0), (0, width - s.shape[1]), (0, 0)), constant_values=1) for s in sheets]), picture
    )
    print("\n".join(f"  {note}" for note in notes))
    print(f"wrote {page} and {picture}")
    return figures


if __name__ == "__main__":
    main(run, __doc__)
