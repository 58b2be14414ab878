"""The commands of texture synthesis: synthesize and rank."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from intaglio.arrays import Array
from intaglio.cli.facts import is_texture
from intaglio.cli.options import FilePath, common, grouped, image_size, known_suffix, was_given
from intaglio.cli.photometric import StackReading, spare_inputs, stack_options
from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.files import (
    IMAGE_SUFFIXES,
    READABLE_SUFFIXES,
    check_folder,
    check_readable,
    check_writable,
    read_image,
    read_image_with_type,
    whole_folder,
    write_image,
)
from intaglio.kernels.transfer import encode_srgb
from intaglio.photometric import (
    KINDS,
    STACK_SUFFIXES,
    TEXTURE_SUFFIXES,
    Relightable,
    read_relightable,
    represent,
    write_maps,
    write_relightable,
)
from intaglio.progress import ProgressBar
from intaglio.synthesis import (
    CONTINUATIONS,
    CUTS,
    METRICS,
    THESIS_LIGHTS,
    GrowOptions,
    Match,
    Material,
    QuiltOptions,
    Synthesis,
    WeaveOptions,
    assess_synthesis,
    even_light,
    friedman,
    holds_material,
    multiple_comparison,
    read_material,
    read_ranks,
    read_trials,
    write_ranking_page,
    write_source,
    write_synthesis_report,
)
from intaglio.synthesis import synthesize as synthesize_texture

# Where pixels came from, in a folder of maps or after an image's name.
SOURCE = "source.exr"

# Columns of the plot of mean ranks.
_PLOT = 60

# Options that only one method has.
_METHODS: dict[str, Callable[..., Any]] = {"weave": WeaveOptions, "quilt": QuiltOptions, "grow": GrowOptions}
_OWN = {method: tuple(f.name for f in fields(options)) for method, options in _METHODS.items()}  # type: ignore[arg-type]

# Options that only photographs under known lights have.
_OF_PHOTOGRAPHS = ("kind", "color", "robust", "response", "sphere", "circle", "gray")


def _for_photographs(names: tuple[str, ...]) -> None:
    """Raise `InputError` if one of the options was given for a sample that is not a stack of photographs."""
    for name in names:
        if was_given(name):
            raise InputError(f"--{name} is for photographs under known lights, which the sample is not")


class _Block(click.ParamType):
    """auto, or a number of pixels."""

    name = "block"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | int:
        """Return the word or the number."""
        if value != "auto" and not re.fullmatch("[0-9]{1,6}", str(value)):
            self.fail(f"{value!r} is neither a number of pixels nor auto", param, ctx)
        return "auto" if value == "auto" else int(value)


@dataclass(frozen=True)
class _Representation:
    """How photographs under known lights are represented; see `intaglio.represent`."""

    kind: str
    color: str
    robust: bool


def _chosen_options(method: str, **values: Any) -> WeaveOptions | QuiltOptions | GrowOptions:
    """Return the options of a method; `InputError` if one was given that only another has."""
    for other, names in _OWN.items():
        for name in names:
            if name not in _OWN[method] and was_given(name):
                raise InputError(f"--{name} is for --method {other}")
    return _METHODS[method](**{name: values[name] for name in _OWN[method]})


class _Radius(click.ParamType):
    """auto, none, or a number of pixels."""

    name = "radius"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | float:
        """Return the word or the number."""
        if isinstance(value, float) or value in ("auto", "none"):
            return value
        if not re.fullmatch(r"[0-9]{1,6}(\.[0-9]*)?", str(value)):
            self.fail(f"{value!r} is neither a number of pixels nor auto or none", param, ctx)
        return float(value)


class _Images:
    """Images of one size: values to copy, values to compare, pixels that may be used."""

    def __init__(self, paths: tuple[Path, ...]) -> None:
        self.paths = paths
        self.channels: list[int] = []
        self.bits: list[int] = []
        self.encoded: list[bool] = []
        values: list[Array] = []
        compared: list[Array] = []
        self.opaque: Array | None = None
        for path in paths:
            image, dtype = read_image_with_type(path)
            if dtype.kind == "f" and path.suffix.lower() != ".exr":
                raise InputError(f"{path}: holds floats, which only EXR could hold of the result; convert it to .exr")
            if dtype.kind in "iu" and dtype not in (np.uint8, np.uint16):
                raise InputError(
                    f"{path}: holds {dtype} values; the result has 8 or 16 bits, convert it to one of them or to .exr"
                )
            image = image[:, :, None] if image.ndim == 2 else image
            if image.shape[2] == 2 or not np.isfinite(image).all():
                what = "2 channels; give 1, 3 or 4" if image.shape[2] == 2 else "values that are not finite"
                raise InputError(f"{path}: has {what}")
            if values and image.shape[:2] != values[0].shape[:2]:
                first = values[0].shape
                raise InputError(
                    f"{path}: is {image.shape[1]} x {image.shape[0]} pixels, {paths[0]} is {first[1]} x {first[0]}; "
                    "maps of one material must have one size"
                )
            if image.shape[2] == 4:
                opaque = image[:, :, 3] > 0.5
                self.opaque = opaque if self.opaque is None else self.opaque & opaque
                image = image[:, :, :3]
            self.channels.append(image.shape[2])
            self.bits.append(16 if dtype == np.uint16 else 8)
            self.encoded.append(dtype == np.uint8)
            values.append(image)
            compared.append(encode_srgb(image) if dtype == np.uint8 else image)
        self.values = np.concatenate(values, axis=2)
        self.compared = np.concatenate(compared, axis=2)

    def flatten(self, radius: str | float) -> None:
        """Take uneven light out of a single image; "auto" looks for it in photographs, which have 8 bits."""
        if radius == "none" or (radius == "auto" and (len(self.paths) > 1 or not self.encoded[0])):
            return
        if len(self.paths) > 1:
            raise InputError("--flatten is for one image, or the colours of a material's folder, not for several maps")
        even = _in_even_light(self.paths[0], self.values, radius, self.opaque)
        self.values = even
        self.compared = encode_srgb(even) if self.encoded[0] else even

    def write(self, maps: Array, number: int, path: Path) -> None:
        """Write one image's part of ``maps`` with the bits it had."""
        first = sum(self.channels[:number])
        image = maps[:, :, first : first + self.channels[number]]
        bits = self.bits[number] if path.suffix.lower() in (".png", ".tif", ".tiff") else 8
        write_image(image, path, bits=bits)


