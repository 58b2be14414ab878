"""Synthetic patches: bumps and waves on a cylinder, a wave on a plane, at about the sizes of the paper.

After Breckon & Fisher, TPAMI 2008, figure 7.

The paper has 720 samples and 561 targets on the cylinders, 1,681 and 1,408 on the plane, and does not give the patterns; here
they are 720 and 576, 1,681 and 1,394, chosen so that samples and targets hold whole periods and their true means are equal.
"""

from __future__ import annotations

import numpy as np

from intaglio.mesh import Cylinder, Plane, Surface

Array = np.ndarray

AMPLITUDE = 0.25
COLUMNS, ROWS, SEEN = 54, 24, 30  # 30 x 24 = 720 samples, 24 x 24 = 576 targets; both whole periods of 6
PLANE_SIDE, PLANE_LENGTH = 41, 75  # 41 x 41 = 1,681 samples, 41 x 34 = 1,394 targets
PLANE_PERIOD = 8.5  # 34 target columns are 4 periods; shifted by 3 the 41 samples average to the mean as well


def bumps(column: Array, row: Array) -> Array:
    """Round bumps, two to a period of 6 columns and 8 rows, standing on the base."""
    first = _bump(column, 6.0) * _bump(row, 8.0)
    second = _bump(column + 3.0, 6.0) * _bump(row + 4.0, 8.0)
    return 3 * AMPLITUDE * (first + second)


def wave(column: Array, row: Array) -> Array:
    """A sine wave along the columns, standing on the base."""
    return AMPLITUDE * (1 + np.sin(2 * np.pi * column / 6.0)) + 0 * row


def plane_wave(column: Array, row: Array) -> Array:
    """Crossed sine waves, standing on the base."""
    return (
        4
        * AMPLITUDE
        * (1 + 0.5 * np.sin(2 * np.pi * (column - 3) / PLANE_PERIOD) + 0.5 * np.sin(2 * np.pi * (row - 3) / PLANE_PERIOD))
    )


def cylinder_base() -> Cylinder:
    """Return the cylinder on which a step of one column is 1 long."""
    return Cylinder(point=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), radius=COLUMNS / (2 * np.pi))


def plane_base() -> Plane:
    """Return the plane z = 0 with its chart along x and y."""
    return Plane(point=np.zeros(3), normal=np.array([0.0, 0.0, 1.0]), direction=np.array([1.0, 0.0, 0.0]))


def on_cylinder(pattern: object) -> tuple[Surface, Surface]:
    """Return the seen patch and the whole tube with relief ``pattern(column, row)``."""
    base = cylinder_base()

    def tube(columns: int, close: bool) -> Surface:
        c, r = np.meshgrid(np.arange(columns, dtype=float), np.arange(ROWS, dtype=float), indexing="ij")
        coordinates = np.stack([c.ravel(), r.ravel()], axis=1)
        foot, normal = base.foot(base.from_chart(coordinates))
        height = pattern(c, r).ravel()  # type: ignore[operator]
        return Surface(vertices=foot + height[:, None] * normal, faces=grid_faces(columns, ROWS, close))

    return tube(SEEN, False), tube(COLUMNS, True)


def on_plane(pattern: object) -> tuple[Surface, Surface]:
    """Return the seen square and the whole rectangle with relief ``pattern(column, row)``."""

    def sheet(columns: int) -> Surface:
        c, r = np.meshgrid(np.arange(columns, dtype=float), np.arange(PLANE_SIDE, dtype=float), indexing="ij")
        vertices = np.stack([c.ravel(), r.ravel(), pattern(c, r).ravel()], axis=1)  # type: ignore[operator]
        return Surface(vertices=vertices, faces=grid_faces(columns, PLANE_SIDE, False))

    return sheet(PLANE_SIDE), sheet(PLANE_LENGTH)


def grid_faces(columns: int, rows: int, close: bool) -> Array:
    """Return the triangles of a columns x rows grid (row index fastest), joined around if ``close``."""
    i = np.arange(columns if close else columns - 1)
    j = np.arange(rows - 1)
    a, b = np.meshgrid(i, j, indexing="ij")
    here, beside = (a * rows + b).ravel(), (((a + 1) % columns) * rows + b).ravel()
    return np.concatenate([np.stack([here, beside, beside + 1], 1), np.stack([here, beside + 1, here + 1], 1)])


def _bump(x: Array, period: float) -> Array:
    return np.cos(np.pi * x / period) ** 4
