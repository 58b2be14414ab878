"""What the scenes share: where to write, where real data lies, progress, and the closing report."""

from __future__ import annotations

import argparse
import os
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.files import write_image
from intaglio.mesh import Surface
from intaglio.progress import ProgressBar
from intaglio.relief import (
    COMPLETED,
    RELIEF,
    SCAN,
    TRUTH,
    ReliefReport,
    ReliefSettings,
    assess_relief,
    prepare_relief,
    relief_pictures,
    write_relief_report,
)

Array = np.ndarray


SMOOTH = "Filled smoothly only"
SHEET = (SCAN, COMPLETED, RELIEF, SMOOTH, TRUTH)


@dataclass(frozen=True)
class Result:
    """What a scene made."""

    scan: Surface
    whole: Surface
    report: ReliefReport
    seconds: float
    picture: Path
    page: Path


def data_folder() -> Path:
    """Return the folder of real input: the environment variable INTAGLIO_DATA, else shared/data beside the repository."""
    given = os.environ.get("INTAGLIO_DATA")
    return Path(given) if given else Path(__file__).resolve().parent.parent.parent / "shared" / "data"


def has_data(name: str) -> bool:
    """Return whether the data folder has a file; where it has not, print a line that says what is missing."""
    path = data_folder() / name
    if not path.exists():
        print(f"skipped: {path} is not there; set INTAGLIO_DATA to the folder that holds {name}")
        return False
    return True


def real_data(name: str) -> Path:
    """Return the path of a file of the data folder, or stop the scene with a line that says what is missing."""
    if not has_data(name):
        raise SystemExit(0)
    return data_folder() / name


def main(run: Callable[..., object], description: str | None, names: Iterable[str] = ()) -> None:
    """Read a scene's command line and run the scene; every scene is started by this.

    Parameters
    ----------
    run : callable
        Takes the output folder, the seed and the device as ``args``, and by its keyword ``names`` which of several are chosen.
    description : str
        The scene's docstring.
    names : iterable of str
        What a scene of several has to choose from.
    """
    warnings.formatwarning = lambda message, *_, **__: f"  warning: {message}\n"
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("-o", "--output", type=Path, default=Path("out"), help="folder for pictures, meshes and report")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--device", default=None, help="cpu, cuda:0; default CUDA if there is one")
    several = tuple(names)
    if several:
        chosen = f"which of {', '.join(several)}; default all"
        parser.add_argument("names", nargs="*", metavar="NAME", help=chosen)
    args = parser.parse_args()
    # argparse itself refuses an empty list where it has choices.
    for name in args.names if several else ():
        if name not in several:
            parser.error(f"argument NAME: invalid choice: {name!r} (choose from {', '.join(several)})")
    args.output.mkdir(parents=True, exist_ok=True)
    if several:
        run(args, names=tuple(args.names) or several)
    else:
        run(args)


def run_scene(
    name: str,
    title: str,
    scan: Surface,
    args: argparse.Namespace,
    *,
    truth: Surface | None = None,
    extra: tuple[str, ...] = (),
    more: Callable[[Surface], dict[str, list[Array]]] | None = None,
    **settings: Any,
) -> Result:
    """Complete ``scan``, measure, render before, after and truth, and write mesh, picture and report.

    ``more(whole)`` renders further rows of the picture, under headings of their own.
    """
    print(f"{title}: completing {len(scan.vertices)} scanned vertices …")
    start = time.perf_counter()
    with ProgressBar("growing relief") as bar:
        laid = {name: settings.pop(name) for name in ("base", "spacing", "extent") if name in settings}
        prepared = prepare_relief(scan, device=args.device, **laid)
        whole = prepared.complete(ReliefSettings(**settings), seed=args.seed, progress=bar.update)
    seconds = time.perf_counter() - start
    for note in whole.notes:
        print(f"  {note}")
    mesh, page, sheet = (args.output / f"{name}{suffix}" for suffix in (".ply", ".html", ".png"))
    whole.write(mesh)
    print("rendering …")
    report = assess_relief(whole, truth, device=args.device)
    pictures = relief_pictures(whole, report, scan=scan, truth=truth)
    timed = (f"completed in {seconds:.2f} s", *extra)
    write_relief_report(whole, page, report=report, pictures=pictures, title=title, extra=timed)
    write_image(contact_sheet(pictures if more is None else {**pictures, **more(whole)}, SHEET), sheet)
    for line in report.lines():
        print(f"  {line}")
    for line in timed:
        print(f"  {line}")
    print(f"wrote {mesh}, {sheet} and {page}")
    return Result(scan, whole, report, seconds, sheet, page)


def contact_sheet(pictures: dict[str, list[Array]], headings: tuple[str, ...] = (SCAN, COMPLETED, RELIEF, TRUTH)) -> Array:
    """Return one picture: a row for each heading (scan, completion and truth, where known), a column for each viewpoint."""
    rows = [pictures[heading] for heading in headings if heading in pictures]
    return np.concatenate([np.concatenate(row, axis=1) for row in rows], axis=0)


def side_by_side(images: list[Array]) -> Array:
    """Return pictures (H, W, 1 or 3) in a row, each at its size, at the top of a white strip."""
    tallest = max(image.shape[0] for image in images)
    padded = []
    for image in images:
        color = np.repeat(image, 3, axis=2) if image.shape[2] == 1 else image
        padded.append(np.pad(color, ((0, tallest - len(color) + 4), (0, 4), (0, 0)), constant_values=1.0))
    return np.concatenate(padded, axis=1)


def cut_out(surface: Surface, center: Array, radius: float) -> Surface:
    """Return the largest connected piece of what lies within ``radius`` of ``center``."""
    near = surface.part(np.linalg.norm(surface.vertices - center, axis=1) < radius)
    return largest_piece(near)


def largest_piece(surface: Surface) -> Surface:
    """Return the connected piece with most vertices."""
    from intaglio.mesh import pieces

    _, label = pieces(surface.faces, len(surface.vertices))
    return surface.part(label == np.argmax(np.bincount(label)))
