"""Reports of stacks and of how well the kinds represent them: lines for a terminal, and an HTML page."""

from __future__ import annotations

import html
from collections.abc import Sequence

import numpy as np

from intaglio.arrays import Array, PathLike, Progress
from intaglio.errors import InputError
from intaglio.files import listing, picture_row, table, write_page
from intaglio.photometric.assess import RepresentationReport, assess_representation
from intaglio.photometric.light_positions import tilt_and_slant
from intaglio.photometric.relightable import KINDS
from intaglio.photometric.representation import represent
from intaglio.photometric.stack import PhotometricStack

# For every kind, reconstruction and prediction; None where the stack does not allow it.
Reports = dict[str, tuple[RepresentationReport | None, RepresentationReport | None]]

_COLORS = ("#3b6ea5", "#a5855a")


def polar_plot(lights: Array) -> list[str]:
    """Return a plot of the lights seen from above as lines of text: slant from the centre, tilt counter-clockwise."""
    rows, columns = 17, 35
    canvas = [[" "] * columns for _ in range(rows)]

    def mark(tilt: float, slant: float, sign: str) -> None:
        t, r = np.radians(tilt), slant / 90
        row = round((rows - 1) / 2 * (1 - r * np.sin(t)))
        column = round((columns - 1) / 2 * (1 + r * np.cos(t)))
        canvas[row][column] = sign

    for degrees in range(0, 360, 5):
        mark(degrees, 90, ".")
    for degrees in range(0, 360, 10):
        mark(degrees, 45, ".")
    mark(0, 0, "+")
    for tilt, slant in zip(*tilt_and_slant(lights), strict=True):
        mark(float(tilt), float(slant), "o")
    return ["".join(line).rstrip() for line in canvas]


def assess_kinds(
    stack: PhotometricStack,
    kinds: Sequence[str] = KINDS,
    *,
    leave_one_out: bool = True,
    robust: bool = False,
    device: str | None = None,
    reasons: list[str] | None = None,
    progress: Progress | None = None,
) -> Reports:
    """Return reconstruction and prediction of every kind; None for a kind that the stack's lights don't allow.

    The reasons why a kind is not allowed are appended to ``reasons``, if it is given.

    Raises
    ------
    InputError
        If no kind can be fitted, with the reasons.
    """
    found: Reports = {}
    reasons = [] if reasons is None else reasons
    for number, kind in enumerate(kinds):
        reports: list[RepresentationReport | None] = []
        for left_out in (False, True):
            try:
                wanted = leave_one_out or not left_out
                use = robust and kind in ("gradient", "height")
                reports.append(assess_representation(stack, kind, left_out, robust=use, device=device) if wanted else None)
            except InputError as error:
                if kind not in KINDS:
                    raise
                if f"{kind}: {error}" not in reasons:
                    reasons.append(f"{kind}: {error}")
                reports.append(None)
        found[kind] = reports[0], reports[1]
        if progress is not None:
            progress(number + 1, len(kinds))
    if not any(first for first, _ in found.values()):
        raise InputError("; ".join(reasons) or f"no kinds are given; known: {', '.join(KINDS)}")
    return found


def assessment_lines(found: Reports) -> list[str]:
    """Return the lines of a table: normalised rms error and relative residual, of reconstruction and of leave-one-out."""
    lines = [f"{'kind':<10}{'eta':>8}{'eta, left out':>16}{'residual':>10}{'residual, left out':>20}"]
    for kind, reports in found.items():
        first, second = (("-", "-") if r is None else (_figure_of(r.normalized_rms), _figure_of(r.relative)) for r in reports)
        lines.append(f"{kind:<10}{first[0]:>8}{second[0]:>16}{first[1]:>10}{second[1]:>20}")
    return lines


def write_assessment(
    stack: PhotometricStack,
    path: PathLike,
    *,
    found: Reports | None = None,
    title: str = "Representations of a photometric stack",
    robust: bool = False,
    device: str | None = None,
) -> None:
    """Write one HTML page: table and plots of all kinds, the lights, and photographs beside the kinds' relit images.

    Parameters
    ----------
    stack : PhotometricStack
        Photographs and their lights.
    path : path
        The .html file.
    found : dict, optional
        From `assess_kinds`; default: computed here.
    title : str
        Heading of the page.
    robust : bool
        Fit gradient and height robustly.
    device : str, optional
        Where fits run; default CUDA if there is a GPU, else the CPU.
    """
    found = assess_kinds(stack, robust=robust, device=device) if found is None else found
    rows = []
    for kind, reports in found.items():
        cells = [("-", "-") if r is None else (_figure_of(r.normalized_rms), _figure_of(r.relative)) for r in reports]
        rows.append([kind, *cells[0], *cells[1]])
    names = ["kind", "η", "relative residual", "η, left out", "relative residual, left out"]
    body = [table("Errors", names, rows)]
    body.append(
        "<p>η is the mean over images of rms(relit − original) / std(original); the relative residual is "
        "‖relit − original‖ / ‖original‖. Left out: every image relit from a fit to the others.</p>"
    )
    body.append("<h2>Plots</h2><div class=row>" + _bars(found) + _lights(stack.lights) + _by_slant(found, stack) + "</div>")
    chosen = _examples(stack.lights)
    textures = {
        kind: represent(stack, kind, robust=robust and kind in ("gradient", "height"), device=device)
        for kind, (first, _) in found.items()
        if first is not None
    }
    photographs = {
        k: stack.image(k) if stack.mask is None else np.where(stack.mask[..., None], stack.image(k), 0) for k in chosen
    }
    top = max(float(np.quantile(p, 0.995)) for p in photographs.values()) or 1.0
    for k, original in photographs.items():
        tilt, slant = (float(a) for a in tilt_and_slant(stack.lights[k]))
        pictures = {"photograph": _reduced(original / top)}
        pictures |= {kind: _reduced(texture.relight(stack.lights[k]) / top) for kind, texture in textures.items()}
        body.append(picture_row(f"Tilt {tilt:.0f}°, slant {slant:.0f}°", pictures))
    notes = [note for texture in textures.values() for note in texture.notes]
    if notes or stack.notes:
        body.append(listing("What was chosen", [*stack.notes, *notes]))
    write_page(path, title, body)


