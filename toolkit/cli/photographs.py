"""The commands of texturing and restoration: texture and restore."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from intaglio.arrays import Array
from intaglio.cli.masks import read_mask
from intaglio.cli.options import FilePath, Numbers, common, grouped, known_suffix, render_on, was_given
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.files import READABLE_SUFFIXES, check_readable, check_writable, read_samples, write_samples
from intaglio.mesh import read_surface
from intaglio.parameterization import BOUNDARIES, ENERGIES, parameterize
from intaglio.photographs import (
    BACKGROUND_THRESHOLD,
    GRAZING,
    TEXTURED_SUFFIXES,
    Photograph,
    bind_photographs,
    border_step,
    combine_photographs,
    compare_with_photograph,
    files_of,
    read_photographs,
    restore_texture,
    write_texture_report,
    write_textured,
)
from intaglio.progress import ProgressBar
from intaglio.restoration import METHODS, write_restoration_report
from intaglio.restoration import restore as restore_image

# Of linear samples, to work on them as they look.
_GAMMA = 2.4

# Image types that restored images are written as.
_WRITTEN = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr")


@dataclass(frozen=True)
class _Layout:
    """How the surface is laid flat; see `intaglio.parameterize`."""

    energy: str
    boundary: str
    view: tuple[float, ...] | None
    importance: float
    shape_threshold: float
    max_stretch: float | None


class _Background(click.ParamType):
    """auto, none, or comma-separated numbers."""

    name = "background"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | tuple[float, ...] | None:
        """Return the word, None, or the colour."""
        if value in ("auto", "none"):
            return "auto" if value == "auto" else None
        color: tuple[float, ...] = Numbers(3).convert(value, param, ctx)
        return color


@click.command(epilog="Example: intaglio texture scan.ply cameras.json -o textured.glb --size 4096 --report textured.html")
@click.argument("mesh", type=FilePath())
@click.argument("cameras", type=FilePath())
@click.option("-o", "--output", required=True, type=FilePath(), help="Textured mesh: .glb, .gltf or .obj.")
@click.option("--images", type=FilePath(), default=None, help="Folder of the photographs.")
@click.option("--size", type=click.IntRange(16, 16384), default=2048, show_default=True, help="Texels a side.")
@grouped(
    "layout",
    _Layout,
    click.option(
        "--energy", type=click.Choice(ENERGIES), default="stretch", show_default=True, help="What the layout minimises."
    ),
    click.option("--boundary", type=click.Choice(BOUNDARIES), default="free", show_default=True, help="Border of the layout."),
    click.option("--view", type=Numbers(3), default=None, help="x,y,z from the object to the eye: gets more of the texture."),
    click.option("--importance", type=float, default=1.5, show_default=True, help="With --view: nearer to 1 is stronger."),
    click.option("--shape-threshold", type=float, default=0.0, show_default=True, help="Least height over side of triangles."),
    click.option("--max-stretch", type=float, default=None, help="Cut seams until the L2 stretch is below, say 1.15."),
)
@grouped(
    "mixing",
    dict,
    click.option("--select", type=click.Choice(["best", "average"]), default="best", show_default=True, help="Per face."),
    click.option("--blend", type=click.Choice(["spline", "none"]), default="spline", show_default=True, help="At borders."),
    click.option("--exposure/--no-exposure", default=True, help="Factor out differences of exposure and white balance."),
)
@grouped(
    "seeing",
    dict,
    click.option(
        "--background",
        type=_Background(),
        default="auto",
        show_default=True,
        help="auto, none, or r,g,b (linear) behind the object.",
    ),
    click.option(
        "--background-threshold",
        type=float,
        default=BACKGROUND_THRESHOLD,
        show_default=True,
        help="Distance of display values within which a vertex is on the background.",
    ),
    click.option("--grazing", type=float, default=GRAZING, show_default=True, help="Degrees from the normal; no use beyond."),
)
@click.option("--restore", type=click.Choice([*METHODS, "none"]), default="auto", show_default=True, help="What was not seen.")
@click.option("--leave-out", multiple=True, help="Name of a photograph to compare with instead of using; may be repeated.")
@click.option("--strict", is_flag=True, help="Refuse a mesh that must be mended, and photographs that are missing or scaled.")
@click.option("--report", type=FilePath(), default=None, help="HTML report with pictures and figures.")
@common
def texture(
    mesh: Path,
    cameras: Path,
    output: Path,
    images: Path | None,
    size: int,
    layout: _Layout,
    mixing: dict[str, Any],
    seeing: dict[str, Any],
    restore: str,
    leave_out: tuple[str, ...],
    strict: bool,
    report: Path | None,
    seed: int,
    device: str | None,
) -> None:
    """Make one texture for MESH from the photographs that CAMERAS registers with it.

    CAMERAS is the folder of a project, or a file: COLMAP's cameras.bin or .txt, transforms.json, Meshroom's .sfm, OpenMVG's
    sfm_data.json, Metashape's .xml, RealityCapture's .csv, Bundler's .out, VisualSFM's .nvm, Middlebury's _par.txt, or JSON with
    K, R, and t or C of each view. Lenses are undone on the way. What no photograph saw is restored; NAME.coverage.png tells
    which texels are made up.
    """
    check_readable(mesh)
    check_writable(output, inputs=(mesh, cameras))
    known_suffix(output, TEXTURED_SUFFIXES, "textured mesh")
    if report is not None:
        check_writable(report, inputs=(mesh, cameras, output))
        known_suffix(report, (".html", ".htm"), "report")
        render_on(device)
    if was_given("importance") and layout.view is None:
        raise InputError("--importance says how much a view counts; give the view with --view")
    chosen = device_or_error(device)
    surface = read_surface(mesh, strict=strict)
    photographs = read_photographs(cameras, images=images, strict=strict)
    for path in files_of(output):
        check_writable(path, inputs=(mesh, cameras, *_pictures(photographs)))
    unknown = sorted(set(leave_out) - {p.name for p in photographs})
    if unknown:
        some = ", ".join(p.name for p in photographs[:5])
        more = f" and {len(photographs) - 5} more" if len(photographs) > 5 else ""
        raise InputError(f"--leave-out {unknown[0]}: {cameras} has no such view; it has {some}{more}")
    for photograph in photographs:
        # A photograph that does not fit its calibration is better known before the work than after it.
        photograph.read()
    used = [p for p in photographs if p.name not in leave_out]
    if not used:
        raise InputError("--leave-out leaves no photograph to make a texture from")
    start = time.perf_counter()
    try:
        with ProgressBar("laying the surface flat") as bar:
            uv = parameterize(surface, **vars(layout), device=chosen, progress=bar.update)
    except InputError as problem:
        raise InputError(f"{mesh}: {problem}") from problem
    for note in uv.notes:
        click.echo(f"  {note}", err=True)
    seconds = time.perf_counter() - start
    click.echo(f"laid flat: L2 stretch {uv.l2_stretch:.4f}, {uv.charts} chart(s), {uv.flips} flips, {seconds:.1f} s")
    with ProgressBar("binding photographs") as bar:
        binding = bind_photographs(surface, used, **seeing, device=chosen, progress=bar.update)
    with ProgressBar("sampling photographs") as bar:
        made = combine_photographs(surface, uv, used, size, **mixing, binding=binding, device=chosen, progress=bar.update)
    for note in made.notes:
        click.echo(f"  {note}", err=True)
    if restore != "none":
        with ProgressBar("restoring what was not seen") as bar:
            made = restore_texture(made, restore, seed=seed, device=chosen, progress=bar.update)
    written = write_textured(surface, uv, made, output)
    share = 100 * made.known.sum() / max(int(made.inside.sum()), 1)
    seconds = time.perf_counter() - start
    click.echo(
        f"wrote {', '.join(map(str, written))}: {size} x {size} texels, {share:.1f} % of the surface photographed, "
        f"border step {border_step(made):.2f}, {seconds:.1f} s"
    )
    extra = []
    for photograph in (p for p in photographs if p.name in leave_out):
        try:
            seen = compare_with_photograph(surface, uv, made.image, made.known, photograph, seed=seed)
        except InputError as problem:
            click.echo(f"warning: {problem}", err=True)
            continue
        line = f"left out {seen.name}: PSNR {seen.psnr:.2f} dB, SSIM {seen.comparison.ssim:.4f}, FLIP {seen.comparison.flip:.4f}"
        click.echo(f"  {line}")
        extra.append(line)
    if report is not None:
        middle = (surface.vertices.min(axis=0) + surface.vertices.max(axis=0)) / 2
        front = np.mean([p.camera.center for p in photographs], axis=0) - middle if layout.view is None else layout.view
        write_texture_report(report, surface, uv, made, title=f"{mesh.name} textured", view=front, extra=extra)
        click.echo(f"wrote {report}")


def _pictures(photographs: list[Photograph]) -> list[Path]:
    return [p.picture for p in photographs if isinstance(p.picture, Path)]


@click.command(epilog="Example: intaglio restore photograph.png scratches.png -o restored.png --report restored.html")
@click.argument("image", type=FilePath())
@click.argument("mask", type=FilePath())
@click.option("-o", "--output", required=True, type=FilePath(), help="Image to write; PNG, TIFF or EXR keep all bits.")
@click.option("--method", type=click.Choice(METHODS), default="auto", show_default=True)
@grouped(
    "synthesis",
    dict,
    click.option("--kappa", type=click.IntRange(0, 512), default=None, help="Subbands of the low band; default chosen."),
    click.option("--levels", type=click.IntRange(1, 6), default=3, show_default=True, help="Of the pyramid."),
    click.option(
        "--coherence", type=float, default=10.0, show_default=True, help="Preference for continuing what neighbours copy."
    ),
    click.option(
        "--orientations",
        type=int,
        default=1,
        show_default=True,
        help="8: compare with turned and mirrored neighbourhoods, too; 1: as they are.",
    ),
    click.option("--refine", type=click.IntRange(0, 10), default=1, show_default=True, help="Passes of texture optimisation."),
    click.option("--seams/--no-seams", default=None, help="Fit what is filled to its surroundings; default: not for synthesize."),
)
@click.option("--barriers", type=FilePath(), default=None, help="Mask of pixels that colours don't spread across.")
@click.option("--invert", is_flag=True, help="The mask's dark pixels are missing, instead of its bright ones.")
@click.option("--report", type=FilePath(), default=None, help="HTML report with pictures and figures.")
@common
def restore(
    image: Path,
    mask: Path,
    output: Path,
    method: str,
    synthesis: dict[str, Any],
    barriers: Path | None,
    invert: bool,
    report: Path | None,
    seed: int,
    device: str | None,
) -> None:
    """Fill what is missing of IMAGE: the bright pixels of MASK (half of its range and more).

    Thin damage is bridged from its sides, holes are filled by coherent pieces of the known part. Known pixels keep their bits.
    Where the image has alpha, fully transparent pixels do not belong to it; restored pixels are opaque.
    """
    inputs = (image, mask) if barriers is None else (image, mask, barriers)
    check_writable(output, inputs=inputs)
    known_suffix(output, _WRITTEN, "image")
    if report is not None:
        check_writable(report, inputs=(*inputs, output))
        known_suffix(report, (".html", ".htm"), "report")
    if method in ("inpaint", "weave"):
        given = [n for n in ("kappa", "levels", "coherence", "orientations", "refine") if was_given(n)]
        if given:
            raise InputError(f"--{given[0]} is for --method split or synthesize, and has no effect on {method}")
    if method == "synthesize" and was_given("kappa"):
        raise InputError("--kappa is for --method split; synthesis alone has no low band")
    known_suffix(image, READABLE_SUFFIXES, "image")
    values = read_samples(image)
    if values.dtype.kind == "f" and output.suffix.lower() != ".exr":
        raise InputError(f"{image}: holds floats, which only EXR could hold of the result; write .exr")
    colors, alpha = (values[:, :, :3], values[:, :, 3]) if values.ndim == 3 and values.shape[2] == 4 else (values, None)
    missing = read_mask(mask, values.shape[:2], image) ^ invert
    walls = None if barriers is None else read_mask(barriers, values.shape[:2], image)
    inside = None if alpha is None else (alpha > 0) | missing
    start = time.perf_counter()
    try:
        with ProgressBar("restoring") as bar:
            found = restore_image(
                _as_seen(colors),
                missing,
                method,
                **synthesis,
                barriers=walls,
                inside=inside,
                seed=seed,
                device=device,
                progress=bar.update,
            )
    except InputError as problem:
        raise InputError(f"{image} with {mask}: {problem}") from problem
    result = np.where(missing[:, :, None] if colors.ndim == 3 else missing, _as_stored(found.image, colors), colors)
    if alpha is not None:
        opaque = np.where(missing, np.iinfo(alpha.dtype).max if alpha.dtype.kind in "iu" else 1, alpha)
        result = np.dstack([result, opaque.astype(alpha.dtype)])
    write_samples(result, output)
    for note in found.notes:
        click.echo(f"  {note}", err=True)
    seconds = time.perf_counter() - start
    share = 100 * missing.mean()
    click.echo(f"wrote {output}: {int(missing.sum())} pixels ({share:.1f} %) restored, {seconds:.1f} s")
    if report is not None:
        lines = write_restoration_report(report, _as_seen(colors), found, title=f"{image.name} restored", method=method)
        for line in lines:
            click.echo(f"  {line}")
        click.echo(f"wrote {report}")


def _as_seen(samples: Array) -> Array:
    """Return samples in values that look evenly spaced: 8-bit ones are, deeper ones and floats are linear."""
    if samples.dtype == np.uint8:
        return samples
    scale = np.iinfo(samples.dtype).max if samples.dtype.kind in "iu" else 1
    values = samples.astype(np.float64) / scale
    return (np.sign(values) * np.abs(values) ** (1 / _GAMMA)).astype(np.float32)


def _as_stored(seen: Array, samples: Array) -> Array:
    """Return what `_as_seen` gave, restored, as samples of the given type."""
    if samples.dtype == np.uint8:
        return seen
    values = np.sign(seen) * np.abs(seen.astype(np.float64)) ** _GAMMA
    if samples.dtype.kind in "iu":
        most = np.iinfo(samples.dtype).max
        return np.clip(np.rint(values * most), 0, most).astype(samples.dtype)
    return values.astype(samples.dtype)
