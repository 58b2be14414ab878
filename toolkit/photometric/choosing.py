"""Which photographs of a list make the stack: those asked for, those that can be used, those that belong."""

from __future__ import annotations

import fnmatch
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import shown
from intaglio.errors import FileError, InputError
from intaglio.photometric.examination import ImageFacts
from intaglio.photometric.light_positions import tilt_and_slant
from intaglio.photometric.stack import checked_lights

# What `read_stack` takes for keep and skip.
Names = str | int | Sequence[str | int]

# Lights less far below the horizon, in degrees, may be raised onto it; and the height they get.
_BELOW = 5.0
_HORIZON = 1e-3
# Lights that differ by less are one.
_SAME = 1e-7
# Fewer photographs than these make no stack, if some had to be left out.
_FEWEST = 3


@dataclass(frozen=True)
class Choice:
    """What the user decides of photographs: those to keep whatever is wrong with them, those to skip, and whether to be strict.

    Attributes
    ----------
    keep, skip : str, int or sequence of them
        Names, patterns such as ``image3*``, or numbers from 0; a text may hold several, with commas between them.
    strict : bool
        Raise an error where a photograph would be left out.
    """

    keep: Names = ()
    skip: Names = ()
    strict: bool = False

    def apply(self, facts: Sequence[ImageFacts], listed: Sequence[str]) -> set[int]:
        """Take out the photographs to skip, and return the numbers of those to keep.

        Raises
        ------
        InputError
            If a name is that of no photograph, or of one that is kept and skipped.
        """
        kept, skipped = (_numbers(name, getattr(self, name), facts, listed) for name in ("keep", "skip"))
        both = sorted(kept & skipped)
        if both:
            raise InputError(f"keep and skip both name {facts[both[0]].name}; give it to one of them")
        for k in skipped:
            facts[k].remark, facts[k].used = "skipped as asked", False
        if not any(one.used for one in facts):
            raise InputError(f"skip leaves none of {len(facts)} photographs; skip fewer")
        return kept


def leave_out(one: ImageFacts, remark: str) -> None:
    """Take a photograph out of the stack, and say why."""
    one.remark, one.used = remark, False


def leave_out_by_list(
    facts: Sequence[ImageFacts], paths: Sequence[Path], kept: set[int], source: Path, strict: bool
) -> list[str]:
    """Take out photographs that are missing, named twice, or without a usable light, and return notes of lights raised.

    Raises
    ------
    FileError
        If a photograph is missing and is to be kept, or any is and ``strict``.
    InputError
        If a light can't be used and its photograph is to be kept, or any is and ``strict``.
    """
    used = [one for one in facts if one.used]
    missing = [one for one in used if not os.path.isfile(paths[one.number])]
    wanted = [one for one in missing if strict or one.number in kept]
    if wanted or len(missing) == len(used):
        listed = ", ".join(str(paths[one.number]) for one in missing[:8])
        listed += f" and {len(missing) - 8} more" if len(missing) > 8 else ""
        raise FileError(f"{source}: {len(missing)} of its {len(facts)} images are missing: {listed}")
    for one in missing:
        leave_out(one, "missing")
    present = [one for one in used if one.used]
    for one in present:
        if not np.isfinite(one.light).all():
            leave_out(one, one.remark or "its light is no direction")
            if strict or one.number in kept:
                raise InputError(f"{source}: {one.name} can't be used: {one.remark}")
    _leave_out_twins(present, paths, kept, source, strict)
    notes = []
    for one in present:
        if one.used and one.light[2] <= 0:
            notes += _treat_low_light(one, kept, strict)
    return notes


def _leave_out_twins(present: Sequence[ImageFacts], paths: Sequence[Path], kept: set[int], source: Path, strict: bool) -> None:
    files: dict[Path, list[ImageFacts]] = {}
    for one in present:
        if one.used:
            files.setdefault(paths[one.number], []).append(one)
    for same in files.values():
        if len(same) == 1:
            continue
        if strict:
            raise InputError(f"{source}: names {same[0].name} more than once; every light has its own image")
        alike = all(np.abs(one.light - same[0].light).max() < _SAME for one in same)
        for one in same[1:] if alike else same:
            if one.number not in kept:
                leave_out(one, "named more than once" if alike else "named more than once, under different lights")
    seen: list[ImageFacts] = []
    for one in present:
        if not one.used:
            continue
        apart = np.abs(lights_of(seen) - one.light).max(axis=1) if seen else np.ones(1)
        if apart.min() >= _SAME or one.number in kept:
            seen.append(one)
            continue
        twin = seen[int(apart.argmin())].name
        if strict:
            raise InputError(f"{source}: {one.name} has the same light as {twin}; skip one of them")
        leave_out(one, f"has the same light as {twin}")


