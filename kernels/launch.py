"""Devices, threads, and the one way in which kernels are launched.

Every kernel of this package takes ``start: int`` as its first parameter and works on index ``start + wp.tid()`` of its
leading dimension. On a CPU that lets a launch be split over threads: Warp runs one CPU launch on one thread but releases
Python's lock meanwhile. On CUDA ``start`` is 0 and there is one plain launch. Since every index writes only its own
outputs, results do not depend on how a launch was split.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import shutil
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

# Warp greets with a banner and reports every module that it loads. Where Intaglio is imported, it is as quiet as NumPy instead:
# only warnings and errors are shown. INTAGLIO_VERBOSE=1 asks for the reports, and a level that was set before
# (``warp.config.log_level``, other than Warp's own default) stays as it is.
if wp.config.log_level == wp.LOG_INFO and os.environ.get("INTAGLIO_VERBOSE", "") in ("", "0"):
    wp.config.log_level = wp.LOG_WARNING

# Nanoseconds of work that pay for handing them to a thread.
_WORTH_A_THREAD = 100_000

_pool_lock = threading.Lock()
_pool: ThreadPoolExecutor | None = None
_pool_size = 0
_threads: int | None = None
# ``_worker.now`` is set in the threads of the pool, which must not wait for one another.
_worker = threading.local()
# Warp compiles a module for one thread at a time.
_load_lock = threading.Lock()


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


_start_lock = threading.Lock()
_started = False


def start_warp() -> None:
    """Start Warp, which happens once; later calls return at once.

    This module lowers Warp's log level when it is imported, which silences the banner. One line more, which says that
    there is no NVIDIA driver, is written by compiled code straight to file descriptor 2. Where the driver is indeed missing,
    that descriptor leads to a file for the moment of the start, and all but this line is then passed on.
    """
    global _started
    with _start_lock:
        if _started:
            return
        if wp.config.log_level <= wp.LOG_INFO or _has_cuda_driver():
            _init()
        else:
            _start_without_driver_warning()
        _started = True


def _init() -> None:
    """Start Warp; where its folder of compiled kernels can't be made, with a temporary one."""
    try:
        wp.init()
    except OSError as error:
        folder = tempfile.mkdtemp(prefix="intaglio-kernels-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        problem = f"{error.filename}: {error.strerror}"
        warnings.warn(
            f"no place to keep compiled kernels ({problem}): they are compiled again each time; set WARP_CACHE_PATH", stacklevel=2
        )
        wp.config.kernel_cache_dir = folder
        wp.init()


def _has_cuda_driver() -> bool:
    """Return whether Warp will find the NVIDIA driver's library."""
    for name in ("nvcuda.dll",) if sys.platform == "win32" else ("libcuda.so", "libcuda.so.1"):
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return True
    return False


def _start_without_driver_warning() -> None:
    """Start Warp; pass on what is written to file descriptor 2 meanwhile, except that there is no driver."""
    try:
        saved = os.dup(2)
    except OSError:
        # The process runs without a standard error.
        _init()
        return
    if sys.stderr is not None:
        sys.stderr.flush()
    with tempfile.TemporaryFile() as caught:
        os.dup2(caught.fileno(), 2)
        try:
            _init()
        finally:
            os.dup2(saved, 2)
            os.close(saved)
            caught.seek(0)
            for line in caught.read().splitlines(keepends=True):
                if b"find or load the NVIDIA CUDA driver" not in line:
                    os.write(2, line)


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
    start_warp()
    if device is None:
        return str(wp.get_cuda_device()) if wp.is_cuda_available() else "cpu"
    known = [str(d) for d in wp.get_devices()]
    name = "cuda:0" if device == "cuda" else device
    if name not in known:
        raise ValueError(f"device {device!r} is not available here; available: {', '.join(known)}")
    return name


def upload(data: np.ndarray, dtype: Any, device: str, *, copy: bool = True) -> wp.array:
    """Return ``data`` as an array on ``device``, converted to the numbers that ``dtype`` is made of.

    Parameters
    ----------
    data : array
        Where ``dtype`` is a vector or a matrix, the last axis or axes hold its components.
    dtype : type
        A Warp scalar, vector or matrix type.
    device : str
        From `choose_device`.
    copy : bool
        False: on the CPU the result shares the memory of ``data``, if this holds the right numbers without gaps.
    """
    start_warp()
    number = wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype))
    axes = len(getattr(dtype, "_shape_", ()))
    numbers = np.ascontiguousarray(data, number)
    return wp.array(numbers, dtype=dtype, ndim=numbers.ndim - axes, device=device, copy=copy)