@click.command(epilog="Example: intaglio synthesize sample.png -o big.png --size 1024x1024")
@click.argument("samples", nargs=-1, required=True, type=FilePath())
@click.option("-o", "--output", required=True, type=FilePath(), help="Image, texture, or folder for several maps.")
@click.option("--size", required=True, help="WIDTHxHEIGHT in pixels.")
@grouped(
    "representation",
    _Representation,
    click.option("--kind", default="gradient", show_default=True, help=f"Of photographs: one of {', '.join(KINDS)}."),
    click.option("--color", type=click.Choice(["channels", "luminance"]), default="channels", show_default=True),
    click.option("--robust", is_flag=True, help="Of photographs: shadows and highlights don't bend normals (gradient, height)."),
)
@grouped(
    "options",
    _chosen_options,
    click.option(
        "--method",
        type=click.Choice(list(_OWN)),
        default="weave",
        show_default=True,
        help="By coherent pieces, by blocks or by pixels.",
    ),
    click.option("--passes", type=int, default=2, show_default=True, help="weave: matches and votes on each level."),
    click.option("--exact", is_flag=True, help="weave: only copies; pieces are not joined by their differences."),
    click.option(
        "--block", type=_Block(), default="auto", show_default=True, help="weave, quilt: side of a block in pixels, or auto."
    ),
    click.option("--overlap", type=int, default=None, help="quilt: of blocks, in pixels; default a third of the block."),
    click.option("--tolerance", type=float, default=0.1, show_default=True, help="quilt: choose within this share of the best."),
    click.option("--cut", type=click.Choice(CUTS), default="path", show_default=True, help="quilt: boundary between blocks."),
    click.option(
        "--continuation",
        type=click.Choice(CONTINUATIONS),
        default="shortcut",
        show_default=True,
        help="quilt: where the sample itself continues.",
    ),
    click.option("--refine", type=int, default=2, show_default=True, help="quilt: passes that remove seams; 0: none."),
    click.option("--window", type=int, default=2, show_default=True, help="grow: radius of the neighbourhood in pixels."),
    click.option("--levels", type=int, default=None, help="grow: of the pyramid; default by the sample's size."),
    click.option("--exhaustive", type=float, default=1.0, show_default=True, help="grow: share of pixels that are searched for."),
)
@click.option(
    "--flatten",
    type=_Radius(),
    default="auto",
    show_default=True,
    help="Uneven light over a photograph is taken out: auto where it stands out, none, or all broader than RADIUS pixels.",
)
@click.option("--metric", type=click.Choice(METRICS), default="absolute", show_default=True, help="Of differences.")
@click.option("--tileable", is_flag=True, help="The result wraps around without a seam.")
@click.option("--maps", type=FilePath(), default=None, help="Folder for normal, albedo and height maps (PBR).")
@click.option("--report", type=FilePath(), default=None, help="HTML page with pictures and figures.")
@click.option("--source/--no-source", default=True, show_default=True, help="Write where each pixel came from (.source.exr).")
@stack_options
@common
def synthesize(
    samples: tuple[Path, ...],
    output: Path,
    size: str,
    representation: _Representation,
    options: WeaveOptions | QuiltOptions | GrowOptions,
    flatten: str | float,
    metric: str,
    tileable: bool,
    maps: Path | None,
    report: Path | None,
    source: bool,
    reading: StackReading,
    seed: int,
    device: str | None,
) -> None:
    """Make a larger texture of SAMPLES.

    One image gives an image; several images of one size (albedo, normal, displacement, …) are synthesised together, to images
    of the same names in a folder. So is a folder of maps with names as materials have them (wood_Color.png, wood_NormalGL.png,
    wood_Roughness.png, …). A relightable texture (.exr, .ptm), or photographs under known lights (an .lp file, a lights.csv, or
    their folder), give a relightable texture.
    """
    height, width = image_size(size)
    device_or_error(device)
    if report is not None:
        known_suffix(report, (".html", ".htm"), "report")
    first = samples[0]
    for path in samples:
        if not os.path.isdir(path):
            check_readable(path)
    inputs = [*samples, *([reading.mask] if reading.mask is not None else [])]
    packed = len(samples) == 1 and reading.sphere is None and os.path.isdir(first) and holds_material(first)
    several = len(samples) > 1 or packed
    where = (output / SOURCE if several else output.with_name(f"{output.stem}.{SOURCE}")) if source else None
    others = [path for path in (where, report) if path is not None]
    start = time.perf_counter()

    def make(sample: Any, match: Match, usable: Array | None) -> Synthesis:
        with ProgressBar("synthesising") as bar:
            return synthesize_texture(
                sample,
                (height, width),
                options,
                tileable=tileable,
                mask=usable,
                match=match,
                seed=seed,
                device=device,
                progress=bar.update,
            )

    if not several and (os.path.isdir(first) or first.suffix.lower() in STACK_SUFFIXES or is_texture(first)):
        known_suffix(output, TEXTURE_SUFFIXES, "texture")
        if was_given("flatten"):
            raise InputError("--flatten is for images; the lights of these photographs are known")
        _check_outputs([output, *others], inputs)
        if maps is not None:
            check_folder(maps)
        texture, inputs = _read_relightable_sample(first, representation, reading, device)
        _check_outputs([output, *others], inputs)
        spare_inputs(inputs, output, maps)
        given: Any = texture
        compared: Any = texture
        usable = None
        result = make(texture, Match(metric=metric), usable)
        assert result.texture is not None
        write_relightable(result.texture, output)
        written = [output] + (write_maps(result.texture, maps) if maps is not None else [])
    else:
        if maps is not None:
            raise InputError("--maps is for relightable textures and photographs under known lights")
        _for_photographs(_OF_PHOTOGRAPHS)
        images: _Images | Material
        if packed:
            images = _flatten_material(_read_material(first, output), flatten)
            _check_outputs([output / name for name in images.files.values()] + others, inputs)
        else:
            _check_outputs(_image_outputs(samples, output, source) + others, inputs)
            images = _Images(samples)
            images.flatten(flatten)
        given, compared = images.values, images.compared
        usable = _usable_pixels(images, samples, reading.mask)
        result = make(images if isinstance(images, Material) else given, Match(compared, metric=metric), usable)
        if isinstance(images, Material):
            written = images.with_values(result.maps).write(output)
        else:
            written = _write_images(images, result, output)
    if where is not None:
        write_source(result, where)
        written.append(where)
    seconds = time.perf_counter() - start
    for note in result.notes:
        click.echo(f"  {note}", err=True)
    click.echo(f"wrote {', '.join(map(str, written))}: {width} x {height} pixels, {seconds:.1f} s")
    if report is not None:
        lights = THESIS_LIGHTS if isinstance(given, Relightable) else None
        figures = assess_synthesis(compared, result, mask=usable, lights=lights)
        write_synthesis_report(report, given, result, figures, title=f"{first.name}: synthesised", extra=(f"{seconds:.1f} s",))
        for line in figures.lines():
            click.echo(f"  {line}")
        click.echo(f"wrote {report}")


