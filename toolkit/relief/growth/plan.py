"""How the samples are searched, and what is held in memory for it."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from intaglio.randomness import Stream, uniform
from intaglio.relief.ground import Ground
from intaglio.relief.growth.samples import Samples

# Candidates (samples times rotations) up to which every one is compared with "auto".
EXHAUSTIVE_UP_TO = 50_000
# Multiplications that are worth no shortcut: a few seconds.
_SMALL_WORK = 1.5e11
# Below this many the samples would say too little about the relief.
_FEWEST_SAMPLES = 2_000
_GIB = 2**30


@dataclass(frozen=True)
class Plan:
    """What was decided.

    Attributes
    ----------
    approximate : bool
    keep_grids : bool
        Hold located grids of all targets, instead of locating them whenever they are read.
    samples : Samples
        All, or a part that fits.
    notes : tuple of str
    """

    approximate: bool
    keep_grids: bool
    samples: Samples
    notes: tuple[str, ...]


def plan_search(
    ground: Ground, samples: Samples, points: int, rotations: int, search: str, memory: float | None, seed: int
) -> Plan:
    """Decide between exhaustive and approximate search, and make its tables fit.

    Parameters
    ----------
    ground : Ground
    samples : Samples
    points : int
        Values compared per neighbourhood: grid points times channels.
    rotations : int
    search : {"auto", "exhaustive", "approximate"}
        "auto": exhaustive up to 50,000 candidates (samples times rotations), and beyond where it takes seconds only.
    memory : float, optional
        Most memory of the process, in GiB: tables that would go beyond are made in chunks, or samples are thinned.
    seed : int
        Of the thinning.
    """
    count = len(samples.vertex)
    targets = int((~ground.measured).sum())
    candidates = count * rotations
    approximate = search == "approximate"
    if search == "auto":
        approximate = candidates > EXHAUSTIVE_UP_TO and float(candidates) * targets * points > _SMALL_WORK
    notes = [
        f"search: {'approximate' if approximate else 'exhaustive'}, {count} samples, {candidates} candidates for each of "
        f"{targets} targets"
    ]
    if memory is None:
        return Plan(approximate, True, samples, tuple(notes))
    free = memory * _GIB - _resident()
    # What a pass holds at a time whatever the size: chunks of neighbourhoods, costs, votes.
    free -= 32_768 * points * 24 + 6 * len(ground.measured) * 64
    share = 0.5 * max(free, 0.0)
    keep_grids = 12 * targets * points <= share
    # A table of values and one of what is known; compared in full they are held three times more.
    per_sample = points * (9 if approximate else 21)
    if count * per_sample > share and not approximate and search == "auto":
        approximate = True
        per_sample = points * 9
        notes.append("search: approximate, since tables of an exhaustive one would not fit the memory")
    most = max(int(share / per_sample), _FEWEST_SAMPLES)
    if most < count:
        keep = np.sort(np.argsort(uniform(seed, Stream.RELIEF_THINNING, np.arange(count)), kind="stable")[:most])
        samples = samples.part(keep)
        notes.append(f"{most} of {count} samples are compared, as many as fit the memory")
    if not keep_grids:
        notes.append("neighbourhoods of targets are located whenever they are read, so that they need no memory")
    if free < 0 or most == _FEWEST_SAMPLES < count:
        notes.append(f"a memory of {memory:g} GiB is less than the scan itself needs: it is exceeded")
    return Plan(approximate, keep_grids, samples, tuple(notes))


def _resident() -> float:
    """Bytes of memory that the process holds now."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return float(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        # Where there is no /proc: what a program with a scan of ordinary size holds.
        return 0.5 * _GIB
