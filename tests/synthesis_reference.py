"""Slow, plain NumPy versions of quilting and of pixel synthesis, in raster order, to hold the kernels against."""

from __future__ import annotations

import numpy as np

from intaglio.randomness import uniform


def exact_sample(shape, maps, seed=0):
    """Maps in 256ths from 0 to 1, smooth enough to have structure: all sums of their differences are exact in float32."""
    rng = np.random.default_rng(seed)
    noise = rng.random((*shape, maps))
    for axis in (0, 1):
        noise = noise + np.roll(noise, 1, axis) + np.roll(noise, 2, axis)
    low, high = noise.min(axis=(0, 1)), noise.max(axis=(0, 1))
    return np.round((noise - low) / (high - low) * 256).astype(np.float32) / 256


def starts(length, block, overlap, wrap):
    step = block - overlap
    if wrap:
        count = max(2, int(np.ceil(length / step)))
        return [i * length // count for i in range(count)]
    found = [0]
    while found[-1] + block < length:
        found.append(found[-1] + step)
    return found


def cut_distance(error):
    """How far from the side the seam runs: ``error`` (along, across), across counted from that side."""
    along, wide = error.shape
    edge = error + np.concatenate([error[:, :1], error[:, :-1]], axis=1)
    total = np.zeros((along, wide))
    total[0] = edge[0]

    def arrivals(a, x):
        found = [(total[a - 1, x], x)]
        if x > 0:
            found.append((total[a - 1, x - 1] + error[a - 1, x - 1] + error[a, x - 1], x - 1))
        if x + 1 < wide:
            found.append((total[a - 1, x + 1] + error[a - 1, x] + error[a, x], x + 1))
        return found

    for a in range(1, along):
        for x in range(wide):
            total[a, x] = edge[a, x] + min(c for c, _ in arrivals(a, x))
    at = int(np.argmin(total[-1]))
    path = [at]
    for a in range(along - 1, 0, -1):
        at = min(arrivals(a, at), key=lambda pair: pair[0])[1]
        path.append(at)
    return np.array(path[::-1])


def quilt_reference(sample, size, block, overlap, tolerance, *, seed, tileable=False, squared=False, shortcut=False, mask=None):
    """Provenance (H, W, 2) of quilting in raster order, every candidate compared in full."""
    ys, xs = (starts(n, block, overlap, tileable) for n in size)
    shape = size if tileable else (ys[-1] + block, xs[-1] + block)
    source = np.full((*shape, 2), -1)
    chosen = {}
    window = np.lib.stride_tricks.sliding_window_view(sample.astype(np.float64), (block, block), axis=(0, 1))
    window = np.moveaxis(window, 2, -1)
    usable = np.ones(window.shape[:2], bool)
    if mask is not None:
        usable = np.lib.stride_tricks.sliding_window_view(mask, (block, block)).all(axis=(2, 3))
    for i, y in enumerate(ys):
        for j, x in enumerate(xs):
            rows, columns = (y + np.arange(block)) % shape[0], (x + np.arange(block)) % shape[1]
            old = source[np.ix_(rows, columns)]
            known = old[..., 0] >= 0
            under = sample[old[..., 0], old[..., 1]].astype(np.float64)
            away = np.abs(window - under) * known[:, :, None]
            cost = (away**2 if squared else away).sum(axis=(2, 3, 4))
            cost[~usable] = np.inf
            listed = np.argwhere(cost <= cost.min() * (1 + tolerance))
            # Counted as the search lists them: in groups of 4 rows and 16 columns.
            listed = sorted(map(tuple, listed.tolist()), key=lambda c: (c[0] // 4, c[1] // 16, c[0] % 4, c[1] % 16))
            u = np.float32(uniform(seed, 40, np.array(y), np.array(x)))
            pick = listed[min(len(listed) - 1, int(u * np.float32(len(listed))))]
            last = tileable and (y + block > shape[0] or x + block > shape[1])
            if shortcut and not last:
                before = [p for p in ((i, j - 1), (i - 1, j), (i - 1, j - 1)) if p in chosen]
                next_to = {(chosen[p][0] + y - ys[p[0]], chosen[p][1] + x - xs[p[1]]) for p in before}
                if len(next_to) == 1:
                    one = next_to.pop()
                    if one[0] < usable.shape[0] and one[1] < usable.shape[1] and usable[one]:
                        pick = one
            chosen[i, j] = pick
            new = np.stack(np.meshgrid(pick[0] + np.arange(block), pick[1] + np.arange(block), indexing="ij"), axis=2)
            error = away[pick].sum(axis=2) if not squared else (away[pick] ** 2).sum(axis=2)
            take = np.ones((block, block), bool)
            at = np.arange(block)
            if j > 0:
                wide = block - (x - xs[j - 1])
                take &= at[None, :] >= cut_distance(error[:, :wide])[:, None]
            if i > 0:
                wide = block - (y - ys[i - 1])
                take &= at[:, None] >= cut_distance(error[:wide].T)[None, :]
            wide = x + block - shape[1]
            if tileable and wide > 0:
                take &= block - 1 - at[None, :] >= cut_distance(error[:, ::-1][:, :wide])[:, None]
            wide = y + block - shape[0]
            if tileable and wide > 0:
                take &= block - 1 - at[:, None] >= cut_distance(error[::-1][:wide].T)[None, :]
            source[np.ix_(rows, columns)] = np.where((take | ~known)[..., None], new, old)
    return source[: size[0], : size[1]]


def best_neighbourhood(planes, above, candidates, known, above_known, squared):
    """Least cost of a comparison with all candidates, and the pixels that have it.

    ``known`` and ``above_known`` are lists of (offset, value (n,)) around the pixel and around its parent.
    """
    y, x = candidates[:, 0], candidates[:, 1]
    cost = np.zeros(len(candidates))
    for (dy, dx), value in known:
        d = np.abs(planes[:, y + dy, x + dx].T.astype(np.float64) - value)
        cost += (d * d if squared else d).sum(axis=1)
    for (dy, dx), value in above_known:
        d = np.abs(above[:, y // 2 + dy, x // 2 + dx].T.astype(np.float64) - value)
        cost += (d * d if squared else d).sum(axis=1)
    return cost.min(), {tuple(c) for c in candidates[cost <= cost.min() * (1 + 1e-6) + 1e-6]}
