"""The command of geometry textures: extend."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from intaglio.cli.options import FilePath, Numbers, common, grouped, known_suffix, render_on
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.files import check_readable, check_writable
from intaglio.geometry import (
    FEWEST,
    POINT_SUFFIXES,
    PRESETS,
    PatchFit,
    assess_geometry,
    extend_geometry,
    mesh_geometry,
    read_geometry_texture,
    read_uv_mesh,
    wrap_geometry,
    write_geometry_report,
)
from intaglio.mesh import WRITABLE
from intaglio.progress import ProgressBar

_POSITIVE = click.FloatRange(min=0, min_open=True)


@dataclass(frozen=True)
class _Meshing:
    """The triangle mesh that is written besides the points; see `intaglio.mesh_geometry`."""

    mesh: Path | None
    mesh_cell: float | None
    closed: bool

    def __post_init__(self) -> None:
        if self.mesh_cell is not None and not np.isfinite(self.mesh_cell):
            raise InputError(f"--mesh-cell must be a finite length, not {self.mesh_cell}")
        if self.mesh is None and (self.closed or self.mesh_cell is not None):
            raise InputError(f"--{'closed' if self.closed else 'mesh-cell'} goes with --mesh")


@dataclass(frozen=True)
class _Wrapping:
    """The mesh that the result is laid over; see `intaglio.wrap_geometry`."""

    over: Path | None
    repeat: tuple[float, ...] | None
    thickness: float | None

    def __post_init__(self) -> None:
        for name, value in (("repeat", self.repeat), ("thickness", self.thickness)):
            if self.over is None and value is not None:
                raise InputError(f"--{name} goes with --over")
        if self.repeat is not None and (min(self.repeat) < 1 or any(r != int(r) for r in self.repeat)):
            raise InputError(f"--repeat must be two whole numbers of at least 1, not {','.join(f'{r:g}' for r in self.repeat)}")

    @property
    def turns(self) -> tuple[int, int]:
        """How often the result repeats along u and v."""
        return (1, 1) if self.repeat is None else (int(self.repeat[0]), int(self.repeat[1]))


def _read_swatch_by(bounds: tuple[float, ...] | None, **options: Any) -> dict[str, Any]:
    """Return the options of `read_geometry_texture`."""
    return {"bounds": None if bounds is None else np.array(bounds).reshape(2, 3), **options}


@click.command(
    epilog="Example: intaglio extend weave.ply --size 20,20 --patch 4 -o larger.ply --mesh larger.glb --report larger.html"
)
@click.argument("swatch", type=FilePath())
@click.option("-o", "--output", required=True, type=FilePath(), help="Points: .ply (keeps provenance), .xyz, .obj.")
@click.option("--size", type=Numbers(), required=True, help="Side, or sides u,v, of the output, in the swatch's unit.")
@click.option("--patch", type=Numbers(), default=None, help="Side(s) of a patch; default a third of the swatch.")
@grouped(
    "laying",
    dict,
    click.option("--overlap", type=_POSITIVE, default=None, help="Least overlap of patches; default 0.28 of a patch."),
    click.option("--extra", type=float, default=None, help="Region copied beyond a patch; default a quarter of it."),
    click.option("--cell", type=_POSITIVE, default=None, help="Step of the search; default a sixteenth of a patch."),
    click.option(
        "--tolerance",
        type=click.FloatRange(min=0),
        default=0.1,
        show_default=True,
        help="Draw from patches whose distance exceeds the least by this share.",
    ),
    click.option("--max-error", type=float, default=None, help="Divide patches that fit worse than this."),
    click.option(
        "--relax", type=click.IntRange(0, 100), default=3, show_default=True, help="Rounds of spreading points at the end."
    ),
    click.option("--tileable", is_flag=True, help="Make an output that tiles."),
)
@grouped(
    "fit",
    PatchFit,
    click.option("--weights", type=click.Choice(["auto", *PRESETS]), default="auto", show_default=True, help="Of pairing."),
    click.option("--pairs", type=click.IntRange(8, 1000), default=110, show_default=True, help="Points paired in an overlap."),
    click.option("--smoothing", type=float, default=1e-3, show_default=True, help="Of the warp: 1e-9 (exact) to 1 (stiff)."),
)
@grouped(
    "reading",
    _read_swatch_by,
    click.option(
        "--bounds", type=Numbers(6), default=None, help="x0,y0,z0,x1,y1,z1: the part of the swatch that is the texture."
    ),
    click.option("--axis", type=click.Choice(["x", "y", "z"]), default=None, help="Height axis; default the thinnest."),
    click.option("--spacing", type=_POSITIVE, default=None, help="Distance of samples: of meshes, or to thin points to."),
    click.option("--height", type=float, default=None, help="Height maps: height of white over black."),
    click.option("--pixel", type=_POSITIVE, default=None, help="Height maps: side of a pixel; default 1."),
)
@grouped(
    "meshing",
    _Meshing,
    click.option("--mesh", type=FilePath(), default=None, help="Also a triangle mesh: .ply, .obj, .glb, …"),
    click.option("--mesh-cell", type=_POSITIVE, default=None, help="Side of its cubes; default the distance of samples."),
    click.option("--closed", is_flag=True, help="Close the mesh where the output's border cuts it."),
)
@grouped(
    "wrapping",
    _Wrapping,
    click.option("--over", type=FilePath(), default=None, help="Mesh with texture coordinates to lay the result over."),
    click.option("--repeat", type=Numbers(2), default=None, help="With --over: how often the result repeats along u,v."),
    click.option("--thickness", type=_POSITIVE, default=None, help="With --over: length on the mesh for a unit of height."),
)
@click.option("--report", type=FilePath(), default=None, help="HTML report with pictures and figures.")
@common
def extend(
    swatch: Path,
    output: Path,
    size: tuple[float, ...],
    patch: tuple[float, ...] | None,
    laying: dict[str, Any],
    fit: PatchFit,
    reading: dict[str, Any],
    meshing: _Meshing,
    wrapping: _Wrapping,
    report: Path | None,
    seed: int,
    device: str | None,
) -> None:
    """Make a large piece of geometry texture from SWATCH: points with normals, a mesh, or a height map.

    Points are .las, .laz, .e57, .pts, .ptx, .pcd, .xyz, .txt, .csv, .asc, .ply or .obj; meshes .ply, .obj, .stl, .off, .gltf
    or .glb; height maps .png, .tif, .exr or .jpg. Along the plane u and v are x and y; with --axis x they are y and z, with
    --axis y z and x.

    Each point of the result says in the PLY which swatch point it is (source), how far it was moved to fit (moved) and which
    patch laid it (patch).
    """
    check_readable(swatch)
    _check_outputs(swatch, output, meshing.mesh, wrapping.over, report)
    if report is not None:
        render_on(device)
    sides, patches = _two_sides("size", size), None if patch is None else _two_sides("patch", patch)
    chosen = device_or_error(device)
    target = None if wrapping.over is None else read_uv_mesh(wrapping.over)
    texture = read_geometry_texture(swatch, **reading, seed=seed)
    for note in texture.notes:
        click.echo(f"  {note}", err=True)
    start = time.perf_counter()
    with ProgressBar("laying patches") as bar:
        made = extend_geometry(texture, sides, patches, fit=fit, seed=seed, device=chosen, progress=bar.update, **laying)
    seconds = time.perf_counter() - start
    for note in made.notes:
        click.echo(f"  {note}", err=True)
    figures = assess_geometry(made, texture, device=chosen) if len(made) >= FEWEST else None
    if target is None:
        result = made
    else:
        if max(wrapping.turns) > 1 and not laying["tileable"]:
            click.echo("  without --tileable the repeated texture shows its borders", err=True)
        result = wrap_geometry(
            made,
            *target,
            size=sides,
            repeat=wrapping.turns,
            axis=texture.axis,
            thickness=wrapping.thickness,
            device=chosen,
        )
        click.echo(f"  {result.notes[-1]}", err=True)
    result.write(output)
    click.echo(f"wrote {output}: {len(result)} points from a swatch of {len(texture.points)}, {seconds:.1f} s")
    if meshing.mesh is not None:
        axis = texture.axis if target is None else None
        solid = mesh_geometry(result, meshing.mesh_cell, closed=meshing.closed, axis=axis, device=chosen)
        solid.write(meshing.mesh)
        click.echo(f"wrote {meshing.mesh}: {len(solid.vertices)} vertices, {len(solid.faces)} triangles")
        click.echo(f"  {solid.notes[-1]}", err=True)
    for line in [] if figures is None else figures.lines():
        click.echo(f"  {line}")
    if report is not None and figures is not None:
        timed = [f"{seconds:.2f} s, {1e6 * seconds / max(len(made), 1):.1f} microseconds a point"]
        write_geometry_report(report, made, texture, figures, title=f"{swatch.name} extended", extra=timed, device=chosen)
        click.echo(f"wrote {report}")


def _check_outputs(swatch: Path, output: Path, mesh: Path | None, over: Path | None, report: Path | None) -> None:
    """Raise an error unless the outputs can be written, differ from each other and from the inputs, and have known types."""
    inputs = (swatch,) if over is None else (swatch, over)
    check_writable(output, inputs=inputs)
    known_suffix(output, POINT_SUFFIXES, "points")
    if mesh is not None:
        check_writable(mesh, inputs=(*inputs, output))
        known_suffix(mesh, WRITABLE, "mesh")
    if report is not None:
        check_writable(report, inputs=(*inputs, output, *([] if mesh is None else [mesh])))
        known_suffix(report, (".html", ".htm"), "report")
    written = [path.absolute().resolve() for path in (output, mesh, report) if path is not None]
    if len(set(written)) < len(written):
        raise InputError("--output, --mesh and --report must be different files")


def _two_sides(name: str, numbers: tuple[float, ...]) -> tuple[float, float]:
    """Return one or two numbers as two, or raise `InputError`."""
    if len(numbers) not in (1, 2):
        raise InputError(f"--{name} takes one number or two (u,v), not {len(numbers)}")
    if not min(numbers) > 0:
        raise InputError(f"--{name} must be above 0, not {','.join(f'{n:g}' for n in numbers)}")
    return numbers[0], numbers[-1]
