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

from intaglio.errors import FileError, InputError
from intaglio.files import check_readable

Array = np.ndarray

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


def read_ranks(paths: Sequence[str | os.PathLike[str]], methods: Sequence[str] | None = None) -> tuple[list[str], Array]:
    """Read tables of ranks (CSV with a header), one below the other.

    Parameters
    ----------
    paths : sequence of path
        Each with a column per method; columns texture, observer, misprint and comment are passed over.
    methods : sequence of str, optional
        Columns to take; default all others.

    Returns
    -------
    names : list of str
    ranks : (b, k) array

    Raises
    ------
    FileError, InputError
        If a file can't be read, has other columns than the first, or holds something that is no number.
    """
    if not paths:
        raise InputError("give at least one table of ranks")
    names: list[str] = list(methods) if methods is not None else []
    rows = []
    for given in paths:
        path = check_readable(given)
        try:
            with open(path, newline="", encoding="utf-8-sig") as file:
                reader = csv.DictReader(file)
                header = [name.strip() for name in reader.fieldnames or []]
                reader.fieldnames = header
                lines = list(reader)
        except (UnicodeDecodeError, csv.Error) as error:
            raise FileError(f"{path}: is no table of ranks, text with commas ({error})") from error
        if not names:
            names = [name for name in header if name.lower() not in LABELS]
        missing = [name for name in names if name not in header]
        if missing:
            raise FileError(f"{path}: has no column {', '.join(missing)}; its columns: {', '.join(header)}")
        rows += [_numbers(path, number, line, names) for number, line in enumerate(lines, 2)]
    if not rows:
        raise FileError(f"{paths[0]}: holds no ranks")
    return names, np.array(rows)


def _numbers(path: Path, line: int, cells: dict[str, str], names: Sequence[str]) -> list[float]:
    try:
        return [float(cells[name]) for name in names]
    except (TypeError, ValueError) as error:
        raise FileError(f"{path}, line {line}: a rank is missing or no number ({error})") from error


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
