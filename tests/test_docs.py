"""The manual: every public name has its place in the reference, and every page in the table of contents."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import intaglio
import intaglio.render

DOCS = Path(__file__).resolve().parent.parent / "docs"


def listed():
    """The names that the reference's tables list, with their module."""
    names = []
    for page in sorted((DOCS / "reference").glob("*.md")):
        text = page.read_text("utf-8")
        module = re.search(r"^\.\. currentmodule:: (\S+)$", text, re.MULTILINE)
        for table in re.findall(r"^\.\. autosummary::\n(?:   :.*\n)*\n((?:   \S+\n)+)", text, re.MULTILINE):
            names += [f"{module.group(1)}.{name}" for name in table.split()]
    return Counter(names)


def test_the_reference_lists_every_public_name_once():
    public = {f"intaglio.{name}" for name in intaglio.__all__ if name != "__version__"}
    public |= {f"intaglio.render.{name}" for name in intaglio.render.__all__}
    found = listed()
    assert set(found) == public
    assert set(found.values()) == {1}


def test_every_page_is_in_a_table_of_contents():
    linked = {DOCS / "index.md"}
    for page in DOCS.rglob("*.md"):
        for tree in re.findall(r"^```\{toctree\}\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL):
            linked |= {page.parent / f"{line}.md" for line in tree.splitlines() if line and not line.startswith(":")}
    assert linked == set(DOCS.rglob("*.md"))