def _read_relightable_sample(
    first: Path, representation: _Representation, reading: StackReading, device: str | None
) -> tuple[Relightable, list[Path]]:
    """Return the relightable sample, and the files it came from."""
    if not os.path.isdir(first) and first.suffix.lower() not in STACK_SUFFIXES:
        _for_photographs((*_OF_PHOTOGRAPHS, "mask"))
        return read_relightable(first), [first]
    stack = reading.read(first)
    with ProgressBar("fitting") as bar:
        texture = represent(stack, **vars(representation), device=device, progress=bar.update)
    for note in texture.notes:
        click.echo(f"  {note}", err=True)
    return texture, reading.inputs(first, stack)


def _read_material(folder: Path, output: Path) -> Material:
    """Return the maps in a folder, and say what was chosen; `InputError` if the output can't be a folder of such maps."""
    if output.suffix.lower() in IMAGE_SUFFIXES:
        raise InputError(f"{output}: a folder of maps gives a folder; give the name of one")
    check_folder(output)
    if output.exists() and output.samefile(folder):
        raise InputError(f"{output}: is the folder of the sample itself; inputs are never overwritten, give another output")
    material = read_material(folder)
    click.echo(f"  {folder}: {', '.join(f'{kind} ({name})' for kind, name in material.files.items())}", err=True)
    for note in material.notes:
        click.echo(f"  {note}", err=True)
    return material


