"""Per-pixel fits and relighting: weighted sums of images, and robust fits of Lambert's law.

Images are planes: row k of a (K, P) array holds all pixels (times channels) of image k.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from intaglio.kernels.launch import launch, run_parallel, single_threaded_blas, split, upload

wp.set_module_options({"enable_backward": False})

# Pixels per matrix product.
_BLOCK = 16384

# Positive floats are ordered as their 31 bits are: halving the range of these this often finds a quantile exactly.
_BITS = wp.constant(31)

# For a scale three digits are enough: the exponent and ten bits after it.
_SCALE_BITS = wp.constant(18)

# A robust fit keeps at least this many of a pixel's values, where so many are not black.
_FEWEST = wp.constant(6)


@wp.kernel
def weighted_sums_kernel(
    start: int,
    planes: wp.array2d[wp.float32],
    weights: wp.array2d[wp.float32],
    floor: float,
    # output
    sums: wp.array2d[wp.float32],
):
    """Write sums[j, i] = max(floor, Σ_k weights[j, k] planes[k, i]) for one pixel i."""
    i = start + wp.tid()
    for j in range(weights.shape[0]):
        total = float(0.0)
        for k in range(weights.shape[1]):
            total += weights[j, k] * planes[k, i]
        sums[j, i] = wp.max(floor, total)


@wp.kernel
def weighted_sums_double_kernel(
    start: int,
    planes: wp.array2d[wp.float32],
    weights: wp.array2d[wp.float64],
    floor: float,
    # output
    sums: wp.array2d[wp.float32],
):
    """Write sums[j, i] = max(floor, Σ_k weights[j, k] planes[k, i]) for one pixel i, added up in double precision."""
    i = start + wp.tid()
    for j in range(weights.shape[0]):
        total = wp.float64(0.0)
        for k in range(weights.shape[1]):
            total += weights[j, k] * wp.float64(planes[k, i])
        sums[j, i] = wp.max(floor, wp.float32(total))


@wp.func
def value_quantile(planes: wp.array2d[wp.float32], i: int, wanted: int):
    """Return the ``wanted``-th smallest of column i's values over 0 (from 1 on)."""
    a = int(0)
    b = int(0x7F7FFFFF)
    for _ in range(_BITS):
        middle = a + (b - a) / 2
        limit = wp.cast(middle, wp.float32)
        count = int(0)
        for k in range(planes.shape[0]):
            if planes[k, i] > 0.0 and planes[k, i] <= limit:
                count += 1
        if count >= wanted:
            b = middle
        else:
            a = middle + 1
    return wp.cast(b, wp.float32)


@wp.func
def residual_quantile(
    planes: wp.array2d[wp.float32],
    lights: wp.array[wp.vec3],
    i: int,
    n: wp.vec3,
    low: float,
    high: float,
    wanted: int,
):
    """Return the ``wanted``-th smallest |planes[k, i] − n·l_k| among values from low to high, to three digits."""
    a = int(0)
    b = int(0x7F7FFFFF)
    for _ in range(_SCALE_BITS):
        middle = a + (b - a) / 2
        limit = wp.cast(middle, wp.float32)
        count = int(0)
        for k in range(planes.shape[0]):
            value = planes[k, i]
            if value >= low and value <= high and wp.abs(value - wp.dot(n, lights[k])) <= limit:
                count += 1
        if count >= wanted:
            b = middle
        else:
            a = middle + 1
    return wp.cast(b, wp.float32)


@wp.kernel
def robust_normals_kernel(
    start: int,
    planes: wp.array2d[wp.float32],
    lights: wp.array[wp.vec3],
    dark: float,
    bright: float,
    tuning: float,
    iterations: int,
    # output
    scaled: wp.array[wp.vec3],
    confidence: wp.array[wp.float32],
):
    """Fit planes[k, i] = n·l_k by iteratively reweighted least squares over the values between two ranks.

    Values at or under 0 are cast shadows and count for nothing. Of the m others the share ``dark`` of the smallest (shadows) and
    the share ``bright`` of the largest (highlights) are left out, as long as `_FEWEST` are kept. Weights are Geman and McClure's
    1 / (1 + (r / s)²)², s = tuning × 1.4826 × median |r|.
    """
    i = start + wp.tid()
    count = planes.shape[0]
    lit = int(0)
    most = float(0.0)
    for k in range(count):
        if planes[k, i] > 0.0:
            lit += 1
            most = wp.max(most, planes[k, i])
    n = wp.vec3(0.0, 0.0, 0.0)
    agreeing = float(0.0)
    if lit >= 3:
        # Ranks of the smallest and the largest value kept, counted from 1.
        first = int(dark * float(lit)) + 1
        last = lit - int(bright * float(lit))
        while last - first + 1 < wp.min(lit, _FEWEST):
            first = wp.max(first - 1, 1)
            last = wp.min(last + 1, lit)
        low = value_quantile(planes, i, first)
        high = value_quantile(planes, i, last)
        kept = int(0)
        for k in range(count):
            if planes[k, i] >= low and planes[k, i] <= high:
                kept += 1
        s = float(0.0)
        for step in range(iterations + 1):
            normal = wp.mat33(0.0)
            moment = wp.vec3(0.0, 0.0, 0.0)
            agreeing = float(0.0)
            for k in range(count):
                value = planes[k, i]
                if value >= low and value <= high:
                    weight = float(1.0)
                    if step > 0:
                        r = (value - wp.dot(n, lights[k])) / s
                        weight = 1.0 / ((1.0 + r * r) * (1.0 + r * r))
                    normal += weight * wp.outer(lights[k], lights[k])
                    moment += weight * value * lights[k]
                    agreeing += weight
            # The lights left for this pixel may lie in one plane: a little of the unit matrix keeps the answer finite.
            normal += 1.0e-6 * wp.trace(normal) * wp.identity(n=3, dtype=wp.float32)
            before = n
            n = wp.inverse(normal) * moment
            if step > 1 and wp.length(n - before) < 1.0e-5 * wp.length(n):
                break
            median = residual_quantile(planes, lights, i, n, low, high, (kept + 1) / 2)
            s = tuning * 1.4826 * median + 1.0e-6 * high + 1.0e-30
        if lit < _FEWEST:
            agreeing = float(0.0)
    scaled[i] = n
    confidence[i] = agreeing / float(count)


