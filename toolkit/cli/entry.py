"""The `intaglio` command: a thin layer over the public functions."""

from __future__ import annotations

import os
from pathlib import Path

import click
import numpy as np

import intaglio
from intaglio.arrays import Array
from intaglio.cli.assessment import assess
from intaglio.cli.close_ups import CloseUp
from intaglio.cli.facts import (
    image_facts,
    is_texture,
    material_facts,
    mesh_facts,
    point_facts,
    stack_facts,
    system_facts,
    texture_facts,
)
from intaglio.cli.geometry import extend
from intaglio.cli.options import FilePath, Numbers, common, grouped, image_size, known_suffix, render_on
from intaglio.cli.photographs import restore, texture
from intaglio.cli.photometric import relight, represent
from intaglio.cli.relief import complete
from intaglio.cli.synthesis import rank, synthesize
from intaglio.devices import device_or_error
from intaglio.errors import InputError, IntaglioError
from intaglio.files import IMAGE_SUFFIXES, READABLE_SUFFIXES, check_readable, check_writable
from intaglio.geometry import POINT_FILES, holds_points
from intaglio.mesh import WRITABLE
from intaglio.photometric import STACK_SUFFIXES
from intaglio.synthesis import holds_material

# Of an angle's turns.
_MOST_DEGREES = 36000


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(intaglio.__version__, prog_name="intaglio")
def cli() -> None:
    """Complete, synthesise and relight the fine surface texture of real objects, render it, and measure it."""


for _command in (complete, represent, relight, assess, synthesize, rank, texture, restore, extend):
    cli.add_command(_command)


@cli.command(epilog="Example: intaglio render whole.ply -o whole.png --direction 1,0.2,0.5 --slant 65")
@click.argument("mesh", type=FilePath())
@click.option("-o", "--output", required=True, type=FilePath(), help="Image to write.")
@grouped(
    "close_up",
    CloseUp,
    click.option("--direction", type=Numbers(3), default=None, help="x,y,z: from the object to the eye; default 0,0,1."),
    click.option("--up", type=Numbers(3), default="0,1,0", show_default=True, help="x,y,z: upright in the picture."),
    click.option("--look-at", type=Numbers(3), default=None, help="x,y,z: the middle of the picture."),
    click.option("--zoom", type=click.FloatRange(0.01, 10000), default=None, help="How much larger than the whole mesh fits in."),
    click.option("--hole", type=int, default=None, help="Look at this filling, largest first, or at this hole as info lists it."),
)
@click.option("--size", default="800x800", show_default=True, help="WIDTHxHEIGHT in pixels.")
@click.option("--tilt", type=float, default=135.0, show_default=True, help="Light's direction in the picture, degrees.")
@click.option("--slant", type=float, default=60.0, show_default=True, help="Light's angle from the line of sight, degrees.")
@click.option("--samples", type=click.IntRange(1, 65536), default=32, show_default=True, help="Paths per pixel.")
@click.option("--color/--clay", default=True, help="Use the mesh's colours, if it has any, or clay.")
@click.option("--provenance", is_flag=True, help="Show the measured part in clay, the filled part in blue.")
@click.option("--flat", is_flag=True, help="Shade facets.")
@click.option("--view", type=Numbers(3), default=None, help="x,y,z: direction of sight of a point cloud.")
@common
def render(
    mesh: Path,
    output: Path,
    close_up: CloseUp,
    size: str,
    tilt: float,
    slant: float,
    samples: int,
    color: bool,
    provenance: bool,
    flat: bool,
    view: tuple[float, ...] | None,
    seed: int,
    device: str | None,
) -> None:
    """Render MESH under raking light, so that its relief shows; of points, with --view, what the scanner saw."""
    from intaglio.relief import FILLED_TINT
    from intaglio.render import CLAY, Light
    from intaglio.render import view as render_view

    check_writable(output, inputs=(mesh,))
    known_suffix(output, IMAGE_SUFFIXES, "image")
    shape = image_size(size)
    if not (abs(tilt) <= _MOST_DEGREES and abs(slant) <= _MOST_DEGREES):
        raise InputError(f"--tilt and --slant must be finite numbers of degrees, from {-_MOST_DEGREES} to {_MOST_DEGREES}")
    render_on(device)
    surface = intaglio.read_surface(mesh, view=view)
    camera = close_up.camera(mesh, surface)
    colors = surface.color if color else None
    if provenance and surface.measured.all():
        click.echo(f"  {mesh} says of no vertex that it was filled", err=True)
    if provenance:
        colors = np.where(surface.measured[:, None], CLAY, FILLED_TINT)
    image = render_view(
        surface.vertices,
        surface.faces,
        camera=camera,
        colors=colors,
        light=Light(tilt=tilt, slant=slant),
        size=shape,
        samples=samples,
        flat=flat,
        seed=seed,
    )
    intaglio.write_image(image, output)
    click.echo(f"wrote {output}: {shape[1]} x {shape[0]} pixels")


