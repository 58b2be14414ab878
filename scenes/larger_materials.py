"""Larger materials: albedo, normal, height and roughness synthesised together, lit from two sides, and tiled."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from intaglio.files import listing, picture_row, read_image, write_image, write_page
from intaglio.kernels.transfer import decode_srgb, encode_srgb
from intaglio.photometric import LambertBasis, Relightable
from intaglio.progress import ProgressBar
from intaglio.scenes.common import data_folder, main, real_data, side_by_side
from intaglio.synthesis import THESIS_LIGHTS, Synthesis, SynthesisReport, assess_synthesis, weave

Array = np.ndarray

# Colour first, then the normal map; then what else the material has.
MATERIALS = {
    "bark": ("materials/ambientcg_Bark014", ("albedo.jpg", "normal.jpg", "displacement.jpg", "roughness.jpg")),
    "rock": ("materials/ambientcg_Rock053", ("albedo.jpg", "normal.jpg", "displacement.jpg", "roughness.jpg")),
    "wool": ("materials/godot_wool", ("wool_albedo.png", "wool_normal.png", "wool_depth.png")),
}
SAMPLE, RESULT, REDUCED = 256, 512, 3


def read_material(folder: Path, files: tuple[str, ...]) -> list[Array]:
    """Return maps (256, 256, C) of one patch, a third as fine as the files: linear albedo, normals and the rest as stored."""
    maps = []
    for number, file in enumerate(files):
        image = read_image(folder / file, linear=None if number == 0 else True)
        image = image[:, :, :3] if image.ndim == 3 else image[:, :, None]
        side = SAMPLE * REDUCED
        patch = image[:side, :side].reshape(SAMPLE, REDUCED, SAMPLE, REDUCED, -1).mean(axis=(1, 3))
        maps.append(patch.astype(np.float32) if number < 2 else patch[:, :, :1].astype(np.float32))
    return maps


def lit(albedo: Array, normal: Array) -> dict[str, Array]:
    """Return a matte material under the thesis' two lights."""
    towards = normal * 2 - 1
    towards /= np.maximum(np.linalg.norm(towards, axis=2, keepdims=True), 1e-6)
    maps = np.moveaxis(towards, 2, 0)[:, :, :, None] * albedo[None]
    texture = Relightable("gradient", maps.astype(np.float32), LambertBasis())
    return {name: 2 * texture.relight(light) for name, light in THESIS_LIGHTS.items()}


def run(args: argparse.Namespace, *, size: int = RESULT, names: tuple[str, ...] = tuple(MATERIALS)) -> dict[str, SynthesisReport]:
    """Run the scene on the materials that are there."""
    if not any((data_folder() / MATERIALS[n][0]).exists() for n in names):
        real_data(MATERIALS[names[0]][0])
    figures: dict[str, SynthesisReport] = {}
    body, sheets = [], []
    with ProgressBar("synthesising") as bar:
        for number, name in enumerate(names):
            folder = data_folder() / MATERIALS[name][0]
            if not folder.exists():
                continue
            maps = read_material(folder, MATERIALS[name][1])
            match = [encode_srgb(maps[0]), *maps[1:]]
            result = weave(match, size, tileable=True, seed=args.seed, device=args.device)
            figures[name] = assess_synthesis(match, result)
            print(f"{name}: {sum(m.shape[2] for m in maps)} maps at once, {', '.join(result.notes)}")
            print("\n".join(f"  {line}" for line in figures[name].lines()))
            body += _rows(name, maps, result)
            body.append(listing(f"{name}: figures", figures[name].lines()))
            before, after = lit(*maps[:2]), lit(*_split(result, maps)[:2])
            pairs = [image for light in before for image in (before[light], after[light])]
            sheets.append(side_by_side(pairs))
            bar.update(number + 1, len(names))
    page, sheet = args.output / "larger_materials.html", args.output / "larger_materials.png"
    write_page(page, "Larger materials", body)
    write_image(np.concatenate(sheets, axis=0), sheet)
    print(f"wrote {page} and {sheet}")
    return figures


def _split(result: Synthesis, maps: list[Array]) -> list[Array]:
    """Return the result's maps one by one, colours linear."""
    albedo, *rest = np.split(result.maps, np.cumsum([m.shape[2] for m in maps])[:-1], axis=2)
    return [decode_srgb(albedo), *rest]


def _rows(name: str, maps: list[Array], result: Synthesis) -> list[str]:
    parts = _split(result, maps)
    before, after = lit(*maps[:2]), lit(*parts[:2])
    rows = [picture_row(f"{name}, {light}", {"sample": before[light], "result": after[light]}) for light in before]
    tiled = np.tile(next(iter(after.values())), (2, 2, 1))
    rows.append(picture_row(f"{name}, tiled two by two", {"no line should be seen": tiled}))
    # Maps that are no colours are shown as they are stored.
    rows.append(picture_row(f"{name}, maps", {"albedo": parts[0], **{f"map {i}": p**2.2 for i, p in enumerate(parts[1:], 2)}}))
    return rows


if __name__ == "__main__":
    main(run, __doc__, MATERIALS)
