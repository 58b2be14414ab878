"""Ranks that observers gave: is any method better than another, and which (Dong, sections 6.3.2 and 6.3.3)."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from intaglio.arrays import Array, PathLike
from intaglio.errors import FileError, InputError
from intaglio.files import check_readable

# Columns of a table of ranks that name its rows or remark on them.
LABELS = ("texture", "observer", "misprint", "comment")


@dataclass(frozen=True)
class Friedman:
    """Friedman's two-way analysis of variance by ranks.

    Attributes
    ----------
    statistic : float
        χ² with k − 1 degrees of freedom.
    pvalue : float
        How likely a statistic this large is if all k methods are alike.
    mean_ranks : (k,) array
        Of each method, as given; 1 is best.
    """

    statistic: float
    pvalue: float
    mean_ranks: Array


@dataclass(frozen=True)
class MultipleComparison:
    """Every pair of methods compared.

    Attributes
    ----------
    critical_difference : float
        Mean ranks further apart than this differ significantly.
    groups : tuple of tuple of int
        The largest sets of methods that do not differ among themselves, best first; methods by their number, best first.
    different : (k, k) bool array
        Which pairs differ.
    mean_ranks : (k,) array
    """

    critical_difference: float
    groups: tuple[tuple[int, ...], ...]
    different: Array
    mean_ranks: Array


def friedman(ranks: Any) -> Friedman:
    """Test whether methods that were ranked differ at all.

    Parameters
    ----------
    ranks : (b, k) array
        A row for each observer and texture: the ranks 1 (best) to k it gave to k methods, at least 3; equal ranks as the mean of
        their places, such as 1.5, 1.5, 3. Rows that are no such ranks (misprints) are ranked anew for the statistic.

    Returns
    -------
    Friedman
        The statistic is corrected for ties.

    Raises
    ------
    InputError
        If there are fewer than 2 rows or 3 methods, or a rank is not from 1 to k.

    References
    ----------
    Dong, Three-dimensional Surface Texture Synthesis (2003), equation 6.3.1, which leaves ties out of account; the correction
    is that of Conover, Practical nonparametric statistics.
    """
    table = _checked(ranks)
    if (table == table[:, :1]).all():
        return Friedman(0.0, 1.0, table.mean(axis=0))
    found = stats.friedmanchisquare(*table.T)
    return Friedman(float(found.statistic), float(found.pvalue), table.mean(axis=0))


def multiple_comparison(ranks: Any, alpha: float = 0.01) -> MultipleComparison:
    """Compare every pair of ranked methods, so that at most a share ``alpha`` of such tables shows any false difference.

    Two methods differ if their mean ranks are further apart than q / √2 · √(k (k + 1) / (6 b)), where q is the upper ``alpha``
    point of the studentised range of k values (Nemenyi 1963; the thesis' section 6.3.3 by Hochberg and Tamhane 1987).

    Parameters
    ----------
    ranks : (b, k) array
        As for `friedman`.
    alpha : float
        Between 0 and 1.

    Raises
    ------
    InputError
        As `friedman`, or for an ``alpha`` out of range.
    """
    table = _checked(ranks)
    try:
        level = float(alpha)
    except (TypeError, ValueError) as error:
        raise InputError(f"alpha must be a number between 0 and 1, not {alpha!r}") from error
    if not 0 < level < 1:
        raise InputError(f"alpha must be between 0 and 1, not {alpha!r}")
    rows, methods = table.shape
    mean = table.mean(axis=0)
    quantile = float(stats.studentized_range.ppf(1 - level, methods, np.inf))
    critical = quantile / np.sqrt(2) * np.sqrt(methods * (methods + 1) / (6 * rows))
    different = np.abs(mean[:, None] - mean[None, :]) > critical
    order = np.argsort(mean, kind="stable")
    groups: list[tuple[int, ...]] = []
    for i in range(methods):
        group = [int(m) for m in order[i:] if not different[order[i], m]]
        if not groups or not set(group) <= set(groups[-1]):
            groups.append(tuple(group))
    return MultipleComparison(float(critical), tuple(groups), different, mean)


def read_ranks(paths: PathLike | Sequence[PathLike], methods: Sequence[str] | None = None) -> tuple[list[str], Array]:
    """Read tables of ranks (CSV with a header), one below the other.

    Parameters
    ----------
    paths : path, or sequence of paths
        Each with a column per method; columns texture, observer, misprint and comment are passed over.
    methods : sequence of str, optional
        Columns to take, ranked among themselves; default all others.

    Returns
    -------
    names : list of str
    ranks : (b, k) array

    Raises
    ------
    FileError, InputError
        If a file can't be read, has other columns than the first, or holds something that is no number.
    """
    given = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    if not given:
        raise InputError("give at least one table of ranks")
    names = list(methods) if methods is not None else None
    rows: list[list[float]] = []
    for path in map(check_readable, given):
        columns, ranks = _read_table(path)
        if names is None:
            names = columns
        missing = [name for name in names if name not in columns]
        if missing or (methods is None and len(columns) != len(names)):
            what = f"no column {', '.join(missing)}" if missing else f"more than {', '.join(names)}"
            raise FileError(f"{path}: has {what}; its columns: {', '.join(columns)}")
        if len(set(names)) < len(names):
            raise InputError(f"a method is named twice: {', '.join(names)}")
        chosen = ranks[:, [columns.index(name) for name in names]]
        # Of some methods only: their ranks among themselves.
        rows += (chosen if len(names) == len(columns) else stats.rankdata(chosen, axis=1)).tolist()
    assert names is not None
    return names, np.array(rows)


def _read_table(path: Path) -> tuple[list[str], Array]:
    """Return the methods and the ranks (b, k) of one file."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            lines = [(reader.line_num, cells) for cells in reader if any(cell.strip() for cell in cells)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{path}: is no table of ranks, text with commas ({error})") from error
    header = [name.strip() for name in lines[0][1]] if lines else []
    taken = [i for i, name in enumerate(header) if name.lower() not in LABELS]
    columns = [header[i] for i in taken]
    if len(columns) < 3 or "" in columns or len(set(columns)) < len(columns):
        raise FileError(
            f"{path}: its first line must name at least 3 methods, each once, between commas; it is {', '.join(header)!r}"
        )
    if len(lines) < 2:
        raise FileError(f"{path}: holds no ranks")
    rows = []
    for number, cells in lines[1:]:
        if len(cells) != len(header):
            raise FileError(f"{path}, line {number}: has {len(cells)} cells, the first line has {len(header)}")
        try:
            row = [float(cells[i]) for i in taken]
        except ValueError as error:
            raise FileError(f"{path}, line {number}: a rank is no number ({error})") from error
        if not all(1 <= value <= len(columns) for value in row):
            raise FileError(
                f"{path}, line {number}: ranks of {len(columns)} methods are from 1 (best) to {len(columns)}, not {row}"
            )
        rows.append(row)
    return columns, np.array(rows)


def _checked(ranks: Any) -> Array:
    """Return ranks as a table, or raise `InputError`."""
    try:
        table = np.asarray(ranks, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"ranks must be a table of numbers ({error})") from error
    if table.ndim != 2 or table.shape[0] < 2 or table.shape[1] < 3:
        raise InputError(f"ranks must be (b, k): at least 2 rows of ranks of at least 3 methods, not {table.shape}")
    if not ((table >= 1) & (table <= table.shape[1])).all():
        raise InputError(f"ranks of {table.shape[1]} methods are numbers from 1 (best) to {table.shape[1]}, each row its own")
    return table
