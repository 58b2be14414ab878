"""Sphinx extension: code cells of a page run while it is read, and what they print and plot stands below them.

The cells of one page share their names, as those of a notebook do. A cell that fails stops the build.
"""

from __future__ import annotations

import base64
import contextlib
import io
import time
import traceback
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

logger = logging.getLogger(__name__)


class CodeCell(SphinxDirective):
    """Python code that runs when the manual is built."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Run the code; return it, what it printed, and its figures."""
        import matplotlib

        matplotlib.use("agg")
        import matplotlib.pyplot as plt

        code = "\n".join(self.content)
        names = self.env.temp_data.setdefault("code cells", {"__name__": "__main__"})
        printed = io.StringIO()
        start = time.perf_counter()
        try:
            with contextlib.redirect_stdout(printed):
                exec(compile(code, f"<{self.env.docname}>", "exec"), names)
        except Exception as error:
            where = f"{self.env.docname}, line {self.lineno}"
            raise ExtensionError(f"{where}: a code cell failed\n{traceback.format_exc()}", error) from error
        logger.verbose("%s, line %d: %.1f s", self.env.docname, self.lineno, time.perf_counter() - start)
        shown: list[nodes.Node] = [nodes.literal_block(code, code, language="python")]
        if printed.getvalue():
            shown.append(nodes.literal_block(printed.getvalue(), printed.getvalue(), language="none", classes=["output"]))
        for number in plt.get_fignums():
            stored = io.BytesIO()
            figure = plt.figure(number)
            figure.savefig(stored, dpi=80)
            titles = "; ".join(title for axis in figure.axes if (title := axis.get_title()))
            source = "data:image/png;base64," + base64.b64encode(stored.getvalue()).decode()
            shown.append(nodes.image(uri=source, alt=titles or "figure"))
            plt.close(number)
        return shown


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("code-cell", CodeCell)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
