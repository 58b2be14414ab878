"""What a function does by default, its command does too."""

from __future__ import annotations

import inspect

import pytest

import intaglio
from intaglio.cli.entry import cli
from intaglio.geometry import PatchFit
from intaglio.synthesis import GrowOptions, Match, QuiltOptions

# The command, the function whose options it has, and those of the command that mean something else by that name.
PAIRS = [
    ("complete", intaglio.complete_relief, set()),
    ("complete", intaglio.prepare_relief, set()),
    ("complete", intaglio.ReliefSettings, {"selection"}),
    ("complete", intaglio.Selection, set()),
    ("texture", intaglio.parameterize, set()),
    ("texture", intaglio.combine_photographs, set()),
    ("texture", intaglio.bind_photographs, set()),
    ("restore", intaglio.restore, set()),
    ("extend", intaglio.extend_geometry, set()),
    ("extend", PatchFit, set()),
    ("extend", intaglio.read_geometry_texture, set()),
    ("synthesize", intaglio.quilt, set()),
    ("synthesize", intaglio.grow, {"size"}),
    ("synthesize", QuiltOptions, set()),
    ("synthesize", GrowOptions, set()),
    ("synthesize", Match, set()),
    ("represent", intaglio.represent, set()),
    ("represent", intaglio.read_stack, {"memory"}),
]


def default(param):
    """A flag that is not given is False, an option that may be repeated gives nothing, or the one value that it has."""
    if param.multiple and isinstance(param.default, tuple) and len(param.default) == 1:
        return param.default[0]
    if param.default is None or not isinstance(param.default, str | int | float | bool | tuple):
        return () if param.multiple else False if param.is_flag and param.secondary_opts == [] else None
    return param.default


@pytest.mark.parametrize(("command", "function", "others"), PAIRS)
def test_functions_and_their_commands_have_the_same_defaults(command, function, others):
    options = {param.name: param for param in cli.commands[command].params}
    shared = 0
    for name, param in inspect.signature(function).parameters.items():
        if name in options and name not in others and param.default is not param.empty:
            assert default(options[name]) == param.default, f"{name}: {default(options[name])} by the command"
            shared += 1
    assert shared
