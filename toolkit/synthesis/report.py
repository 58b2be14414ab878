"""Pages and files about a synthesised texture: pictures, figures, provenance."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.files import listing, picture_row, write_exr, write_page
from intaglio.kernels.transfer import decode_srgb
from intaglio.photometric import Relightable, light_direction
from intaglio.synthesis.assess import SynthesisReport
from intaglio.synthesis.result import Synthesis, pixel_positions
from intaglio.synthesis.sample import stack_maps

# The lights under which the thesis compares synthesised textures: tilt 60 and 120 degrees, slant 60.
THESIS_LIGHTS: dict[str, Array] = {
    "tilt 60°, slant 60°": light_direction(60.0, 60.0),
    "tilt 120°, slant 60°": light_direction(120.0, 60.0),
}


def source_picture(source: Array, shape: tuple[int, int]) -> Array:
    """Return provenance as colours (H, W, 3): red runs with the sample's rows, green with its columns."""
    place = source / np.maximum(np.array(shape) - 1, 1)
    return decode_srgb(np.stack([place[..., 0], place[..., 1], np.full(source.shape[:2], 0.4)], axis=2))


def first_channels(maps: Array) -> Array:
    """Return maps (H, W, n) as pictures (H, W, 1 or 3): the first one, or three, of them."""
    return maps[..., :3] if maps.shape[2] >= 3 else maps[..., :1]


def synthesis_pictures(
    sample: Any, result: Synthesis, lights: Mapping[str, Array] = THESIS_LIGHTS
) -> dict[str, dict[str, Array]]:
    """Return rows of pictures of sample and result: as they are, or under each light where they can be relit."""
    if isinstance(sample, Relightable) and result.texture is not None:
        rows = {}
        for name, light in lights.items():
            pair = {"sample": sample.relight(light), "result": result.texture.relight(light)}
            top = float(np.quantile(pair["sample"], 0.995)) or 1.0
            rows[name] = {key: image / top for key, image in pair.items()}
        return rows
    values = stack_maps(sample).astype(np.float32)
    low, high = float(np.nanmin(first_channels(values))), float(np.nanmax(first_channels(values)))
    # Photographs are shown as they are, other maps scaled by their range.
    low, high = (0.0, 1.0) if low >= 0 and high <= 1 else (low, max(high, low + 1e-30))
    pair = {"sample": first_channels(values), "result": first_channels(result.maps)}
    return {"Sample and result": {key: (image - low) / (high - low) for key, image in pair.items()}}


def write_synthesis_report(
    path: PathLike,
    sample: Any,
    result: Synthesis,
    report: SynthesisReport,
    *,
    title: str,
    pictures: Mapping[str, Mapping[str, Array]] | None = None,
    extra: Sequence[str] = (),
) -> None:
    """Write a page of sample and result, what was copied from where, and the figures.

    Parameters
    ----------
    path : path
        .html
    sample : like the maps that were synthesised
    result : Synthesis
    report : SynthesisReport
        From `assess_synthesis`.
    title : str
    pictures : dict of rows, optional
        Shown in place of `synthesis_pictures` them.
    extra : sequence of str
        Further lines.
    """
    rows = pictures if pictures is not None else synthesis_pictures(sample, result)
    body = [_sized_row(heading, row) for heading, row in rows.items()]
    if result.tileable:
        last = list(next(iter(rows.values())).values())[-1]
        body.append(picture_row("Tiled two by two", {"no line should be seen": np.tile(last, (2, 2, 1))}))
    shape = stack_maps(sample).shape[:2]
    body.append(
        _sized_row(
            "Where each pixel was copied from",
            {
                "places of the sample": source_picture(pixel_positions(shape), shape),
                "result": source_picture(result.source, shape),
            },
        )
    )
    body.append(listing("Figures", report.lines()))
    body.append(listing("How", (*result.notes, *extra)))
    write_page(Path(path), title, body)


def _sized_row(heading: str, pictures: Mapping[str, Array]) -> str:
    """Return a row whose pictures keep their relative sizes."""
    row = picture_row(heading, pictures)
    for name, image in pictures.items():
        old = f'alt="{html.escape(heading)}, {html.escape(name)}"'
        row = row.replace(old, f'{old} style="width:{image.shape[1]}px;max-width:100%"')
    return row.replace("<div class=row>", '<div class=row style="align-items:flex-start">').replace(
        "<figure>", '<figure style="flex:0 1 auto">'
    )


def write_source(result: Synthesis, path: PathLike) -> None:
    """Write provenance as an EXR: channels ``source.row`` and ``source.column``, whole numbers, row 0 at the top.

    Where pieces were joined, ``moved.0``, ``moved.1``, … say what was added to each map's copies.
    """
    rows, columns = (result.source[..., i].astype(np.float32) for i in range(2))
    channels = {"source.row": rows, "source.column": columns}
    if result.moved is not None:
        channels |= {f"moved.{c}": np.ascontiguousarray(result.moved[..., c]) for c in range(result.moved.shape[2])}
    write_exr(channels, path)
