"""Restoration of text, scratches and blobs over texture, and over texture with a gradient, with known truth, against others."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from intaglio.files import picture_row, read_image, table, write_image, write_page
from intaglio.kernels.transfer import decode_srgb, encode_srgb
from intaglio.restoration import RestorationReport, assess_restoration, restore
from intaglio.scenes.common import data_folder, main, real_data, side_by_side

Array = np.ndarray

SOURCES = {
    "bark": "materials/ambientcg_Bark014/albedo.jpg",
    "wool": "materials/godot_wool/wool_albedo.png",
    "rock": "materials/ambientcg_Rock053/albedo.jpg",
    "plaster": "textures/photex/aar.png",
}
SIZE = (450, 600)
OURS = ("auto", "synthesize", "inpaint", "split")


def damage(shape: tuple[int, int] = SIZE, seed: int = 1) -> Array:
    """Return a mask (H, W) bool of text, scratches and blobs, about 5 % of the picture, as in the paper's figures."""
    from PIL import Image, ImageDraw, ImageFont

    random = np.random.default_rng(seed)
    height, width = shape
    picture = Image.new("L", (width, height))
    draw = ImageDraw.Draw(picture)
    draw.text((width // 15, height // 7), "Textures revisited", 255, font=ImageFont.load_default(size=height // 10))
    for _ in range(10):
        x, y, angle, length = (
            random.uniform(0, width),
            random.uniform(0, height),
            random.uniform(0, 6.28),
            random.uniform(60, 200),
        )
        draw.line((x, y, x + length * np.cos(angle), y + length * np.sin(angle)), fill=255, width=4)
    for x, y, radius in ((0.25, 0.67, 34), (0.7, 0.49, 26), (0.83, 0.84, 30)):
        x, y = x * width, y * height
        draw.ellipse((x - radius, y - 0.7 * radius, x + radius, y + 0.7 * radius), fill=255)
    return np.asarray(picture) > 127


def pictures(size: tuple[int, int] = SIZE) -> dict[str, Array]:
    """Return display pictures (H, W, 3): one without texture, real textures, and each with a gradient of light across it."""
    found = {}
    height, width = size
    y, x = np.mgrid[:height, :width] / height
    shading = 0.5 + 0.3 * np.sin(3 * x + 1) * np.cos(2 * y) + 0.1 * x
    found["shading alone"] = np.stack([shading, 0.9 * shading, 0.7 * shading], axis=2).astype(np.float32)
    slope = np.linspace(0.55, 1.45, width)[None, :, None]
    for name, file in SOURCES.items():
        if not (data_folder() / file).exists():
            continue
        image = encode_srgb(read_image(data_folder() / file))
        image = np.repeat(image[:, :, None], 3, axis=2) if image.ndim == 2 else image[:, :, :3]
        while image.shape[0] < height or image.shape[1] < width:
            image = np.concatenate([image, image[:, ::-1]], axis=1)
            image = np.concatenate([image, image[::-1]], axis=0)
        found[name] = np.ascontiguousarray(image[:height, :width])
        found[f"{name}, gradient"] = np.clip(found[name] * slope, 0, 1).astype(np.float32)
    return found


def others(image: Array, missing: Array) -> dict[str, Array]:
    """Return what scikit-image's, and OpenCV's where it is installed, make of an image with missing pixels."""
    from skimage.restoration import inpaint_biharmonic

    found = {"scikit-image, biharmonic": np.clip(inpaint_biharmonic(image, missing, channel_axis=2), 0, 1).astype(np.float32)}
    try:
        import cv2
    except ImportError:
        return found
    levels = np.round(image * 255).astype(np.uint8)
    for name, flag in (("OpenCV, Telea", cv2.INPAINT_TELEA), ("OpenCV, Navier-Stokes", cv2.INPAINT_NS)):
        found[name] = cv2.inpaint(levels, missing.astype(np.uint8), 5, flag).astype(np.float32) / 255
    return found


def run(args: argparse.Namespace, *, size: tuple[int, int] = SIZE) -> dict[tuple[str, str], RestorationReport]:
    """Run the scene; return the figures of each picture and method."""
    missing = damage(size)
    found = pictures(size)
    if len(found) == 1:
        real_data(next(iter(SOURCES.values())))
    restore(next(iter(found.values())), missing, device=args.device)  # compiles kernels, so that times are of the work
    figures: dict[tuple[str, str], RestorationReport] = {}
    rows, body, strips = [], [], []
    for name, truth in found.items():
        damaged = np.where(missing[:, :, None], np.array([0.85, 0.1, 0.1]), truth).astype(np.float32)
        shown = {"damaged": damaged}
        for method in OURS:
            start = time.perf_counter()
            result = restore(damaged, missing, method, device=args.device)
            seconds = time.perf_counter() - start
            shown[method] = result.image
            figures[name, method] = assess_restoration(result.image, missing, truth)
            rows.append(_row(name, f"{method}, κ {result.kappa}", figures[name, method], seconds))
        start = time.perf_counter()
        for method, image in others(damaged, missing).items():
            shown[method] = image
            figures[name, method] = assess_restoration(image, missing, truth)
            rows.append(_row(name, method, figures[name, method], float("nan")))
        body.append(picture_row(name, {n: decode_srgb(p) for n, p in {**shown, "truth": truth}.items()}))
        strips.append(side_by_side([decode_srgb(p) for p in (damaged, *(shown[m] for m in OURS), truth)]))
    for row in rows:
        print("  " + "  ".join(row))
    heading = ("picture", "method", "detail energy (truth's)", "seam (truth's)", "PSNR in dB", "seconds")
    page, sheet = Path(args.output) / "restoration.html", Path(args.output) / "restoration.png"
    write_page(page, "Restoration", [table("Figures", heading, rows), *body])
    write_image(np.concatenate(strips), sheet)
    print(f"wrote {page} and {sheet}")
    return figures


def _row(name: str, method: str, r: RestorationReport, seconds: float) -> tuple[str, ...]:
    return (
        name,
        method,
        f"{r.energy:.3f} ({r.truth_energy:.3f})",
        f"{r.seam:.3f} ({r.truth_seam:.3f})",
        f"{r.psnr:.2f}",
        "" if np.isnan(seconds) else f"{seconds:.2f}",
    )


if __name__ == "__main__":
    main(run, __doc__)
