"""What a run reads and what it leaves behind: inputs that no output may replace, and unfinished files that no end may leave."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from intaglio.arrays import PathLike
from intaglio.errors import FileError

# Files that were read while inputs are guarded, by device and number: whatever name or link leads to one.
_read: set[tuple[int, int]] = set()
_planned: set[tuple[int, int]] = set()
_written: set[tuple[int, int]] = set()
_REFUSED = "{}: is one of the inputs; inputs are never overwritten, give another output"
_guarding = False
_hooked = False

_told: int | None = None
_settling = False
_asked_to_end = False


def guard_inputs(on: bool = True) -> None:
    """From now on refuse to replace any file that this process has read since; ``on=False`` ends that and forgets them.

    Files that Python opens are noticed whoever opens them: a reader, or a library that it calls. Those that compiled code
    opens are noticed by `check_readable`, which every reader calls.
    """
    global _guarding, _hooked
    _guarding = on
    _read.clear()
    _planned.clear()
    _written.clear()
    if on and not _hooked:
        # There is no way to remove a hook; it does nothing while inputs are not guarded.
        sys.addaudithook(_notice)
        _hooked = True


def _notice(event: str, arguments: tuple[Any, ...]) -> None:
    """Remember a file that is opened for reading."""
    if event != "open" or not _guarding:
        return
    path, mode, flags = arguments
    reading = "r" in mode if isinstance(mode, str) else not (isinstance(flags, int) and flags & (os.O_WRONLY | os.O_CREAT))
    if reading and not (isinstance(mode, str) and "+" in mode) and isinstance(path, str | bytes | os.PathLike):
        identity = _identity(os.fsdecode(path))
        if identity is not None:
            _read.add(identity)


def note_read(path: PathLike) -> None:
    """Remember a file as one that is read, or raise `FileError` if it is to be written: before the work, not after it."""
    if _guarding:
        identity = _identity(path)
        if identity is not None:
            _read.add(identity)
            if identity in _planned:
                raise FileError(_REFUSED.format(path))


def note_input(path: PathLike | None) -> None:
    """Remember a file that an input names, whether it is read or not."""
    if path is not None:
        note_read(path)


def note_planned(path: PathLike) -> None:
    """Remember a file that is to be written, if there is one to be replaced."""
    identity = _identity(path) if _guarding else None
    if identity is not None:
        _planned.add(identity)


def forget_read(path: PathLike) -> None:
    """Forget that a file was read."""
    _read.discard(_identity(path) or (-1, -1))


def note_written(path: PathLike) -> None:
    """Remember a file as an output that is finished."""
    identity = _identity(path) if _guarding else None
    if identity is not None:
        _written.add(identity)


def check_not_read(path: PathLike) -> None:
    """Raise `FileError` if writing ``path`` would replace a file that was read, or another output."""
    if _guarding and _identity(path) in _written:
        raise FileError(f"{path}: is another output of this command, just written; give them different names")
    if _guarding and _identity(path) in _read:
        raise FileError(_REFUSED.format(path))


def _identity(path: PathLike) -> tuple[int, int] | None:
    try:
        found = os.stat(path)
    except (OSError, ValueError):
        return None
    return found.st_dev, found.st_ino


def may_end_now() -> bool:
    """Tell whether the process may end at once; else it ends itself as soon as files have been put in their places."""
    global _asked_to_end
    _asked_to_end = _settling
    return not _settling


@contextmanager
def settling() -> Iterator[None]:
    """Let no signal come between the files that are put in their places together."""
    global _settling
    _tell(b"(")
    _settling = True
    try:
        yield
    finally:
        _settling = False
        _tell(b")")
    if _asked_to_end:
        raise KeyboardInterrupt


def tell_unfinished(descriptor: int | None) -> None:
    """From now on write to a file descriptor, for who cleans up after this process, what is begun and ended; None ends that."""
    global _told
    _told = descriptor


def _tell(kind: bytes, path: PathLike = "") -> None:
    if _told is not None:
        with suppress(OSError):
            os.write(_told, kind + os.fsencode(os.path.abspath(path) if path else "") + b"\0")


def tell_made(folder: Path) -> None:
    """Tell who cleans up after this process that a folder is made, which is to go if it stays empty."""
    _tell(b"/", folder)


@contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """Remove a file or folder, which the block makes, at its end if it is still there, whatever the end."""
    _tell(b"+", path)
    try:
        yield path
    finally:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
        _tell(b"-", path)