def _treat_low_light(one: ImageFacts, kept: set[int], strict: bool) -> list[str]:
    """Take out a photograph whose light is on or below the horizon; if it is to be kept, raise its light onto it and say so."""
    below = float(tilt_and_slant(one.light)[1]) - 90
    if strict:
        checked_lights(one.light[None], (one.name,))
    if one.number not in kept:
        leave_out(one, f"lit from {below:.2f} degrees below the horizon")
        return []
    if below > _BELOW:
        raise InputError(
            f"{one.name} can't be kept: its light comes from {below:.1f} degrees below the horizon, the most is {_BELOW:g}"
        )
    raised = np.append(one.light[:2] / np.hypot(*one.light[:2]), _HORIZON)
    one.light = raised / np.linalg.norm(raised)
    return [f"kept {one.name} as asked: lit from {below:.2f} degrees below the horizon, its light counts as grazing from it"]


def leave_out_odd(
    facts: Sequence[ImageFacts], kept: set[int], source: Path, strict: bool, disorder: bool
) -> tuple[list[str], list[str]]:
    """Take out photographs that don't belong to the others, and return notes and doubts.

    With ``disorder``, photographs and lights have nothing to do with each other.

    Raises
    ------
    InputError
        If one doesn't belong and ``strict``, or many don't.
    """
    used = [one for one in facts if one.used]
    odd = [one for one in used if one.odd and one.number not in kept]
    doubted = [one for one in used if one.remark and not one.odd]
    many = len(odd) > max(1, len(used) // 4)
    if many or disorder:
        found = "the photographs don't" if disorder else f"{len(odd)} of {len(used)} photographs don't"
        doubt = f"{source.name}: {found} fit their lights and each other; are they listed in another order? All were kept"
        if strict:
            raise InputError(f"{source}: {found} fit their lights and each other; are they listed in another order?")
        return [], [doubt]
    if odd and strict:
        raise InputError(f"{source}: {_listed(odd)}; skip or keep them by name")
    for one in odd:
        one.used = False
    notes = [f"kept {one.name} as asked, though it looks odd: {one.remark}" for one in used if one.odd and one.number in kept]
    return notes, [f"{source.name}: {_listed(doubted)}; kept"] if doubted else []


def check_enough(facts: Sequence[ImageFacts], source: Path) -> None:
    """Raise `InputError` if so many photographs had to be left out that the rest makes no stack."""
    left = sum(one.used for one in facts)
    out = [one for one in facts if not one.used and one.remark != "skipped as asked"]
    if out and (left < _FEWEST or left < len(out)):
        raise InputError(f"{source}: only {left} of {len(facts)} photographs can be used: {_listed(out)}")


def left_out_notes(facts: Iterable[ImageFacts]) -> list[str]:
    """Return a note for every reason for which photographs were left out, with their names."""
    reasons: dict[str, list[str]] = {}
    for one in facts:
        if not one.used:
            reasons.setdefault(one.remark, []).append(one.name)
    return [f"left out {_few(names)}: {reason}" for reason, names in reasons.items()]


def _listed(images: Sequence[ImageFacts]) -> str:
    more = f"; and {len(images) - 3} more" if len(images) > 3 else ""
    return "; ".join(f"{one.name}: {one.remark}" for one in images[:3]) + more


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")


def _numbers(argument: str, given: Names, facts: Sequence[ImageFacts], listed: Sequence[str]) -> set[int]:
    """Return the numbers of the photographs that ``given`` names.

    Raises
    ------
    InputError
        If a word names none, or is neither text nor a whole number.
    """
    words: list[str | int] = []
    for word in _sequence(argument, given):
        if isinstance(word, bool) or not isinstance(word, str | int | np.integer):
            raise InputError(f"{argument} must be names or numbers of photographs, not {shown(word)}")
        if not isinstance(word, str):
            words.append(int(word))
        elif _matches(word, facts, listed):
            words.append(word)
        else:
            words += [part.strip() for part in word.split(",") if part.strip()]
    found: set[int] = set()
    for word in words:
        hits = _matches(word, facts, listed) if isinstance(word, str) else []
        if not hits and str(word).lstrip("-").isdecimal():
            number = int(word) if len(str(word)) < 10 else len(facts)
            hits = [number % len(facts)] if -len(facts) <= number < len(facts) else []
        if not hits:
            raise InputError(
                f"{argument}: no photograph is {shown(word)}; there are {_few([one.name for one in facts])}, numbers from 0"
            )
        found.update(hits)
    return found


def _sequence(argument: str, given: object) -> list[object]:
    if isinstance(given, str | int | np.integer):
        return [given]
    try:
        if not isinstance(given, bytes):
            return list(given)  # type: ignore[call-overload]
    except TypeError:
        pass
    raise InputError(f"{argument} must be names or numbers of photographs, not {shown(given)}")


def _matches(word: str, facts: Sequence[ImageFacts], listed: Sequence[str]) -> list[int]:
    """Return the numbers of the photographs whose name, with or without folder and suffix, fits a pattern."""
    pattern = word.casefold()
    hits = []
    for one in facts:
        names = [one.name, Path(one.name).stem, *(listed[one.number : one.number + 1])]
        if any(name.casefold() == pattern or fnmatch.fnmatchcase(name.casefold(), pattern) for name in names):
            hits.append(one.number)
    return hits


def lights_of(facts: Iterable[ImageFacts]) -> Array:
    """Return the (K, 3) lights of the photographs that are used."""
    return np.array([one.light for one in facts if one.used])