@cli.command(epilog="Example: intaglio compare completed.png truth.png -o difference.png")
@click.argument("image", type=FilePath())
@click.argument("reference", type=FilePath())
@click.option("-o", "--output", default=None, type=FilePath(), help="Write FLIP's difference picture.")
@common
def compare(image: Path, reference: Path, output: Path | None, seed: int, device: str | None) -> None:
    """Compare IMAGE with REFERENCE: rmse, PSNR, SSIM and FLIP."""
    from intaglio.kernels.transfer import decode_srgb
    from intaglio.render import compare as compare_images

    device_or_error(device)
    if output is not None:
        check_writable(output, inputs=(image, reference))
        known_suffix(output, IMAGE_SUFFIXES, "image")
    first, second = (_opaque(intaglio.read_image(p)) for p in (image, reference))
    try:
        result = compare_images(first, second)
    except ValueError as error:
        raise InputError(f"{image} and {reference}: {error}") from error
    click.echo(f"rmse {result.rmse:.6f}  PSNR {result.psnr:.2f} dB  SSIM {result.ssim:.4f}  FLIP {result.flip:.4f}")
    if output is not None:
        intaglio.write_image(decode_srgb(result.difference), output)
        click.echo(f"wrote {output}")


@cli.command(epilog="Example: intaglio info scan.ply capture.lp")
@click.argument("files", nargs=-1, type=FilePath())
@click.option("--strict", is_flag=True, help="Refuse meshes whose faces must be mended to join as a surface.")
@common
def info(files: tuple[Path, ...], strict: bool, seed: int, device: str | None) -> None:
    """Show versions, devices and the renderer's variant; or the facts of meshes, points, images, textures, stacks, materials."""
    device_or_error(device)
    if not files:
        for line in system_facts(device):
            click.echo(line)
    refused: list[IntaglioError] = []
    for path in files:
        try:
            lines = _facts(path, strict)
        except IntaglioError as problem:
            refused.append(problem)
            continue
        click.echo(str(path))
        for line in lines:
            click.echo(f"  {line}")
    for error in refused[:-1]:
        click.echo(f"intaglio: {error}", err=True)
    if refused:
        raise refused[-1]


def _facts(path: Path, strict: bool) -> list[str]:
    """Return what there is to say of a file or folder."""
    suffix = path.suffix.lower()
    # os.path's is False for names that no file can have, pathlib's raises.
    folder = os.path.isdir(path)
    if not folder:
        check_readable(path)
    if folder and holds_material(path):
        return material_facts(path)
    if folder or suffix in STACK_SUFFIXES:
        return stack_facts(path)
    if suffix in POINT_FILES or (suffix in WRITABLE and holds_points(path)):
        return point_facts(path)
    if suffix in WRITABLE:
        return mesh_facts(path, strict)
    if is_texture(path):
        return texture_facts(path)
    if suffix in READABLE_SUFFIXES:
        return image_facts(path)
    raise InputError(
        f"{path}: {suffix or 'without a suffix it'} is no type of mesh, points, image, texture or list of lights that is known; "
        "files of cameras are for texture"
    )


def _opaque(image: Array) -> Array:
    return image[:, :, :3] if image.ndim == 3 else image


def run_command() -> int:
    """Run the command that the arguments name, and return its exit status."""
    done = cli.main(prog_name="intaglio", standalone_mode=False)
    return done if isinstance(done, int) else 0
