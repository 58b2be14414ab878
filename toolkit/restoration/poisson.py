"""Seam correction: filled pixels take the differences between neighbours of what they copy (Pérez et al. 2003)."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from intaglio.arrays import Array
from intaglio.restoration.fill import ORIENTATIONS
from intaglio.sparse import solve_symmetric


def fit_to_surroundings(
    filled: Array, band: Array, source: Array, turn: Array, missing: Array, chart: Array, *, reach: float = 100.0
) -> Array:
    """Return the band (H, W, C) with its missing pixels fitted to known neighbours and to their sources' differences.

    Minimises sum (u_p - u_q - g_pq)^2 over neighbours p, q of which one at least is missing; g_pq is the difference between
    the source of p and the pixel beside it in q's direction, the mean of both ends' where both are filled. A step at the
    border decays as exp(-distance / reach).

    Parameters
    ----------
    filled : (H, W, C) array
        Known pixels, and in missing ones what they copy.
    band : (H, W, C) array
        What is copied from.
    source : (H, W, 2) int array
    turn : (H, W) int array
        Orientation, of `ORIENTATIONS`, in which a pixel's surroundings appear about its source.
    missing : (H, W) bool array
    chart : (H, W) int array
        Pixels of different charts are not neighbours; 0 is outside of all.
    reach : float, optional
        In pixels. Default 100: no more than islands without a known neighbour need to be determined.
    """
    pull = 1 / reach**2
    number = np.full(missing.shape, -1)
    number[missing] = np.arange(missing.sum())
    count = int(missing.sum())
    if count == 0:
        return filled
    height, width = missing.shape
    diagonal = np.zeros(count)
    right = np.zeros((count, filled.shape[2]))
    rows, columns = [], []
    y, x = np.nonzero(missing)
    usable = chart > 0
    for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        ny, nx = y + dy, x + dx
        inside = (ny >= 0) & (ny < height) & (nx >= 0) & (nx < width)
        py, px, qy, qx = y[inside], x[inside], ny[inside], nx[inside]
        same = usable[qy, qx] & (chart[py, px] == chart[qy, qx])
        py, px, qy, qx = py[same], px[same], qy[same], qx[same]
        p = number[py, px]
        wanted = _difference(band, source[py, px], ORIENTATIONS[turn[py, px]] @ (dy, dx), missing, chart)
        back = _difference(band, source[qy, qx], ORIENTATIONS[turn[qy, qx]] @ (-dy, -dx), missing, chart)
        both = np.isfinite(back[:, 0]) & missing[qy, qx]
        wanted = np.where(both[:, None], np.where(np.isfinite(wanted), (wanted - back) / 2, -back), wanted)
        # If the source of neither end has such a neighbour, the difference of the filled values is kept.
        wanted = np.where(np.isfinite(wanted), wanted, filled[py, px] - filled[qy, qx])
        diagonal += np.bincount(p, minlength=count)
        known = ~missing[qy, qx]
        for c in range(filled.shape[2]):
            amount = wanted[:, c] + np.where(known, filled[qy, qx, c], 0)
            right[:, c] += np.bincount(p, amount, count)
        rows.append(p[~known])
        columns.append(number[qy, qx][~known])
    r, c_ = np.concatenate(rows), np.concatenate(columns)
    start = filled[missing].astype(np.float64)
    right += pull * start
    off = csr_array((np.full(len(r), -1.0), (r, c_)), shape=(count, count))
    system = off + csr_array((diagonal + pull, np.arange(count), np.arange(count + 1)), shape=(count, count))
    result = filled.copy()
    result[missing] = solve_symmetric(csr_array(system), right, start)
    return result


def _difference(band: Array, at: Array, step: Array, missing: Array, chart: Array) -> Array:
    """Return value(at) - value(at + step), (M, C); NaN where the neighbour is not known or of another chart."""
    beside = at + step
    inside = ((beside >= 0) & (beside < missing.shape)).all(axis=1)
    safe = np.where(inside[:, None], beside, at)
    known = inside & ~missing[safe[:, 0], safe[:, 1]]
    known &= chart[safe[:, 0], safe[:, 1]] == chart[at[:, 0], at[:, 1]]
    found = band[at[:, 0], at[:, 1]].astype(np.float64) - band[safe[:, 0], safe[:, 1]]
    found[~known] = np.nan
    return np.asarray(found)
