"""Threads, limits and output of launches."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import numpy as np
import pytest
import warp as wp
from threadpoolctl import threadpool_info, threadpool_limits

from intaglio.kernels.launch import launch, run_parallel, set_threads, single_threaded_blas, upload

# Far longer than any of this takes: a deadlock fails the test instead of holding it up.
PATIENCE = 60


@wp.kernel
def thread_kernel(start: int, out: wp.array2d[wp.int32]):
    """Write the first index of the launch's part."""
    i, j = wp.tid()
    out[start + i, j] = start


@pytest.fixture
def two_threads():
    set_threads(2)
    yield
    set_threads(None)


def finishes(work):
    """Run ``work`` on a thread of its own, and return its result or raise its error, or fail if it does not end."""
    outcome = []

    def run():
        try:
            outcome.append((work(), None))
        except Exception as error:
            outcome.append((None, error))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    assert not thread.is_alive(), "deadlock"
    value, error = outcome[0]
    if error is not None:
        raise error
    return value


def test_nested_calls_do_not_wait_for_each_other(two_threads):
    done = np.zeros((6, 5, 4), int)

    def outer(i):
        def middle(j):
            def inner(k):
                done[i, j, k] += 1

            run_parallel(inner, range(4))

        run_parallel(middle, range(5))

    finishes(lambda: run_parallel(outer, range(6)))
    assert (done == 1).all()


def test_a_nested_call_stays_on_its_thread(two_threads):
    inside = [set() for _ in range(4)]

    def outer(i):
        inside[i].add(threading.get_ident())
        run_parallel(lambda _: inside[i].add(threading.get_ident()), range(8))

    finishes(lambda: run_parallel(outer, range(4)))
    assert all(len(names) == 1 for names in inside)


def test_a_launch_within_a_thread_is_not_split(two_threads):
    def rows():
        return wp.full((64, 3), -1, dtype=wp.int32, device="cpu")

    outside = rows()
    launch(thread_kernel, (64, 3), inputs=[], outputs=[outside], device="cpu", grain=1)
    assert len(np.unique(outside.numpy())) > 1
    outs = [rows() for _ in range(4)]
    finishes(
        lambda: run_parallel(
            lambda i: launch(thread_kernel, (64, 3), inputs=[], outputs=[outs[i]], device="cpu", grain=1), range(len(outs))
        )
    )
    for out in outs:
        np.testing.assert_array_equal(out.numpy(), 0)


def test_an_error_in_a_nested_call_reaches_the_caller(two_threads):
    def outer(i):
        def inner(k):
            if i == 2 and k == 1:
                raise RuntimeError("within")

        run_parallel(inner, range(3))

    with pytest.raises(RuntimeError, match="within"):
        finishes(lambda: run_parallel(outer, range(4)))
    # The pool serves on.
    seen = np.zeros(4, int)

    def mark(i):
        seen[i] = 1

    finishes(lambda: run_parallel(mark, range(4)))
    assert seen.all()


def test_the_number_of_threads_may_change_while_others_work():
    counts = np.zeros((2, 200), int)

    def user(row):
        for _ in range(20):

            def work(i):
                counts[row, i] += 1

            run_parallel(work, range(200))

    def change():
        users = [threading.Thread(target=user, args=(row,), daemon=True) for row in range(2)]
        for one in users:
            one.start()
        for count in [2, 3, 2, 4] * 5:
            set_threads(count)
        for one in users:
            one.join()

    set_threads(2)
    try:
        finishes(change)
    finally:
        set_threads(None)
    assert (counts == 20).all()


def blas_threads():
    """Return the thread limits of the BLAS libraries that are loaded."""
    return [found["num_threads"] for found in threadpool_info() if found["user_api"] == "blas"]


@pytest.fixture
def three_blas_threads():
    """Begin from a limit that differs from 1, however many cores there are."""
    with threadpool_limits(limits=3, user_api="blas"):
        before = blas_threads()
        if not before or set(before) == {1}:
            pytest.skip("BLAS has no threads to limit")
        yield before


def test_blas_has_its_threads_back_after_two_users_that_overlap(three_blas_threads):
    first_is_in, second_is_in, first_is_out = threading.Event(), threading.Event(), threading.Event()
    within = []

    def first():
        with single_threaded_blas():
            first_is_in.set()
            assert second_is_in.wait(PATIENCE)
        first_is_out.set()

    def second():
        assert first_is_in.wait(PATIENCE)
        with single_threaded_blas():
            second_is_in.set()
            assert first_is_out.wait(PATIENCE)
            within.append(blas_threads())

    users = [threading.Thread(target=work, daemon=True) for work in (first, second)]
    for one in users:
        one.start()
    for one in users:
        one.join(PATIENCE)
        assert not one.is_alive()
    assert set(within[0]) == {1}
    assert blas_threads() == three_blas_threads


def test_blas_has_its_threads_back_after_errors(three_blas_threads):
    def fail():
        with single_threaded_blas(), single_threaded_blas():
            assert set(blas_threads()) == {1}
            raise RuntimeError("within")

    with pytest.raises(RuntimeError, match="within"):
        fail()
    assert blas_threads() == three_blas_threads
    with pytest.raises(RuntimeError, match="within"):
        finishes(fail)
    assert blas_threads() == three_blas_threads


def test_uploads_take_the_numbers_their_type_is_made_of(device):
    for dtype, shape, kind in (
        (wp.vec3, (4, 3), np.float32),
        (wp.mat33, (4, 3, 3), np.float32),
        (wp.vec2i, (2, 5, 2), np.int32),
        (wp.float64, (3, 2), np.float64),
        (wp.uint8, (0, 7), np.uint8),
    ):
        data = np.arange(np.prod(shape)).reshape(shape)[..., ::-1]
        there = upload(data, dtype, device)
        assert there.numpy().dtype == kind
        np.testing.assert_array_equal(there.numpy(), data)
    held = np.zeros(3, np.float32)
    shared, copied = upload(held, wp.float32, "cpu", copy=False), upload(held, wp.float32, "cpu")
    held[1] = 1
    assert shared.numpy()[1] == 1
    assert copied.numpy()[1] == 0


SCRIPT = """
import numpy as np
{before}
from intaglio.kernels.point_surface import PointSurface
surface = PointSurface(np.random.default_rng(0).normal(size=(50, 3)), np.tile((0, 0, 1.0), (50, 1)), 1.0)
assert surface.nearest(np.zeros((1, 3)), reach=10.0)[0] >= 0
"""


def run_script(folder, before="", **environment):
    """Return what a new process that launches a kernel writes to its two outputs."""
    script = folder / "quiet.py"
    script.write_text(SCRIPT.format(before=before))
    settings = {name: value for name, value in os.environ.items() if name != "INTAGLIO_VERBOSE"} | environment
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=300, env=settings, check=True)
    return done.stdout, done.stderr


def test_a_launch_prints_nothing(tmp_path):
    # A cache of its own, so that the kernels are compiled as they are when they run for the first time.
    assert run_script(tmp_path, WARP_CACHE_PATH=str(tmp_path / "cache")) == ("", "")


@pytest.mark.parametrize("chosen", ["environment", "level"])
def test_reports_are_shown_to_whom_asks(chosen, tmp_path):
    if chosen == "environment":
        said, _ = run_script(tmp_path, INTAGLIO_VERBOSE="1")
    else:
        said, _ = run_script(tmp_path, before="import warp; warp.config.log_level = warp.LOG_DEBUG")
    assert "initialized" in said
    assert "intaglio.kernels.points" in said
