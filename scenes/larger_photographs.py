"""Larger textures of photographs: by blocks, by pixels, and by coherent pieces; with the limits of the method."""

from __future__ import annotations

import argparse
import time

import numpy as np
from skimage import data

from intaglio.files import listing, picture_row, read_image, table, write_image, write_page
from intaglio.kernels.transfer import encode_srgb
from intaglio.progress import ProgressBar
from intaglio.scenes.common import data_folder, main, side_by_side
from intaglio.synthesis import SynthesisReport, assess_synthesis, grow, quilt, weave

Array = np.ndarray

SAMPLE, RESULT = 128, 320

# Near-regular, stochastic, coloured; and large irregular elements, where the thesis fails as well.
FILES = {
    "aaj (thesis)": "textures/photex/aaj.png",
    "aar (thesis)": "textures/photex/aar.png",
    "acd (thesis)": "textures/photex/acd.png",
    "leaves": "textures/quilting_student/t9.jpg",
    "crackers": "textures/quilting_student/t21.png",
    "water": "textures/embark/1.jpg",
    "lentils (thesis' failure)": "textures/photex/add.png",
    "shelves (no texture)": "textures/quilting_student/t12.jpeg",
}


def samples() -> dict[str, Array]:
    """Return linear samples (128, 128, 1 or 3) by name: three that are always there, and those of the data folder."""
    pictures = {"brick": data.brick(), "grass": data.grass(), "gravel": data.gravel()}
    found = {name: (picture / 255.0).astype(np.float32)[:, :, None] ** 2.2 for name, picture in pictures.items()}
    for name, file in FILES.items():
        path = data_folder() / file
        if path.exists():
            image = read_image(path)
            found[name] = image[:, :, :3] if image.ndim == 3 else image[:, :, None]
    return {name: np.ascontiguousarray(image[:SAMPLE, :SAMPLE]) for name, image in found.items()}


def run(
    args: argparse.Namespace, *, size: int = RESULT, names: tuple[str, ...] | None = None
) -> dict[str, list[SynthesisReport]]:
    """Run the scene."""
    chosen = {n: s for n, s in samples().items() if names is None or n in names}
    figures: dict[str, list[SynthesisReport]] = {}
    rows, body, sheets = [], [], []
    with ProgressBar("synthesising") as bar:
        for number, (name, sample) in enumerate(chosen.items()):
            settings = {"match": encode_srgb(sample), "seed": args.seed, "device": args.device}
            start = time.perf_counter()
            blocks = quilt(sample, size, refine=0, **settings)
            middle = time.perf_counter()
            pixels = grow(sample, size, **settings)
            end = time.perf_counter()
            woven = weave(sample, size, **settings)
            seconds = (middle - start, end - middle, time.perf_counter() - end)
            reports = [assess_synthesis(sample, r) for r in (blocks, pixels, woven)]
            figures[name] = reports
            cells = [
                f"{r.seam:.2f} / {r.likeness.coherence:.3f} / {r.likeness.spectrum:.1f} dB / {s:.1f} s"
                for r, s in zip(reports, seconds, strict=True)
            ]
            rows.append([name, *cells, blocks.notes[0]])
            print("  " + " | ".join(rows[-1]))
            pictures = {"sample": sample, "by blocks": blocks.maps, "by pixels": pixels.maps, "by coherent pieces": woven.maps}
            body.append(picture_row(name, pictures))
            sheets.append(side_by_side(list(pictures.values())))
            bar.update(number + 1, len(chosen))
    page, sheet = args.output / "larger_photographs.html", args.output / "larger_photographs.png"
    heading = "Seams / coherence / spectrum / time"
    how = [
        "seams: jumps across seams over jumps inside, 1: none",
        "coherence: distance to the sample's windows, 0: all are copies",
    ]
    head = ["sample", "by blocks", "by pixels", "by coherent pieces", "block"]
    write_page(page, "Larger textures of photographs", [table(heading, head, rows), listing("How", how), *body])
    write_image(np.concatenate(sheets, axis=0), sheet)
    print(f"wrote {page} and {sheet}")
    return figures


if __name__ == "__main__":
    main(run, __doc__)
