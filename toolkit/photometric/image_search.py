"""Finding the images that a list of lights names: under other paths, cases and types than were written down."""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterable
from pathlib import Path

from intaglio.errors import FileError, InputError
from intaglio.files import READABLE_SUFFIXES

# Files with these names are not photographs of the stack: a mask, a sphere's reference, or maps that were written there.
_NO_IMAGES = ("mask", "ref", "normal", "albedo", "height", "maps")
# Lists name photographs by where they lay on another computer; no more parts of such a path are tried than this.
_MOST_PARTS = 4


def find_images(folder: Path, names: list[str], count: int, source: Path, strict: bool) -> tuple[list[Path], list[str]]:
    """Return a path for each of ``count`` lights, which need not exist, and notes of those that lie elsewhere than named.

    If some images lie where the list says, the others are looked for in their folder, under another case or type; if none
    does, the folders around are looked through for one that holds most of them.

    Parameters
    ----------
    folder : Path
        Folder of the list of lights.
    names : list of str
        As the list has them, with forward slashes; empty if it has none.
    count : int
        Number of lights.
    source : Path
        The list itself, for messages.
    strict : bool
        Take names as they are.

    Raises
    ------
    InputError
        If the numbers of names or images and lights differ.
    """
    if not names:
        return _unnamed_images(folder, count, source), []
    if len(names) != count:
        raise InputError(f"{source}: {count} lights, but {len(names)} images are named")
    paths = [_as_named(folder, name) for name in names]
    lost = [k for k, path in enumerate(paths) if not _exists(path)]
    if not lost or strict:
        return paths, []
    notes: list[str] = []
    found: dict[int, Path] = {}
    for place in _places(folder) if len(lost) == len(paths) else [folder]:
        known = _listing(place)
        here = {k: hit for k in lost if (hit := _look_up(place, names[k], known)) is not None}
        if len(here) > len(found):
            found = here
    if len(lost) == len(paths) and 2 * len(found) < len(paths):
        found = {}
    taken = {path for k, path in enumerate(paths) if k not in found}
    for k, path in found.items():
        # A photograph that another line names is not this one's.
        if path not in taken:
            paths[k] = path
            taken.add(path)
            notes.append(f"{_brief(names[k])} is {os.path.relpath(path, folder)}")
    if len(notes) > 3:
        where = {os.path.relpath(path.parent, folder) for path in found.values()}
        there = ("this folder" if where == {"."} else min(where)) if len(where) == 1 else "other folders"
        notes = [f"{len(notes)} images were found under other names than written, in {there}"]
    return paths, [f"{source.name}: {note}" for note in notes]


def images_of(folder: Path) -> list[Path]:
    """Return the folder's images in natural order (2 before 10), without masks and sphere references."""
    if not folder.is_dir():
        raise FileError(f"{folder}: no such folder")
    images = [
        p
        for p in folder.iterdir()
        if p.suffix.lower() in READABLE_SUFFIXES and p.stem.lower() not in _NO_IMAGES and not p.name.startswith(".")
    ]

    def natural(path: Path) -> list[tuple[int, str]]:
        return [
            (int(part), "") if part.isdecimal() and part.isascii() else (-1, part)
            for part in re.split("([0-9]{1,18})", path.name.lower())
        ]

    return sorted(images, key=natural)


def _unnamed_images(folder: Path, count: int, source: Path) -> list[Path]:
    found = images_of(folder)
    if len(found) > count:
        # Other images in the folder, such as a texture that was written there, are of another type.
        kinds = [p.suffix.lower() for p in found]
        found = [p for p in found if p.suffix.lower() == max(kinds, key=kinds.count)]
    if len(found) == count:
        return found
    below = {d.name.lower(): images_of(d) for d in sorted(folder.iterdir()) if d.is_dir()}
    below = {name: images for name, images in below.items() if len(images) == count}
    if len(below) > 1:
        below = {name: images for name, images in below.items() if name in ("images", "objects")}
    if not found and len(below) == 1:
        return next(iter(below.values()))
    raise InputError(f"{source}: gives {count} lights, but {folder} holds {len(found)} images; name them in an .lp or lights.csv")


def _as_named(folder: Path, name: str) -> Path:
    try:
        return folder / name
    except ValueError:
        return folder / "?"


def _exists(path: Path) -> bool:
    # os.path's is False for names that no file can have, pathlib's raises.
    return os.path.isfile(path)


def _places(folder: Path) -> Iterable[Path]:
    """Return the folders to look in: the list's own, those below it, and those beside it."""
    try:
        below = sorted(d for d in folder.iterdir() if d.is_dir() and not d.name.startswith("."))
        beside = sorted(d for d in folder.resolve().parent.iterdir() if d.is_dir() and not d.name.startswith("."))
    except OSError:
        return [folder]
    return [folder, *below, *(d for d in beside if d != folder.resolve())]


def _listing(place: Path) -> dict[str, list[str]]:
    """Return the images of a folder by their names without suffix, case and way of writing accents."""
    known: dict[str, list[str]] = {}
    try:
        for entry in sorted(os.listdir(place)):
            if Path(entry).suffix.lower() in READABLE_SUFFIXES:
                known.setdefault(_plain(Path(entry).stem), []).append(entry)
    except OSError:
        return {}
    return known


def _look_up(place: Path, name: str, known: dict[str, list[str]]) -> Path | None:
    """Return the image of a folder that a name means, or None if there is none, or more than one that it may be."""
    parts = [part for part in name.split("/") if part not in ("", ".", "..")]
    for skipped in range(max(0, len(parts) - _MOST_PARTS), len(parts) - 1):
        inner = place.joinpath(*parts[skipped:])
        if _exists(inner):
            return inner
    if not parts:
        return None
    same = known.get(_plain(Path(parts[-1]).stem), []) or known.get(_plain(parts[-1]), [])
    exact = [entry for entry in same if _plain(entry) == _plain(parts[-1])]
    chosen = exact or same
    return place / chosen[0] if len(chosen) == 1 else None


def _plain(text: str) -> str:
    return unicodedata.normalize("NFC", text).casefold()


def _brief(name: str) -> str:
    return name if len(name) <= 60 else f"…{name[-59:]}"
