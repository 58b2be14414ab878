"""Filling holes by coherent pieces: patches over a hole are matched to what is known and vote, from coarse to fine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from intaglio.arrays import Array, Progress
from intaglio.kernels.patch_field import PatchField, patch_grid
from intaglio.kernels.patch_match import SIDE, STRIDE
from intaglio.randomness import Stream, uniform
from intaglio.restoration.coherent.frames import Canvas, Frame, group_holes, lay_frames
from intaglio.restoration.coherent.order import Windows, fill_in_order
from intaglio.restoration.inpaint import inpaint
from intaglio.synthesis import covered_pixels, halve_planes, mean_step, refine_source, smooth_plane, sum_in_patches, window_starts

# The mean steps along rows and columns, over a Gaussian of so many pixels, are compared as two more maps, so that a smooth start
# is not matched to smooth places alone (Newson et al. 2014, section 3.2); they weigh so much of what the values do.
_SPREAD, _TEXTURE = 4.0, 0.5

# How often patches are matched and vote: on every level but the finest, on the finest, and how much more often at first.
_PASSES, _LAST, _FIRST = 8, 2, 6

# Sweeps of a pass: how far off the neighbours are that a patch asks; places that it tries by chance, thrice at first.
_JUMPS, _CHANCES = (4, 2, 1), 6

# A patch votes with exp(-cost / 2 s^2) _GAMMA^-d: s^2 is this percentile of all costs, d its distance from what is known, in
# pixels (Wexler et al. 2007, section 3.3).
_PERCENTILE, _GAMMA = 75.0, 1.3

# Rounds in which borders move, a pixel's faith in the vote against seams, and the price of a border in units of the mean step.
_SETTLES, _FAITH, _PRICE = 4, 0.5, 0.05

# The second start looks at so many patches about a hole, and is left out where more pixels than that are missing.
_WINDOWS, _MOST = 6000, 8000

# What the second start's patches may cost, of what the first's do, to be preferred.
_CLEARLY = 0.85


@dataclass(frozen=True)
class _Level:
    """The image on one level: what is compared, which pixels may be compared and copied, charts, and where patches may begin."""

    planes: Array
    context: Array
    usable: Array
    chart: Array
    barriers: Array
    starts: Array


@dataclass(frozen=True)
class _Task:
    """Frames of one level: which of their pixels are open, which patches are matched, and how far inside patches are."""

    canvas: Canvas
    open_: Array
    own: Array
    active: Array
    covered: Array
    inside: Array
    patch_frame: Array


def fill_by_pieces(
    image: Array,
    hole: Array,
    usable: Array,
    chart: Array,
    *,
    barriers: Array | None = None,
    seed: int,
    device: str,
    progress: Progress | None = None,
) -> tuple[Array, str]:
    """Return what fills a hole: the pixel (H, W, 2) that each pixel copies, itself outside of the hole, and how it was found.

    Parameters
    ----------
    image : (H, W, C) float32 array
    hole : (H, W) bool array
        Pixels to fill.
    usable : (H, W) bool array
        Pixels that may be copied. All that is in a chart and no hole is compared.
    chart : (H, W) int array
        Patches don't leave their chart, the sample's do not mix charts; 0 is outside of all.
    barriers : (H, W) bool array, optional
        Pixels across which the smooth start doesn't diffuse.
    seed : int
    device : str
        From `choose_device`.
    progress : callable, optional
        Called with the amount done and the total.
    """
    label, frames = group_holes(hole, chart)
    levels = _levels(
        image, ~hole & (chart > 0), usable, chart, np.zeros_like(hole) if barriers is None else barriers, max(frames)
    )
    frames = _as_deep_as_known(frames, len(levels) - 1)
    source = np.moveaxis(np.indices(hole.shape), 0, 2).astype(np.int32)
    count = sum(len(group) for group in frames.values())
    total = round(sum(sum(_work(group, depth)) for depth, group in frames.items()))
    done, ordered = 0.0, 0

    def advance(amount: float) -> None:
        nonlocal done
        done += amount
        if progress is not None:
            progress(min(round(done), total), total)

    for depth, group in sorted(frames.items()):
        found, canvas, second = _fill_frames(levels, label, group, depth, seed, device, advance)
        ordered += second
        for (top, left), f in zip(canvas.corners, group, strict=True):
            box = (slice(top, top + f.height), slice(left, left + f.width))
            place = canvas.place[box].reshape(-1, 2)
            inside = ((place >= 0) & (place < hole.shape)).all(axis=1)
            y, x = place[inside].T
            own = label[y, x] == f.group
            source[y[own], x[own]] = found[box].reshape(-1, 2)[inside][own]
    if progress is not None:
        progress(total, total)
    deepest = max(frames)
    note = (
        f"{count} hole{'s' if count > 1 else ''} filled by coherent pieces, on up to {deepest + 1} level{'s' if deepest else ''}"
    )
    return source, note + (f"; {ordered} begun in the order of structure, which fitted better" if ordered else "")


def _as_deep_as_known(frames: dict[int, list[Frame]], deepest: int) -> dict[int, list[Frame]]:
    """Return frames with those that want coarser levels than there are moved to the coarsest that there is."""
    result: dict[int, list[Frame]] = {}
    for depth, group in sorted(frames.items()):
        result.setdefault(min(depth, deepest), []).extend(group)
    return result


def _levels(image: Array, context: Array, usable: Array, chart: Array, barriers: Array, deepest: int) -> list[_Level]:
    """Return the levels down to ``deepest``, or as far as patches can be copied."""
    planes = np.concatenate([np.moveaxis(image, 2, 0), _texture_planes(image, context, chart)]).astype(np.float32)
    levels: list[_Level] = []
    while True:
        starts = whole_patches(usable, chart)
        if levels and not starts.any():
            return levels
        levels.append(_Level(planes, context, usable, chart, barriers, starts))
        if len(levels) > deepest or min(context.shape) < 4 * SIDE:
            return levels
        planes, coarse = halve_planes(planes, context)
        usable = (smooth_plane(usable.astype(np.float64))[::2, ::2] > 0.5) & coarse
        chart, barriers = chart[::2, ::2], _halve_any(barriers)
        # Next to another chart, means mix.
        alone = ndimage.minimum_filter(chart, 3) == ndimage.maximum_filter(chart, 3)
        context = coarse & (chart > 0) & (alone | (chart.max() == chart.min()))
        usable &= context


def _halve_any(mask: Array) -> Array:
    """Return whether any pixel of each 2 x 2 is set."""
    height, width = mask.shape
    padded = np.pad(mask, ((0, height % 2), (0, width % 2)))
    return np.asarray(padded.reshape(-(-height // 2), 2, -(-width // 2), 2).any(axis=(1, 3)))


def _texture_planes(image: Array, context: Array, chart: Array) -> Array:
    """Return (2, H, W): the mean steps along rows and columns about each pixel, as far as they are known."""
    gray = image.mean(axis=2).astype(np.float64)
    planes = []
    for axis in (0, 1):
        ahead = np.roll(context, -1, axis) & context & (np.roll(chart, -1, axis) == chart)
        ahead[(slice(-1, None), slice(None)) if axis == 0 else (slice(None), slice(-1, None))] = False
        step = np.where(ahead, np.abs(np.roll(gray, -1, axis) - gray), 0)
        weight = ndimage.gaussian_filter(ahead.astype(np.float64), _SPREAD)
        planes.append(np.where(weight > 1e-3, ndimage.gaussian_filter(step, _SPREAD) / np.maximum(weight, 1e-3), 0))
    result = np.stack(planes)
    spread = np.sqrt(float(result[:, context].var(axis=1).sum()))
    wanted = _TEXTURE * np.sqrt(float(image[context].astype(np.float64).var(axis=0).sum()))
    return result * (wanted / spread) if spread > 1e-9 else np.zeros_like(result)


def whole_patches(usable: Array, chart: Array) -> Array:
    """Return where patches of usable pixels of one chart begin."""
    if min(usable.shape) < SIDE:
        return np.zeros((0, 0), bool)
    starts = window_starts(usable, SIDE)
    if chart.min() != chart.max():
        same = ndimage.minimum_filter(chart, SIDE) == ndimage.maximum_filter(chart, SIDE)
        half = SIDE // 2
        starts &= same[half : half + starts.shape[0], half : half + starts.shape[1]]
    return starts


def _work(frames: list[Frame], depth: int) -> list[float]:
    """Return what each level takes, finest first: its pixels, twice where two starts are compared."""
    pixels = sum(f.height * f.width for f in frames)
    return [pixels / 4**n * (2 if n >= min(depth, 1) else 1) for n in range(depth + 1)]


def _fill_frames(
    levels: list[_Level],
    label: Array,
    frames: list[Frame],
    depth: int,
    seed: int,
    device: str,
    advance: Callable[[float], None],
) -> tuple[Array, Canvas, int]:
    """Return the sources on the canvas of some frames, the canvas, and how many frames took the second start."""
    work = _work(frames, depth)
    tasks = [_task(levels[n], lay_frames(frames, depth, n), label, frames, n) for n in range(depth + 1)]
    chosen = min(depth, 1)
    smooth = _smooth_start(levels[depth], tasks[depth])
    starts = [smooth]
    # Where more is missing the search of every patch would take too long.
    if tasks[depth].own.sum() <= _MOST:
        starts.append(_ordered_start(levels[depth], tasks[depth], frames, depth, *smooth))
    results = []
    for number, (values, source) in enumerate(starts):
        cost = np.zeros(0)
        for n in range(depth, chosen - 1, -1):
            if n < depth:
                source = _refined(source, levels[n], tasks[n])
                values = levels[n].planes[:, source[..., 0], source[..., 1]]
            source, cost = _improve(levels[n], tasks[n], values, source, n == depth, n, seed + number, device)
            advance(work[n] / 2)
        results.append((source, cost))
    source, ordered = _choose(results, tasks[chosen], len(frames))
    for n in range(chosen - 1, -1, -1):
        source = _refined(source, levels[n], tasks[n])
        values = levels[n].planes[:, source[..., 0], source[..., 1]]
        source, _ = _improve(levels[n], tasks[n], values, source, False, n, seed, device)
        advance(work[n])
    return source, tasks[0].canvas, ordered


def _choose(results: list[tuple[Array, Array]], task: _Task, count: int) -> tuple[Array, int]:
    """Return the sources of the start whose patches cost least, frame by frame, and in how many the second's are taken."""
    source = results[0][0]
    if len(results) < 2:
        return source, 0
    frame = task.patch_frame.ravel()[task.active]
    means = [np.bincount(frame, cost[task.active], count + 1) for _, cost in results]
    second = means[1] < _CLEARLY * means[0]
    return np.where(second[task.canvas.frame][..., None], results[1][0], source), int(second[1:].sum())


