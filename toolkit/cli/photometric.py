"""The commands of photometric textures: represent, relight and assess."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from intaglio.cli.options import FilePath, Numbers, common, grouped, image_size, known_suffix, render_on, was_given
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.files import IMAGE_SUFFIXES, check_folder, check_readable, check_writable, write_image
from intaglio.photometric import (
    KINDS,
    MAP_NAMES,
    TEXTURE_SUFFIXES,
    PhotometricStack,
    assess_kinds,
    assessment_lines,
    light_direction,
    read_relightable,
    read_stack,
    write_assessment,
    write_maps,
    write_relightable,
    write_web_planes,
)
from intaglio.photometric import represent as represent_stack
from intaglio.progress import ProgressBar


@dataclass(frozen=True)
class StackReading:
    """How a stack of photographs is read; see `intaglio.read_stack`."""

    response: str | None
    mask: Path | None
    sphere: Path | None
    circle: tuple[float, float, float] | None
    gray: bool
    keep: tuple[str, ...]
    skip: tuple[str, ...]
    strict: bool

    def read(self, capture: Path) -> PhotometricStack:
        """Return the stack that ``capture`` names."""
        try:
            curve = self.response if self.response in (None, "linear", "srgb") else float(str(self.response))
        except ValueError:
            raise InputError(f"--response {self.response!r} is not known; give linear, srgb or a gamma such as 2.2") from None
        stack = read_stack(
            capture,
            curve,
            mask=self.mask,
            sphere=self.sphere,
            circle=self.circle,
            gray=self.gray,
            keep=self.keep,
            skip=self.skip,
            strict=self.strict,
        )
        for note in stack.notes:
            click.echo(f"  {note}", err=True)
        return stack

    def inputs(self, capture: Path, stack: PhotometricStack) -> list[Path]:
        """Return the files that the stack was read from."""
        return [capture, *map(Path, stack.names), *([self.mask] if self.mask is not None else [])]


stack_options = grouped(
    "reading",
    StackReading,
    click.option("--response", default=None, help="linear, srgb or a gamma; default: 8 bits sRGB, others linear."),
    click.option("--mask", type=FilePath(), default=None, help="Image of the pixels to use."),
    click.option("--sphere", type=FilePath(), default=None, help="Folder of mirror sphere pictures."),
    click.option("--circle", type=Numbers(3), default=None, help="x,y,radius of the sphere in its pictures, in pixels."),
    click.option("--gray", is_flag=True, help="Take the mean of the channels."),
    click.option("--keep", multiple=True, help="Photographs to use though they look odd: names, patterns, numbers from 0."),
    click.option("--skip", multiple=True, help="Photographs to leave out, likewise, as 31,image4* (`info` shows the table)."),
    click.option("--strict", is_flag=True, help="Refuse a capture of which a photograph would be left out."),
)


def spare_inputs(inputs: list[Path], output: Path, maps: Path | None) -> None:
    """Raise `InputError` if one of the files that go beside ``output``, or into ``maps``, has the name of an input or of it."""
    if maps is not None and output.name in MAP_NAMES and output.parent.resolve() == maps.resolve():
        raise InputError(f"{output}: one of the maps has that name; give --output or --maps another place")
    if maps is not None and output.resolve() == maps.resolve():
        raise InputError(f"{output}: is both --output, a file, and --maps, a folder; give them different names")
    for given in inputs:
        into_maps = maps is not None and maps.exists() and given.name in MAP_NAMES and given.parent.samefile(maps)
        beside = output.suffix.lower() == ".json" and given.parent.samefile(output.parent)
        if into_maps or (beside and (re.match(r"plane_\d+\.", given.name) or given.name == "materials.bin")):
            raise InputError(f"{given}: is an input and would be overwritten; inputs never are, give another output folder")


@click.command(epilog="Example: intaglio represent capture.lp -o texture.exr --kind rbf --maps maps")
@click.argument("capture", type=FilePath())
@click.option("-o", "--output", required=True, type=FilePath(), help=".exr, .ptm, info.json (web) or .glb.")
@grouped(
    "fit",
    dict,
    click.option("--kind", default="rbf", show_default=True, help=f"One of {', '.join(KINDS)}."),
    click.option("--color", type=click.Choice(["channels", "luminance"]), default="channels", show_default=True),
    click.option("--robust", is_flag=True, help="gradient, height: leave out shadows and highlights."),
    click.option("--order", type=int, default=3, show_default=True, help="hsh: 2 (4 maps) or 3 (9 maps)."),
    click.option("--interpolation", type=click.Choice(["auto", "grid", "triangles"]), default="auto", show_default=True),
    click.option("--components", type=int, default=None, help="rbf: number of maps; default by cross-validation."),
    click.option("--smoothing", type=float, default=None, help="rbf: 0 passes through all images; default by cross-validation."),
    click.option("--integration", type=click.Choice(["fourier", "cosine"]), default="fourier", show_default=True, help="height."),
    click.option(
        "--differentiation",
        type=click.Choice(["fourier", "central", "forward"]),
        default="fourier",
        show_default=True,
        help="height.",
    ),
)
@click.option("--maps", type=FilePath(), default=None, help="Folder for normal, albedo and height images.")
@click.option("--tiles", is_flag=True, help="info.json: Deep Zoom tiles instead of whole planes.")
@stack_options
@common
def represent(
    capture: Path,
    output: Path,
    reading: StackReading,
    maps: Path | None,
    tiles: bool,
    fit: dict[str, Any],
    seed: int,
    device: str | None,
) -> None:
    """Fit a relightable texture to CAPTURE: an .lp file, a lights.csv, or the folder of a stack of lit photographs."""
    known_suffix(output, TEXTURE_SUFFIXES, "texture")
    if tiles and output.suffix.lower() != ".json":
        raise InputError("--tiles is for web planes: give -o info.json")
    check_writable(output, inputs=(capture,))
    if maps is not None:
        check_folder(maps)
    start = time.perf_counter()
    stack = reading.read(capture)
    inputs = reading.inputs(capture, stack)
    check_writable(output, inputs=tuple(inputs))
    spare_inputs(inputs, output, maps)
    with ProgressBar("fitting") as bar:
        texture = represent_stack(stack, device=device, progress=bar.update, **fit)
    for note in texture.notes:
        click.echo(f"  {note}", err=True)
    if output.suffix.lower() == ".json":
        write_web_planes(texture, output, tiles=tiles)
    else:
        write_relightable(texture, output)
    if output.suffix.lower() == ".ptm" and texture.kind != "ptm":
        click.echo("  .ptm holds the six coefficients of a polynomial, to which the texture was approximated", err=True)
    seconds = time.perf_counter() - start
    height, width, channels = texture.shape
    colour = "colour" if channels == 3 else "grey"
    click.echo(
        f"wrote {output}: {texture.kind}, {len(texture.maps)} maps of {width} x {height} pixels, {colour}, "
        f"from {stack.shape[0]} images, {seconds:.1f} s"
    )
    if maps is not None:
        written = write_maps(texture, maps)
        click.echo(f"wrote {', '.join(str(p) for p in written)}")


@click.command(epilog="Example: intaglio relight texture.exr -o lit.png --tilt 135 --slant 60")
@click.argument("texture", type=FilePath())
@click.option("-o", "--output", required=True, type=FilePath(), help="Image to write.")
@click.option("--tilt", type=float, default=135.0, show_default=True, help="Degrees from x (right) to y (up).")
@click.option("--slant", type=float, default=45.0, show_default=True, help="Degrees from straight above.")
@click.option("--light", type=Numbers(3), default=None, help="x,y,z towards the light, instead of tilt and slant.")
@click.option("--exposure", type=float, default=1.0, show_default=True, help="Factor on the values.")
@click.option("--bits", type=click.Choice(["8", "16"]), default="8", show_default=True, help="Of PNG and TIFF.")
@click.option("--encoded", is_flag=True, help="Values are display values already: fitted to photographs as stored.")
@click.option("--mesh", type=FilePath(), default=None, help="Render on this mesh (with texture coordinates).")
@click.option("--repeat", type=float, default=1.0, show_default=True, help="--mesh: repeats of the texture.")
@click.option("--direction", type=Numbers(3), default="0.3,0.4,1", show_default=True, help="--mesh: x,y,z to the eye.")
@click.option("--size", default="800x800", show_default=True, help="--mesh: WIDTHxHEIGHT in pixels.")
@click.option("--samples", type=click.IntRange(1, 65536), default=32, show_default=True, help="--mesh: paths per pixel.")
@common
def relight(
    texture: Path,
    output: Path,
    tilt: float,
    slant: float,
    light: tuple[float, ...] | None,
    exposure: float,
    bits: str,
    encoded: bool,
    mesh: Path | None,
    repeat: float,
    direction: tuple[float, ...],
    size: str,
    samples: int,
    seed: int,
    device: str | None,
) -> None:
    """Light TEXTURE (.exr or .ptm) from any direction above it, flat, or on a mesh.

    On a mesh, light and eye are in the mesh's coordinates.
    """
    check_writable(output, inputs=(texture,) if mesh is None else (texture, mesh))
    known_suffix(output, IMAGE_SUFFIXES, "image")
    if not np.isfinite([tilt, slant]).all():
        raise InputError("--tilt and --slant must be finite numbers of degrees")
    if not 1e-6 <= exposure <= 1e6:
        raise InputError(f"--exposure must be a number from 1e-6 to 1e6, not {exposure}")
    if bits == "16" and output.suffix.lower() not in (".png", ".tif", ".tiff"):
        raise InputError(f"--bits 16: {output.suffix} has no 16 bits; write .png or .tif")
    for name in ("repeat", "direction", "size", "samples"):
        if mesh is None and was_given(name):
            raise InputError(f"--{name} goes with --mesh; flat, a texture is lit as it is")
    towards = light_direction(tilt, slant) if light is None else np.array(light)
    loaded = read_relightable(texture)
    if mesh is None:
        image = loaded.relight(towards, device=device)
    else:
        from intaglio.photometric import render_on_mesh

        if not np.any(direction) or not np.any(towards):
            raise InputError("--direction and --light must not be all zero")
        if not (np.isfinite(repeat) and repeat > 0):
            raise InputError(f"--repeat must be a finite number over 0, not {repeat}")
        render_on(device)
        image = render_on_mesh(
            loaded,
            mesh,
            light=towards,
            direction=np.array(direction),
            repeat=repeat,
            size=image_size(size),
            samples=samples,
            seed=seed,
        )
    write_image(image * np.float32(exposure), output, bits=int(bits), linear=True if encoded else None)
    height, width = image.shape[:2]
    click.echo(f"wrote {output}: {width} x {height} pixels")


@click.command("capture", epilog="Example: intaglio assess capture capture.lp -o kinds.html")
@click.argument("capture", type=FilePath())
@click.option("-o", "--output", default=None, type=FilePath(), help="HTML report with plots and pictures.")
@click.option("--kinds", default=",".join(KINDS), show_default=True, help="Comma-separated kinds.")
@click.option(
    "--leave-one-out/--no-leave-one-out", default=True, show_default=True, help="Also predict each image from the others."
)
@click.option("--robust", is_flag=True, help="Fit gradient and height robustly.")
@stack_options
@common
def assess_capture(
    capture: Path,
    output: Path | None,
    kinds: str,
    leave_one_out: bool,
    reading: StackReading,
    robust: bool,
    seed: int,
    device: str | None,
) -> None:
    """Compare how well the kinds reconstruct the photographs of CAPTURE, and predict those left out."""
    if not capture.is_dir():
        check_readable(capture)
    device_or_error(device)
    wanted = [k.strip() for k in kinds.split(",") if k.strip()]
    for kind in wanted:
        if kind not in KINDS:
            raise InputError(f"--kinds: {kind!r} is not known; known: {', '.join(KINDS)}")
    if not wanted:
        raise InputError(f"--kinds is empty; known: {', '.join(KINDS)}")
    if output is not None:
        known_suffix(output, (".html", ".htm"), "report")
        check_writable(output, inputs=(capture,))
    stack = reading.read(capture)
    with ProgressBar("fitting kinds") as bar:
        reasons: list[str] = []
        found = assess_kinds(
            stack,
            wanted,
            leave_one_out=leave_one_out,
            robust=robust,
            device=device,
            reasons=reasons,
            progress=bar.update,
        )
    for reason in reasons:
        click.echo(f"  {reason}", err=True)
    click.echo("\n".join(assessment_lines(found)))
    if output is not None:
        write_assessment(stack, output, found=found, title=f"{capture.name}: kinds compared", robust=robust, device=device)
        click.echo(f"wrote {output}")
