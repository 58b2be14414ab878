"""What the command line and the scenes show of long work: a bar on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
import threading
import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

# Seconds until a bar is shown, until a line says that work goes on, and from one such line to the next.
_BAR_AFTER, _LINE_AFTER, _LINE_EVERY = 1.0, 2.0, 30.0

_quiet = False
# Stages that have said that they are at work, innermost last; only the innermost says how far it is.
_stages: list[Stage] = []


def be_quiet(quiet: bool = True) -> None:
    """Show nothing of the progress of work from now on, or again."""
    global _quiet
    _quiet = quiet


class Stage:
    """A part of the work that says so where it takes longer than two seconds and there is no terminal to show a bar on.

    It writes a line to stderr when it has taken that long, one every half minute with how far it is, and one with its seconds
    at the end. A context that ends it.

    Parameters
    ----------
    label : str
        What is being done.
    """

    def __init__(self, label: str) -> None:
        self.label = label
        self._start = time.perf_counter()
        self._done = threading.Event()
        self._far: tuple[int, int] | None = None
        self._said = False
        self._thread: threading.Thread | None = None

    def __enter__(self) -> Stage:
        _stages.append(self)
        if not (_quiet or Console(stderr=True).is_terminal):
            self._thread = threading.Thread(target=self._tell, daemon=True)
            self._thread.start()
        return self

    def __exit__(self, *problem: object) -> None:
        _stages.remove(self)
        self._done.set()
        if self._thread is not None:
            self._thread.join()
        if self._said and problem[0] is None:
            self._write(f"{self.label}: {time.perf_counter() - self._start:.1f} s")

    def update(self, done: int, total: int) -> None:
        """Note that ``done`` of ``total`` is done."""
        self._far = (done, total)

    def _tell(self) -> None:
        wait = _LINE_AFTER
        while not self._done.wait(wait):
            if _stages and _stages[-1] is self:
                far = "" if self._far is None or not self._said else f" {self._far[0]} of {self._far[1]}"
                self._write(f"{self.label} …{far}")
                self._said = True
            wait = _LINE_EVERY

    def _write(self, line: str) -> None:
        sys.stderr.write(f"  {line}\n")
        sys.stderr.flush()


class ProgressBar(Stage):
    """A bar on stderr, shown on a terminal once the work has taken a second; elsewhere lines. A context that closes it.

    Parameters
    ----------
    label : str
        What is being done.
    """

    def __init__(self, label: str) -> None:
        super().__init__(label)
        console = Console(stderr=True)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns, console=console, transient=True, disable=_quiet or not console.is_terminal)
        self._task = self._bar.add_task(label, total=None)
        self._shown = False

    def __enter__(self) -> ProgressBar:
        super().__enter__()
        return self

    def __exit__(self, *problem: object) -> None:
        if self._shown:
            self._bar.stop()
        super().__exit__(*problem)

    def update(self, done: int, total: int) -> None:
        """Show ``done`` of ``total``."""
        super().update(done, total)
        if not self._shown and time.perf_counter() - self._start > _BAR_AFTER:
            self._bar.start()
            self._shown = True
        self._bar.update(self._task, completed=done, total=total)