def _task(level: _Level, canvas: Canvas, label: Array, frames: list[Frame], number: int) -> _Task:
    height, width = level.context.shape
    place = canvas.place
    inside = (place >= 0).all(axis=2) & (place[..., 0] < height) & (place[..., 1] < width) & (canvas.frame > 0)
    y, x = (np.where(inside, place[..., i], 0) for i in range(2))
    charts = np.array([0, *(f.chart for f in frames)])[canvas.frame]
    open_ = (canvas.frame > 0) & ~(inside & level.context[y, x] & (level.chart[y, x] == charts))
    # A coarse pixel belongs to a group where the pixels that it stands for do, or those beside it.
    groups = np.array([0, *(f.group for f in frames)])[canvas.frame]
    own = np.zeros_like(open_)
    scale = 1 << number
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            v, u = (np.clip(p * scale + d * scale, 0, n - 1) for p, d, n in zip((y, x), (dy, dx), label.shape, strict=True))
            own |= label[v, u] == groups
    own &= open_ & inside
    grid = patch_grid(own.shape, False)
    holds = sum_in_patches(own, grid, SIDE, SIDE) > 0
    covered = covered_pixels(holds, own.shape, False) & open_
    middle = SIDE // 2
    distance = ndimage.distance_transform_edt(open_)[middle:, middle:][::STRIDE, ::STRIDE][: grid[0], : grid[1]]
    patch_frame = canvas.frame[middle:, middle:][::STRIDE, ::STRIDE][: grid[0], : grid[1]]
    return _Task(canvas, open_, own, np.flatnonzero(holds), covered, distance, patch_frame)


