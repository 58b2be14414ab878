"""Pages of reports: one HTML file each, with pictures and plots inside, so that it works offline."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.files.paths import whole_file
from intaglio.kernels.transfer import encode_srgb

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:1040px;margin:2em auto;padding:0 1em;color:#222;background:#fff}
h1{font-size:1.6em;margin-bottom:0}h2{font-size:1.15em;margin:2em 0 .4em;border-bottom:1px solid #ddd}
.row{display:flex;gap:12px;flex-wrap:wrap}.row figure{margin:0;flex:1 1 220px}.row img{width:100%;display:block}
figcaption{font-size:.85em;color:#555}table{border-collapse:collapse}td,th{padding:.25em .9em .25em 0;text-align:left;
border-bottom:1px solid #eee;vertical-align:top}th{font-weight:600}li{margin:.15em 0}svg{max-width:100%}
"""


def write_page(path: PathLike, title: str, body: Sequence[str]) -> None:
    """Write a page with the heading ``title`` and the pieces of HTML in ``body``."""
    page = (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head>'
        f"<body><h1>{html.escape(title)}</h1>{''.join(body)}</body></html>"
    )
    with whole_file(Path(path)) as beside:
        beside.write_bytes(page.encode("utf-8", "replace"))


def picture_row(heading: str, pictures: Mapping[str, Array]) -> str:
    """Return the HTML of a heading and, side by side, linear pictures (H, W, 1 or 3) with their names."""
    figures = "".join(
        f'<figure><img alt="{html.escape(heading)}, {html.escape(name)}" src="{inline_image(image)}">'
        f"<figcaption>{html.escape(name)}</figcaption></figure>"
        for name, image in pictures.items()
    )
    return f"<h2>{html.escape(heading)}</h2><div class=row>{figures}</div>"


def listing(heading: str, lines: Iterable[str]) -> str:
    """Return the HTML of a heading and a list of ``lines``."""
    return f"<h2>{html.escape(heading)}</h2><ul>" + "".join(f"<li>{html.escape(x)}</li>" for x in lines) + "</ul>"


def table(heading: str, names: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return the HTML of a heading and a table with columns ``names``."""
    head = "".join(f"<th>{html.escape(n)}</th>" for n in names)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in row) + "</tr>" for row in rows)
    return f"<h2>{html.escape(heading)}</h2><table><tr>{head}</tr>{body}</table>"


def inline_image(image: Array) -> str:
    """Return a linear picture as a PNG in a data URL."""
    from PIL import Image

    buffer = io.BytesIO()
    plane = image[:, :, 0] if image.ndim == 3 and image.shape[2] == 1 else image
    # Level 9 takes six times as long, for 6 % less.
    Image.fromarray(np.round(encode_srgb(plane) * 255).astype(np.uint8)).save(buffer, "PNG", compress_level=7)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