def _figure_of(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "-"


def _reduced(image: Array, longest: int = 480) -> Array:
    """Return the image reduced by means over square blocks of pixels, so that the page stays small."""
    step = -(-max(image.shape[:2]) // longest)
    rows, columns = image.shape[0] // step * step, image.shape[1] // step * step
    if step == 1 or rows == 0 or columns == 0:
        return image
    blocks = image[:rows, :columns].reshape(rows // step, step, columns // step, step, -1)
    return np.asarray(blocks.mean(axis=(1, 3)))


def _examples(lights: Array) -> list[int]:
    """Return the images lit nearest to slants of 20, 45 and 70 degrees from the upper left."""
    wanted = [np.array([-np.sin(s) / np.sqrt(2), np.sin(s) / np.sqrt(2), np.cos(s)]) for s in np.radians([20, 45, 70])]
    return list(dict.fromkeys(int(np.argmax(lights @ w)) for w in wanted))


def _bars(found: Reports) -> str:
    """Draw η per kind, reconstruction and prediction side by side."""
    values = {k: [0.0 if r is None else float(np.nan_to_num(r.normalized_rms)) for r in pair] for k, pair in found.items()}
    top = max(max(v) for v in values.values()) or 1.0
    step = 300 / len(values)
    shapes = ""
    for i, (kind, pair) in enumerate(values.items()):
        for j, value in enumerate(pair):
            height = 110 * value / top
            x = 10 + step * (i + 0.1 + 0.4 * j)
            shapes += f'<rect x="{x:.1f}" y="{130 - height:.1f}" width="{0.38 * step:.1f}" height="{height:.1f}" '
            shapes += f'fill="{_COLORS[j]}"><title>{html.escape(kind)}: {value:.3f}</title></rect>'
        shapes += f'<text x="{10 + step * (i + 0.5):.1f}" y="142" text-anchor="middle">{html.escape(kind)}</text>'
    return _figure(shapes + f'<text x="10" y="12">η up to {top:.2f}</text>' + _legend(), "η by kind")


def _lights(lights: Array) -> str:
    """Draw the lights from above."""
    tilt, slant = (np.asarray(a) for a in tilt_and_slant(lights))
    shapes = "".join(
        f'<circle cx="160" cy="72" r="{66 * r / 90:.1f}" fill="none" stroke="#ccc"/>'
        f'<text x="{162 + 66 * r / 90:.1f}" y="76">{r}°</text>'
        for r in (30, 60, 90)
    )
    for t, s in zip(np.radians(tilt), slant, strict=True):
        x, y = 160 + 66 * s / 90 * np.cos(t), 72 - 66 * s / 90 * np.sin(t)
        shapes += f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.2" fill="{_COLORS[0]}"/>'
    return _figure(shapes, f"{len(lights)} lights, slant outwards")


def _by_slant(found: Reports, stack: PhotometricStack) -> str:
    """Draw the errors of the best kind's images against their lights' slants."""
    usable = {k: (b or a) for k, (a, b) in found.items() if (b or a) is not None}
    kind, best = min(usable.items(), key=lambda item: np.inf if item[1] is None else item[1].relative)
    assert best is not None
    _, slant = tilt_and_slant(stack.lights)
    top = max((float(e) for e in best.per_image if np.isfinite(e)), default=0.0) or 1.0
    shapes = '<line x1="10" y1="131" x2="310" y2="131" stroke="#bbb"/>'
    for s, e in zip(slant, best.per_image, strict=True):
        if np.isfinite(e):
            shapes += f'<circle cx="{10 + 300 * s / 90:.1f}" cy="{130 - 110 * e / top:.1f}" r="2.5" fill="{_COLORS[1]}"/>'
    shapes += '<text x="10" y="145">0°</text><text x="310" y="145" text-anchor="end">90°</text>'
    shapes += f'<text x="10" y="12">η up to {top:.2f}</text>'
    return _figure(shapes, f"{kind}: error of an image against the slant of its light")


def _legend() -> str:
    return (
        f'<text x="310" y="12" text-anchor="end" fill="{_COLORS[0]}">reconstructed</text>'
        f'<text x="310" y="25" text-anchor="end" fill="{_COLORS[1]}">left out</text>'
    )


def _figure(shapes: str, label: str) -> str:
    return (
        f'<figure><svg viewBox="0 0 320 165" role="img" aria-label="{html.escape(label)}"><g font-size="10" fill="#555">'
        f'{shapes}<text x="160" y="160" text-anchor="middle">{html.escape(label)}</text></g></svg></figure>'
    )
