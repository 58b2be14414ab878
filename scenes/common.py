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
from PIL import Image, ImageDraw, ImageFont

from intaglio.files import write_image
from intaglio.kernels.transfer import encode_srgb
from intaglio.mesh import Surface, border_edges
from intaglio.progress import ProgressBar
from intaglio.relief import (
    COMPLETED,
    RELIEF,
    SCAN,
    TRUTH,
    ReliefReport,
    ReliefSettings,
    assess_relief,
    choose_viewpoints,
    largest_filling,
    prepare_relief,
    relief_pictures,
    without_relief,
    write_relief_report,
)
from intaglio.render import Light, Viewpoint, variant, view

Array = np.ndarray


SMOOTH = "Filled smoothly only"
SHEET = (SCAN, COMPLETED, RELIEF, SMOOTH, TRUTH)
# One light for close-ups and turntables: it rakes, and its fill keeps the side that it leaves from turning black.
RAKING = Light(slant=55.0, strength=3.0, fill=0.7)
_PAPER, _INK, _CAPTION = 1.0, 70, 0.05
# A close-up shows nothing that lies further from its middle than so many times what it spans.
_DEEP = 2.5
# Where more than this share was filled it is no hole; normals whose mean is shorter don't point one way.
_MOST_OF_IT, _POINTS_OUT = 0.3, 0.1


def picture_size() -> int:
    """Return rows and columns of pictures: three are 1,680 pixels wide, and fewer where the renderer takes ray by ray."""
    return 560 if variant().vectorized else 280


@dataclass(frozen=True)
class Result:
    """What a scene made."""

    scan: Surface
    whole: Surface
    truth: Surface | None
    report: ReliefReport
    seconds: float
    picture: Path
    close: Path
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
        laid = {name: settings.pop(name) for name in ("base", "spacing", "extent", "holes", "hole_size") if name in settings}
        prepared = prepare_relief(scan, device=args.device, **laid)
        whole = prepared.complete(ReliefSettings(**settings), seed=args.seed, progress=bar.update)
    seconds = time.perf_counter() - start
    for note in whole.notes:
        print(f"  {note}")
    mesh, page, sheet, close = (args.output / f"{name}{suffix}" for suffix in (".ply", ".html", ".png", "_close.png"))
    whole.write(mesh)
    print("rendering …")
    report = assess_relief(whole, truth, device=args.device)
    pictures = relief_pictures(whole, report, scan=scan, truth=truth, size=picture_size())
    timed = (f"completed in {seconds:.2f} s", *extra)
    write_relief_report(whole, page, report=report, pictures=pictures, title=title, extra=timed)
    write_image(contact_sheet(pictures if more is None else {**pictures, **more(whole)}, SHEET), sheet)
    write_image(captioned(close_ups(whole, scan, truth, size=picture_size())), close)
    for line in report.lines():
        print(f"  {line}")
    for line in timed:
        print(f"  {line}")
    print(f"wrote {mesh}, {sheet}, {close} and {page}")
    return Result(scan, whole, truth, report, seconds, sheet, close, page)


def close_camera(whole: Surface, share: float = 2.0) -> Viewpoint:
    """Return a camera close by: over the largest filling where it is a hole, else over the seam, half of it filled.

    ``share`` is the radius that is seen, in radii of the hole.
    """
    inside = largest_filling(whole)
    _, front, up = choose_viewpoints(whole)[0]
    if len(inside) > _MOST_OF_IT * len(whole.vertices):
        # What can give it away is the seam.
        _, front, up = choose_viewpoints(whole)[1]
        known = whole.measured[whole.faces]
        seam = whole.vertices[np.unique(whole.faces[known.any(axis=1) & ~known.all(axis=1)])]
        off = seam - seam.mean(axis=0)
        center = seam[np.argmax(off @ front - 0.5 * np.abs(off @ up))]
        reach = 0.15 * float(np.linalg.norm(np.ptp(whole.vertices[np.unique(whole.faces)], axis=0)))
    else:
        center = whole.vertices[inside].mean(axis=0)
        reach = share * float(np.linalg.norm(whole.vertices[inside] - center, axis=1).max())
        outward = whole.normal[inside].mean(axis=0)
        if np.linalg.norm(outward) > _POINTS_OUT:
            front = outward
    origin = center + reach / np.tan(np.radians(12.5)) * front / np.linalg.norm(front)
    return Viewpoint(tuple(origin), tuple(center), tuple(up))


