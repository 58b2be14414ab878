"""Libraries that speak while they read: hushed, and what they raise told in one line."""

from __future__ import annotations

import contextlib
import ctypes
import io
import logging
import os
import re
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

_lock = threading.RLock()


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
def hushed_streams() -> Iterator[None]:
    """Keep what a library of C or C++ writes to the process's output and errors from the user."""
    with _lock:
        _flush()
        kept = []
        try:
            silent = os.open(os.devnull, os.O_WRONLY)
            for stream in (1, 2):
                kept.append((stream, os.dup(stream)))
                os.dup2(silent, stream)
            os.close(silent)
        except OSError:
            pass  # a process without these streams hears nothing anyway
        try:
            # Bindings print by Python's own streams, what they bind by the process's.
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                yield
        finally:
            _flush()
            for stream, copy in kept:
                os.dup2(copy, stream)
                os.close(copy)


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
    lines = [" ".join(line.split()) for line in str(error).splitlines()]
    text = next((line for line in lines if line), type(error).__name__)
    text = re.sub(r"^\[[\w./-]+:\d+\] ", "", text)
    name = str(path)
    if name:
        for quoted in (f"'{name}'", f'"{name}"', repr(name), name):
            text = text.replace(quoted, "the file")
    if text.startswith("cannot identify image file"):
        return "its header is damaged"
    return text.removeprefix("the file: ")[:300]
