"""Height maps from gradients and back, and whether gradients are those of any surface (Dong, section 4.5.3).

Gradients are per pixel: p = ∂s/∂x along the columns, q = ∂s/∂y upwards, against the rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from intaglio.arrays import Array
from intaglio.checks import check_fields, checked_arguments, checked_number, checked_numeric, refuse_huge, shown
from intaglio.errors import InputError


@dataclass(frozen=True)
class Integrability:
    """How far two gradient maps are from being the gradients of one surface.

    Attributes
    ----------
    residual : float
        √(‖p − p'‖² + ‖q − q'‖²) / √(‖p‖² + ‖q‖²), without means: 0 for a surface's own gradients, 1 for a pure rotation.
    p, q : (H, W) float64 arrays
        The nearest gradients p', q' that satisfy v P = u Q (eq. 4.5.4), without a unit.

    See Also
    --------
    intaglio.integrability : Computes it.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 4.5.3.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> waves = np.sin(2 * np.pi * np.arange(16) / 16)
    >>> p = np.tile(waves, (16, 1))
    >>> found = intaglio.integrability(p, np.zeros((16, 16)))
    >>> round(found.residual, 6), np.allclose(found.p, p)
    (0.0, True)
    """

    residual: float
    p: Array
    q: Array

    def __post_init__(self) -> None:
        check_fields(self, nan=True)


def height_from_gradients(p: Array, q: Array, *, method: str = "fourier") -> Array:
    """Integrate gradients to the height map whose own gradients are nearest to them.

    Parameters
    ----------
    p, q : (H, W) arrays
        Slopes ∂s/∂x along the columns and ∂s/∂y upwards, against the rows, without a unit; finite.
    method : {"fourier", "cosine"}, optional
        ``"fourier"``: S = (−j u P − j v Q) / (u² + v²) (eq. 4.5.5). The map is assumed to repeat; a constant slope, which
        does not, is integrated separately as a plane. It is the default since the thesis does so. ``"cosine"``: the
        heights of neighbours differ by the mean of their gradients, in the least-squares sense, with free borders
        (Poisson's equation by the cosine transform); right for maps that do not repeat.

    Returns
    -------
    (H, W) float64 array
        Heights in pixels, of mean 0.

    Raises
    ------
    InputError
        If p and q are not two images of one shape with finite values, or the method is unknown.

    See Also
    --------
    intaglio.gradients_from_height : The reverse.
    intaglio.integrability : How far gradients are from those of a surface.

    References
    ----------
    Frankot & Chellappa, "A Method for Enforcing Integrability in Shape from Shading Algorithms", IEEE PAMI 10(4), 1988.

    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 4.5.3, eq. 4.5.5.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:16, :16]
    >>> height = np.cos(2 * np.pi * x / 16) + np.sin(4 * np.pi * y / 16)
    >>> p, q = intaglio.gradients_from_height(height, slope=(0, 0))
    >>> np.allclose(intaglio.height_from_gradients(p, q), height)
    True
    """
    p, q = _checked(p, q)
    if not isinstance(method, str):
        raise InputError(f"method must be text, not {shown(method)}")
    if method == "cosine":
        return _by_cosines(p, q)
    if method != "fourier":
        raise InputError(f"method of integration {shown(method)} is not known; known: fourier, cosine")
    u, v = _frequencies(p.shape)
    squared = u * u + v * v
    squared[squared == 0] = 1
    spectrum = (-1j * u * fft.rfft2(p) - 1j * v * fft.rfft2(q)) / squared
    spectrum[0, 0] = 0
    x, y = _coordinates(p.shape)
    plane = p.mean() * x + q.mean() * y
    return np.asarray(fft.irfft2(spectrum, s=p.shape) + plane - plane.mean())


@checked_arguments
def gradients_from_height(z: Array, *, method: str = "fourier", slope: tuple[float, float] | None = None) -> tuple[Array, Array]:
    """Differentiate a height map.

    Parameters
    ----------
    z : (H, W) array
        Heights in pixels, finite.
    method : {"fourier", "central", "forward"}, optional
        ``"fourier"``: P = j u S, Q = j v S (eqs. 4.5.2 and 4.5.3) after a plane is taken out, which does not repeat. It is
        the default since relighting by these gradients has the smaller error (the thesis, figure 4.5.11).
        ``"central"``: p = (s(x+1, y) − s(x−1, y)) / 2, q = (s(x, y+1) − s(x, y−1)) / 2, one-sided at the edges; local, and
        where the pixel is.
        ``"forward"``: p = s(x+1, y) − s(x, y), q = s(x, y+1) − s(x, y) (eqs. 4.5.6 and 4.5.7), which lie half a pixel off; the
        last column and the top row repeat their neighbours.
    slope : (float, float), optional
        Slopes p, q of the plane that ``"fourier"`` takes out; (0, 0) for a map that repeats. Default None: the plane of
        best fit.

    Returns
    -------
    p : (H, W) float64 array
        Slopes ∂s/∂x along the columns, without a unit.
    q : (H, W) float64 array
        Slopes ∂s/∂y upwards, against the rows, likewise.

    Raises
    ------
    InputError
        If z is not one image of finite values, or the method is unknown.

    See Also
    --------
    intaglio.height_from_gradients : The reverse.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 4.5.3.

    Examples
    --------
    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:4, :4]
    >>> p, q = intaglio.gradients_from_height(0.5 * x - 0.25 * y, method="forward")
    >>> print(p[0], q[0])
    [0.5 0.5 0.5 0.5] [0.25 0.25 0.25 0.25]
    """
    z = checked_numeric("z", z, np.float64)
    if z.ndim != 2 or z.size == 0 or not np.isfinite(z).all():
        raise InputError(f"z must be a height map of finite values, (H, W), not {z.shape}")
    refuse_huge("z", z)
    if slope is not None:
        slope = (checked_number("slope", slope[0], -np.inf), checked_number("slope", slope[1], -np.inf))
    if method == "forward":
        p = np.diff(z, axis=1, append=z[:, -1:])
        q = -np.diff(z, axis=0, prepend=z[:1])
        p[:, -1:], q[:1] = p[:, -2:-1] if z.shape[1] > 1 else 0, q[1:2] if z.shape[0] > 1 else 0
        return p, q
    if method == "central":
        p = np.gradient(z, axis=1) if z.shape[1] > 1 else np.zeros_like(z)
        q = -np.gradient(z, axis=0) if z.shape[0] > 1 else np.zeros_like(z)
        return p, q
    if method != "fourier":
        raise InputError(f"method of differentiation {shown(method)} is not known; known: fourier, central, forward")
    x, y = _coordinates(z.shape)
    if slope is None:
        slope = (x * z).sum() / max((x * x).sum(), 1e-300), (y * z).sum() / max((y * y).sum(), 1e-300)
    a, b = slope
    u, v = _frequencies(z.shape)
    spectrum = fft.rfft2(z - a * x - b * y)
    return np.asarray(fft.irfft2(1j * u * spectrum, s=z.shape) + a), np.asarray(fft.irfft2(1j * v * spectrum, s=z.shape) + b)


def integrability(p: Array, q: Array) -> Integrability:
    """Measure how far two maps are from being the gradients of one surface.

    The gradients of a surface satisfy v P(u, v) = u Q(u, v) in the frequency domain (eq. 4.5.4); the nearest maps that do
    are found by projection.

    Parameters
    ----------
    p, q : (H, W) arrays
        Slopes ∂s/∂x along the columns and ∂s/∂y upwards, against the rows, without a unit; finite.

    Returns
    -------
    Integrability
        The nearest gradients of a surface, and the relative distance from them.

    Raises
    ------
    InputError
        If p and q are not two images of one shape with finite values.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 4.5.3, eq. 4.5.4.

    Examples
    --------
    A rotation is not the gradient of any surface:

    >>> import numpy as np
    >>> import intaglio
    >>> y, x = np.mgrid[:16, :16] * (2 * np.pi / 16)
    >>> found = intaglio.integrability(p=np.sin(y), q=np.sin(x))
    >>> round(found.residual, 6)
    1.0
    """
    p, q = _checked(p, q)
    u, v = _frequencies(p.shape)
    squared = u * u + v * v
    squared[squared == 0] = 1
    first, second = fft.rfft2(p - p.mean()), fft.rfft2(q - q.mean())
    along = (u * first + v * second) / squared
    nearest_p = fft.irfft2(u * along, s=p.shape) + p.mean()
    nearest_q = fft.irfft2(v * along, s=p.shape) + q.mean()
    away = np.hypot(np.linalg.norm(p - nearest_p), np.linalg.norm(q - nearest_q))
    whole = np.hypot(np.linalg.norm(p - p.mean()), np.linalg.norm(q - q.mean()))
    return Integrability(float(away / whole) if whole > 0 else 0.0, np.asarray(nearest_p), np.asarray(nearest_q))


def _frequencies(shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Return angular frequencies u along x and v along y (upwards) of rfft2's bins, 0 at Nyquist's frequency."""
    u = 2 * np.pi * fft.rfftfreq(shape[1])[None, :].repeat(shape[0], axis=0)
    v = -2 * np.pi * fft.fftfreq(shape[0])[:, None].repeat(shape[1] // 2 + 1, axis=1)
    # At Nyquist's frequency a real signal's derivative is zero at every sample.
    if shape[1] % 2 == 0:
        u[:, -1] = 0
    if shape[0] % 2 == 0:
        v[shape[0] // 2] = 0
    return u, v


def _coordinates(shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Return x to the right and y upwards in pixels, of mean 0."""
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    return columns - columns.mean(), rows.mean() - rows


def _by_cosines(p: Array, q: Array) -> Array:
    """Solve for heights whose differences between neighbours are the means of their gradients, by least squares."""
    height, width = p.shape
    across = (p[:, 1:] + p[:, :-1]) / 2
    down = -(q[1:] + q[:-1]) / 2
    divergence = np.zeros((height, width))
    divergence[:, 1:] += across
    divergence[:, :-1] -= across
    divergence[1:] += down
    divergence[:-1] -= down
    i, j = np.arange(height)[:, None], np.arange(width)[None, :]
    # Eigenvalues of minus the Laplacian with free borders under the second cosine transform.
    values = 4 * np.sin(np.pi * i / (2 * height)) ** 2 + 4 * np.sin(np.pi * j / (2 * width)) ** 2
    values[0, 0] = 1
    spectrum = fft.dctn(divergence, type=2) / values
    spectrum[0, 0] = 0
    return np.asarray(fft.idctn(spectrum, type=2))


def _checked(p: Array, q: Array) -> tuple[Array, Array]:
    try:
        p, q = checked_numeric("p", p, np.float64), checked_numeric("q", q, np.float64)
    except InputError as error:
        raise InputError(f"gradients are not arrays of numbers: {error}") from error
    if p.ndim != 2 or p.size == 0 or p.shape != q.shape:
        raise InputError(f"gradients p and q must be two (H, W) images of one shape, not {p.shape} and {q.shape}")
    for name, values in (("p", p), ("q", q)):
        if not np.isfinite(values).all():
            raise InputError(f"gradients {name} have values that are not finite (NaN or infinite)")
        refuse_huge(name, values)
    return p, q
