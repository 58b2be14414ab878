"""Several completions of one scan side by side, so that a person chooses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from intaglio.arrays import PathLike
from intaglio.checks import checked_arguments, checked_count
from intaglio.errors import InputError
from intaglio.files import check_writable, listing, picture_row, table, write_page
from intaglio.mesh import Surface
from intaglio.relief.assess import assess_relief
from intaglio.relief.figures import ReliefReport
from intaglio.relief.pictures import choose_viewpoints, clay_pictures, fixed_cameras, mark_pictured
from intaglio.relief.report import SCAN, TRUTH


@checked_arguments
def write_candidates_report(
    candidates: Sequence[Surface],
    path: PathLike,
    *,
    truth: Surface | None = None,
    title: str = "Candidates",
    scan: Surface | None = None,
    size: int = 480,
    device: str | None = None,
) -> list[ReliefReport]:
    """Render several completions side by side, measure each, and write one HTML file.

    Parameters
    ----------
    candidates : sequence of Surface
        From `PreparedRelief.candidates`: completions of one scan.
    path : path
        The .html file. It appears whole, or stays as it was.
    truth, title, scan, size, device : optional
        As in `write_relief_report`.

    Returns
    -------
    list of ReliefReport
        The measures of each.

    Raises
    ------
    InputError
        As `assess_relief`; for no candidates, or some of different scans.
    FileError
        If the file can't be written.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import intaglio
    >>> x, y = np.meshgrid(np.arange(24.0), np.arange(24.0))
    >>> points = np.stack([x, y, 0.4 * np.sin(x)], axis=-1)
    >>> points[9:13, 9:13] = np.nan
    >>> scan = intaglio.surface_from_range_image(points, view=(12, 12, 100))
    >>> prepared = intaglio.prepare_relief(scan, "plane", extent="holes", device="cpu")
    >>> two = prepared.candidates(2, intaglio.ReliefSettings(window=3))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     reports = intaglio.write_candidates_report(two, f"{folder}/both.html", size=16, device="cpu")
    >>> [report.filled_count for report in reports]
    [16, 16]
    """
    path = check_writable(path)
    size = checked_count("size", size, 1, 16384)
    if len(candidates) == 0:
        raise InputError("candidates holds no surface")
    first = candidates[0]
    for number, candidate in enumerate(candidates, 1):
        if not np.array_equal(candidate.vertices[candidate.measured], first.vertices[first.measured]):
            raise InputError(f"candidate {number} completes another scan than candidate 1: their measured vertices differ")
    reports = [assess_relief(candidate, truth, device=device) for candidate in candidates]
    views = choose_viewpoints(first)
    cameras = fixed_cameras(first, views)
    shown = {SCAN: scan} | {f"Candidate {n}": c for n, c in enumerate(candidates, 1)} | {TRUTH: truth}
    pictures = {
        name: clay_pictures(s.part(mark_pictured(s, first)), cameras, size=(size, size))
        for name, s in shown.items()
        if s is not None
    }
    body = [
        picture_row(view, {name: images[number] for name, images in pictures.items()})
        for number, (view, _, _) in enumerate(views)
    ]
    names = ["candidate", "roughness, rim to middle", "coherence", "local sources", "confidence"]
    rows = [
        [str(n), _roughness(r), _share(r.coherence), _share(r.local_share), _number(r.confidence)]
        for n, r in enumerate(reports, 1)
    ]
    if truth is not None:
        names.append("rms from the truth")
        rows = [[*row, "–" if r.truth is None else f"{r.truth.rms:.4g}"] for row, r in zip(rows, reports, strict=True)]
    body.append(table("Figures", names, rows))
    for number, candidate in enumerate(candidates, 1):
        body.append(listing(f"Candidate {number}: what was chosen", candidate.notes[-4:]))
    write_page(path, title, body)
    return reports


def _roughness(report: ReliefReport) -> str:
    """Return the roughness against the surroundings, band by band."""
    return " · ".join(" ".join(_number(value) for value in row) for row in report.roughness)


def _share(value: float) -> str:
    return f"{value:.0%}" if np.isfinite(value) else "–"


def _number(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "–"
