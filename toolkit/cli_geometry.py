"""The command of geometry textures: extend."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click
import numpy as np

from intaglio.cli_options import Numbers, common, known_suffix, render_on, was_given
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.files import check_readable, check_writable
from intaglio.geometry import (
    PRESETS,
    assess_geometry,
    extend_geometry,
    mesh_geometry,
    read_geometry_texture,
    wrap_geometry,
)
from intaglio.geometry.report import write_geometry_report
from intaglio.geometry.shell import read_uv_mesh
from intaglio.geometry.writing import POINT_SUFFIXES
from intaglio.mesh_writing import WRITABLE
from intaglio.progress import ProgressBar

Array = np.ndarray


@click.command(
    epilog="Example: intaglio extend weave.ply --size 20,20 --patch 4 -o larger.ply --mesh larger.glb --report larger.html"
)
@click.argument("swatch", type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", required=True, type=click.Path(path_type=Path), help="Points: .ply (keeps provenance), .xyz, .obj."
)
@click.option("--size", type=Numbers(), required=True, help="Side, or sides u,v, of the output, in the swatch's unit.")
@click.option("--patch", type=Numbers(), default=None, help="Side(s) of a patch; default a third of the swatch.")
@click.option("--overlap", type=float, default=None, help="Least overlap of patches; default 0.28 of a patch.")
@click.option("--extra", type=float, default=None, help="Region copied beyond a patch; default a quarter of it.")
@click.option("--cell", type=float, default=None, help="Step of the search; default a sixteenth of a patch.")
@click.option(
    "--tolerance", type=float, default=0.1, show_default=True, help="Choose among patches this much worse than the best."
)
@click.option("--max-error", type=float, default=None, help="Divide patches that fit worse than this.")
@click.option("--weights", type=click.Choice(["auto", *PRESETS]), default="auto", show_default=True, help="Of pairing.")
@click.option("--pairs", type=int, default=150, show_default=True, help="Points paired in an overlap.")
@click.option("--smoothing", type=float, default=1e-3, show_default=True, help="Regularisation of the warp.")
@click.option("--relax", type=int, default=3, show_default=True, help="Rounds of spreading points at the end.")
@click.option("--toroidal", is_flag=True, help="Make an output that tiles.")
@click.option("--bounds", type=Numbers(6), default=None, help="x0,y0,z0,x1,y1,z1: the part of the swatch that is the texture.")
@click.option("--axis", type=click.Choice(["x", "y", "z"]), default=None, help="Height axis; default the thinnest.")
@click.option("--spacing", type=float, default=None, help="Distance of samples: of meshes, or to thin points to.")
@click.option("--height", type=float, default=None, help="Height maps: height of white over black.")
@click.option("--pixel", type=float, default=1.0, show_default=True, help="Height maps: side of a pixel.")
@click.option("--mesh", type=click.Path(path_type=Path), default=None, help="Also a triangle mesh: .ply, .obj, .glb, …")
@click.option("--mesh-cell", type=float, default=None, help="Side of its cubes; default the distance of samples.")
@click.option("--closed", is_flag=True, help="Close the mesh where the output's border cuts it.")
@click.option(
    "--over", type=click.Path(path_type=Path), default=None, help="Mesh with texture coordinates to lay the result over."
)
@click.option("--repeat", type=Numbers(2), default=None, help="With --over: how often the result repeats along u,v.")
@click.option("--thickness", type=float, default=None, help="With --over: length on the mesh for a unit of height.")
@click.option("--report", type=click.Path(path_type=Path), default=None, help="HTML report with pictures and figures.")
@common
def extend(
    swatch: Path,
    output: Path,
    size: tuple[float, ...],
    patch: tuple[float, ...] | None,
    bounds: tuple[float, ...] | None,
    axis: str | None,
    spacing: float | None,
    height: float | None,
    pixel: float,
    mesh: Path | None,
    mesh_cell: float | None,
    closed: bool,
    over: Path | None,
    repeat: tuple[float, ...] | None,
    thickness: float | None,
    report: Path | None,
    seed: int,
    device: str | None,
    **settings: Any,
) -> None:
    """Make a large piece of geometry texture from SWATCH: points with normals, a mesh, or a height map.

    Each point of the result says in the PLY which swatch point it is (source), how far it was moved to fit (moved) and which
    patch laid it (patch).
    """
    check_readable(swatch)
    inputs = (swatch,) if over is None else (swatch, over)
    check_writable(output, inputs=inputs)
    known_suffix(output, POINT_SUFFIXES, "points")
    if mesh is not None:
        check_writable(mesh, inputs=(*inputs, output))
        known_suffix(mesh, WRITABLE, "mesh")
    if report is not None:
        check_writable(report, inputs=(*inputs, output, *([] if mesh is None else [mesh])))
        known_suffix(report, (".html", ".htm"), "report")
        render_on(device)
    for name, wanted, option in (("repeat", over, "--over"), ("thickness", over, "--over"), ("mesh_cell", mesh, "--mesh")):
        if was_given(name) and wanted is None:
            raise InputError(f"--{name.replace('_', '-')} goes with {option}")
    if closed and mesh is None:
        raise InputError("--closed goes with --mesh")
    chosen = device_or_error(device)
    target = None if over is None else read_uv_mesh(over)
    box = None if bounds is None else np.array(bounds).reshape(2, 3)
    texture = read_geometry_texture(swatch, bounds=box, axis=axis, spacing=spacing, height=height, pixel=pixel, seed=seed)
    for note in texture.notes:
        click.echo(f"  {note}", err=True)
    start = time.perf_counter()
    with ProgressBar("laying patches") as bar:
        made = extend_geometry(
            texture, _sides(size, "size"), None if patch is None else _sides(patch, "patch"), seed=seed, device=chosen,
            progress=bar.update, **settings,
        )  # fmt: skip
    seconds = time.perf_counter() - start
    for note in made.notes:
        click.echo(f"  {note}", err=True)
    figures = assess_geometry(made, texture, device=chosen)
    if target is None:
        result = made
    else:
        turns = (1, 1) if repeat is None else (int(repeat[0]), int(repeat[1]))
        if repeat is not None and turns != tuple(repeat):
            raise InputError(f"--repeat must be whole numbers, not {repeat[0]:g},{repeat[1]:g}")
        result = wrap_geometry(
            made, *target, size=_sides(size, "size"), repeat=turns, axis=texture.axis, thickness=thickness, device=chosen
        )
        click.echo(f"  {result.notes[-1]}", err=True)
    result.write(output)
    click.echo(f"wrote {output}: {len(result)} points from a swatch of {len(texture.points)}, {seconds:.1f} s")
    if mesh is not None:
        solid = mesh_geometry(result, mesh_cell, closed=closed, axis=texture.axis if target is None else None, device=chosen)
        solid.write(mesh)
        click.echo(f"wrote {mesh}: {len(solid.vertices)} vertices, {len(solid.faces)} triangles")
    for line in figures.lines():
        click.echo(f"  {line}")
    if report is not None:
        timed = [f"{seconds:.2f} s, {1e6 * seconds / max(len(made), 1):.1f} microseconds a point"]
        write_geometry_report(report, made, texture, figures, title=f"{swatch.name} extended", extra=timed, device=chosen)
        click.echo(f"wrote {report}")


def _sides(numbers: tuple[float, ...], name: str) -> tuple[float, float]:
    """Return one or two numbers as two."""
    if len(numbers) not in (1, 2):
        raise InputError(f"--{name} takes one number or two (u,v), not {len(numbers)}")
    return numbers[0], numbers[-1]