def _flatten_material(material: Material, radius: str | float) -> Material:
    """Return a material whose colours are in even light."""
    if radius == "none" or "color" not in material.maps or (radius == "auto" and material.bits["color"] != 8):
        return material
    color = _in_even_light(Path(material.files["color"]), material.maps["color"], radius, material.opaque)
    return replace(material, maps={**material.maps, "color": color})


def _in_even_light(path: Path, values: Array, radius: str | float, usable: Array | None) -> Array:
    """Return linear values in even light, and say what was taken out; `InputError` with the file's name."""
    try:
        even = even_light(values, radius, mask=usable)
    except InputError as problem:
        raise InputError(f"{path}: {problem}") from problem
    if (even.light != 1).any():
        click.echo(f"  {path.name}: {even.note}", err=True)
    return even.image


def _check_outputs(outputs: list[Path], inputs: list[Path]) -> None:
    """Raise unless all outputs can be written and none is an input; a folder that is yet to be made holds no input."""
    for path in outputs:
        if path.parent.is_dir() or len(outputs) == 1:
            check_writable(path, inputs=tuple(inputs))


def _image_outputs(samples: tuple[Path, ...], output: Path, source: bool) -> list[Path]:
    """Return the images that will be written; `InputError` unless the samples are images and the output fits them."""
    for path in samples:
        if os.path.isdir(path) or path.suffix.lower() in STACK_SUFFIXES:
            raise InputError(f"{path}: photographs under known lights are given alone, not among images")
        known_suffix(path, READABLE_SUFFIXES, "image")
    if len(samples) == 1:
        known_suffix(output, IMAGE_SUFFIXES, "image")
        if not output.parent.is_dir():
            check_writable(output)
        return [output]
    if output.suffix.lower() in IMAGE_SUFFIXES:
        raise InputError(f"{output}: several maps give several images; give a folder")
    check_folder(output)
    names = [_image_name(path) for path in samples]
    if len(set(names)) < len(names):
        raise InputError(f"two of the maps would be written as one file; rename them: {', '.join(map(str, samples))}")
    if source and SOURCE in names:
        raise InputError(f"a map called {SOURCE} would be overwritten by where pixels came from; rename it or give --no-source")
    return [output / name for name in names]


def _image_name(path: Path) -> str:
    """Return the name under which a map is written: its own, but lossless."""
    return path.name if path.suffix.lower() in (".png", ".tif", ".tiff", ".exr") else f"{path.stem}.png"


def _usable_pixels(images: _Images | Material, samples: tuple[Path, ...], mask: Path | None) -> Array | None:
    """Return pixels that may be used: opaque ones, inside the mask."""
    if mask is None:
        if images.opaque is not None and not images.opaque.any():
            raise InputError(f"{', '.join(map(str, samples))}: all transparent, there is nothing to copy")
        return images.opaque
    given = read_image(mask, linear=True)
    given = given[:, :, :3].mean(axis=2) if given.ndim == 3 else given
    if given.shape != images.values.shape[:2]:
        height, width = images.values.shape[:2]
        raise InputError(f"{mask}: is {given.shape[1]} x {given.shape[0]} pixels, the sample is {width} x {height}")
    inside: Array = given > 0.5
    inside = inside if images.opaque is None else inside & images.opaque
    if not inside.any():
        raise InputError(f"{mask}: leaves no pixel of the sample; white marks pixels that may be used")
    return inside


