"""How long something takes, warm."""

from __future__ import annotations

import time


def best(work, times=5):
    """Return the least seconds of several runs, after one to warm up."""
    work()
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return min(seconds)