def _run_on_pool(work: Callable[[int], None], items: Sequence[int], count: int) -> list[Future[None]]:
    """Hand all items to the pool of ``count`` threads, which is kept between calls."""
    global _pool, _pool_size
    with _pool_lock:
        if _pool is None or _pool_size != count:
            if _pool is not None:
                # Whoever waits for work in the old pool gets it done: it ends when it has nothing left.
                _pool.shutdown(wait=False)
            _pool = ThreadPoolExecutor(count, thread_name_prefix="intaglio", initializer=_become_worker)
            _pool_size = count
        return [_pool.submit(work, item) for item in items]


def _become_worker() -> None:
    _worker.now = True


def _in_worker() -> bool:
    return getattr(_worker, "now", False)


def run_parallel(work: Callable[[int], None], items: Iterable[int]) -> None:
    """Call ``work(item)`` for every item, over the CPU threads; the first error is raised after all have stopped.

    Within such a call, everything runs on the thread that it runs on already: threads that waited for others of the same pool
    would wait for ever.
    """
    items = list(items)
    if min(threads(), len(items)) <= 1 or _in_worker():
        for item in items:
            work(item)
        return
    futures = _run_on_pool(work, items, threads())
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
    start_warp()
    with _load_lock:
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

    Within `run_parallel` a launch is not split.

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
        start_warp()
        wp.launch(kernel, dim=shape, inputs=[0, *inputs], outputs=list(outputs), device=device)
        return
    load(kernel, device)
    if work is not None:
        grain = int(_WORTH_A_THREAD // max(work, 1)) + 1
    # More parts than threads even out rows of unequal work.
    parts = 1 if threads() == 1 or _in_worker() else min(4 * threads(), max(1, shape[0] // grain))
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


_blas_lock = threading.Lock()
_blas_users = 0
_blas_limits: Any = None
_blas: Any = None


@contextmanager
def single_threaded_blas() -> Iterator[None]:
    """Hold BLAS to one thread, so that products of fixed shape have the same bits whatever the machine's thread count.

    The limit is the whole process': the first of all threads to enter sets it, and the last to leave restores what was there.
    Inner uses are free.
    """
    global _blas, _blas_users, _blas_limits
    from threadpoolctl import ThreadpoolController

    with _blas_lock:
        if _blas_users == 0:
            if _blas is None:
                # This takes milliseconds. NumPy's and SciPy's libraries, which are all that is used, are loaded with Intaglio.
                _blas = ThreadpoolController()
            _take_control_of_blas()
            _blas_limits = _blas.limit(limits=1, user_api="blas")
        _blas_users += 1
    try:
        yield
    finally:
        with _blas_lock:
            _blas_users -= 1
            if _blas_users == 0:
                _take_control_of_blas()
                _blas_limits.restore_original_limits()
                _take_control_of_blas()
                _blas_limits = None


def _take_control_of_blas() -> None:
    """Let any thread set OpenBLAS' limit next: newer versions of threadpoolctl ignore all but the one that set it first."""
    from threadpoolctl import OpenBLASController

    clear = getattr(OpenBLASController, "clear_controlling_thread", None)
    if clear is not None:
        clear(force=True)