def _write_images(images: _Images, result: Synthesis, output: Path) -> list[Path]:
    if len(images.paths) == 1:
        images.write(result.maps, 0, output)
        return [output]
    names = [_image_name(path) for path in images.paths]
    with whole_folder(output) as beside:
        for number, name in enumerate(names):
            images.write(result.maps, number, beside / name)
    return [output / name for name in names]


@click.command(epilog="Example: intaglio rank study -o page.html, and later: intaglio rank ranks_*.csv")
@click.argument("inputs", nargs=-1, required=True, type=FilePath())
@click.option("-o", "--output", default=None, type=FilePath(), help="Page to write, of a study's folder.")
@click.option("--title", default="Rank the results", show_default=True, help="Of the page.")
@click.option("--alpha", type=float, default=0.01, show_default=True, help="Share of false differences that is accepted.")
@click.option("--methods", default=None, help="Comma-separated columns to compare; default all.")
@common
def rank(
    inputs: tuple[Path, ...],
    output: Path | None,
    title: str,
    alpha: float,
    methods: str | None,
    seed: int,
    device: str | None,
) -> None:
    """Make a page on which people rank results blind, or test the ranks they gave.

    A folder is a study: a folder in it for each texture, with sample.png and a picture per method. Tables (CSV) are ranks, as
    the page saves them: Friedman's test, then every pair of methods.
    """
    if len(inputs) == 1 and os.path.isdir(inputs[0]):
        if output is None:
            raise InputError(f"{inputs[0]}: is a study; give the page to write with -o page.html")
        known_suffix(output, (".html", ".htm"), "page")
        check_writable(output)
        trials = read_trials(inputs[0])
        write_ranking_page(output, trials, title=title, seed=seed)
        count = len(next(iter(trials.values()))[1])
        click.echo(f"wrote {output}: {len(trials)} textures, {count} methods in random order")
        return
    if output is not None:
        if not inputs[0].exists():
            raise InputError(f"{inputs[0]}: no such folder; -o writes the page of a study")
        raise InputError("-o is for the page of a study's folder; ranks are printed")
    if len({path.resolve() for path in inputs}) < len(inputs):
        raise InputError("the same table is given twice: its ranks would count double; give each once")
    wanted = None if methods is None else [m.strip() for m in methods.split(",") if m.strip()]
    names, ranks = read_ranks(inputs, wanted)
    test, pairs = friedman(ranks), multiple_comparison(ranks, alpha)
    click.echo(f"{len(ranks)} rankings of {len(names)} methods")
    click.echo(f"Friedman: chi-squared {test.statistic:.2f}, p {test.pvalue:.2g}")
    order = np.argsort(test.mean_ranks, kind="stable")
    for i in order:
        beats = [names[j] for j in order if pairs.different[i, j] and test.mean_ranks[i] < test.mean_ranks[j]]
        click.echo(f"  {names[i]}: mean rank {test.mean_ranks[i]:.2f}" + (f", better than {', '.join(beats)}" if beats else ""))
    apart = f"more than {pairs.critical_difference:.3f} apart: intervals are disjoint"
    click.echo(f"mean ranks differ at alpha {alpha:g} if they are {apart}")
    for line in _interval_plot([names[i] for i in order], pairs.mean_ranks[order], pairs.intervals[order]):
        click.echo(f"  {line}")


def _interval_plot(names: list[str], means: Array, intervals: Array) -> list[str]:
    """Return mean ranks (o) and their intervals as lines of text, as in the thesis' figure 6.3.1."""
    low, high = float(intervals.min()), float(intervals.max())
    wide = max(map(len, names))

    def column(rank: float) -> int:
        return round((rank - low) / max(high - low, 1e-9) * (_PLOT - 1))

    lines = []
    for name, mean, (start, end) in zip(names, means, intervals, strict=True):
        drawn = [" "] * _PLOT
        drawn[column(start) : column(end) + 1] = "-" * (column(end) + 1 - column(start))
        drawn[column(mean)] = "o"
        lines.append(f"{name:{wide}} {''.join(drawn).rstrip()}")
    return [*lines, f"{'':{wide}} {low:<{_PLOT - 5}.2f}{high:>5.2f}"]
