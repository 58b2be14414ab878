"""Devices, threads, and the one way in which kernels are launched.

Every kernel of this package takes ``start: int`` as its first parameter and works on index ``start + wp.tid()`` of its
leading dimension. On a CPU that lets a launch be split over threads: Warp runs one CPU launch on one thread but releases
Python's lock meanwhile. On CUDA ``start`` is 0 and there is one plain launch. Since every index writes only its own
outputs, results do not depend on how a launch was split.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
import warp as wp

# Nanoseconds of work that pay for handing them to a thread.
_WORTH_A_THREAD = 100_000

_lock = threading.Lock()
_pool: ThreadPoolExecutor | None = None
_pool_size = 0
_threads: int | None = None


def threads() -> int:
    """Return how many CPU threads a launch is split over.

    ``set_threads`` decides, else the environment variable ``INTAGLIO_THREADS``, else the cores this process may use.
    """
    if _threads is not None:
        return _threads
    given = os.environ.get("INTAGLIO_THREADS", "")
    if given.isdigit() and int(given) > 0:
        return int(given)
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def set_threads(count: int | None) -> None:
    """Set the number of CPU threads; None returns to the default. Results do not depend on it."""
    global _threads
    if count is not None and count < 1:
        raise ValueError(f"threads must be at least 1, not {count}")
    _threads = count


def start_quietly() -> None:
    """Start Warp without its banner and without the line by which it tells that there is no NVIDIA driver.

    That line is written by compiled code straight to file descriptor 2; anything else written there is passed on. For
    programs, not for libraries: it holds the process' stderr for the moment of the start.
    """
    wp.config.log_level = wp.LOG_ERROR
    sys.stderr.flush()
    saved = os.dup(2)
    with tempfile.TemporaryFile() as caught:
        os.dup2(caught.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            caught.seek(0)
            for line in caught.read().decode(errors="replace").splitlines():
                if "find or load the NVIDIA CUDA driver" not in line:
                    print(line, file=sys.stderr)


def choose_device(device: str | None = None) -> str:
    """Return the alias of the device to work on.

    Parameters
    ----------
    device : str, optional
        ``"cpu"``, ``"cuda:0"``, …; None takes CUDA if there is one, else the CPU.

    Raises
    ------
    ValueError
        If there is no such device; the message lists those there are.
    """
    wp.init()
    if device is None:
        return str(wp.get_cuda_device()) if wp.is_cuda_available() else "cpu"
    known = [str(d) for d in wp.get_devices()]
    name = "cuda:0" if device == "cuda" else device
    if name not in known:
        raise ValueError(f"device {device!r} is not available here; available: {', '.join(known)}")
    return name


def _executor(count: int) -> ThreadPoolExecutor:
    """Return a pool of ``count`` threads, kept between launches."""
    global _pool, _pool_size
    with _lock:
        if _pool is None or _pool_size != count:
            if _pool is not None:
                _pool.shutdown(wait=True)
            _pool, _pool_size = ThreadPoolExecutor(count, thread_name_prefix="intaglio"), count
        return _pool


def run_parallel(work: Callable[[int], None], items: Iterable[int]) -> None:
    """Call ``work(item)`` for every item, over the CPU threads; the first error is raised after all have stopped."""
    items = list(items)
    count = min(threads(), len(items))
    if count <= 1:
        for item in items:
            work(item)
        return
    futures = [_executor(threads()).submit(work, item) for item in items]
    try:
        for future in futures:
            future.result()
    finally:
        for future in futures:
            future.cancel()
        for future in futures:
            if not future.cancelled():
                future.exception()


def split(count: int, parts: int) -> Iterator[tuple[int, int]]:
    """Yield (start, stop) of ``parts`` nearly equal ranges of ``range(count)``, none empty."""
    edges = np.linspace(0, count, max(1, min(parts, count)) + 1).astype(int)
    yield from ((int(a), int(b)) for a, b in pairwise(edges) if b > a)


def load(kernel: wp.Kernel, device: str) -> None:
    """Compile ``kernel``'s module before threads meet at it: compiling is not made for several at once."""
    if device.startswith("cpu"):
        kernel.module.load(device, block_dim=1)
    else:
        kernel.module.load(device)


def launch(
    kernel: wp.Kernel,
    dim: int | Sequence[int],
    inputs: Sequence[object],
    outputs: Sequence[object],
    *,
    device: str,
    grain: int = 64,
    work: float | None = None,
) -> None:
    """Launch ``kernel`` over ``dim``, split over CPU threads along the leading dimension, or once on CUDA.

    Parameters
    ----------
    kernel : wp.Kernel
        Its first parameter must be ``start: int``; ``inputs`` and ``outputs`` follow it.
    dim : int or sequence of int
        Launch dimensions.
    inputs, outputs : sequence
        Kernel arguments after ``start``, in order.
    device : str
        From `choose_device`.
    grain : int
        Fewest leading indices worth a thread of their own.
    work : float, optional
        About how many nanoseconds a leading index takes, in place of ``grain``.
    """
    shape = (dim,) if isinstance(dim, int) else tuple(dim)
    if min(shape) == 0:
        return
    if not device.startswith("cpu"):
        wp.launch(kernel, dim=shape, inputs=[0, *inputs], outputs=list(outputs), device=device)
        return
    load(kernel, device)
    if work is not None:
        grain = int(_WORTH_A_THREAD // max(work, 1)) + 1
    # More parts than threads even out rows of unequal work.
    parts = 1 if threads() == 1 else min(4 * threads(), max(1, shape[0] // grain))
    ranges = list(split(shape[0], parts))

    def part(index: int) -> None:
        start, stop = ranges[index]
        wp.launch(
            kernel,
            dim=(stop - start, *shape[1:]),
            inputs=[start, *inputs],
            outputs=list(outputs),
            device=device,
            record_tape=False,
        )

    run_parallel(part, range(len(ranges)))


_held = threading.local()


@contextmanager
def single_threaded_blas() -> Iterator[None]:
    """Hold BLAS to one thread, so that products of fixed shape have the same bits whatever the machine's thread count.

    Finding the loaded BLAS libraries takes a millisecond: around many small products, hold it once; inner uses are free.
    """
    from threadpoolctl import threadpool_limits

    if getattr(_held, "now", False):
        yield
        return
    _held.now = True
    try:
        with threadpool_limits(limits=1, user_api="blas"):
            yield
    finally:
        _held.now = False
