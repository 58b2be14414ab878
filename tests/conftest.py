"""Fixtures: one device fixture (CPU always, CUDA where there is one), small scans, real data where present."""

from __future__ import annotations

import importlib
import os
import pkgutil
import warnings
from pathlib import Path

# Of the processes that pytest-xdist runs side by side each takes its share of the cores; BLAS reads these when it is loaded.
WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
SHARE = max(1, (os.cpu_count() or 1) // WORKERS)
if WORKERS > 1:
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, str(SHARE))

import numpy as np  # noqa: E402
import pytest  # noqa: E402
import warp as wp  # noqa: E402

wp.config.log_level = wp.LOG_WARNING
wp.init()

from intaglio import cli  # noqa: E402
from intaglio.mesh.surface import Surface  # noqa: E402
from intaglio.render import mitsuba  # noqa: E402
from intaglio.scenes.common import data_folder  # noqa: E402
from intaglio.scenes.patterns import on_cylinder, on_plane, plane_wave, wave  # noqa: E402


def pytest_sessionstart():
    """Compile the kernels once for all processes of pytest-xdist.

    They share a cache, which Warp fills with whole folders, each made beside and renamed. Every process starts at another module
    and takes them all in turn, so that it compiles those that the others have not come to yet.
    """
    if WORKERS == 1:
        return
    import intaglio.kernels

    names = sorted(found.name for found in pkgutil.iter_modules(intaglio.kernels.__path__))
    for name in names:
        importlib.import_module(f"intaglio.kernels.{name}")
    modules = [module for name in names if (module := wp.get_module(f"intaglio.kernels.{name}")).kernels]
    first = int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw")) * len(modules) // WORKERS
    for module in (*modules[first:], *modules[:first]):
        module.load("cpu", block_dim=1)


@pytest.fixture(params=["cpu", *[str(d) for d in wp.get_cuda_devices()[:1]]])
def device(request):
    return request.param


@pytest.fixture
def real():
    """Return a function that gives a path of the data folder or skips the test."""

    def path(name: str) -> Path:
        found = data_folder() / name
        if not found.exists():
            pytest.skip(f"{found} is not there (set INTAGLIO_DATA)")
        return found

    return path


@pytest.fixture(scope="session")
def wave_tube():
    """A seen patch of a tube with a wave, and the whole tube."""
    return on_cylinder(wave)


@pytest.fixture(scope="session")
def wave_sheet():
    """A seen square of a sheet with crossed waves, and the whole sheet."""
    return on_plane(plane_wave)


@pytest.fixture(scope="session")
def cap():
    """A rough, irregular cap of a sphere in survey coordinates: radius 10 about (5e5, 4e6, 100)."""
    rng = np.random.default_rng(7)
    x = np.linspace(-8, 8, 33)
    u, v = np.meshgrid(x, x, indexing="ij")
    u, v = u + rng.uniform(-0.1, 0.1, u.shape), v + rng.uniform(-0.1, 0.1, v.shape)
    inside = u**2 + v**2 < 60
    radius = 10 + 0.2 * np.sin(2.2 * u) * np.sin(2.2 * v)
    w = np.sqrt(100 - np.minimum(u**2 + v**2, 99))
    points = np.stack([u, v, w], axis=-1) / 10 * radius[..., None] + (5e5, 4e6, 100.0)
    return grid_surface(points, inside)


def grid_surface(points: np.ndarray, keep: np.ndarray) -> Surface:
    """Triangulate a grid of points (H, W, 3), x along the first axis, keeping ``keep``; faces look towards +z."""
    index = np.full(keep.shape, -1)
    index[keep] = np.arange(keep.sum())
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]
    faces = np.concatenate([np.stack([a, b, d], -1).reshape(-1, 3), np.stack([a, d, c], -1).reshape(-1, 3)])
    faces = faces[(faces >= 0).all(axis=1)]
    used = np.zeros(keep.sum(), bool)
    used[faces] = True
    renumber = np.cumsum(used) - 1
    return Surface(vertices=points[keep][used], faces=renumber[faces])


@pytest.fixture
def run(monkeypatch, capsys):
    """Return a function that runs the command and returns status, output and errors."""

    def call(*words, cwd=None):
        if cwd is not None:
            monkeypatch.chdir(cwd)
        monkeypatch.setattr("sys.argv", ["intaglio", *map(str, words)])
        capsys.readouterr()
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            status = cli.run()
        said, errors = capsys.readouterr()
        return status, said, errors

    return call


@pytest.fixture
def quick_pictures(monkeypatch):
    """Let reports be rendered with one path a pixel, where a test looks at their pages and not at what the pictures show."""
    mi = mitsuba()
    render = mi.render
    monkeypatch.setattr(mi, "render", lambda *args, spp, **settings: render(*args, spp=1, **settings))


@pytest.fixture(autouse=True)
def _share_of_the_threads(monkeypatch):
    if WORKERS > 1:
        monkeypatch.setenv("INTAGLIO_THREADS", str(SHARE))
    else:
        monkeypatch.delenv("INTAGLIO_THREADS", raising=False)
