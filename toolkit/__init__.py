"""Intaglio completes, synthesises and relights the fine surface texture of real objects."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from intaglio.public import *  # noqa: F403

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """Import a public name, or a room, when it is first asked for: the command answers signals before that."""
    if not name.startswith("_") and find_spec(f"intaglio.{name}") is not None:
        return import_module(f"intaglio.{name}")
    public = import_module("intaglio.public")
    if name == "__all__":
        return [*public.__all__, "__version__"]
    if name not in public.__all__:
        raise AttributeError(f"module 'intaglio' has no attribute {name!r}")
    globals().update({each: getattr(public, each) for each in public.__all__})
    return globals()[name]


def __dir__() -> list[str]:
    return [*import_module("intaglio.public").__all__, "__version__"]
