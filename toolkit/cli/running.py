"""Running the command: how it starts, how it is interrupted, and what it says when it can't go on.

The work is done in a child of the process that is called, which is forked before anything is imported. A signal ends the child by
an exception, so that it removes what it was writing; if it is in compiled code that doesn't return, its parent ends it, and
removes what it had told it of.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import socket
import sys
import time
import traceback
import warnings
from contextlib import suppress
from types import FrameType
from typing import Any, NoReturn, TextIO

# Seconds that the child has to clean up after a signal, and to put files in their places if it is just doing that.
_PATIENCE, _SETTLING = 0.15, 5.0

# Windows knows no hanging up.
_ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

_warned: set[str] = set()


class _Ended(BaseException):
    """A signal that ends the process has come; nothing but cleaning up is to be done."""


def main() -> None:
    """Run the command; errors become one line on stderr and exit status 2, signals one line and 128 and their number."""
    _open_missing_streams()
    told = _Supervisor().fork() if hasattr(os, "fork") else None
    signals = _Signals()
    try:
        code = run(told)
    except _Ended:
        signals.leave_at_once(told is None)
    except BaseException:
        # Compiled code in between makes other errors of it.
        if signals.number:
            signals.leave_at_once(told is None)
        raise
    if signals.number and code:
        signals.leave_at_once(told is None)
    signals.leave(code)


def run(told: int | None = None) -> int:
    """Run the command that the process' arguments name, and return its exit status; no file that it reads is replaced.

    Parameters
    ----------
    told : int, optional
        File descriptor that is told of files that are being written.
    """
    try:
        from intaglio.cli.entry import run_command
        from intaglio.files import guard_inputs, tell_unfinished
    except Exception as error:
        return _stop(f"can't start: {error}; install Intaglio again, or give it more memory")
    try:
        _warned.clear()
        warnings.showwarning = _show_warning
        guard_inputs()
        tell_unfinished(told)
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
    if isinstance(error, ValueError) and _raised_in(error).startswith(("intaglio.render", "intaglio.kernels")):
        # What stands below the toolkit names its arguments in plain errors.
        return _stop(str(error))
    if isinstance(error, RuntimeError) and "shared library" in str(error):
        return _stop(f"can't start: {error}; give it more memory, or install Intaglio again")
    if os.environ.get("INTAGLIO_VERBOSE", "") not in ("", "0"):
        traceback.print_exception(error)
    _stop(f"defect: {type(error).__name__}: {error}; with INTAGLIO_VERBOSE=1 its traceback is shown, please report it")
    return 1


def _raised_in(error: BaseException) -> str:
    """Return the name of the module that raised an error."""
    module, at = "", error.__traceback__
    while at is not None:
        module, at = str(at.tb_frame.f_globals.get("__name__", "")), at.tb_next
    return module


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
    """Say that the command was interrupted; not through Python's stream, which may be in use."""
    with suppress(OSError):
        os.write(2, b"interrupted; no file was left half written\n")


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
    """The signals that end the command, where the work is done: the first raises `_Ended`, later ones are not needed."""

    def __init__(self) -> None:
        self.number = 0
        for number in _ENDING:
            # Started by nohup, say, it stays ignored.
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._raise)
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)

    def _raise(self, number: int, _: FrameType | None) -> None:
        first = self.number == 0
        self.number = number
        guard: Any = sys.modules.get("intaglio.files.guard")
        if first and (guard is None or guard.may_end_now()):
            raise _Ended

    def leave_at_once(self, say: bool) -> NoReturn:
        """End the process after a signal, when all has been cleaned up: unloading what was imported would take a second."""
        if say:
            _say_interrupted()
        os._exit(128 + self.number)

    def leave(self, code: int) -> NoReturn:
        """End the process with an exit status; from here on signals are too late."""
        for number in _ENDING:
            signal.signal(number, signal.SIG_IGN)
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        sys.exit(code)


class _Supervisor:
    """The process that was called, while its child works: it takes the signals, and ends the child if that doesn't end itself."""

    def __init__(self) -> None:
        self._number = 0
        self._came = 0.0
        self._unfinished: set[str] = set()
        self._made: list[str] = []
        self._settling = False
        self._rest = b""

    def fork(self) -> int:
        """Return, in the child alone, the file descriptor on which it tells what files it is writing."""
        reader, writer = os.pipe()
        # Until each side is ready for them.
        signal.pthread_sigmask(signal.SIG_BLOCK, _ENDING)
        child = os.fork()
        if child == 0:
            os.close(reader)
            if sys.platform == "linux":
                _end_with_parent()
            return writer
        os.close(writer)
        status = self._wait(child, reader)
        self._remove_unfinished()
        if (self._number and status != 0) or status - 128 in _ENDING:
            _say_interrupted()
            status = 128 + (self._number or status - 128)
        elif status < 0:
            name = signal.Signals(-status).name
            _write_error(f"intaglio: was ended by {name}" + (", as where memory runs out" if name == "SIGKILL" else ": a defect"))
            status = 128 - status
        os._exit(status)

    def _wait(self, child: int, reader: int) -> int:
        """Wait for the child, and return its exit status, negative for a signal."""
        awake, wake = socket.socketpair()
        wake.setblocking(False)
        signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda *_: None)
        for number in _ENDING:
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, lambda number, _: self._hand_on(number, child))
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING)
        sources: list[socket.socket | int] = [awake, reader]
        while True:
            done, status = os.waitpid(child, os.WNOHANG)
            if done:
                self._listen(reader)
                return os.waitstatus_to_exitcode(status)
            left = None
            if self._number:
                left = self._came + (_SETTLING if self._settling else _PATIENCE) - time.monotonic()
                if left <= 0:
                    os.kill(child, signal.SIGKILL)
                    left = None
            ready = select.select(sources, [], [], left)[0]
            if awake in ready:
                awake.recv(64)
            if reader in ready and not self._listen(reader):
                sources = [awake]

    def _hand_on(self, number: int, child: int) -> None:
        """Remember a signal, and give it to the child, which has it already only if it came from the keyboard."""
        if not self._number:
            self._number, self._came = number, time.monotonic()
            os.kill(child, number)

    def _listen(self, reader: int) -> bool:
        """Take what the child tells; False when it has gone."""
        more = False
        while select.select([reader], [], [], 0)[0]:
            data = os.read(reader, 65536)
            if not data:
                break
            more = True
            *messages, self._rest = (self._rest + data).split(b"\0")
            for message in messages:
                kind, path = message[:1], os.fsdecode(message[1:])
                if kind in (b"(", b")"):
                    self._settling = kind == b"("
                elif kind == b"/":
                    self._made.append(path)
                elif kind == b"+":
                    self._unfinished.add(path)
                else:
                    self._unfinished.discard(path)
        return more

    def _remove_unfinished(self) -> None:
        for path in self._unfinished:
            if os.path.isdir(path) and not os.path.islink(path):
                shutil.rmtree(path, ignore_errors=True)
            else:
                with suppress(OSError):
                    os.unlink(path)
        if self._number:
            # Folders that were made for the output, inner ones first, as far as they are empty.
            for path in self._made:
                with suppress(OSError):
                    os.rmdir(path)


def _end_with_parent() -> None:
    """Have Linux end this process when its parent is ended by what can't be caught."""
    import ctypes

    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(1, int(signal.SIGKILL), 0, 0, 0)


def _open_missing_streams() -> None:
    """Open what of standard input, output and error is closed, so that no file gets its number; and outlive a closed pipe."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _Unbroken(sys.stdout or open(os.devnull, "w"))  # noqa: SIM115
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
