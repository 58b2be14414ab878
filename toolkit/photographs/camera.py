"""Cameras and photographs that are registered with a mesh."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments, checked_choice, checked_finite, checked_vectors
from intaglio.errors import InputError
from intaglio.files import read_image
from intaglio.photographs.lens import (
    MODELS,
    checked_coefficients,
    distort,
    is_straight,
    packed,
    reach_of,
    undistort,
)

# Entries of R R^T may differ from the identity's by this much: calibrations are printed with six digits.
_ROTATION = 1e-3


@dataclass(frozen=True, kw_only=True)
class Camera:
    """Camera: a point X appears at pixel K (R X + t), which the lens may have moved before K.

    In the camera's coordinates x is right, y down and z forwards. Pixel centres are whole numbers, from (0, 0).

    Parameters
    ----------
    K : (3, 3) array
        Intrinsics in pixels: upper triangular, with positive focal lengths and the last row 0 0 1 (or a multiple of it).
    R : (3, 3) array
        Rotation from the world's coordinates to the camera's. It is replaced by the nearest exact rotation.
    t : (3,) array
        Translation, in the surface's unit of length.
    size : (int, int) or None, optional
        Rows and columns of the photographs for which the camera is calibrated. Default None: not known, so not checked.
    distortion : (n,) array, optional
        Coefficients of the lens, in the order of its model; those that are left out are 0. Default none.
    model : str, optional
        How the lens distorts. With (x, y) the point at depth 1 and r its distance from the axis:

        * ``"opencv"`` (default): k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, as OpenCV orders them: r becomes
          r (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6), with tangential and thin prism terms;
        * ``"brown"``: k1, k2, k3, k4, p1, p2: r (1 + k1 r^2 + k2 r^4 + k3 r^6 + k4 r^8), and the tangential terms;
        * ``"fisheye"``: k1, k2, k3, k4, p1, p2: the same of the angle off the axis in place of r;
        * ``"thin_prism_fisheye"``, ``"rad_tan_thin_prism_fisheye"``, ``"fov"``, ``"division"``, ``"eucm"``: COLMAP's
          parameters of these names, after focal lengths and principal point;
        * ``"inverse"``: k: VisualSFM's, r becomes the r' with r = r' (1 + k r'^2).

    Raises
    ------
    InputError
        If K is not such a matrix, R not a rotation, the size not two whole numbers, a value is not finite, or the lens has
        more coefficients than its model.

    See Also
    --------
    intaglio.read_photographs : Read cameras and photographs from files.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> camera = intaglio.Camera(K=[[16, 0, 15.5], [0, 16, 15.5], [0, 0, 1]], R=np.diag([1.0, -1, -1]), t=[0, 0, 2])
    >>> pixel, depth = camera.project(np.array([[0.5, 0.25, 0.0]]))
    >>> print(pixel, depth)
    [[19.5 13.5]] [2.]
    """

    K: Array
    R: Array
    t: Array
    size: tuple[int, int] | None = None
    distortion: Array = ()  # type: ignore[assignment]
    model: str = "opencv"

    def __post_init__(self) -> None:
        check_fields(self)
        checked_choice("model", self.model, MODELS)
        for name, shape in (("K", (3, 3)), ("R", (3, 3)), ("t", (3,)), ("distortion", None)):
            try:
                if np.iscomplexobj(getattr(self, name)):
                    raise TypeError("complex numbers")
                value = np.array(getattr(self, name), np.float64)
            except (TypeError, ValueError, OverflowError) as problem:
                raise InputError(f"{name} is not an array of numbers ({problem})") from problem
            if name == "t" and value.size == 3:
                value = value.reshape(3)
            if shape is not None and value.shape != shape:
                raise InputError(f"{name} must be {' x '.join(map(str, shape))} numbers, not of shape {value.shape}")
            if not np.isfinite(value).all():
                raise InputError(f"{name} has entries that are not finite")
            object.__setattr__(self, name, value)
        object.__setattr__(self, "distortion", checked_coefficients(self.model, self.distortion))
        if self.size is not None:
            try:
                rows, columns = self.size
                put_size = (int(rows), int(columns))
            except (TypeError, ValueError):
                put_size = (0, 0)
            if min(put_size) < 1 or put_size != tuple(self.size):
                raise InputError(f"size must be rows and columns in whole pixels, not {self.size!r}")
            object.__setattr__(self, "size", put_size)
        with np.errstate(all="ignore"):
            k = self.K / self.K[2, 2] if self.K[2, 2] else self.K
        focal = min(k[0, 0], k[1, 1])
        if not (focal > 0 and np.isfinite(k).all() and np.abs(k[[1, 2, 2], [0, 0, 1]]).max() < 1e-6 * focal and k[2, 2] == 1):
            raise InputError("K must be upper triangular with positive focal lengths and 1 in the last place")
        object.__setattr__(self, "K", k)
        with np.errstate(all="ignore"):
            off = float(np.abs(self.R @ self.R.T - np.eye(3)).max())
        if not off <= _ROTATION:
            raise InputError(f"R is not a rotation: R times its transpose differs from the identity by {off:.3g}")
        if np.linalg.det(self.R) < 0:
            raise InputError("R is a reflection, its determinant is -1; reverse the sign of one axis")
        # The nearest rotation is taken, since with six printed digits pixels would be wrong by a hundredth.
        left, _, right = np.linalg.svd(self.R)
        object.__setattr__(self, "R", left @ right)

    @property
    def center(self) -> Array:
        """Position of the camera in the world, -R^T t.

        Returns
        -------
        (3,) float64 array
            Position in the surface's unit of length.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> intaglio.Camera(K=np.eye(3), R=np.diag([1.0, -1, -1]), t=[0, 0, 2]).center
        array([0., 0., 2.])
        """
        return np.asarray(-self.R.T @ self.t)

    @property
    def lens(self) -> tuple[int, Array]:
        """The lens as the kernels take it.

        Returns
        -------
        family : int
            Number of the family that the model belongs to.
        coefficients : (16,) float64 array
            The distortion's coefficients in the places of the family; see `intaglio.kernels.lenses`.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> intaglio.Camera(K=np.eye(3), R=np.eye(3), t=[0, 0, 2], distortion=[0.1, 0.02]).lens[1][:3]
        array([0.1 , 0.02, 0.  ])
        """
        return packed(self.model, self.distortion)

    @property
    def distorts(self) -> bool:
        """Whether the lens bends straight lines.

        Returns
        -------
        bool
            False for a pinhole: no coefficient of the lens does anything.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> intaglio.Camera(K=np.eye(3), R=np.eye(3), t=[0, 0, 2]).distorts
        False
        >>> intaglio.Camera(K=np.eye(3), R=np.eye(3), t=[0, 0, 2], model="fisheye").distorts
        True
        """
        return not is_straight(self.model, self.distortion)

    @property
    def reach(self) -> float:
        """Squared distance from the axis, before distortion, up to which the distortion does not turn back.

        Returns
        -------
        float
            Squared distance at depth 1; infinite if the distortion is monotonic everywhere.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> intaglio.Camera(K=np.eye(3), R=np.eye(3), t=[0, 0, 2]).reach
        inf
        >>> round(intaglio.Camera(K=np.eye(3), R=np.eye(3), t=[0, 0, 2], distortion=[-1 / 3, 0]).reach, 6)
        1.0
        """
        return reach_of(self.lens)

    @checked_arguments
    def project(self, points: Array) -> tuple[Array, Array]:
        """Return where points appear in the picture.

        Parameters
        ----------
        points : (N, 3) array
            Positions in the world, in the surface's unit of length.

        Returns
        -------
        pixel : (N, 2) float64 array
            Positions x, y in pixels, from the centre of the upper left pixel, inside the picture or not; NaN for points
            behind the camera or beyond the reach of its distortion.
        depth : (N,) float64 array
            Distances along the camera's axis, negative behind it.

        Raises
        ------
        InputError
            If ``points`` is not an (N, 3) array of finite numbers.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> camera = intaglio.Camera(K=[[16, 0, 15.5], [0, 16, 15.5], [0, 0, 1]], R=np.eye(3), t=[0, 0, 2])
        >>> pixel, depth = camera.project(np.array([[0.5, 0.0, 0.0], [0.0, 0.0, -3.0]]))
        >>> print(pixel, depth)
        [[19.5 15.5]
         [ nan  nan]] [ 2. -1.]
        """
        seen = checked_vectors("points", points) @ self.R.T + self.t
        depth = seen[:, 2]
        with np.errstate(all="ignore"):
            flat = np.where(depth[:, None] > 0, seen[:, :2] / depth[:, None], np.nan)
            r = np.sum(flat**2, axis=1, keepdims=True)
            flat = np.where(r < self.reach, flat, np.nan)
            if self.distorts:
                flat = distort(self.lens, flat)
            return flat @ self.K[:2, :2].T + self.K[:2, 2], depth

    @checked_arguments
    def unproject(self, pixel: Array) -> Array:
        """Return the directions in which pixels look: what `project` leads to them.

        Parameters
        ----------
        pixel : (N, 2) array
            Positions x, y in pixels, from the centre of the upper left pixel.

        Returns
        -------
        (N, 3) float64 array
            Unit vectors in the world, from the camera's `center`; NaN where the lens shows nothing.

        Raises
        ------
        InputError
            If ``pixel`` is not an (N, 2) array of finite numbers.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> camera = intaglio.Camera(K=[[16, 0, 15.5], [0, 16, 15.5], [0, 0, 1]], R=np.eye(3), t=[0, 0, 2], distortion=[0.1])
        >>> point = np.array([[0.5, 0.25, 0.0]])
        >>> way = camera.unproject(camera.project(point)[0])
        >>> bool(np.allclose(np.cross(way, point - camera.center), 0))
        True
        """
        at = checked_finite("pixel", pixel)
        if at.ndim != 2 or at.shape[1] != 2:
            raise InputError(f"pixel must be an (N, 2) array, not {at.shape}")
        with np.errstate(all="ignore"):
            flat = np.linalg.solve(self.K[:2, :2], (at - self.K[:2, 2]).T).T
            if self.distorts:
                flat = undistort(self.lens, flat, self.reach)
            way = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)
            return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True) @ self.R)


@dataclass(frozen=True, kw_only=True)
class Photograph:
    """Photograph with its calibrated camera.

    Parameters
    ----------
    camera : Camera
        The camera, calibrated for pictures of this size.
    picture : (H, W), (H, W, 3) or (H, W, 4) float array, or path
        Linear values, of at least 4 x 4 pixels, or an image file. A fourth channel tells where the object is. A file is read
        each time it is needed, so that many photographs take little memory; its pixels are taken as they are stored, and turned
        as EXIF says only if the camera's size asks for that.
    name : str, optional
        Name of the photograph in messages and in the coverage of a texture. Default "photograph".

    See Also
    --------
    intaglio.read_photographs : Read photographs and cameras from files.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> camera = intaglio.Camera(K=[[16, 0, 15.5], [0, 16, 15.5], [0, 0, 1]], R=np.eye(3), t=[0, 0, 2])
    >>> photograph = intaglio.Photograph(camera=camera, picture=np.full((32, 32), 0.5), name="front")
    >>> photograph.image.shape
    (32, 32, 3)
    """

    camera: Camera
    picture: Array | Path
    name: str = "photograph"

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def image(self) -> Array:
        """Linear values of the picture.

        Returns
        -------
        (H, W, 3) float32 array
            The first of what `read` returns; row 0 is the top.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> camera = intaglio.Camera(K=[[4, 0, 3.5], [0, 4, 3.5], [0, 0, 1]], R=np.eye(3), t=[0, 0, 2])
        >>> intaglio.Photograph(camera=camera, picture=np.full((8, 8), 0.5)).image[0, 0]
        array([0.5, 0.5, 0.5], dtype=float32)
        """
        return self.read()[0]

    def read(self) -> tuple[Array, Array | None]:
        """Return the picture's linear values, and where its alpha channel shows the object.

        Returns
        -------
        values : (H, W, 3) float32 array
            Linear values; row 0 is the top.
        mask : (H, W) bool array or None
            Where alpha is over one half; None for a picture without alpha.

        Raises
        ------
        InputError
            If the size is not the calibration's, the principal point lies outside the picture, or values are integers or not
            finite.
        FileError
            If the file is missing or damaged.

        Examples
        --------
        >>> import numpy as np
        >>> import intaglio
        >>> camera = intaglio.Camera(K=[[4, 0, 3.5], [0, 4, 3.5], [0, 0, 1]], R=np.eye(3), t=[0, 0, 2])
        >>> picture = np.full((8, 8, 4), 0.5)
        >>> picture[:, :4, 3] = 1.0
        >>> values, mask = intaglio.Photograph(camera=camera, picture=picture).read()
        >>> values.shape, int(mask.sum())
        ((8, 8, 3), 32)
        """
        values = self._values()
        if values.dtype.kind != "f":
            raise InputError(
                f"{self.name}: the picture must hold linear values as floats (read_image gives them), not {values.dtype}"
            )
        if values.ndim == 2:
            values = np.repeat(values[:, :, None], 3, axis=2)
        if values.ndim != 3 or values.shape[2] not in (3, 4) or min(values.shape[:2]) < 4:
            raise InputError(f"{self.name}: the picture must be (H, W, 3) of at least 4 x 4 pixels, not {values.shape}")
        height, width = values.shape[:2]
        expected = self.camera.size
        if expected is not None and (height, width) != tuple(expected):
            raise InputError(
                f"{self.name}: the photograph's picture has {width} x {height} pixels, its calibration is for "
                f"{expected[1]} x {expected[0]}; use the calibrated size"
            )
        cx, cy = self.camera.K[:2, 2]
        if expected is None and not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
            raise InputError(
                f"{self.name}: the principal point ({cx:.0f}, {cy:.0f}) lies outside the photograph of {width} x {height} "
                "pixels: its calibration is for another size"
            )
        if not np.isfinite(values).all():
            raise InputError(f"{self.name}: the photograph's picture has values that are not finite")
        mask = values[:, :, 3] > 0.5 if values.shape[2] == 4 else None
        return np.ascontiguousarray(values[:, :, :3], np.float32), mask

    def _values(self) -> Array:
        """Return the picture; a file's pixels as they are stored, which calibrations count, unless only turned they fit."""
        if not isinstance(self.picture, str | os.PathLike):
            try:
                # A matrix of NumPy stays one whatever it is indexed with.
                return np.asarray(self.picture)
            except (TypeError, ValueError) as problem:
                raise InputError(f"{self.name}: the picture is neither an array nor a path ({problem})") from problem
        values = read_image(self.picture, orient=False)
        expected = self.camera.size
        if expected is not None and values.shape[:2] == expected[::-1] != expected:
            return read_image(self.picture)
        return values