def _image_places(level: _Level, task: _Task) -> Array:
    """Return the image's pixel at each of the canvas, the nearest one beyond the image."""
    return np.asarray(np.clip(task.canvas.place, 0, np.array(level.context.shape) - 1), np.int32)


def _smooth_start(level: _Level, task: _Task) -> tuple[Array, Array]:
    """Return values (n, H, W) on the canvas, diffused into the holes, and sources (H, W, 2): the nearest usable pixel."""
    here = _image_places(level, task)
    values = np.moveaxis(level.planes[:, here[..., 0], here[..., 1]], 0, 2)
    smooth = inpaint(values, task.open_, chart=task.canvas.frame, barriers=level.barriers[here[..., 0], here[..., 1]])
    nearest = ndimage.distance_transform_edt(~level.usable, return_distances=False, return_indices=True)
    near = np.moveaxis(nearest[:, here[..., 0], here[..., 1]], 0, 2).astype(np.int32)
    return np.ascontiguousarray(np.moveaxis(smooth, 2, 0)), np.where(task.open_[..., None], near, here)


def _ordered_start(
    level: _Level, task: _Task, frames: list[Frame], depth: int, values: Array, source: Array
) -> tuple[Array, Array]:
    """Return the values and sources of a smooth start with holes filled in the order of structure."""
    values, source = values.copy(), source.copy()
    for (top, left), f in zip(task.canvas.corners, frames, strict=True):
        box = (slice(top, top + (f.height >> depth)), slice(left, left + (f.width >> depth)))
        middle = task.canvas.place[box].reshape(-1, 2).mean(axis=0) - SIDE / 2
        windows = Windows(level.planes, _nearest_starts(level.starts, middle))
        part = (slice(None), *box)
        filled, found = fill_in_order(values[part], ~task.open_[box], task.own[box], windows, level.planes)
        values[part] = filled
        source[box] = np.where(found >= 0, found, source[box])
    return values, source


