"""The commands that measure results: one for each system, beside truth or sample."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

import intaglio
from intaglio.arrays import Array
from intaglio.cli.masks import read_mask
from intaglio.cli.options import FilePath, common, known_suffix
from intaglio.cli.photometric import assess_capture
from intaglio.devices import device_or_error
from intaglio.errors import FileError, InputError
from intaglio.files import check_readable, check_writable, read_samples
from intaglio.geometry import read_uv_mesh, write_geometry_report
from intaglio.kernels.transfer import decode_srgb
from intaglio.mesh import read_mesh_file, samples_of
from intaglio.parameterization import measure_parameterization
from intaglio.progress import ProgressBar


@click.group()
def assess() -> None:
    """Measure a result: completed relief, kinds of a capture, a larger texture, a restored image, geometry, a textured mesh."""


assess.add_command(assess_capture)


@assess.command("relief", epilog="Example: intaglio assess relief whole.ply --truth truth.ply -o whole.html")
@click.argument("completed", type=FilePath())
@click.option("--truth", type=FilePath(), default=None, help="Known surface.")
@click.option("-o", "--output", default=None, type=FilePath(), help="HTML report with pictures and figures.")
@common
def assess_relief(completed: Path, truth: Path | None, output: Path | None, seed: int, device: str | None) -> None:
    """Measure the filled relief of COMPLETED, a PLY that `complete` wrote, against the measured, and against the truth."""
    _check_files([completed, truth], output)
    surface = intaglio.read_surface(completed)
    known = None if truth is None else intaglio.read_surface(truth)
    report = intaglio.assess_relief(surface, known, device=device)
    _say(report.lines())
    if output is not None:
        intaglio.write_relief_report(
            surface, output, report=report, truth=known, title=f"{completed.name} assessed", device=device
        )
        click.echo(f"wrote {output}")


@assess.command("synthesis", epilog="Example: intaglio assess synthesis sample.png big.png")
@click.argument("sample", type=FilePath())
@click.argument("result", type=FilePath())
@click.option(
    "--source",
    type=FilePath(),
    default=None,
    help="Where pixels came from, as `synthesize` wrote it; default: beside RESULT.",
)
@click.option("--tileable", is_flag=True, help="RESULT wraps around: measure that seam as well.")
@common
def assess_synthesis(sample: Path, result: Path, source: Path | None, tileable: bool, seed: int, device: str | None) -> None:
    """Measure RESULT, a larger texture, against SAMPLE: likeness, seams, size of copied pieces, repetition."""
    where = result.with_name(f"{result.stem}.source.exr") if source is None else source
    _check_files([sample, result, where], None)
    channels, _ = intaglio.read_exr(where)
    if not {"source.row", "source.column"} <= channels.keys():
        raise FileError(f"{where}: has no channels source.row and source.column; give the file that synthesize wrote")
    place = np.stack([channels["source.row"], channels["source.column"]], axis=2).astype(np.int32)
    made = _read_stored(result)
    if made.shape[:2] != place.shape[:2]:
        raise InputError(
            f"{result}: has {made.shape[1]} x {made.shape[0]} pixels, {where} is for {place.shape[1]} x {place.shape[0]}"
        )
    given = _read_stored(sample)
    found = intaglio.Synthesis(made, place, tileable=tileable)
    copied = found.copy_of(given).reshape(found.maps.shape[:2] + (-1,))
    if copied.shape == found.maps.shape:
        found = replace(found, moved=(found.maps.astype(np.float64) - copied).astype(np.float32))
    _say(intaglio.assess_synthesis(given, found).lines())


@assess.command("restoration", epilog="Example: intaglio assess restoration restored.png scratches.png --truth whole.png")
@click.argument("restored", type=FilePath())
@click.argument("missing", type=FilePath())
@click.option("--truth", type=FilePath(), default=None, help="The undamaged image.")
@common
def assess_restoration(restored: Path, missing: Path, truth: Path | None, seed: int, device: str | None) -> None:
    """Measure RESTORED, whose pixels that are bright in MISSING were filled: detail, seam, and error where truth is known."""
    _check_files([restored, missing, truth], None)
    image = _read_stored(restored)
    mask = read_mask(missing, image.shape[:2], restored)
    known = None if truth is None else _read_stored(truth)
    _say(intaglio.assess_restoration(image, mask, known).lines())


@assess.command("geometry", epilog="Example: intaglio assess geometry larger.ply weave.ply -o larger.html")
@click.argument("result", type=FilePath())
@click.argument("swatch", type=FilePath())
@click.option("-o", "--output", default=None, type=FilePath(), help="HTML report with pictures and figures.")
@common
def assess_geometry(result: Path, swatch: Path, output: Path | None, seed: int, device: str | None) -> None:
    """Measure RESULT, a PLY of points that `extend` wrote, against SWATCH: spacing, holes, normals."""
    _check_files([result, swatch], output)
    texture = intaglio.read_geometry_texture(swatch)
    made = intaglio.read_geometry_texture(result, axis=texture.axis).points
    report = intaglio.assess_geometry(made, texture, device=device)
    _say(report.lines())
    if output is not None:
        write_geometry_report(output, made, texture, report, title=f"{result.name} assessed", device=device)
        click.echo(f"wrote {output}")


@assess.command("texture", epilog="Example: intaglio assess texture textured.glb cameras.json")
@click.argument("mesh", type=FilePath())
@click.argument("cameras", type=FilePath())
@click.option("--images", type=FilePath(), default=None, help="Folder of the photographs.")
@click.option("--reduce", type=click.IntRange(1, 64), default=1, show_default=True, help="Compare at less resolution.")
@common
def assess_texture(mesh: Path, cameras: Path, images: Path | None, reduce: int, seed: int, device: str | None) -> None:
    """Hold MESH, a textured mesh, against photographs: best those of CAMERAS that the texture was not made from."""
    _check_files([mesh, cameras], None)
    device_or_error(device)
    vertices, faces, positions = read_uv_mesh(mesh)
    pictures = read_mesh_file(mesh).pictures
    if len(pictures) != 1:
        raise InputError(f"{mesh}: has {len(pictures) or 'no'} pictures; give a mesh that texture wrote")
    image = decode_srgb(samples_of(pictures[0])[:, :, :3].astype(np.float32) / 255)
    surface = intaglio.Surface(vertices=vertices, faces=faces)
    uv = measure_parameterization(surface, positions, faces, np.arange(len(vertices)), ())
    photographs = intaglio.read_photographs(cameras, images=images)
    known = np.ones(image.shape[:2], bool)
    coverage = mesh.with_name(f"{mesh.stem}.coverage.png")
    if coverage.exists():
        # Levels of 2 and more are photographs; what was made up is not held against any.
        known = read_samples(coverage) >= 2
        if known.shape != image.shape[:2]:
            raise InputError(f"{coverage}: is of another size than the picture of {mesh}; write the textured mesh again")
    found = []
    with ProgressBar("comparing views") as bar:
        for done, photograph in enumerate(photographs):
            found.append(intaglio.compare_with_photograph(surface, uv, image, known, photograph, reduce=reduce, seed=seed))
            bar.update(done + 1, len(photographs))
    _say(f"{f.name}: PSNR {f.psnr:.2f} dB, SSIM {f.comparison.ssim:.4f}, FLIP {f.comparison.flip:.4f}" for f in found)
    click.echo(f"  mean PSNR {np.mean([f.psnr for f in found]):.2f} dB over {len(found)} photographs")


def _check_files(inputs: list[Path | None], output: Path | None) -> None:
    """Raise an error for inputs that can't be read and an output that can't be written."""
    given = tuple(path for path in inputs if path is not None)
    for path in given:
        check_readable(path)
    if output is not None:
        known_suffix(output, (".html", ".htm"), "report")
        check_writable(output, inputs=given)


def _say(lines: Iterable[str]) -> None:
    for line in lines:
        click.echo(f"  {line}")


def _read_stored(path: Path) -> Array:
    """Return an image's values as they are stored, (H, W, C) float32, integers brought to [0, 1], alpha left out."""
    samples = read_samples(path)
    values = samples.astype(np.float32)
    if samples.dtype.kind in "iu":
        values /= np.float32(np.iinfo(samples.dtype).max)
    return values[:, :, None] if values.ndim == 2 else values[:, :, :3]