def close_ups(
    whole: Surface, scan: Surface, truth: Surface | None, *, size: int, camera: Viewpoint | None = None, light: Light = RAKING
) -> dict[str, Array]:
    """Render scan, smooth filling, completion and truth from close by, in clay under one light.

    A smooth filling needs a rim all around: where the filling ends in the open there is none.
    """
    camera = close_camera(whole) if camera is None else camera
    enclosed = bool(whole.measured[border_edges(whole.faces)].all())
    shown = {SCAN: scan, SMOOTH: without_relief(whole) if enclosed else None, "Intaglio": whole, TRUTH: truth}
    return {
        heading: view(part.vertices, part.faces, camera=camera, light=light, size=(size, size))
        for heading, part in ((heading, in_view(s, whole, camera)) for heading, s in shown.items() if s is not None)
    }


def in_view(surface: Surface, whole: Surface, camera: Viewpoint) -> Surface:
    """Return what a camera close to a hole looks at, without what lies behind it; all of a plane, cylinder or sphere."""
    if whole.model is None or whole.model.kind != "smooth":
        return surface
    target = np.asarray(camera.target)
    reach = np.linalg.norm(np.asarray(camera.origin) - target) * np.tan(np.radians(camera.fov / 2))
    return surface.part(np.linalg.norm(surface.vertices - target, axis=1) < _DEEP * reach)


def captioned(pictures: dict[str, Array], columns: int = 2) -> Array:
    """Return linear pictures (H, W, 3) of one size in rows, each under its heading."""
    height, width = next(iter(pictures.values())).shape[:2]
    strip = max(16, int(_CAPTION * height))
    font = ImageFont.load_default(0.7 * strip)
    cells = []
    for heading, picture in pictures.items():
        label = Image.new("L", (width, strip), 255)
        ImageDraw.Draw(label).text((strip // 3, strip // 10), heading, fill=_INK, font=font)
        shown = np.repeat(np.asarray(label, np.float32)[:, :, None] / 255, 3, axis=2)
        cells.append(np.concatenate([shown, picture], axis=0))
    cells += [np.full_like(cells[0], _PAPER)] * (-len(cells) % columns)
    rows = [np.concatenate(cells[at : at + columns], axis=1) for at in range(0, len(cells), columns)]
    return np.concatenate(rows, axis=0)


def write_turntable(
    surfaces: list[Surface], path: Path, *, camera: Viewpoint, axis: Array, angles: Array, size: int = 400, light: Light = RAKING
) -> None:
    """Write an animated WebP of surfaces side by side, seen from a camera that goes round ``axis`` by ``angles`` in radians."""
    target, axis = np.asarray(camera.target), np.asarray(axis) / np.linalg.norm(axis)
    arm = np.asarray(camera.origin) - target
    frames = []
    for angle in angles:
        turned = np.cos(angle) * arm + np.sin(angle) * np.cross(axis, arm) + (1 - np.cos(angle)) * (axis @ arm) * axis
        eye = Viewpoint(tuple(target + turned), camera.target, tuple(axis), camera.fov)
        row = [view(s.vertices, s.faces, camera=eye, light=light, size=(size, size), samples=8) for s in surfaces]
        shown = np.clip(encode_srgb(np.concatenate(row, axis=1)), 0, 1)
        frames.append(Image.fromarray((255 * shown + 0.5).astype(np.uint8)))
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=90, loop=0, quality=78, method=4)


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
