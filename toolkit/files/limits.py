"""A limit on memory, held against what the header of a file announces before anything is decoded."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from intaglio.arrays import PathLike
from intaglio.checks import checked_positive
from intaglio.errors import InputError

_GIB = 2**30

# Share of the memory that is available which one input may take; the rest is for the work on it.
_SHARE = 0.5

# Where neither the setting nor the system says anything.
_FALLBACK = 4 * _GIB

_limit: int | None = None


def limit_memory(gib: float | None) -> None:
    """Set how much memory an input may take, for this process.

    Parameters
    ----------
    gib : float or None
        GiB that decoding one input may need. None goes back to the default: the environment variable ``INTAGLIO_MEMORY`` (GiB),
        or half of the memory that is available when a file is read.

    Raises
    ------
    InputError
        If it is not a number above 0.
    """
    global _limit
    _limit = None if gib is None else int(min(checked_positive("memory", gib), 1e9) * _GIB)


def memory_limit() -> int:
    """Return the number of bytes that an input may take now.

    Raises
    ------
    InputError
        If ``INTAGLIO_MEMORY`` is set to something that is not a number above 0.
    """
    if _limit is not None:
        return _limit
    asked = os.environ.get("INTAGLIO_MEMORY", "").strip()
    if asked:
        try:
            number = float(asked)
        except ValueError:
            number = 0.0
        if not 0 < number < float("inf"):
            raise InputError(f"INTAGLIO_MEMORY={asked} is not a number of GiB above 0, such as 8")
        return int(min(number, 1e9) * _GIB)
    return int(_SHARE * _available())


def check_memory(path: PathLike, bytes_needed: float, what: str) -> None:
    """Raise `InputError` if reading a file would take more memory than the limit: called before it is decoded.

    Parameters
    ----------
    path : path
        The file, for the message.
    bytes_needed : float
        What decoding will take at its peak, from the sizes in the file's header.
    what : str
        What is so large, with its size: ``"an image of 40000 x 30000 pixels"``.
    """
    limit = memory_limit()
    if bytes_needed > limit:
        raise InputError(
            f"{path}: {what} needs {_gib(bytes_needed)} of memory, the limit is {_gib(limit)}; "
            "give a smaller one, or raise the limit: --memory GIB, or INTAGLIO_MEMORY"
        )


def _gib(number: float) -> str:
    return f"{number / _GIB:.3g} GiB" if number < 1e6 * _GIB else "over a million GiB"


def _available() -> int:
    """Return the bytes of memory that are free for this process: the machine's, its container's or its own limit."""
    found = [n for n in (_of_machine(), _of_container(), _of_process()) if n is not None]
    return max(min(found), 0) if found else _FALLBACK


def _of_machine() -> int | None:
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError, IndexError):
        pass
    try:
        # What is free says little where files are cached in the rest; half of all is a guess.
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (AttributeError, ValueError, OSError):
        return None


def _of_container() -> int | None:
    """Return what the control group leaves; None without one."""
    for limit, used in (
        ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
        ("/sys/fs/cgroup/memory/memory.limit_in_bytes", "/sys/fs/cgroup/memory/memory.usage_in_bytes"),
    ):
        try:
            return int(Path(limit).read_text()) - int(Path(used).read_text())
        except (OSError, ValueError):
            continue
    return None


def _of_process() -> int | None:
    """Return what a limit on the process's address space (``ulimit -v``) leaves; None without one."""
    if sys.platform == "win32":
        return None
    import resource

    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft == resource.RLIM_INFINITY:
        return None
    try:
        used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, IndexError):
        used = 0
    return soft - used
