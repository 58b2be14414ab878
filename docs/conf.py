"""Sphinx configuration: the Markdown pages of this folder."""

project = "Intaglio"
extensions = ["myst_parser"]
html_theme = "furo"
exclude_patterns: list[str] = []
