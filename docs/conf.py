"""Sphinx configuration: pages of this folder, the reference from docstrings, and tutorials that run as the manual is built."""

import os

import intaglio

# Pages are made beside other work, and on machines whose cores are few.
os.environ.setdefault("MPLBACKEND", "agg")

project = "Intaglio"
version = release = intaglio.__version__
extensions = [
    "myst_nb",
    "numpydoc",
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
numpydoc_xref_param_type = False

nb_execution_mode = "cache"
nb_execution_cache_path = os.path.join(os.path.dirname(__file__), "..", "out", "docs-cache")
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True
