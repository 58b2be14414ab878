"""The command that completes relief."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

import intaglio
from intaglio.cli.options import (
    ExemplarChoice,
    Extent,
    FilePath,
    GuidesChoice,
    HoleChoice,
    Numbers,
    SymmetryChoice,
    common,
    known_suffix,
)
from intaglio.errors import InputError
from intaglio.files import check_readable, check_writable
from intaglio.mesh import WRITABLE, files_beside
from intaglio.progress import ProgressBar
from intaglio.relief import FRAMES, METHODS, METRICS, ORDERS, PARTNERS, RULES, SEARCHES, chosen_sources

# Options of the command by where they belong.
_PREPARED = ("base", "extent", "holes", "hole_size", "relief_scale", "spacing", "reference", "device")
_SETTINGS = (
    "window",
    "rotations",
    "error",
    "levels",
    "refine",
    "color_weight",
    "metric",
    "order",
    "search",
    "bootstrap",
    "oversample",
    "subsample",
    "partners",
    "interpolate",
    "method",
    "mirror",
    "symmetry",
)


@click.command(epilog="Example: intaglio complete statue.ply -o whole.ply --report whole.html")
@click.argument("scan", type=FilePath())
@click.option("-o", "--output", default=None, type=FilePath(), help="Mesh to write; PLY keeps provenance.")
@click.option(
    "--base",
    type=click.Choice(["auto", "plane", "cylinder", "sphere", "smooth"]),
    default="auto",
    show_default=True,
    help="smooth: the scan's own smoothed surface; auto: a plane, cylinder or sphere where one fits, else smooth.",
)
@click.option("--extent", type=Extent(), default=None, help="whole, rectangle, holes, or numbers (low,high or u0,u1,v0,v1).")
@click.option("--holes", type=HoleChoice(), default=None, help="all (default), largest, every, or numbers; list: show and stop.")
@click.option("--hole-size", type=Numbers(2), default=None, help="low,high: only holes whose rim is so long.")
@click.option("--relief-scale", type=float, default=None, help="Smooth base: longer waves are shape; default 12 spacings.")
@click.option("--method", type=click.Choice(METHODS), default=None, help="Default pieces over a smooth base, else propagation.")
@click.option(
    "--exemplar",
    type=ExemplarChoice(),
    multiple=True,
    default=("near",),
    show_default=True,
    help="near, all, a ball x,y,z,radius, or files of other scans, with near or all beside them or not.",
)
@click.option("--mirror", is_flag=True, help="pieces: mirror images of what was measured serve as well.")
@click.option(
    "--guides", type=GuidesChoice(), default="auto", show_default=True, help="pieces: auto, none, or a file of polylines."
)
@click.option(
    "--symmetry",
    type=SymmetryChoice(),
    default="auto",
    show_default=True,
    help="pieces: auto, none, a mirror plane nx,ny,nz,d, or an axis and its count px,py,pz,dx,dy,dz,n.",
)
@click.option("--window", type=int, default=None, help="Neighbourhood radius in edges; default from the relief.")
@click.option("--error", type=float, default=None, help="Largest accepted mean squared distance; default from the noise.")
@click.option("--rotations", type=int, default=None, help="Rotations tried; default 1 where relief has a direction, else 12.")
@click.option("--levels", type=int, default=1, show_default=True, help="Scales: completed coarse to fine.")
@click.option("--color-weight", type=float, default=None, help="0 to 1: how much colour counts beside shape.")
@click.option("--search", type=click.Choice(SEARCHES), default="auto", show_default=True)
@click.option("--refine", type=int, default=None, help="Refinement passes after growth.")
@click.option("--spacing", type=float, default=None, help="Distance between new vertices, in the scan's unit.")
@click.option("--metric", type=click.Choice(METRICS), default="displacement", show_default=True)
@click.option("--order", type=click.Choice(ORDERS), default="wave", show_default=True)
@click.option("--selection", type=click.Choice(RULES), default="near-best", show_default=True)
@click.option("--frames", type=click.Choice([*FRAMES, "relief"]), default=None, help="Local frames.")
@click.option("--reference", type=Numbers(3), default=None, help="x,y,z: global vector for --frames reference.")
@click.option("--tolerance", type=float, default=0.1, show_default=True, help="near-best: how much above the least error.")
@click.option("--eta", type=float, default=10.0, show_default=True, help="best-percent: percent to choose from.")
@click.option("--oversample/--no-oversample", default=None, help="Halve the samples' edges; default where out of phase.")
@click.option("--oversample-levels", type=int, default=None, help="Halve the samples' edges so often, 0 to 4.")
@click.option("--subsample", type=float, default=1.0, show_default=True, help="Share of the samples that is compared.")
@click.option("--partners", type=click.Choice(PARTNERS), default="measured", show_default=True, help="What neighbours fall on.")
@click.option("--interpolate", is_flag=True, help="Take relief between the samples' vertices, where it fits best.")
@click.option("--bootstrap", is_flag=True, help="Filled vertices become samples; there is no refinement then.")
@click.option("--view", type=Numbers(3), default=None, help="x,y,z: direction of sight of a point cloud.")
@click.option("--strict", is_flag=True, help="Refuse a mesh whose faces must be mended to join as a surface.")
@click.option("--truth", type=FilePath(), default=None, help="Known surface, for the report.")
@click.option("--report", type=FilePath(), default=None, help="HTML report with pictures and figures.")
@click.option(
    "--candidates",
    type=click.IntRange(1, 100),
    default=1,
    show_default=True,
    help="Completions to choose from, of this and the next seeds: OUTPUT-1, OUTPUT-2 …; the report shows them together.",
)
@common
def complete(
    scan: Path,
    output: Path | None,
    view: tuple[float, ...] | None,
    strict: bool,
    truth: Path | None,
    report: Path | None,
    **options: Any,
) -> None:
    """Complete what SCAN did not see: its smooth base, and over it the scan's own relief.

    On a plane, cylinder or sphere all of it is completed. The holes of any other scan are filled over its own smoothed surface:
    from a place of the scan that is alike, where there is one, else by coherent pieces of what lies beside them; creases and
    ridges that reach the rim are carried on. Measured vertices come out as they are (in PLY bit for bit). What was made up is
    marked in the PLY's vertex properties measured, source, rotation, error and confidence, and its faces' measured. A textured
    scan keeps its texture; what was filled gets one of its own.
    """
    check_readable(scan)
    if options["holes"] == "list":
        low, high = options["hole_size"] or (0.0, float("inf"))
        surface = intaglio.read_surface(scan, view=view, strict=strict)
        for note in surface.notes:
            click.echo(f"  {note}", err=True)
        for hole in intaglio.list_holes(surface):
            if low <= hole.length <= high:
                click.echo(hole.describe())
        return
    if output is None:
        raise click.UsageError("Missing option '-o' / '--output'.")
    count = options["candidates"]
    outputs = [output] if count == 1 else [output.with_stem(f"{output.stem}-{k}") for k in range(1, count + 1)]
    for file in outputs:
        check_writable(file, inputs=(scan,) if truth is None else (scan, truth))
    known_suffix(output, WRITABLE, "mesh")
    if report is not None:
        check_writable(report, inputs=(scan, *outputs))
        known_suffix(report, (".html", ".htm"), "report")
    known = None if truth is None else intaglio.read_surface(truth)
    surface = intaglio.read_surface(scan, view=view, strict=strict)
    for made in outputs:
        for file in files_beside(surface, made, to_be_filled=True):
            check_writable(file, inputs=(scan,))
    start = time.perf_counter()
    try:
        candidates = _complete(surface, options)
    except (InputError, intaglio.FitError) as error:
        if str(error).partition(" ")[0] in options:
            # About an option, not about the scan.
            raise
        raise type(error)(f"{scan}: {error}") from error
    filled = 0
    for number, (whole, made) in enumerate(zip(candidates, outputs, strict=True)):
        # What the scan and its base said is said once.
        said = whole.notes if number == 0 else [note for note in whole.notes if note not in candidates[0].notes]
        for note in said:
            click.echo(f"  {note}", err=True)
        intaglio.write_surface(whole, made)
        filled = int((~whole.measured).sum())
        seconds = time.perf_counter() - start
        click.echo(f"wrote {made}: {len(whole.vertices) - filled} measured and {filled} filled vertices, {seconds:.1f} s")
    if report is not None and filled == 0:
        click.echo(f"no report: what was missing of {scan} was closed by triangles alone, there is nothing to assess")
    elif report is not None and count > 1:
        intaglio.write_candidates_report(
            candidates,
            report,
            truth=known,
            scan=surface,
            title=f"{scan.name} completed, {count} candidates",
            device=options["device"],
        )
        click.echo(f"wrote {report}")
    elif report is not None:
        whole = candidates[0]
        figures = intaglio.write_relief_report(
            whole, report, truth=known, scan=surface, title=f"{scan.name} completed", device=options["device"]
        )
        for line in figures.lines():
            click.echo(f"  {line}")
        click.echo(f"wrote {report}")


def _complete(surface: intaglio.Surface, options: dict[str, Any]) -> list[intaglio.Surface]:
    """Complete a scan as the command's options say, as often as they say."""
    settings = {name: options[name] for name in _SETTINGS}
    if options["oversample_levels"] is not None:
        if options["oversample"] is not None:
            raise click.UsageError("--oversample-levels says whether and how often to oversample: leave out --[no-]oversample")
        settings["oversample"] = options["oversample_levels"]
    selection = intaglio.Selection(options["selection"], options["tolerance"], options["eta"])
    along_relief = options["frames"] == "relief"
    laid = {name: options[name] for name in _PREPARED} | {"frames": None if along_relief else options["frames"]}
    given = [intaglio.read_surface(one) if isinstance(one, Path) else one for one in options["exemplar"]]
    if len(given) > 1 and any(isinstance(one, tuple) for one in given):
        raise click.UsageError("--exemplar takes a ball alone")
    exemplar = given if len(given) > 1 or isinstance(given[0], intaglio.Surface) else given[0]
    near = chosen_sources(surface, exemplar).near
    with ProgressBar("completing") as bar:
        prepared = intaglio.prepare_relief(surface, near=near, **laid)
        return prepared.candidates(
            options["candidates"],
            intaglio.ReliefSettings(selection=selection, along_relief=along_relief, **settings),
            exemplar=exemplar,
            guides=options["guides"],
            seed=options["seed"],
            memory=click.get_current_context().params["memory"],
            progress=bar.update,
        )
