"""Running the command: how it starts, how it is interrupted, and what it says when it can't go on.

Everything but this module is imported under its protection, since imports take longer than many a command.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
import time
import traceback
import warnings
from contextlib import suppress
from types import FrameType
from typing import Any, NoReturn, TextIO

# Compiled code that does not return gets so long, in seconds, after a signal.
_PATIENCE = 0.12

_said = threading.Lock()


class _Ended(BaseException):
    """A signal that ends the process has come; nothing but cleaning up is to be done."""


def main() -> None:
    """Run the command; errors become one line on stderr and exit status 2, signals one line and 128 and their number."""
    _open_missing_streams()
    signals = _Signals()
    try:
        code = run()
    except _Ended:
        _say_interrupted()
        code = 128 + signals.number
    signals.leave(code)


def run() -> int:
    """Run the command that the process' arguments name, and return its exit status; no file that it reads is replaced."""
    try:
        from intaglio.cli.entry import run_command
        from intaglio.files import guard_inputs

        _warned.clear()
        warnings.showwarning = _show_warning
        guard_inputs()
        try:
            return run_command()
        finally:
            guard_inputs(False)
    except BaseException as error:
        if isinstance(error, _Ended):
            raise
        return _explain(error)


def _explain(error: BaseException) -> int:
    """Say in one line what stopped the command, and return the exit status."""
    if isinstance(error, SystemExit):
        return error.code if isinstance(error.code, int) else 0 if error.code is None else 1
    # What is imported here has been, unless it is what failed.
    kinds = {kind.__name__ for kind in type(error).__mro__}
    if "IntaglioError" in kinds:
        return _stop(str(error))
    if "UsageError" in kinds:
        command = getattr(getattr(error, "ctx", None), "command_path", "intaglio")
        return _stop(f"{error.format_message()} (see {command} --help)")  # type: ignore[attr-defined]
    if "ClickException" in kinds:
        return _stop(error.format_message())  # type: ignore[attr-defined]
    if kinds & {"Abort", "KeyboardInterrupt", "EOFError"}:
        _say_interrupted()
        return 130
    if isinstance(error, MemoryError):
        return _stop(
            "not enough memory; meshes: a larger --spacing, a smaller --window or fewer --rotations; stacks: smaller images"
        )
    if isinstance(error, OSError):
        return _stop(f"{error.filename or 'output'}: {error.strerror or error}")
    if isinstance(error, ValueError) and "INTAGLIO_" in str(error):
        return _stop(str(error))
    if isinstance(error, ImportError):
        return _stop(f"can't start: {error}; install Intaglio again, or give it more memory")
    if os.environ.get("INTAGLIO_VERBOSE", "") not in ("", "0"):
        traceback.print_exception(error)
    _stop(f"defect: {type(error).__name__}: {error}; with INTAGLIO_VERBOSE=1 its traceback is shown, please report it")
    return 1


def _stop(message: str) -> int:
    """Write a message as one line."""
    _write_error("intaglio: " + " ".join(message.split()))
    return 2


def _write_error(line: str) -> None:
    """Write a line to standard error, if there is anybody to read it."""
    with suppress(OSError, ValueError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def _say_interrupted() -> None:
    """Say once that the command was interrupted; not through Python's stream, which the main thread may hold."""
    if _said.acquire(blocking=False):
        with suppress(OSError):
            os.write(2, b"interrupted; no file was left half written\n")


_warned: set[str] = set()


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Show a warning as a line: Intaglio's own for the user, others with the place that they come from."""
    text = " ".join(str(message).split())
    own = category.__name__ == "IntaglioWarning"
    said = f"warning: {text}" if own else f"warning: {text} ({category.__name__}, {os.path.basename(filename)}:{lineno})"
    # A file may be read more than once.
    if said not in _warned:
        _warned.add(said)
        _write_error(said)


class _Signals:
    """The signals that end the command, while it lives.

    A signal raises `_Ended` in the main thread, so that all files that are being written are removed on the way out. Where the
    main thread is in compiled code that does not return soon, a thread removes them and ends the process.
    """

    def __init__(self) -> None:
        self.number = 0
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            # Started by nohup, say, it stays ignored.
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._raise)
        threading.Thread(target=self._watch, daemon=True).start()

    def _raise(self, number: int, _: FrameType | None) -> None:
        first = self.number == 0
        self.number = number
        guard: Any = sys.modules.get("intaglio.files.guard")
        if first and (guard is None or guard.may_end_now()):
            raise _Ended

    def _watch(self) -> None:
        ending = {getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)}
        while True:
            number = self._reader.recv(1)[0]
            if number in ending:
                break
        time.sleep(_PATIENCE)
        guard: Any = sys.modules.get("intaglio.files.guard")
        if guard is not None:
            guard.remove_unfinished()
        _say_interrupted()
        os._exit(128 + number)

    def leave(self, code: int) -> NoReturn:
        """End the process with an exit status; from here on signals are too late."""
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        sys.exit(code)


def _open_missing_streams() -> None:
    """Open what of standard input, output and error is closed, so that no file gets its number; and outlive a closed pipe."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _Unbroken(sys.stdout or open(os.devnull, "w"))  # type: ignore[assignment]  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115


class _Unbroken:
    """A stream whose reader may go away, as `head` does, without ending the work: files are written all the same."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write text, or drop it if nobody reads."""
        try:
            return self._stream.write(text)
        except BrokenPipeError:
            self._let_go()
            return len(text)

    def flush(self) -> None:
        """Hand on what was written, or drop it if nobody reads."""
        try:
            self._stream.flush()
        except BrokenPipeError:
            self._let_go()

    def _let_go(self) -> None:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)
