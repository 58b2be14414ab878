"""Tests on ranks that observers gave: whether methods differ, and which of them (Dong, sections 6.3.2 and 6.3.3)."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from intaglio.arrays import Array, PathLike
from intaglio.checks import check_fields, checked_arguments, checked_numeric
from intaglio.errors import FileError, InputError
from intaglio.files import check_readable

# Columns of a table of ranks that hold names of rows or comments rather than ranks.
LABELS = ("texture", "observer", "misprint", "comment")


@dataclass(frozen=True)
class Friedman:
    """Result of Friedman's two-way analysis of variance by ranks.

    Attributes
    ----------
    statistic : float
        Friedman's χ², with k − 1 degrees of freedom.
    pvalue : float
        The probability of a statistic this large if all k methods are alike.
    mean_ranks : (k,) float64 array
        Mean of the ranks that each method was given; 1 is best.

    See Also
    --------
    intaglio.friedman : Computes it.

    Examples
    --------
    >>> import intaglio
    >>> result = intaglio.friedman([[1, 2, 3], [1, 2, 3], [1, 3, 2], [1, 2, 3]])
    >>> result.mean_ranks
    array([1.  , 2.25, 2.75])
    """

    statistic: float
    pvalue: float
    mean_ranks: Array

    def __post_init__(self) -> None:
        check_fields(self, nan=True)


@dataclass(frozen=True)
class MultipleComparison:
    """Result of a comparison of every pair of ranked methods.

    Attributes
    ----------
    critical_difference : float
        Mean ranks further apart than this differ significantly.
    groups : tuple of tuple of int
        The largest sets of methods among which none differs from another, best first; methods by their number from 0, best
        first.
    different : (k, k) bool array
        Which pairs differ.
    mean_ranks : (k,) float64 array
        Mean of the ranks that each method was given; 1 is best.

    See Also
    --------
    intaglio.multiple_comparison : Computes it.

    Examples
    --------
    >>> import intaglio
    >>> result = intaglio.multiple_comparison([[1, 2, 3]] * 6, alpha=0.05)
    >>> result.groups
    ((0, 1), (1, 2))
    >>> result.different
    array([[False, False,  True],
           [False, False, False],
           [ True, False, False]])
    """

    critical_difference: float
    groups: tuple[tuple[int, ...], ...]
    different: Array
    mean_ranks: Array

    def __post_init__(self) -> None:
        check_fields(self, nan=True)

    @property
    def intervals(self) -> Array:
        """Intervals about the mean ranks that are disjoint where two methods differ (the thesis, figure 6.3.1).

        Returns
        -------
        (k, 2) float64 array
            From and to.

        Examples
        --------
        >>> import intaglio
        >>> intaglio.multiple_comparison([[1, 2, 3]] * 6, alpha=0.05).intervals.round(2)
        array([[0.32, 1.68],
               [1.32, 2.68],
               [2.32, 3.68]])
        """
        half = self.critical_difference / 2
        return np.stack([self.mean_ranks - half, self.mean_ranks + half], axis=1)


@checked_arguments
def friedman(ranks: Any) -> Friedman:
    """Test whether methods that were ranked differ at all, by Friedman's analysis of variance.

    Parameters
    ----------
    ranks : (b, k) array
        A row for each of at least 2 observers and textures: the ranks from 1 (best) to k that it gave to k methods, at least
        3. Methods of equal rank have the mean of their places, such as 1.5, 1.5, 3. Rows that are not such ranks, as by
        misprints, are ranked again for the statistic.

    Returns
    -------
    Friedman
        The statistic, corrected for equal ranks, its probability, and the mean ranks.

    Raises
    ------
    InputError
        If there are fewer than 2 rows or 3 methods, or a rank is not a number from 1 to k.

    See Also
    --------
    intaglio.multiple_comparison : Which methods differ.

    References
    ----------
    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 6.3.2, eq. 6.3.1,
    which does not take equal ranks into account.

    Conover, "Practical Nonparametric Statistics", Wiley 1971: the correction for equal ranks.

    Examples
    --------
    Six observers agree on three methods:

    >>> import intaglio
    >>> result = intaglio.friedman([[1, 2, 3]] * 6)
    >>> result.statistic, round(result.pvalue, 4)
    (12.0, 0.0025)
    """
    # SciPy's statistics take long to import.
    from scipy import stats

    table = _checked_ranks(ranks)
    if (table == table[:, :1]).all():
        return Friedman(0.0, 1.0, table.mean(axis=0))
    found = stats.friedmanchisquare(*table.T)
    return Friedman(float(found.statistic), float(found.pvalue), table.mean(axis=0))


@checked_arguments
def multiple_comparison(ranks: Any, alpha: float = 0.01) -> MultipleComparison:
    """Find which of several ranked methods differ, with a bound on the probability of any false difference.

    Two methods differ if their mean ranks are further apart than q / √2 · √(k (k + 1) / (6 b)), where q is the upper ``alpha``
    point of the studentised range of k values.

    Parameters
    ----------
    ranks : (b, k) array
        Ranks from 1 (best) to k that b observers and textures gave to k methods; see `friedman`.
    alpha : float, optional
        The probability that some of the methods are found to differ although all are alike, between 0 and 1. Default 0.01, as
        in the thesis.

    Returns
    -------
    MultipleComparison
        The critical difference, the groups of methods that do not differ, the pairs that do, and the mean ranks.

    Raises
    ------
    InputError
        If there are fewer than 2 rows or 3 methods, a rank is not a number from 1 to k, or ``alpha`` is out of range.

    See Also
    --------
    intaglio.friedman : Whether methods differ at all.

    References
    ----------
    Nemenyi, "Distribution-free Multiple Comparisons", PhD thesis, Princeton University 1963.

    Hochberg & Tamhane, "Multiple Comparison Procedures", Wiley 1987.

    Dong, "Three-dimensional Surface Texture Synthesis", PhD thesis, Heriot-Watt University 2003, section 6.3.3.

    Examples
    --------
    >>> import intaglio
    >>> result = intaglio.multiple_comparison([[1, 2, 3]] * 6, alpha=0.05)
    >>> round(result.critical_difference, 3)
    1.353
    >>> bool(result.different[0, 2]), bool(result.different[0, 1])
    (True, False)
    """
    # SciPy's statistics take long to import.
    from scipy import stats

    table = _checked_ranks(ranks)
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


@checked_arguments
def read_ranks(paths: PathLike | Sequence[PathLike], methods: Sequence[str] | None = None) -> tuple[list[str], Array]:
    r"""Read ranks from one or more tables.

    Parameters
    ----------
    paths : path or sequence of path
        CSV files with a header, a column per method and a row per observer and texture; their rows are joined. Columns
        texture, observer, misprint and comment are skipped.
    methods : sequence of str, optional
        The columns to take, which are then ranked among themselves. Default None: all columns that are not skipped.

    Returns
    -------
    names : list of str
        The methods.
    ranks : (b, k) float64 array
        A row per observer and texture, a column per method; as `friedman` takes them.

    Raises
    ------
    FileError
        If a file can't be read, lacks a method or has other columns than the first, or a cell is not a rank.
    InputError
        If no file is given, or a method is named twice.

    Examples
    --------
    >>> import pathlib
    >>> import tempfile
    >>> import intaglio
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "ranks.csv")
    ...     _ = path.write_text("observer,quilt,grow,tile\nAnna,1,2,3\nBen,2,1,3\n")
    ...     names, ranks = intaglio.read_ranks(path)
    >>> names
    ['quilt', 'grow', 'tile']
    >>> ranks
    array([[1., 2., 3.],
           [2., 1., 3.]])
    """
    # SciPy's statistics take long to import.
    from scipy import stats

    given = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    if not given:
        raise InputError("paths name no table of ranks; give at least one")
    names = None if methods is None else [methods] if isinstance(methods, str) else list(methods)
    rows: list[list[float]] = []
    for path in map(check_readable, given):
        columns, ranks = _read_table(path)
        if names is None:
            names = columns
        missing = [name for name in names if name not in columns]
        if missing or (methods is None and len(columns) != len(names)):
            what = f"no column {', '.join(missing)}" if missing else f"more than {', '.join(names)}"
            asked = "" if methods is None else ", asked for by methods"
            raise FileError(f"{path}: has {what}{asked}; its columns: {', '.join(columns)}")
        if len(set(names)) < len(names):
            raise InputError(f"a method is named twice: {', '.join(names)}")
        chosen = ranks[:, [columns.index(name) for name in names]]
        # Some of the methods are ranked among themselves.
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
        raise FileError(f"{path}: is not a table of ranks, text with commas ({error})") from error
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
            raise FileError(f"{path}, line {number}: a rank is not a number ({error})") from error
        if not all(1 <= value <= len(columns) for value in row):
            raise FileError(
                f"{path}, line {number}: ranks of {len(columns)} methods are from 1 (best) to {len(columns)}, not {row}"
            )
        rows.append(row)
    return columns, np.array(rows)


def _checked_ranks(ranks: Any) -> Array:
    """Return ranks as a table, or raise `InputError`."""
    try:
        table = checked_numeric("ranks", ranks, np.float64)
    except InputError as problem:
        raise InputError(f"ranks must be a table of numbers: {problem}") from problem
    if table.ndim != 2 or table.shape[0] < 2 or table.shape[1] < 3:
        raise InputError(f"ranks must be (b, k): at least 2 rows of ranks of at least 3 methods, not {table.shape}")
    if not ((table >= 1) & (table <= table.shape[1])).all():
        raise InputError(f"ranks of {table.shape[1]} methods must be numbers from 1 (best) to {table.shape[1]}")
    return table
