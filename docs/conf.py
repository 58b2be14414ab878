"""Sphinx configuration: pages of this folder, the reference from docstrings, and tutorials that run as the manual is built."""

import sys
from pathlib import Path

import click
from sphinx.application import Sphinx

import intaglio

sys.path.insert(0, str(Path(__file__).parent))

project = "Intaglio"
version = release = intaglio.__version__
extensions = [
    "myst_parser",
    "numpydoc",
    "run_cells",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx_click",
]
html_theme = "furo"
html_title = f"Intaglio {release}"
templates_path = ["_templates"]
exclude_patterns = ["_templates"]
default_role = "py:obj"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3

autosummary_generate = True
autodoc_typehints = "none"  # numpydoc's sections say the types
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
smartquotes_action = "q"  # two hyphens of an option stay two


def setup(app: Sphinx) -> None:
    """Show the examples of commands as what is typed."""
    app.connect("sphinx-click-process-epilog", _show_example)


def _show_example(app: Sphinx, context: click.Context, lines: list[str]) -> None:
    lines[:] = [part for line in lines for part in _typed(line)]


def _typed(line: str) -> list[str]:
    if not line.startswith("Example: "):
        return [line]
    commands = line.removeprefix("Example: ").split(", and later: ")
    return ["Example:", "", ".. code-block:: sh", "", *(f"   {command}" for command in commands), ""]