def _nearest_starts(starts: Array, middle: Array) -> Array:
    """Return the places (N, 2) nearest to a point where patches begin, at most `_WINDOWS`."""
    reach = 64.0
    while True:
        # Beyond a square that holds enough, its corners' distance bounds where nearer ones may be.
        low = np.clip(np.floor(middle - reach), 0, starts.shape).astype(int)
        high = np.clip(np.ceil(middle + reach) + 1, 0, starts.shape).astype(int)
        whole = (low == 0).all() and (high == starts.shape).all()
        found = np.argwhere(starts[low[0] : high[0], low[1] : high[1]]) + low
        distance = ((found - middle) ** 2).sum(axis=1)
        if whole or (distance <= reach**2).sum() > _WINDOWS:
            break
        reach *= 2
    return found if len(found) <= _WINDOWS else found[np.sort(np.argpartition(distance, _WINDOWS)[:_WINDOWS])]


def _refined(source: Array, level: _Level, task: _Task) -> Array:
    """Return the sources on a level from those of the next coarser one; pixels that are known are their own."""
    fine = refine_source(source, (task.open_.shape[0], task.open_.shape[1]), level.usable)
    return np.ascontiguousarray(np.where(task.open_[..., None], fine, _image_places(level, task)))


def _improve(
    level: _Level, task: _Task, values: Array, source: Array, first: bool, number: int, seed: int, device: str
) -> tuple[Array, Array]:
    """Return the sources of a level improved, and the costs of all patches."""
    field = PatchField(
        level.planes,
        level.usable,
        level.starts,
        np.ascontiguousarray(values),
        np.ascontiguousarray(source),
        task.covered,
        task.active,
        False,
        device,
        len(level.planes),
    )
    weights = np.asarray(_GAMMA ** -task.inside.ravel())
    for turn in range((_PASSES if number else _LAST) + (_FIRST if first else 0)):
        for jump in _JUMPS if turn == 0 else _JUMPS[1:]:
            key = int(uniform(seed, Stream.RESTORATION_SWEEP, number, turn, jump) * 2**31)
            chances = _CHANCES * (3 if first else 1)
            field.sweep(jump=jump, chances=chances, radius=max(level.starts.shape), evenness=0.0, seed=key)
        field.vote(_vote_weights(field.cost, task.active, weights))
    field.copy(_SETTLES, _FAITH, _PRICE * mean_step(level.planes, level.usable))
    return field.source, field.cost


def _vote_weights(cost: Array, active: Array, near: Array) -> Array:
    """Return the weights (K,) with which patches vote."""
    result = near.copy()
    costs = cost[active]
    spread = float(np.percentile(costs, _PERCENTILE))
    if spread > 0:
        result[active] *= np.maximum(np.exp(-costs / (2 * spread)), 1e-6)
    return np.maximum(result, 1e-12).astype(np.float32)
