"""Fixtures: one device fixture (CPU always, CUDA where there is one), small scans, real data where present."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
import warp as wp

wp.config.log_level = wp.LOG_WARNING
wp.init()

from intaglio import cli  # noqa: E402
from intaglio.mesh.surface import Surface  # noqa: E402
from intaglio.scenes.common import data_folder  # noqa: E402
from intaglio.scenes.patterns import on_cylinder, on_plane, plane_wave, wave  # noqa: E402


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
        status = 0
        with warnings.catch_warnings():
            warnings.simplefilter("default")
            try:
                cli.main()
            except SystemExit as stop:
                status = stop.code
        said, errors = capsys.readouterr()
        return status, said, errors

    return call


@pytest.fixture(autouse=True)
def _no_stray_environment(monkeypatch):
    for name in ("INTAGLIO_THREADS",):
        if name in os.environ:
            monkeypatch.delenv(name)
