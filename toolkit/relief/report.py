"""Reports of completions: one HTML file with pictures, figures and distributions, which works offline."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import checked_arguments, checked_count
from intaglio.errors import InputError
from intaglio.files import check_writable, listing, picture_row, write_page
from intaglio.kernels.transfer import encode_srgb
from intaglio.mesh import Surface
from intaglio.relief.assess import assess_relief
from intaglio.relief.figures import BAND_NAMES, ReliefReport
from intaglio.relief.pictures import (
    choose_viewpoints,
    clay_pictures,
    confidence_pictures,
    difference_pictures,
    fixed_cameras,
    mark_pictured,
    provenance_pictures,
)

SCAN, COMPLETED, TRUTH = "The scan", "Completed", "The truth"
RELIEF = "Completed, relief alone"
_MEASURED, _FILLED = "#a5855a", "#3b6ea5"
_BANDS = ("#3b6ea5", "#7a4fa0", "#b0562f")
# The plot of roughness reaches from a quarter to four times that of the surroundings.
_LEAST_SHOWN, _MOST_SHOWN = 0.25, 4.0


@checked_arguments
def write_relief_report(
    surface: Surface,
    path: PathLike,
    *,
    report: ReliefReport | None = None,
    truth: Surface | None = None,
    title: str = "Relief completion",
    scan: Surface | None = None,
    extra: Sequence[str] = (),
    size: int = 480,
    device: str | None = None,
    pictures: dict[str, list[Array]] | None = None,
) -> ReliefReport:
    """Render a completion, measure it, and write one HTML file.

    Parameters
    ----------
    surface : Surface
        From `complete_relief`.
    path : path
        The .html file. It appears whole, or stays as it was.
    report : ReliefReport, optional
        From `assess_relief`. Default None: computed here.
    truth : Surface, optional
        The known surface, in the same coordinates: it is rendered beside the completion, and the difference from it is shown
        in colour. Default None: not known.
    title : str, optional
        Heading of the page.
    scan : Surface, optional
        The scan before completion, rendered beside it. Default None.
    extra : sequence of str, optional
        Further lines for the list of figures. Default none.
    size : int, optional
        Rows and columns of each picture. Default 480.
    device : str, optional
        Where the assessment is computed, such as "cpu" or "cuda:0". Default None: CUDA if there is a GPU, else the CPU.
    pictures : dict of str to list of (H, W, 3) array, optional
        The pictures, if they have been rendered already; ``scan`` and ``size`` are then not used. Default None: rendered
        here.

    Returns
    -------
    ReliefReport
        The measures that the page shows.

    Raises
    ------
    InputError
        As `assess_relief`.
    FileError
        If the file can't be written.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> x, y = np.meshgrid(np.arange(16.0), np.arange(16.0))
    >>> points = np.column_stack([x.ravel(), y.ravel(), 0.2 * np.sin(x.ravel())])
    >>> sheet = intaglio.surface_from_points(points, direction=(0, 0, -1))
    >>> filled = (np.abs(sheet.vertices[:, :2] - 7.5) < 3).all(axis=1)
    >>> completed = intaglio.Surface(
    ...     vertices=sheet.vertices,
    ...     faces=sheet.faces,
    ...     base=sheet.vertices * [1, 1, 0],
    ...     normal=np.tile([0.0, 0.0, 1.0], (256, 1)),
    ...     measured=~filled,
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = f"{folder}/completed.html"
    ...     report = intaglio.write_relief_report(completed, path, size=16, device="cpu")
    ...     with open(path, encoding="utf-8") as file:
    ...         print(file.read(15))
    <!doctype html>
    >>> report.filled_count
    36
    """
    path = check_writable(path)
    size = checked_count("size", size, 1, 16384)
    report = assess_relief(surface, truth, device=device) if report is None else report
    for name, field in (("displacement", report.displacement), ("filled", report.filled)):
        if len(field) != len(surface.vertices):
            raise InputError(
                f"report belongs to another surface: its {name} has {len(field)} values, not {len(surface.vertices)}"
            )
    if pictures is None:
        pictures = relief_pictures(surface, report, scan=scan, truth=truth, size=size)
    names = [name for name, _, _ in choose_viewpoints(surface)]
    body = [picture_row(heading, dict(zip(names, images, strict=True))) for heading, images in pictures.items()]
    body.append(listing("Figures", [*report.lines(), *extra]))
    if np.isfinite(report.roughness).any():
        body.append(f"<h2>Roughness against the surroundings</h2><div class=row><figure>{_roughness(report)}</figure></div>")
    body.append("<h2>Distributions</h2><div class=row>" + _distributions(report, surface) + "</div>")
    if surface.notes:
        body.append(listing("What was chosen", surface.notes))
    write_page(path, title, body)
    return report


def relief_pictures(
    surface: Surface, report: ReliefReport, *, scan: Surface | None = None, truth: Surface | None = None, size: int = 480
) -> dict[str, list[Array]]:
    """Return the pictures of the report: for every heading a list with one linear picture (size, size, 3) per viewpoint.

    The parameters are those of `write_relief_report`.
    """
    cameras = fixed_cameras(surface, choose_viewpoints(surface))
    shape = (size, size)
    rows: dict[str, list[Array]] = {}
    seen = mark_pictured(surface, surface)
    scan, truth = (None if s is None else s.part(mark_pictured(s, surface)) for s in (scan, truth))
    surface = surface.part(seen)
    if scan is not None:
        rows[SCAN] = clay_pictures(scan, cameras, size=shape)
    rows[COMPLETED] = clay_pictures(surface, cameras, size=shape)
    if surface.color is not None:
        rows[RELIEF] = clay_pictures(surface, cameras, size=shape, color=False)
    rows["Measured (clay) and filled (blue)"] = provenance_pictures(surface, cameras, size=shape)
    if surface.confidence is not None:
        heading = "Confidence of what was filled: red 0, yellow 0.5, green 1"
        rows[heading] = confidence_pictures(surface, surface.confidence, cameras, size=shape)
    if truth is not None:
        rows[TRUTH] = clay_pictures(truth, cameras, size=shape)
    if report.truth is not None:
        spread = 2 * report.std_measured or 1.0
        heading = f"Difference from the truth: blue {-spread:.3g}, white 0, red {spread:+.3g}"
        rows[heading] = difference_pictures(surface, report.truth.difference[seen], cameras, limit=spread, size=shape)
    return rows


def _roughness(report: ReliefReport) -> str:
    """Return a plot of roughness against the surroundings, a line for each band from rim to middle, dashed for the truth."""

    def height(ratio: float) -> float:
        shown = min(max(ratio, _LEAST_SHOWN), _MOST_SHOWN)
        return 10 + 120 * (1 - np.log(shown / _LEAST_SHOWN) / np.log(_MOST_SHOWN / _LEAST_SHOWN))

    across = np.linspace(50, 200, report.roughness.shape[1])
    lines = f'<rect x="30" y="{height(1.25):.1f}" width="190" height="{height(0.8) - height(1.25):.1f}" fill="#eee"/>'
    curves = [(report.roughness, "")]
    if report.truth is not None:
        curves.append((report.truth.roughness, ' stroke-dasharray="3 3" opacity="0.6"'))
    for roughness, style in curves:
        for row, color in zip(roughness, _BANDS, strict=True):
            places = [f"{x:.1f},{height(v):.1f}" for x, v in zip(across, row, strict=True) if np.isfinite(v)]
            lines += f'<polyline fill="none" stroke="{color}" stroke-width="2"{style} points="{" ".join(places)}"/>'
            lines += "".join(
                f'<circle cx="{p.split(",")[0]}" cy="{p.split(",")[1]}" r="3" fill="{color}"{style}/>' for p in places
            )
    for value in (_LEAST_SHOWN, 0.5, 1.0, 2.0, _MOST_SHOWN):
        lines += f'<text x="26" y="{height(value) + 4:.1f}" font-size="11" fill="#555" text-anchor="end">{value:g}</text>'
    for x, name in zip(across, ("rim", "halfway", "middle"), strict=True):
        lines += f'<text x="{x:.1f}" y="148" font-size="11" fill="#555" text-anchor="middle">{name}</text>'
    for row, (name, color) in enumerate(zip(BAND_NAMES, _BANDS, strict=True)):
        lines += f'<text x="232" y="{24 + 14 * row}" font-size="11" fill="{color}">{name} spacings</text>'
    if report.truth is not None:
        lines += '<text x="232" y="66" font-size="11" fill="#555">dashed: the truth</text>'
    return f'<svg viewBox="0 0 340 155" role="img" aria-label="roughness against the surroundings">{lines}</svg>'


def _distributions(report: ReliefReport, surface: Surface) -> str:
    measured = ~report.filled & surface.measured
    parts = [
        _histogram(report.displacement[measured], report.displacement[report.filled], "displacement"),
        _histogram(report.normal_deviation[measured], report.normal_deviation[report.filled], "normal deviation, degrees"),
        _spectrum(report),
    ]
    if surface.color is not None:
        shown = encode_srgb(surface.color)
        for channel, name in enumerate(("red", "green", "blue")):
            parts.append(_histogram(shown[measured, channel], shown[report.filled, channel], f"{name}, display value"))
    return "".join(f"<figure>{p}</figure>" for p in parts)


def _histogram(measured: Array, filled: Array, label: str) -> str:
    both = np.concatenate([measured, filled])
    low, high = np.quantile(both, [0.002, 0.998])
    if not high > low:
        low, high = low - 0.5, high + 0.5
    edges = np.linspace(low, high, 49)
    curves = [np.histogram(v, edges)[0] / max(len(v), 1) for v in (measured, filled)]
    return _plot((edges[:-1] + edges[1:]) / 2, curves, label, f"{low:.3g}", f"{high:.3g}")


def _spectrum(report: ReliefReport) -> str:
    order = np.argsort(-report.wavelength)
    curves = [report.spectrum_measured[order], report.spectrum_filled[order]]
    top = max(float(np.max(c)) for c in curves)
    logs = [np.log10(np.maximum(c, 1e-5 * top)) + 5 - np.log10(top) if top > 0 else c for c in curves]
    x = -np.log(report.wavelength[order])
    return _plot(
        x,
        logs,
        "roughness spectrum, log power against wavelength",
        f"{report.wavelength.max():.3g}",
        f"{report.wavelength.min():.3g}",
    )


def _plot(x: Array, curves: list[Array], label: str, left: str, right: str) -> str:
    top = max(float(c.max()) for c in curves) or 1.0
    lines = ""
    for curve, color in zip(curves, (_MEASURED, _FILLED), strict=True):
        px = 10 + 300 * (x - x.min()) / (np.ptp(x) or 1.0)
        py = 130 - 115 * curve / top
        path = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px, py, strict=True))
        lines += f'<polyline fill="none" stroke="{color}" stroke-width="2" points="{path}"/>'
    return (
        f'<svg viewBox="0 0 320 165" role="img" aria-label="{html.escape(label)}">{lines}'
        f'<line x1="10" y1="131" x2="310" y2="131" stroke="#bbb"/>'
        f'<g font-size="11" fill="#555"><text x="10" y="145">{left}</text>'
        f'<text x="310" y="145" text-anchor="end">{right}</text>'
        f'<text x="160" y="160" text-anchor="middle">{html.escape(label)}</text>'
        f'<text x="310" y="12" text-anchor="end" fill="{_MEASURED}">measured</text>'
        f'<text x="310" y="25" text-anchor="end" fill="{_FILLED}">filled</text></g></svg>'
    )
