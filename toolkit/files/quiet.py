"""Libraries that speak while they read: hushed, and what they raise told in one line."""

from __future__ import annotations

import contextlib
import ctypes
import io
import logging
import os
import re
import struct
import sys
import tempfile
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

_lock = threading.RLock()

_SLIPS = (TypeError, AttributeError, LookupError, ArithmeticError, AssertionError, UnicodeError, struct.error)


@contextmanager
def hushed() -> Iterator[None]:
    """Keep the warnings and log lines of image libraries, and NumPy's about overflow, from the user."""
    log = logging.getLogger("tifffile")
    with _lock, warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        before, log.disabled = log.disabled, True
        try:
            yield
        finally:
            log.disabled = before


@contextmanager
def hushed_streams() -> Iterator[list[str]]:
    """Keep what a library of C or C++ writes to the process's output and errors from the user.

    Gives a list that holds, after the block, what was said.
    """
    heard: list[str] = []
    with _lock, tempfile.TemporaryFile() as instead:
        _flush()
        kept = []
        for stream in (1, 2):
            try:
                kept.append((stream, os.dup(stream)))
                os.dup2(instead.fileno(), stream)
            except OSError:
                continue  # a process may have closed its streams; nothing is heard there then
        try:
            # Bindings print by Python's own streams, what they bind by the process's.
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                yield heard
        finally:
            _flush()
            for stream, copy in kept:
                os.dup2(copy, stream)
                os.close(copy)
            instead.seek(0)
            heard.append(instead.read(2000).decode("utf-8", "replace"))


def _flush() -> None:
    """Write out what Python and the C library hold back, so that it goes where it was meant to."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (AttributeError, OSError, ValueError):
            continue
    try:
        ctypes.CDLL(None).fflush(None)
    except (OSError, TypeError, AttributeError):
        return


def reason(error: BaseException, path: object = "") -> str:
    """Return what a library's error says, as a phrase of one line without places in its source or the file's name."""
    if isinstance(error, _SLIPS) or not str(error):
        # The library has stumbled over what it read, and says only how.
        return "its header is damaged"
    text = error.args[0].decode("ascii", "replace") if error.args and isinstance(error.args[0], bytes) else str(error)
    lines = [" ".join(line.split()) for line in text.splitlines()]
    text = next((line for line in lines if line), type(error).__name__)
    if text.startswith("cannot identify image file"):
        return "its header is damaged"
    text = re.sub(r"^\[[\w./-]+:\d+\] ", "", text)
    name = str(path)
    if name:
        for quoted in (f"'{name}'", f'"{name}"', repr(name), name):
            text = text.replace(quoted, "the file")
    return text.removeprefix("the file: ")[:300]
