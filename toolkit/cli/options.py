"""Options and checks that commands share."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np

from intaglio.devices import device_or_error
from intaglio.errors import InputError
from intaglio.files import limit_memory
from intaglio.progress import Stage, be_quiet
from intaglio.relief import read_guides

_ABOVE_0 = click.FloatRange(min=0, min_open=True)


class FilePath(click.Path):
    """The name of a file or folder: never an empty one, which would mean the current folder."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path."""
        if value == "":
            self.fail("the name is empty", param, ctx)
        return super().convert(value, param, ctx)


class Numbers(click.ParamType):
    """Comma-separated numbers."""

    name = "numbers"

    def __init__(self, count: int | None = None) -> None:
        self.count = count

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Return the numbers."""
        try:
            numbers = tuple(float(v) for v in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a list of numbers like 0,0,1", param, ctx)
        if not np.isfinite(numbers).all():
            self.fail(f"{value!r} holds a number that is not finite", param, ctx)
        if self.count is not None and len(numbers) != self.count:
            self.fail(f"{value!r} has {len(numbers)} numbers where {self.count} are needed", param, ctx)
        return numbers


class Extent(click.ParamType):
    """whole, rectangle, holes, or comma-separated numbers."""

    name = "extent"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | tuple[float, ...]:
        """Return the word or the numbers."""
        if value in ("whole", "rectangle", "holes"):
            return str(value)
        numbers: tuple[float, ...] = Numbers().convert(value, param, ctx)
        return numbers


class HoleChoice(click.ParamType):
    """all, largest, every, list, or comma-separated numbers of holes."""

    name = "holes"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | tuple[int, ...]:
        """Return the word or the numbers."""
        if value in ("all", "largest", "every", "list"):
            return str(value)
        try:
            return tuple(int(v) for v in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not all, largest, every, list, or numbers like 1,3", param, ctx)


class ExemplarChoice(click.ParamType):
    """near, all, a file, or four comma-separated numbers: a ball's centre and radius."""

    name = "exemplar"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | Path | tuple[float, ...]:
        """Return the word, the file's name or the numbers."""
        if value in ("near", "all"):
            return str(value)
        # A name without commas, or of a file that is there.
        if "," not in str(value) or Path(value).exists():
            return Path(value)
        return Numbers(4).convert(value, param, ctx)


class GuidesChoice(click.ParamType):
    """auto, none, or a file of polylines."""

    name = "guides"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | list[np.ndarray]:
        """Return the word or the polylines."""
        if isinstance(value, list) or value in ("auto", "none"):
            return value
        return read_guides(value)


class SymmetryChoice(click.ParamType):
    """auto, none, or four or seven comma-separated numbers: a mirror plane, or an axis and how many turns make a circle."""

    name = "symmetry"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str | tuple[float, ...]:
        """Return the word or the numbers."""
        if isinstance(value, tuple) or value in ("auto", "none"):
            return value
        if "," not in str(value):
            self.fail(f"{value!r} is neither auto nor none, nor four or seven numbers like 1,0,0,2.5", param, ctx)
        return Numbers().convert(value, param, ctx)


def grouped(name: str, make: Callable[..., Any], *options: Callable[..., Any]) -> Callable[..., Any]:
    """Add options to a command, which gets what ``make`` makes of their values as one argument ``name``.

    Parameters
    ----------
    name : str
        Argument of the command.
    make : callable
        Called with the values of the options by keyword: a class of settings, or ``dict`` for those that are handed on.
    options : decorators from `click.option`
        In the order in which the help lists them.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        names: list[str] = []

        @functools.wraps(command)
        def collect(*args: Any, **values: Any) -> Any:
            group = make(**{option: values.pop(option) for option in names})
            return command(*args, **{name: group}, **values)

        known = vars(collect).setdefault("__click_params__", [])
        before = len(known)
        for option in reversed(options):
            option(collect)
        names.extend(param.name for param in known[before:])
        return collect

    return decorate


def _by_option(message: str, command: click.Command) -> str:
    """Return a message that begins with an argument's name with the option's in its place, as the user wrote it."""
    name, space, rest = message.partition(" ")
    options = {param.name for param in command.params if isinstance(param, click.Option)}
    return f"--{name.replace('_', '-')}{space}{rest}" if name in options else message


def common(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that every command has; --quiet and --memory are obeyed here, and long work says so."""

    @functools.wraps(command)
    def start(*args: Any, quiet: bool, memory: float | None, **values: Any) -> Any:
        be_quiet(quiet)
        limit_memory(memory)
        context = click.get_current_context()
        with Stage(context.command_path.removeprefix("intaglio ")):
            try:
                return command(*args, **values)
            except InputError as error:
                raise InputError(_by_option(str(error), context.command)) from error

    for option in (
        click.option("--quiet", is_flag=True, help="Show no progress."),
        click.option(
            "--memory", type=_ABOVE_0, default=None, help="Most memory for inputs, in GiB; default half of what is free."
        ),
        click.option("--device", default=None, help="cpu, cuda:0, …; default: CUDA if there is one."),
        click.option("--seed", type=int, default=0, show_default=True, help="The same seed gives the same bits."),
    ):
        start = option(start)
    return start


def was_given(name: str) -> bool:
    """Return whether the user gave an option, rather than left it at its default."""
    return click.get_current_context().get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


def known_suffix(path: Path, known: tuple[str, ...], what: str) -> None:
    """Raise `InputError` unless the suffix is known."""
    if path.suffix.lower() not in known:
        raise InputError(f"{path}: unknown {what} type {path.suffix!r}; known: {', '.join(known)}")


def image_size(text: str) -> tuple[int, int]:
    """Return the rows and columns that WIDTHxHEIGHT means."""
    try:
        width, height = (int(v) for v in text.lower().split("x"))
    except ValueError:
        raise InputError(f"--size {text!r} is not WIDTHxHEIGHT, such as 800x600") from None
    if not (1 <= width <= 16384 and 1 <= height <= 16384):
        raise InputError(f"--size {text!r}: width and height must be from 1 to 16384 pixels")
    return height, width


def render_on(device: str | None) -> None:
    """Have the renderer use the device that was asked for, as far as it can."""
    from intaglio.render import usable_llvm, variant

    if device is None:
        return
    on_cpu = device_or_error(device) == "cpu"
    if on_cpu and variant().name.startswith("cuda"):
        os.environ["INTAGLIO_VARIANT"] = "llvm_ad_rgb" if usable_llvm()[0] else "scalar_rgb"
        variant.cache_clear()
    if not on_cpu and not variant().name.startswith("cuda"):
        raise InputError(f"--device {device}: the renderer has no CUDA here, it uses {variant().name}")