def weighted_sums(
    planes: np.ndarray,
    weights: np.ndarray,
    *,
    floor: float | None = None,
    out: np.ndarray | None = None,
    add: bool = False,
    double: bool = False,
    device: str = "cpu",
) -> np.ndarray:
    """Return ``weights @ planes``: fitting (weights from the lights) and relighting (weights from the light) are this product.

    Parameters
    ----------
    planes : (K, P) float32 array
        Images or maps, a row each.
    weights : (n, K) array
    floor : float, optional
        Least value of the result.
    out : (n, P) float32 array, optional
        Where to write.
    add : bool
        Add to ``out`` instead, without a floor. Always on the CPU: the sums would have to travel back and forth.
    double : bool
        Multiply and sum in double precision, as fits do: their weights cancel.
    device : str
        On the CPU blocks of pixels are multiplied by BLAS, a block a thread, always of the same shape, so that the bits do
        not depend on the number of threads. On CUDA a kernel takes one pixel a thread.

    Returns
    -------
    (n, P) float32 array
    """
    if add and (floor is not None or out is None):
        raise ValueError("adding needs an array to add to, and has no floor")
    weights = np.ascontiguousarray(weights, np.float64 if double else np.float32)
    result = np.empty((len(weights), planes.shape[1]), np.float32) if out is None else out
    if not device.startswith("cpu") and not add:
        kind = wp.float64 if double else wp.float32
        sums = wp.empty(result.shape, dtype=wp.float32, device=device)
        launch(
            weighted_sums_double_kernel if double else weighted_sums_kernel,
            planes.shape[1],
            inputs=[
                upload(planes, wp.float32, device),
                upload(weights, kind, device),
                float(-np.inf if floor is None else floor),
            ],
            outputs=[sums],
            device=device,
        )
        result[...] = sums.numpy()
        return result

    def block(start: int) -> None:
        part = slice(start, start + _BLOCK)
        if add:
            result[:, part] += (weights @ planes[:, part]).astype(np.float32, copy=False)
        elif double:
            result[:, part] = weights @ planes[:, part].astype(np.float64)
        else:
            np.matmul(weights, planes[:, part], out=result[:, part])
        if floor is not None:
            np.maximum(result[:, part], np.float32(floor), out=result[:, part])

    def blocks(index: int) -> None:
        for start in range(*ranges[index], 1):
            block(start * _BLOCK)

    ranges = list(split(-(-planes.shape[1] // _BLOCK), 16))
    with single_threaded_blas():
        run_parallel(blocks, range(len(ranges)))
    return result


def products(planes: np.ndarray) -> np.ndarray:
    """Return the (K, K) float64 matrix of inner products of the rows of ``planes`` (K, P)."""
    ranges = list(split(-(-planes.shape[1] // _BLOCK), 64))
    parts: list[np.ndarray] = [np.zeros(0)] * len(ranges)

    def block(index: int) -> None:
        total = np.zeros((len(planes), len(planes)))
        for b in range(*ranges[index]):
            part = planes[:, b * _BLOCK : (b + 1) * _BLOCK].astype(np.float64)
            total += part @ part.T
        parts[index] = total

    with single_threaded_blas():
        run_parallel(block, range(len(ranges)))
    return np.asarray(sum(parts))


def robust_normals(
    planes: np.ndarray,
    lights: np.ndarray,
    *,
    dark: float,
    bright: float,
    tuning: float = 2.0,
    iterations: int = 8,
    device: str = "cpu",
) -> tuple[np.ndarray, np.ndarray]:
    """Fit Lambert's law i = n·l to every pixel, leaving out shadows and highlights.

    Parameters
    ----------
    planes : (K, P) float32 array
        One value per image and pixel.
    lights : (K, 3) array
        Unit vectors.
    dark, bright : float
        Shares of a pixel's values over 0 that are left out: the smallest, and the largest.
    tuning : float
        Residuals count as far off in units of this many robust standard deviations.
    iterations : int
        Reweighting steps after the first fit.
    device : str

    Returns
    -------
    scaled : (P, 3) float32 array
        Normals times albedo.
    confidence : (P,) float32 array
        Sum of the final weights over K: the share of the lights that Lambert's law explains. 0 where fewer than `_FEWEST` values
        are over 0.
    """
    count = planes.shape[1]
    scaled = wp.empty(count, dtype=wp.vec3, device=device)
    confidence = wp.empty(count, dtype=wp.float32, device=device)
    launch(
        robust_normals_kernel,
        count,
        inputs=[
            upload(planes, wp.float32, device, copy=False),
            upload(lights, wp.vec3, device),
            float(dark),
            float(bright),
            float(tuning),
            int(iterations),
        ],
        outputs=[scaled, confidence],
        device=device,
        grain=1024,
    )
    return scaled.numpy(), confidence.numpy()
