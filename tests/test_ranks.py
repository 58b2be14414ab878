"""Friedman's test and multiple comparison: the thesis' table, exact facts, files, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from intaglio import FileError, InputError, friedman, multiple_comparison, read_ranks

NAMES = ["3I", "Gradient", "PTM", "Eigen3", "Eigen6"]

# Dong, appendix C: ten observers' ranks of 3I, Gradient, PTM, Eigen3 and Eigen6 for each of eleven textures. Two rows are
# misprinted in the thesis: their ranks don't sum to 15.
THESIS = """
1 3 2 5 4,5 3 4 1 2,5 2 4 1 3,4 3 5 1 2,4 3 5 1 2
4 2 5 1 3,1 5 2 4 3,5 3 4 1 2,4 1 5 2 3,5 1 4 3 2
4 3 5 1 2,5 2 4 1 3,4 5 3 1 2,4 5 2 3 1,5 2 4 3 1
5 2 4 3 1,4 1 5 2 3,4 3 5 1 2,4 5 2 1 3,5 4 1 2 3
1 2 5 4 3,5 4 3 1 2,5 1 4 2 3,4 1 3 5 2,5 3 4 1 2
4 1 5 3 2,4 2 1 5 3,5 1.5 4 3 1.5,5 2 3 1 4,5 2 1 4 3
5 2 4 3 1,4 2 5 1 3,5 1 4 2 3,4 3 2 1 5,5 1 4 2 3
5 2 4 1 3,4 2 5 3 1,4 1 5 3 2,4 1 5 2 3,4 5 1 2 3
5 3 4 2 1,4 1 5 2 3,5 4 1 2 3,4 1 5 2 3,5 2 4 1 3
5 1 4 2 3,5 3 4 2 1,5 3 4 2 1,3 1 5 2 4,4 5 2 3 1
5 1 4 2 3,5 4 1 3 2,4 1 5 3 2,5 2 4 1 3,5 3 4 1 2
5 3 4 1 2,5 3 4 2 1,5 1 4 3 2,5 3 4 2 1,4 2 3 1 5
5 1 3 2 4,5 2 3 1 4,5 1 3 4 2,5 3 4 2 1,5 1 3 2 4
4 5 3 2 1,4 3 1 5 2,5 2 1 4 3,5 4 1 3 2,1 4 2 3 5
2 5 1 4 3,5 2 1 3 4,4 1 3 2 5,5 1 4 2 3,5 4 3 1 2
3 4 5 2 1,5 3 4 1 2,3 2 1 5 4,1 5 2 3 4,2 4 1 3 5
4 1 3 2 5,5 1 2 4 3,4 3 1 2 5,5 1 4 3 2,5 2 4 3 1
5 4 3 2 1,5 3 2 4 1,5 4 3 2 1,5 1 4 3 2,5 1 2 4 3
5 1 2 4 3,5 3 4 1 2,5 3 1 2 4,5 3 4 1 2,5 3 4 2 1
5 3 4 2 1,5 2 4 3 1,5 2 4 3 1,4 5 3 1 3,5 4 1 2 3
2 1 4 5 3,5 1 4 3 2,4 1 2 3 5,5 2 1 4 3,4 3 5 2 1
3 4 5 2 1,2 1 3 5 4,1 2 3 4 5,3 5 1 4 3,3 4 2 5 1
"""


def thesis_ranks():
    return np.array([[float(v) for v in row.split()] for line in THESIS.split("\n") if line for row in line.split(",")])


def test_the_thesis_finds_what_the_thesis_says():
    ranks = thesis_ranks()
    assert ranks.shape == (110, 5)
    test = friedman(ranks)
    assert test.statistic == pytest.approx(108.96, abs=0.005)
    assert test.pvalue == pytest.approx(1.2e-22, rel=0.02)
    np.testing.assert_allclose(test.mean_ranks, [4.27, 2.50, 3.27, 2.43, 2.54], atol=0.005)
    pairs = multiple_comparison(ranks, 0.01)
    assert pairs.critical_difference == pytest.approx(0.694, abs=0.0005)
    named = [{NAMES[i] for i in group} for group in pairs.groups]
    assert named == [{"Gradient", "Eigen3", "Eigen6"}, {"PTM"}, {"3I"}]
    assert not pairs.different[np.ix_([1, 3, 4], [1, 3, 4])].any()
    assert pairs.different[2, [0, 1, 3, 4]].all()
    assert pairs.different[0, 1:].all()


def test_the_table_is_the_published_one(real):
    names, ranks = read_ranks([real("../papers/thesis_ranks.csv")])
    assert names == NAMES
    np.testing.assert_array_equal(ranks, thesis_ranks())


def test_the_formula_without_ties():
    rng = np.random.default_rng(0)
    ranks = np.array([rng.permutation(4) + 1 for _ in range(12)])
    b, k = ranks.shape
    sums = ranks.sum(axis=0)
    expected = 12 / (b * k * (k + 1)) * ((sums - b * (k + 1) / 2) ** 2).sum()
    assert friedman(ranks).statistic == pytest.approx(expected, rel=1e-12)


def test_all_equal_is_no_difference():
    test = friedman(np.full((6, 4), 2.5))
    assert (test.statistic, test.pvalue) == (0.0, 1.0)
    assert multiple_comparison(np.full((6, 4), 2.5)).groups == ((0, 1, 2, 3),)


def test_unanimous_ranks_differ():
    ranks = np.tile([3, 1, 2], (40, 1))
    assert friedman(ranks).pvalue < 1e-15
    pairs = multiple_comparison(ranks)
    assert pairs.groups == ((1,), (2,), (0,))


def test_groups_may_overlap():
    ranks = np.tile([1, 2, 3], (8, 1))
    pairs = multiple_comparison(ranks, 0.05)
    assert pairs.groups == ((0, 1), (1, 2))
    # Intervals are disjoint where methods differ, and nowhere else (the thesis, figure 6.3.1).
    for i in range(3):
        for j in range(3):
            apart = pairs.intervals[i, 0] > pairs.intervals[j, 1] or pairs.intervals[j, 0] > pairs.intervals[i, 1]
            assert apart == pairs.different[i, j]


@pytest.mark.parametrize(
    ("ranks", "message"),
    [
        ([[1, 2, 3]], "at least 2 rows"),
        ([[1, 2], [2, 1]], "3 methods"),
        ([[1, 2, 4], [1, 2, 3]], "from 1"),
        ([[1, 2, np.nan], [1, 2, 3]], "from 1"),
        ([[1, 2, 3], [1, 2]], "table of numbers"),
        ("x", "table of numbers"),
    ],
)
def test_bad_ranks_are_named(ranks, message):
    with pytest.raises(InputError, match=message):
        friedman(ranks)
    with pytest.raises(InputError, match=message):
        multiple_comparison(ranks)


@pytest.mark.parametrize("alpha", [0, 1, -1, np.nan, "x"])
def test_bad_alpha_is_named(alpha):
    with pytest.raises(InputError, match="alpha"):
        multiple_comparison([[1, 2, 3], [1, 2, 3]], alpha)


def test_tables_are_read_one_below_the_other(tmp_path):
    (tmp_path / "a.csv").write_text("\ufefftexture,observer,x,y,z\nbark,1,1,2,3\n", encoding="utf-8")
    (tmp_path / "b.csv").write_text("z, y ,x,comment\n1,2,3,none\n")
    names, ranks = read_ranks([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert names == ["x", "y", "z"]
    np.testing.assert_array_equal(ranks, [[1, 2, 3], [3, 2, 1]])
    assert read_ranks(tmp_path / "a.csv", ["z", "x"])[1].tolist() == [[2, 1]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n\n1,2,a\n", "line 3: a rank is not a number"),
        ("x,y,z\n1,2\n", "line 2: has 2 cells"),
        ("x,y,z\n1,2,3,4\n", "line 2: has 4 cells"),
        ("x,y,z\n1,2,4\n", "line 2: ranks of 3 methods"),
        ("x,y,z\n1,2,nan\n", "line 2: ranks of 3 methods"),
        ("x,y,z\n", "holds no ranks"),
        ("x;y;z\n1;2;3\n", "at least 3 methods"),
        ("x,y,y\n1,2,3\n", "each once"),
        ("\x00\xff", "not a table of ranks"),
        (" ", "first line"),
    ],
)
def test_bad_tables_are_named(text, message, tmp_path):
    path = tmp_path / "ranks.csv"
    path.write_text(text, encoding="latin-1")
    with pytest.raises((FileError, InputError), match=message):
        read_ranks([path])
    (tmp_path / "c.csv").write_text("x,y,z\n1,2,3\n")
    with pytest.raises(FileError, match="has no column w"):
        read_ranks([tmp_path / "c.csv"], ["w"])
    (tmp_path / "d.csv").write_text("x,y,z,w\n1,2,3,4\n")
    with pytest.raises(FileError, match="has more than x, y, z"):
        read_ranks([tmp_path / "c.csv", tmp_path / "d.csv"])
    with pytest.raises(InputError, match="named twice"):
        read_ranks([tmp_path / "c.csv"], ["x", "x", "y"])
    with pytest.raises(InputError, match="at least one"):
        read_ranks([])
