"""Cameras and photographs that are registered with a mesh."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.errors import InputError
from intaglio.files import read_image

# Entries of R R^T may differ from the identity's by this much: calibrations are printed with six digits.
_ROTATION = 1e-3


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A pinhole camera: pixel = K (R X + t), x right, y down, z forwards; pixel centres at whole numbers, from (0, 0).

    Attributes
    ----------
    K : (3, 3) float64 array
        Intrinsics in pixels, upper triangular, last row 0 0 1.
    R : (3, 3) float64 array
        Rotation from world to camera.
    t : (3,) float64 array
        Translation, in the mesh's unit.
    size : (int, int), optional
        Rows and columns of the photograph that was calibrated.
    distortion : (2,) float64 array
        Radial: r (1 + k1 r^2 + k2 r^4) at distance r from the axis, before K.

    Raises
    ------
    InputError
        If K is no such matrix, R no rotation, or anything is not finite.
    """

    K: Array
    R: Array
    t: Array
    size: tuple[int, int] | None = None
    distortion: Array = (0.0, 0.0)  # type: ignore[assignment]

    def __post_init__(self) -> None:
        for name, shape in (("K", (3, 3)), ("R", (3, 3)), ("t", (3,)), ("distortion", (2,))):
            try:
                value = np.array(getattr(self, name), np.float64)
            except (TypeError, ValueError) as problem:
                raise InputError(f"{name} is no array of numbers ({problem})") from problem
            if name == "t" and value.size == 3:
                value = value.reshape(3)
            if value.shape != shape:
                raise InputError(f"{name} must be {' x '.join(map(str, shape))} numbers, not of shape {value.shape}")
            if not np.isfinite(value).all():
                raise InputError(f"{name} has entries that are not finite")
            object.__setattr__(self, name, value)
        if self.size is not None:
            try:
                rows, columns = self.size
                put_size = (int(rows), int(columns))
            except (TypeError, ValueError):
                put_size = (0, 0)
            if min(put_size) < 1 or put_size != tuple(self.size):
                raise InputError(f"size must be rows and columns in whole pixels, not {self.size!r}")
            object.__setattr__(self, "size", put_size)
        k = self.K / self.K[2, 2] if self.K[2, 2] else self.K
        if not (k[0, 0] > 0 and k[1, 1] > 0 and np.abs(k[[1, 2, 2], [0, 0, 1]]).max() < 1e-6 * k[0, 0] and k[2, 2] == 1):
            raise InputError("K must be upper triangular with positive focal lengths and 1 in the last place")
        object.__setattr__(self, "K", k)
        off = float(np.abs(self.R @ self.R.T - np.eye(3)).max())
        if off > _ROTATION:
            raise InputError(f"R is no rotation: R times its transpose differs from the identity by {off:.3g}")
        if np.linalg.det(self.R) < 0:
            raise InputError("R is a reflection, its determinant is -1; turn the sign of an axis")
        # The nearest rotation: six printed digits leave pixels off by a hundredth.
        left, _, right = np.linalg.svd(self.R)
        object.__setattr__(self, "R", left @ right)

    @property
    def center(self) -> Array:
        """Where the camera stands, (3,): -R^T t."""
        return np.asarray(-self.R.T @ self.t)

    @property
    def reach(self) -> float:
        """Squared distance from the axis, before distortion, at which the distortion turns back on itself; infinite if never."""
        k1, k2 = self.distortion
        # r (1 + k1 r^2 + k2 r^4) stops growing where 1 + 3 k1 s + 5 k2 s^2 = 0, s = r^2.
        roots = np.roots([5 * k2, 3 * k1, 1.0]) if k2 or k1 else np.zeros(0)
        real = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0)]
        return float(real.min()) if len(real) else np.inf

    def project(self, points: Array) -> tuple[Array, Array]:
        """Return pixels (N, 2) and depths (N,) of points (N, 3); pixels are NaN where it sees nothing."""
        seen = np.asarray(points, np.float64) @ self.R.T + self.t
        depth = seen[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            flat = np.where(depth[:, None] > 0, seen[:, :2] / depth[:, None], np.nan)
        r = np.sum(flat**2, axis=1, keepdims=True)
        flat = np.where(r < self.reach, flat, np.nan)
        flat = flat * (1 + self.distortion[0] * r + self.distortion[1] * r**2)
        return flat @ self.K[:2, :2].T + self.K[:2, 2], depth


@dataclass(frozen=True, kw_only=True)
class Photograph:
    """A photograph and its camera.

    Attributes
    ----------
    camera : Camera
    picture : (H, W, 3) float32 array of linear values, or a path
        A path is read each time it is asked for, so that many photographs need little memory.
    name : str
    """

    camera: Camera
    picture: Array | Path
    name: str = "photograph"

    @property
    def image(self) -> Array:
        """Linear values, (H, W, 3) float32; see `read`."""
        return self.read()[0]

    def read(self) -> tuple[Array, Array | None]:
        """Return linear values (H, W, 3) float32, and where the picture's alpha says that the object is, (H, W) bool or None.

        Raises
        ------
        InputError
            If the size is not the calibration's, or values are not finite.
        """
        stored = isinstance(self.picture, str | os.PathLike)
        values = read_image(self.picture) if stored else np.asarray(self.picture)  # type: ignore[arg-type]
        if values.dtype.kind != "f":
            raise InputError(
                f"{self.name}: a photograph holds linear values as floats (read_image gives them), not {values.dtype}"
            )
        if values.ndim == 2:
            values = np.repeat(values[:, :, None], 3, axis=2)
        if values.ndim != 3 or values.shape[2] not in (3, 4) or min(values.shape[:2]) < 4:
            raise InputError(f"{self.name}: a photograph is (H, W, 3) of at least 4 x 4 pixels, not {values.shape}")
        height, width = values.shape[:2]
        expected = self.camera.size
        if expected is not None and (height, width) != tuple(expected):
            raise InputError(
                f"{self.name}: the photograph has {width} x {height} pixels, its calibration is for "
                f"{expected[1]} x {expected[0]}; use the calibrated size"
            )
        cx, cy = self.camera.K[:2, 2]
        if expected is None and not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
            raise InputError(
                f"{self.name}: the principal point ({cx:.0f}, {cy:.0f}) lies outside the photograph of {width} x {height} "
                "pixels: its calibration is for another size"
            )
        if not np.isfinite(values).all():
            raise InputError(f"{self.name}: the photograph has values that are not finite")
        mask = values[:, :, 3] > 0.5 if values.shape[2] == 4 else None
        return np.ascontiguousarray(values[:, :, :3], np.float32), mask
